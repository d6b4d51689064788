"""Joints at rest whose friction grows with what it holds, by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from pinarm.engine.friction.carried_loads import CarriedLoads
from pinarm.engine.friction.locking import locks
from pinarm.engine.friction.slipping import Slipping
from pinarm.mechanics.friction.bearing import Bearing


def flanks(first, response, mu, constant=None):
    """Joints that begin to slip forwards, whose flanks carry ``first + response f``."""
    k = len(mu)
    contacts = [SimpleNamespace(name=f"joint.{i}", bearing=Bearing.thread(np.eye(3)[0], 1.0)) for i in range(k)]
    wrench, per = np.zeros((k, 6)), np.zeros((k, k, 6))
    wrench[:, 0], per[:, :, 0] = first, response
    constant = np.zeros(k) if constant is None else np.array(constant)
    return Slipping(contacts, np.ones(k), np.array(mu), constant, CarriedLoads.linear(wrench, per))


@pytest.mark.parametrize(
    ("first", "response", "held"),
    [
        (10.0, -4.0, True),  # x <= 0.3 (10 + 4 x) for all x
        (0.0, 4.0, True),  # x <= 1.2 x
        (1e-13, 4.0, True),  # and the same but for rounding of an effort of 1
        (10.0, 4.0, False),  # not from 3 / 2.2 to 15
        (10.0, 3.0, False),  # 0.3 * 3 < 1: there is an end
    ],
)
def test_one_joint(first, response, held):
    assert locks(flanks(first, response, [0.3]), np.ones(1), 1.0) == held


def test_a_load_that_friction_without_a_load_of_its_own_takes_over():
    """``x <= 0.3 |2 - 3 - 4 x|``: with 3 N the second joint turns the load of 2 N round."""
    response = [[4.0, 1.0], [0.0, 0.0]]
    assert not locks(flanks([2.0, 0.0], response, [0.3, 0.0], [0.0, 1.0]), np.ones(2), 1.0)
    assert locks(flanks([2.0, 0.0], response, [0.3, 0.0], [0.0, 3.0]), np.ones(2), 1.0)


def test_two_joints_lock_together_that_would_give_way_alone():
    """Each raises its own load 0.6 times, and that of the other one as often."""
    assert locks(flanks([0.0, 0.0], [[2.0, 2.0], [2.0, 2.0]], [0.3, 0.3]), np.ones(2), 1.0)
    assert not locks(flanks([0.0, 0.0], [[2.0, -2.0], [2.0, 2.0]], [0.3, 0.3]), np.ones(2), 1.0)
