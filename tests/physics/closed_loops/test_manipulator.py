"""Industrial manipulator: all plane joint forces, and the law of motion, with a massless cylinder in the loop."""

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.mechanics.forces.points import Wrench
from pinarm.mechanics.laws import Harmonic

from .manipulator_closed_form import Manipulator

F, PRESSURE = 250.0, 3e5
PINS = {"A": "joint.alpha", "B": "joint.B", "E": "joint.E", "F": "loop.F", "D": "loop.D"}
GUIDES = {"x.force": "joint.x.force.y", "x.moment": "joint.x.moment.z", "y.force": "joint.y.force.x",
          "y.moment": "joint.y.moment.z"}  # fmt: skip


@pytest.fixture
def arm():
    return Manipulator()


def start(alpha):
    return {"alpha": alpha, "B": -alpha, "E": alpha, "x": -0.75 * np.cos(alpha), "y": 2 - 0.75 * np.sin(alpha)}


def loads(force, pressure, piston=0.03):
    return {
        "rod": Wrench(point="D5", force=(0.0, -pressure * piston, 0.0)),
        "cylinder": Wrench(point="H", force=(0.0, pressure * piston, 0.0)),
        "operator": Wrench(point="P", force=(0.0, force, 0.0), axes="arm"),
    }


def test_every_joint_force_is_that_of_newton_and_euler_for_each_body(solve, arm):
    law = Harmonic(mean=0.2, amplitude=0.9, pulsation=1.7, phase=0.4)
    found = solve("manipulator", "inverse", end=4.0, motion={"alpha": law}, drives=["alpha"],
                  start=start(0.55), loads=loads(F, PRESSURE))  # fmt: skip
    alpha, ald, aldd = (found[name].values for name in ("alpha", "ald", "aldd"))
    forces = arm.forces(alpha, ald, aldd, F, PRESSURE)
    assert found["joint.alpha.effort"].values == pytest.approx(forces["T"], rel=1e-9, abs=1e-7)
    assert forces["T"] == pytest.approx(arm.torque(alpha, aldd, F, PRESSURE), rel=1e-9, abs=1e-7)
    for pin, name in PINS.items():
        for axis in "xy":
            assert found[f"{name}.force.{axis}"].values == pytest.approx(forces[f"{pin}.{axis}"], rel=1e-9, abs=1e-6)
    for guide, name in GUIDES.items():
        assert found[name].values == pytest.approx(forces[guide], rel=1e-9, abs=1e-6)


def test_it_swings_as_its_law_of_motion_says(solve, arm):
    initial = {"position": {"alpha": 0.9}, "velocity": {"alpha": -0.3}}
    found = solve("manipulator", "forward", end=1.5, initial=initial, start=start(0.9), loads=loads(F, PRESSURE))
    alpha, ald = arm.swing(found["t"].values, 0.9, -0.3, F, PRESSURE)
    assert alpha.min() < -0.5
    assert found["alpha"].values == pytest.approx(alpha, abs=1e-9)
    assert found["ald"].values == pytest.approx(ald, abs=1e-9)
    forces = arm.forces(alpha, ald, arm.acceleration(alpha, F, PRESSURE), F, PRESSURE)
    for pin, name in PINS.items():
        for axis in "xy":
            assert found[f"{name}.force.{axis}"].values == pytest.approx(forces[f"{pin}.{axis}"], rel=1e-7, abs=1e-5)


def test_components_that_rigid_bodies_do_not_determine_are_refused(solve):
    """Hyperstatic in space: three times in the parallelogram, once along Z in the loop of the cylinder."""
    found = solve("manipulator", "statics", hold={"alpha": 0.2}, drives=["alpha"], start=start(0.2))
    for name in ("loop.F.force.z", "loop.F.moment.x", "joint.B.moment.y", "loop.D.force.z", "joint.alpha.force.z"):
        with pytest.raises(InputError, match="hyperstatic of degree 4"):
            found[name]
