"""A parallelogram that all but stops where its bars are in line, and may go on crossed: this is said, not guessed."""

import numpy as np
import pytest
from catalogue import TWO_CRANKS, two_cranks
from motions import free
from scipy.integrate import solve_ivp

from pinarm.engine.checks.residuals import residual_figures
from pinarm.errors import IntegrationError

CUTS = pytest.mark.parametrize("cut", "ABC")
TOLERANCES = (1e-8, 1e-9, 1e-10, 1e-11)


def exact(t, start):
    inertia, moment = TWO_CRANKS
    return solve_ivp(lambda _, y: [y[1], moment / inertia * np.sin(y[0])], (0.0, t[-1]), [start, 0.0], "DOP853", t,
                     rtol=1e-12, atol=1e-12).y[0]  # fmt: skip


@CUTS
@pytest.mark.parametrize("miss", [1e-3, 1e-4, 1e-5, 1e-7])
def test_one_that_turns_back_in_line_is_followed_until_then(miss, cut, tmp_path):
    mechanism = two_cranks(np.pi / 2 - miss).build(tmp_path, [cut])
    with pytest.raises(
        IntegrationError, match=r"not determined: it all but stops at .* of its usual regularity"
    ) as told:
        free(mechanism, 1.0, 101, tolerance=1e-9)
    kept = told.value.partial.rows
    assert kept is None if miss < 3e-7 and told.value.data["t"] == 0 else 0.45 < kept.grid.t[-1] < 0.48
    if kept is not None:
        turned = kept.q[:, mechanism.joints["O"].q] + np.pi / 2 - miss
        assert turned == pytest.approx(exact(kept.grid.t, np.pi / 2 - miss), abs=1e-7)


@CUTS
@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_one_that_turns_back_far_enough_is_followed(tolerance, cut, tmp_path):
    """At most 0.14 of its largest speed where it is in line."""
    run = free(two_cranks(np.pi / 2 - 0.02).build(tmp_path, [cut]), 1.0, 101, tolerance=tolerance)
    turned = run.q[:, run.mechanism.joints["O"].q] + np.pi / 2 - 0.02
    assert turned == pytest.approx(exact(run.grid.t, np.pi / 2 - 0.02), abs=1e3 * tolerance)


def test_at_rest_in_line_there_is_no_motion_to_follow(tmp_path):
    with pytest.raises(IntegrationError, match="from t = 0 s on the motion is not determined"):
        free(two_cranks(np.pi / 2).build(tmp_path, ["B"]), 1.0)


def test_without_weight_it_stays_at_rest_in_line(tmp_path):
    still = free(two_cranks(np.pi / 2).build(tmp_path, ["B"], gravity="none"), 1.0)
    assert still.q == pytest.approx(0.0, abs=1e-15)


@CUTS
def test_the_stamp_tells_that_a_motion_passes_a_singular_position(cut, tmp_path):
    """At the first row a whole row of the loop vanishes: what is left of the others is regular."""
    mechanism = two_cranks(np.pi / 2).build(tmp_path, [cut])
    speeds = {"O": 5.0, "A": -5.0, "B": 5.0, "C": 5.0}
    run = free(mechanism, 0.1, velocity={name: speeds[name] for name in mechanism.joints})
    figures = residual_figures(run)
    assert figures["regularity"] < 1e-12
    assert figures["least regular at"] == 0.0
