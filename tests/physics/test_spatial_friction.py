"""Friction against slips with several components, in cylindrical and ball joints, against closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pinarm
from pinarm.errors import PinarmError
from tests.physics.test_friction import CLOSED, CRANK

MU, RADIUS, MASS, INERTIA, WEIGHT = 0.2, 0.03, 2.0, 0.004, 2.0 * 9.81
SIMPLE = (
    ("x", "prismatic", "1 0 0"), ("y", "prismatic", "0 1 0"), ("way", "prismatic", "0 0 1"),
    ("tilt_x", "continuous", "1 0 0"), ("tilt_y", "continuous", "0 1 0"), ("spin", "continuous", "0 0 1"),
)  # fmt: skip


def floating(inertia=INERTIA, mass=MASS):
    """Return a collar on six simple joints, so that its bearing is a loop joint whose load is determined."""
    parent, parts = "base", []
    for name, kind, axis in SIMPLE:
        link = "collar" if name == "spin" else f"{name}_link"
        body = f"""<inertial><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.01" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial>"""
        parts.append(f"""<link name="{link}">{body if name == "spin" else ""}</link>
<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{link}"/><axis xyz="{axis}"/>
<limit lower="-1e4" upper="1e4" effort="1e6" velocity="1e3"/></joint>""")
        parent = link
    return "".join(parts)


CYLINDER = f"""gravity: {{direction: -x}}
loops: {{sleeve: {{kind: cylindrical, between: [base, collar], axis: z}}}}
friction: {{sleeve: {{mu: {MU}, static_mu: 0.25, radius: {RADIUS} m}}}}
"""
PARTS = "loop.sleeve.friction.tangential, loop.sleeve.friction.axial"


@pytest.mark.parametrize(("omega", "speed"), [(0.0, -0.3), (5.0, 0.0), (-7.0, 0.1)])
def test_a_collar_that_turns_is_easier_to_push(write, omega, speed):
    """Friction ``mu m g`` against the slip ``(r omega, z')``: its axial part is ``mu m g z' / |u|``."""
    problem = f"""{{kind: state, hold: {{way: 0.1 m, spin: 0.4 rad}}, drives: [way, spin],
  velocity: {{way: {speed} m/s, spin: {omega} rad/s}}}}"""
    found = pinarm.run(write(floating(), CYLINDER, problem, f"joint.way.effort, joint.spin.effort, {PARTS}"))
    slip = np.array([RADIUS * omega, speed])
    expected = MU * WEIGHT * slip / np.linalg.norm(slip)
    assert found["joint.way.effort"].values[0] == pytest.approx(expected[1], rel=1e-12, abs=1e-14)
    assert found["joint.spin.effort"].values[0] == pytest.approx(RADIUS * expected[0], rel=1e-12, abs=1e-14)
    told = [found[f"loop.sleeve.friction.{part}"].values[0] for part in ("tangential", "axial")]
    assert told == pytest.approx(-expected, rel=1e-12, abs=1e-13)
    assert found.figures["friction"] < 1e-13


def test_a_collar_at_rest_is_held_by_a_band(write):
    """By 0.25 m g along its axis; about it by that times the radius."""
    problem = "{kind: statics, hold: {way: 0.1 m, spin: 0.4 rad}, drives: [way, spin]}"
    outputs = "joint.way.effort.lower, joint.way.effort.upper, joint.spin.effort.upper"
    found = pinarm.run(write(floating(), CYLINDER, problem, outputs))
    sides = [found[f"joint.{side}"].values[0] for side in ("way.effort.lower", "way.effort.upper", "spin.effort.upper")]
    assert sides == pytest.approx(0.25 * WEIGHT * np.array([-1.0, 1.0, RADIUS]), rel=1e-12)


@pytest.mark.slow
def test_a_collar_thrown_along_its_shaft_slides_in_a_curve(write):
    """Against the plane equations of its motion, ``J w' = - r mu m g r w / |u|``, ``m z'' = P - mu m g z' / |u|``."""
    push = 10.0
    mechanism = CYLINDER + (
        f"forces: {{push: {{kind: joint_effort, joint: way, effort: {{law: constant, value: {push} N}}}}}}\n"
    )
    problem = (
        """{kind: forward, time: {end: 0.5 s, samples: 6}, initial: {velocity: {way: -0.8 m/s, spin: 20 rad/s}}}"""
    )
    found = pinarm.run(write(floating(), mechanism, problem, "way, spin, power.friction"))

    def rates(t, y):
        slip = np.array([RADIUS * y[3], y[2]])
        f = -MU * WEIGHT * slip / np.linalg.norm(slip)
        return [y[2], y[3], (push + f[1]) / MASS, RADIUS * f[0] / INERTIA]

    t = found.trajectory.grid.t
    solved = solve_ivp(rates, (0.0, 0.5), [0.0, 0.0, -0.8, 20.0], rtol=1e-11, atol=1e-13, dense_output=True).sol(t)
    assert found["way"].values == pytest.approx(solved[0], abs=1e-7)  # the tolerance of the integration is 1e-8
    assert found["spin"].values == pytest.approx(solved[1], abs=1e-6)
    assert found.figures["friction"] < 1e-12
    assert len(found.outcome.motion.motion.segments) > 1  # its slip turns by more than 60 deg


@pytest.mark.slow
def test_rest_with_more_than_one_motion_is_refused(write):
    """Where the collar comes to rest, and where it is at rest at first."""
    for start, said in (("{velocity: {way: 0.8 m/s, spin: 40 rad/s}}", r"t = 1\.44188[67]\d* s.*at rest and may begin"),
                        ("{}", "t = 0 s.*at rest and may begin")):  # fmt: skip
        problem = f"{{kind: forward, time: {{end: 9 s, samples: 6}}, initial: {start}}}"
        with pytest.raises(PinarmError, match=said):
            pinarm.run(write(floating(), CYLINDER, problem, "way"))


LEAD = 0.05
NUT = CYLINDER + f"couplings: {{thread: {{kind: screw, joints: [spin, way], lead: {LEAD} m}}}}\n"
"""The collar slips along one helix: ``z = h spin``."""
RISE = LEAD / (2.0 * np.pi)
LENGTH = np.hypot(RADIUS, RISE)
"""Slip per angle."""


@pytest.mark.slow
def test_a_collar_with_one_motion_sticks_and_slips(write):
    """A push P along the shaft moves it from ``P h = 0.25 m g |c|`` on, ``c = (r, h)``; then ``mu m g |c|`` resists."""
    problem = "{kind: statics, hold: {spin: 0.4 rad}, drives: [way]}"
    band = pinarm.run(write(floating(), NUT, problem, "joint.way.effort.lower, joint.way.effort.upper"))
    limit = float(0.25 * WEIGHT * LENGTH / RISE)
    assert band["joint.way.effort.upper"].values[0] == pytest.approx(limit, rel=1e-11)
    assert band["joint.way.effort.lower"].values[0] == pytest.approx(-limit, rel=1e-11)
    for push, moves in ((0.999 * limit, False), (1.001 * limit, True)):
        law = f"{{law: constant, value: {push!r} N}}"
        mechanism = NUT + f"forces: {{push: {{kind: joint_effort, joint: way, effort: {law}}}}}\n"
        problem = "{kind: forward, time: {end: 0.2 s, samples: 3}}"
        found = pinarm.run(write(floating(), mechanism, problem, f"spin, {PARTS}"))
        acceleration = (push * RISE - MU * WEIGHT * LENGTH) / (INERTIA + MASS * RISE**2)
        expected = 0.5 * acceleration * 0.2**2 if moves else 0.0
        # below abs: rounding of a collar that sticks
        assert found["spin"].values[-1] == pytest.approx(expected, rel=1e-7, abs=1e-20)
        if not moves:
            parts = np.array([found[f"loop.sleeve.friction.{part}"].values for part in ("tangential", "axial")]).T
            assert parts == pytest.approx(
                np.tile(-push * RISE / LENGTH**2 * np.array([RADIUS, RISE]), (3, 1)), rel=1e-10
            )


BALL = f"""gravity: {{direction: -z}}
friction: {{ball: {{mu: {MU}, radius: {RADIUS} m, preload: 5 N}}}}
"""
TOP = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="top"><joint name="ball" type="ball"/>
<inertial pos="0 0 0" mass="2" diaginertia="0.01 0.01 0.004"/></body></worldbody></mujoco>"""
LOOSE = BALL + "loops: {ball: {kind: spherical, between: [base, collar]}}\n"
MOMENT = MU * RADIUS * (WEIGHT + 5.0)
OMEGA = np.array([3.0, -4.0, 12.0])


@pytest.fixture
def ball(write, tmp_path):
    """Return what writes a ball joint of the tree or of a loop with its start, by the names of its velocities."""

    def written(loop, problem, outputs):
        names = ("tilt_x", "tilt_y", "spin") if loop else tuple(f"ball.angular_velocity.{x}" for x in "xyz")
        given = ", ".join(f"{name}: {value} rad/s" for name, value in zip(names, OMEGA, strict=True))
        path = write(floating(), LOOSE if loop else BALL, problem.replace("GIVEN", given), outputs)
        if not loop:
            (tmp_path / "model.urdf").unlink()
            (tmp_path / "model.xml").write_text(TOP)
            (tmp_path / "mechanism.yaml").write_text("pinarm: 1\nrobot: model.xml\n" + BALL)
        return path

    return written


@pytest.mark.parametrize("loop", [False, True])
def test_a_ball_resists_with_a_moment_against_its_angular_velocity(ball, loop):
    """``mu R (m g + preload)`` along the angular velocity; of slips of 13 rad/s."""
    problem = "{kind: forward, time: {end: 0.01 s, samples: 2}, initial: {velocity: {GIVEN}}}"
    kind = "loop" if loop else "joint"
    outputs = ", ".join(f"{kind}.ball.friction.{x}" for x in "xyz")
    found = pinarm.run(ball(loop, problem, f"{outputs}, power.friction"))
    told = np.array([found[f"{kind}.ball.friction.{x}"].values[0] for x in "xyz"])
    assert told == pytest.approx(-MOMENT * OMEGA / 13.0, rel=1e-12)
    assert found["power.friction"].values[0] == pytest.approx(-MOMENT * 13.0, rel=1e-12)
    assert found.figures["friction"] < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("loop", [False, True])
def test_a_ball_runs_out_by_eulers_equations(ball, loop):
    """``I w' + w x I w = - M w / |w|`` in the axes of the body; at rest what holds it is refused."""
    problem = "{kind: forward, time: {end: 0.2 s, samples: 3}, initial: {velocity: {GIVEN}}}"
    outputs = "body.collar.angular_velocity.norm" if loop else "body.top.angular_velocity.norm"
    found = pinarm.run(ball(loop, problem, outputs))
    size = np.array([0.01, 0.01, 0.004])

    def rates(t, w):
        return (-np.cross(w, size * w) - MOMENT * w / np.linalg.norm(w)) / size

    solved = solve_ivp(rates, (0.0, 0.2), OMEGA, rtol=1e-11, atol=1e-13, t_eval=[0.0, 0.1, 0.2])
    assert found[outputs].values == pytest.approx(np.linalg.norm(solved.y, axis=0), rel=1e-6)
    with pytest.raises(PinarmError, match=r"ball is at rest and may begin to slip in more than one direction"):
        pinarm.run(ball(loop, problem.replace("0.2 s", "9 s"), outputs))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["spherical", "cylindrical, axis: z"])
def test_in_a_plane_mechanism_they_are_as_a_pin(write, kind):
    """A slider-crank that runs out and stands still: the same motion, friction and rest as with a revolute joint."""
    problem = """{kind: forward, time: {end: 1.4 s, samples: 15},
  initial: {position: {turn: 40 deg}, velocity: {turn: 10 rad/s}}}"""
    friction = """friction:
  turn: {mu: 0.1, static_mu: 0.15, radius: 30 mm, constant: 0.3 N*m}
  pin: {mu: 0.1, static_mu: 0.15, radius: 20 mm, undetermined: minimum_norm}
"""
    closed = CLOSED.replace("revolute, between: [end, piston], axis: z", f"{kind}, between: [end, piston]")
    pin = pinarm.run(write(CRANK, CLOSED + friction, problem, "turn, power.friction"))
    other = pinarm.run(write(CRANK, closed + friction, problem, "turn, power.friction"))
    assert len(pin.outcome.motion.motion.segments) == 3  # the pin turns back, then all stands still
    assert other["turn"].values == pytest.approx(pin["turn"].values, abs=1e-7)
    assert other["power.friction"].values == pytest.approx(pin["power.friction"].values, abs=1e-6)
    assert np.ptp(other["turn"].values[-4:]) == 0.0
    assert other.figures["friction"] < 1e-9
