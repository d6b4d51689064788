"""The command line: exit codes, what goes to which stream, and what is left on the disk."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import pinarm
from pinarm.cli.main import COMMANDS, _parser, main

URDF = """\
<robot name="pendulum">
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 -1"/><mass value="2"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint>
</robot>
"""
MECHANISM = "pinarm: 1\nrobot: pendulum.urdf\ngravity: {magnitude: 10 m/s^2}\nsymbols: {M: joint.pivot.effort}\n"
SCENARIO = """\
pinarm: 1
title: Held
mechanism: pendulum.yaml
problem: {kind: statics, over: {pivot: {from: 0 deg, to: 180 deg, samples: 9}}}
outputs: [M]
expect:
  - {quantity: M, at: max, value: 20 N*m, source: by hand}
"""
FORWARD = """\
pinarm: 1
mechanism: pendulum.yaml
problem:
  kind: forward
  time: {end: 0.3 s, samples: 31}
  loads: {push: {kind: joint_effort, joint: pivot, effort: EFFORT}}
outputs: [pivot]
accuracy: {tolerance: 1e-2}
"""
BLOW_UP = "{law: constant_speed, from: 1 N*m, speed: 1e7 N*m/rad}, over: pivot"  # grows e-fold every 0.5 ms


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A root with a model and a scenario in it, as the working directory."""
    for name, text in {
        ".pinarm-root": "", "pendulum.urdf": URDF, "pendulum.yaml": MECHANISM, "a.yaml": SCENARIO,
        "blow.yaml": FORWARD.replace("EFFORT", BLOW_UP), "bad.yaml": SCENARIO.replace("statics", "static"),
        "miss.yaml": SCENARIO.replace("20 N*m", "21 N*m"),
    }.items():  # fmt: skip
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def shell(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pinarm", *arguments]
    paths = os.pathsep.join(path for path in sys.path if path)
    environment = {**os.environ, "PYTHONPATH": paths, **environment}
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60, check=False)


def strict_json(text: str) -> Any:
    """JSON as the standard has it: NaN and Infinity are not."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    return json.loads(text, parse_constant=refuse)


# ---------------------------------------------------------------------------------------------------------- run


def test_run_writes_a_result_and_says_where(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "a.yaml"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("Held\n")
    assert "written to results/a" in out
    assert err == ""
    assert set(files(here / "results/a")) >= {"scenario.yaml", "summary.json", "trajectory.csv", "timing.json"}


def test_run_json_elsewhere_without_plots(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "a.yaml", "--json", "--no-plots", "-o", "there/deep"]) == 0
    summary = strict_json(capsys.readouterr().out)
    assert summary["outputs"]["M"]["max"] == pytest.approx(20.0, rel=1e-14)  # rounding
    assert summary["folder"] == "there/deep"
    assert (here / "there/deep/trajectory.csv").is_file()
    assert not list(here.rglob("*.svg"))
    assert not (here / "results").exists()


JSON = {
    "new": "new arm -o arm", "run": "run a.yaml --no-plots", "check": "check a.yaml", "validate": "validate a.yaml",
    "explain": "explain a.yaml", "quantities": "quantities a.yaml", "report": "report out", "replay": "replay out",
    "sweep": "sweep a.yaml --over problem.over.pivot.to='90, 180 deg' --no-plots -j 1",
    "tradeoff": "tradeoff soft.yaml --no-plots", "schema": "schema", "examples": "examples", "selftest": "selftest",
    "lab": "lab a.yaml -o sheet.ipynb",
}  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_prints_json(here: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    (here / "soft.yaml").write_text(FORWARD.replace("EFFORT", "{law: constant, value: 1 N*m}"))
    if command in ("report", "replay"):
        assert main(["run", "a.yaml", "--no-plots", "-o", "out"]) == 0
        capsys.readouterr()
    assert main([*shlex.split(JSON[command]), "--json"]) == 0
    assert strict_json(capsys.readouterr().out)


def test_explain_json_tells_the_mobility(capsys: pytest.CaptureFixture[str]) -> None:
    """Three pins and a fourth that closes the loop, all parallel: of its 5 rows the 3 out of the plane say nothing."""
    crank_rocker = Path(pinarm.__file__).parents[1] / "models" / "crank_rocker" / "mechanism.yaml"
    assert main(["explain", str(crank_rocker), "--json"]) == 0
    said = strict_json(capsys.readouterr().out)
    assert [said[key] for key in ("joints", "rows", "rank", "degree", "mobility")] == [3, 5, 2, 3, 1]
    assert said["undetermined"].keys() == {"B", "theta2", "A", "theta4"}


def test_set_replaces_values(capsys: pytest.CaptureFixture[str]) -> None:
    wanted = ["--set", "problem.over.pivot.to=30 deg", "--set", "expect.0.value=10 N*m", "--json", "--no-plots"]
    assert main(["run", "a.yaml", "-o", "out", *wanted]) == 0
    assert strict_json(capsys.readouterr().out)["outputs"]["M"]["max"] == pytest.approx(10.0, rel=1e-14)  # rounding
    assert main(["check", "a.yaml", *wanted[:4]]) == 0
    assert main(["check", "a.yaml", *wanted[:2]]) == 1


@pytest.mark.parametrize("words", [
    "run bad.yaml", "run nofile.yaml", "run missing.urdf", "run .", "run a.yaml --set title",
    "run a.yaml --set titel=x", "run a.yaml --set outputs.7=M", "run a.yaml --set outputs.²=M",
    "run a.yaml --set mechanism=../../etc/passwd.yaml", "run a.yaml --set problem.over.pivot.to='1 h^99'",
    "run a.yaml --set outputs.0=N", "check a.yaml --set expect.0.value='1 kg'", "check bad.yaml a.yaml",
    "validate a.yaml --set problem.over.pivot.to=1", "validate nofile.yaml", "report a.yaml -o report.docx",
    "report nothing",
])  # fmt: skip
def test_bad_input_is_exit_2_and_nothing_is_written(here: Path, capsys: pytest.CaptureFixture[str], words: str) -> None:
    before = files(here)
    assert main(shlex.split(words)) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert "Traceback" not in err
    assert files(here) == before


def test_a_traceback_only_where_it_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    main(["run", "bad.yaml", "--traceback"])
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_failed_numerics_are_exit_3_and_the_rest_is_kept(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A torque that grows to 1e306 N*m from 0.1 s on: the first row beyond is told, and all rows are kept."""
    assert main(["run", "blow.yaml", "-o", "out", "--no-plots"]) == 3
    out, err = capsys.readouterr()
    assert out == ""
    assert "too large to be checked, from t = 0.18 s" in err
    assert "kept: 31 rows in out/partial" in err
    assert (here / "out/partial/trajectory.csv").read_text().count("\n") == 32
    notes = json.loads((here / "out/partial/summary.json").read_text())["notes"]
    assert any(note.startswith("the numerics failed, and what there was by then is not checked: ") for note in notes)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_failures_leave_an_older_result_alone(here: Path) -> None:
    main(["run", "a.yaml", "-o", "out", "--no-plots"])
    before = files(here / "out")
    assert main(["run", "a.yaml", "-o", "out", "--set", "outputs.0=N"]) == 2
    assert files(here / "out") == before
    assert main(["run", "blow.yaml", "-o", "out", "--no-plots"]) == 3
    assert {name: text for name, text in files(here / "out").items() if not name.startswith("partial/")} == before


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_an_accuracy_that_is_not_a_number_is_no_success(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At 1e159 rad the motion stays finite, its energy does not: no figure says what the numbers are worth."""
    (here / "x.yaml").write_text(FORWARD.replace("EFFORT", BLOW_UP).replace("end: 0.3 s", "end: 0.19 s"))
    assert main(["run", "x.yaml", "--no-plots"]) != 0
    capsys.readouterr()


# ------------------------------------------------------------------------------------------------------- report


def test_report_writes_one_document_on_results(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "a.yaml", "-o", "out", "--no-plots"]) == 0
    capsys.readouterr()
    assert main(["report", "out"]) == 0
    assert capsys.readouterr().out == "written to out/report.html\n"
    assert main(["run", "a.yaml", "-o", "out", "--no-plots"]) == 0  # the report is ours, and may be replaced
    capsys.readouterr()
    assert main(["report", "out", "out", "-o", "both.html", "--title", "Two <runs>", "--json"]) == 0
    said = strict_json(capsys.readouterr().out)
    page = (here / "both.html").read_text()
    assert page.count("<article") == 2
    assert "<h1>Two &lt;runs&gt;</h1>" in page
    assert said == {"file": "both.html", "bytes": len(page.encode())}


# -------------------------------------------------------------------------------------------- check and validate


def test_check_is_exit_1_where_an_expectation_is_missed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "a.yaml"]) == 0
    assert "1 agrees" in capsys.readouterr().out
    assert main(["check", "a.yaml", "miss.yaml"]) == 1
    out, err = capsys.readouterr()
    assert "1 agrees; 1 MISS" in out
    assert "MISS miss: M" in out
    assert err == ""


def test_check_goes_on_after_a_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "bad.yaml", "blow.yaml", "a.yaml"]) == 3
    out, err = capsys.readouterr()
    assert "1 agrees" in out
    assert err.count("error: ") == 2


def test_check_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "a.yaml", "miss.yaml", "bad.yaml", "--json"]) == 2
    read = strict_json(capsys.readouterr().out)
    assert [finding["verdict"] for finding in read["findings"]] == ["agrees", "MISS"]
    assert "unknown kind 'static'" in read["errors"][0]
    no_number = ["--set", "expect.0.quantity=M*sqrt(-1 - pivot)", "--set", "expect.0.at=all"]
    assert main(["check", "a.yaml", "--json", *no_number]) != 0
    strict_json(capsys.readouterr().out)


def test_validate_reports_every_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "bad.yaml", "a.yaml", "nofile.yaml"]) == 2
    out, err = capsys.readouterr()
    assert out == "a.yaml: valid\n"
    assert err.count("error: ") == 2
    assert main(["validate", "a.yaml", "miss.yaml"]) == 0
    capsys.readouterr()
    assert main(["validate", "a.yaml", "bad.yaml", "--json"]) == 2
    assert [mistake["file"] for mistake in strict_json(capsys.readouterr().out)["mistakes"]] == ["bad.yaml"]


# ------------------------------------------------------------------------------------------------------- schema


def references(node: Any) -> list[str]:
    if isinstance(node, dict):
        own = [node["$ref"]] if isinstance(node.get("$ref"), str) else []
        return own + [found for value in node.values() for found in references(value)]
    return [found for value in node for found in references(value)] if isinstance(node, list) else []


@pytest.mark.parametrize(("of", "keys"), [("scenario", {"pinarm", "mechanism", "problem"}), ("mechanism", {"pinarm"})])
def test_the_schema_is_a_json_schema(capsys: pytest.CaptureFixture[str], of: str, keys: set[str]) -> None:
    assert main(["schema", of]) == 0
    schema = strict_json(capsys.readouterr().out)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["type"] == "object"
    assert schema["additionalProperties"] is False
    assert keys <= set(schema["required"]) <= set(schema["properties"])
    assert references(schema)
    assert all(ref.startswith("#/$defs/") and ref[8:] in schema["$defs"] for ref in references(schema))
    if of == "scenario":  # ``from``, not ``start``: what an editor offers must be what the reader takes
        assert all({"from", "to"} <= set(schema["$defs"][name]["properties"]) for name in ("Range", "Trapezoid"))


@pytest.mark.parametrize(("line", "offered"), [
    ("pinarm new s", {"scissor_lift", "slider_crank"}),
    ("pinarm run q.yaml --set problem.time.", {"problem.time.end=", "problem.time.samples="}),
])  # fmt: skip
def test_the_shell_is_told_how_a_line_may_go_on(line: str, offered: set[str], tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")
    (tmp_path / "q.yaml").write_text("problem: {kind: inverse, time: {end: 1 s, samples: 5}}")
    answer = tmp_path / "answer"
    package = str(Path(pinarm.__file__).parents[1])
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": "\n",
             "_ARGCOMPLETE_STDOUT_FILENAME": str(answer), "PYTHONPATH": package}  # fmt: skip
    subprocess.run([sys.executable, "-m", "pinarm"], env={**os.environ, **asked}, cwd=tmp_path, check=False)
    assert {word.strip() for word in answer.read_text().splitlines()} == offered


# ------------------------------------------------------------------------------------------------------ streams


def test_a_reader_that_leaves_is_no_error() -> None:
    """As in ``pinarm check ... | head -1``: not a traceback, and not the exit code of a missed expectation."""
    end, start = os.pipe()
    os.close(end)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-m", "pinarm", "run", "a.yaml", "--no-plots"]
    done = subprocess.run(command, stdout=start, stderr=subprocess.PIPE, env=environment, timeout=60, check=False)
    os.close(start)
    assert done.returncode == 0
    assert done.stderr == b""


def test_a_terminal_without_unicode_is_no_error(here: Path) -> None:
    (here / "u.yaml").write_text(SCENARIO.replace("Held", "Größe 力"), encoding="utf-8")
    done = shell("run", "u.yaml", "--no-plots", PYTHONIOENCODING="ascii")
    assert done.returncode == 0, done.stderr


def test_nothing_steers_the_terminal(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Escape sequences in a file from a stranger are shown, not sent."""
    sequence = "\\e]0;x\\a\\e[2J"
    (here / "e.yaml").write_text(SCENARIO.replace("title: Held", f'"{sequence}": x'))
    (here / "f.yaml").write_text(SCENARIO.replace("title: Held", f'title: "{sequence}"'))
    (here / "g.yaml").write_text(
        SCENARIO.replace("quantity: M,", f'quantity: "{sequence}",').replace("20 N", "21 N")
        + f'symbols: {{"{sequence}": M}}\n'
    )
    for arguments in (["run", "e.yaml"], ["validate", "e.yaml"], ["check", "e.yaml", "g.yaml"], ["run", "f.yaml"]):
        main([*arguments])
        out, err = capsys.readouterr()
        assert "\x1b" not in out + err
        assert "\x07" not in out + err


@pytest.mark.parametrize("arguments", [[], ["fly"], ["run"], ["run", "a.yaml", "b.yaml"], ["schema", "robot"]])
def test_wrong_usage_is_exit_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert "usage: pinarm" in capsys.readouterr().err


# ------------------------------------------------------------------------------------ what is no scenario, help


@pytest.mark.parametrize(
    ("command", "file", "said"),
    [("run", "pendulum.urdf", "a model"), ("check", "pendulum.yaml", "a mechanism file"),
     ("validate", "pendulum.urdf", "a model"), ("sweep", "pendulum.yaml", "a mechanism file")],
)  # fmt: skip
def test_what_is_no_scenario_is_told_with_what_to_do(
    capsys: pytest.CaptureFixture[str], command: str, file: str, said: str
) -> None:
    assert main([command, file]) == 2
    err = capsys.readouterr().err
    assert f"{file}: this is {said}, not a scenario" in err
    assert f"python -m pinarm explain {file}" in err
    assert "python -m pinarm new " in err


def test_a_mechanism_file_is_validated_as_one(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "pendulum.yaml"]) == 0
    said = "pendulum.yaml: valid mechanism file: keys, names, units and the model are right, mobility 1 in the closed"
    assert capsys.readouterr().out.startswith(said)
    text = (here / "pendulum.yaml").read_text()
    (here / "pendulum.yaml").write_text(f"{text}drives: {{motor: {{joint: pivto}}}}\n")
    assert main(["validate", "pendulum.yaml"]) == 2
    err = capsys.readouterr().err
    assert "pivto" in err and "try: pivot" in err


@pytest.mark.parametrize(("file", "formula", "said"), [
    ("mechanism.yaml", "joint.QQ.velocity", "there is no quantity 'joint.QQ.velocity'"),
    ("mechanism.yaml", "w + 1 rad/s", "the symbol 'w' is defined by itself"),
    ("scenario.yaml", "joint.O.position + joint.O.velocity", "do not go together"),
    ("scenario.yaml", "joint.O.effort", ""),
    ("mechanism.yaml", "joint.A.friction", ""),
])  # fmt: skip
def test_symbols_are_validated_though_nothing_asks_for_them(
    here: Path, capsys: pytest.CaptureFixture[str], file: str, formula: str, said: str
) -> None:
    """Joint A has friction; the scenario is kinematic, and does not tell forces that exist."""
    planar = {"points": {"O": [0, 0], "A": ["1 m", 0], "B": ["2 m", 0]}, "ground": ["O"],
              "links": {pair: {"points": [*pair], "mass": "1 kg"} for pair in ("OA", "AB")}}  # fmt: skip
    own, symbols = ({"symbols": {"w": formula}} if file == name else {} for name in ("mechanism.yaml", "scenario.yaml"))
    (here / "mechanism.yaml").write_text(
        json.dumps({"pinarm": 1, "planar": planar, "friction": {"A": {"mu": 0.2, "radius": "9 mm"}}, **own})
    )
    motion = {name: {"law": "constant_speed", "speed": "1 rad/s"} for name in "OA"}
    problem = {"problem": {"kind": "kinematics", "time": {"end": "1 s"}, "motion": motion}}
    scenario = {"pinarm": 1, "mechanism": "mechanism.yaml", **problem, "outputs": ["joint.O.position"], **symbols}
    (here / "scenario.yaml").write_text(json.dumps(scenario))
    assert main(["validate", str(here / file)]) == (2 if said else 0)
    told = capsys.readouterr().err
    assert said in told
    assert not said or f"{file}:1:" in told


def test_folders_are_validated_with_those_below_them(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("bad.yaml", "blow.yaml", "miss.yaml"):
        (here / name).unlink()
    for folder in ("models/deep", "models/.hidden", "empty"):
        (here / folder).mkdir(parents=True)
    (here / "models" / "other.yaml").write_text("jobs: [build]\n")
    (here / "pendulum.yaml").rename(here / "models" / "deep" / "pendulum.yaml")
    (here / "models" / ".hidden" / "x.yaml").write_text("problem: {}\n")
    assert main(["validate", "models", "empty"]) == 2  # the robot is not beside it
    out, err = capsys.readouterr()
    assert out == "1 scenarios and mechanism files, 1 with mistakes\n"
    assert "models/deep/pendulum.yaml" in err
    assert main(["validate", "empty"]) == 2
    assert "there are no scenarios and no mechanism files in empty" in capsys.readouterr().err
    assert main(["validate", "empty", "models", "--json"]) == 2
    said = strict_json(capsys.readouterr().out)
    assert (said["files"], len(said["mistakes"])) == (1, 1)


def test_a_file_with_a_mistake_is_not_nothing_to_check(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "bad.yaml"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "static" in err
    (here / "free.yaml").write_text(SCENARIO.partition("expect:")[0])
    assert main(["check", "free.yaml"]) == 0
    assert capsys.readouterr().out == "nothing to check\n"


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    import pinarm

    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"pinarm {pinarm.__version__}\n"


@pytest.mark.parametrize("command", [*COMMANDS])
def test_help_has_examples_that_parse(capsys: pytest.CaptureFixture[str], command: str) -> None:
    with pytest.raises(SystemExit):
        main([command, "-h"])
    lines = capsys.readouterr().out.partition("examples:\n")[2].splitlines()
    examples = [shlex.split(line.partition(" > ")[0])[3:] for line in lines if line.strip()]
    assert examples
    for words in examples:
        assert words[0] == command
        _parser(words).parse_args(words)


# ------------------------------------------------------------------------------------------------- interrupts


class Interrupted:
    """Interrupts the making of the class that it is an attribute of."""

    def __set_name__(self, owner: type, name: str) -> None:
        raise KeyboardInterrupt


def interrupted_class(*_: object) -> None:
    type("Made", (), {"part": Interrupted()})


def interrupted(*_: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("part", ["validate", "_parser"])
@pytest.mark.parametrize("made", [interrupted_class, interrupted])
def test_an_interrupt_at_any_moment_is_exit_130(
    part: str, made: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where Python 3.11 makes a RuntimeError of it: in the making of a class, as imports do."""
    if part == "_parser":
        monkeypatch.setattr("pinarm.cli.main._parser", made)
    else:
        monkeypatch.setitem(COMMANDS, "validate", COMMANDS["validate"]._replace(call=made))
    assert main(["validate", "x.yaml"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "arm/scenario.yaml", "--set", "drives.w.ratio=3"], "try: changes.drives.w.ratio\n"),
        (["sweep", "arm/scenario.yaml", "--over", "links.a.mass=1, 2 kg"], "try: changes.planar.links.a.mass\n"),
        (["quantities", "arm/mechanism.yaml", "--like", "Accelaration"], "try: acceleration\n"),
    ],
)  # fmt: skip
def test_what_newcomers_write_is_answered_with_what_they_need(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    (tmp_path / "own").mkdir()
    monkeypatch.chdir(tmp_path / "own")
    assert main(["new", "arm"]) == 0
    assert main(arguments) == 2
    assert said in capsys.readouterr().err
