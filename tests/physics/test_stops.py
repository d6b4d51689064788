"""Stops, and cables that only pull, together with friction that sticks and with controllers, against closed forms."""

import json
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import pinarm
from pinarm.errors import IntegrationError

SIZES = '<limit lower="-1e4" upper="1e4" effort="1e6" velocity="1e3"/>'
BODY = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
BLOCK = f"""
<link name="band">{BODY.format(1)}</link><link name="block">{BODY.format(2)}</link>
<joint name="belt" type="prismatic"><parent link="base"/><child link="band"/><axis xyz="1 0 0"/>{SIZES}</joint>
<joint name="slip" type="prismatic"><parent link="band"/><child link="block"/><axis xyz="1 0 0"/>{SIZES}</joint>"""
MASS, SLIDES, STICKS = 2.0, 0.2 * 2.0 * 9.81, 0.3 * 2.0 * 9.81
RUBBING = "friction: {slip: {mu: 0.2, static_mu: 0.3}}\n"
STILL = "motion: {belt: {law: constant, value: 0 m}}"
WHEEL = f"""
<link name="wheel">{BODY.format(1)}</link>
<joint name="turn" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/></joint>"""
MOTOR = "drives: {{motor: {{joint: turn, ratio: 10, rotor_inertia: 3e-5 kg*m^2, motor: {{kind: ideal}}{}}}}}\n"
PRESSED = (
    "{kind: forward, time: {end: 0.5 s, samples: 11}, initial: {position: {turn: 0.3 rad}}, "
    "end_stops: {turn: {upper: 0.3 rad}}, control: [{kind: state_feedback, drive: motor, states: [turn], "
    "gains: [[0 N*m/rad, 0 N*m*s/rad]], bias: [0.05 N*m]}]}"
)


def test_a_pushed_block_rebounds_and_sticks_where_it_turns(write):
    """With 5 N, between the friction of slip and of rest, from 1 m/s on: it comes to the stop, and does not return."""
    problem = (f"{{kind: forward, time: {{end: 2 s, samples: 3}}, {STILL}, initial: {{velocity: {{slip: 1 m/s}}}}, "
               "end_stops: {slip: {upper: 1 m, restitution: 0.5}}, "
               "loads: {push: {kind: joint_effort, joint: slip, effort: {law: constant, value: 5 N}}}}")  # fmt: skip
    result = pinarm.run(write(BLOCK, RUBBING, problem, "slip, joint.slip.friction"))
    gains, loses = (5.0 - SLIDES) / MASS, (5.0 + SLIDES) / MASS
    speed = np.sqrt(1.0 + 2.0 * gains)
    hits, turns = (speed - 1.0) / gains, (speed - 1.0) / gains + 0.5 * speed / loses
    found = [segment.solution.end for segment in result.outcome.motion.motion.segments]
    assert found == pytest.approx([hits, turns, 2.0], rel=1e-9)
    assert result["slip"].values[-1] == pytest.approx(1.0 - (0.5 * speed) ** 2 / (2.0 * loses), rel=1e-9)
    assert result["joint.slip.friction"].values[-1] == pytest.approx(-5.0, rel=1e-12)


def test_a_block_on_a_belt_that_speeds_up_comes_to_rest_at_a_stop_on_it(write):
    """On the belt 4 m/s^2 push it back: rebounds are ``e ((A - k)/(A + k))^(1/2)`` as fast as those before.

    At rest stop and friction share 8 N: the stop gives what friction leaves of it, at most the limit of rest to either
    side.
    """
    problem = ("{kind: forward, time: {end: 1.3 s, samples: 3}, "
               "motion: {belt: {law: trapezoid, from: 0 m, to: 36 m, acceleration: 4 m/s^2}}, "
               "end_stops: {slip: {lower: -0.5 m, restitution: 0.5}}}")  # fmt: skip
    result = pinarm.run(write(BLOCK, RUBBING, problem, "slip, joint.slip.effort"))
    slower, faster = 4.0 - SLIDES / MASS, 4.0 + SLIDES / MASS
    hits = [event for event in result.events if abs(event.before[1]) > 1e-4]
    assert hits[0].t == pytest.approx(np.sqrt(1.0 / slower), rel=1e-9)
    ratio = 0.5 * np.sqrt(slower / faster)
    for one, two in pairwise(hits):
        assert two.before[1] / one.before[1] == pytest.approx(ratio, rel=1e-5)  # the places are known to 1e-13 m
        away = abs(one.v[1])
        assert two.t - one.t == pytest.approx(away / faster + away / np.sqrt(slower * faster), rel=1e-5)
    for end, friction in (("least", -STICKS), ("greatest", STICKS)):
        assert result[f"joint.slip.effort.{end}"].values[-1] == pytest.approx(4.0 * MASS + friction, rel=1e-9)


CONTROL = "control: [{kind: pid, drive: slip, follows: {law: constant, value: 1 m}, kp: 200 N/m, kd: 4 N*s/m}]"
STOP = "end_stops: {slip: {upper: 0.5 m, restitution: 0.5}}"


def test_a_controlled_mass_at_a_stop(write, friction=3.0):
    """``2 x'' = 200 (1 - x) - 4 x' - F sign(x')``, from rest, and from the stop on with half the velocity back."""
    problem = f"{{kind: forward, time: {{end: 0.25 s, samples: 3}}, {STILL}, {STOP}, {CONTROL}}}"
    rubbing = f"friction: {{slip: {{constant: {friction} N}}}}\n"
    result = pinarm.run(write(BLOCK, "gravity: none\n" + rubbing, problem, "slip"))

    def rates(t, x):
        return [x[1], 100.0 * (1.0 - x[0]) - 2.0 * x[1] - 0.5 * friction * np.sign(x[1])]

    def at_stop(t, x):
        return x[0] - 0.5 if t > 1e-6 else -1.0

    def turns(t, x):
        return x[1] if t > 1e-6 else -1.0

    at_stop.terminal = turns.terminal = True
    at_stop.direction = 1.0
    options = {"rtol": 1e-11, "atol": 1e-13, "method": "DOP853"}
    first = solve_ivp(rates, (0.0, 1.0), [0.0, 0.0], events=at_stop, **options)
    back = solve_ivp(rates, (0.0, 1.0), [0.5, -0.5 * first.y[1, -1]], events=turns, **options)
    forth = solve_ivp(rates, (0.0, 1.0), [back.y[0, -1], 1e-12], events=at_stop, **options)
    times = np.cumsum([first.t[-1], back.t[-1] + forth.t[-1]])
    assert [event.t for event in result.events] == pytest.approx(times, rel=1e-7)
    assert [event.before[-1] for event in result.events] == pytest.approx([first.y[1, -1], forth.y[1, -1]], rel=1e-7)


DOOR = f"""
<link name="door">{BODY.format(15)}</link><link name="weight">{BODY.format(10)}</link>
<joint name="lift" type="prismatic"><parent link="base"/><child link="door"/><axis xyz="0 0 1"/>{SIZES}</joint>
<joint name="drop" type="prismatic"><parent link="base"/><child link="weight"/><origin xyz="1 0 1"/><axis xyz="0 0 1"/>
{SIZES}</joint><link name="a"/><link name="b"/>
<joint name="a_fixed" type="fixed"><parent link="base"/><child link="a"/><origin xyz="0 0 3"/></joint>
<joint name="b_fixed" type="fixed"><parent link="base"/><child link="b"/><origin xyz="1 0 3"/></joint>"""
HUNG = """loops: {rope: {kind: cable, through: [door, a, b, weight], length: 6 m}}
friction: {lift: {constant: 60 N}, drop: {constant: 20 N}}
"""


def test_a_controlled_door_on_a_cable_breaks_loose_at_the_sample_that_asks_for_more_than_friction_holds(write):
    """The motor lifts with ``2000 N/m * 0.1 m/s * t``, 5 N more a sample of 25 ms, the cable with 98.1 N of 147.15 N.

    Friction of door and counterweight hold 80 N together: it moves at the first sample with more than 129.05 N.
    """
    control = "{kind: pid, drive: lift, follows: {law: constant_speed, speed: 0.1 m/s}, kp: 2000 N/m, period: 25 ms}"
    problem = f"{{kind: forward, time: {{end: 0.7 s, samples: 29}}, control: [{control}]}}"
    result = pinarm.run(write(DOOR, HUNG, problem, "lift, joint.lift.velocity, loop.rope.tension"))
    begins = 0.025 * np.ceil((15.0 * 9.81 - 10.0 * 9.81 + 80.0) / 200.0 / 0.025)
    t, moves = result["t"].values, result["joint.lift.velocity"].values > 0.0
    assert t[moves].min() > begins - 1e-9
    assert moves[t > begins + 1e-9].all()
    accelerates = (200.0 * begins + 10.0 * 9.81 - 15.0 * 9.81 - 80.0) / 25.0
    row = result.lookup.at({"t": f"{begins + 0.02} s"}, "lift")
    assert row["joint.lift.velocity"].values[0] == pytest.approx(accelerates * 0.02, rel=1e-8)
    assert row["loop.rope.tension"].values[0] == pytest.approx(10.0 * (9.81 - accelerates) - 20.0, rel=1e-9)


def test_a_block_is_lifted_off_its_stop_by_a_ripple_of_the_load(write):
    """The load ripples many times in a step of the integration, as nothing moves before; the block's flight is known.

    It is lifted at t1, where ``P(t) = 2.6 sin(w1 t) + 0.5 sin(w2 t) - 2 N`` becomes positive, and back where the second
    integral of P from t1 on is 0.
    """
    slow, fast = 0.15, 30.0
    laws = ("law: harmonic, amplitude: 2.6 N, pulsation: 0.15 rad/s", "law: constant, value: -2 N",
            "law: harmonic, amplitude: 0.5 N, pulsation: 30 rad/s")  # fmt: skip
    given = ", ".join(f"l{k}: {{kind: joint_effort, joint: slip, effort: {{{law}}}}}" for k, law in enumerate(laws))
    problem = (f"{{kind: forward, time: {{end: 6 s, samples: 3}}, {STILL}, loads: {{{given}}}, "
               "end_stops: {slip: {lower: 0 m}}}")  # fmt: skip
    result = pinarm.run(write(BLOCK, "gravity: none\n", problem, "slip"))

    def push(t):
        return 2.6 * np.sin(slow * t) + 0.5 * np.sin(fast * t) - 2.0

    t = np.linspace(0.0, 6.0, 600_001)
    k = int(np.flatnonzero(push(t) > 0.0)[0])
    lifted = brentq(push, t[k - 1], t[k], xtol=1e-14)

    def way(t):
        parts = ((2.6, slow), (0.5, fast))
        rate = sum(a / w * np.cos(w * lifted) for a, w in parts)
        start = sum(a / w**2 * np.sin(w * lifted) for a, w in parts)
        h = t - lifted
        return -sum(a / w**2 * np.sin(w * t) for a, w in parts) + start + rate * h - h * h

    back = brentq(way, lifted + 0.04, lifted + 0.1, xtol=1e-14)
    assert result.events[0].t == pytest.approx(back, abs=1e-8)


def slider_crank(stop, speed="10 rad/s", angle=1.2):
    """A free slider-crank, 0.1 m and 0.3 m, drawn with its crank turned by an angle; x is how far its piston moves."""
    a = [0.1 * float(np.cos(angle)), 0.1 * float(np.sin(angle))]
    p = a[0] + float(np.sqrt(0.3**2 - a[1] ** 2))
    points = {"A": [f"{x!r} m" for x in a], "P": [f"{p!r} m", 0], "Q": [f"{p + 0.1!r} m", 0]}
    planar = {
        "points": {"O": [0, 0], **points}, "ground": ["O"],
        "links": {"crank": {"points": ["O", "A"], "mass": "1 kg"}, "rod": {"points": ["A", "P"], "mass": "1 kg"},
                  "piston": {"points": ["P", "Q"], "mass": "2 kg"}},
        "sliders": {"x": {"link": "piston", "along": ["P", "Q"]}},
    }  # fmt: skip
    problem = {"kind": "forward", "time": {"end": "2 s", "samples": 21}, "initial": {"velocity": {"O": speed}},
               "end_stops": {"x": {"upper": f"{0.4 - p + stop!r} m", "restitution": 0.5}}}  # fmt: skip
    mechanism = {"pinarm": 1, "gravity": "none", "planar": planar}
    return {"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": ["O", "energy.kinetic"]}


def test_a_stop_at_a_dead_point_is_passed_or_refused():
    """The piston comes to it with velocity 0: no impact, or one that turns the crank back, is one rounding apart."""
    clear = pinarm.run(slider_crank(1e-6))
    assert not clear.events
    met = pinarm.run(slider_crank(-1e-6))
    first = met.events[0]
    assert first.v[0] == pytest.approx(-0.5 * first.before[0], rel=1e-6)
    for angle in (0.7, 1.7):
        for stop in (0.0, 1e-14, -1e-14):
            try:
                assert not pinarm.run(slider_crank(stop, angle=angle)).events
            except IntegrationError as error:
                assert "turns at the end stop 'x upper'" in error.message
                assert error.partial is not None


def test_a_four_bar_that_bounces_to_rest_at_a_stop_is_held_there_in_compiled_code():
    """Held, it has no acceleration at all; what rounding leaves of it is no disagreement with Pinocchio."""
    scenario = pinarm.load("scenarios/crank_rocker_free.yaml", values={
        "problem.end_stops": {"theta4": {"upper": "110 deg", "restitution": 0.5}}, "problem.time.end": "1 s",
        "accuracy": {"tolerance": 1e-9}, "expect": [],
    })  # fmt: skip
    result = scenario.run()
    assert not [note for note in result.notes() if "kernel" in str(note)]
    at_rest = result["theta2"].values[-1]
    assert result["theta4"].values[-1] == pytest.approx(np.radians(110.0), rel=1e-12)
    a, b, c, d = 0.10, 0.35, 0.25, 0.40
    closing = np.exp(1j * np.radians(110.0)) * c + d - a * np.exp(1j * at_rest)
    assert abs(closing) == pytest.approx(b, rel=1e-12)


def test_a_stop_of_a_nut_is_met_though_its_spindle_turns_fast(write):
    """Lead 4 mm: 1571 rad/m, which is no dead point. With damping on the nut ``v = v0 exp(-t / T)``."""
    bodies = f"""
<link name="spindle">{BODY.format(1)}</link><link name="nut">{BODY.format(2)}</link>
<joint name="turn" type="continuous"><parent link="base"/><child link="spindle"/><axis xyz="0 0 1"/></joint>
<joint name="lift" type="prismatic"><parent link="base"/><child link="nut"/><axis xyz="0 0 1"/>{SIZES}</joint>"""
    felt = 2.0 + (2.0 * np.pi / 4e-3) ** 2
    screw = ("gravity: none\ncouplings: {s: {kind: screw, joints: [turn, lift], lead: 4 mm}}\n"
             f"forces: {{d: {{kind: joint_spring, joint: lift, damping: {felt!r} N*s/m}}}}\n")  # fmt: skip
    problem = ("{kind: forward, time: {end: 6 s, samples: 3}, initial: {velocity: {lift: 1 mm/s}}, "
               "end_stops: {lift: {upper: 0.99 mm}}}")  # fmt: skip
    result = pinarm.run(write(bodies, screw, problem, "lift"))
    assert result.events[0].t == pytest.approx(-np.log(0.01), rel=1e-6)
    assert result["lift"].values[-1] == pytest.approx(0.99e-3, rel=1e-12)


POINTS = np.linspace(0.0, 10.0, 1001)
BLOW = CubicSpline(POINTS, 15.0 * np.maximum(1.0 - np.abs(POINTS - 7.76) / 0.05, 0.0), bc_type="clamped")
"""A force measured at 100 Hz: a blow of 0.1 s in a run of 10 s, as a spline that SciPy computes."""


@pytest.mark.parametrize(
    ("accuracy", "rests"),
    [
        ("", False),
        ("", True),
        pytest.param("accuracy: {target: 1e-6}", True, marks=[pytest.mark.slow, pytest.mark.timeout(1800)]),
    ],
)
def test_a_short_blow_in_a_long_table_is_not_stepped_over(write, accuracy, rests):
    """On a block in steady motion, and on one that 2 N press onto its stop, which no step before it is short for."""
    points = [[f"{t:.2f} s", f"{f!r} N"] for t, f in zip(POINTS.tolist(), BLOW(POINTS).tolist(), strict=True)]
    loads = {"blow": {"kind": "joint_effort", "joint": "slip", "effort": {"law": "spline", "points": points}}}
    if rests:
        loads["press"] = {"kind": "joint_effort", "joint": "slip", "effort": {"law": "constant", "value": "-2 N"}}
    rest = ["end_stops: {slip: {lower: 0 m}}"] if rests else ["initial: {velocity: {slip: 0.1 m/s}}"]
    keys = ["kind: forward", "time: {end: 10 s, samples: 2}", STILL, f"loads: {json.dumps(loads)}", *rest]
    result = pinarm.run(write(BLOCK, "gravity: none\n", "{" + ", ".join(keys) + "}\n" + accuracy, "slip"))
    if not rests:
        exact = 1.0 + BLOW.antiderivative(2)(10.0) / MASS
        assert result["slip"].values[-1] == pytest.approx(exact, rel=1e-9)
        return
    lifted = brentq(lambda t: BLOW(t) - 2.0, 7.71, 7.76, xtol=1e-14)
    once, twice = BLOW.antiderivative(), BLOW.antiderivative(2)

    def way(t):
        h = t - lifted
        return twice(t) - twice(lifted) - once(lifted) * h - h * h

    back = brentq(way, 7.8, 10.0, xtol=1e-13)
    assert [event.t for event in result.events] == pytest.approx([back], abs=1e-7)


def test_a_cable_is_taut_and_slack_at_its_instants_beside_a_joint_that_is_left_out(write):
    """A weight of 2 kg falls by 0.3 m, and bounces on 50 kN/m: half an oscillation about ``m g / k``, from ``v`` on."""
    bodies = f"""
<link name="weight">{BODY.format(2)}</link><link name="wheel">{BODY.format(1)}</link>
<joint name="drop" type="prismatic"><parent link="base"/><child link="weight"/><origin xyz="0 0 -1"/>
<axis xyz="0 0 -1"/>{SIZES}</joint>
<joint name="turn" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/></joint>"""
    rope = "{kind: cable, through: [base, weight], stiffness: 50 kN/m, free_length: 1.3 m}"
    problem = ("{kind: forward, time: {end: 0.4 s, samples: 3}, motion: {turn: {law: constant, value: 0 rad}}, "
               f"loads: {{rope: {rope}}}}}")  # fmt: skip
    result = pinarm.run(write(bodies, "", problem, "drop"))
    taut, pulse = np.sqrt(0.6 / 9.81), np.sqrt(50e3 / 2.0)
    slack = taut + 2.0 / pulse * (np.pi - np.arctan(taut * pulse))
    assert [one.how for one in result.removals] == ["locked"]
    found = [segment.solution.end for segment in result.outcome.motion.motion.motion.segments]
    assert found == pytest.approx([taut, slack, 0.4], rel=1e-7)


@pytest.mark.parametrize("friction", ["", "friction: {turn: {constant: 0.08 N*m}}\n"])
def test_a_motor_that_presses_against_a_stop_has_its_torque(write, friction):
    """0.05 N*m through a gear of 10: 0.5 N*m, which the stop takes, but for what friction at rest may hold of it."""
    result = pinarm.run(write(WHEEL, MOTOR.format("") + friction, PRESSED, "turn"))
    assert result["joint.turn.effort"].values == pytest.approx(0.5, rel=1e-12)
    assert result["drive.motor.torque"].values == pytest.approx(0.05, rel=1e-12)
    assert result.number("drive.motor.torque @ rms")[0] == pytest.approx(0.05, rel=1e-12)
    for end, held in (("least", -0.08), ("greatest", 0.08)):
        push = result[f"joint.turn.stop.{end}"].values
        assert push == pytest.approx(-0.5 + (held if friction else 0.0), rel=1e-12)


@pytest.mark.parametrize("friction", ["", "friction: {turn: {constant: 0.08 N*m}}\n"])
def test_an_elastic_gear_pulls_at_a_joint_on_its_stop_as_its_spring_does(write, friction):
    """The rotor, 0.003 kg*m^2 at the joint, swings on 28 N*m/rad about the 0.5 N*m of its motor."""
    elastic = ", elasticity: {stiffness: 28 N*m/rad}"
    result = pinarm.run(write(WHEEL, MOTOR.format(elastic) + friction, PRESSED, "turn"))
    exact = 0.5 * (1.0 - np.cos(np.sqrt(28.0 / 0.003) * result["t"].values))
    assert result["joint.turn.effort"].values == pytest.approx(exact, abs=1e-7)
    settled = exact > 0.2  # on the stop, and friction no longer holds the joint alone
    assert result["joint.turn.stop"].values[settled] == pytest.approx(-exact[settled], abs=1e-7)
