"""KinematicMotion: the motion of inverse dynamics without its forces, for models without mass too."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.laws import Constant, ConstantSpeed, Harmonic, Trapezoid
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Inverse, KinematicMotion
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

ROOT = Path(pinarm.__file__).parents[1]
WEIGHTLESS = {"m_A": "0 kg", "m_B": "0 kg", "m_BA": "0 kg"}
LIFT = {"A_height": Harmonic(mean=0.55, amplitude=0.1, pulsation=3.0), "A_side": Constant(value=0.3)}
ELBOW = {"O": 1.0, "B": -1.5}


def place(*path):
    return nullcontext()


def arm(**arguments):
    return Mechanism.load(ROOT / "models" / "gen411_arm" / "mechanism.yaml", arguments)


def outcome(mechanism, motion, *, kind=KinematicMotion, start=None, time=None):
    problem = kind(time=time or TimeGrid(end=2.0, samples=41), motion=motion, start=start or {})
    return problem.solve(mechanism, Accuracy(), place)


def solve(mechanism, motion, **given):
    return outcome(mechanism, motion, **given).rows


def test_a_task_motion_of_a_massless_arm_is_that_of_its_two_circles():
    """Elbow up: ``B = -2 acos(d / 2 l)`` and ``O = atan2(y, x) - B / 2`` with d the distance of A from O."""
    run = solve(arm(**WEIGHTLESS), LIFT, start=ELBOW)
    x, y = 0.3, 0.05 + 0.1 * np.sin(3.0 * run.grid.t)
    bend = -2 * np.arccos(np.hypot(x, y) / 0.5)
    assert run.q[:, 1] == pytest.approx(bend, abs=1e-13)
    assert run.q[:, 0] == pytest.approx(np.arctan2(y, x) - bend / 2, abs=1e-13)
    assert np.ptp(run.q[:, 0]) > 0.2


def test_velocity_and_acceleration_of_the_task_are_those_of_the_law():
    run = solve(arm(**WEIGHTLESS), LIFT, start=ELBOW)
    quantities, t = Quantities(run), run.grid.t
    assert quantities["point.A.velocity.y"].values == pytest.approx(0.3 * np.cos(3 * t), abs=1e-13)
    assert quantities["point.A.acceleration.y"].values == pytest.approx(-0.9 * np.sin(3 * t), abs=1e-12)
    assert quantities["point.A.acceleration.x"].values == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("motion", [LIFT, {"O": Trapezoid(start=0.2, end=1.0, acceleration=4.0, begin=0.5),
                                           "phi": ConstantSpeed(speed=-1.0)}], ids=["task", "joints"])  # fmt: skip
def test_the_motion_is_that_of_inverse_dynamics(motion):
    moved, driven = (solve(arm(), motion, kind=kind, start=ELBOW) for kind in (KinematicMotion, Inverse))
    for name in ("q", "v", "a"):
        assert np.array_equal(getattr(moved, name), getattr(driven, name)), name
    assert np.array_equal(moved.grid.t, driven.grid.t)


def test_the_start_chooses_the_branch():
    up, down = (solve(arm(), LIFT, start={"O": o, "B": b}) for o, b in ((1.0, -1.5), (-0.5, 1.5)))
    assert up.q[:, 1] == pytest.approx(-down.q[:, 1], abs=1e-13)
    assert (up.q[:, 1] < 0.0).all()


def test_too_few_laws_are_refused():
    with pytest.raises(InputError, match="2 coordinates have to follow a law and 1 do"):
        solve(arm(), {"O": Constant(value=0.0)})


def test_a_motion_out_of_reach_is_refused():
    with pytest.raises(AssemblyError, match="out of reach"):
        solve(arm(), {"A_height": Constant(value=2.0), "A_side": Constant(value=0.3)}, start=ELBOW)


def test_a_stretched_arm_is_singular_without_any_mass():
    with pytest.raises(AssemblyError, match="singular"):
        solve(arm(**WEIGHTLESS), {"A_height": Constant(value=0.5), "A_side": Constant(value=0.5)}, start={"B": 0.01})


@pytest.mark.parametrize("name", ["joint.B.power", "joint.O.moment.z"])
def test_forces_are_refused_and_not_zero(name):
    run = solve(arm(), {"O": Constant(value=0.3), "B": Constant(value=0.4)})
    with pytest.raises(InputError, match="kinematic") as caught:
        Quantities(run)[name]
    assert caught.value.hint == "kind: inverse"
    assert Quantities(run)["joint.O.position"].values[0] == 0.3


def test_forces_are_refused_before_anything_is_solved():
    file = ROOT / "scenarios" / "magic_arms_kinematics.yaml"
    with pytest.raises(InputError, match="asks for no forces"):
        pinarm.load(file, ["outputs=[joint.alpha.effort]"]).validate()
