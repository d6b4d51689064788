"""What two and three joints at rest may share, by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from pinarm.engine.friction.complementarity import FrictionBalance, extreme_frictions, groups_of
from pinarm.engine.friction.slip_equation import CarriedLoads, SlipResponse
from pinarm.mechanics.friction.contact import Bearing, FrictionLaw


def held(slips, pull, limits, mu=None, weight=0.0, coupling=0.0):
    """One mass of 1 kg under a pull, with joints of given slips; the last carries ``weight + coupling f_0``."""
    k, slips = len(limits), np.array(slips)[:, None]
    laws = [FrictionLaw(0.0, 0.0, limit, limit) for limit in limits]
    bearings = [Bearing.none() for _ in limits]
    wrench, response = np.zeros((k, 6)), np.zeros((k, k, 6))
    if mu is not None:
        laws[-1], bearings[-1] = FrictionLaw(mu, mu, 0.0, 0.0), Bearing.thread(np.eye(3)[0], 1.0)
        wrench[-1, 0], response[-1, 0, 0] = weight, coupling
    contacts = [SimpleNamespace(name=f"joint.{i}", law=law, bearing=bearing)
                for i, (law, bearing) in enumerate(zip(laws, bearings, strict=True))]  # fmt: skip
    state = SlipResponse(pull * slips[:, 0], slips @ slips.T, CarriedLoads.linear(wrench, response),
                         np.zeros(k, dtype=bool))  # fmt: skip
    balance = FrictionBalance(contacts, state, np.zeros(k))
    groups = groups_of(contacts, state, list(range(k)))
    told = balance.solve(np.zeros(k), groups, np.zeros(k, dtype=bool)).f
    return balance, groups, told


def extremes(*given, **further):
    balance, groups, told = held(*given, **further)
    found, endless = extreme_frictions(balance, np.zeros(len(told)), groups, told)
    assert not endless.any()
    slips = np.array(given[0])
    assert found @ slips == pytest.approx(np.full(len(found), told @ slips), rel=1e-12)  # the load is held
    return found[np.argsort(found[:, 0])]


def test_two_joints_of_constant_friction():
    """``f_0 + f_1 = -5`` with ``|f_0| <= 10`` and ``|f_1| <= 3``: f_0 from -8 to -2."""
    assert extremes([1.0, 1.0], 5.0, [10.0, 3.0])[:, 0] == pytest.approx([-8.0, -2.0], rel=1e-10)
    assert extremes([1.0, 1.0], 5.0, [1.0, 30.0])[:, 0] == pytest.approx([-1.0, 1.0], rel=1e-10)


def test_a_limit_that_depends_on_what_is_shared():
    """``|f_1| <= 0.1 (40 + 2 f_0)`` and ``f_0 + f_1 = -5``: ``-5 - f_0 = -+0.1 (40 + 2 f_0)``."""
    found = extremes([1.0, 1.0], 5.0, [10.0, 0.0], mu=0.1, weight=40.0, coupling=2.0)
    assert found[:, 0] == pytest.approx([-9.0 / 1.2, -1.0 / 0.8], rel=1e-10)


def test_three_joints_have_the_corners_of_a_polygon():
    """Each of three is least and greatest where the other two are at limits, or at its own limit."""
    found = extremes([1.0, 1.0, 1.0], 2.0, [3.0, 4.0, 10.0])
    assert found.min(axis=0) == pytest.approx([-3.0, -4.0, -9.0], rel=1e-12)
    assert found.max(axis=0) == pytest.approx([3.0, 4.0, 5.0], rel=1e-12)


@pytest.mark.parametrize("law", [0, 1])
def test_ends_that_are_not_known_are_told_in_both_directions(law):
    """``|f_1| <= |20 - 3 f_0|`` holds for all ``f_0 < 0``; the other joint has a wide limit, or the same law."""
    balance, groups, _ = held([1.0, 1.0], 5.0, [60.0, 0.0], mu=1.0, weight=20.0, coupling=-3.0)
    if law:
        balance.response.loads.wrench[0, 0], balance.response.loads.response[0, 0, 0] = 20.0, -3.0
        balance.contacts[0] = SimpleNamespace(**{**vars(balance.contacts[1]), "name": "joint.0"})
    found, endless = extreme_frictions(balance, np.zeros(2), groups, np.array([-2.5, -2.5]))
    assert endless.all() and found.sum(axis=1) == pytest.approx([-5.0, -5.0], rel=1e-12)
    assert sorted(np.sign(found[:, 0] + 2.5)) == [-1.0, 1.0]
