"""A result read back from its folder is the result."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.errors import InputError

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    "name",
    ["gen411_arm_static", "gen411_arm_equilibria", "exoskeleton_leg_guided_knee", "hoist_with_losses"],
)
def test_every_number_comes_back(tmp_path: Path, name: str) -> None:
    """Outputs, multipliers and figures, and what is asked only now: to the last bit."""
    loaded = pinarm.load(ROOT / "scenarios" / f"{name}.yaml")
    result = loaded.verified() if name == "gen411_arm_static" else loaded.run()
    again = pinarm.restore(result.save(tmp_path / "elsewhere", plots=False))
    assert again.errors == result.errors
    assert bool(result.errors) == (name == "gen411_arm_static")
    assert again.setting == result.setting
    assert again.figures == result.figures
    assert again.summary() == {**result.summary(), "input": again.digest()}
    assert again.trajectory.grid.cuts == result.trajectory.grid.cuts
    links = [frame.name for frame in result.trajectory.mechanism.model.frames if "BODY" in str(frame.type)]
    known = [] if result.trajectory.no_efforts else result.quantities.names()
    efforts = [name for name in known if name.endswith((".effort", ".torque"))]
    for asked in (*result.content.outputs, *efforts, f"point.{links[-1]}.acceleration.norm", "momentum.all.angular.z"):
        assert np.array_equal(again[asked].values, result[asked].values)
        assert again[asked].label == result[asked].label
    assert np.array_equal(again.trajectory.lam, result.trajectory.lam)


def test_events_and_impacts_come_back(tmp_path: Path) -> None:
    """Impacts are told from events by the velocity before, which the stop halves."""
    given = {
        "pinarm": 1, "mechanism": str(ROOT / "docs" / "kind_examples" / "events" / "lever.yaml"), "outputs": ["O"],
        "problem": {"kind": "forward", "time": {"end": "0.6 s", "samples": 3},
                    "events": {"half": {"when": "O", "reaches": "-45 deg"}},
                    "end_stops": {"O": {"lower": "-60 deg", "restitution": 0.5}}},
    }  # fmt: skip
    result = pinarm.run(given)
    events = pinarm.restore(result.save(tmp_path / "o", plots=False)).events
    assert [event.name for event in events][:2] == ["half", "O lower"]
    assert events[0].before is None
    assert events[1].before is not None
    assert events[1].v == pytest.approx(-0.5 * events[1].before, rel=1e-12)
    assert repr(events) == repr(tuple(result.events))


def test_columns_of_controllers_friction_stops_and_events_come_back_each_to_its_name(tmp_path: Path) -> None:
    """1 kg m^2 turns under 1 N m less 0.5 N m of friction, to its stop at 0.1 rad in 0.63 s."""
    planar = {
        "points": {"O": [0, 0], "P": ["1 m", 0]}, "ground": ["O"],
        "links": {"arm": {"points": ["O", "P"], "mass": "1 kg", "centre": "O", "inertia": "1 kg*m^2"}},
    }  # fmt: skip
    command = {"kind": "state_feedback", "drive": "motor", "states": ["O"], "bias": ["1 N*m"],
               "gains": [["0 N*m/rad", "0 N*m*s/rad"]]}  # fmt: skip
    events = {"half": "0.05 rad", "never": "0.2 rad"}
    given = {
        "pinarm": 1, "outputs": ["O"],
        "mechanism": {
            "pinarm": 1, "gravity": "none", "planar": planar, "friction": {"O": {"constant": "0.5 N*m"}},
            "drives": {"motor": {"joint": "O", "motor": {"kind": "ideal"}}},
        },
        "problem": {"kind": "forward", "time": {"end": "1 s", "samples": 5}, "control": [command],
                    "events": {name: {"when": "O", "reaches": at} for name, at in events.items()},
                    "end_stops": {"O": {"upper": "0.1 rad"}}},
    }  # fmt: skip
    result = pinarm.run(given)
    again = pinarm.restore(result.save(tmp_path / "o", plots=False))
    assert again["event.half.time"].values == pytest.approx(0.2**0.5, rel=1e-9)
    assert again["control.motor.effort"].values == pytest.approx(1.0, rel=1e-12)
    assert again["joint.O.stop"].values[-1] == pytest.approx(-1.0, rel=1e-12)
    for name, column in result.trajectory.columns.items():
        assert np.array_equal(again[name].values, column.values, equal_nan=True), name


def test_it_needs_nothing_outside_of_the_folder(scenario: Callable[..., Any], folder: Path, tmp_path: Path) -> None:
    result = scenario("inverse", "numbers: [drive.motor.torque @ rms]\n").run()
    saved = result.save(folder / "out", plots=False)
    for file in ("pendulum.urdf", "pendulum.yaml", "inverse.yaml"):
        (folder / file).unlink()
    again = pinarm.restore(saved)
    assert np.array_equal(again["drive.motor.torque"].values, result["drive.motor.torque"].values)
    assert np.array_equal(again["M"].values, result["M"].values)
    assert again.notes() == result.notes()


def test_a_motion_that_a_function_drives_is_known_at_its_rows_only(tmp_path: Path) -> None:
    """Without the function the servo would stay where it starts."""
    problem = {"kind": "forward", "time": {"end": "1 s", "samples": 11}, "initial": {"position": {"x": "1 rad"}}}
    servo = {"pinarm": 1, "mechanism": str(ROOT / "models/servo/mechanism.yaml"), "problem": problem, "outputs": ["x"]}
    result = pinarm.run(servo, control={"x": lambda _, state: -25.0 * state["x"] - 6.0 * state["joint.x.velocity"]})
    again = pinarm.restore(result.save(tmp_path / "out", plots=False))
    assert np.array_equal(again["x"].values, result["x"].values)
    with pytest.raises(InputError, match="a function in Python drives it"):
        again.number("x @ min")


def test_a_table_that_is_changed_afterwards_changes_nothing(scenario: Callable[..., Any], folder: Path) -> None:
    """The angle of a pendulum follows a table, whose largest value is 30 deg, between rows."""
    table = folder / "t.csv"
    table.write_text("t [s],angle [deg]\n0,0\n1,30\n2,0\n")
    given = scenario("inverse").document.path
    given.write_text(
        "pinarm: 1\nmechanism: pendulum.yaml\noutputs: [pivot]\nproblem: {kind: inverse, time: {end: 2 s, samples: 4}, "
        "motion: {pivot: {law: table, file: t.csv}}}\n"
    )
    result = pinarm.run(given)
    saved = result.save(folder / "out", plots=False)
    table.write_text("t [s],angle [deg]\n0,0\n1,5\n2,0\n")
    value, error = pinarm.restore(saved).number("pivot @ max")
    assert value == pytest.approx(np.deg2rad(30.0), abs=error + 1e-9)


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("summary.json", "{}"), ("trajectory.npz", "no archive"), ("scenario.yaml", "pinarm: 2"),
        ("summary.json", '{"accuracy": {"a": "b"}, "cost": {}, "findings": {}, "scenario": "a", "notes": []}'),
        ("model.urdf", "<robot/>"),
    ],
)  # fmt: skip
def test_a_damaged_folder_is_refused(scenario: Callable[..., Any], folder: Path, file: str, content: str) -> None:
    saved = scenario("inverse").run().save(folder / "out", plots=False)
    (saved / file).write_text(content)
    with pytest.raises(pinarm.PinarmError):
        pinarm.restore(saved)


MJCF = """<mujoco><option gravity="0 0 -4"/><worldbody><body name="rod" pos="0 0 1"><joint name="pin" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -1" size="0.05"/></body></worldbody></mujoco>"""


def test_other_kinds_of_models_and_bases_come_back(tmp_path: Path) -> None:
    """MJCF with a gravity of its own, and a robot by name, which floats."""
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "rod.xml").write_text(MJCF)
    forward = "problem: {kind: forward, time: {end: 0.1 s, samples: 5}}\n"
    for mechanism, output in (("rod.xml", "joint.pin.acceleration"), ("iris", "root.z")):
        (tmp_path / "s.yaml").write_text(f"pinarm: 1\nmechanism: {mechanism}\n{forward}outputs: [{output}]\n")
        result = pinarm.load(tmp_path / "s.yaml").run()
        again = pinarm.restore(result.save(tmp_path / "out", plots=False))
        assert np.array_equal(again["energy.total"].values, result["energy.total"].values)
        assert np.array_equal(again["momentum.all.linear.z"].values, result["momentum.all.linear.z"].values)
        assert again.replay().html == result.replay().html


def rewritten(path: Path, name: str, raw: bytes) -> None:
    """Write an npz file again with other bytes for one of its arrays."""
    with zipfile.ZipFile(path) as archive:
        parts = {each: archive.read(each) for each in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for each, content in {**parts, name: raw}.items():
            archive.writestr(each, content)


def npy(shape: str, kind: str = "<f8", data: bytes = b"") -> bytes:
    head = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + data


@pytest.mark.parametrize(("raw", "said"), [
    (npy("(1000000000000,)", "'<f8'", bytes(8)), "does not hold the states"),
    (npy("(1000000000000, 0)", "'<f8'"), "not those of its model"),
    (npy("(1,)", "'|O'", b"cos\nsystem\n"), "does not hold the states"),
    (npy("(1,)", "[('a', '<f8'), ('b', '<f8')]", bytes(16)), "does not hold the states"),
    (npy("(" * 500 + ")" * 500, "'<f8'"), "does not hold the states"),
    (npy("(1,)", "__import__('os')"), "does not hold"), (b"", "does not hold the states"),
])  # fmt: skip
def test_an_array_that_promises_more_than_it_holds_is_refused(
    scenario: Callable[..., Any], folder: Path, raw: bytes, said: str
) -> None:
    saved = scenario("inverse").run().save(folder / "out", plots=False)
    rewritten(saved / "trajectory.npz", "state.q.npy", raw)
    with pytest.raises(InputError, match=said):
        pinarm.restore(saved)


@pytest.mark.parametrize("summary", ['{"accuracy":' * 50_000, "9" * 100_000, "NaN"])
def test_a_summary_meant_to_harm_is_refused(scenario: Callable[..., Any], folder: Path, summary: str) -> None:
    saved = scenario("inverse").run().save(folder / "out", plots=False)
    (saved / "summary.json").write_text(summary)
    with pytest.raises(InputError, match="is no summary of a run"):
        pinarm.restore(saved)


def test_a_replay_in_the_folder_goes_through_no_link(
    scenario: Callable[..., Any], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = scenario("inverse").run().save(folder / "out", plots=False)
    (folder / "mine").write_text("mine")
    for name in ("replay.html", ".replay.html.part", ".summary.json.part"):
        (saved / name).symlink_to(folder / "mine")
    assert main(["replay", str(saved)]) == 2
    assert "is not a regular file" in capsys.readouterr().err
    (saved / "replay.html").unlink()
    assert main(["replay", str(saved)]) == main(["replay", str(saved)]) == 0
    assert (folder / "mine").read_text() == "mine"


@pytest.mark.parametrize("name", ["scenario.yaml", "summary.json", "trajectory.npz"])
def test_a_link_in_place_of_a_file_is_not_followed(tmp_path: Path, name: str) -> None:
    """The message about what is wrong in it would show a line of a file elsewhere."""
    saved = pinarm.run(ROOT / "scenarios" / "gen411_arm_static.yaml").save(tmp_path / "out", plots=False)
    (tmp_path / "mine").write_text("secret: of another folder\n")
    (saved / name).unlink()
    (saved / name).symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match="symbolic link") as caught:
        pinarm.restore(saved)
    assert "secret" not in str(caught.value)
