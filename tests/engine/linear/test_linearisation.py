"""Linearised motions against closed forms: chains, a spinning rotor and a top, a four-bar with springs, Pinocchio."""

import itertools
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq
from urdf_links import link, robot

import pinarm
from pinarm.errors import DynamicsError, InputError
from pinarm.use.mechanism import Mechanism

GRAVITY = 9.81
ROOT = Path(pinarm.__file__).parents[1]


def hanging(n, length=0.7):
    """A chain of n point masses on massless rods."""
    links = [
        link(f"j{k}", f"j{k - 1}_link" if k else "base", "0 1 0", at=f"0 0 {-length if k else 0}", mass=1.3,
             com=f"0 0 {-length}")
        for k in range(n)
    ]  # fmt: skip
    return robot(*links)


@pytest.mark.parametrize("n", [2, 9])
def test_a_chain_of_point_masses_has_the_zeros_of_laguerres_polynomial(n, mechanism):
    """``omega^2 = (g/l) x``, L_n(x) = 0."""
    found = mechanism(hanging(n)).linearise(np.zeros(n)).modes
    zeros = np.polynomial.laguerre.lagroots([0.0] * n + [1.0])
    assert found.frequencies == pytest.approx(np.sqrt(GRAVITY / 0.7 * zeros) / (2.0 * math.pi), rel=1e-10)
    assert found.damping_ratios == pytest.approx(0.0, abs=1e-12)
    assert found.errors.max() < 1e-11  # masses of nine rods in a row


def test_springs_and_dampers_in_a_row(mechanism):
    """Two carriages with springs and dampers: lambda of ``M x'' + D x' + K x = 0`` by its own state matrix."""
    xml = robot(
        link("a", "base", "1 0 0", mass=2.0, kind="prismatic"), link("b", "a_link", "1 0 0", mass=3.0, kind="prismatic")
    )
    found = mechanism(xml, gravity="none", forces={
        "one": {"kind": "joint_spring", "joint": "a", "stiffness": "70 N/m", "damping": "1.5 N*s/m"},
        "two": {"kind": "joint_spring", "joint": "b", "stiffness": "40 N/m", "damping": "0.4 N*s/m"},
    }).linearise(np.zeros(2))  # fmt: skip
    m, k, d = np.diag([2.0, 3.0]), np.array([[110.0, -40.0], [-40.0, 40.0]]), np.array([[1.9, -0.4], [-0.4, 0.4]])
    inverse = np.linalg.inv(m)
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ k, -inverse @ d]])
    expected = [x for x in np.linalg.eigvals(state) if x.imag > 0.0]
    assert found.modes.eigenvalues == pytest.approx(sorted(expected, key=abs), rel=1e-12)
    assert found.states == ["a", "b", "a'", "b'"]
    moved = found.response(np.array([0.0]), np.eye(2, 4))[0]
    assert moved[:, 0].real == pytest.approx([1.0 / 70.0, 0.0], abs=1e-15)  # 1 N on the first carriage


def test_two_gears_and_an_elastic_belt_between_them(mechanism):
    """``M x'' + D x' + K x = 0``: inertias by the squares of the ratios, ``k e e^T`` of the belt's stretch ``e x``."""
    inertias, first, last, radii = [0.002, 0.03, 0.05, 0.4], -0.25, 0.2, np.array([0.04, -0.11])
    xml = robot(*(link(f"s{k}", "base", "0 0 1", at=f"{0.3 * k} 0 0", mass=1.0, inertia=(0.3, 0.3, inertia))
                  for k, inertia in enumerate(inertias, 1)))  # fmt: skip
    made = mechanism(
        xml,
        gravity="none",
        couplings={
            "first": {"kind": "gear", "joints": ["s1", "s2"], "ratio": first, "pressure_angle": "20 deg"},
            "last": {"kind": "gear", "joints": ["s3", "s4"], "ratio": last},
        },
        coordinates={"stretch": {"kind": "sum", "of": dict(zip(["s2", "s3"], radii.tolist(), strict=True))}},
        forces={
            "belt": {"kind": "coordinate_spring", "coordinate": "stretch", "stiffness": "2e5 N*m/rad",
                     "damping": "30 N*m*s/rad"},
            "load": {"kind": "joint_spring", "joint": "s4", "stiffness": "150 N*m/rad"},
        },
    )  # fmt: skip
    mass = np.diag([inertias[0] / first**2 + inertias[1], inertias[2] + inertias[3] * last**2])
    belt = np.outer(radii, radii)
    terms = (2e5 * belt + np.diag([0.0, 150.0 * last**2]), 30.0 * belt)
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(mass, term) for term in terms]])
    expected = sorted((x for x in np.linalg.eigvals(state) if x.imag > 0.0), key=abs)
    found = made.linearise(np.zeros(4)).modes
    assert np.abs(found.eigenvalues - expected).max() < 1e-11 * abs(expected[1])  # rounding of the largest entries


@pytest.mark.parametrize("part", [1e-12, 1e-14, 1e-16, 1e-18])
@pytest.mark.parametrize("parent", ["base", "a_link"])
def test_a_mode_slower_by_nine_digits_is_no_rigid_one(part, parent, mechanism):
    """Carriages on a soft and a stiff spring, beside each other and in a row: ``det(K - w^2 M) = 0``."""
    xml = robot(
        link("a", "base", "1 0 0", mass=2.0, kind="prismatic"), link("b", parent, "1 0 0", mass=3.0, kind="prismatic")
    )
    spring = {"kind": "joint_spring"}
    found = mechanism(xml, gravity="none", forces={
        "soft": {**spring, "joint": "a", "stiffness": f"{1e6 * part!r} N/m"},
        "stiff": {**spring, "joint": "b", "stiffness": "1e6 N/m"},
    }).linearise(np.zeros(2)).modes  # fmt: skip
    half = 0.5e6 * (3.0 * part + 2.0 + (3.0 if parent == "a_link" else 0.0))
    slow = math.sqrt(1e12 * part / (half + math.sqrt(half**2 - 6e12 * part)))
    assert abs(found.eigenvalues[0].imag - slow) <= found.errors[0] < 1e-3 * slow
    assert abs(found.eigenvalues[0].imag - slow) < 1e-9 * slow


@pytest.mark.parametrize("excess", [0.0, 1e-15, 1e-12, -1e-12])
def test_stiffnesses_that_cancel_have_the_error_of_what_is_left(excess, mechanism):
    """A pendulum on its head held by a spring: ``lambda^2 = -(g/l) excess``, of which rounding leaves few digits."""
    stiffness = 1.3 * GRAVITY * 0.7 * (1.0 + excess)
    found = mechanism(robot(link("a", "base", "0 1 0", mass=1.3, com="0 0 0.7")), forces={
        "spring": {"kind": "joint_spring", "joint": "a", "stiffness": f"{stiffness!r} N*m/rad"},
    }).linearise(np.zeros(1)).modes  # fmt: skip
    size = math.sqrt(GRAVITY / 0.7 * abs(excess))
    assert np.abs(np.abs(found.eigenvalues) - size) == pytest.approx(0.0, abs=found.errors.max())
    assert found.errors.max() < 1e-6 if abs(excess) < 1e-12 else found.errors.max() < 1e-3 * size


@pytest.mark.parametrize("spin", [30.0, 400.0])
def test_a_spinning_disk_on_a_gimbal_with_springs(spin, mechanism):
    """``omega = sqrt((I_p W / (2 I_t))^2 + k / I_t) +- I_p W / (2 I_t)``."""
    stiffness, polar, transverse = 60.0, 0.02, 0.013
    xml = robot(
        link("x", "base", "1 0 0"), link("y", "x_link", "0 1 0"),
        link("z", "y_link", "0 0 1", mass=1.0, inertia=(transverse, transverse, polar)),
    )  # fmt: skip
    spring = {"kind": "joint_spring", "stiffness": f"{stiffness} N*m/rad"}
    made = mechanism(xml, gravity="none", forces={"x": {**spring, "joint": "x"}, "y": {**spring, "joint": "y"}})
    found = made.linearise(np.zeros(3), np.array([0.0, 0.0, spin]))
    assert found.acceleration == pytest.approx(0.0, abs=1e-12)
    half = polar * spin / (2.0 * transverse)
    root = math.sqrt(half**2 + stiffness / transverse)
    whirling = found.modes.frequencies[found.modes.frequencies > 1e-6] * 2.0 * math.pi
    assert whirling == pytest.approx([root - half, root + half], rel=1e-9)


def test_a_top_on_a_ball_joint(mechanism):
    """Upright: ``I_t w^2 - I_p W w + m g h = 0`` in space, w - W in the axes of the top, in which it is linearised."""
    height, mass, polar, transverse, spin = 0.1, 0.8, 0.004, 0.006 + 0.8 * 0.01, 60.0
    xml = robot(link("ball", "base", "0 0 1", mass=mass, com=f"0 0 {height}",
                     inertia=(0.006, 0.006, polar))).replace('type="continuous"', 'type="spherical"')  # fmt: skip
    made = mechanism(xml)
    found = made.linearise(pin.neutral(made.model), np.array([0.0, 0.0, spin]))
    expected = sorted(abs(w - spin) for w in np.roots([transverse, -polar * spin, mass * GRAVITY * height]))
    whirling = found.modes.frequencies[found.modes.frequencies > 1e-6] * 2.0 * math.pi
    assert whirling == pytest.approx(expected, rel=1e-9)


def test_forward_dynamics_of_a_tree_have_pinocchios_derivatives():
    model = Mechanism.load("ur5")
    generator = np.random.default_rng(3)
    q, v, tau = generator.uniform(-1.0, 1.0, (3, model.model.nv))
    found = model.linearise(q, v, 10.0 * tau)
    data = model.model.createData()
    by_q, by_v, by_tau = pin.computeABADerivatives(model.model, data, q, v, 10.0 * tau)
    n = model.model.nv
    for own, other in ((found.A[n:, :n], by_q), (found.A[n:, n:], by_v), (found.B[n:], by_tau)):
        assert own == pytest.approx(other, rel=1e-9, abs=1e-9 * np.abs(other).max())


class FourBar:
    """Bars in the plane, uniform rods: angles of coupler and rocker over the crank angle, energies, in closed form."""

    def __init__(self, a, b, c, d, masses, stiffness):
        self.lengths, self.masses, self.stiffness = (a, b, c, d), masses, stiffness

    def angles(self, x):
        a, b, c, d = self.lengths
        tip = a * np.exp(1j * x)
        way = d - tip
        coupler = np.angle(way) + math.acos((b * b + abs(way) ** 2 - c * c) / (2.0 * b * abs(way)))
        return coupler, np.angle(tip + b * np.exp(1j * coupler) - d)

    def places(self, x):
        a, b, c, d = self.lengths
        coupler, rocker = self.angles(x)
        return [0.5 * a * np.exp(1j * x), a * np.exp(1j * x) + 0.5 * b * np.exp(1j * coupler),
                d + 0.5 * c * np.exp(1j * rocker)]  # fmt: skip

    def potential(self, x):
        weights = sum(m * GRAVITY * z.imag for m, z in zip(self.masses, self.places(x), strict=True))
        return weights + 0.5 * self.stiffness * self.angles(x)[1] ** 2

    def inertia(self, x, derivative):
        """m(x) of ``T = m(x) x'^2 / 2``."""
        total = 0.0
        for k, (mass, length) in enumerate(zip(self.masses, self.lengths, strict=False)):
            place = [derivative(lambda y, k=k, part=part: getattr(self.places(y)[k], part), x, 1e-3)
                     for part in ("real", "imag")]  # fmt: skip
            turn = 1.0 if k == 0 else derivative(lambda y, k=k: self.angles(y)[k - 1], x, 1e-3)
            total += mass * (place[0] ** 2 + place[1] ** 2) + mass * length**2 / 12.0 * turn**2
        return total


def test_a_four_bar_with_a_spring_about_its_equilibrium(differentiate):
    """``omega^2 = V'' / m`` over the crank angle, from the closed geometry alone."""
    numbers = {"a": 0.12, "b": 0.35, "c": 0.28, "d": 0.3, "m2": 0.4, "m3": 0.9, "m4": 0.7}
    made = Mechanism.load(ROOT / "models/crank_rocker/mechanism.yaml", numbers, values={"forces": {
        "spring": {"kind": "joint_spring", "joint": "theta4", "stiffness": "9 N*m/rad"},
    }})  # fmt: skip
    bars = FourBar(*(numbers[key] for key in "abcd"), [numbers[f"m{k}"] for k in (2, 3, 4)], 9.0)
    slope = lambda x: differentiate(bars.potential, x, 1e-3)  # noqa: E731
    starts = np.linspace(-math.pi, math.pi, 41)
    ends = [(x, y) for x, y in itertools.pairwise(starts) if slope(x) < 0.0 < slope(y)]
    x = brentq(slope, *ends[0], xtol=1e-14)
    coupler, rocker = bars.angles(x)
    q = made.configurations({"theta2": x, "A": coupler - x, "theta4": rocker})
    found = made.linearise(q)
    assert found.acceleration == pytest.approx(0.0, abs=1e-7)  # of a slope by differences
    curvature = differentiate(slope, x, 1e-2)
    frequency = math.sqrt(curvature / bars.inertia(x, differentiate)) / (2.0 * math.pi)
    assert found.modes.frequencies == pytest.approx([frequency], rel=1e-7)  # of differences of second order


def test_a_cam_with_its_follower_on_a_spring(mechanism):
    """``m x'' = -V''`` with ``f = a sin(phi)``, ``m = I + M f'^2`` and ``V = k (f - r)^2 / 2``, where ``V' = 0``."""
    amplitude, inertia, mass, stiffness, rest = 0.05, 0.003, 0.8, 900.0, 0.03
    xml = robot(link("turn", "base", "0 0 1", mass=1.0, inertia=(1.0, 1.0, inertia)),
                link("lift", "base", "0 1 0", mass=mass, kind="prismatic"))  # fmt: skip
    made = mechanism(
        xml, gravity="none",
        couplings={"cam": {"kind": "cam", "joints": ["turn", "lift"],
                           "profile": {"law": "harmonic", "amplitude": f"{amplitude} m", "pulsation": "1 rad/rad"}}},
        forces={"spring": {"kind": "joint_spring", "joint": "lift", "stiffness": f"{stiffness} N/m", "rest": "30 mm"}},
    )  # fmt: skip
    angle = math.asin(rest / amplitude)
    found = made.linearise(made.configurations({"turn": angle, "lift": rest}))
    slope = amplitude * math.cos(angle)
    expected = math.sqrt(stiffness * slope**2 / (inertia + mass * slope**2)) / (2.0 * math.pi)
    assert found.acceleration == pytest.approx(0.0, abs=1e-10)
    assert found.modes.frequencies == pytest.approx([expected], rel=1e-12)
    pressed = made.linearise(made.configurations({"turn": 0.5 * math.pi, "lift": amplitude}))  # V' = 0 as f' is
    curvature = -stiffness * (amplitude - rest) * amplitude
    assert pressed.A[1, 0] == pytest.approx(-curvature / inertia, rel=1e-12)


def test_a_jump_of_a_cams_curvature_is_refused(mechanism):
    """A harmonic rise to a dwell at 60 deg: the force of the follower's spring times f'' is another one beyond."""
    rise = {"law": "harmonic", "mean": "10 mm", "amplitude": "10 mm", "pulsation": "3 rad/rad", "phase": "-90 deg"}
    dwell = {"duration": "60 deg", "motion": {"law": "constant", "value": "20 mm"}}
    profile = {"law": "succession", "segments": [{"duration": "60 deg", "motion": rise}, dwell]}
    made = mechanism(
        robot(link("turn", "base", "0 0 1", mass=1.0, inertia=(1.0, 1.0, 1.0)),
              link("lift", "base", "0 1 0", mass=1.0, kind="prismatic")),
        gravity="none",
        couplings={"cam": {"kind": "cam", "joints": ["turn", "lift"], "profile": profile}},
    )  # fmt: skip
    seam = math.pi / 3.0
    with pytest.raises(InputError, match="the profile of 'cam' has a kink here"):
        made.linearise(made.configurations({"turn": seam, "lift": 0.02}))
    for beside in (-1e-3, 1e-3):
        lift = 0.02 if beside > 0.0 else 0.01 * (1.0 + math.cos(3.0 * beside))
        assert made.linearise(made.configurations({"turn": seam + beside, "lift": lift})).states == ["turn", "turn'"]


def test_singular_positions_are_refused():
    square = Mechanism.load(ROOT / "models/crank_rocker/mechanism.yaml", {"a": 0.2, "b": 0.3, "c": 0.2, "d": 0.3})
    with pytest.raises(DynamicsError, match="singular"):
        square.linearise(square.configurations({"theta2": 0.0, "A": 0.0, "theta4": 0.0}))
    aligned = Mechanism.load(ROOT / "models/change_point_four_bar/mechanism.yaml")
    for beside in (0.0, 3e-8):  # loops close to rounding, bars are aligned to its root
        with pytest.raises(DynamicsError, match="singular"):
            aligned.linearise(aligned.configurations({"theta2": np.pi, "A": np.pi - beside, "theta4": beside - np.pi}))
