"""Dry friction in linearised motions: held joints, laws of slip, loads of bearings; against the motion's own slopes."""

import math

import numpy as np
import pinocchio as pin
import pytest
from urdf_links import link, robot, tip

from pinarm.errors import DynamicsError, InputError

BODY = {"mass": 2.0, "com": "0.1 0 -0.4", "inertia": (0.03, 0.04, 0.02)}


def accelerations_slopes(mechanism, q, v, tau, differentiate):
    """Slopes of ``forward`` by q, v and tau by real differences of order 8."""
    nv = mechanism.model.nv

    def at(x, which, way):
        state = [q, v, tau]
        state[which] = pin.integrate(mechanism.model, q, x * way) if which == 0 else state[which] + x * way
        return mechanism.forward(*state)

    return [np.array([differentiate(lambda x, k=k, way=way: at(x, k, way), 0.0, h=2e-3) for way in np.eye(nv)]).T
            for k in range(3)]  # fmt: skip


LAWS = {
    "constant": {"constant": "0.7 N*m"},
    "stribeck": {
        "constant": "0.5 N*m",
        "static_constant": "0.9 N*m",
        "stribeck": "1.5 rad/s",
        "viscous": "0.2 N*m*s/rad",
    },
    "journal": {"mu": 0.15, "radius": "20 mm", "thrust_radius": "15 mm", "span": "0.1 m"},
}


@pytest.mark.parametrize("law", LAWS)
def test_slip_of_a_spatial_arm_has_the_slopes_of_its_motion(law, mechanism, differentiate):
    xml = robot(link("a", "base", "0 1 0.2", **BODY), link("b", "a_link", "1 0.3 0", at="0.1 0.05 -0.5", **BODY))
    made = mechanism(xml, friction={"a": LAWS[law], "b": LAWS[law]})
    q, v, tau = np.array([0.3, -0.7]), np.array([1.1, -0.6]), np.array([2.0, -1.0])
    found = made.linearise(q, v, tau)
    by_q, by_v, by_tau = accelerations_slopes(made, q, v, tau, differentiate)
    # rounding of accelerations of 10 over steps of 2e-3, and of the fixed point of friction
    assert found.A[2:] == pytest.approx(np.hstack([by_q, by_v]), abs=1e-7)
    assert found.B[2:] == pytest.approx(by_tau, abs=1e-8)


def test_slip_of_a_loop_has_the_slopes_of_its_motion(mechanism, differentiate):
    """A bar that hangs from two cranks of the same length: friction in a pin that closes the loop, and in a crank."""
    bar = link("a", "base", "0 1 0", **BODY) + link("b", "a_link", "0 1 0", at="0 0 -0.5", **BODY)
    xml = robot(
        bar,
        link("c", "base", "0 1 0", at="0.4 0 0", **BODY),
        tip("b_end", "b_link", "0.3 0 0.1"),
        tip("c_end", "c_link", "0 0 -0.45"),
    )
    pin_friction = {"mu": 0.2, "radius": "30 mm"}
    made = mechanism(
        xml, loops={"pin": {"kind": "pin", "between": ["b_end", "c_end"], "axis": "y"}}, start={"a": "0.2 rad"},
        friction={"pin": pin_friction, "a": pin_friction},
    )  # fmt: skip
    q = closed(made, {"a": 0.2})
    free = np.linalg.svd(made.closure.rows(made.closure.state(q)))[2][-1]
    v, tau = free / free[0] * 1.3, np.array([3.0, 0.0, 0.0])
    found = made.linearise(q, v, tau)
    index = int(found.motion.independent[0])

    def moved(x, which):
        position = closed(made, {}, pin.integrate(made.model, q, x * found.motion.position[:, 0] * (which == 0)))
        allowed = np.linalg.svd(made.closure.rows(made.closure.state(position)))[2][-1]
        rate = allowed / allowed[index] * (v[index] + x * (which == 1))
        return made.forward(position, rate, tau)[index]

    slopes = [differentiate(lambda x, k=k: moved(x, k), 0.0, h=2e-3) for k in range(2)]
    assert found.A[1] == pytest.approx(slopes, abs=1e-6)  # of Newton's method in the loop


def closed(made, start, q=None):
    """Return a configuration with a closed loop by Newton's method on its gaps."""
    q = made.configurations({"a": 0.0, "b": 0.0, "c": 0.0, **start}) if q is None else q
    for _ in range(30):
        state = made.closure.state(q)
        step = -np.linalg.lstsq(made.closure.rows(state), made.closure.gap(state))[0]
        q = pin.integrate(made.model, q, step)
    return q


def test_a_joint_that_sticks_is_held(mechanism):
    """Of two pendulums one in the other the lower one sticks: a rigid pendulum, ``w^2 = m g s / I``."""
    upper = link("a", "base", "0 1 0", mass=1.0, com="0 0 -0.5")
    xml = robot(upper, link("b", "a_link", "0 1 0", at="0 0 -1", mass=2.0, com="0 0 -0.3"))
    made = mechanism(xml, friction={"b": {"constant": "1 N*m"}})
    found = made.linearise(np.zeros(2))
    expected = math.sqrt(9.81 * (1.0 * 0.5 + 2.0 * 1.3) / (0.25 + 2.0 * 1.69)) / (2.0 * math.pi)
    assert found.states == ["a", "a'"]
    assert found.modes.frequencies == pytest.approx([expected], rel=1e-12)
    assert found.friction.note == "held by dry friction in the small motion: joint.b"


def test_a_joint_that_begins_to_slip_is_refused(mechanism):
    made = mechanism(robot(link("a", "base", "0 1 0", mass=1.0, com="0 0 -1")), friction={"a": {"constant": "1 N*m"}})
    with pytest.raises(DynamicsError, match=r"joint\.a begins to slip here: friction has a kink"):
        made.linearise(np.array([0.5]))
    assert made.linearise(np.array([0.05])).states == []


def test_a_bearing_without_load_has_a_kink(mechanism):
    rotor = robot(link("a", "base", "0 0 1", mass=1.0, com="0.1 0 0", inertia=(1.0, 1.0, 1.0)))
    made = mechanism(rotor, gravity="none", friction={"a": {"mu": 0.1, "radius": "1 cm", "thrust_radius": "1 cm"}})
    found = made.linearise(np.zeros(1), np.array([2.0]))  # f = -mu r m s v^2, by the centrifugal force
    assert found.A[1, 1] * (1.0 + 0.01) == pytest.approx(-0.1 * 0.01 * 0.1 * 2.0 * 2.0, rel=1e-3)
    shaft = link("a", "base", "0 1 0", mass=1.0, com="0 0.05 0", inertia=(0.1, 0.1, 0.1))
    slide = link("b", "a_link", "0 1 0", mass=1.0, kind="prismatic")
    one_sided = mechanism(robot(shaft, slide), friction={"a": {"mu": 0.1, "radius": "1 cm", "span": "0.1 m"}})
    with pytest.raises(InputError, match="has a kink here: a normal force of its bearing is 0"):
        one_sided.linearise(np.array([0.0, 0.05]), np.array([1.0, 0.0]))
    one_sided.linearise(np.array([0.0, 0.06]), np.array([1.0, 0.0]))
