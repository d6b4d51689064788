"""Plain Pinocchio and SciPy, as a user writes it: accelerations by ``aba`` or ``constraintDynamics``, then an ODE code.

Loops are points that meet, held by Baumgarte's terms; those terms and the proximal solver's regularisation are swept.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import odeint, solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.race.engines import WORKERS, Run, Setting, Unable, decades, flown
from benchmarks.race.mechanisms import Body, Linkage
from benchmarks.race.problems import STARTS, Batch, Inverse, Motion, Problem

Array = np.ndarray
MOST = 8.0
"""Memory of Pinocchio's buffers, 46 to 65 bytes for each cube of joints, beyond which it is not tried [GB]."""
Acceleration = Callable[[Array, Array], Array]


def prepare(problem: Problem) -> list[Setting]:
    if isinstance(problem, Inverse):
        return _inverse(problem)
    if isinstance(problem, Batch):
        return _batch(problem)
    assert isinstance(problem, Motion)
    if (gigabytes := 50e-9 * len(problem.linkage.q) ** 3) > MOST:
        raise Unable(f"pin.Data(model) takes {gigabytes:.0f} GB")
    if problem.linkage.loops:
        return _closed(problem)
    acceleration = tree(problem.linkage)
    methods = ["DOP853", "odeint"]
    if problem.linkage.damping.any():
        methods = ["Radau", "LSODA", "odeint", "DOP853"]
    return [Setting(method, tolerance, partial(integration, problem, acceleration, method, tolerance))
            for method in methods for tolerance in decades(3, 13, 2)]  # fmt: skip


def model_of(linkage: Linkage) -> pin.Model:
    model = pin.Model()
    model.gravity.linear = np.array(linkage.gravity)
    for body in linkage.bodies:
        flying = linkage.flight and body.parent < 0
        index = model.addJoint(body.parent + 1, pin.JointModelFreeFlyer() if flying else _joint(body),
                               pin.SE3(np.array(body.rotation), np.array(body.place)), body.name)  # fmt: skip
        inertia = pin.Inertia(body.mass, np.array(body.com), np.array(body.inertia))
        model.appendBodyToJoint(index, inertia, pin.SE3.Identity())
    return model


def _joint(body: Body) -> Any:
    """Return the joint of a body: those about an axis of the frame are faster."""
    kind = "P" if body.slides else "R"
    if 1.0 in body.axis:
        return getattr(pin, f"JointModel{kind}{'XYZ'[body.axis.index(1.0)]}")()
    return pin.JointModelRevoluteUnaligned(np.array(body.axis))


def tree(linkage: Linkage) -> Acceleration:
    model = model_of(linkage)
    data, torque = model.createData(), np.concatenate([np.zeros(6 if linkage.flight else 0), linkage.torque])
    if not linkage.stiffness.any():
        return lambda q, v: pin.aba(model, data, q, v, torque)
    stiffness, damping, n = linkage.stiffness, linkage.damping, len(linkage.hinged)

    def acceleration(q: Array, v: Array) -> Array:
        tau = torque.copy()
        tau[-n:] -= stiffness * q[-n:] + damping * v[-n:]
        return pin.aba(model, data, q, v, tau)

    return acceleration


def _closed(problem: Motion) -> list[Setting]:
    fine = decades(3, 11, 2) if len(problem.linkage.bodies) < 20 else decades(3, 11, 1)
    sweep = product(((0.0, 0.0), (100.0, 20.0), (1e4, 200.0)), ((1e-10, 8), (1e-6, 3)))
    scale = 1.0 if problem.end > 1.0 else 1e3
    found = []
    for (kp, kd), (mu, iterations) in sweep:
        acceleration = closed(problem.linkage, (kp * scale**2, kd * scale), mu, iterations)
        found += [Setting(f"{method}, Baumgarte {kp * scale**2:g}, mu {mu:g}", tolerance,
                          partial(integration, problem, acceleration, method, tolerance))
                  for method in ("DOP853", "odeint") for tolerance in fine]  # fmt: skip
    return found


def closed(linkage: Linkage, corrector: tuple[float, float], mu: float, iterations: int) -> Acceleration:
    """Return the accelerations of a linkage with loops; a spatial loop takes two points of its axis."""
    model = model_of(linkage)
    data, loops, states = model.createData(), pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for loop in linkage.loops:
        for shift in (0.0,) if loop.planar else (-0.5, 0.5):
            first, second = (pin.SE3(np.eye(3), np.array(point) + shift * np.array(loop.axis)) for point in loop.points)
            one = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, loop.bodies[0] + 1, first,
                                           loop.bodies[1] + 1, second, pin.LOCAL)  # fmt: skip
            one.setBaumgarteCorrectorParameters(pin.BaumgarteCorrectorParameters(*corrector))
            loops.append(one)
            states.append(loops[-1].createData())
    pin.initConstraintDynamics(model, data, loops, states)
    settings, torque = pin.ProximalSettings(1e-12, mu, iterations), linkage.torque
    if not (spring := linkage.spring):
        return lambda q, v: pin.constraintDynamics(model, data, q, v, torque, loops, states, settings)
    joint, anchor = spring.body + 1, np.array(spring.anchor)
    hook = model.addFrame(pin.Frame("hook", joint, pin.SE3(np.eye(3), np.array(spring.point)), pin.FrameType.OP_FRAME))
    data = model.createData()
    pin.initConstraintDynamics(model, data, loops, states)

    def acceleration(q: Array, v: Array) -> Array:
        jacobian = pin.computeFrameJacobian(model, data, q, hook, pin.LOCAL_WORLD_ALIGNED)[:3]
        apart = anchor - data.oMi[joint].act(np.array(spring.point))
        length = np.sqrt(apart @ apart)
        tau = torque + jacobian.T @ (spring.stiffness * (length - spring.length) / length * apart)
        return pin.constraintDynamics(model, data, q, v, tau, loops, states, settings)

    return acceleration


def integration(problem: Motion, acceleration: Acceleration, method: str, tolerance: float) -> Run:
    linkage, times = problem.linkage, problem.times
    nq = len(linkage.q) + (7 if linkage.flight else 0)
    start = np.concatenate([linkage.q, linkage.v])
    if flight := linkage.flight:
        start = np.concatenate([np.zeros(6), [1.0], linkage.q, flight.linear, flight.angular, linkage.v])

    def rate(t: float, y: Array) -> Array:
        return np.concatenate([y[nq:], acceleration(y[:nq], y[nq:])])

    def flying(t: float, y: Array) -> Array:
        x, v = y[3:7] / np.sqrt(y[3:7] @ y[3:7]), y[nq:]
        q = np.concatenate([y[:3], x, y[7:nq]])
        a = acceleration(q, v)
        w = v[3:6]
        spin = 0.5 * np.append(x[3] * w + np.cross(x[:3], w), -x[:3] @ w)
        return np.concatenate([pin.Quaternion(x).toRotationMatrix() @ v[:3], spin, v[6:], a])

    slope = flying if linkage.flight else rate

    def run() -> Array:
        if method == "odeint":
            y = odeint(slope, start, [0.0, *times], tfirst=True, rtol=tolerance, atol=tolerance, mxstep=1_000_000)[1:]
        else:
            solution = solve_ivp(slope, (0.0, times[-1]), start, method, t_eval=times, rtol=tolerance, atol=tolerance)
            if not solution.success:
                raise ArithmeticError(solution.message)
            y = solution.y.T
        if not linkage.flight:
            return y[:, :nq]
        return flown(y[:, :3], Rotation.from_quat(y[:, 3:7]), y[:, 7:nq])

    return run


def _batch(problem: Batch) -> list[Setting]:
    """Return RK4 and DOP853 with one step for all starts, accelerations by ``abaInParallel``."""
    steps = tuple(float(round(25.0 * 2.0 ** (k / 2))) for k in range(13))
    ways = [*(("RK4", n) for n in steps), *(("DOP853", tolerance) for tolerance in decades(2, 12, 4))]
    return [
        Setting(f"{method}, abaInParallel, threads {n}", value, partial(together, problem, n, method, value))
        for n in sorted({1, WORKERS}) for method, value in ways
    ]  # fmt: skip


def together(problem: Batch, threads: int, method: str, value: float) -> Run:
    """Return what advances all starts together: RK4 with so many steps, or DOP853 with a tolerance."""
    model, n = model_of(problem.linkage), len(problem.linkage.q)
    torque = np.repeat(problem.linkage.torque[:, None], STARTS, axis=1)
    start = np.vstack([x.T for x in problem.starts()])
    pool = pin.ModelPool(model, threads)

    def rate(t: float, y: Array) -> Array:
        return np.concatenate([y[n:], pin.abaInParallel(threads, pool, y[:n], y[n:], torque)])

    def rk4() -> Array:
        y, h = start, problem.end / value
        for _ in range(int(value)):
            k1 = rate(0.0, y)
            k2 = rate(0.0, y + 0.5 * h * k1)
            k3 = rate(0.0, y + 0.5 * h * k2)
            y = y + h / 6 * (k1 + 2 * (k2 + k3) + rate(0.0, y + h * k3))
        return y[:n].T

    def flat(t: float, y: Array) -> Array:
        return rate(t, y.reshape(2 * n, STARTS)).ravel()

    def dop853() -> Array:
        solution = solve_ivp(flat, (0.0, problem.end), start.ravel(), "DOP853", rtol=value, atol=value)
        return solution.y[:, -1].reshape(2 * n, STARTS)[:n].T

    return rk4 if method == "RK4" else dop853


def _inverse(problem: Inverse) -> list[Setting]:
    if problem.drive is not None:
        return [Setting("rnea, loop rows and solve, in a loop", 0.0, partial(_driven, problem))]
    model, rows = model_of(problem.linkage), problem.states()
    data = model.createData()

    def one_by_one() -> Run:
        return lambda: np.array([pin.rnea(model, data, *row) for row in zip(*rows, strict=True)])

    def parallel(threads: int) -> Run:
        q, v, a = (np.asfortranarray(x.T) for x in rows)
        pool = pin.ModelPool(model, threads)
        return lambda: pin.rneaInParallel(threads, pool, q, v, a).T

    many = [Setting(f"rneaInParallel, threads {n}", 0.0, partial(parallel, n)) for n in sorted({1, WORKERS})]
    return [Setting("rnea in a loop", 0.0, one_by_one), *many]


def _driven(problem: Inverse) -> Run:
    """Return the torque of one drive of a planar linkage: the loops' rows of the Jacobian carry the rest."""
    linkage, rows, drive = problem.linkage, problem.states(), problem.drive
    model = model_of(linkage)
    frames = []
    for k, loop in enumerate(linkage.loops):
        places = [pin.SE3(np.eye(3), np.array(point)) for point in loop.points]
        frames.append([model.addFrame(pin.Frame(f"{k} {side}", loop.bodies[side] + 1, place, pin.FrameType.OP_FRAME))
                       for side, place in enumerate(places)])  # fmt: skip
    data, others = model.createData(), [k for k in range(model.nv) if k != drive]

    def torque(q: Array, v: Array, a: Array) -> float:
        demand = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        jacobian = np.vstack([
            pin.getFrameJacobian(model, data, one, pin.LOCAL_WORLD_ALIGNED)[:2]
            - pin.getFrameJacobian(model, data, other, pin.LOCAL_WORLD_ALIGNED)[:2] for one, other in frames
        ])  # fmt: skip
        lam = np.linalg.solve(jacobian[:, others].T, demand[others])
        return demand[drive] - jacobian[:, drive] @ lam

    return lambda: np.array([[torque(*row)] for row in zip(*rows, strict=True)])
