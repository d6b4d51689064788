"""Inverse dynamics for controllers of trees with couplings, against forward dynamics."""

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.problems.control import MechanismPlant

JOINTS = [f"panda_joint{k}" for k in range(1, 8)]
FINGER, OTHER = "panda_finger_joint1", "panda_finger_joint2"


def test_efforts_of_drives_give_the_accelerations_that_they_were_asked_for():
    mechanism = pinarm.Mechanism.load("panda")
    plant, names = MechanismPlant(mechanism, mechanism.dynamics), [FINGER, *JOINTS[::-1]]
    inverse, random = plant.inverse([plant.drive(name) for name in names]), np.random.default_rng(3)
    v_of = {name: joint.v for name, joint in mechanism.joints.items()}
    q, v = random.normal(size=(2, 5, mechanism.model.nv))
    q[:, v_of[OTHER]], v[:, v_of[OTHER]] = q[:, v_of[FINGER]], v[:, v_of[FINGER]]
    a, places = random.normal(size=(5, len(names))), [v_of[name] for name in names]
    tau = np.zeros_like(v)
    tau[:, places] = inverse(np.zeros(5), q, v, a)
    assert np.asarray(mechanism.forward(q, v, tau))[:, places] == pytest.approx(a, abs=1e-9)
    assert np.array_equal(tau[2, places], inverse(0.0, q[2], v[2], a[2]))


def test_drives_that_are_coupled_are_refused():
    mechanism = pinarm.Mechanism.load("panda")
    plant = MechanismPlant(mechanism, mechanism.dynamics)
    with pytest.raises(InputError, match="do not move independently"):
        plant.inverse([plant.drive(name) for name in (FINGER, OTHER)])
