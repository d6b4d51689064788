"""Efforts at joints: on each side of a jump of their law, and along a motor curve."""

import numpy as np
import pytest

from pinarm.mechanics.forces.along_coordinate import TorqueSpeed

from .test_force_element import SAMPLES, load


def test_motor_curve_is_linear_between_its_points_and_constant_beyond(model, joints):
    element = SAMPLES[TorqueSpeed][0].bind(model, joints)
    rates = np.array([-7.0, -1.0, -0.5, 0.0, 0.75, 1.5, 2.0, 3.0, 40.0])
    expected = [9.0, 9.0, 7.5, 6.0, 5.5, 5.0, 3.0, -1.0, -1.0]
    v = np.stack([rates, np.full(9, 50.0)], axis=1)
    assert load(element, 0.0, np.zeros((9, 2)), v)[:, 0] == pytest.approx(expected, abs=1e-14)
    assert element.dissipated_power(0.0, np.zeros((9, 2)), v) == pytest.approx(-rates * expected, abs=1e-13)
