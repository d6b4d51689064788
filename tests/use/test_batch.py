"""Many motions at once are the motions one by one, each with its own steps, events, impacts and failures."""

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

import pinarm
from pinarm.engine.integrators import Adaptive, Flat, Stretch, advance, integrate
from pinarm.errors import InputError, NumericsError
from pinarm.mechanics.forces.pieces import Pieces

ROOT = Path(__file__).parents[2]
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
        for name in ("O", "B", "point.A.position.y", "joint.B.velocity"):
            assert batch[name][number] == pytest.approx(expected[name].values, abs=1e-9)
        assert q[number, :, 1] == pytest.approx(expected["B"].values, abs=1e-9)
        assert v[number, :, 1] == pytest.approx(expected["joint.B.velocity"].values, abs=1e-8)


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
    push = Stretch(0.0, 1.0, lambda t, q, v: 100.0 * np.clip(1.0 - abs(q - 3.01) / 0.01, 0.0, None),
                   together=lambda t, q, v: 100.0 * np.clip(1.0 - abs(q - 3.01) / 0.01, 0.0, None))  # fmt: skip
    pieces, line = Pieces(np.array([3.0, 3.01, 3.02])), Flat(1, 1)
    given = {"max_steps": 300, "passes": lambda t, q, v: pieces.passed(q[:, 0])}
    speeds = np.array([[20.0], [2.0], [-5.0]])
    batch = advance([push], line, np.zeros((3, 1)), speeds, Adaptive(1e-10), **given)
    for v, found in zip(speeds, batch.solutions, strict=True):
        expected = integrate([push], line, np.zeros(1), v, Adaptive(1e-10), **given)
        assert len(found.steps) == pytest.approx(len(expected.steps), abs=2)  # errors of 1e-10 but for rounding
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
    found = batch["O"]
    assert np.isfinite(found[[0, 1, 3]]).all()
    assert 0 < np.isfinite(found[2]).sum() < 21
    assert found[1] == pytest.approx(alone(one, 1, rates).run()["O"].values, abs=1e-9)


def test_loops_are_taken_one_by_one(scenario):
    text = (
        "pinarm: 1\nmechanism: models/four_bar/mechanism.yaml\nproblem:\n"
        "  kind: forward\n  time: {end: 0.4 s, samples: 5}\n"
        "  initial: {position: {upright_0: 0 rad}, velocity: {upright_0: 1 rad/s}}\noutputs: [upright_0]\n"
    )
    batch = pinarm.batch(scenario(text=text), velocity={"upright_0": [1.0, 2.0]})
    assert batch["upright_1"] == pytest.approx(batch["upright_0"], abs=1e-12)
    assert batch["upright_0"][0, -1] == pytest.approx(scenario(text=text).run()["upright_0"].values[-1], abs=1e-13)


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ({"o": 0.0}, "no free joint 'o'"),
        ({"O": [0.0, 1.0], "B": [0.0, 1.0, 2.0]}, "the arrays have the shapes"),
        ({"O": []}, "there are no initial values"),
        ({"O": [[0.0]]}, "the arrays have 2 axes"),
    ],
)
def test_starts_that_cannot_be_are_refused(scenario, position, message):
    with pytest.raises(InputError, match=message):
        pinarm.batch(scenario(), position)


def test_a_scenario_that_looks_for_its_setting_is_refused(scenario):
    with pytest.raises(InputError, match="looks for numbers"):
        pinarm.batch(scenario().varied({"accuracy": {"target": 1e-6}}), {"O": 0.0})


def test_a_body_without_mass_is_refused_before_anything_moves(scenario):
    with pytest.raises(NumericsError, match="without mass"):
        pinarm.batch(scenario().varied({"arguments.m_A": "0 kg", "arguments.m_BA": "0 kg"}), STARTS)


def test_only_forward_motions_have_initial_states():
    with pytest.raises(InputError, match="of kind statics"):
        pinarm.batch(ROOT / "scenarios" / "gen411_arm_static.yaml", {"O": 0.0})


@pytest.mark.parametrize("tolerance", [1e-5, 1e-10])
def test_steps_do_not_depend_on_the_company(tolerance):
    """Oscillators whose pulsations differ by their first coordinate, which stays."""
    rng = np.random.default_rng(0)
    q, v = rng.uniform(0.5, 30.0, (40, 2)), rng.normal(size=(40, 2)) * [0.0, 1.0]

    def accelerations(t, q, v):
        return np.array([0.0 * q[:, 0], -np.sin(q[:, 1]) * q[:, 0] ** 2 + np.cos(3.0 * t)]).T

    def acceleration(t, q, v):
        return accelerations(np.array([t]), q[None], v[None])[0]

    stretches = [Stretch(a, b, acceleration, together=accelerations) for a, b in ((0.0, 0.9), (0.9, 2.0))]
    method, space = Adaptive(tolerance), Flat(2, 2)
    ensemble = advance(stretches, space, q, v, method)
    t = np.linspace(0.0, 2.0, 7)
    states = ensemble.states(t)
    for number in range(40):
        single, ours = integrate(stretches, space, q[number], v[number], method), ensemble.solutions[number]
        assert len(ours.steps) == pytest.approx(len(single.steps), abs=3)  # errors near 1 go by rounding
        assert states[0][number] == pytest.approx(single.states(t)[0], abs=1e3 * tolerance)
