"""Whatever a file holds, the command ends, within 2 GB, with an answer or with exit code 2."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

GIGABYTES, PATIENCE = 2.0, 120.0  # of memory; seconds after which it hangs, ten times what the slowest file takes

LINK = ("<link name='{0}'><inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
        "</inertial></link>")  # fmt: skip
JOINT = "<joint name='{1}_{0}' type='continuous'><parent link='{1}'/><child link='{0}'/><axis xyz='0 1 0'/></joint>"
ROD = f"<robot name='r'><link name='base'/>{LINK.format('rod')}{JOINT.format('rod', 'base')}</robot>"
HEAD = "pinarm: 1\nmechanism: rod.urdf\n"
LAW = "{law: constant, value: 1 rad}"
PROBLEM = "problem: {kind: inverse, time: {end: 1 s, samples: 3}, motion: {base_rod: LAW}}\noutputs: [base_rod]\n"
SCENARIO = HEAD + PROBLEM.replace("LAW", LAW)
ENTRY = "  - {quantity: QUANTITY, value: 0.0 rad, source: s}\n"


def links(count: int, parent: Callable[[int], str]) -> str:
    parts = (LINK.format(f"l{n}") + JOINT.format(f"l{n}", parent(n)) for n in range(count))
    return f"<robot name='r'><link name='base'/>{''.join(parts)}</robot>"


def with_law(law: str) -> str:
    return HEAD + PROBLEM.replace("LAW", law)


def loaded(kind: str, count: int) -> str:
    return SCENARIO.replace("}}\nout", "}, loads: {" + ", ".join(f"f{n}: {kind}" for n in range(count)) + "}}\nout")


SCENARIOS: dict[str, Callable[[], str | bytes]] = {
    "brackets": lambda: "[" * 900_000,
    "digits": lambda: "pinarm: " + "9" * 900_000,
    "numbers": lambda: f"a: [{','.join('1' * 400_000)}]",
    "keys": lambda: "".join(f"k{n}: 1\n" for n in range(90_000)),
    "long key": lambda: "k" * 900_000 + ": 1",
    "long text": lambda: f"{SCENARIO}title: '{'x' * 900_000}'\n",
    "comments": lambda: "#\n" * 400_000 + SCENARIO,
    "too large": lambda: "#" * 2_000_000,
    "deep formula": lambda: SCENARIO.replace("[base_rod]", f"['{'(' * 900}base_rod{')' * 900}']"),
    "symbols in a chain": lambda: SCENARIO.replace("[base_rod]", "[s0]")
    + "symbols: {" + ", ".join(f"s{n}: s{n + 1} + s{n + 1}" for n in range(5000)) + "}\n",
    "unit without end": lambda: with_law("{law: constant, value: 1 " + "rad*" * 200_000 + "}"),
    "points without end": lambda: with_law(
        "{law: spline, points: [" + ",".join(f"[{n} s, 1 rad]" for n in range(50_000)) + "]}"),
    "points that jump": lambda: with_law(
        "{law: speed_points, points: [" + ",".join(f"[{n} us, {n % 7} rad/s]" for n in range(12_000)) + "]}"),
    "profile passed without end": lambda: with_law(
        "{law: over, of: base_rod, period: 1e-300 rad, profile: " + LAW + "}"),
    "table that is a pipe": lambda: with_law("{law: table, file: pipe.csv}"),
    "table that has no end": lambda: with_law("{law: table, file: large.csv}"),
    "table of one line": lambda: with_law("{law: table, file: line.csv}"),
    "many loads": lambda: loaded("{kind: wrench, point: rod}", 5000),
    "many answers": lambda: SCENARIO + "expect:\n" + "".join(
        ENTRY.replace("QUANTITY", f"base_rod*{n}") for n in range(5000)),
}  # fmt: skip

MODELS: dict[str, Callable[[], str]] = {
    "chain of 1999 links": lambda: links(1999, lambda n: f"l{n - 1}" if n else "base"),
    "star of 1999 links": lambda: links(1999, lambda n: "base"),
    "masses beyond numbers": lambda: ROD.replace("value='1'", "value='1e308'").replace("ixx='1'", "ixx='1e308'"),
    "mesh elsewhere": lambda: ROD.replace(
        "</inertial>", "</inertial><collision><geometry><mesh filename='file:///dev/zero'/></geometry></collision>"),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "rod.urdf").write_text(ROD)
    return tmp_path


@pytest.fixture
def answer(folder: Path, spend: Callable[..., Any]) -> Callable[..., tuple[int, str]]:
    """Return a function that runs a command, holds it to its limits, and returns its exit code and what it said."""

    def run(*arguments: str) -> tuple[int, str]:
        spent = spend(folder, *arguments, limit=PATIENCE, OPENBLAS_NUM_THREADS="1")
        assert spent.status in (0, 2, 3), spent.text[-2000:]
        assert "Traceback" not in spent.text, spent.text[-2000:]
        assert spent.peak < GIGABYTES * 1e9
        assert not (folder / "canary").exists()
        return spent.status, spent.text

    return run


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_is_read_or_refused_in_time(folder: Path, name: str, answer: Callable[..., Any]) -> None:
    content = SCENARIOS[name]()
    (folder / "s.yaml").write_bytes(content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content)
    os.mkfifo(folder / "pipe.csv")
    if name == "table that has no end":
        (folder / "large.csv").write_text(
            "t [s],x [rad]\n" + "".join(f"{n},{n}.123456789012\n" for n in range(2_300_000))
        )
    if name == "table of one line":
        (folder / "line.csv").write_text("t [s],x [rad]" + ",1" * 20_000_000)
    code, _ = answer("validate", "s.yaml")
    assert code == (0 if name in ("comments", "long text", "many loads", "many answers", "points that jump") else 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_a_model_is_read_or_refused_in_time(folder: Path, name: str, answer: Callable[..., Any]) -> None:
    (folder / "rod.urdf").write_text(MODELS[name]())
    (folder / "s.yaml").write_text(SCENARIO)
    code, _ = answer("run", "s.yaml", "--no-plots", "-o", "out")
    assert code == (0 if name == "mesh elsewhere" else 2)


@pytest.mark.parametrize("command", ["run", "explain"])
def test_a_pipe_in_place_of_a_scenario_keeps_nobody_waiting(
    folder: Path, command: str, answer: Callable[..., Any]
) -> None:
    os.mkfifo(folder / "s.yaml")
    code, said = answer(command, "s.yaml")
    assert (code, "not a regular file" in said) == (2, True)
