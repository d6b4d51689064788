from contextlib import nullcontext

import numpy as np
import pinocchio as pin
import pytest
from scipy.special import ellipj, ellipk

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Interval
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.forces.along_coordinate import JointSpring
from pinarm.mechanics.laws import ConstantSpeed
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid

G = 9.81
DOWN_Y = {"direction": "-y", "magnitude": "9.81 m/s^2"}
BOB = {"name": "arm", "mass": 1.5, "com": "0 -0.7 0", "inertia": (0.0, 0.0, 0.0)}
LENGTH, MASS = 0.7, 1.5
ROD = {"mass": 1.0, "com": "0 -0.5 0", "inertia": (1 / 12, 0.0, 1 / 12)}
SLIDER = {"name": "slide", "kind": "prismatic", "axis": "1 0 0", "mass": 2.0}


def run(mechanism, end, samples=101, tolerance=1e-12, **content):
    return outcome(mechanism, end, samples, tolerance, **content).rows


def outcome(mechanism, end, samples=101, tolerance=1e-12, **content):
    problem = Forward(time=TimeGrid(end=end, samples=samples), **content)
    return problem.solve(mechanism, Accuracy(tolerance=tolerance), lambda *path: nullcontext())


@pytest.mark.parametrize("amplitude", [0.1, 3.0])
def test_pendulum_swings_as_the_elliptic_functions_say(mechanism, chain, amplitude):
    pendulum = mechanism(chain(BOB), gravity=DOWN_Y)
    m, rate = np.sin(amplitude / 2) ** 2, np.sqrt(G / LENGTH)
    period = 4 * ellipk(m) / rate
    swing = run(pendulum, 2 * period, initial={"position": {"arm": amplitude}})
    sn, cn, _dn, _ = ellipj(rate * swing.grid.t + ellipk(m), m)
    # tolerance 1e-12 over two periods; at 3 rad the pendulum lingers near its top and errors grow a hundredfold
    assert swing.q[:, 0] == pytest.approx(2 * np.arcsin(np.sqrt(m) * sn), abs=1e-8)
    assert swing.v[:, 0] == pytest.approx(2 * np.sqrt(m) * rate * cn, abs=1e-8)
    assert (swing.q[50, 0], swing.q[-1, 0]) == pytest.approx((amplitude, amplitude), abs=1e-8)


def test_pendulum_turns_over_and_counts_its_turns(mechanism, chain):
    """Faster than the separatrix: q = 2 am(v0 t / 2, m), m = 4 g / (l v0^2)."""
    pendulum, v0 = mechanism(chain(BOB), gravity=DOWN_Y), 9.0
    m = 4 * G / (LENGTH * v0**2)
    over = run(pendulum, 5.0, initial={"velocity": {"arm": v0}})
    *_, amplitude = ellipj(0.5 * v0 * over.grid.t, m)
    assert over.q[:, 0] == pytest.approx(2 * amplitude, abs=1e-9)
    assert over.q[-1, 0] > 4 * np.pi


def test_pin_of_a_pendulum_carries_weight_and_centripetal_force(mechanism, chain):
    pendulum = mechanism(chain(BOB), gravity=DOWN_Y)
    swing = run(pendulum, 2.0, initial={"position": {"arm": 1.2}, "velocity": {"arm": 0.5}})
    found = Quantities(swing)
    q, v, a = swing.q[:, 0], swing.v[:, 0], swing.a[:, 0]
    assert a == pytest.approx(-G / LENGTH * np.sin(q), abs=1e-12)
    along = MASS * G * np.cos(q) + MASS * LENGTH * v**2  # towards the pin
    across = MASS * LENGTH * a + MASS * G * np.sin(q)
    assert across == pytest.approx(0.0, abs=1e-12)
    assert found["joint.arm.force.x"].values == pytest.approx(-along * np.sin(q), abs=1e-12)
    assert found["joint.arm.force.y"].values == pytest.approx(along * np.cos(q), abs=1e-12)
    for part in ("force.z", "moment.x", "moment.y", "moment.z"):
        assert found[f"joint.arm.{part}"].values == pytest.approx(0.0, abs=1e-12)


def test_bearing_of_a_spinning_rod_feels_its_centrifugal_force_and_tilting_moment(mechanism, chain):
    """A rod at 30 deg to its vertical axis: the moment m l^2 w^2 sin cos / 3 turns with it."""
    length, mass, w, tilt = 0.9, 1.2, 20.0, np.pi / 6
    xml = chain({"name": "shaft", "mass": mass, "com": f"{length / 2} 0 0",
                 "inertia": (0.0, mass * length**2 / 12, mass * length**2 / 12)})  # fmt: skip
    x, z = length / 2 * np.sin(tilt), length / 2 * np.cos(tilt)
    tilted = f'<origin xyz="{x:.17g} 0 {z:.17g}" rpy="0 {tilt - np.pi / 2:.17g} 0"/>'
    rod = mechanism(xml.replace(f'<origin xyz="{length / 2} 0 0"/>', tilted), gravity="none")
    motion = {"shaft": ConstantSpeed(speed=w)}
    turn = Inverse(time=TimeGrid(end=0.4, samples=41), motion=motion)
    turned = turn.solve(rod, Accuracy(), lambda *path: nullcontext()).rows
    found, q = Quantities(turned), turned.q[:, 0]
    force = -mass * length / 2 * np.sin(tilt) * w**2
    moment = -mass * length**2 / 3 * np.sin(tilt) * np.cos(tilt) * w**2
    assert abs(moment) > 50
    parts = ("force.x", "force.y", "moment.x", "moment.y", "moment.z")
    values = {part: found[f"joint.shaft.{part}"].values for part in parts}
    assert values["force.x"] == pytest.approx(force * np.cos(q), abs=1e-11)
    assert values["force.y"] == pytest.approx(force * np.sin(q), abs=1e-11)
    # r x F with F horizontal: m r_z r_x w^2 about the horizontal axis across
    assert values["moment.x"] == pytest.approx(-moment * np.sin(q), abs=1e-11)
    assert values["moment.y"] == pytest.approx(moment * np.cos(q), abs=1e-11)
    assert values["moment.z"] == pytest.approx(0.0, abs=1e-11)


def test_double_pendulum_of_two_rods_ends_where_all_references_say(mechanism, chain):
    rods = mechanism(chain({"name": "first", **ROD}, {"name": "second", "at": "0 -1 0", **ROD}), gravity=DOWN_Y)
    fall = run(rods, 10.0, samples=2, initial={"position": {"first": 0.8, "second": 0.8}})
    assert fall.q[-1] == pytest.approx([0.522210808870693, 1.436052080126094], abs=1e-9)  # errors grow 20 to 30 times


class TestSpringAndDamper:
    stiffness, damping, mass = 50.0, 3.0, 2.0
    loads = {"spring": JointSpring(joint="slide", stiffness=50.0, damping=3.0, rest=0.1)}

    def test_underdamped_free_motion(self, mechanism, chain):
        slider = mechanism(chain(SLIDER))
        initial = {"position": {"slide": 0.4}, "velocity": {"slide": -1.0}}
        found = outcome(slider, 4.0, initial=initial, loads=self.loads)
        free = found.rows
        decay = self.damping / (2 * self.mass)
        w = np.sqrt(self.stiffness / self.mass - decay**2)
        t = free.grid.t
        expected = np.exp(-decay * t) * (0.3 * np.cos(w * t) + (-1.0 + decay * 0.3) / w * np.sin(w * t))
        assert free.q[:, 0] == pytest.approx(0.1 + expected, abs=1e-10)  # a hundred times the tolerance
        assert found.measures()["energy"] < 1e-10


ACROSS, ALONG = 0.8, 0.5
SPIN = np.array([0.7, 0.0, 2.0])


@pytest.fixture(scope="module")
def turned():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.addJointFrame(joint)
    inertia = pin.Inertia(1.0, np.zeros(3), np.diag([ACROSS, ACROSS, ALONG]))
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    top = Dynamics.of(model)
    t = np.linspace(0.0, 10.0, 201)
    start = np.array([0.0, 0.0, 0.0, 1.0])
    q, v = integrate([Interval(0.0, 10.0, top.acceleration())], top.manifold, start, SPIN, Adaptive(1e-12)).states(t)
    return t, np.array([pin.Quaternion(*row[[3, 0, 1, 2]]).toRotationMatrix() for row in q]), v


class TestFreeTop:
    """A symmetric body free to turn: its axis precesses about the angular momentum at |L| / A."""

    def test_its_axis_precesses_at_a_steady_rate(self, turned):
        t, rotations, _ = turned
        momentum = np.array([ACROSS * 0.7, 0.0, ALONG * 2.0])
        pole = momentum / np.linalg.norm(momentum)
        axis = np.array([0.0, 0.0, 1.0])
        angle = np.linalg.norm(momentum) / ACROSS * t
        expected = (  # Rodrigues
            np.outer(np.cos(angle), axis) + np.outer(np.sin(angle), np.cross(pole, axis))
            + np.outer(1 - np.cos(angle), pole) * (pole @ axis)
        )  # fmt: skip
        assert rotations[:, :, 2] == pytest.approx(expected, abs=1e-10)

    def test_its_spin_turns_in_the_body(self, turned):
        t, _, v = turned
        rate = (ALONG - ACROSS) / ACROSS * 2.0
        expected = np.stack([0.7 * np.cos(rate * t), 0.7 * np.sin(rate * t), np.full_like(t, 2.0)], axis=1)
        assert v == pytest.approx(expected, abs=1e-10)
