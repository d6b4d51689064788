"""Friction that depends on reactions that depend on it: roots by hand, and where there are none or two."""

from types import SimpleNamespace

import numpy as np
import pytest

from pinarm.engine.friction.slipping import CarriedLoads, Slipping
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.bearing import Bearing


def slipping(coupling, first=10.0, mu=0.3, sign=1.0, constant=0.0):
    """One slide along x whose guide carries ``first + coupling f`` across it."""
    contact = SimpleNamespace(name="joint.slide", bearing=Bearing.guide(np.array([1.0, 0.0, 0.0])))
    wrench, response = np.zeros((1, 6)), np.zeros((1, 1, 6))
    wrench[0, 1], response[0, 0, 1] = first, coupling
    return Slipping([contact], np.array([sign]), np.array([mu]), np.array([constant]), CarriedLoads(wrench, response))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("coupling", [0.0, 2.5, -2.5])
def test_one_root_by_hand(coupling, sign):
    """``f = -s mu (10 + c f)``."""
    equation = slipping(coupling, sign=sign, constant=1.0)
    assert equation.contraction() == pytest.approx(0.3 * abs(coupling))
    assert equation.require_one_root()
    assert equation.friction() == pytest.approx(-sign * (3.0 + 1.0) / (1.0 + sign * 0.3 * coupling), rel=1e-15)


def test_friction_that_raises_its_load_without_end_has_no_root():
    assert not slipping(-4.0).require_one_root()  # x = 0.3 (10 + 4 x) has none for x > 0


def test_two_roots_are_refused():
    """``x = 0.3 |10 - 4 x|``: x = 3 / 2.2 and x = 15."""
    with pytest.raises(DynamicsError, match=r"do not determine each other: friction raises its own load 1\.2 times"):
        slipping(4.0).require_one_root()


def test_many_joints_solve_their_equation():
    rng = np.random.default_rng(5)
    contacts = [SimpleNamespace(name=f"joint.{i}", bearing=Bearing.guide(np.eye(3)[i % 3], 0.5, 0.2)) for i in range(5)]
    for _ in range(50):
        loads = CarriedLoads(10.0 * rng.normal(size=(5, 6)), 0.05 * rng.normal(size=(5, 5, 6)))
        direction, mu = rng.choice([-1.0, 0.0, 1.0], size=5), rng.uniform(0.0, 0.3, size=5)
        equation = Slipping(contacts, direction, mu, np.full(5, 0.1) * np.abs(direction), loads)
        assert equation.contraction() < 1.0
        f = equation.friction()
        assert f == pytest.approx(-direction * equation.resistance(f), rel=1e-13, abs=1e-13)
