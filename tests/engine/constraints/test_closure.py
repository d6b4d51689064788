"""The rows of constraints at many configurations, kept or not, against those of each configuration by itself."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.constraints.closure import KEPT, SEVERAL
from pinarm.engine.mechanism import Mechanism

MODELS = Path(pinarm.__file__).parents[1] / "models"


@pytest.fixture
def closure():
    return Mechanism.load(MODELS / "andrews" / "mechanism.yaml").closure


@pytest.mark.parametrize("n", [SEVERAL - 1, SEVERAL, KEPT, KEPT + 1])
def test_rows_and_their_derivatives_are_those_of_each_state(closure, n):
    q, v, w = np.random.default_rng(n).uniform(-1.0, 1.0, (3, n, closure.model.nv))
    for rates in (v, w):  # of the same configurations
        gaps, rows = closure.at(q)
        drifts, splits = closure.drifts(q, rates), closure.splits(q, rows)
        assert splits.shape == rows.shape
        for k in range(n):
            state = closure.state(q[k], rates[k])
            assert gaps[k] == pytest.approx(closure.gap(state), abs=1e-14)
            assert rows[k] == pytest.approx(closure.rows(state), abs=1e-14)
            assert drifts[k] == pytest.approx(closure.drift(state), abs=1e-13)
    ((_, split),) = splits.parts  # random configurations are regular
    assert rows @ split.free == pytest.approx(np.zeros((n, rows.shape[1], split.free.shape[2])), abs=1e-14)


def test_what_is_kept_is_of_the_configurations_that_are_asked_for(closure):
    q, other = np.random.default_rng(1).uniform(-1.0, 1.0, (2, SEVERAL, closure.model.nv))
    first = closure.at(q)[1].copy()
    assert not np.array_equal(closure.at(other)[1], first)
    assert closure.at(q)[1] is closure.at(q.copy())[1] and np.array_equal(closure.at(q)[1], first)
