"""Polynomials over steps and over parts of them."""

import numpy as np
import pytest

from pinarm.engine.integration.dense_output import DenseOutput


def parabola(start, h, count):
    """Return ``t^2`` over equal parts of a step: ``base + x (r_0 + (1 - x) r_1)`` with ``r_1 = -h^2``."""
    t, h = start + h / count * np.arange(count), h / count
    terms = np.stack([(t + h) ** 2 - t**2, np.full(count, -(h**2))], axis=1)
    return DenseOutput((t**2)[:, None], terms[..., None], np.array([count]))


def test_parts_of_a_step_are_what_the_whole_is():
    output = DenseOutput.joined([parabola(0.0, 1.0, 1), parabola(1.0, 3.0, 8), parabola(4.0, 2.0, 3)])
    t = np.linspace(-0.1, 6.1, 63)  # events are located a little beyond the ends, too
    start, h = np.array([0.0, 1.0, 4.0]), np.array([1.0, 3.0, 2.0])
    step = np.clip(np.searchsorted(start, t, side="right") - 1, 0, 2)
    x = (t - start[step]) / h[step]
    assert output.states(step, x)[:, 0] == pytest.approx(t**2, abs=1e-13)
    each = output.split()
    assert [len(one.base) for one in each] == [1, 8, 3]
    assert np.array_equal(DenseOutput.joined(each).states(step, x), output.states(step, x))
