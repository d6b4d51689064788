"""Loads that are linear on both sides of kinks, against differences."""

from itertools import pairwise

import numpy as np
import pytest

from pinarm.engine.friction.carried_loads import CarriedLoads
from pinarm.mechanics.friction.bearing import Bearing


@pytest.fixture
def loads() -> CarriedLoads:
    rng = np.random.default_rng(8)
    shapes = (3, 6), (3, 4, 6), (2,), (2, 4), (3, 2, 6)
    return CarriedLoads(*(rng.normal(size=shape) for shape in shapes))


def test_slopes_are_differences(loads):
    f, small = np.array([0.3, -2.0, 0.7, 1.1]), 1e-6
    for j, step in enumerate(small * np.eye(4)):
        between = (loads.at(f + step) - loads.at(f - step)) / (2.0 * small)
        assert loads.slope(f)[:, j] == pytest.approx(between, abs=1e-8)


def test_one_piece_has_the_wrenches_and_no_other_has_its_side(loads):
    for f in 3.0 * np.random.default_rng(9).normal(size=(20, 4)):
        there = [piece for side, piece in loads.pieces() if loads.on_side(side, f)]
        assert len(there) == 1
        assert there[0].at(f) == pytest.approx(loads.at(f), rel=1e-13, abs=1e-13)


def test_crossings_are_where_the_slope_along_a_line_changes(loads):
    f, way = np.array([1.0, 0.0, -1.0, 2.0]), np.array([0.5, -1.0, 0.3, 0.2])
    crossings = np.sort(loads.crossings(f, way))
    for x in crossings:
        before, at, after = (loads.at(f + (x + step) * way) for step in (-1e-3, 0.0, 1e-3))
        assert np.abs(before - 2.0 * at + after).max() > 1e-4
    ends = [crossings[0] - 10.0, *crossings, crossings[-1] + 10.0]
    for low, high in pairwise(ends):
        one, middle, two = (loads.at(f + x * way) for x in (low, 0.5 * (low + high), high))
        assert middle == pytest.approx(0.5 * (one + two), abs=1e-12)


def test_far_away_loads_grow_as_told(loads):
    way = np.array([0.5, -1.0, 0.3, 0.2])
    assert loads.at(1e9 * way) / 1e9 == pytest.approx(loads.far(way), abs=1e-8)


def test_no_change_is_more_than_the_most(loads):
    rng, bearing = np.random.default_rng(10), Bearing.journal(np.array([0.0, 0.0, 1.0]), 0.01, 0.02, 0.1)
    for f, step in zip(rng.normal(size=(50, 4)), rng.normal(size=(50, 4)), strict=True):
        change = bearing.load(loads.at(f + step)) - bearing.load(loads.at(f))
        most = [float(loads.most(i, bearing) @ np.abs(step)) for i in range(3)]
        assert (np.abs(change) <= most).all()


def test_reduced_loads_are_those_of_the_friction_that_is_put_in(loads):
    rng = np.random.default_rng(11)
    fixed, ways, x = rng.normal(size=4), rng.normal(size=(4, 2)), rng.normal(size=2)
    assert loads.reduced(fixed, ways).at(x) == pytest.approx(loads.at(fixed + ways @ x), abs=1e-12)


def test_loads_that_friction_does_not_change_are_constant(loads):
    assert not loads.constant
    none = CarriedLoads(loads.wrench, 0.0 * loads.response, loads.distance, 0.0 * loads.rate, loads.fold)
    assert none.constant
    assert CarriedLoads.linear(loads.wrench, 0.0 * loads.response).constant
