"""Optima on borders beyond which runs are refused, against closed forms."""

import math

import numpy as np
import pytest

from pinarm.use.result.condition import Condition
from pinarm.use.scenario.border import ALONG_BORDER, Border
from pinarm.use.scenario.landscape import Landscape, Trial
from pinarm.use.scenario.optimum import optimum

ABOVE = Condition.read("a @ end", "> 0 mm")


def landscape(target, inside, margin=None) -> Landscape:
    """One and the square of the distance from a point, between -2 and 2; runs that are not inside are refused."""

    def trial(x) -> Trial:
        if not inside(x):
            return Trial(refusal="loop does not close")
        return Trial(1.0 + float((x - target) @ (x - target)), (margin(x),) if margin else ())

    k = len(target)
    more = {"conditions": [ABOVE], "sizes": [1.0]} if margin else {}
    return Landscape(*np.full((2, k), [[-2.0], [2.0]]), np.full(k, -1.0), lambda points: [*map(trial, points)], **more)


@pytest.mark.parametrize("normal", [(1.0, 2.0), (-1.0, 3.0), (2.0, 1.0, -1.0), (1.0, 1.0, 0.1)])
def test_an_optimum_on_an_oblique_border_is_the_nearest_point_of_it(normal):
    """Of the plane n x = d the point that is nearest to t is t - (n t - d) n/n^2."""
    n, target = np.array(normal), np.ones(len(normal))
    d = n @ target - 0.5 * np.linalg.norm(n)
    found = optimum(landscape(target, lambda x: n @ x <= d), 8, 0)
    assert found.best.end == pytest.approx(target - 0.5 * n / np.linalg.norm(n), abs=1e-3)
    assert found.best.trial.objective == pytest.approx(1.25, rel=1e-6)
    assert found.best.status == ALONG_BORDER


def test_a_border_may_be_round_and_a_condition_may_hold_the_optimum_on_it():
    """The unit circle from (2, 1): (2, 1)/sqrt(5); and with y > 0.6 (0.8, 0.6)."""
    target, inside = np.array([1.9, 0.95]), lambda x: x @ x <= 1.0
    end = optimum(landscape(target, inside), 8, 0).best.end
    assert end == pytest.approx(np.array([2.0, 1.0]) / math.sqrt(5.0), abs=1e-3)
    held = optimum(landscape(target, inside, lambda x: x[1] - 0.6), 8, 0)
    assert held.best.end == pytest.approx([0.8, 0.6], abs=1e-4)
    assert held.active == [0]


def test_there_is_no_border_where_the_objective_rises_before_it():
    place = landscape(np.zeros(2), lambda x: x[0] <= 0.1)
    assert Border.beside(place, np.array([0.5, 0.5])) is None
    assert Border.beside(place, np.array([0.5, 0.45])) is None
