"""Efforts at joints: on each side of a jump of their law, and along a motor curve."""

import numpy as np
import pytest

from pinarm.mechanics.forces.joint_forces import JointEffort, TorqueSpeed
from pinarm.mechanics.laws import Trapezoid

from .test_force_element import SAMPLES, load, motion


def test_motor_curve_is_linear_between_its_points_and_constant_beyond(model, joints):
    element = SAMPLES[TorqueSpeed][0].bind(model, joints)
    rates = np.array([-7.0, -1.0, -0.5, 0.0, 0.75, 1.5, 2.0, 3.0, 40.0])
    expected = [9.0, 9.0, 7.5, 6.0, 5.5, 5.0, 3.0, -1.0, -1.0]
    v = np.stack([rates, np.full(9, 50.0)], axis=1)
    assert load(element, 0.0, np.zeros((9, 2)), v)[:, 0] == pytest.approx(expected, abs=1e-14)
    assert element.dissipated_power(0.0, np.zeros((9, 2)), v) == pytest.approx(-rates * expected, abs=1e-13)


def test_effort_is_its_law_on_each_side_of_a_jump(model, joints):
    law = Trapezoid(start=0.0, end=1.0, acceleration=1.0, begin=0.5)
    element = JointEffort(joint="turn", effort=law).bind(model, joints)
    q, v = motion(0.0)
    assert element.laws() == [law]
    assert load(element.on(1.5, 2.5), 1.0, q, v)[0] == pytest.approx(1.0 - 0.5 * 1.5**2)
    assert load(element.on(0.5, 1.5), 1.0, q, v)[0] == pytest.approx(0.125)
    with pytest.raises(ValueError, match="on an interval of time"):
        load(element, 1.0, q, v)
