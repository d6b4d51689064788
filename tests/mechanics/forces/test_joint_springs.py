"""Springs, dampers and friction at joints, by hand."""

import numpy as np
import pytest

from pinarm.mechanics.forces.along_coordinate import JointSpring, RegularisedFriction
from pinarm.mechanics.forces.joint_forces import CREEP

from .test_force_element import SAMPLES, load


@pytest.mark.parametrize("creep", [None])
def test_friction_is_its_bound_far_above_creep_and_gives_way_below(model, joints, creep):
    given = {} if creep is None else {"creep": creep}
    element = RegularisedFriction(joint="turn", friction=3.0, **given).bind(model, joints)
    scale = CREEP if creep is None else creep

    def at(rate):
        return load(element, 0.0, np.zeros(2), np.array([rate, 50.0]))[0]

    for sign in (1.0, -1.0):
        assert at(sign * 5 * scale) == pytest.approx(-sign * 3.0, rel=1e-4)
        assert at(sign * 1e3 * scale) == -sign * 3.0
        # a load of half the bound makes the joint creep at atanh(1/2)
        assert at(sign * scale * np.arctanh(0.5)) == pytest.approx(-sign * 1.5, rel=1e-14)
    assert at(0.0) == 0.0
    assert element.dissipated_power(0.0, np.zeros(2), np.array([-2.0, 50.0])) == pytest.approx(6.0, rel=1e-14)
    assert element.potential_energy(np.ones(2)) == 0.0


def test_spring_and_damper_by_hand(model, joints):
    element = SAMPLES[JointSpring][0].bind(model, joints)
    q, v = np.array([0.5, 9.0]), np.array([-2.0, 9.0])
    assert load(element, 0.0, q, v) == pytest.approx([-30.0 * 0.3 + 0.7 * 2.0, 0.0])
    assert element.potential_energy(q) == pytest.approx(0.5 * 30.0 * 0.3**2)
    assert element.dissipated_power(0.0, q, v) == pytest.approx(0.7 * 4.0)
    assert element.laws() == []
