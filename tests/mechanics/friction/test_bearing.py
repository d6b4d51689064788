"""Loads of bearings by hand, and the law of friction."""

import numpy as np
import pytest

from pinarm.mechanics.friction.contact import Bearing, FrictionLaw

Z = np.array([0.0, 0.0, 1.0])


def test_a_journal_carries_what_is_across_its_axis_and_a_shoulder_what_is_along_it():
    wrench = np.array([3.0, 4.0, -7.0, 1.0, 2.0, 9.0])
    assert Bearing.journal(Z, 0.02).load(wrench) == pytest.approx(0.02 * 5.0, rel=1e-15)
    assert Bearing.journal(Z, 0.02, 0.05, preload=10.0).load(wrench) == pytest.approx(0.1 + 0.35 + 0.2, rel=1e-15)


def test_two_bearings_balance_force_and_moment():
    """Bearings at z = +-0.2 m: 30 N along x and 20 N*m about y ask for 15 +- 50 N."""
    wrench = np.array([30.0, 0.0, 0.0, 0.0, 20.0, 0.0])
    upper, lower = 15.0 + 50.0, 15.0 - 50.0
    assert upper + lower == 30.0
    assert 0.2 * upper - 0.2 * lower == 20.0  # moment about y of forces along x
    bearing = Bearing.journal(Z, 1.0, span=0.4)
    assert bearing.load(wrench) == pytest.approx(abs(upper) + abs(lower), rel=1e-15)
    assert np.abs(bearing.parts @ wrench)[:, 0] == pytest.approx([abs(upper), abs(lower)])


def test_a_key_carries_the_moment_about_the_axis_of_a_slide():
    wrench = np.array([0.0, 5.0, 100.0, 0.0, 0.0, 6.0])
    assert Bearing.guide(Z).load(wrench) == 5.0
    assert Bearing.guide(Z, radius=0.03, preload=2.0).load(wrench) == pytest.approx(5.0 + 200.0 + 2.0, rel=1e-15)


@pytest.mark.parametrize("bearing", [
    Bearing.journal(np.array([0.6, 0.0, 0.8]), 0.02, 0.05, 0.3, 4.0), Bearing.guide(Z, 0.03, 0.1),
])  # fmt: skip
def test_the_slope_is_that_of_the_load_and_no_change_exceeds_the_most(bearing):
    rng = np.random.default_rng(3)
    wrench, step = rng.normal(size=(2, 8, 6))
    slope = (bearing.load(wrench + 1e-6 * step) - bearing.load(wrench - 1e-6 * step)) / 2e-6
    assert (bearing.slope(wrench) * step).sum(axis=1) == pytest.approx(slope, abs=1e-7)
    assert (np.abs(bearing.load(wrench + step) - bearing.load(wrench)) <= bearing.most(step) * (1.0 + 1e-14)).all()
    assert not bearing.slope(np.zeros(6)).any()


def test_stribecks_transition_begins_at_rest_and_ends_in_slip():
    law = FrictionLaw(0.1, 0.3, 2.0, 5.0, viscous=7.0, stribeck=0.01)
    mu, constant = law.slipping(np.array([0.0, 0.01, 1.0]))
    share = np.array([1.0, np.exp(-1.0), 0.0])
    assert mu == pytest.approx(0.1 + 0.2 * share, rel=1e-15)
    assert constant == pytest.approx(2.0 + 3.0 * share + np.array([0.0, 0.07, 7.0]), rel=1e-15)
    assert law.resting == (0.3, 5.0)
    assert [float(x) for x in FrictionLaw(0.1, 0.3, 2.0, 5.0).slipping(0.0)] == [0.1, 2.0]
