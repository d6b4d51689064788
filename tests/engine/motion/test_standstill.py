"""Which way a joint moves where its speed is zero: by the law's own derivatives, whatever rows are looked at."""

import re
from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.engine.motion.outcome import on_interval
from pinarm.mechanics.laws import Cycloidal, Harmonic, Polynomial, Trapezoid
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Inverse, State, Statics
from pinarm.problems.time_grid import TimeGrid

ETA = 0.5
DOWN = [
    Trapezoid(start=1.0, end=0.0, acceleration=-1.0, begin=0.7),
    Cycloidal(start=1.0, end=0.0, duration=1.7, begin=0.7),
    Polynomial(start=1.0, end=0.0, duration=1.7, begin=0.7, degree=5),
    Polynomial(start=1.0, end=0.0, duration=1.7, begin=0.7, degree=7),
]


@pytest.fixture
def arm(mechanism, chain):
    drives = {"motor": {"joint": "arm", "efficiency": ETA}}
    return mechanism(chain({"name": "arm", "axis": "0 -1 0", "com": "0.5 0 0"}), drives=drives)


@pytest.fixture
def two_arms(mechanism, chain):
    bodies = [{"name": name, "axis": "0 -1 0", "com": "0.5 0 0"} for name in ("arm", "hand")]
    return mechanism(chain(*bodies), drives={"motor": {"joint": "arm", "efficiency": ETA}})


def outcome(problem, mechanism):
    return problem.solve(mechanism, Accuracy(tolerance=1e-10), lambda *path: nullcontext())


@pytest.mark.parametrize("law", DOWN, ids=["trapezoid", "cycloidal", "fifth degree", "seventh degree"])
@pytest.mark.parametrize("samples", [2, 7])
def test_at_the_ends_of_a_motion_it_is_that_of_the_motion(arm, law, samples):
    begin, end = law.breakpoints()[0], law.breakpoints()[-1]
    solved = outcome(Inverse(time=TimeGrid(end=3.0, samples=samples), motion={"arm": law}), arm)
    cuts = solved.rows.grid.cuts
    for interval, t, wanted in (
        (0, begin, 0), (1, begin, -1), (len(cuts) - 3, end, -1), (len(cuts) - 2, end, 0),
    ):  # fmt: skip
        alone = on_interval(solved.motion, cuts, interval, np.array([t]))
        assert alone.direction(0).tolist() == [wanted], (interval, t)


def test_efforts_that_hold_give_no_direction(two_arms):
    """The accelerations that they leave are rounding of gravity's, 29 rad/s^2 or less."""
    q = np.random.default_rng(2).uniform(-3.0, 3.0, (200, 2))
    held = two_arms.inverse(q, np.zeros_like(q), np.zeros_like(q))
    alone = two_arms.at(q, tau=held)
    assert 0.0 < np.abs(alone["joint.arm.acceleration"].values).max() < 1e-12
    assert alone["drive.motor.torque"].values == pytest.approx(held[:, 0] / ETA, rel=1e-12)


@pytest.mark.parametrize("acceleration", [-0.1, 0.1])
def test_a_state_at_rest_is_about_to_move(arm, acceleration):
    """Weight 1 kg at 0.5 m, inertia 0.35 kg*m^2: lowered it drives the motor."""
    rows = outcome(State(hold={"arm": 0.0}, acceleration={"arm": acceleration}), arm).rows
    assert rows.direction(0).tolist() == [np.sign(acceleration)]


def test_a_slip_that_is_zero_but_for_rounding_has_no_friction(mechanism, chain):
    """With a + b = 0.1 x, b + c = 0.7 x and c + a = 0.8 x joint b keeps its angle: rounding leaves it a speed."""
    bodies = [{"name": name, "axis": "0 1 0", "com": "0.5 0 0"} for name in "abc"]
    coordinates = {name: {"kind": "sum", "of": [*name]} for name in ("ab", "bc", "ca")}
    arm = mechanism(chain(*bodies), coordinates=coordinates, friction={"b": {"constant": "1 N*m"}})
    motion = {name: Harmonic(amplitude=x, pulsation=2.0) for name, x in (("ab", 0.1), ("bc", 0.7), ("ca", 0.8))}
    run = outcome(Inverse(time=TimeGrid(end=3.0, samples=31), motion=motion), arm).rows
    assert 0.0 < np.abs(run.v[:, 1]).max() < 1e-14
    assert not run.columns["joint.b.friction"].values.any()
    lower, upper = (run.columns[f"joint.b.effort.{part}"].values for part in ("lower", "upper"))
    assert upper - lower == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize(("gravity", "held"), [({"direction": "-z"}, 1), ("none", 0)])
def test_a_gear_that_holds_a_load_has_a_band(mechanism, chain, gravity, held):
    """From ``eta tau / N`` to ``tau / (eta N)``; without a load there is none."""
    body, servo = {"name": "arm", "axis": "0 -1 0", "com": "0.5 0 0"}, {"joint": "arm", "ratio": 10, "efficiency": 0.7}
    found = outcome(Statics(hold={"arm": 0.0}), mechanism(chain(body), gravity=gravity, drives={"servo": servo})).notes
    assert len(found) == held
    if held:
        assert found[0].startswith("drive.servo.torque: at rest its gear holds the load with any torque of a band")
        band = re.search("from ([0-9.]+) to ([0-9.]+) N[*]m in the first of them", found[0])
        assert [float(x) for x in band.groups()] == pytest.approx([0.5 * 9.81 * 0.07, 0.5 * 9.81 / 7.0], rel=1e-3)
