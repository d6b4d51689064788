"""Friction that depends on reactions that depend on it: roots by hand, none or two, and joints that lock."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

from pinarm.engine.friction.slip_equation import CarriedLoads, Slipping
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.contact import Bearing
from pinarm.records import replace


def slipping(coupling, first=10.0, mu=0.3, sign=1.0, constant=0.0):
    """One slide along x whose guide carries ``first + coupling f`` across it."""
    contact = SimpleNamespace(name="joint.slide", bearing=Bearing.guide(np.array([1.0, 0.0, 0.0])))
    wrench, response = np.zeros((1, 6)), np.zeros((1, 1, 6))
    wrench[0, 1], response[0, 0, 1] = first, coupling
    return Slipping(
        [contact], np.array([sign]), np.array([mu]), np.array([constant]), CarriedLoads.linear(wrench, response)
    )


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
        loads = CarriedLoads.linear(10.0 * rng.normal(size=(5, 6)), 0.05 * rng.normal(size=(5, 5, 6)))
        direction, mu = rng.choice([-1.0, 0.0, 1.0], size=5), rng.uniform(0.0, 0.3, size=5)
        equation = Slipping(contacts, direction, mu, np.full(5, 0.1) * np.abs(direction), loads)
        assert equation.contraction() < 1.0
        f = equation.friction()
        assert f == pytest.approx(-direction * equation.resistance(f), rel=1e-13, abs=1e-13)


def slide_on_teeth(first, coupling, press, distance, rate, *, mu=0.3, sign=1.0):
    """One slide whose guide carries ``first + coupling f + press |distance + rate f|``."""
    plain = slipping(coupling, first, mu, sign)
    fold = np.zeros((1, 1, 6))
    fold[0, 0, 1] = press
    loads = replace(plain.loads, distance=np.array([distance]), rate=np.array([[rate]]), fold=fold)
    return replace(plain, loads=loads)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("distance", [-2.0, -0.5, 0.0, 0.5, 2.0])
def test_the_root_is_on_the_side_of_a_kink_that_the_friction_leads_to(distance, sign):
    """``f = -s mu |10 + f / 2 + |d + f||``, whose root a bisection brackets: the right side grows less than f."""
    equation = slide_on_teeth(10.0, 0.5, 1.0, distance, 1.0, sign=sign)
    root = brentq(lambda f: f + sign * 0.3 * abs(10.0 + 0.5 * f + abs(distance + f)), -100.0, 100.0, xtol=1e-14)
    assert equation.contraction() == pytest.approx(0.45)
    assert equation.require_one_root()
    assert equation.friction() == pytest.approx(root, rel=1e-13)
    assert equation.roots == [pytest.approx(root, rel=1e-12)]


@pytest.mark.parametrize("distance", [-12.0, -4.0, 1.0])
def test_roots_beyond_contraction_are_those_of_all_sides(distance):
    """``f = -0.6 |10 - 2 |d + f||``, as a walk in small steps finds them."""
    equation = slide_on_teeth(10.0, 0.0, -2.0, distance, 1.0, mu=0.6)
    steps = np.linspace(-100.0, 100.0, 2_000_002)
    left = steps + 0.6 * np.abs(10.0 - 2.0 * np.abs(distance + steps))
    passed = steps[:-1][left[:-1] * left[1:] < 0.0]
    assert not equation.contracts
    assert sorted(float(f[0]) for f in equation.roots) == pytest.approx(passed, abs=2e-4)


def test_a_load_that_grows_beyond_a_kink_only_jams_there():
    """``0.3 |6 + 4 |x - 1||`` falls to 1.8 at x = 1 and grows faster than x beyond: it is nowhere x."""
    assert not slide_on_teeth(6.0, 0.0, 4.0, 1.0, 1.0).require_one_root()
    with pytest.raises(DynamicsError, match="do not determine each other"):
        slide_on_teeth(-6.0, 0.0, 4.0, 1.0, 1.0).require_one_root()  # x = 0.3 |4 |x - 1| - 6| has two


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
def test_one_joint_locks_where_its_friction_grows_with_what_it_holds(first, response, held):
    assert flanks(first, response, [0.3]).locks(np.ones(1), 1.0) == held


def test_a_load_that_friction_without_a_load_of_its_own_takes_over():
    """``x <= 0.3 |2 - 3 - 4 x|``: with 3 N the second joint turns the load of 2 N round."""
    response = [[4.0, 1.0], [0.0, 0.0]]
    assert not flanks([2.0, 0.0], response, [0.3, 0.0], [0.0, 1.0]).locks(np.ones(2), 1.0)
    assert flanks([2.0, 0.0], response, [0.3, 0.0], [0.0, 3.0]).locks(np.ones(2), 1.0)


def test_two_joints_lock_together_that_would_give_way_alone():
    """Each raises its own load 0.6 times, and that of the other one as often."""
    assert flanks([0.0, 0.0], [[2.0, 2.0], [2.0, 2.0]], [0.3, 0.3]).locks(np.ones(2), 1.0)
    assert not flanks([0.0, 0.0], [[2.0, -2.0], [2.0, 2.0]], [0.3, 0.3]).locks(np.ones(2), 1.0)
