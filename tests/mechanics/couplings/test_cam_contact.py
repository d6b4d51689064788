"""Contacts of cams against textbook formulas, and against the envelope of the follower's positions."""

import numpy as np
import pytest

from pinarm.mechanics.couplings.cam import Follower
from pinarm.records import replace

ALPHA = np.linspace(0.0, 2.0 * np.pi, 37)
LIFT = 0.02


def harmonic(alpha):
    """A lift ``LIFT (1 - cos alpha) / 2`` and its derivatives."""
    return LIFT * (1.0 - np.cos(alpha)) / 2.0, LIFT * np.sin(alpha) / 2.0, LIFT * np.cos(alpha) / 2.0


S, DS, DDS = harmonic(ALPHA)
E, RP = 0.007, 0.04
"""Offset of the follower, and radius of the prime circle, through the roller's centre at no lift."""

SLIDING = Follower(complex(E, np.sqrt(RP**2 - E**2)), 1j)
TURNING = Follower(0.03 + 0.035j, -1j * (0.03 + 0.035j - (0.1 + 0.02j)), -1.0)


def swing(alpha):
    """A swing of 0.3 rad and its derivatives."""
    return 0.15 * (1.0 - np.cos(alpha)), 0.15 * np.sin(alpha), 0.15 * np.cos(alpha)


def test_pressure_angle_and_curvature_of_an_offset_roller():
    """``tan(phi) = (s' - e) / (s + sqrt(rp^2 - e^2))`` (Norton, Cam Design and Manufacturing Handbook, eq. 7.1d).

    In polar coordinates of a follower without offset the pitch curve ``r(alpha)`` has the radius of curvature
    ``(r^2 + r'^2)^(3/2) / (r^2 + 2 r'^2 - r r'')``.
    """
    touch = SLIDING.touch(S, DS, DDS)
    assert np.tan(touch.pressure_angle) == pytest.approx((DS - E) / (S + np.sqrt(RP**2 - E**2)), abs=1e-14)
    radial = Follower(1j * RP, 1j, radius=0.01).touch(S, DS, DDS)
    r = RP + S
    polar = (r**2 + DS**2) ** 1.5 / (r**2 + 2.0 * DS**2 - r * DDS)
    assert radial.radius == pytest.approx(polar - 0.01, rel=1e-13)


def test_curvature_and_eccentricity_of_a_flat_face():
    """``rho = rb + s + s''`` and the eccentricity s' (Norton, eqs. 7.14 and 7.16)."""
    touch = Follower(1j * RP, 1j, face=1j).touch(S, DS, DDS)
    assert touch.radius == pytest.approx(RP + S + DDS, rel=1e-13)
    assert touch.eccentricity == pytest.approx(DS, abs=1e-16)
    assert touch.point == pytest.approx(DS + 1j * (RP + S), abs=1e-16)
    assert touch.pressure_angle == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("point", [SLIDING, TURNING], ids=["sliding", "turning"])
@pytest.mark.parametrize(
    "surface", [{"radius": 0.008}, {"face": (0.2 + 0.98j) / abs(0.2 + 0.98j)}], ids=["roller", "face"]
)
def test_the_contact_is_on_the_envelope_of_the_followers_positions(point, surface):
    """Contact points on the cam make a curve: its tangent is across the normal, its curvature by differences.

    Differences of fourth order in steps of 1e-3 rad err by 1e-12 of the size times the sixth derivative.
    """
    follower = replace(point, **surface)
    step = 1e-3
    places = ALPHA[:, None] + step * np.arange(-2, 3)

    def touch(alpha):
        return follower.touch(*(swing if point is TURNING else harmonic)(alpha))

    on_cam = np.array([touch(column).point * np.exp(-1j * column) for column in places.T])
    normals = np.array([touch(column).normal * np.exp(-1j * column) for column in places.T])
    first = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * step)
    tangent, turned = first @ on_cam, first @ normals
    found = touch(ALPHA)
    across = (np.conj(normals[2]) * tangent).real
    assert np.abs(across).max() < 1e-10 * np.abs(tangent).max()
    along = 1j * normals[2]
    psi = (np.conj(normals[2]) * turned).imag
    assert (np.conj(along) * tangent).real == pytest.approx(found.radius * psi, rel=1e-8, abs=1e-9)
