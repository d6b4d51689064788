"""Journals beside teeth that change flanks and belts with a slack strand: a scalar equation tells the side, bracketed.

Teeth press wheels apart with ``|F_t| tan(alpha)``, a strand that would be pushed carries nothing: what a journal
carries depends on a sign that depends on its friction.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

import pinarm

BODY = """<link name="{name}"><inertial><origin xyz="{arm} 0 0"/><mass value="{mass}"/>
<inertia ixx="2e-3" iyy="2e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{name}" type="continuous"><parent link="base"/><child link="{name}"/><origin xyz="{at} 0 0"/>
<axis xyz="0 0 1"/></joint>"""
GRAVITY, J, MASS, MU, RADIUS = 9.81, 2e-3, 2.0, 0.3, 0.05

R1, R2, ARM, PRESSED = 0.04, 0.08, 0.02, np.tan(np.radians(28.0))
GEAR = BODY.format(name="a", arm=0, mass=1, at=0) + BODY.format(name="b", arm=ARM, mass=MASS, at=R1 + R2)
MESH = """gravity: {{direction: {down}, magnitude: 9.81 m/s^2}}
couplings: {{C: {{kind: gear, joints: [ja, jb], ratio: -0.5, pressure_angle: 28 deg}}}}
friction: {{jb: {{mu: 0.3, radius: 50 mm}}}}
"""


def unbalanced(
    force: float, angle: float, speed: float, rate: float, turning: float, mu: float = MU, radius: float = RADIUS
) -> float:
    """Return what is left of the moments on the second wheel under a force of the teeth, the first one turning so.

    ``turning`` is the sense in which the journal slips.
    """
    angle, speed, rate = -0.5 * angle, -0.5 * speed, -0.5 * rate
    arm = ARM * np.array([np.cos(angle), np.sin(angle)])
    demand = MASS * (rate * np.array([-arm[1], arm[0]]) - speed**2 * arm + np.array([0.0, GRAVITY]))
    carried = np.hypot(*(demand - np.array([abs(force) * PRESSED, force])))
    return (J + MASS * ARM**2) * rate + R2 * force + arm[0] * MASS * GRAVITY + turning * mu * radius * carried


def teeth(angle: float, speed: float, rate: float, turning: float) -> float:
    """Return the effort at the first wheel; see ``unbalanced``."""
    return J * rate + R1 * brentq(unbalanced, -500.0, 500.0, args=(angle, speed, rate, turning), xtol=1e-13)


ANGLES = np.linspace(0.0, 12.0, 25)


@pytest.mark.parametrize("speed", [5.0, -5.0])
def test_efforts_of_wheels_that_turn_hold_on_both_flanks(speed, write):
    problem = "{{kind: state, hold: {{ja: {} rad}}, velocity: {{ja: {} rad/s}}, acceleration: {{ja: 3 rad/s^2}}}}"
    for angle in ANGLES[::6].tolist():
        path = write(GEAR, MESH.format(down="-y"), problem.format(angle, speed), "joint.ja.effort")
        found = pinarm.run(path)["joint.ja.effort"].values[0]
        assert found == pytest.approx(teeth(angle, speed, 3.0, -np.sign(speed)), rel=1e-12, abs=1e-12)


def band(write, gear: str, mechanism: str, angles: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the band that friction holds, over the angle of the first wheel."""
    problem = f"{{kind: statics, over: {{ja: {angles}}}}}"
    result = pinarm.run(write(gear, mechanism, problem, "ja, joint.ja.effort.lower, joint.ja.effort.upper"))
    return result["joint.ja.effort.lower"].values, result["joint.ja.effort.upper"].values


UP, DOWN = "{from: 0 rad, to: 12 rad, samples: 25}", "{from: -12 rad, to: 0 rad, samples: 25}"


def test_bands_of_wheels_hold_on_both_flanks(write):
    lower, upper = band(write, GEAR, MESH.format(down="-y"), UP)
    assert lower == pytest.approx([teeth(angle, 0.0, 0.0, 1.0) for angle in ANGLES], rel=1e-11)
    assert upper == pytest.approx([teeth(angle, 0.0, 0.0, -1.0) for angle in ANGLES], rel=1e-11)


@pytest.mark.parametrize("turning", [1.0, -1.0])
@pytest.mark.parametrize("angle", [1.5, 4.5])
def test_a_wheel_sticks_up_to_the_end_of_the_band_and_moves_beyond(angle, turning, write):
    """Beyond it the first acceleration is that of the scalar equation, solved for the rate that the effort takes."""

    def started(effort: float) -> tuple[float, float]:
        problem = (
            f"{{kind: forward, time: {{end: 1 ms, samples: 2}}, initial: {{position: {{ja: {angle} rad}}}}, "
            f"loads: {{M: {{kind: joint_effort, joint: ja, effort: {{law: constant, value: {effort!r} N*m}}}}}}}}"
        )
        result = pinarm.run(write(GEAR, MESH.format(down="-y"), problem, "ja, joint.ja.acceleration"))
        return float(result["joint.ja.acceleration"].values[0]), float(np.ptp(result["ja"].values))

    end = teeth(angle, 0.0, 0.0, -turning)
    assert started(end - 1e-3 * turning) == (0.0, 0.0)
    effort = end + 1e-3 * turning
    rate = brentq(lambda x: teeth(angle, 0.0, x, -turning) - effort, -1e3, 1e3, xtol=1e-13)
    assert started(effort)[0] == pytest.approx(rate, rel=1e-8)


S1, S2, DISTANCE, F0 = 0.05, 0.1, 0.3, 5.0
PULLED = """gravity: {direction: -y, magnitude: 9.81 m/s^2}
couplings: {C: {kind: belt, joints: [ja, jb], radii: [50 mm, 100 mm], pretension: 5 N}}
friction: {jb: {mu: 0.3, radius: 50 mm}}
"""


def strands(difference: float) -> tuple[np.ndarray, float]:
    """Return the force of both strands on the second wheel and their moment about it."""
    tight, slack = F0 + 0.5 * abs(difference), F0 - 0.5 * abs(difference)
    if slack < 0.0:
        tight, slack = abs(difference), 0.0
    cosine, force, moment = (S1 - S2) / DISTANCE, np.zeros(2), 0.0
    for side in (1.0, -1.0):
        normal = np.array([cosine, side * np.sqrt(1.0 - cosine**2)])
        way = S1 * normal - np.array([DISTANCE, 0.0]) - S2 * normal
        way /= np.hypot(*way)
        turns = S2 * (normal[0] * way[1] - normal[1] * way[0])
        tension = tight if (turns > 0.0) == (difference > 0.0) else slack
        force, moment = force + tension * way, moment + tension * turns
    return force, moment


def test_the_journal_of_a_wheel_on_a_belt_that_slips_carries_both_strands(write):
    """The belt pulls with ``2 F0 tanh(mu theta / 2)``, less than 2 F0: neither strand is slack, F0 acts as ever."""
    pull = 2.0 * F0 * np.tanh(0.5 * 0.3 * (np.pi - 2.0 * np.arcsin((S2 - S1) / DISTANCE)))
    problem = ("{kind: forward, time: {end: 1 ms, samples: 2}, "
               "motion: {ja: {law: constant_speed, from: 3 rad, speed: 300 rad/s}}}")  # fmt: skip
    friction = PULLED.replace("jb: {mu: 0.3, radius: 50 mm}", "jb: {mu: 0.1, radius: 20 mm}, C: {mu: 0.3}")
    gear = BODY.format(name="a", arm=0, mass=1, at=0) + BODY.format(name="b", arm=0, mass=MASS, at=DISTANCE)
    result = pinarm.run(write(gear, friction, problem, "jb, joint.jb.acceleration"))
    force, moment = strands(pull)
    carried = np.hypot(*(np.array([0.0, MASS * GRAVITY]) - force))
    assert abs(moment) == pytest.approx(S2 * pull, rel=1e-12)
    rate = (S2 * pull - 0.1 * 0.02 * carried) / J
    assert result["joint.jb.acceleration"].values[0] == pytest.approx(rate, rel=1e-10)
