"""Many motions at once are the motions one by one, each with its own steps, events, impacts and failures."""

import gc
import json
import weakref
from functools import partial
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

import pinarm
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.ensemble import integrate_batch
from pinarm.engine.integration.integrator import Flat, Interval
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.motion.segmented.ensembles import is_batchable
from pinarm.errors import InputError, Interrupted, NumericsError, PinarmError
from pinarm.input.units import unit
from pinarm.mechanics.forces.breakpoints import Pieces
from pinarm.problems.forward import Forward
from pinarm.use.study.batch import batch as motions
from pinarm.use.study.batch.block import Block
from pinarm.use.workers.worker import LostJob

ROOT = Path(__file__).parents[4]
SWING = """\
pinarm: 1
mechanism: models/gen411_arm/mechanism.yaml
problem:
  kind: forward
  time: {end: 2 s, samples: 21}
  initial: {position: {O: 10 deg, B: 20 deg}}
  loads:
    motor: {kind: joint_effort, joint: O, effort: {law: polynomial, from: 0 N*m, to: 1 N*m, duration: 0.7 s}}
    rub: {kind: joint_spring, joint: B, stiffness: 0 N*m/rad, damping: 0.02 N*m*s/rad}
  EXTRA
outputs: [O, B, point.A.position.y]
accuracy: {tolerance: 1e-9}
"""
LOOP = (
    "pinarm: 1\nmechanism: models/four_bar/mechanism.yaml\nproblem:\n"
    "  kind: forward\n  time: {end: 0.4 s, samples: 5}\n"
    "  initial: {position: {upright_0: 0 rad}, velocity: {upright_0: 1 rad/s}}\noutputs: [upright_0]\n"
)
STARTS = {"O": np.array([0.1, -0.7, 1.3, 0.4]), "B": np.array([0.0, 0.3, -0.2, 2.0])}
RATES = {"B": np.array([0.0, 2.0, -1.0, 9.0])}


@pytest.fixture
def scenario(tmp_path):
    (tmp_path / ".pinarm-root").touch()
    for model in ("gen411_arm", "four_bar"):
        copytree(ROOT / "models" / model, tmp_path / "models" / model)

    def made(extra="", text=SWING):
        (tmp_path / "s.yaml").write_text(text.replace("EXTRA", extra))
        return pinarm.load(tmp_path / "s.yaml")

    return made


def alone(scenario, number, rates=RATES):
    """Return the run of one of the starts by itself."""
    values = {f"problem.initial.position.{name}": f"{x[number]!r} rad" for name, x in STARTS.items()}
    values |= {f"problem.initial.velocity.{name}": f"{x[number]!r} rad/s" for name, x in rates.items()}
    return scenario.varied({path: value.replace("np.float64(", "").replace(")", "") for path, value in values.items()})


def test_every_motion_is_that_of_a_run_of_its_own(scenario):
    one = scenario()
    batch = pinarm.batch(one, STARTS, RATES)
    q, v = batch.states()
    assert len(batch) == 4
    assert batch.failures == {}
    for number in range(4):
        run, expected = batch.run(number), alone(one, number).run()
        # the same steps: sums of products in another order
        assert run.figures["evaluations"] == pytest.approx(expected.figures["evaluations"], abs=30)
        for name in ("O", "point.A.position.y", "joint.B.velocity"):
            assert batch[name][number] == pytest.approx(expected[name].values, abs=1e-9)
            assert (type(batch[name]), batch[name].label) == (type(expected[name]), expected[name].label)
        assert q[number, :, 1] == pytest.approx(expected["B"].values, abs=1e-9)
        assert v[number, :, 1] == pytest.approx(expected["joint.B.velocity"].values, abs=1e-8)


def test_what_laws_leave_free_is_integrated_together(scenario):
    """Of the arm whose first joint turns to and fro, driven from a jump of its law on."""
    law = "O: {law: trapezoid, begin: 0.3 s, from: 0.1 rad, to: 1.1 rad, speed: 1 rad/s, acceleration: 4 rad/s^2}"
    text = SWING.replace("{O: 10 deg, B: 20 deg}", "{B: 20 deg}").replace("  EXTRA", f"  motion: {{{law}}}\n  EXTRA")
    one = scenario(text=text)
    batch = pinarm.batch(one, {"B": STARTS["B"]}, RATES)
    assert is_batchable(batch.question.hybrid)
    q, v = batch.states()
    for number in (0, 3):
        values = {"problem.initial.position.B": f"{float(STARTS['B'][number])!r} rad"}
        values |= {"problem.initial.velocity": {"B": f"{float(RATES['B'][number])!r} rad/s"}}
        run = one.varied(values).run()
        rows = np.searchsorted(run.trajectory.grid.t, batch.t + 1e-9) - 1
        assert q[number] == pytest.approx(run.trajectory.q[rows], abs=1e-8)
        assert v[number] == pytest.approx(run.trajectory.v[rows], abs=1e-8)
        for name in ("joint.O.effort", "energy.kinetic"):
            expected = run[name].values[rows]
            assert batch[name][number] == pytest.approx(expected, rel=1e-7, abs=1e-7, nan_ok=True)


@pytest.mark.slow
def test_events_and_stops_are_those_of_each_motion(scenario):
    one = scenario("events: {low: {when: O, reaches: -0.2 rad}}\n  end_stops: {B: {upper: 2.1 rad, restitution: 0.5}}")
    batch = pinarm.batch(one, STARTS, RATES)
    times = batch["event.low.time"][:, 0]
    assert np.isnan(times).any() or len(set(times)) > 1
    for number in range(4):
        expected = alone(one, number).run()
        assert times[number] == pytest.approx(expected["event.low.time"].values[0], abs=1e-9, nan_ok=True)
        rows = np.searchsorted(expected.trajectory.grid.t, batch.t)  # its table has the impacts, too
        assert batch["B"][number] == pytest.approx(expected["B"].values[rows], abs=1e-8)
    assert batch["B"].max() <= 2.1 + 1e-12


def test_a_narrow_part_of_a_load_is_passed_unseen_by_none():
    """Points that fly evenly but for a push of 1 J between 3 and 3.02."""
    push = Interval(0.0, 1.0, lambda t, q, v: 100.0 * np.clip(1.0 - abs(q - 3.01) / 0.01, 0.0, None),
                   batch=lambda t, q, v: 100.0 * np.clip(1.0 - abs(q - 3.01) / 0.01, 0.0, None))  # fmt: skip
    pieces, line = Pieces(np.array([3.0, 3.01, 3.02])), Flat(1, 1)
    given = {"max_steps": 300, "steps_over": lambda t, q, v: pieces.passed(q[:, 0])}
    speeds = np.array([[20.0], [2.0], [-5.0]])
    batch = integrate_batch([push], line, np.zeros((3, 1)), speeds, Adaptive(1e-10), **given)
    for number, v in enumerate(speeds):
        expected = integrate([push], line, np.zeros(1), v, Adaptive(1e-10), **given)
        assert batch.counts[number] == pytest.approx(len(expected.steps), abs=2)  # errors of 1e-10 but for rounding
    _, v = batch.states(np.array([1.0]))
    assert v[:, 0, 0] == pytest.approx([np.sqrt(20.0**2 + 2.0), 2.0, -5.0], rel=1e-6)  # kinks


def test_an_event_ends_its_own_motion_only(scenario):
    one = scenario("events: {low: {when: O, reaches: -0.9 rad, then: stop}}")
    batch = pinarm.batch(one, STARTS, RATES)
    reached = np.isfinite(batch["O"]).sum(axis=1)
    assert reached.min() < 21
    for number in range(4):
        expected = alone(one, number).run()
        whole = np.isin(expected.trajectory.grid.t, batch.t)
        assert reached[number] == len(set(expected.trajectory.grid.t[whole]))


def test_one_that_fails_does_not_hurt_the_others(scenario):
    one = scenario().varied({"accuracy.max_steps": 300})
    rates = {"B": np.array([0.0, 2.0, 3000.0, 1.0])}
    batch = pinarm.batch(one, STARTS, rates)
    assert list(batch.failures) == [2]
    assert "300 steps" in batch.failures[2]
    with pytest.raises(NumericsError, match="300 steps") as caught:
        batch.run(2)
    assert caught.value.partial is not None
    for none in (4, -5, 1.0, "1"):
        with pytest.raises(InputError, match="there is no motion"):
            batch.run(none)
    found = batch["O"]
    assert np.isfinite(found[[0, 1, 3]]).all()
    assert 0 < np.isfinite(found[2]).sum() < 21
    assert found[1] == pytest.approx(alone(one, 1, rates).run()["O"].values, abs=1e-9)


def test_loops_are_taken_one_by_one(scenario):
    batch = pinarm.batch(scenario(text=LOOP), velocity={"upright_0": [1.0, 2.0]})
    assert batch["upright_1"] == pytest.approx(batch["upright_0"], abs=1e-12)
    assert batch["upright_0"][0, -1] == pytest.approx(scenario(text=LOOP).run()["upright_0"].values[-1], abs=1e-13)


def all_of(batch, *names):
    return [batch.values(*names), *batch.states(), batch.failures]


def same(ones, others):
    for one, other in zip(ones[:-1], others[:-1], strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9)  # sums of products in another order
    assert ones[-1] == others[-1]


@pytest.mark.parametrize("kept", [pytest.param(0, marks=pytest.mark.slow), 4])
def test_blocks_are_parts_of_the_whole(scenario, monkeypatch, kept):
    """One motion fails, some end at an event: in blocks of two."""
    one = scenario("events: {low: {when: O, reaches: -0.9 rad, then: stop}}").varied({"accuracy.max_steps": 300})
    rates, names = {"B": np.array([0.0, 2.0, 3000.0, 1.0])}, ("point.A.position.y", "event.low.time", "B")
    whole = all_of(pinarm.batch(one, STARTS, rates), *names)
    monkeypatch.setattr(motions, "ALONE", 2)
    monkeypatch.setattr(motions, "KEPT", kept)
    batch = pinarm.batch(one, STARTS, rates)
    same(all_of(batch, *names), whole)
    assert list(batch.failures) == [2]
    assert len(batch._blocks) == (2 if kept else 0)
    expected = whole[0][2, 1][np.isfinite(whole[0][2, 1])]
    assert batch.run(1)["B"].values[: len(expected)] == pytest.approx(expected, abs=1e-9)


class TestWorkers:
    @pytest.mark.slow
    def test_processes_give_the_same_numbers_and_files(self, scenario, monkeypatch, tmp_path):
        """Of a loop: the last motion takes too many steps."""
        monkeypatch.setattr(motions, "ALONE", 2)
        one, rates = scenario(text=LOOP).varied({"accuracy.max_steps": 30}), {"upright_0": [1.0, 2.0, 3.0, 4.0, 300.0]}
        ours, theirs = (pinarm.batch(one, velocity=rates, workers=workers) for workers in (1, 2))
        one, other = (batch.reduced({"upright_1": ["max", "rms"]}) for batch in (ours, theirs))
        for column in one.columns:
            np.testing.assert_array_equal(column.values, other[column.name].values)
        assert one.errors == other.errors == theirs.failures
        assert list(one.errors) == [4]
        folders = [batch.save(tmp_path / str(batch.workers)) for batch in (ours, theirs)]
        files = [{path.name: path.read_bytes() for path in folder.rglob("*.*")} for folder in folders]
        assert files[0] == files[1]
        assert {"000003.csv", "motions.npz"} < files[0].keys()

    def test_what_a_process_cannot_answer_is_told_here(self, scenario, tmp_path):
        batch = pinarm.batch(scenario(text=LOOP), velocity={"upright_0": [1.0, 2.0]}, workers=2)
        with pytest.raises(InputError, match="no quantity 'upright'"):
            list(batch._answers(partial(Block.values, names=["upright"])))

    def test_a_process_that_dies_is_told(self, scenario, monkeypatch):
        lost = LostJob("its process died")
        monkeypatch.setattr(motions.Dispatch, "in_order", lambda self, jobs: (lost for _ in jobs))
        batch = pinarm.batch(scenario(text=LOOP), velocity={"upright_0": [1.0, 2.0]}, workers=2)
        with pytest.raises(NumericsError, match="the motions 0 to 1 have no answer: its process died"):
            batch.states()


def test_an_instant_next_to_a_jump_of_a_law_is_told_of_what_comes_after(scenario):
    """The law jumps at 0.7 s, and linspace has 0.7000000000000001 s."""
    effort = {"law": "trapezoid", "from": "0 N*m", "to": "1 N*m", "speed": "2 N*m/s", "acceleration": "10 N*m/s^2"}
    one = scenario().varied({"problem.loads.motor.effort": effort})
    batch, run = pinarm.batch(one, STARTS, RATES), alone(one, 1).run()
    assert 0.7 in run.trajectory.grid.t
    assert 0.7 not in batch.t
    after = np.searchsorted(run.trajectory.grid.t, 0.7, side="right") - 1
    for name in ("O", "power.motor"):
        assert batch[name][1, 7] == pytest.approx(run[name].values[after], abs=1e-9)
    assert np.isfinite(batch.states()[0]).all()
    stopped = scenario("end_stops: {B: {upper: 90 rad}}").varied({"problem.loads.motor.effort": effort})
    assert pinarm.batch(stopped, STARTS, RATES)["O"][:, 7] == pytest.approx(batch["O"][:, 7], abs=1e-9)


def test_joints_that_follow_laws_are_where_these_have_them(tmp_path, chain):
    """A second arm beside the free one is not solved for. Its speed is reached at 1.5000000000000002 s in floats."""
    free, moved = ({"name": name, "axis": "0 1 0", "com": "0 0 0.3"} for name in ("free", "moved"))
    other = chain(moved).partition('<link name="base"/>')[2]
    (tmp_path / "two.urdf").write_text(chain(free).replace("</robot>", other))
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: two.urdf\nproblem:\n  kind: forward\n  time: {end: 2 s, samples: 21}\n  motion:\n"
        "    moved: {law: trapezoid, begin: 0.1 s, from: 0 rad, to: 9 rad, speed: 4.2 rad/s, acceleration: 3 rad/s^2}\n"
        "outputs: [free, moved]\n"
    )
    batch = pinarm.batch(tmp_path / "s.yaml", {"free": [0.1, 0.2]})
    joint, run = batch.question.scenario.mechanism.joints["moved"], batch.run(0)
    assert is_batchable(batch.question.hybrid)
    q, v = batch.states()
    rows = np.searchsorted(run.trajectory.grid.t, batch.t)
    assert q[1, :, joint.q] == pytest.approx(run["moved"].values[rows], abs=1e-14)
    assert v[1, :, joint.v] == pytest.approx(run["joint.moved.velocity"].values[rows], abs=1e-14)
    assert q[1, [6, 15], joint.q] == pytest.approx([0.5 * 3.0 * 0.5**2, 0.5 * 4.2 * 1.4], abs=1e-14)
    assert batch["moved"] == pytest.approx(q[:, :, joint.q], abs=1e-14)
    assert batch["joint.moved.acceleration"][1, [0, 1, 14, 15]].tolist() == [0.0, 3.0, 3.0, 0.0]


def test_a_motor_with_losses_is_that_of_its_own_motion(scenario):
    """It comes to rest at the last instant: which way it has turned until then, the rows of others do not tell."""
    law = "O: {law: trapezoid, from: 0 rad, to: 1.75 rad, speed: 1 rad/s, acceleration: 4 rad/s^2}"
    text = SWING.replace("{O: 10 deg, B: 20 deg}", "{B: 20 deg}").replace("  EXTRA", f"  motion: {{{law}}}\n  EXTRA")
    one = scenario("", text).varied({"changes.drives.m": {"joint": "O", "efficiency": 0.5}})
    batch = pinarm.batch(one, {"B": STARTS["B"]})
    torque, effort = batch.values("drive.m.torque", "joint.O.effort")
    assert batch.states()[1][:, -1, batch.question.scenario.mechanism.joints["O"].v] == pytest.approx(0.0, abs=1e-14)
    assert torque[:, -1] == pytest.approx(np.where(effort[:, -1] > 0.0, 2.0, 0.5) * effort[:, -1], rel=1e-12)


def test_a_block_is_gone_when_the_next_is_solved(scenario, monkeypatch, tmp_path):
    """By its references alone, some of its motions having failed: the collector of cycles does not run."""
    alive, most = weakref.WeakSet(), []
    begun = Block.__init__

    def counted(block, *arguments):
        begun(block, *arguments)
        alive.add(block)
        most.append(len(alive))

    monkeypatch.setattr(Block, "__init__", counted)
    monkeypatch.setattr(motions, "TOGETHER", 4)
    monkeypatch.setattr(motions, "KEPT", 1)
    one = scenario().varied({"problem.time.end": "0.1 s"})
    batch = pinarm.batch(one, {"O": np.linspace(-1.0, 1.0, 12)}, {"B": np.where(np.arange(12) % 4, 0.0, 1e200)})
    gc.collect()
    gc.disable()
    try:
        batch.save(tmp_path / "out")
    finally:
        gc.enable()
    assert len(most) == 3
    assert max(most) <= 2
    assert len(batch.failures) == 3


def test_who_interrupts_is_not_told_of_a_motion_that_failed(scenario, monkeypatch):
    def solve_from(*_):
        raise Interrupted("interrupted at t = 0.1 s")

    monkeypatch.setattr(Forward, "solve_from", solve_from)
    with pytest.raises(Interrupted):
        _ = pinarm.batch(scenario(text=LOOP), velocity={"upright_0": 1.0}).failures


class TestReduced:
    def test_measures_of_a_ramp(self, scenario):
        """Of t from 0 to 2 in 21 rows: the square's mean is 4/3, and by the trapezoidal rule 0.1^2/6 more."""
        asked = ["min", "max", "mean", "rms", "median", 95, "start", "end"]
        table = pinarm.batch(scenario(), STARTS, RATES).reduced({"t": asked, "-2*t": "largest"})
        found = [table[name].values for name in ("min t", "max t", "mean t", "rms t", "median t", "95 % t", "start t")]
        expected = [0.0, 2.0, 1.0, (4.0 / 3.0 + 0.01 / 6.0) ** 0.5, 1.0, 1.9, 0.0]
        assert np.array(found) == pytest.approx(np.tile(expected, (4, 1)).T, rel=1e-14, abs=1e-14)
        assert table["end t"].values.tolist() == [2.0] * 4
        assert table["largest -2*t"].values.tolist() == [4.0] * 4
        assert table["max t"].label == "max t [s]"
        assert table["start joint.B.velocity"].values.tolist() == RATES["B"].tolist()
        assert table.to_dataframe().shape == (4, 3 + 9 + 1)
        assert "95 % t" in table._repr_html_()

    def test_a_motion_counts_as_far_as_it_goes_and_one_that_fails_not_at_all(self, scenario):
        one = scenario("events: {low: {when: O, reaches: -0.9 rad, then: stop}}").varied({"accuracy.max_steps": 300})
        batch = pinarm.batch(one, STARTS, {"B": np.array([0.0, 2.0, 3000.0, 1.0])})
        table, told = batch.reduced({"t": "end", "O": "min"}), batch["O"]
        assert np.isnan(table["min O"].values).tolist() == [False, False, True, False]
        assert list(table.errors) == [2]
        assert table["end t"].values[1] == batch.t[np.isfinite(told[1]).sum() - 1] < 2.0
        assert table["min O"].values[[0, 1, 3]] == pytest.approx(np.nanmin(told[[0, 1, 3]], axis=1), rel=1e-14)

    @pytest.mark.parametrize(("asked", "message"), [
        ({"O": "maximum"}, "no measure 'maximum' of O"), ({"o": "max"}, "'o'"),
    ])  # fmt: skip
    def test_what_cannot_be_asked_is_refused_before_anything_is_solved(self, scenario, asked, message):
        batch = pinarm.batch(scenario(), STARTS, RATES)
        with pytest.raises(InputError, match=message):
            batch.reduced(asked)
        with pytest.raises(InputError, match="no number of a run"):
            batch.numbers("O @ rms", "O @ p195")
        assert not batch._looked


class TestNumbers:
    @pytest.mark.slow
    def test_they_are_those_of_each_run_sections_included(self, scenario):
        one = scenario().varied({"limits.keep": {"O @ max": "< 1 rad"}, "accuracy.max_steps": 300})
        rates = {"B": np.array([0.0, 2.0, 3000.0, 1.0])}
        table = pinarm.batch(one, velocity=rates).numbers("O @ rms", "limits.least_margin", "t @ max(O)")
        assert list(table.errors) == [2]
        assert [str(column.unit) for column in table.columns[1:]] == ["rad", "1", "s"]
        for k in (0, 1, 3):
            alone = pinarm.run(one, {"problem.initial.velocity": {"B": f"{rates['B'][k]} rad/s"}})
            for column in table.columns[1:]:
                assert column.values[k] == pytest.approx(alone.number(column.name)[0], rel=1e-9)
        assert np.isnan(table["O @ rms"].values[2])

    def test_a_motion_that_does_not_come_to_a_place_leaves_the_others_their_numbers(self, scenario):
        """From 0.4 rad/s the arm does not come to 1 rad."""
        one, first = scenario().varied({"gravity": "none", "problem.loads": {}}), "t @ B=1 rad, occurrence=1"
        batch = pinarm.batch(one, {"O": 0.0, "B": 0.0}, {"O": 0.0, "B": [9.0, 0.4]})
        table = batch.numbers(first)
        assert np.isnan(table[first].values).tolist() == [False, True]
        assert list(table.errors) == [1]
        assert "not reached" in table.errors[1]
        with pytest.raises(InputError, match="not reached"):
            batch.numbers("t @ B=1000 rad")


class TestSave:
    def test_motions_are_saved_as_runs_are(self, scenario, tmp_path, monkeypatch):
        one = scenario().varied({"accuracy.max_steps": 300})
        monkeypatch.setattr(motions, "TOGETHER", 2)
        batch = pinarm.batch(one, STARTS, {"B": np.array([0.0, 2.0, 3000.0, 1.0])})
        folder = batch.save(tmp_path / "out")
        names = ["manifest.json", "motions", "motions.csv", "motions.npz", "summary.json"]
        assert sorted(path.name for path in folder.iterdir()) == names
        assert len(list((folder / "motions").iterdir())) == 8
        with np.load(folder / "motions" / "000001.npz") as arrays:
            assert arrays["B"] == pytest.approx(batch["B"][1], abs=1e-14)
        batch.run(1).save(tmp_path / "one", plots=False)
        assert (folder / "motions" / "000001.csv").read_bytes() == (tmp_path / "one" / "trajectory.csv").read_bytes()
        with np.load(folder / "motions.npz") as table:
            assert table["max B"][1] == batch["B"][1].max()
            assert table["energy"][[0, 1, 3]].max() < 1e-8
            assert "300 steps" in table["error"][2]
            assert np.isnan(table["max B"][2])
        lines = (folder / "motions.csv").read_text().splitlines()
        assert lines[0].startswith("motion,start joint.O.position [rad],")
        assert len(lines) == 5
        assert json.loads((folder / "summary.json").read_text())["failed"] == 1

    def test_tables_are_in_the_units_that_the_scenario_chooses(self, scenario, tmp_path):
        one = scenario().varied({"units": {"B": "deg", "t": "ms"}})
        batch = pinarm.batch(one, STARTS, {"B": np.array([0.0, 2.0, 3.0, 1.0])})
        folder = batch.save(tmp_path / "out")
        batch.run(1).save(tmp_path / "one", plots=False)
        rows = (folder / "motions" / "000001.csv").read_text()
        assert rows == (tmp_path / "one" / "trajectory.csv").read_text()
        assert rows.startswith("t [ms],")
        heading, *lines = (line.split(",") for line in (folder / "motions.csv").read_text().splitlines())
        place = heading.index("max B [deg]")
        assert [float(line[place]) for line in lines] == pytest.approx(np.degrees(batch["B"].values.max(axis=1)))
        reduced = batch.reduced({"B": ["largest", 95]}).written()[-2:]
        assert [series.label for series in reduced] == ["largest B [deg]", "95 % B [deg]"]
        with np.load(folder / "motions.npz") as table:
            assert table["max B"][1] == batch["B"][1].max()

    def test_one_motion_saved_can_be_run_again(self, scenario, tmp_path):
        motion = pinarm.batch(scenario(), STARTS, RATES).run(3)
        motion.save(tmp_path / "one", plots=False)
        again = pinarm.run(tmp_path / "one" / "scenario.yaml")
        assert again["B"].values == pytest.approx(motion["B"].values, abs=1e-9)


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
    with pytest.raises(NumericsError, match="without mass"):
        pinarm.batch(scenario().varied({"arguments.m_A": "0 kg", "arguments.m_BA": "0 kg"}), STARTS)
    with pytest.raises(InputError, match="of kind statics"):
        pinarm.batch(ROOT / "scenarios" / "gen411_arm_static.yaml", {"O": 0.0})


def test_a_start_where_nothing_is_moved_is_found_among_others(scenario):
    """With the tip's mass alone, a stretched arm cannot push it along itself: M has the determinant (m l l sin B)^2."""
    tip = scenario().varied({"arguments.m_B": "0 kg", "arguments.m_BA": "0 kg"})
    assert len(pinarm.batch(tip, {"B": [1.0, -0.5]})) == 2
    with pytest.raises(NumericsError, match="without mass"):
        pinarm.batch(tip, {"B": [1.0, 0.0, -0.5]})


def test_steps_do_not_depend_on_the_company():
    """Oscillators whose pulsations differ by their first coordinate, which stays."""
    rng = np.random.default_rng(0)
    q, v = rng.uniform(0.5, 30.0, (15, 2)), rng.normal(size=(15, 2)) * [0.0, 1.0]

    def accelerations(t, q, v):
        return np.array([0.0 * q[:, 0], -np.sin(q[:, 1]) * q[:, 0] ** 2 + np.cos(3.0 * t)]).T

    def acceleration(t, q, v):
        return accelerations(np.array([t]), q[None], v[None])[0]

    intervals = [Interval(a, b, acceleration, batch=accelerations) for a, b in ((0.0, 0.9), (0.9, 2.0))]
    method, space = Adaptive(1e-5), Flat(2, 2)
    ensemble = integrate_batch(intervals, space, q, v, method)
    t = np.linspace(0.0, 2.0, 7)
    states = ensemble.states(t)
    for number in range(15):
        single = integrate(intervals, space, q[number], v[number], method)
        assert ensemble.counts[number] == pytest.approx(len(single.steps), abs=3)  # errors near 1 go by rounding
        assert states[0][number] == pytest.approx(single.states(t)[0], abs=1e-2)


def test_steps_are_limited_over_all_stretches():
    """Either half of an oscillation takes fewer than both."""

    def pull(t, q, v):
        return -400.0 * q

    halves = [Interval(t, t + 1.0, pull, batch=pull) for t in (0.0, 1.0)]
    ones, line, method = np.ones((2, 1)), Flat(1, 1), Adaptive(1e-10)
    first, both = (integrate_batch(some, line, ones, ones, method).counts[0] for some in (halves[:1], halves))
    most = int(both) - 1
    assert first < 0.6 * most
    assert list(integrate_batch(halves, line, ones, ones, method, max_steps=most).failures) == [0, 1]


def test_rates_of_coordinates_that_the_scenario_gives_are_those_of_all_motions():
    """The coupler turns at 3 rad/s in every position of the crank, and the branch is that of a run of its own."""
    given = {
        "pinarm": 1, "mechanism": str(ROOT / "models" / "crank_rocker" / "mechanism.yaml"), "outputs": ["theta4"],
        "problem": {"kind": "forward", "time": {"end": "0.1 s", "samples": 3},
                    "initial": {"velocity": {"theta3": "3 rad/s"}}},
    }  # fmt: skip
    positions = np.linspace(-2.0, 2.0, 3)
    found = pinarm.batch(given, {"theta2": positions})
    assert found["omega3"].values[:, 0] == pytest.approx(3.0, abs=1e-12)
    for position, ours in zip(positions.tolist(), found["theta4"].values, strict=True):
        alone = pinarm.run(given, {"problem.initial.position.theta2": f"{position!r} rad"})
        assert ours == pytest.approx(alone["theta4"].values, abs=1e-9)


def test_rotors_behind_elastic_gears_begin_as_their_joints_do():
    """A flywheel and its rotor turn at one speed: the spring between them is idle."""
    given = {
        "pinarm": 1, "mechanism": str(ROOT / "models" / "servo" / "backlash.yaml"), "outputs": ["x"],
        "problem": {"kind": "forward", "time": {"end": "1 s", "samples": 3}},
    }  # fmt: skip
    found = pinarm.batch(given, {"x": [0.0, 1.0]}, {"x": [1.0, -2.0]})
    expected = [[0.0, 0.5, 1.0], [1.0, 0.0, -1.0]]
    assert found["x"].values == pytest.approx(np.array(expected), abs=1e-12)


@pytest.mark.slow
def test_motions_that_come_to_edges_of_a_load_are_the_motions_one_by_one():
    """A rotor at rest is taken along, thrown ahead and caught again at both flanks of a backlash."""
    given = {
        "pinarm": 1, "mechanism": str(ROOT / "models" / "servo" / "backlash.yaml"), "outputs": ["x"],
        "problem": {"kind": "forward", "time": {"end": "1 s", "samples": 3},
                    "initial": {"velocity": {"servo.rotor": "0 rad/s"}}},
    }  # fmt: skip
    speeds = [1.0, -2.0]
    found = pinarm.batch(given, velocity={"x": speeds})
    for speed, ours in zip(speeds, found["x"].values, strict=True):
        alone = pinarm.run(given, {"problem.initial.velocity.x": f"{speed} rad/s"})
        at_rows = [alone.number(f"x @ t={t} s, side=left")[0] for t in (0.0, 0.5, 1.0)]
        assert ours == pytest.approx(at_rows, abs=1e-9)


def test_either_of_two_wheels_in_mesh_may_begin_elsewhere():
    """They go on at their speeds, one at -0.5 of the other."""
    given = {
        "pinarm": 1, "mechanism": str(ROOT / "docs" / "kind_examples" / "couplings" / "gear_mechanism.yaml"),
        "problem": {"kind": "forward", "time": {"end": "1 s", "samples": 3}}, "outputs": ["in", "out"],
    }  # fmt: skip
    found = pinarm.batch(given, {"out": [0.4, -0.2]}, {"out": [1.0, 2.0]})
    assert found["out"].values == pytest.approx(np.array([[0.4, 0.9, 1.4], [-0.2, 0.8, 1.8]]), abs=1e-9)
    assert found["out"].values == pytest.approx(-0.5 * found["in"].values, abs=1e-12)


def test_velocities_that_loops_change_are_told_of_each_motion(scenario):
    """In a parallelogram both uprights turn alike, whatever the scenario gives of one."""
    one = scenario(text=LOOP)
    speeds = {"upright_0": [2.0, 1.0], "upright_1": [2.0, 0.0]}
    notes = [pinarm.batch(one, velocity=speeds).run(number).notes() for number in range(2)]
    assert notes[0] == []
    assert "the loops do not allow the given velocities" in notes[1][0]
    assert "where 1 was given" in notes[1][0]
