"""Rotor in a ball bearing and a ring bearing, with any correction masses, on shafts of both kinds."""

import numpy as np
import pytest

from pinarm.mechanics.description import Gravity
from pinarm.mechanics.laws import ConstantSpeed

from .rotor_closed_form import Rotor

W, G = 100 * np.pi, 9.81


def spun(solve, direction, masses=(0.0, 0.0), angles=(0.0, 0.0)):
    arguments = {"m_c1": masses[0], "m_c2": masses[1], "a_c1": angles[0], "a_c2": angles[1]}
    return solve("rotor_in_bearings", "inverse", arguments=arguments, end=0.02, samples=41, drives=["phi"],
                 gravity=Gravity(direction=direction), motion={"phi": ConstantSpeed(speed=W)})  # fmt: skip


def force(found, name):
    return found[f"{name}.force.x"].values + 1j * found[f"{name}.force.y"].values


@pytest.mark.parametrize(("masses", "angles"), [((0.0, 0.0), (0.0, 0.0)), ((0.03, 0.011), (1.0, -2.5))])
def test_bearing_forces_have_the_rotating_and_the_constant_part_of_the_closed_form(solve, masses, angles):
    rotor, found = Rotor(), spun(solve, "-y", masses, angles)
    turn = np.exp(1j * found["phi"].values)
    rotating, constant = rotor.rotating(W, masses, angles), rotor.constant(G, masses)
    for name, turning, still in zip(("joint.tilt_x", "loop.B"), rotating, constant, strict=True):
        assert force(found, name) == pytest.approx(still + turning * turn, abs=1e-8)
    upright = spun(solve, "-z", masses, angles)
    for name, turning in zip(("joint.tilt_x", "loop.B"), rotor.rotating(W, masses, angles, axial_g=G), strict=True):
        assert force(upright, name) == pytest.approx(turning * turn, abs=1e-8)
    assert upright["joint.tilt_x.force.z"].values == pytest.approx((12.0 + sum(masses)) * G, abs=1e-8)


def test_correction_masses_leave_the_weights_alone(solve):
    rotor = Rotor()
    masses, angles = rotor.corrections()
    found = spun(solve, "-y", masses, angles)
    for name, still in zip(("joint.tilt_x", "loop.B"), rotor.constant(G, masses), strict=True):
        assert force(found, name) == pytest.approx(still, abs=1e-8)
