"""The references hold by themselves: closed forms against Fourier series, other theorems, and published digits."""

import numpy as np
import pytest

from . import andrews_equations as andrews
from . import equal_four_bars
from .bricard_closed_form import Bricard
from .energy_integral import EnergyIntegral
from .four_bar_closed_form import ChangePoint, FourBar
from .manipulator_closed_form import Manipulator
from .periodic import rate
from .rotor_closed_form import Rotor
from .rssr_closed_form import Rssr
from .slider_crank_closed_form import SliderCrank
from .vibrator_closed_form import Vibrator, X, Y, Z

W = 7.0
TURN = 2 * np.pi * np.arange(128) / 128
LINKAGE = FourBar(0.10, 0.35, 0.25, 0.40, 1.0, 3.5, 2.5)
CHANGE_POINT = ChangePoint(0.15, 0.35, 0.20, 0.40, 1.5, 3.5, 2.0)


def angle_rate(angle, period):
    """Rate of an angle that may turn over."""
    e = np.exp(1j * angle)
    return (rate(e, period) / (1j * e)).real


@pytest.mark.parametrize("linkage", [LINKAGE, FourBar(0.10, 0.35, 0.25, 0.40, 1.0, 3.5, 2.5, open=False)])
def test_four_bar_closes_and_its_rates_are_those_of_fourier_series(linkage):
    (theta3, theta4), omegas, alphas = linkage.rates(TURN, W)
    gap = linkage.a * np.exp(1j * TURN) + linkage.b * np.exp(1j * theta3) - linkage.d - linkage.c * np.exp(1j * theta4)
    assert abs(gap).max() < 1e-14
    for angle, omega, alpha in zip((theta3, theta4), omegas, alphas, strict=True):
        assert angle_rate(angle, 2 * np.pi / W) == pytest.approx(omega, abs=1e-11)
        assert rate(omega, 2 * np.pi / W) == pytest.approx(alpha, abs=1e-10)


def test_torque_of_the_four_bar_is_the_rate_of_its_energy():
    energy = 0.5 * LINKAGE.inertia(TURN) * W**2 + LINKAGE.potential(TURN)
    assert rate(energy, 2 * np.pi / W) / W == pytest.approx(LINKAGE.forces(TURN, W)["T"], abs=1e-11)


def test_change_point_linkage_is_smooth_over_two_turns_and_closed():
    theta2 = 4 * np.pi * np.arange(512) / 512 + 0.001
    theta3, theta4, d3, d4 = CHANGE_POINT.slopes(theta2)
    gap = 0.15 * np.exp(1j * theta2) + 0.35 * np.exp(1j * theta3) - 0.40 - 0.20 * np.exp(1j * theta4)
    assert abs(gap).max() < 1e-14
    for angle, slope in ((theta3, d3), (theta4, d4)):
        assert angle_rate(angle, 4 * np.pi) == pytest.approx(slope, abs=1e-11)
    first, second, *_ = CHANGE_POINT.slopes(np.array([0.0, 2 * np.pi]))
    assert np.sin(second - first).sum() == pytest.approx(0.0, abs=1e-14)  # open on one turn, crossed on the next


def test_equal_four_bars_turn_as_published():
    for count, turned in ((1, 31.914741297738026), (2, 31.750597186986102), (40, 31.59743374398574)):
        assert equal_four_bars.angle(10.0, count) == pytest.approx(turned, abs=1e-12)


def test_energy_integral_is_the_elliptic_function():
    t = np.linspace(0.0, 10.0, 41)
    turning = EnergyIntegral(lambda q: 5 / 3 + 0 * q, lambda q: 2 * 9.81 * np.cos(q), 0.0, 1.0, 35.0)
    assert turning.at(t) == pytest.approx(equal_four_bars.angle(t, 1), abs=1e-12)


@pytest.mark.parametrize("height", [0.0, 0.012])
def test_slider_crank_moves_as_fourier_series_say_and_newton_agrees_with_energy(height):
    crank, period = SliderCrank(e=height), 2 * np.pi / W
    positions, velocities, accelerations = crank.motion(TURN, W)
    for position, velocity, acceleration in zip(positions, velocities, accelerations, strict=True):
        assert rate(position, period) == pytest.approx(velocity, abs=1e-12)
        assert rate(velocity, period) == pytest.approx(acceleration, abs=1e-11)
    assert crank.forces(TURN, W, 3.0, 100.0)["T"] == pytest.approx(crank.torque(TURN, W, 3.0, 100.0), abs=1e-13)
    assert 0.5 * W * rate(crank.inertia(TURN), period) == pytest.approx(crank.torque(TURN, W), abs=1e-13)


def test_manipulator_obeys_its_law_of_motion_body_by_body_and_has_the_published_sizes():
    arm = Manipulator()
    alpha = np.linspace(-1.4, 1.4, 9)
    torque = arm.forces(alpha, 0.3, 0.5, F=100.0, p=3e5)["T"]
    assert torque == pytest.approx(arm.torque(alpha, 0.5, F=100.0, p=3e5), abs=1e-9)  # of forces of 1e4 N
    assert arm.I_eq == pytest.approx(3483.958, abs=5e-4)
    assert Manipulator(m=0.0).weights == 0.0
    assert arm.torque(alpha, p=0.5232e6) == pytest.approx(0.0, abs=1e-9)
    assert arm.acceleration(alpha, F=653.24, p=0.5232e6) == pytest.approx(0.375, rel=5e-6)
    assert arm.acceleration(0.0, F=65.324, p=0.57546e6) == pytest.approx(0.375, rel=1e-4)


def test_vibrator_obeys_the_balance_of_its_trunk_which_its_law_of_motion_did_not_use():
    machine, t = Vibrator(e=0.6, Omega=50.7), np.linspace(0.0, 0.5, 101)
    for instant, beta, bed, bedd in zip(t, *machine.motion(t), strict=True):
        x53, y53, z53 = machine.loop_force(instant, beta, bed, bedd)
        theta = machine.closure(beta)[1]
        x2, z2 = np.cos(theta) * X - np.sin(theta) * Z, np.sin(theta) * X + np.cos(theta) * Z
        arm = machine.l5 * (np.cos(beta) * Z - np.sin(beta) * Y)
        moment = np.cross(arm, -(x53 * x2 + y53 * Y + z53 * z2))[0]
        resisted = machine.A5 * bedd + machine.k_star * beta + (machine.b_star + machine.lam) * bed
        assert resisted == pytest.approx(moment, abs=1e-8)  # of 1e5 N*m


def test_vibrator_has_the_published_inertia_resonance_and_small_motion():
    machine, t = Vibrator(e=6e-5), np.linspace(0.0, 0.3, 301)
    assert machine.inertia(0.1, 0.0) == pytest.approx(106.71, rel=1e-14)
    stiffness = machine.k1 * machine.l5**2 + machine.k_star
    assert np.sqrt(stiffness / 106.71) == pytest.approx(50.7, abs=0.05)
    exact, linear = machine.motion(t), machine.linear(t)
    assert linear[0] == pytest.approx(exact[0], abs=1e-10)  # of 1e-5: relative deviations of the size of beta
    damping, unbalance = machine.b_star + machine.b1 * machine.l5**2 + machine.lam, machine.m4 * machine.l5 * machine.e
    left = 106.71 * linear[2] + damping * linear[1] + stiffness * linear[0]
    assert left == pytest.approx(-unbalance * machine.Omega**2 * np.cos(machine.Omega * t), abs=1e-12)
    # the steady amplitude: what is left of the free motion after 20 times its time constant
    late = machine.linear(np.linspace(20.0, 20.0 + 2 * np.pi / machine.Omega, 1001))
    assert abs(late[0]).max() == pytest.approx(machine.amplitude(), rel=1e-5)


@pytest.mark.slow
def test_bricard_stays_closed_and_keeps_its_energy():
    linkage, t = Bricard(), np.linspace(0.0, 10.0, 101)
    energies = []
    for a, b, da, db in np.transpose(linkage.motion(t)):
        assert abs(linkage.gap(a, b)).max() < 1e-11
        inertia, potential = linkage.energies(a, b)
        along, speed = np.array(linkage.tangent(a, b)), np.array([da, db])
        energies.append(0.5 * inertia * (along @ speed / (along @ along)) ** 2 + potential)
    assert np.ptp(energies) < 1e-10


@pytest.mark.parametrize("branch", [1, -1])
def test_rssr_closes_and_its_torque_has_no_mean_over_a_turn(branch):
    linkage = Rssr(branch=branch)
    apart = linkage.rocker_pin(TURN) - linkage.crank_pin(TURN)
    assert np.linalg.norm(apart, axis=1) == pytest.approx(linkage.b, abs=1e-14)
    *_, torque, _ = linkage.turn(6.0)
    assert torque.mean() == pytest.approx(0.0, abs=1e-12)
    assert linkage.turn(6.0, 512)[3][::2] == pytest.approx(torque, abs=1e-9)


def test_rotor_is_balanced_by_its_correction_masses():
    rotor, w = Rotor(), 100 * np.pi
    a, b = rotor.rotating(w)
    assert (a, b) == pytest.approx((-246.7401 - 24.6740j, -345.4362 + 24.6740j), abs=1e-4)
    masses, angles = rotor.corrections()
    assert np.abs(rotor.rotating(w, masses, angles, axial_g=9.81)).max() < 1e-12
    assert sum(rotor.constant(9.81, masses)).imag == pytest.approx(9.81 * (12 + masses.sum()))


@pytest.mark.slow
def test_andrews_reaches_the_values_of_the_test_set():
    first, _ = andrews.acceleration(andrews.START, np.zeros(7))
    assert first[:2] == pytest.approx((14222.4439199541138, -10666.8329399655854), rel=1e-12)
    t = np.linspace(0.0, 0.03, 31)
    q, v = andrews.motion(t)
    assert max(abs(andrews.closure(row)).max() for row in q) < 1e-13
    assert np.ptp([andrews.energy(*row) for row in zip(q, v, strict=True)]) < 1e-12
    assert q[-1] + 1e-12 * v[-1] == pytest.approx(andrews.PUBLISHED, abs=2e-11)
