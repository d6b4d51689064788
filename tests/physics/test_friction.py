"""Friction that sticks, against closed forms and printed numbers."""

from itertools import pairwise

import numpy as np
import pytest

import pinarm
from pinarm.errors import PinarmError

SIZES = '<limit lower="-1e4" upper="1e4" effort="1e6" velocity="1e3"/>'
BODY = '<inertial><mass value="{mass}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


@pytest.fixture
def write(tmp_path):
    """Write a model, its mechanism file and a scenario; return the scenario's path."""
    (tmp_path / ".pinarm-root").touch()

    def write(urdf, mechanism, problem, outputs):
        (tmp_path / "model.urdf").write_text(f'<robot name="r"><link name="base"/>{urdf}</robot>')
        (tmp_path / "mechanism.yaml").write_text(f"pinarm: 1\nrobot: model.urdf\n{mechanism}")
        text = f"pinarm: 1\nmechanism: mechanism.yaml\nproblem: {problem}\noutputs: [{outputs}]\n"
        (tmp_path / "scenario.yaml").write_text(text)
        return tmp_path / "scenario.yaml"

    return write


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
    assert [one.system.slip.direction for one in segments] == [(0,), (-1,), (0,), (-1,)]
    assert result.figures["friction"] < 1e-12


ARM = """
<link name="upper"><inertial><origin xyz="0 0 -1"/><mass value="2"/>
<inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<dynamics friction="{friction}"/></joint>"""


def test_a_stuck_arm_stays_where_it_is_in_one_step(write):
    """Its friction is the moment of the weight, m g l sin; it does not creep at all."""
    problem = "{kind: forward, time: {end: 100 s, samples: 5}, initial: {position: {pivot: 20 deg}}}"
    result = pinarm.run(write(ARM.format(friction=7.0), "", problem, "pivot, joint.pivot.friction"))
    assert result.figures["steps"] == 1
    assert np.ptp(result["pivot"].values) == 0.0
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
    assert sides == pytest.approx(exact, rel=1e-13)
    assert any("coordinate.x.effort: friction holds any value" in note for note in held.notes())
    assert not any("self-locking" in note for note in held.notes())
    moving = "{kind: state, hold: {slope: 0 m}, velocity: {slope: 1 m/s}, drives: [x]}"
    up = pinarm.run(write(INCLINE, PUSHED, moving, BAND))
    assert round(float(up["coordinate.x.effort"].values[0])) == 649
    assert up["coordinate.x.effort.upper"].values == pytest.approx(up["coordinate.x.effort"].values, rel=1e-14)


def test_a_block_that_friction_holds_is_told_to_be_self_locking(write):
    mechanism = PUSHED.replace("static_mu: 0.35", "static_mu: 0.5")  # tan 25 deg is 0.466
    held = pinarm.run(write(INCLINE, mechanism, "{kind: statics, hold: {slope: 0 m}, drives: [x]}", BAND))
    assert held["coordinate.x.effort.lower"].values[0] < 0.0
    assert any("coordinate.x is self-locking in 1 of 1 rows" in note for note in held.notes())


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
    assert lower[moves] == pytest.approx(effort[moves], rel=1e-13)
    assert effort[~moves] == pytest.approx(bare[~moves], rel=1e-13)
    assert (lower[~moves], upper[~moves]) == (pytest.approx(bare[~moves] - 3.0), pytest.approx(bare[~moves] + 3.0))


def test_states_of_their_own_have_the_same_friction(write):
    path = write(ARM.format(friction=3.0), "", "{kind: statics, hold: {pivot: 0 rad}}", "pivot")
    mechanism = pinarm.load(path).mechanism
    q, v = np.array([[0.1], [0.1], [0.2]]), np.array([[0.0], [-1.0], [0.0]])
    weight = 2.0 * 9.81 * np.sin(q)
    assert mechanism.inverse(q, v, np.zeros((3, 1))) == pytest.approx(weight + 3.0 * np.sign(v), rel=1e-14)
    slips = np.where(v < 0.0, 3.0, np.where(np.abs(weight) > 3.0, 3.0, weight))
    assert mechanism.forward(q, v) == pytest.approx((slips - weight) / 2.5, abs=1e-14)
    at = mechanism.at(q, v, tau=np.zeros((3, 1)))
    assert at["joint.pivot.friction"].values == pytest.approx(slips[:, 0], rel=1e-13)
    assert at["joint.pivot.effort"].values == pytest.approx(0.0, abs=1e-14)
