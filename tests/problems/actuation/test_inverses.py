"""Inverse dynamics for controllers: that of trees with couplings against the general route with multipliers."""

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.problems.actuation.controls import MechanismPlant
from pinarm.problems.actuation.inverses import InverseOfCouplings, InverseOfLoops

JOINTS = [f"panda_joint{k}" for k in range(1, 8)]
FINGER = "panda_finger_joint1"


def general(plant, names):
    """The route of loops for the same drives."""
    mechanism = plant.mechanism
    rows = mechanism.closure.with_guides(names, [mechanism.coordinate(name) for name in names])
    return InverseOfLoops(plant.dynamics, rows, (), len(names))


@pytest.mark.parametrize("names", [[FINGER, *JOINTS[::-1]], JOINTS[2:5]])
def test_a_tree_with_couplings_needs_the_efforts_of_the_general_route(names):
    mechanism = pinarm.Mechanism.load("panda")
    plant = MechanismPlant(mechanism, mechanism.dynamics)
    inverse, random = plant.inverse([plant.drive(name) for name in names]), np.random.default_rng(3)
    assert isinstance(inverse, InverseOfCouplings)
    q, v = random.normal(size=(2, 5, mechanism.model.nv))
    finger, other = (mechanism.joints[name].v for name in (FINGER, "panda_finger_joint2"))
    q[:, other], v[:, other] = q[:, finger], v[:, finger]
    a = random.normal(size=(5, len(names)))
    expected = general(plant, names)(np.zeros(5), q, v, a)
    found = inverse(np.zeros(5), q, v, a)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-10 * np.abs(expected).max())
    assert np.array_equal(found[2], inverse(0.0, q[2], v[2], a[2]))


def test_drives_that_are_coupled_are_refused():
    mechanism = pinarm.Mechanism.load("panda")
    plant = MechanismPlant(mechanism, mechanism.dynamics)
    with pytest.raises(InputError, match="do not move independently"):
        plant.inverse([plant.drive(name) for name in (FINGER, "panda_finger_joint2")])
