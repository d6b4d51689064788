"""Friction that sticks, against closed forms and printed numbers."""

from itertools import pairwise

import numpy as np
import pytest

import pinarm
from pinarm.errors import PinarmError
from pinarm.use.study.restore import restore

SIZES = '<limit lower="-1e4" upper="1e4" effort="1e6" velocity="1e3"/>'
BODY = '<inertial><mass value="{mass}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


BELT = f"""
<link name="band">{BODY.format(mass=1)}</link><link name="block">{BODY.format(mass=2)}</link><link name="wall"/>
<joint name="post" type="fixed"><parent link="base"/><child link="wall"/><origin xyz="-1 0 0"/></joint>
<joint name="belt" type="prismatic"><parent link="base"/><child link="band"/><axis xyz="1 0 0"/>{SIZES}</joint>
<joint name="slip" type="prismatic"><parent link="band"/><child link="block"/><axis xyz="1 0 0"/>{SIZES}</joint>"""
SPRING = "forces: {spring: {kind: point_spring, between: [wall, block], stiffness: 50 N/m, free_length: 1 m}}\n"


@pytest.mark.parametrize("law", ["mu: 0.25, static_mu: 0.4", "constant: 4.905 N, static_constant: 7.848 N"])
def test_a_block_on_a_belt_sticks_and_slips_as_the_closed_form_says(write, law):
    """It sticks until the spring pulls with 0.4 m g, then swings about 0.25 m g / k until it is as fast as the belt."""
    k, m, speed, n = 50.0, 2.0, 0.1, 2.0 * 9.81
    omega, begins, swing = np.sqrt(k / m), 0.4 * n / k, (0.4 - 0.25) * n / k
    slipping = 2.0 / omega * (np.pi - np.arctan(omega * swing / speed))
    again = begins - 2.0 * swing
    problem = "{kind: forward, time: {end: 3.6 s, samples: 5}, motion: {belt: {law: constant_speed, speed: 0.1 m/s}}}"
    path = write(BELT, SPRING + f"friction: {{slip: {{{law}}}}}\n", problem, "slip, joint.slip.friction")
    result = pinarm.run(path)
    segments = result.outcome.motion.motion.segments
    found = np.diff([0.0, *(one.solution.end for one in segments[:3])])
    sticking = (begins - again) / speed
    # the tolerance of the integration is 1e-8
    assert found == pytest.approx([begins / speed, slipping, sticking], rel=1e-7)
    assert [one.system.friction.slip.direction for one in segments] == [(0,), (-1,), (0,), (-1,)]
    assert result.figures["friction"] < 1e-12


ARM = """
<link name="upper"><inertial><origin xyz="0 0 -1"/><mass value="2"/>
<inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<dynamics friction="{friction}"/></joint>"""


def test_a_stuck_arm_stays_where_it_is_in_few_steps(write):
    """Its friction is the moment of the weight, m g l sin; it does not creep, but for a last digit."""
    problem = "{kind: forward, time: {end: 100 s, samples: 5}, initial: {position: {pivot: 20 deg}}}"
    result = pinarm.run(write(ARM.format(friction=7.0), "", problem, "pivot, joint.pivot.friction"))
    assert result.figures["steps"] < 20
    assert np.ptp(result["pivot"].values) <= 1e-16
    assert result["joint.pivot.friction"].values == pytest.approx(2.0 * 9.81 * np.sin(np.radians(20.0)), rel=1e-14)


def test_a_pendulum_loses_its_amplitude_to_constant_friction(write):
    """Work of friction is the fall of potential energy, swing by swing, until a turning point sticks."""
    friction, weight = 2.0, 2.0 * 9.81
    problem = "{kind: forward, time: {end: 20 s, samples: 201}, initial: {position: {pivot: 60 deg}}}"
    result = pinarm.run(write(ARM.format(friction=friction), "", problem, "pivot, power.friction"))
    ends = result["pivot"].values[-1]
    segments = result.outcome.motion.motion.segments
    turns = [np.pi / 3, *(float(one.solution.states(np.array([one.solution.end]))[0][0, 0]) for one in segments[:-1])]
    lost = [weight * (np.cos(b) - np.cos(a)) for a, b in pairwise(turns)]
    assert lost == pytest.approx([friction * abs(b - a) for a, b in pairwise(turns)], rel=1e-6)
    assert abs(weight * np.sin(ends)) <= friction < abs(weight * np.sin(turns[-3]))
    assert result.figures["energy"] < 1e-7  # what friction takes is counted


INCLINE = f"""
<link name="block">{BODY.format(mass=1)}</link>
<joint name="slope" type="prismatic"><parent link="base"/><child link="block"/>
<origin rpy="0 {-float(np.radians(25.0))!r} 0"/><axis xyz="1 0 0"/>{SIZES}</joint>"""
PUSHED = """gravity: {magnitude: 800 m/s^2}
coordinates: {x: {kind: point, point: block, along: x}}
friction: {slope: {mu: 0.25, static_mu: 0.35}}
"""
BAND = "coordinate.x.effort, coordinate.x.effort.lower, coordinate.x.effort.upper"


def test_the_block_on_an_incline_of_the_textbook(write):
    """Beer and Johnston, Vector Mechanics for Engineers: Statics, sample problem 8.2: 800 N, pushed horizontally.

    780 N begin to move it up, 649 N keep it moving, and 80.0 N prevent it from sliding down.
    """
    held = pinarm.run(write(INCLINE, PUSHED, "{kind: statics, hold: {slope: 0 m}, drives: [x]}", BAND))
    assert round(float(held["coordinate.x.effort.upper"].values[0])) == 780
    assert round(float(held["coordinate.x.effort.lower"].values[0]), 1) == 80.0
    rest = np.arctan(0.35)
    exact = 800.0 * np.tan(np.radians(25.0) + np.array([-rest, rest]))
    sides = [held[f"coordinate.x.effort.{side}"].values[0] for side in ("lower", "upper")]
    assert sides == pytest.approx(exact, rel=1e-12)  # the iteration of the load ends below 1e-13
    assert any("coordinate.x.effort: friction holds any value" in note for note in held.notes())
    assert not any("self-locking" in note for note in held.notes())
    moving = "{kind: state, hold: {slope: 0 m}, velocity: {slope: 1 m/s}, drives: [x]}"
    up = pinarm.run(write(INCLINE, PUSHED, moving, BAND))
    assert round(float(up["coordinate.x.effort"].values[0])) == 649
    assert up["coordinate.x.effort.upper"].values == pytest.approx(up["coordinate.x.effort"].values, rel=1e-14)


FREE_WEDGE = f"""
<link name="wedge">{BODY.format(mass=3)}</link><link name="block">{BODY.format(mass=5)}</link>
<joint name="floor" type="prismatic"><parent link="base"/><child link="wedge"/><axis xyz="1 0 0"/>{SIZES}</joint>
<joint name="slope" type="prismatic"><parent link="wedge"/><child link="block"/>
<axis xyz="{{}} 0 {{}}"/>{SIZES}</joint>"""


@pytest.mark.parametrize("degrees", [10.0, 20.0, 37.0])
@pytest.mark.parametrize(("mu", "floor", "speed"), [(0.4, 0.9, -1.0), (0.3, 0.9, 1.0), (0.1, 0.05, 1.0)])
def test_a_block_slides_on_a_wedge_that_slides_or_sticks(write, degrees, mu, floor, speed):
    """Forces of wedge and block, along x and z; no effort acts along the floor but for what the block does."""
    c, s, sign, m = np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), np.sign(speed), 5.0
    press, rub = np.array([s, c]), -sign * mu * np.array([c, -s])  # on the block, over the force N normal to the slope
    right, up = -(press + rub)  # on the wedge, over N
    held = m * 9.81 * c  # N where the wedge is at rest
    holds = abs(held * right) <= floor * (3.0 * 9.81 - held * up)
    way = np.sign(right)
    # X'' = (N right - way floor (3 g - N up)) / 3, and N = m (g c + X'' s)
    part = 0.0 if holds else (right + way * floor * up) / 3.0
    free = 0.0 if holds else -way * floor * 9.81
    normal = m * (9.81 * c + free * s) / (1.0 - m * part * s)
    slides = free + normal * part
    along = 9.81 * s - sign * mu * normal / m - slides * c
    problem = f"{{kind: forward, time: {{end: 20 ms, samples: 3}}, initial: {{velocity: {{slope: {speed} m/s}}}}}}"
    friction = f"friction: {{slope: {{mu: {mu}}}, floor: {{mu: {floor}}}}}\n"
    result = pinarm.run(
        write(FREE_WEDGE.format(float(c), float(-s)), friction, problem, "slope, floor, joint.slope.friction")
    )
    assert result["joint.slope.friction"].values == pytest.approx(-sign * mu * normal, rel=1e-9)
    assert result["slope"].values[-1] == pytest.approx(speed * 0.02 + along * 2e-4, rel=1e-9)
    assert result["floor"].values[-1] == pytest.approx(slides * 2e-4, rel=1e-7, abs=1e-14)


def test_a_block_too_steep_to_be_pushed_up_is_refused(write):
    """Beyond 90 deg less the angle of friction no horizontal force moves it up: 25 deg and mu = 2.2, 65.6 deg."""
    mechanism = PUSHED.replace("mu: 0.25, static_mu: 0.35", "mu: 2.2")
    with pytest.raises(PinarmError, match=r"jams|do not determine each other"):
        pinarm.run(write(INCLINE, mechanism, "{kind: statics, hold: {slope: 0 m}, drives: [x]}", BAND))


def test_inverse_dynamics_knows_friction_by_the_direction_of_motion(write):
    law = "{law: trapezoid, from: 0 rad, to: 1 rad, acceleration: 1 rad/s^2}"
    problem = f"{{kind: inverse, time: {{end: 3 s, samples: 31}}, motion: {{pivot: {law}}}}}"
    outputs = "joint.pivot.effort, joint.pivot.effort.lower, joint.pivot.effort.upper"
    result = pinarm.run(write(ARM.format(friction=3.0), "", problem, outputs))
    q, a, v = (result[f"joint.pivot.{rate}"].values for rate in ("position", "acceleration", "velocity"))
    bare = 2.5 * a + 2.0 * 9.81 * np.sin(q)
    effort, lower, upper = (result[f"joint.pivot.effort{part}"].values for part in ("", ".lower", ".upper"))
    moves = (v != 0.0) | (a != 0.0)
    moves[result.trajectory.grid.t > 2.0 + 1e-9] = False
    assert moves.sum() > 15
    assert effort[moves] == pytest.approx(bare[moves] + 3.0, rel=1e-13)
    assert lower[v != 0.0] == pytest.approx(effort[v != 0.0], rel=1e-13)
    assert upper[moves & (a >= 0.0)] == pytest.approx(effort[moves & (a >= 0.0)], rel=1e-13)
    assert effort[~moves] == pytest.approx(bare[~moves], rel=1e-13)
    assert (lower[~moves], upper[~moves]) == (pytest.approx(bare[~moves] - 3.0), pytest.approx(bare[~moves] + 3.0))


SLIDE = """
pinarm: 1
title: slide
planar:
  points: {{O: [0, 0], X: [1 m, 0], P: [0, 0]}}
  ground: [O, X]
  links: {{block: {{points: [P], mass: 2 kg}}}}
  sliders: {{x: {{link: block, along: [O, X]}}}}
friction: {{x: {{mu: 0.2, static_mu: {static}}}}}
"""
RISE = "{law: cycloidal, from: 0 m, to: 0.1 m, duration: 10 s}"
SWING = "{law: harmonic, amplitude: 0.05 m, pulsation: 5 rad/s, phase: 20 deg}"


def slid(tmp_path, static, law):
    """Return a slide that follows a law, at three rows."""
    (tmp_path / "slide.yaml").write_text(SLIDE.format(static=static))
    problem = f"{{kind: inverse, time: {{end: 1 s, samples: 3}}, motion: {{x: {law}}}}}"
    text = f"pinarm: 1\nmechanism: slide.yaml\nproblem: {problem}\noutputs: [joint.x.effort]\n"
    (tmp_path / "scenario.yaml").write_text(text)
    return pinarm.run(tmp_path / "scenario.yaml")


@pytest.mark.parametrize("law", [RISE, SWING])
def test_a_motion_that_passes_rest_takes_the_effort_that_breaks_away(tmp_path, law):
    """``static_mu m g`` to either side, where a law begins at the first row or turns back between rows."""
    result, most = slid(tmp_path, 0.5, law), 0.5 * 2.0 * 9.81
    again = restore(result.save(tmp_path / "saved", plots=False))
    assert result.number("joint.x.effort.lower @ min")[0] == pytest.approx(-most, rel=1e-12)
    assert again.number("joint.x.effort.upper @ max")[0] == pytest.approx(most, rel=1e-12)


SLIDER_CRANK = """
pinarm: 1
title: crank
planar:
  points: {O: [0, 0], A: [0.1 m, 0], B: [0.4 m, 0], X: [1 m, 0]}
  ground: [O, X]
  links: {crank: {points: [O, A], mass: 1 kg}, rod: {points: [A, B], mass: 1 kg}, piston: {points: [B], mass: 2 kg}}
  sliders: {x: {link: piston, along: [O, X]}}
friction:
  x: {mu: 0.2, static_mu: 0.5}
  A: {mu: 0.1, static_mu: 0.3, radius: 10 mm}
"""


def cranked(tmp_path, problem):
    (tmp_path / "crank.yaml").write_text(SLIDER_CRANK)
    text = f"pinarm: 1\nmechanism: crank.yaml\nproblem: {problem}\noutputs: [joint.O.effort]\n"
    (tmp_path / "scenario.yaml").write_text(text)
    return pinarm.run(tmp_path / "scenario.yaml")


def test_a_crank_that_turns_back_is_held_there_as_at_rest(tmp_path):
    """At the instants of ``cos 3t = 0``, none of them a row, by the band of ``statics``; a dead centre has none."""
    law = "{law: harmonic, amplitude: 0.5 rad, pulsation: 3 rad/s, mean: 0.4 rad}"
    run = cranked(tmp_path, f"{{kind: inverse, time: {{end: 3 s, samples: 5}}, motion: {{O: {law}}}}}")
    t = np.array([0.5, 1.0, 2.0, 3.0, 4.0, 5.0]) * np.pi / 6.0
    rows = run.lookup.quantities_at(0, t)
    ends = np.array([rows[f"joint.O.effort.{end}"].values for end in ("lower", "upper")])
    passing = np.abs(np.cos(3.0 * t)) > 1e-3
    assert ends[0, passing] == pytest.approx(ends[1, passing], rel=1e-9)
    for k in np.flatnonzero(~passing):
        position = float(rows["joint.O.position"].values[k])
        held = cranked(tmp_path, f"{{kind: statics, hold: {{O: {position!r} rad}}, drives: [O]}}")
        for end, found in zip(("lower", "upper"), ends[:, k], strict=True):
            assert found == pytest.approx(held[f"joint.O.effort.{end}"].values[0], rel=1e-9)


def test_the_band_of_a_motion_counts_the_rotor_as_the_effort_does(write):
    """``(I + N^2 J) a + weight + friction`` where the arm moves, and 3 N*m to either side where it rests."""
    law = "{law: cycloidal, from: 0 rad, to: 1 rad, begin: 0.5 s, duration: 1 s}"
    problem = f"{{kind: inverse, time: {{end: 2 s, samples: 21}}, motion: {{pivot: {law}}}}}"
    drive = "drives: {motor: {joint: pivot, ratio: 100, rotor_inertia: 2e-4 kg*m^2}}\n"
    outputs = "joint.pivot.effort, joint.pivot.effort.lower, joint.pivot.effort.upper"
    result = pinarm.run(write(ARM.format(friction=3.0), drive, problem, outputs))
    q, a, v = (result[f"joint.pivot.{rate}"].values for rate in ("position", "acceleration", "velocity"))
    frictionless = (2.5 + 2.0) * a + 2.0 * 9.81 * np.sin(q)
    effort, lower, upper = (result[f"joint.pivot.effort{part}"].values for part in ("", ".lower", ".upper"))
    moves = v > 1e-3
    assert moves.sum() == 9
    assert np.abs(a[moves]).max() > 5.0
    for part in (effort, lower, upper):
        assert part[moves] == pytest.approx(frictionless[moves] + 3.0, rel=1e-12)
    rests = result.trajectory.grid.t < 0.5 - 1e-9
    assert upper[rests] - lower[rests] == pytest.approx(6.0, rel=1e-12)


SCREW = f"""
<link name="spindle">{BODY.format(mass=1)}</link><link name="nut">{BODY.format(mass=1)}</link>
<joint name="turn" type="continuous"><parent link="base"/><child link="spindle"/><axis xyz="0 0 1"/></joint>
<joint name="lift" type="prismatic"><parent link="base"/><child link="nut"/><axis xyz="0 0 1"/>{SIZES}</joint>"""
LOAD = """gravity: none
forces: {load: {kind: joint_effort, joint: lift, effort: {law: constant, value: -6.4 kN}}}
"""
COUPLED = "couplings: {thread: {kind: screw, joints: [turn, lift], lead: 8 mm}}\n"
LOOPED = "loops: {thread: {kind: screw, between: [spindle, nut], axis: z, lead: -8 mm}}\n"  # the nut does not turn
TORQUE = "joint.turn.effort, joint.turn.effort.lower, joint.turn.effort.upper"


def torque(thrust, lead, diameter, mu, flank=0.0):
    """Torque that raises a load on a thread."""
    angle = np.arctan(lead / (np.pi * diameter))
    normal = np.arctan(np.tan(flank) * np.cos(angle))
    return thrust * 0.5 * diameter * np.tan(angle + np.arctan(mu / np.cos(normal)))


@pytest.mark.parametrize(("joint", "flank"), [(COUPLED, 0.0), (LOOPED, 0.0), (COUPLED, 14.5)])
def test_the_power_screw_of_the_textbook(write, joint, flank):
    """Shigley's Mechanical Engineering Design, example 8-1: square thread, two starts of 4 mm, 32 mm, 6.4 kN, mu 0.08.

    On the thread alone 15.94 N*m raise the load, and it would come down by itself, but for 0.466 N*m.
    """
    mechanism = f"{LOAD}{joint}friction: {{thread: {{mu: 0.08, radius: 15 mm, flank: {flank} deg}}}}\n"
    statics = "{kind: statics, hold: {turn: 0 rad}, drives: [turn]}"
    held = pinarm.run(write(SCREW, mechanism, statics, TORQUE))
    lower, upper = (float(held[f"joint.turn.effort.{side}"].values[0]) for side in ("lower", "upper"))
    wanted = torque(6400.0, 0.008, 0.03, np.array([-0.08, 0.08]), np.radians(flank))
    assert [lower, upper] == pytest.approx(wanted, abs=3e-12 * wanted[1])  # the iteration of the load ends below 1e-13
    if not flank:
        assert (round(upper, 2), round(lower, 3)) == (15.94, 0.466)
    assert not any("self-locking" in note for note in held.notes())
    rougher = pinarm.run(write(SCREW, mechanism.replace("0.08", "0.09"), statics, TORQUE))
    assert any("joint.turn is self-locking" in note for note in rougher.notes())
    problem = "{kind: inverse, time: {end: 1 s, samples: 2}, motion: {turn: {law: constant_speed, speed: 3 rad/s}}}"
    turning = pinarm.run(write(SCREW, mechanism, problem, "joint.turn.effort, -power.load/joint.turn.power"))
    efficiency = 6400.0 * 0.008 / (2.0 * np.pi * wanted[1])
    assert turning["-power.load/joint.turn.power"].values == pytest.approx(efficiency, rel=3e-12)
    assert turning.figures["friction"] < 3e-12


NUT = ", ".join(f"joint.lift.effort{side}" for side in ("", ".lower", ".upper"))
HELD_AT_NUT = "{kind: statics, hold: {lift: 0 mm}, drives: [lift]}"


@pytest.mark.parametrize(
    ("joint", "thread", "further"),
    [
        (COUPLED, "mu: 0.09", ""),
        (LOOPED, "mu: 0.09, constant: 3 N", ""),  # no slip that begins is in balance
        (COUPLED, "mu: 0.08", ", turn: {mu: 0.1, radius: 20 mm, thrust_radius: 20 mm}"),  # the collar locks alone
        (COUPLED, "mu: 0.06", ", turn: {mu: 0.04, radius: 20 mm, thrust_radius: 20 mm}"),  # neither does
    ],
)
def test_no_effort_at_the_nut_turns_a_screw_that_locks_itself(write, joint, thread, further):
    """Statics tells it of any effort; motions under a thousand times the load, either way, do not begin."""
    rubs = f"friction: {{thread: {{radius: 15 mm, {thread}}}{further}}}\n"
    held = pinarm.run(write(SCREW, LOAD + joint + rubs, HELD_AT_NUT, NUT))
    assert [float(held[name].values[0]) for name in NUT.split(", ")] == pytest.approx([6400.0, -np.inf, np.inf])
    assert held.notes()[0].startswith("joint.lift is self-locking in 1 of 1 rows: friction grows with the effort")
    assert held.figures["equilibrium"] < 1e-13  # of 6400 N of drive and load, of which nothing is left
    entry = held.headline(held["joint.lift.effort.upper"])
    assert (entry["min"], entry["max"]) == (np.inf, np.inf)
    for load in ("6400 kN", "-6400 kN"):
        moved = write(SCREW, LOAD.replace("-6.4 kN", load) + joint + rubs, "{kind: forward, time: {end: 1 s}}", "lift")
        assert np.ptp(pinarm.run(moved)["lift"].values) < 1e-20  # m: the rounding of what friction holds


@pytest.mark.parametrize(("angle", "locks"), [(4.0, True), (20.0, False)])
def test_the_efficiency_of_a_worm_comes_out(write, angle, locks):
    """Shigley, section 13-17: ``(cos phi - mu tan L) / (cos phi + mu cot L)``, phi normal to the thread."""
    mu, lead, axial = 0.08, np.radians(angle), np.radians(20.0)
    normal = np.cos(np.arctan(np.tan(axial) * np.cos(lead)))
    expected = (normal - mu * np.tan(lead)) / (normal + mu / np.tan(lead))
    wheel = SCREW.replace("prismatic", "revolute").replace('<child link="nut"/><axis xyz="0 0 1"/>',
                                                           '<child link="nut"/><axis xyz="0 1 0"/>')  # fmt: skip
    mechanism = f"""gravity: none
forces: {{load: {{kind: joint_effort, joint: lift, effort: {{law: constant, value: -50 N*m}}}}}}
couplings: {{worm: {{kind: gear, joints: [turn, lift], ratio: 0.05}}}}
friction: {{worm: {{mu: {mu}, radius: 20 mm, lead_angle: {angle} deg, flank: 20 deg}}}}
"""
    problem = "{kind: inverse, time: {end: 1 s, samples: 2}, motion: {turn: {law: constant_speed, speed: 3 rad/s}}}"
    turning = pinarm.run(write(wheel, mechanism, problem, "-power.load/joint.turn.power"))
    assert turning["-power.load/joint.turn.power"].values == pytest.approx(expected, rel=1e-12)
    free = "{kind: forward, time: {end: 1 s, samples: 3}}"
    left_alone = pinarm.run(write(wheel, mechanism, free, "lift"))
    assert (np.ptp(left_alone["lift"].values) <= 1e-16) == locks


def test_an_arm_at_rest_breaks_loose_when_a_fast_load_says_so(write):
    """At rest nothing sets the steps: 6 N*m sin(200 t), growing at last beyond what friction and weight hold."""
    law = "{law: harmonic, amplitude: 6 N*m, pulsation: 200 rad/s}"
    mechanism = f"forces: {{shaker: {{kind: joint_effort, joint: pivot, effort: {law}}}}}\n"
    problem = "{kind: forward, time: {end: 0.1 s, samples: 3}, initial: {position: {pivot: 10 deg}}}"
    weight = 2.0 * 9.81 * np.sin(np.radians(10.0))
    held = pinarm.run(write(ARM.format(friction=weight + 6.001), mechanism, problem, "pivot"))
    assert np.ptp(held["pivot"].values) == 0.0
    shaken = pinarm.run(write(ARM.format(friction=weight + 5.999), mechanism, problem, "pivot"))
    first = shaken.outcome.motion.motion.segments[0].solution.end
    load = abs(weight - 6.0 * np.sin(200.0 * first))
    assert load == pytest.approx(weight + 5.999, rel=1e-9)
    assert first < 2.0 * np.pi / 200.0
    assert shaken["pivot"].values[-1] < held["pivot"].values[-1]


PULLEY = f"""
<link name="pulley">{BODY.format(mass=1e-3)}</link><link name="left"/><link name="right"/>
<joint name="shaft" type="continuous"><parent link="base"/><child link="pulley"/><axis xyz="0 1 0"/></joint>
<joint name="a" type="fixed"><parent link="pulley"/><child link="left"/><origin xyz="-0.2 0 0"/></joint>
<joint name="b" type="fixed"><parent link="pulley"/><child link="right"/><origin xyz="0.2 0 0"/></joint>"""


@pytest.mark.parametrize(("along", "axis"), [("z", "vertical"), ("x", "horizontal")])
def test_a_pulley_on_a_rough_shaft(write, along, axis):
    """500 N at 0.2 m, raised by a pull P at the same radius, on a shaft of 0.1 m radius with mu = 0.2.

    ``(P - 500) R = mu r F`` with the force F on the shaft: 611.1 N straight down, with ``F = P + 500``.
    """
    at, pull = ("right", "z") if along == "z" else ("top", "x")
    urdf = PULLEY + ('<link name="top"/><joint name="c" type="fixed"><parent link="pulley"/><child link="top"/>'
                     '<origin xyz="0 0 0.2"/></joint>')  # fmt: skip
    mechanism = f"""gravity: none
coordinates: {{pull: {{kind: point, point: {at}, along: {pull}}}}}
forces: {{load: {{kind: wrench, point: left, force: [0 N, 0 N, -500 N]}}}}
friction: {{shaft: {{mu: 0.2, radius: 100 mm}}}}
"""
    held = pinarm.run(write(urdf, mechanism, "{kind: statics, hold: {shaft: 0 rad}, drives: [pull]}",
                            "coordinate.pull.effort.lower, coordinate.pull.effort.upper"))  # fmt: skip
    sides = sorted(abs(float(held[f"coordinate.pull.effort.{side}"].values[0])) for side in ("lower", "upper"))
    if axis == "vertical":
        assert sides == pytest.approx([500.0 * 1.8 / 2.2, 500.0 * 2.2 / 1.8], rel=1e-12)
    else:
        for p, sign in zip(sides, (-1.0, 1.0), strict=True):
            assert (p - 500.0) * 0.2 == pytest.approx(sign * 0.2 * 0.1 * np.hypot(p, 500.0), rel=1e-11)


SHAFTS = """
<link name="first"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
</link><link name="second"><inertial><mass value="4"/><inertia ixx="1" iyy="1" izz="0.02" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<joint name="in" type="continuous"><parent link="base"/><child link="first"/><axis xyz="0 0 1"/></joint>
<joint name="out" type="continuous"><parent link="base"/><child link="second"/><origin xyz="0.15 0 0"/>
<axis xyz="0 0 1"/></joint>"""
BELTED = """gravity: none
couplings: {C: {kind: belt, joints: [in, out], radii: [50 mm, 100 mm], pretension: 3 N}}
friction: {C: {mu: 0.3}}
"""


def test_a_law_that_moves_against_two_frictions_at_rest_is_refused(write):
    """At rest a bearing and the belt hold the driven wheel; once the law moves, one of them must slip."""
    problem = ("{kind: forward, time: {end: 1 s, samples: 11}, "
               "motion: {in: {law: cycloidal, from: 0 rad, to: 6 rad, duration: 1 s}}}")  # fmt: skip
    path = write(SHAFTS, BELTED + "  out: {constant: 0.01 N*m}\n", problem, "out")
    path.with_name("mechanism.yaml").write_text(
        path.with_name("mechanism.yaml").read_text().replace("friction: {C: {mu: 0.3}}", "friction:\n  C: {mu: 0.3}")
    )
    with pytest.raises(PinarmError, match=r"friction holds .* at one instant, and a law moves them against each other"):
        pinarm.run(path)


DRAWER = f"""
<link name="drawer">{BODY.format(mass=1)}</link><link name="knob"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="drawer"/><axis xyz="1 0 0"/>{SIZES}</joint>
<joint name="k" type="fixed"><parent link="drawer"/><child link="knob"/><origin xyz="0 0.3 0"/></joint>"""


@pytest.mark.parametrize(("mu", "jams"), [(0.3, False), (0.4, True)])
def test_a_drawer_pulled_at_its_side_jams(write, mu, jams):
    """Pulled with P at 0.3 m off its middle, guided over 0.2 m: ``N1 = N2 = P 0.3 / 0.2``, so that it jams from
    ``2 mu 1.5 >= 1`` on; below, the friction against 10 N at its middle is ``P - 10 = 3 mu P``.
    """
    mechanism = f"""gravity: none
coordinates: {{pull: {{kind: point, point: knob, along: x}}}}
forces: {{load: {{kind: joint_effort, joint: slide, effort: {{law: constant, value: -10 N}}}}}}
friction: {{slide: {{mu: {mu}, span: 200 mm}}}}
"""
    path = write(DRAWER, mechanism, "{kind: state, hold: {slide: 0 m}, velocity: {slide: 1 m/s}, drives: [pull]}",
                 "coordinate.pull.effort")  # fmt: skip
    if jams:
        with pytest.raises(PinarmError, match="jams"):
            pinarm.run(path)
    else:
        assert pinarm.run(path)["coordinate.pull.effort"].values == pytest.approx(10.0 / (1.0 - 3.0 * mu), rel=1e-12)


CRANK = """
<link name="crank"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<link name="rod"><inertial><origin xyz="0.15 0 0"/><mass value="0.5"/>
<inertia ixx="0.004" iyy="0.004" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="piston"><inertial><mass value="0.4"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link>
<joint name="turn" type="continuous"><parent link="base"/><child link="crank"/><axis xyz="0 0 1"/></joint>
<joint name="swing" type="continuous"><parent link="crank"/><child link="rod"/><origin xyz="0.1 0 0"/>
<axis xyz="0 0 1"/></joint>
<link name="end"/><joint name="e" type="fixed"><parent link="rod"/><child link="end"/><origin xyz="0.3 0 0"/></joint>
<joint name="way" type="prismatic"><parent link="base"/><child link="piston"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="1e6" velocity="1e3"/></joint>"""
CLOSED = "gravity: none\nloops: {pin: {kind: revolute, between: [end, piston], axis: z}}\n"
RUBBING = """friction:
  turn: {mu: 0.1, static_mu: 0.15, radius: 30 mm}
  swing: {mu: 0.1, static_mu: 0.15, radius: 20 mm, constant: 0.05 N*m}
  pin: {mu: 0.1, static_mu: 0.15, radius: 20 mm}
  way: {mu: 0.1, static_mu: 0.15, constant: 3 N, undetermined: minimum_norm}
"""


@pytest.mark.slow
def test_a_slider_crank_runs_out_and_stands_still(write):
    """Energy and the law of friction, with the reactions of the rows, hold through all reversals until it stops."""
    problem = """{kind: forward, time: {end: 1 s, samples: 11},
  initial: {position: {turn: 40 deg}, velocity: {turn: 10 rad/s}}}"""
    result = pinarm.run(write(CRANK, CLOSED + RUBBING, problem, "turn, loop.pin.friction, power.friction"))
    assert result.figures["energy"] < 1e-7
    assert result.figures["friction"] < 1e-11
    ways = [one.system.friction.slip.direction for one in result.outcome.motion.motion.segments]
    assert len(ways) >= 3
    assert ways[-1] == (0, 0, 0, 0)
    assert all(0 not in way for way in ways[:-1])
    assert np.ptp(result["turn"].values[-4:]) == 0.0
    assert (result["power.friction"].values <= 0.0).all()


def test_friction_of_a_hyperstatic_joint_is_refused_without_a_rule(write):
    problem = "{kind: statics, hold: {turn: 40 deg}}"
    bare = RUBBING.replace(", undetermined: minimum_norm", "")
    with pytest.raises(PinarmError, match=r"the friction of joint\.way depends on a reaction that rigid"):
        pinarm.run(write(CRANK, CLOSED + bare, problem, "joint.turn.effort.upper"))
    forward = "{kind: forward, time: {end: 1 s, samples: 3}, initial: {position: {turn: 40 deg}}}"
    with pytest.raises(PinarmError, match="hyperstatic"):
        pinarm.run(write(CRANK, CLOSED + bare, forward, "turn"))


def test_a_rod_that_no_acceleration_lets_slide_on_is_refused_by_the_name_of_its_guide(write):
    """Painleve's rod, 60 deg steep, foot ahead: nothing is at rest that could stick or begin to slip."""
    urdf = f"""<link name="foot"/><link name="rod">{BODY.format(mass=2).replace("<mass", '<origin xyz="1 0 0"/><mass')}
</link><joint name="slide" type="prismatic"><parent link="base"/><child link="foot"/><axis xyz="1 0 0"/>{SIZES}</joint>
<joint name="pivot" type="continuous"><parent link="foot"/><child link="rod"/><axis xyz="0 0 1"/></joint>"""
    urdf = urdf.replace('ixx="1" iyy="1" izz="1"', 'ixx="0.6" iyy="0.6" izz="0.6"')
    mechanism = "gravity: {direction: -y}\nfriction: {slide: {mu: 2, undetermined: minimum_norm}}\n"
    start = "initial: {position: {pivot: 60 deg}, velocity: {slide: -1 m/s}}"
    with pytest.raises(PinarmError, match=r"no motion with slip of joint\.slide is possible"):
        pinarm.run(write(urdf, mechanism, f"{{kind: forward, time: {{end: 1 ms, samples: 2}}, {start}}}", "slide"))


def bars(*pins):
    """Bars one after the other, each drawn by its pin and the place of that pin on the bar before, or on the base."""
    return "".join(
        f'<link name="{pin}_bar">{BODY.format(mass=1)}</link><joint name="{pin}" type="continuous">'
        f'<parent link="{on}"/><child link="{pin}_bar"/><origin xyz="{x} {y} 0"/><axis xyz="0 0 1"/></joint>'
        for (pin, x, y), on in zip(pins, ("base", *(f"{pin}_bar" for pin, _, _ in pins)), strict=False)
    )


@pytest.mark.parametrize("closing", ["P", "C"])
def test_a_pin_that_sticks_with_several_motions_is_one_of_the_tree(write, closing):
    """A five-bar falls with a stuck pin; the refusal of one that closes the loop says to let it close elsewhere."""
    near, far = [("O", 0, 0), ("A", 0, 0.2)], [("C", 0.3, 0), ("B", 0, 0.2)]
    if closing == "P":
        urdf, ends = bars(*near) + bars(*far), "A_bar: [150 mm, 250 mm], B_bar: [-150 mm, 250 mm]"
    else:
        urdf = bars(*near, ("P", 0.15, 0.25), ("B", 0.15, -0.25))
        ends = "B_bar: [0 mm, -200 mm], base: [300 mm, 0 mm]"
    (one, first), (other, second) = (end.split(": [") for end in ends.split("], "))
    mechanism = f"""gravity: {{direction: -y}}
points: {{m: {{link: {one}, at: [{first}, 0 m]}}, n: {{link: {other}, at: [{second.rstrip("]")}, 0 m]}}}}
loops: {{{closing}: {{kind: revolute, between: [m, n], axis: z}}}}
friction: {{P: {{constant: 300 N*m}}}}
"""
    path = write(urdf, mechanism, "{kind: forward, time: {end: 0.1 s, samples: 2}, loads: {push: {kind: joint_effort, "
                 "joint: O, effort: {law: constant, value: 1 N*m}}}}", "O, A")  # fmt: skip
    if closing == "P":
        with pytest.raises(PinarmError, match=r"no joint of the tree stands still where loop\.P sticks") as caught:
            pinarm.run(path)
        assert "loops: that close at another joint" in caught.value.hint
    else:
        moved = pinarm.run(path)
        assert abs(moved["O"].values[-1]) > 1e-3
        assert np.ptp(moved["joint.P.position"].values) < 1e-12  # by rounding of the closure


def test_the_crank_of_a_loaded_slider_crank(write):
    """Without masses the rod is in line with its pins but for friction: ``T`` follows from the friction circles.

    The rod carries S between its ends at the angle b - g, ``sin g = 2 mu r / l``, as the journals' moments turn it.
    """
    loads = "forces: {gas: {kind: joint_effort, joint: way, effort: {law: constant, value: -1000 N}}}\n"
    mechanism = CLOSED + loads + "friction: {swing: {mu: 0.1, radius: 20 mm}, pin: {mu: 0.1, radius: 20 mm}}\n"
    angle = np.radians(60.0)
    held = pinarm.run(write(CRANK, mechanism, "{kind: statics, hold: {turn: 60 deg}}",
                            "joint.turn.effort.lower, joint.turn.effort.upper"))  # fmt: skip
    b = np.arcsin(0.1 / 0.3 * np.sin(angle))
    found = sorted(float(held[f"joint.turn.effort.{side}"].values[0]) for side in ("lower", "upper"))
    expected = []
    for sign in (1.0, -1.0):
        line = -b + sign * np.arcsin(2.0 * 0.1 * 0.02 / 0.3)  # of the force in the rod, from x
        force = 1000.0 / np.cos(line)
        pin = 0.1 * np.array([np.cos(angle), np.sin(angle)])
        push = -force * np.array([np.cos(line), np.sin(line)])  # of the rod on the crank
        moment = pin[0] * push[1] - pin[1] * push[0]
        expected.append(-(moment - sign * 0.1 * 0.02 * force))
    assert found == pytest.approx(sorted(expected), rel=1e-9)


def test_friction_of_a_thread_loads_its_bearings(write):
    """The nut's guide carries nothing along its axis but the load, the spindle's thrust bearing all of it."""
    problem = "{kind: inverse, time: {end: 1 s, samples: 2}, motion: {turn: {law: constant_speed, speed: 3 rad/s}}}"
    mechanism = LOAD + COUPLED + "friction: {thread: {mu: 0.08, radius: 15 mm}}\n"
    outputs = "joint.turn.force.z, joint.lift.moment.z, joint.turn.effort, joint.lift.effort"
    result = pinarm.run(write(SCREW, mechanism, problem, outputs))
    assert result["joint.turn.force.z"].values == pytest.approx(6400.0, rel=1e-12)
    assert result["joint.lift.moment.z"].values == pytest.approx(-result["joint.turn.effort"].values, rel=1e-12)
    for name in ("coupling.thread.axial", "coupling.thread.force.z", "joint.lift.effort"):
        assert result[name].values == pytest.approx(6400.0, rel=1e-12)
    raising = torque(6400.0, 0.008, 0.03, 0.08)
    assert result["coupling.thread.torque"].values == pytest.approx(raising, rel=1e-12)
    assert result["coupling.thread.moment.z"].values == pytest.approx(raising, rel=1e-12)
    assert result.figures["bodies"] < 1e-13


@pytest.mark.parametrize(("friction", "left_out"), [("", 1), ("friction: {slip: {mu: 0.3}}\n", 0)])
def test_nothing_is_left_out_where_friction_may_stick(write, friction, left_out):
    problem = """{kind: forward, time: {end: 1 s, samples: 3}, initial: {velocity: {belt: 0.1 m/s}},
  motion: {slip: {law: constant, value: 0 m}}}"""
    result = pinarm.run(write(BELT, friction, problem, "joint.belt.velocity"))
    assert len(result.removals) == left_out
    assert result["joint.belt.velocity"].values == pytest.approx(0.1, rel=1e-12)


def test_a_block_at_rest_on_its_belt_has_the_band_of_efforts_that_holds_it(write):
    problem = """{kind: inverse, time: {end: 1 s, samples: 3}, motion: {
  belt: {law: constant_speed, speed: 0.1 m/s}, slip: {law: constant, value: 0 m}}}"""
    result = pinarm.run(write(BELT, "friction: {slip: {mu: 0.3}}\n", problem, "joint.belt.effort"))
    assert result["joint.slip.effort.upper"].values == pytest.approx(0.3 * 2.0 * 9.81, rel=1e-12)
