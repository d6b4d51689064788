"""Rolling without slip and knife edges, against closed forms and equations that textbooks derive otherwise."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import pinarm
from pinarm.engine.linear.derivatives import complex_kept
from pinarm.errors import InputError, PinarmError

RADIUS, MASS, ACROSS, AXIAL, GRAVITY = 0.15, 2.0, 0.01125, 0.0225, 9.81
"""A homogeneous disc: radius [m], mass [kg], moments of inertia about a diameter and the axis [kg m^2]."""

CHAIN = """<robot name="chain"><link name="ground"/>
  {links}<link name="body"><inertial><origin xyz="{ahead} 0 0"/><mass value="{mass}"/>
    <inertia ixx="{across}" iyy="{axial}" izz="{across}" ixy="0" ixz="0" iyz="0"/></inertial></link>{joints}</robot>"""

AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1", "yaw": "0 0 1", "lean": "1 0 0", "spin": "0 1 0"}
"""Joints of a body, in the order from the ground, and their axes."""


@pytest.fixture
def body(tmp_path):
    """Return a function that writes a body on the joints of some names, and what its mechanism file says."""

    def write(*names, ahead=0.0, across=ACROSS, **description):
        links = [*(f"l{k}" for k in range(1, len(names))), "body"]
        joints = "".join(
            f'<joint name="{name}" type="{"prismatic" if name in ("x", "y", "z") else "continuous"}">'
            f'<parent link="{parent}"/><child link="{child}"/><axis xyz="{AXES[name]}"/>'
            '<limit effort="1" velocity="1" lower="-1000" upper="1000"/></joint>'
            for name, parent, child in zip(names, ["ground", *links[:-1]], links, strict=True)
        )
        own = "".join(f'<link name="{link}"/>' for link in links[:-1])
        text = CHAIN.format(links=own, joints=joints, ahead=ahead, mass=MASS, across=across, axial=AXIAL)
        (tmp_path / "body.urdf").write_text(text)
        return {"pinarm": 1, "robot": "body.urdf", **description}

    return write


@pytest.fixture
def disc(body):
    """What the mechanism file of a rolling disc says."""
    contact = {"kind": "rolling", "between": ["ground", "body"], "radius": f"{RADIUS} m"}
    return body(*AXES, loops={"contact": contact}, start={"z": f"{RADIUS} m"})


def run(folder, mechanism, problem):
    """Run a problem of a mechanism written here."""
    import json

    (folder / "mechanism.yaml").write_text(json.dumps(mechanism))
    (folder / "scenario.yaml").write_text(
        json.dumps({"pinarm": 1, "mechanism": "mechanism.yaml", "problem": problem, "outputs": ["energy.total"]})
    )
    return pinarm.run(folder / "scenario.yaml")


def load(folder, mechanism):
    import json

    (folder / "mechanism.yaml").write_text(json.dumps(mechanism))
    return pinarm.Mechanism.load(folder / "mechanism.yaml")


def values(result, name):
    return np.asarray(result[name])


def test_drifts_and_the_gap_are_those_of_the_rows(disc, tmp_path):
    mechanism = load(tmp_path, disc)
    model, closure = mechanism.model, mechanism.closure
    q, v = np.random.default_rng(5).normal(scale=0.5, size=(2, model.nv))

    def along(s):
        return pin.integrate(model, q, s * v)

    state, h = closure.state(q, v), 1e-5
    rows, gaps = ([what(closure.state(along(s))) for s in (h, -h)] for what in (closure.rows, closure.gap))
    assert closure.drift(state) == pytest.approx((rows[0] - rows[1]) @ v / (2.0 * h), abs=1e-8)
    rate = (gaps[0] - gaps[1]) / (2.0 * h)
    assert rate[0] == pytest.approx(closure.rows(state)[0] @ v, abs=1e-8)
    assert not rate[1:].any()
    many = closure.constraint_rows.at(np.array([q, along(0.1)]))
    assert many.matrices[0] == pytest.approx(closure.rows(state), abs=1e-14)
    assert many.drifts(np.array([v, v]))[0] == pytest.approx(closure.drift(state), abs=1e-13)
    with complex_kept():
        step = closure.constraint_rows.at((q + 1e-30j * v)[None]).matrices[0]
    assert step.imag @ v / 1e-30 == pytest.approx(closure.drift(state), abs=1e-12)


def test_a_disc_rolls_as_by_the_equations_in_euler_angles(disc, tmp_path):
    """O'Reilly, The dynamics of rolling disks and sliding disks, Nonlinear Dynamics 10 (1996), angles as in there.

    theta is the angle of the axis against the vertical, phi that of the heading, Omega the axial angular velocity.
    """
    inertia = MASS * RADIUS**2

    def rates(_, y):
        theta, _, d_theta, d_phi, omega = y
        sine, cosine = np.sin(theta), np.cos(theta)
        weight = MASS * GRAVITY * RADIUS * cosine
        turning = ACROSS * d_phi**2 * sine * cosine - (AXIAL + inertia) * d_phi * sine * omega - weight
        precession = (AXIAL * omega - 2.0 * ACROSS * d_phi * cosine) * d_theta / (ACROSS * sine)
        return [d_theta, d_phi, turning / (ACROSS + inertia), precession,
                inertia * d_phi * d_theta * sine / (AXIAL + inertia)]  # fmt: skip

    begun = [0.5 * np.pi - 0.2, 0.0, -0.1, 1.5, 12.0 + 1.5 * np.cos(0.5 * np.pi - 0.2)]
    t = np.linspace(0.0, 1.0, 21)
    truth = solve_ivp(rates, (0.0, 1.0), begun, method="DOP853", rtol=1e-12, atol=1e-12, t_eval=t).y
    found = run(tmp_path, disc, {
        "kind": "forward", "time": {"end": "1 s", "samples": 21},
        "initial": {"position": {"lean": "0.2 rad"},
                    "velocity": {"yaw": "1.5 rad/s", "lean": "0.1 rad/s", "spin": "12 rad/s"}},
    })  # fmt: skip
    assert values(found, "lean") == pytest.approx(0.5 * np.pi - truth[0], abs=1e-7)
    assert values(found, "yaw") == pytest.approx(truth[1], abs=1e-7)
    assert np.ptp(values(found, "energy.total")) < 1e-7
    height = RADIUS * np.cos(values(found, "lean"))
    assert values(found, "z") == pytest.approx(height, abs=1e-12)


@pytest.mark.parametrize("kind", ["kinematics", "inverse"])
def test_a_disc_that_is_led_rolls_along_a_circle(disc, tmp_path, kind):
    spin, yaw, lean, t = 5.0, 1.5, 0.1, np.linspace(0.0, 2.0, 21)
    found = run(tmp_path, disc, {
        "kind": kind, "time": {"end": "2 s", "samples": 21},
        "motion": {"spin": {"law": "constant_speed", "speed": f"{spin} rad/s"},
                   "yaw": {"law": "constant_speed", "speed": f"{yaw} rad/s"},
                   "lean": {"law": "constant", "value": f"{lean} rad"}},
        **({"start": {"x": "0.3 m"}} if kind == "inverse" else {}),
    })  # fmt: skip
    speed = RADIUS * (spin + yaw * np.sin(lean))
    begun = 0.3 if kind == "inverse" else 0.0
    assert values(found, "x") - begun == pytest.approx(speed / yaw * np.sin(yaw * t), abs=1e-11)
    assert values(found, "y") == pytest.approx(speed / yaw * (1.0 - np.cos(yaw * t)), abs=1e-11)
    dense = found.outcome.motion.positions(np.array([0.777]))
    assert dense[0, 0] - begun == pytest.approx(speed / yaw * np.sin(0.777 * yaw), abs=1e-11)
    if kind == "inverse":
        inertia = MASS * np.array([-np.sin(yaw * t), np.cos(yaw * t)]) * speed * yaw
        for axis, force in zip("xy", inertia, strict=True):
            assert values(found, f"loop.contact.force.{axis}") == pytest.approx(force, abs=1e-9)
        assert values(found, "loop.contact.force.z") == pytest.approx(MASS * GRAVITY, abs=1e-9)


def test_a_skate_on_a_slope_goes_along_a_cycloid(body, tmp_path):
    """Neimark and Fufaev, Dynamics of nonholonomic systems (1972), chapter II: it does not go down for ever."""
    slope, turning, t = 0.3, 2.0, np.linspace(0.0, 4.0, 41)
    force = [f"{float(MASS * GRAVITY * np.sin(slope))!r} N", "0 N", "0 N"]
    pull = {"pull": {"kind": "wrench", "point": "body", "force": force, "axes": "world"}}
    mechanism = body("x", "y", "yaw", loops={"blade": {"kind": "knife_edge", "between": ["ground", "body"]}})
    found = run(tmp_path, mechanism, {
        "kind": "forward", "time": {"end": "4 s", "samples": 41}, "loads": pull,
        "initial": {"velocity": {"yaw": f"{turning} rad/s"}},
    })  # fmt: skip
    size = GRAVITY * np.sin(slope) / (2.0 * turning**2)
    assert values(found, "x") == pytest.approx(size * np.sin(turning * t) ** 2, abs=1e-8)
    assert values(found, "y") == pytest.approx(size * (turning * t - 0.5 * np.sin(2.0 * turning * t)), abs=1e-8)


def test_a_sleigh_ends_in_a_straight_line(body, tmp_path):
    """Chaplygin's sleigh: ``u' = a w^2``, ``(I + m a^2) w' = -m a u w``; the blade is a behind the centre of mass."""
    ahead, inertia = 0.4, 0.3
    mechanism = body("x", "y", "yaw", ahead=ahead, across=inertia,
                     loops={"blade": {"kind": "knife_edge", "between": ["ground", "body"]}})  # fmt: skip
    found = run(tmp_path, mechanism, {
        "kind": "forward", "time": {"end": "5 s", "samples": 51},
        "initial": {"velocity": {"x": "0.1 m/s", "yaw": "3 rad/s"}},
    })  # fmt: skip

    def rates(_, y):
        u, w = y
        return [ahead * w**2, -MASS * ahead * u * w / (inertia + MASS * ahead**2)]

    t = np.linspace(0.0, 5.0, 51)
    truth = solve_ivp(rates, (0.0, 5.0), [0.1, 3.0], method="DOP853", rtol=1e-12, atol=1e-12, t_eval=t).y
    assert values(found, "joint.yaw.velocity") == pytest.approx(truth[1], abs=1e-8)
    speed = np.hypot(values(found, "joint.x.velocity"), values(found, "joint.y.velocity"))
    assert speed == pytest.approx(np.abs(truth[0]), abs=1e-8)


def test_a_disc_that_falls_flat_ends_the_run(disc, tmp_path):
    with pytest.raises(PinarmError, match="lies flat"):
        run(tmp_path, disc, {
            "kind": "forward", "time": {"end": "2 s", "samples": 41}, "initial": {"position": {"lean": "0.2 rad"}},
        })  # fmt: skip


def test_rolling_leaves_more_positions_than_velocities(disc, tmp_path):
    closure = load(tmp_path, disc).closure
    assert closure.size == 3
    assert closure.holonomic.size == 1


def test_no_posture_is_nearest_where_something_rolls(disc, tmp_path):
    with pytest.raises(InputError, match="no nearest posture"):
        run(tmp_path, disc, {
            "kind": "kinematics", "time": {"end": "1 s", "samples": 3}, "resolve": {"nearest_to": {"lean": "0 rad"}},
            "motion": {"spin": {"law": "constant_speed", "speed": "5 rad/s"}},
        })  # fmt: skip
