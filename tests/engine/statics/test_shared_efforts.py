"""Shared efforts against the conditions of Karush, Kuhn and Tucker, and against linear programming."""

import re

import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

from pinarm.engine.statics.actuation import SharedEfforts
from pinarm.errors import DrivesError

SIZES = [(1, 2), (2, 3), (4, 9), (6, 8)]
SEEDS = range(30)


def problem(f, d, seed):
    """A, b of one row, w and limits, of sizes three orders apart: either way, one-sided, and infinite ones.

    Of odd seeds some drives only pull, as cables do, with a least tension or none.
    """
    rng = np.random.default_rng([f, d, seed])
    weights, largest = 10.0 ** rng.uniform(-1.5, 1.5, (2, d))
    largest[rng.random(d) < 0.2] = np.inf
    limits = np.array([-largest, largest])
    if seed % 2:
        pulls = rng.random(d) < 0.4
        limits[1, pulls] = rng.choice([0.0, -0.01, -0.1], size=int(pulls.sum()))
        limits[0] = np.minimum(limits[0], limits[1] - 0.1)
    return rng.normal(size=(f, d)), rng.normal(size=f) * 10.0 ** rng.uniform(-1, 2.5), weights, limits


def solved(ways, load, weights, limits):
    effort, good = SharedEfforts(weights, limits).efforts(ways[None], load[None], np.array([1e-9]), np.zeros(1))
    return effort[0], bool(good[0])


def feasible(ways, load, limits):
    return linprog(np.zeros(ways.shape[1]), A_eq=ways, b_eq=load, bounds=limits.T).status == 0


def require_optimal(ways, load, weights, limits, x):
    """``W^2 x = A^T nu - lam_upper + lam_lower`` with multipliers >= 0 of active limits; sufficient, as it is convex.

    1e-9 of the terms is a thousand times what rounding leaves of systems of this size and of these weights.
    """
    assert ways @ x == pytest.approx(load, abs=1e-9 * np.abs(ways * x).max())
    assert (x >= limits[0]).all()
    assert (x <= limits[1]).all()
    active = np.diag(1.0 * (x == limits[1]) - (x == limits[0]))
    columns = np.hstack([ways.T, -active])
    lower = np.append(np.full(len(load), -np.inf), np.zeros(len(x)))
    gradient = weights**2 * x
    size = np.linalg.norm(gradient)
    found = lsq_linear(columns, gradient / size, (lower, np.inf), tol=1e-14)
    assert np.linalg.norm(columns @ found.x - gradient / size) < 1e-9


@pytest.mark.parametrize(("f", "d"), SIZES)
def test_efforts_within_limits_are_the_least_there_are(f, d):
    at_limits = refused = 0
    for seed in SEEDS:
        given = ways, load, _, limits = problem(f, d, seed)
        x, good = solved(*given)
        assert good == feasible(ways, load, limits)
        if good:
            require_optimal(*given, x)
            at_limits += bool((x == limits).any())
        refused += not good
    assert at_limits >= 3
    assert refused >= 3


@pytest.mark.parametrize(("f", "d"), SIZES)
def test_what_is_refused_is_beyond_the_limits(f, d):
    problems = [problem(f, d, seed) for seed in SEEDS]
    beyond = [given for given in problems if not solved(*given)[1]]
    assert len(beyond) >= 3
    for ways, load, _, limits in beyond:
        assert not feasible(ways, load, limits)


@pytest.mark.parametrize(("kilogram", "metre"), [(1.0, 1.0), (1e6, 1e-3), (1e-6, 1e3)])
def test_weights_across_all_joints_leave_nothing_for_a_drive_that_is_missing(mechanism, chain, kilogram, metre):
    """Two level rods whose axes stand upright, but for a tilt e: the second carries ``m g e l cos(q1 + q2)``.

    Turned there by ``rpy``, the axes and the weights are at right angles but for 1e-16.
    """
    rod = {"axis": "0 0 1", "mass": 2.0 * kilogram, "com": f"{0.5 * metre!r} 0 0"}
    arm = chain({"name": "a", **rod}, {"name": "b", "at": f"{metre!r} 0 0", **rod})
    turned = arm.replace('<origin xyz="0 0 0"/>\n    <axis', '<origin rpy="1.5707963267948966 0 0"/>\n    <axis', 1)

    def drive(tilt):
        return mechanism(turned, gravity={"direction": [0.0, 1.0, tilt], "magnitude": "9.81 m/s^2"}).inverse(
            np.array([0.3, 0.4]), np.zeros(2), np.zeros(2), drives=["a"]
        )

    unit = 2.0 * kilogram * 9.81 * metre
    assert np.abs(drive(0.0)).max() < 1e-14 * unit
    with pytest.raises(DrivesError) as caught:
        drive(1e-9)
    left = float(re.search(r"leave a load of (\S+) N", caught.value.message)[1])
    assert left == pytest.approx(1e-9 * unit * 0.5 * np.cos(0.7), rel=5e-3)  # it is printed with 3 digits
