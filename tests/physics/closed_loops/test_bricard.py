"""Bricard's linkage: overconstrained, and yet with one motion."""

import numpy as np
import pytest

from .bricard_closed_form import Bricard

T = np.linspace(0.0, 10.0, 101)


@pytest.fixture(scope="module")
def motion():
    return Bricard().motion(T)


@pytest.mark.parametrize(("tolerance", "reached"), [
    (1e-9, 1e-6), pytest.param(1e-12, 1e-8, marks=pytest.mark.slow),
])  # fmt: skip
def test_joints_follow_the_closed_form_for_ten_seconds(solve, motion, tolerance, reached):
    found = solve("bricard", "forward", end=10.0, tolerance=tolerance, initial={"position": {"P0": 0.0}})
    a, b, da, db = motion
    for joint in range(5):
        assert found[f"P{joint}"].values == pytest.approx(b if joint % 2 else a, abs=reached)
        assert found[f"joint.P{joint}.velocity"].values == pytest.approx(db if joint % 2 else da, abs=20 * reached)


def test_rows_that_tear_within_coarse_steps_do_not_count_as_independent(solve):
    """They made the start, at rest, look singular."""
    found = solve("bricard", "forward", end=10.0, tolerance=1e-4, initial={"position": {"P0": 0.0}})
    assert np.ptp(found["energy.total"].values) < 2e-2 * np.ptp(found["energy.kinetic"].values)
