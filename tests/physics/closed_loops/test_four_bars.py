"""Four-bars: at constant speed, free, and through their aligned positions."""

import numpy as np
import pytest

import pinarm
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import NumericsError, PinarmError
from pinarm.mechanics.laws import ConstantSpeed, Harmonic
from pinarm.use.mechanism import Mechanism

from . import equal_four_bars
from .energy_integral import EnergyIntegral
from .four_bar_closed_form import ChangePoint, FourBar

LINKAGE = FourBar(0.10, 0.35, 0.25, 0.40, 1.0, 3.5, 2.5)
CROSSED = FourBar(0.10, 0.35, 0.25, 0.40, 1.0, 3.5, 2.5, open=False)
CHANGE_POINT = ChangePoint(0.15, 0.35, 0.20, 0.40, 1.5, 3.5, 2.0)
OPEN, TURNED_OVER = {"A": 0.8, "theta4": 1.8}, {"A": -0.8, "theta4": -1.8}
PINS = {"O2": "joint.theta2", "A": "joint.A", "B": "loop.B", "O4": "joint.theta4"}


@pytest.mark.parametrize(("linkage", "start"), [(LINKAGE, OPEN), (CROSSED, TURNED_OVER)])
def test_torque_and_pin_forces_are_those_of_newton_and_euler_for_each_bar(solve, linkage, start):
    law = Harmonic(mean=2.0, amplitude=3.5, pulsation=6.0)
    found = solve("crank_rocker", "inverse", motion={"theta2": law}, drives=["theta2"], start={"theta2": 2.0, **start})
    theta2, omega2 = found["theta2"].values, found["omega2"].values
    alpha2 = found["joint.theta2.acceleration"].values
    angles, omegas, alphas = linkage.rates(theta2, omega2, alpha2)
    for name, angle, omega, alpha in zip(("theta3", "theta4"), angles, omegas, alphas, strict=True):
        assert np.cos(found[name].values - angle) == pytest.approx(1.0, abs=1e-14)
        assert found[f"coordinate.{name}.velocity"].values == pytest.approx(omega, rel=1e-9, abs=1e-9)
        assert found[f"coordinate.{name}.acceleration"].values == pytest.approx(alpha, rel=1e-9, abs=1e-8)
    forces = linkage.forces(theta2, omega2, alpha2)
    assert found["T"].values == pytest.approx(forces["T"], rel=1e-9, abs=1e-9)
    for pin, name in PINS.items():
        for axis in "xy":
            assert found[f"{name}.force.{axis}"].values == pytest.approx(forces[f"{pin}.{axis}"], rel=1e-9, abs=1e-8)


def test_a_motor_at_the_rocker_takes_the_power_that_one_at_the_crank_takes(solve):
    law = Harmonic(mean=0.9, amplitude=0.6, pulsation=6.0)  # away from the dead points of the rocker
    common = {"motion": {"theta2": law}, "start": {"theta2": 0.9, **OPEN}}
    crank = solve("crank_rocker", "inverse", drives=["theta2"], **common)
    rocker = solve("crank_rocker", "inverse", drives=["theta4"], **common)
    power = crank["joint.theta2.power"].values
    assert np.ptp(power) > 1.0
    assert rocker["joint.theta4.power"].values == pytest.approx(power, rel=1e-9, abs=1e-9)
    assert rocker["joint.theta2.effort"].values == pytest.approx(0.0, abs=1e-12)


def test_free_crank_and_rocker_follows_its_energy_integral(solve):
    turning = EnergyIntegral(LINKAGE.inertia, LINKAGE.potential, 0.0, 12.0, 30.0)
    initial = {"position": {"theta2": 0.0}, "velocity": {"theta2": 12.0}}
    found = solve("crank_rocker", "forward", end=2.0, start=OPEN, initial=initial)
    t, theta2 = found["t"].values, found["theta2"].values
    assert theta2 == pytest.approx(turning.at(t), abs=1e-9)  # 1e-12 a step over 400 steps
    assert found["omega2"].values == pytest.approx(turning.speed(theta2), rel=1e-9)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-12])
@pytest.mark.parametrize("speed", [-12.5, 17.3])
def test_change_point_linkage_stays_on_its_smooth_motion_at_every_turn(solve, speed, tolerance):
    turning = EnergyIntegral(CHANGE_POINT.inertia, CHANGE_POINT.potential, 0.0, speed, 4.2 * speed)
    initial = {"position": {"theta2": 0.0}, "velocity": {"theta2": speed}}
    found = solve(
        "change_point_four_bar", "forward", end=3.0, samples=61, tolerance=tolerance, start=OPEN, initial=initial
    )
    theta2 = found["theta2"].values
    assert abs(theta2[-1]) > 10 * np.pi
    theta3, theta4, *_ = CHANGE_POINT.slopes(theta2)
    assert np.cos(found["theta3"].values - theta3).min() > 1.0 - 1e-8
    assert np.cos(found["theta4"].values - theta4).min() > 1.0 - 1e-8
    # errors of the steps add up, and slow turns magnify them; below 1e-6 the passages themselves leave what they like
    assert theta2 == pytest.approx(turning.at(found["t"].values), abs=max(1e3 * tolerance, 1e-6))


@pytest.mark.parametrize("kind", ["inverse", "kinematics"])
def test_a_law_from_exactly_the_change_point_is_refused_and_one_from_beside_it_passes(solve, kind):
    """At theta2 = 180 deg two motions cross, which obey the same law."""

    def law(start):
        return {"theta2": ConstantSpeed(start=start, speed=3.0)}

    with pytest.raises(PinarmError, match="the position is singular at t = 0 s") as caught:
        solve("change_point_four_bar", kind, end=2.0, samples=21, motion=law(np.pi), start={"A": -3.1, "theta4": 3.1})
    assert "at a change point a start and rows beside it, between which the motion passes it" in caught.value.hint
    found = solve("change_point_four_bar", kind, end=2.0, samples=21, motion=law(3.1), start={"A": -3.1, "theta4": 3.1})
    _, theta4, *_ = CHANGE_POINT.slopes(found["theta2"].values)
    assert np.exp(1j * found["theta4"].values) == pytest.approx(np.exp(1j * theta4), abs=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("rough", [0.0, 0.02])
def test_a_start_next_to_the_change_point_has_the_velocities_of_its_branch_or_is_refused(outcome, side, rough):
    """Within 1e-5 rad a start had other velocities than were given, without a word; the energy was not kept."""
    right = 0
    for apart in (1e-2, 1e-3, 1e-4, 3e-6, 1e-6, 3e-7, 1e-7, 1e-8, 1e-10, 0.0):
        turned = np.pi - side * apart
        start = {"A": -np.pi + rough, "theta4": np.pi - rough}
        initial = {"position": {"theta2": turned}, "velocity": {"theta2": 12.0}}
        try:
            solved = outcome("change_point_four_bar", "forward", end=0.1, samples=3, start=start, initial=initial)
        except PinarmError as error:
            assert "choose its velocities" in str(error) or "for an instant only" in str(error)
            assert apart <= 3e-6
            continue
        right += 1
        found = Quantities(solved.rows)
        branches = [CHANGE_POINT.slopes(np.array(turned + offset))[3] for offset in (0.0, 2.0 * np.pi)]
        rate = found["omega4"].values[0] / found["omega2"].values[0]
        rounding = 1e-15 / max(apart, 1e-6) ** 2  # over the square of the regularity, which is 1e-6 at least
        assert found["omega2"].values[0] == pytest.approx(12.0, rel=1e-4 + rounding)
        assert min(abs(rate - one) for one in branches) < 1e-4 + rounding + apart
        lost = np.ptp(found["energy.total"].values) / np.ptp(found["energy.kinetic"].values)
        assert lost < 1e-6 + 1e-14 / apart**2  # velocities at the start: rounding over the square of the regularity
        assert solved.figures["steps"] < 100  # no less than elsewhere: rounding does not shorten them
    assert right >= 3


@pytest.mark.parametrize("shorter", [1e-8, -1e-7])
def test_beside_a_change_point_the_linkage_turns_and_keeps_its_energy(solve, shorter):
    """With a frame longer than that of the change point the crank turns back; half of the energy was lost there."""
    solved = solve("change_point_four_bar", "forward", arguments={"d": 0.4 * (1.0 - shorter)}, end=0.6, samples=301,
                   start=OPEN, initial={"position": {"theta2": 1.0}, "velocity": {"theta2": 12.0}})  # fmt: skip
    energy, crank = solved["energy.total"].values, solved["theta2"].values
    assert np.ptp(energy) < 3e-5 * np.ptp(solved["energy.kinetic"].values)  # rounding over regularity cubed
    assert (crank.max() > 2.0 * np.pi) == (shorter > 0.0)


@pytest.mark.parametrize(("lengths", "shorter", "masses"), [
    ((0.187, 0.305, 0.307), 1.5e-7, (10.0, 170.0, 0.0069)), ((0.179, 0.430, 0.261), 2.9e-9, (2.1, 86.0, 0.11)),
    ((0.144, 0.454, 0.422), 1.4e-9, (2.1, 48.0, 0.036)),
])  # fmt: skip
def test_bars_of_unlike_masses_turn_beside_a_change_point_as_their_energy_says(solve, lengths, shorter, masses):
    """At any tolerance the accelerations there took up to 1e-3 of the speed."""
    a, b, c = lengths
    linkage = FourBar(a, b, c, b + c - a - shorter, *masses)
    theta3, theta4 = linkage.angles(1.0)
    named = {name: getattr(linkage, name) for name in ("a", "b", "c", "d", "m2", "m3", "m4")}
    found = solve("crank_rocker", "forward", arguments=named, end=0.75, samples=61,
                  start={"A": float(theta3) - 1.0, "theta4": float(theta4)},
                  initial={"position": {"theta2": 1.0}, "velocity": {"theta2": 8.0}})  # fmt: skip
    crank, energy = found["theta2"].values, 32.0 * linkage.inertia(1.0) + linkage.potential(1.0)
    assert crank[-1] > 2.0 * np.pi
    speed = np.sqrt(2.0 * (energy - linkage.potential(crank)) / linkage.inertia(crank))
    assert found["omega2"].values == pytest.approx(speed, rel=1e-7)  # 1e-9 is left of rounding


@pytest.mark.parametrize("mass", [2e5])
def test_a_heavy_rocker_takes_the_crank_through_the_change_point(solve, mass):
    """Beside the rocker's dead points the crank is many times as fast as in the change point."""
    linkage = ChangePoint(0.15, 0.35, 0.20, 0.40, 1.5, 3.5, mass)
    found = solve("change_point_four_bar", "forward", arguments={"m4": mass}, end=0.6, samples=61, start=OPEN,
                  initial={"position": {"theta2": 0.0}, "velocity": {"theta2": 12.0}})  # fmt: skip
    crank, energy = found["theta2"].values, 72.0 * linkage.inertia(0.0) + linkage.potential(0.0)
    assert crank[-1] > 2.0 * np.pi
    speed = np.sqrt(2.0 * (energy - linkage.potential(crank)) / linkage.inertia(crank))
    assert speed.max() > 5.0 * speed.min()
    assert found["omega2"].values == pytest.approx(speed, rel=1e-7)


@pytest.mark.parametrize("shorter", [-1e-9, 1e-10])
def test_where_rounding_decides_whether_a_change_point_is_passed_the_motion_is_refused(outcome, shorter):
    with pytest.raises(NumericsError, match="goes through it or turns beside it"):
        outcome("change_point_four_bar", "forward", arguments={"d": 0.4 * (1.0 - shorter)}, end=0.6, samples=13,
                start=OPEN, initial={"position": {"theta2": 1.0}, "velocity": {"theta2": 12.0}})  # fmt: skip


@pytest.mark.parametrize("ulps", [(0, 0, 0), (0, 1, 0), (0, 0, -1), (-1, 1, 2), (2, -2, 1)])
@pytest.mark.parametrize("turn", [0.0, 2.0 * np.pi])
def test_from_the_change_point_velocities_tell_the_motion(solve, turn, ulps):
    _, _, d3, d4 = CHANGE_POINT.slopes(np.array(np.pi + turn))
    velocity = {"theta2": 12.0, "A": 12.0 * (d3 - 1.0), "theta4": 12.0 * d4}
    near, rocker, crank = (float(x + k * np.spacing(np.pi)) for x, k in zip((-np.pi, np.pi, np.pi), ulps, strict=True))
    found = solve(
        "change_point_four_bar", "forward", end=0.2, samples=5, tolerance=1e-10, start={"A": near, "theta4": rocker},
        initial={"position": {"theta2": crank}, "velocity": {name: float(rate) for name, rate in velocity.items()}},
    )  # fmt: skip
    _, theta4, *_ = CHANGE_POINT.slopes(found["theta2"].values + turn)
    assert np.exp(1j * found["theta4"].values) == pytest.approx(np.exp(1j * theta4), abs=1e-7)
    assert np.ptp(found["energy.total"].values) < 1e-6 * np.ptp(
        found["energy.kinetic"].values
    )  # noise of the first row


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-9, 1e-13])
def test_it_is_passed_from_any_start(solve, tolerance):
    generator = np.random.default_rng(3)
    for _ in range(40):
        turned, speed = generator.uniform(-2.5, 2.5), generator.uniform(12.5, 20.0) * generator.choice([-1.0, 1.0])
        theta3, theta4, *_ = CHANGE_POINT.slopes(np.array(turned))
        found = solve(
            "change_point_four_bar", "forward", end=3.0, samples=61, tolerance=tolerance,
            start={"A": theta3 - turned, "theta4": theta4},
            initial={"position": {"theta2": turned}, "velocity": {"theta2": speed}},
        )  # fmt: skip
        theta3, theta4, *_ = CHANGE_POINT.slopes(found["theta2"].values)
        assert np.exp(1j * found["theta3"].values) == pytest.approx(np.exp(1j * theta3), abs=1e-9)
        assert np.exp(1j * found["theta4"].values) == pytest.approx(np.exp(1j * theta4), abs=1e-9)
        error = np.ptp(found["energy.total"].values) / np.ptp(found["energy.kinetic"].values)
        assert error < max(100.0 * tolerance, 1e-8)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-11])
@pytest.mark.parametrize(("model", "count"), [("four_bar", 1), ("two_four_bars", 2)])
def test_equal_four_bars_pass_their_flat_positions_on_the_parallelogram(solve, model, count, tolerance):
    initial = {"position": {"upright_0": 0.0}, "velocity": {"upright_0": 1.0}}
    found = solve(model, "forward", end=10.0, samples=21, tolerance=tolerance, initial=initial)
    turned = equal_four_bars.angle(found["t"].values, count)
    for upright in range(count + 1):
        # ten passages by the upright position, each of which magnifies what errors there are
        assert found[f"upright_{upright}"].values == pytest.approx(turned, abs=max(1e4 * tolerance, 1e-7))


@pytest.mark.slow
def test_forty_four_bars_turn_as_one_pendulum(solve):
    """Rounding at the flat positions, which forty loops pass together, leaves 1e-10 to 3e-9: other processors, more."""
    initial, errors = {"position": {"upright_0": 0.0}, "velocity": {"upright_0": 1.0}}, []
    for tolerance in (5e-12, 2e-12, 1e-12):
        found = solve("forty_four_bars", "forward", end=10.0, samples=21, tolerance=tolerance, initial=initial)
        errors.append(np.abs(found["upright_40"].values - equal_four_bars.angle(found["t"].values, 40)).max())
    assert max(errors) < 1e-7


RECTANGLE = """
pinarm: 1
title: Rectangle
gravity: none
planar:
  points: {O: [0, 0], A: [0, 0.5 m], B: [0.9 m, 0.5 m], C: [0.9 m, 0]}
  ground: [O, C]
  links: {l: {points: [O, A], mass: 1 kg}, k: {points: [A, B], mass: 3 kg}, r: {points: [B, C], mass: 2 kg}}
"""


@pytest.mark.parametrize("tolerance", [1e-6, 3e-11, 1e-13])
def test_pins_of_a_drawing_pass_flat_positions_at_any_tolerance(tmp_path, tolerance):
    """Without loads the uprights turn evenly, past two positions in which the rectangle is flat."""
    (tmp_path / "mechanism.yaml").write_text(RECTANGLE)
    result = pinarm.run({
        "pinarm": 1, "mechanism": Mechanism.load(tmp_path / "mechanism.yaml"), "outputs": ["O", "joint.O.velocity"],
        "problem": {"kind": "forward", "time": {"end": "5 s", "samples": 51},
                    "initial": {"velocity": {"O": "1 rad/s"}}},
        "accuracy": {"tolerance": tolerance},
    })  # fmt: skip
    near = max(1e3 * tolerance, 1e-9)
    assert result["joint.O.velocity"].values == pytest.approx(1.0, abs=near)
    assert result["O"].values == pytest.approx(np.linspace(0.0, 5.0, 51), abs=near)
