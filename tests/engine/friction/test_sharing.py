"""Friction that a guide and a gear share, against a scalar equation by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

from pinarm.engine.friction.columns import SlipGroup
from pinarm.engine.friction.complementarity import FrictionBalance
from pinarm.engine.friction.slip_equation import CarriedLoads, SlipResponse
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.contact import Bearing, FrictionLaw

RATIO, CONSTANT, WEIGHT = 10.0, 60.0, 1000.0
"""Slip of the gear per slip of the guide, limit of the guide [N], and normal force of the gear without friction [N]."""


def shared(pull, mu, coupling):
    """A guide of constant friction, and a gear that carries ``WEIGHT + coupling f`` under friction f of the guide.

    The pull acts along the guide, on a mass of 1 kg.
    """
    guide = SimpleNamespace(name="joint.guide", law=FrictionLaw(0.0, 0.0, CONSTANT, CONSTANT), bearing=Bearing.none())
    thread = Bearing.thread(np.eye(3)[0], 1.0)
    gear = SimpleNamespace(name="coupling.gear", law=FrictionLaw(mu, mu, 0.0, 0.0), bearing=thread)
    wrench, response = np.zeros((2, 6)), np.zeros((2, 2, 6))
    wrench[1, 0], response[1, 0, 0] = WEIGHT, coupling
    slips = np.array([[1.0], [RATIO]])
    state = SlipResponse(
        pull * slips[:, 0], slips @ slips.T, CarriedLoads.linear(wrench, response), np.zeros(2, dtype=bool)
    )
    group = SlipGroup(np.array([1.0, RATIO]), np.ones(2))
    nothing = np.zeros(2)
    return FrictionBalance([guide, gear], state, nothing).solve(nothing, [group], np.zeros(2, dtype=bool))


def at_share(sigma, mu, coupling):
    """Friction of both in proportion sigma to their limits."""
    guide = sigma * CONSTANT
    return np.array([guide, sigma * mu * abs(WEIGHT + coupling * guide)])


@pytest.mark.parametrize("coupling", [3.0, -10.0])
@pytest.mark.parametrize("pull", [-300.0, 40.0, 130.0, 410.0])
def test_members_share_in_proportion_to_limits_that_depend_on_what_they_share(pull, coupling):
    mu = 0.1
    f = shared(pull, mu, coupling).f
    sigma = brentq(lambda s: pull + np.array([1.0, RATIO]) @ at_share(s, mu, coupling), -1.0, 1.0, xtol=1e-15)
    assert f == pytest.approx(at_share(sigma, mu, coupling), rel=1e-12)


def test_a_group_that_breaks_loose_has_its_limits():
    """Together they hold 60 + 10 * 0.1 * (1000 - 3 * 60) = 880 N."""
    solution = shared(-900.0, 0.1, -3.0)
    assert (solution.held, solution.bounds) == (pytest.approx([900.0]), pytest.approx([880.0], rel=1e-13))


def test_what_is_not_found_is_refused():
    with pytest.raises(DynamicsError, match=r"how joint\.guide, coupling\.gear share the friction .* is not found"):
        shared(-300.0, 0.1, -30.0)
