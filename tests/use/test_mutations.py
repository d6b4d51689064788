"""Junk in, a message out: whatever is done to a valid scenario or mechanism, only errors of pinarm come out.

A value is replaced, deleted or copied elsewhere, up to three times; the file is then read, run, checked and saved.
"""

import json
import math
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import pinarm
from pinarm.errors import PinarmError
from pinarm.input.yaml.document import Document

EXPECT = """
expect:
  - {quantity: alpha, at: {PLACE, occurrence: 1, side: left}, value: 0.5 rad, atol: 1 rad, source: s}
  - {quantity: M, at: max, published: 20.0 N*m, because: 20*alpha, verdict: rounding, value: 20 N*m, source: s}
  - {quantity: M, formula: 1*M, published_formula: 2*M + 1, verdict: misprint, rtol: 1e-3, source: s}
symbols: {twice: 2*alpha, more: twice + 1}
accuracy: {tolerance: 1e-6, max_steps: 3000}
payloads: {sack: {point: tip, mass: 1 kg, inertia: [0 kg*m^2, 1 kg*m^2, 1 kg*m^2]}}
gravity: {direction: x, magnitude: 1 m/s^2}
"""
LOADS = """\
  loads:
    a: {kind: joint_spring, joint: pivot, stiffness: 1 N*m, damping: 1 N*m*s, rest: 1 rad}
    b: {kind: joint_effort, joint: pivot, effort: {law: cycloidal, from: 0 N*m, to: 1 N*m, duration: 1 s, begin: 1 s}}
    c: {kind: joint_effort, joint: pivot, over: pivot, period: 360 deg,
        effort: {law: spline, points: [[0 deg, 1 N*m], [90 deg, 2 N*m], [270 deg, 2 N*m], [360 deg, 1 N*m]]}}
"""
AT_REST = LOADS.replace("{law: cycloidal, from: 0 N*m, to: 1 N*m, duration: 1 s, begin: 1 s}",
                        "{law: constant, value: 1 N*m}")  # fmt: skip
JUNK = [
    None, True, False, 0, 1, -1, 7, 0.5, 1e308, -1e-320, math.nan, math.inf, 10**399, "", " ", "x", "alpha", "pivot",
    "M",
    "rod", "0", "1", "-1 m", "1e308 rad", "30 deg", "1e-300 s", "-1 s", "1 kg", "1 h^99", "1/um^99", "1 Hz",
    "1e999 N*m",
    "twice", "more", "sqrt(-alpha - 1)", "1/0", "alpha**alpha**99", "max", "file", "q", "..", "../..",
    "/etc/passwd.yaml",
    "pendulum.yaml", "pendulum.urdf", "a\0b", "\x1b[2J", "[/]", "$\\foo{", "é\U0001f600", "\ud800", "x" * 3000,
    [], {}, [[]],
    [1, "1 m"], {"x": 1}, {"": ""}, {"kind": "statics"}, {"law": "harmonic"}, {"t": "1 s"}, {"pivot": "abc"},
    {"alpha": "0.5 rad", "occurrence": "x"}, {"pivot": {"law": "constant", "value": "1e200 rad"}},
]  # fmt: skip


def places(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


def mutate(data: Any, chance: Random) -> None:
    """Change one place of the data."""
    known = list(places(data))
    if not known:
        return
    path = chance.choice(known)
    holder = data
    for key in path[:-1]:
        holder = holder[key]
    what = chance.choice(["replace", "replace", "replace", "delete", "copy", "rename"])
    if what == "replace":
        holder[path[-1]] = chance.choice(JUNK)
    elif what == "copy":
        other = chance.choice(known)
        value = data
        for key in other:
            value = value[key]
        holder[path[-1]] = json.loads(json.dumps(value))
    else:
        value = holder.pop(path[-1])
        if what == "rename" and isinstance(holder, dict):
            holder[chance.choice([text for text in JUNK if isinstance(text, str)])] = value


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Fail where the block hangs; a loaded machine takes ten times as long as a free one, and no longer."""

    def ring(*_: object) -> None:
        raise AssertionError(f"no answer after {seconds} s")

    previous = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)


def dumped(data: Any) -> str:
    """JSON is YAML, but for the names of what is no number."""
    return json.dumps(data).replace("NaN", ".nan").replace("Infinity", ".inf")


WHEEL = """\
  <link name="wheel"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="crank" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 1 0"/></joint>
</robot>
"""
"""Beside the pendulum, so that a profile can run along it."""
AT = {"statics": "pivot: 10 deg", "inverse": "t: 1 s", "forward": "t: 1 s", "kinematics": "t: 1 s", "state": "row: 0",
      "equilibria": "row: 1"}  # fmt: skip
EFFORTLESS = {"kinematics"}


def whole(kind: str, scenario: Callable[..., Any], folder: Path) -> Any:
    """Return a scenario of a kind with every key that it may have."""
    expect = EXPECT.replace("PLACE", AT[kind])
    loads = LOADS if kind in ("inverse", "forward") else AT_REST
    if kind in EFFORTLESS:
        model = (folder / "pendulum.urdf").read_text()
        (folder / "pendulum.urdf").write_text(model if "wheel" in model else model.replace("</robot>\n", WHEEL))
        expect, loads = expect.replace("quantity: M", "quantity: alpha").replace("2*M + 1", "2*alpha + 1"), ""
        expect = expect.replace("1*M", "1*alpha").replace("20 N*m", "20 rad").replace("20.0 N*m", "20.0 rad")
    return scenario(kind, expect, ("outputs: [", loads + "outputs: [twice, "))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of numpy, where numbers overflow
@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow if kind not in ("statics", "inverse") else ()) for kind in AT]
)
@settings(
    max_examples=25, deadline=None, derandomize=True, database=None,
    phases=[Phase.explicit, Phase.generate],  # shrinking would take longer than the test

    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)  # fmt: skip
@given(seed=st.integers(0, 2**32))
def test_only_errors_of_pinarm_come_out(scenario: Callable[..., Any], folder: Path, kind: str, seed: int) -> None:
    chance = Random(seed)
    whole(kind, scenario, folder)
    files = {name: Document.read(folder / name).data for name in (f"{kind}.yaml", "pendulum.yaml")}
    originals = {name: (folder / name).read_text() for name in files}
    for _ in range(chance.choice([1, 1, 2, 3])):
        mutate(files[chance.choice([f"{kind}.yaml", f"{kind}.yaml", "pendulum.yaml"])], chance)
    for name, data in files.items():
        (folder / name).write_text(dumped(data))
    try:
        with within(60.0):
            loaded = pinarm.load(folder / f"{kind}.yaml")
            loaded.validate()
            result = loaded.run()
            pinarm.check(loaded, result=result)
            result.save(folder / "out", plots=False)
    except PinarmError as error:
        assert str(error)
    finally:
        for name, text in originals.items():
            (folder / name).write_text(text)


@pytest.mark.parametrize("kind", AT)
def test_what_is_mutated_is_valid(scenario: Callable[..., Any], folder: Path, kind: str) -> None:
    loaded = whole(kind, scenario, folder)
    loaded.validate()
    assert len(pinarm.check(loaded)) == 3
