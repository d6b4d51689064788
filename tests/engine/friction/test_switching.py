"""Which joints stick: chains of blocks against all combinations, groups that move together, and several answers."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from pinarm.engine.friction.complementarity import FrictionBalance, decided, groups_of
from pinarm.engine.friction.slip_equation import CarriedLoads, SlipResponse
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.contact import Bearing, FrictionLaw


def balance(rows, pull, limits, static=None):
    """Unit masses under pulls, with slips ``rows @ v`` of constant friction."""
    rows, k = np.atleast_2d(rows), len(limits)
    laws = [FrictionLaw(0.0, 0.0, kinetic, rest) for kinetic, rest in zip(limits, static or limits, strict=True)]
    contacts = [SimpleNamespace(name=f"joint.{i}", law=law, bearing=Bearing.none()) for i, law in enumerate(laws)]
    loads = CarriedLoads.linear(np.zeros((k, 6)), np.zeros((k, k, 6)))
    size = np.linalg.norm(rows, axis=1)
    response = SlipResponse(rows @ pull, rows @ rows.T, loads, size == 0.0)
    return FrictionBalance(contacts, response, np.zeros(k))


def test_the_switch_solves_the_convex_problem():
    """The work of friction and kinetic energy: the acceleration minimises |a - pull|^2 / 2 + sum_i F_i |J_i a|."""
    rng = np.random.default_rng(2)
    for _ in range(40):
        rows, pull, limits = rng.normal(size=(4, 6)), 3.0 * rng.normal(size=6), rng.uniform(0.2, 3.0, size=4)
        given = balance(rows, pull, limits)
        slip = decided(given, np.zeros(4), np.zeros(4))
        solved = given.solve(np.array(slip.direction, float), slip.stuck, np.zeros(4, dtype=bool))

        def cost(a, rows=rows, pull=pull, limits=limits):
            return 0.5 * ((a - pull) ** 2).sum() + limits @ np.abs(rows @ a)

        a = pull + rows.T @ solved.f
        assert (np.abs(solved.f) <= limits * (1.0 + 1e-12)).all()
        for step in rng.normal(size=(30, 6)):
            assert cost(a + 1e-4 * step) >= cost(a) - 1e-13


def test_static_friction_holds_what_friction_of_slip_would_not():
    rows, pull = np.eye(1), np.array([1.5])
    assert decided(balance(rows, pull, [1.0], [2.0]), np.zeros(1), np.zeros(1)).direction == (0,)
    assert decided(balance(rows, pull, [1.0], [1.4]), np.zeros(1), np.zeros(1)).direction == (1,)
    assert decided(balance(rows, pull, [1.0], [2.0]), np.zeros(1), np.ones(1)).direction == (1,)  # it has broken loose


def test_joints_that_move_together_share_one_limit():
    """Slips v, -2 v and 0.5 v: together they hold 1 + 2 * 3 + 0.5 * 2 = 8."""
    rows = np.array([[1.0], [-2.0], [0.5]])
    limits = [1.0, 3.0, 2.0]
    given = balance(rows, np.zeros(1), limits)
    (group,) = groups_of(given.contacts, given.response, [0, 1, 2])
    assert group.ratios == pytest.approx([1.0, -2.0, 0.5])
    for pull, direction in ((7.9, (0, 0, 0)), (8.1, (1, -1, 1)), (-8.1, (-1, 1, -1))):
        given = balance(rows, np.array([pull]), limits)
        slip = decided(given, np.zeros(3), np.zeros(3))
        assert slip.direction == direction
        f = given.solve(np.array(direction, float), slip.stuck, np.zeros(3, dtype=bool)).f
        assert rows[:, 0] @ f == pytest.approx(-pull if not any(direction) else -8.0 * np.sign(pull))
        assert np.abs(f) / limits == pytest.approx(min(abs(pull) / 8.0, 1.0))


def test_more_frictions_than_motions_are_refused():
    rows = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    with pytest.raises(DynamicsError, match="3 frictions at rest hold fewer motions"):
        decided(balance(rows, np.ones(2), [1.0, 1.0, 1.0]), np.zeros(3), np.zeros(3))


def loaded(weight, coupling, pull, mu):
    """A mass on a line whose guide carries ``weight + coupling f`` under friction f."""
    contact = SimpleNamespace(name="joint.rod", law=FrictionLaw(mu, mu, 0.0, 0.0), bearing=Bearing.guide(np.eye(3)[0]))
    wrench, response = np.zeros((1, 6)), np.zeros((1, 1, 6))
    wrench[0, 1], response[0, 0, 1] = weight, coupling
    loads = CarriedLoads.linear(wrench, response)
    slips = SlipResponse(np.array([pull]), np.eye(1), loads, np.zeros(1, dtype=bool))
    return FrictionBalance([contact], slips, np.zeros(1))


@pytest.mark.parametrize("pull", [0.5, 2.0, -2.0, 5.0])
def test_with_loads_exactly_one_of_three_answers_holds(pull):
    given = loaded(10.0, 0.8, pull, 0.3)
    slip = decided(given, np.zeros(1), np.zeros(1))
    bound = {sign: 3.0 / (1.0 + sign * 0.3 * 0.8) for sign in (1, -1)}
    expected = next((sign for sign in (1, -1) if sign * pull > bound[sign]), 0)
    assert slip.direction == (expected,)


def test_painleves_paradox_is_refused():
    """Sliding one way friction of 1.2 f raises its load by more than itself: it may slip, or jam."""
    for pull, sign in product([-5.0, 5.0], [1.0, -1.0]):
        with pytest.raises(DynamicsError):
            decided(loaded(10.0, sign * 4.0, pull, 0.3), np.zeros(1), np.zeros(1))
