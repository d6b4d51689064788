"""Bodies that turn and float: closed forms of rigid-body mechanics, none of them by way of quaternions."""

from contextlib import nullcontext

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipk

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.laws import Constant, ConstantAcceleration
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

G = 9.81
BODY = {"name": "body", "kind": "floating", "mass": 2.0, "inertia": (0.2, 0.3, 0.45)}


def here(*_):
    return nullcontext()


def run(mechanism, end, samples=101, tolerance=1e-12, **content):
    problem = Forward(time=TimeGrid(end=end, samples=samples), **content)
    return problem.solve(mechanism, Accuracy(tolerance=tolerance), here).rows


def spun(x, y, z):
    return {f"body.angular_velocity.{axis}": value for axis, value in zip("xyz", (x, y, z), strict=True)}


def test_asymmetric_body_without_torque_turns_as_jacobi_says(mechanism, chain):
    """Euler's equations with 2 T I2 > H^2: w1 = a cn, w2 = b sn, w3 = c dn (Landau and Lifshitz, section 37)."""
    i1, i2, i3 = BODY["inertia"]
    w1, w3 = 0.8, 2.5
    free = run(mechanism(chain(BODY), gravity="none"), 12.0, initial={"velocity": spun(w1, 0.0, w3)})
    energy, momentum = (i1 * w1**2 + i3 * w3**2) / 2, i1**2 * w1**2 + i3**2 * w3**2
    assert momentum > 2 * energy * i2
    rate = np.sqrt((i3 - i2) * (momentum - 2 * energy * i1) / (i1 * i2 * i3))
    m = (i2 - i1) * (2 * energy * i3 - momentum) / ((i3 - i2) * (momentum - 2 * energy * i1))
    sn, cn, dn, _ = ellipj(rate * free.grid.t, m)
    b = np.sqrt((2 * energy * i3 - momentum) / (i2 * (i3 - i2)))
    assert free.v[:, 3:] == pytest.approx(np.array([w1 * cn, b * sn, w3 * dn]).T, abs=1e-9)
    assert free.v[:, :3] == pytest.approx(0.0, abs=1e-14)


def test_axis_of_middle_inertia_turns_over_in_the_period_of_the_elliptic_integral(mechanism, chain):
    i1, i2, i3 = BODY["inertia"]
    w1, w2 = 1e-3, 3.0
    energy, momentum = (i1 * w1**2 + i2 * w2**2) / 2, i1**2 * w1**2 + i2**2 * w2**2
    assert momentum < 2 * energy * i2  # the roles of the first and the third axis are exchanged
    rate = np.sqrt((i2 - i1) * (2 * energy * i3 - momentum) / (i1 * i2 * i3))
    m = (i3 - i2) * (momentum - 2 * energy * i1) / ((i2 - i1) * (2 * energy * i3 - momentum))
    half = 2 * ellipk(m) / rate
    free = run(mechanism(chain(BODY), gravity="none"), half, initial={"velocity": spun(w1, w2, 0.0)})
    assert free.v[-1, 3:] == pytest.approx([w1, -w2, 0.0], abs=1e-7)  # it lingers at both ends: errors grow


def test_tumbling_body_falls_along_a_parabola_and_keeps_its_angular_momentum(mechanism, chain):
    centre = np.array([0.1, -0.2, 0.3])
    body = mechanism(chain({**BODY, "com": "0.1 -0.2 0.3"}))
    position = {"body.x": 1.0, "body.z": 5.0, "body.roll": 0.4, "body.pitch": -0.3, "body.yaw": 2.0}
    fall = run(body, 2.0, initial={"position": position, "velocity": {"body.y": 3.0, **spun(4.0, -5.0, 6.0)}})
    t, found = fall.grid.t, Quantities(fall)
    turn = Rotation.from_euler("ZYX", [2.0, -0.3, 0.4])
    start = np.array([1.0, 0.0, 5.0]) + turn.apply(centre)
    speed = np.array([0.0, 3.0, 0.0]) + np.cross(turn.apply([4.0, -5.0, 6.0]), turn.apply(centre))
    parabola = start + np.outer(t, speed) - np.outer(t**2 / 2, [0.0, 0.0, G])
    place = np.array([found[f"point.body_link.position.{axis}"].values for axis in "xyz"]).T
    seen = place + Rotation.from_quat(fall.q[:, 3:]).apply(centre)
    assert seen == pytest.approx(parabola, abs=1e-9)
    spin = np.array([found[f"momentum.all.angular.{axis}"].values for axis in "xyz"]).T
    linear = 2.0 * (speed - np.outer(t, [0.0, 0.0, G]))
    own = turn.apply(np.array(BODY["inertia"]) * [4.0, -5.0, 6.0])
    assert spin - np.cross(parabola, linear) == pytest.approx(np.broadcast_to(own, spin.shape), abs=1e-9)
    assert found["energy.total"].values == pytest.approx(found["energy.total"].values[0], rel=1e-11)


TOP = """<mujoco model="top"><worldbody><body name="top">
  <joint name="tip" type="ball"/><inertial pos="0 0 0.3" mass="1.2" diaginertia="0.02 0.02 0.009"/>
</body></worldbody></mujoco>"""


def test_heavy_top_nutates_as_the_elliptic_function_says(tmp_path):
    """With u = cos(theta): u'^2 is a cubic, so u = u1 + (u2 - u1) sn^2 (Goldstein, section 5.7)."""
    (tmp_path / "top.xml").write_text(TOP)
    top = Mechanism.load(tmp_path / "top.xml")
    across, along, lever = 0.02 + 1.2 * 0.3**2, 0.009, 1.2 * G * 0.3
    theta, spin, drift = 0.5, 60.0, 4.0  # released at a turning point of theta
    velocity = {"tip.angular_velocity.y": drift * np.sin(theta), "tip.angular_velocity.z": spin}
    start = {"position": {"tip.rotation.x": theta}, "velocity": velocity}  # about x: the drift is about body's y and z
    swing = run(top, 1.0, samples=201, initial=start)
    u = np.cos(theta)
    b, a = (along * spin * u + across * drift * (1 - u * u)) / across, along * spin / across
    beta = 2 * lever / across
    alpha = drift**2 * (1 - u * u) + beta * u
    roots = np.sort(np.roots([beta, -(alpha + a * a), 2 * a * b - beta, alpha - b * b]).real)
    near, far = sorted(roots[:2], key=lambda root: abs(root - u))
    assert near == pytest.approx(u, abs=1e-12)
    low, high, third = roots
    rate, m = np.sqrt(beta * (third - low)) / 2, (high - low) / (third - low)
    shift = 0.0 if near == low else ellipk(m)
    sn = ellipj(rate * swing.grid.t + shift, m)[0]
    seen = Rotation.from_quat(swing.q).apply([0.0, 0.0, 1.0])[:, 2]
    assert seen == pytest.approx(low + (high - low) * sn**2, abs=1e-9)
    assert abs(far - u) > 0.05  # it does nutate


@pytest.mark.parametrize("axis", ["0 -3 4", "0 0 -1"])
def test_planar_joint_slides_straight_in_its_plane_and_counts_its_turns(mechanism, chain, axis):
    puck = mechanism(chain({"name": "puck", "kind": "planar", "axis": axis, "at": "1 2 3"}), gravity="none")
    velocity = {"puck.x": 0.5, "puck.y": -1.0, "puck.angle": 9.0}
    slide = run(puck, 3.0, initial={"position": {"puck.x": 0.2}, "velocity": velocity})
    t, found = slide.grid.t, Quantities(slide)
    assert slide.q == pytest.approx(np.array([0.2 + 0.5 * t, -t, 9.0 * t]).T, abs=1e-11)
    place = np.array([found[f"point.puck_link.position.{one}"].values for one in "xyz"]).T - [1.0, 2.0, 3.0]
    normal = np.array([float(x) for x in axis.split()])
    normal /= np.linalg.norm(normal)
    assert place @ normal == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(place, axis=1) == pytest.approx(np.hypot(0.2 + 0.5 * t, t), abs=1e-12)
    spin = np.array([found[f"body.puck_link.angular_velocity.{one}"].values for one in "xyz"]).T
    assert spin == pytest.approx(np.broadcast_to(9.0 * normal, spin.shape), abs=1e-12)


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_damping_of_a_joint_with_several_coordinates_brakes_each_of_them(mechanism, chain, kind):
    axis = {"axis": "0 0 1"}
    body = mechanism(chain({**BODY, **axis, "kind": kind, "damping": 0.6}), gravity="none")
    turn = "body.angle" if kind == "planar" else "body.angular_velocity.z"
    coast = run(body, 2.0, initial={"velocity": {"body.x": 3.0, turn: 5.0}})
    t = coast.grid.t
    assert coast.v[:, 0] == pytest.approx(3.0 * np.exp(-0.6 * t / 2.0), abs=1e-10)
    assert coast.v[:, -1] == pytest.approx(5.0 * np.exp(-0.6 * t / 0.45), abs=1e-10)


def test_floating_robot_that_moves_its_limbs_keeps_its_momenta():
    robot = Mechanism.load("solo12", values={"gravity": "none"})
    kick = {"FL_HFE": 3.0, "HR_KFE": -4.0, "FR_HAA": 2.0, "root.y": 0.4, "root.angular_velocity.x": 1.0}
    free = run(robot, 0.3, samples=11, tolerance=1e-10, initial={"position": {"FL_HFE": 0.8}, "velocity": kick})
    found = Quantities(free)
    for kind in ("linear", "angular"):
        momentum = np.array([found[f"momentum.all.{kind}.{axis}"].values for axis in "xyz"])
        assert np.ptp(momentum, axis=1) == pytest.approx(0.0, abs=1e-9)
        assert np.abs(momentum).max() > 0.01
    assert np.ptp(free.v[:, 3]) > 0.1  # the base itself does not keep still


def test_arm_on_a_base_that_is_lifted_feels_its_acceleration_as_weight(mechanism, chain):
    """A pendulum hung on a floating base that laws lift and hold level swings under g + a."""
    arm = {"name": "arm", "axis": "1 0 0", "at": "0 0.4 0", "mass": 1.5, "com": "0 0 -0.7", "inertia": (0.1, 0.1, 0.1)}
    hung = mechanism(chain({**BODY, "name": "base_joint"}, arm))
    still = {f"base_joint.{name}": Constant(value=0.0) for name in ("x", "y", *(f"rotation.{one}" for one in "xyz"))}
    lift = {**still, "base_joint.z": ConstantAcceleration(acceleration=2.5)}
    swing = run(hung, 1.0, motion=lift, initial={"position": {"arm": 1.0}})
    fixed = run(
        mechanism(chain(arm), gravity={"magnitude": f"{G + 2.5} m/s^2"}), 1.0, initial={"position": {"arm": 1.0}}
    )
    index = hung.joints["arm"].q
    assert swing.q[:, index] == pytest.approx(fixed.q[:, 0], abs=1e-9)
    found, level = Quantities(swing), Quantities(fixed)
    push = found["joint.base_joint.z.effort"].values - 2.0 * (G + 2.5)
    assert push == pytest.approx(level["joint.arm.force.z"].values, abs=1e-8)
    with pytest.raises(InputError, match=r"the drive acts along base_joint\.rotation\.x"):
        found["joint.base_joint.effort.x"]
    tilt = 0.4 * level["joint.arm.force.z"].values  # the hinge itself passes no moment about x
    assert found["coordinate.base_joint.rotation.x.effort"].values == pytest.approx(tilt, abs=1e-8)
    assert found["joint.base_joint.moment.x"].values == pytest.approx(tilt, abs=1e-8)


def test_a_floating_body_that_falls_has_the_same_motion_as_pinocchios_free_flyer(mechanism, chain):
    xml = chain({**BODY, "com": "0.1 0.2 0.3"}, {"name": "arm", "at": "0.2 0 0", "axis": "0 1 0", "com": "0 0 0.4"})
    ours = mechanism(xml, gravity="none")
    theirs = pin.buildModelFromXML(xml.replace("continuous", "revolute"))
    q, v = np.random.default_rng(3).normal(size=(2, 8))
    q[3:7] /= np.linalg.norm(q[3:7])
    turn = pin.Quaternion(q[3:7]).matrix()
    theirs.gravity.linear = np.zeros(3)
    rates = v[:7].copy()
    rates[:3] = turn.T @ v[:3]
    found = ours.forward(q, v[:7])
    flown = pin.aba(theirs, theirs.createData(), q, rates, np.zeros(7))
    seen = turn @ (flown[:3] + np.cross(rates[3:6], rates[:3]))  # theirs is the rate of local components
    assert found[:3] == pytest.approx(seen, abs=1e-11)
    assert found[3:] == pytest.approx(flown[3:], abs=1e-11)
