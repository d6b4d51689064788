"""The table of accepted steps, and the dense output that is kept of them."""

import numpy as np

from pinarm.engine.integration.solution import DenseOutput, InterpolatedSteps, StepTable


def add(steps, numbers):
    """Add the steps from k to k + 1 s of some numbers k."""
    for k in numbers:
        state, work = np.array([[k, -k]], float), np.array([[12 * k, k // 3, 0]])
        steps.extend(np.array([[k, 1, k + 1]]), state, np.full((1, 3, 2), k), k // 20, work)


def polynomial(index: np.ndarray, parts: int) -> DenseOutput:
    """Return ``t^2`` over equal parts of steps of length 1 that start at the times of their indices."""
    t, h = (index[:, None] + np.arange(parts) / parts).ravel(), 1.0 / parts
    terms = np.stack([(t + h) ** 2 - t**2, np.full(len(t), -(h**2))], axis=1)
    return DenseOutput((t**2)[:, None], terms[..., None], np.full(len(index), parts))


def test_a_step_comes_back_as_it_was_added_however_long_the_table_has_become():
    steps = StepTable()
    add(steps, range(57))
    assert len(steps) == len(list(steps)) == 57
    for k, found in enumerate(steps):
        assert (found.t, found.h, found.until, found.interval) == (k, 1.0, k + 1.0, k // 20)
        assert found.y.tolist() == [k, -k]
        assert np.array_equal(found.slopes, np.full((3, 2), float(k)))
    assert steps[-1].t == 56.0
    assert steps.work[30].tolist() == [360, 10, 0]


def test_steps_that_are_added_after_others_were_taken_away_stand_in_their_place():
    steps = StepTable()
    add(steps, range(20))
    steps.truncate(5)
    add(steps, [40, 41])
    assert steps.t.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 40.0, 41.0]
    steps.end_at(5, 40.5)
    assert steps.until[4:].tolist() == [5.0, 40.5, 42.0]
    some = steps.some(np.array([6, 0]))
    assert some.t.tolist() == [41.0, 0.0]
    assert some.y.tolist() == [[41.0, -41.0], [0.0, 0.0]]


def test_a_table_without_steps_has_columns_without_rows():
    steps = StepTable()
    assert not steps
    assert [len(x) for x in (steps.t, steps.h, steps.until, steps.y, steps.slopes, steps.interval)] == [0] * 6


def test_outputs_are_found_in_any_order_of_asking_and_forgotten_with_their_steps():
    known = InterpolatedSteps()
    for index, parts in (([30, 31], 1), ([2], 8), ([5, 40], 1), ([7, 8], 8)):
        asked = np.array([*index, index[0]])
        assert known.missing(asked, 50).tolist() == sorted(index)
        known.add(np.array(sorted(index)), polynomial(np.array(sorted(index), float), parts))
        assert not len(known.missing(asked, 50))
    assert known.indices == [2, 5, 7, 8, 30, 31, 40]
    where = np.array([40, 2, 8, 31, 2, 30, 7, 5])
    x = np.array([0.3, 0.9, 0.05, 0.5, 0.1, 1.0, 1.05, -0.05])  # events are located a little beyond the ends, too
    np.testing.assert_allclose(known.states(where, x)[:, 0], (where + x) ** 2, rtol=1e-14)
    known.truncate(30)
    assert known.indices == [2, 5, 7, 8]
    assert known.missing(np.array([30, 2, 31]), 50).tolist() == [30, 31]
