"""Many motions are the motions one by one: each has its own events, impacts and failures, whoever solves it."""

import json
from pathlib import Path
from shutil import copytree
from time import process_time

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError, NumericsError, PinarmError
from pinarm.input.units import unit

ROOT = Path(__file__).parents[4]
SWING = """\
pinarm: 1
mechanism: models/gen411_arm/mechanism.yaml
problem:
  kind: forward
  time: {end: 2 s, samples: 21}
  initial: {position: {O: 10 deg, B: 20 deg}}
  loads:
    motor: {kind: joint_effort, joint: O, effort: MOTOR}
    rub: {kind: joint_spring, joint: B, stiffness: 0 N*m/rad, damping: 0.02 N*m*s/rad}
  EXTRA
outputs: [O, B, point.A.position.y]
accuracy: {tolerance: 1e-9}
"""
STEADY = "{law: constant, value: 0.3 N*m}"
RAMP = "{law: trapezoid, from: 0 N*m, to: 1 N*m, speed: 2 N*m/s, acceleration: 10 N*m/s^2}"
LOOP = (
    "pinarm: 1\nmechanism: models/four_bar/mechanism.yaml\nproblem:\n"
    "  kind: forward\n  time: {end: 0.4 s, samples: 5}\n"
    "  initial: {position: {upright_0: 0 rad}, velocity: {upright_0: 1 rad/s}}\noutputs: [upright_0]\n"
)
STARTS = {"O": np.array([0.1, -0.7, 1.3, 0.4]), "B": np.array([0.0, 0.3, -0.2, 2.0])}
RATES = {"B": np.array([0.0, 2.0, -1.0, 9.0])}
WILD = {"B": np.array([0.0, 2.0, 3000.0, 1.0])}
"""The third motion takes more than 300 steps."""


@pytest.fixture
def scenario(tmp_path):
    (tmp_path / ".pinarm-root").touch()
    for model in ("gen411_arm", "four_bar"):
        copytree(ROOT / "models" / model, tmp_path / "models" / model)

    def made(extra="", text=SWING, motor=STEADY):
        (tmp_path / "s.yaml").write_text(text.replace("EXTRA", extra).replace("MOTOR", motor))
        return pinarm.load(tmp_path / "s.yaml")

    return made


def alone(scenario, number, rates=RATES):
    """Return the run of one of the starts by itself."""
    values = {f"problem.initial.position.{name}": f"{float(x[number])!r} rad" for name, x in STARTS.items()}
    values |= {f"problem.initial.velocity.{name}": f"{float(x[number])!r} rad/s" for name, x in rates.items()}
    return scenario.varied(values).run()


@pytest.mark.parametrize("motor", [STEADY, RAMP])
def test_every_motion_is_that_of_a_run_of_its_own(scenario, motor):
    """Under a steady effort they are solved together, under one that follows a law one by one."""
    one = scenario(motor=motor)
    batch = pinarm.batch(one, STARTS, RATES)
    names = ("O", "point.A.position.y", "joint.B.velocity")
    values, (q, v) = batch.values(*names), batch.states()
    assert (len(batch), batch.failures, values.shape) == (4, {}, (3, 4, 21))
    assert (type(batch["O"]), batch["O"].label) == (pinarm.Series, "O [rad]")
    for number in range(4):
        expected = alone(one, number)
        rows = np.searchsorted(expected.trajectory.grid.t, batch.t + 1e-9) - 1
        for name, found in zip(names, values[:, number], strict=True):
            assert found == pytest.approx(expected[name].values[rows], abs=1e-9)
        assert q[number, :, 1] == pytest.approx(expected["B"].values[rows], abs=1e-9)
        assert v[number, :, 1] == pytest.approx(expected["joint.B.velocity"].values[rows], abs=1e-8)
    run = batch.run(3)
    assert run.figures["energy"] == pytest.approx(expected.figures["energy"], abs=1e-9)
    assert run.scenario.document.data["problem"]["initial"]["velocity"]["B"] == "9.0 rad/s"


def test_small_motions_and_ones_that_fail_beside_others_are_those_of_runs_of_their_own(scenario):
    """Small ones have finer steps than others; the fourth takes more than 300."""
    one = scenario(motor="{law: constant, value: 0 N*m}").varied({"accuracy.max_steps": 300})
    starts, rates = {"O": [0.3, 1e-7, 0.0, 0.3], "B": [0.2, -1e-7, 0.0, 0.2]}, {"B": [0.0, 0.0, 0.0, 3000.0]}
    batch = pinarm.batch(one, starts, rates)
    q, _ = batch.states()
    assert list(batch.failures) == [3]
    assert np.isnan(q[3]).any()
    for number in range(3):
        expected = one.varied(batch.cases.values(number)).run().trajectory.q
        assert np.abs(q[number] - expected).max() <= 1e-12 * np.abs(expected).max()


def test_many_free_motions_of_a_tree_are_followed_together(scenario):
    """300 take the time of some ten runs."""
    one = scenario().varied({"problem.time.end": "0.1 s", "accuracy.tolerance": 1e-5})
    starts = {"O": np.linspace(0.1, 1.0, 300)}
    times = list[float]()
    for solve in (one.run, one.run, pinarm.batch(one, starts).states):
        begun = process_time()
        solve()
        times.append(process_time() - begun)
    assert times[2] < 150 * times[1]


def test_events_and_stops_are_those_of_each_motion(scenario):
    one = scenario("events: {low: {when: O, reaches: -0.2 rad}}\n  end_stops: {B: {upper: 2.1 rad, restitution: 0.5}}")
    batch = pinarm.batch(one, STARTS, RATES)
    times, angles = batch.values("event.low.time", "B")
    assert np.isnan(times).any() or len(set(times[:, 0])) > 1
    for number in (0, 3):
        expected = alone(one, number)
        assert times[number, 0] == pytest.approx(expected["event.low.time"].values[0], abs=1e-9, nan_ok=True)
        rows = np.searchsorted(expected.trajectory.grid.t, batch.t)  # its table has the impacts, too
        assert angles[number] == pytest.approx(expected["B"].values[rows], abs=1e-8)
    assert angles.max() <= 2.1 + 1e-12


def test_one_that_fails_or_ends_at_an_event_does_not_touch_the_others(scenario):
    one = scenario("events: {low: {when: O, reaches: -0.9 rad, then: stop}}").varied({"accuracy.max_steps": 300})
    batch = pinarm.batch(one, STARTS, WILD)
    found = batch["O"]
    assert list(batch.failures) == [2]
    assert "300 steps" in batch.failures[2]
    reached = np.isfinite(found).sum(axis=1)
    assert 0 < reached[2] < 21
    assert reached[[0, 1, 3]].min() < 21
    for number in (0, 1, 3):
        expected = alone(one, number, WILD)
        whole = np.isin(expected.trajectory.grid.t, batch.t)
        assert reached[number] == len(set(expected.trajectory.grid.t[whole]))
        assert found[number, : reached[number]] == pytest.approx(
            expected["O"].values[whole][: reached[number]], abs=1e-9
        )
    with pytest.raises(NumericsError, match="300 steps") as caught:
        batch.run(2)
    assert caught.value.partial is not None
    for none in (4, -5, 1.0, "1"):
        with pytest.raises(InputError, match="there is no motion"):
            batch.run(none)
    table, told = batch.reduced({"t": "end", "O": "min"}), batch["O"]
    assert np.isnan(table["min O"].values).tolist() == [False, False, True, False]
    assert table["min O"].values[[0, 1, 3]] == pytest.approx(np.nanmin(told[[0, 1, 3]], axis=1), rel=1e-14)


@pytest.mark.slow
def test_processes_give_the_same_numbers_and_files(scenario, tmp_path):
    """Of a loop: the last motion takes too many steps."""
    one, rates = scenario(text=LOOP).varied({"accuracy.max_steps": 30}), {"upright_0": [1.0, 2.0, 3.0, 300.0]}
    batches = [pinarm.batch(one, velocity=rates, workers=workers) for workers in (1, 2)]
    ours, theirs = (batch.reduced({"upright_1": ["max", "rms"]}) for batch in batches)
    for column in ours.columns:
        np.testing.assert_array_equal(column.values, theirs[column.name].values)
    assert ours.errors == theirs.errors == batches[1].failures
    assert list(ours.errors) == [3]
    folders = [batch.save(tmp_path / str(number)) for number, batch in enumerate(batches)]
    files = [{path.name: path.read_bytes() for path in folder.rglob("*.*")} for folder in folders]
    assert files[0] == files[1]
    assert {"000002.csv", "cases.npz"} < files[0].keys()


def test_measures_of_a_ramp(scenario):
    """Of t from 0 to 2 in 21 rows: the square's mean is 4/3, and by the trapezoidal rule 0.1^2/6 more."""
    asked = ["min", "max", "mean", "rms", "median", 95, "start", "end"]
    table = pinarm.batch(scenario(), STARTS, RATES).reduced({"t": asked, "-2*t": "largest"})
    found = [table[name].values for name in ("min t", "max t", "mean t", "rms t", "median t", "95 % t", "start t")]
    expected = [0.0, 2.0, 1.0, (4.0 / 3.0 + 0.01 / 6.0) ** 0.5, 1.0, 1.9, 0.0]
    assert np.array(found) == pytest.approx(np.tile(expected, (4, 1)).T, rel=1e-14, abs=1e-14)
    assert table["end t"].values.tolist() == [2.0] * 4
    assert table["largest -2*t"].values.tolist() == [4.0] * 4
    assert table["max t"].label == "max t [s]"
    assert table["problem.initial.velocity.B"].values.tolist() == RATES["B"].tolist()
    assert table.to_dataframe().shape == (4, 1 + 3 + 9)


def test_numbers_are_those_of_each_run_sections_included(scenario):
    one = scenario().varied({"limits.keep": {"O @ max": "< 1 rad"}, "accuracy.max_steps": 300})
    table = pinarm.batch(one, velocity=WILD).numbers("O @ rms", "limits.least_margin", "t @ max(O)")
    assert list(table.errors) == [2]
    assert [str(column.unit) for column in table.columns[:3]] == ["rad", "1", "s"]
    for k in (0, 3):
        alone = pinarm.run(one, {"problem.initial.velocity": {"B": f"{WILD['B'][k]} rad/s"}})
        for column in table.columns[:3]:
            assert column.values[k] == pytest.approx(alone.number(column.name)[0], rel=1e-9)
    assert np.isnan(table["O @ rms"].values[2])
    first = "t @ B=1 rad, occurrence=1"  # from 0.4 rad/s the arm does not come to 1 rad
    free = pinarm.batch(one.varied({"gravity": "none", "problem.loads": {}}), {"O": 0.0, "B": 0.0}, {"B": [9.0, 0.4]})
    reached = free.numbers(first)
    assert np.isnan(reached[first].values).tolist() == [False, True]
    assert "not reached" in reached.errors[1]


def test_motions_are_saved_as_runs_are_and_can_be_run_again(scenario, tmp_path):
    one = scenario().varied({"accuracy.max_steps": 300, "units": {"B": "deg", "t": "ms"}})
    batch = pinarm.batch(one, STARTS, WILD)
    folder, angles = batch.save(tmp_path / "out"), batch["B"]
    names = ["cases.csv", "cases.npz", "manifest.json", "motions", "summary.json", "sweep.yaml"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert len(list((folder / "motions").iterdir())) == 8
    run = batch.run(1)
    run.save(tmp_path / "one", plots=False)
    rows = (folder / "motions" / "000001.csv").read_text()
    assert rows == (tmp_path / "one" / "trajectory.csv").read_text()
    assert rows.startswith("t [ms],")
    assert pinarm.run(tmp_path / "one" / "scenario.yaml")["B"].values == pytest.approx(run["B"].values, abs=1e-9)
    with np.load(folder / "motions" / "000001.npz") as arrays:
        assert arrays["B"] == pytest.approx(angles[1], abs=1e-9)
    with np.load(folder / "cases.npz") as table:
        assert table["max B"][[0, 1, 3]] == pytest.approx(angles[[0, 1, 3]].max(axis=1), abs=1e-9)
        assert table["energy"][[0, 1, 3]].max() < 1e-8
        assert "300 steps" in table["error"][2]
        assert np.isnan(table["max B"][2])
    heading, *lines = (line.split(",") for line in (folder / "cases.csv").read_text().splitlines())
    assert heading[:2] == ["case", "problem.initial.position.O [rad]"]
    place = heading.index("max B [deg]")
    assert float(lines[1][place]) == pytest.approx(np.degrees(angles[1].max()))
    assert json.loads((folder / "summary.json").read_text())["failed"] == 1


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ({"o": 0.0}, "no free joint 'o'"),
        ({"O": [0.0, 1.0], "B": [0.0, 1.0, 2.0]}, "the arrays have the shapes"),
        ({"O": []}, "there are no initial values"),
        ({"O": [0.1, np.nan]}, "position O is not finite"),
        ({"O": pinarm.Series("O", unit("mm"), np.array([1.0]))}, "position O is in mm"),
    ],
)
def test_starts_that_cannot_be_are_refused(scenario, position, message):
    with pytest.raises(PinarmError, match=message):
        pinarm.batch(scenario(), position)


def test_scenarios_without_motions_to_start_are_refused(scenario):
    with pytest.raises(InputError, match="looks for numbers"):
        pinarm.batch(scenario().varied({"accuracy": {"target": 1e-6}}), {"O": 0.0})
    with pytest.raises(InputError, match="of kind statics"):
        pinarm.batch(ROOT / "scenarios" / "gen411_arm_static.yaml", {"O": 0.0})
    law = "motion: {O: {law: constant, value: 0 rad}}"
    with pytest.raises(InputError, match="no free joint 'O'"):
        pinarm.batch(scenario(law).varied({"problem.initial": {}, "problem.loads": {}}), {"O": 0.1})
