"""MuJoCo: MJCF text from the same numbers, fixed steps; loops are ``connect`` constraints made stiff with the step.

A constraint's reference acceleration is ``-b v - k r`` with ``k = STIFFNESS / dt^2`` (``solref`` negative, ``refsafe``
off): the stiffest that steps of that length bear. With the defaults the four-bar is wrong by radians at any step.
"""

from __future__ import annotations

from functools import partial
from itertools import product

import mujoco
import numpy as np
from mujoco import rollout
from pinocchio import Quaternion
from scipy.spatial.transform import Rotation

from benchmarks.race.engines import WORKERS, Run, Setting, Unable, flown, halvings
from benchmarks.race.mechanisms import Body, Linkage
from benchmarks.race.problems import SAMPLES, STARTS, Batch, Inverse, Motion, Problem
from pinarm.records import replace

DEEP = 400
"""Bodies from which on a model is not written as nested elements, of which MuJoCo reads 500."""

STIFFNESS = (1.0, 2.0, 4.0)
"""k dt^2 of the loops' constraints."""


def prepare(problem: Problem) -> list[Setting]:
    if isinstance(problem, Inverse):
        if problem.linkage.loops:
            raise Unable("inverse dynamics gives a loop's forces to all joints")
        return [Setting("mj_inverse in a loop", 0.0, partial(_inverse, problem))]
    if isinstance(problem, Batch):
        return [Setting(f"RK4, rollout, threads {WORKERS}", problem.end / steps, partial(_batch, problem, steps))
                for steps in (12, 25, 50, 100, 200, 400, 800, 1600)]  # fmt: skip
    assert isinstance(problem, Motion)
    if problem.linkage.loops:
        choices = [("RK4", k) for k in STIFFNESS]
    else:
        choices = (
            [("RK4", 1.0)] if not problem.linkage.damping.any() else [("implicit", 1.0), ("Euler", 1.0), ("RK4", 1.0)]
        )
    most = 200_000 if problem.linkage.damping.any() else 32_768
    fewest = 4 if problem.linkage.loops else 1
    steps = halvings(fewest, most // SAMPLES)
    return [
        Setting(f"{method}, k dt² = {stiffness:g}" if problem.linkage.loops else method, problem.end / (SAMPLES * n),
                partial(_motion, problem, method, stiffness, n))
        for (method, stiffness), n in product(choices, steps)
    ]  # fmt: skip


def _motion(problem: Motion, method: str, stiffness: float, steps: int) -> Run:
    linkage, dt = problem.linkage, problem.end / (SAMPLES * steps)
    model = model_of(linkage, method, dt, stiffness)
    data = mujoco.MjData(model)
    angles, dofs = _places(model, linkage)

    def run() -> np.ndarray:
        mujoco.mj_resetData(model, data)
        data.qpos[angles], data.qvel[dofs], data.qfrc_applied[dofs] = linkage.q, linkage.v, linkage.torque
        if flight := linkage.flight:
            data.qvel[:6] = [*flight.linear, *flight.angular]
        rows = np.empty((SAMPLES, model.nq))
        for k in range(SAMPLES):
            mujoco.mj_step(model, data, nstep=steps)
            rows[k] = data.qpos
            if any(warning.number for warning in data.warning):
                raise ArithmeticError("MuJoCo warned of a bad state")
        if not linkage.flight:
            return rows[:, angles]
        return flown(rows[:, :3], Rotation.from_quat(rows[:, 3:7], scalar_first=True), rows[:, angles])

    return run


def _places(model: mujoco.MjModel, linkage: Linkage) -> tuple[list[int], list[int]]:
    """Return where the joints are in qpos and in qvel."""
    joints = [model.joint(body.name) for body in linkage.hinged]
    return [int(joint.qposadr[0]) for joint in joints], [int(joint.dofadr[0]) for joint in joints]


def _batch(problem: Batch, steps: int) -> Run:
    """Return the motions of many starts by MuJoCo's own pool of threads."""
    linkage, n = problem.linkage, len(problem.linkage.q)
    states = np.hstack([np.zeros((STARTS, 1)), *problem.starts()])
    model = model_of(linkage, "RK4", problem.end / steps, 1.0)
    data = [mujoco.MjData(model) for _ in range(WORKERS)]
    applied = np.broadcast_to(linkage.torque, (STARTS, steps, n)).copy()
    force = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)

    def run() -> np.ndarray:
        kept, _ = rollout.rollout(model, data, states, applied, control_spec=force, persistent_pool=True)
        return kept[:, -1, 1 : 1 + n]

    return run


def _inverse(problem: Inverse) -> Run:
    model = model_of(problem.linkage, "RK4", 1e-3, 1.0)
    data, states = mujoco.MjData(model), problem.states()

    def run() -> np.ndarray:
        found = np.empty_like(states[0])
        for k, (q, v, a) in enumerate(zip(*states, strict=True)):
            data.qpos, data.qvel, data.qacc = q, v, a
            mujoco.mj_inverse(model, data)
            found[k] = data.qfrc_inverse
        return found

    return run


def model_of(linkage: Linkage, method: str, dt: float, stiffness: float) -> mujoco.MjModel:
    """Return the model; of long chains, which elements of XML are not nested deeply enough for, body by body."""
    if len(linkage.bodies) < DEEP:
        return mujoco.MjModel.from_xml_string(mjcf(linkage, method, dt, stiffness))
    assert not linkage.loops and not linkage.flight and not linkage.spring
    spec = mujoco.MjSpec.from_string(mjcf(replace(linkage, bodies=()), method, dt, stiffness))
    own: list[mujoco.MjsBody] = []
    for body in linkage.bodies:
        ((xx, xy, xz), (_, yy, yz), (_, _, zz)) = body.inertia
        quat = [float(x) for x in _quaternion(body).split()]
        added = (own[body.parent] if body.parent >= 0 else spec.worldbody).add_body(pos=body.place, quat=quat)
        added.explicitinertial, added.mass, added.ipos = True, body.mass, body.com
        added.fullinertia = [xx, yy, zz, xy, xz, yz]
        added.add_joint(name=body.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=body.axis, stiffness=body.stiffness,
                        damping=body.damping)  # fmt: skip
        own.append(added)
    return spec.compile()


def mjcf(linkage: Linkage, method: str, dt: float, stiffness: float) -> str:
    """Return the model; ``stiffness`` is k dt^2 of loops, with critical damping."""
    children: dict[int, list[int]] = {}
    for index, body in enumerate(linkage.bodies):
        children.setdefault(body.parent, []).append(index)

    def element(index: int) -> str:
        body = linkage.bodies[index]
        joint = "<freejoint/>" if linkage.flight and not index else _joint(body)
        inner = "".join(element(child) for child in children.get(index, []))
        return (f"<body name='link_{body.name}' pos='{_numbers(body.place)}' quat='{_quaternion(body)}'>{joint}"
                f"{_inertial(body)}{_sites(linkage, index)}{inner}</body>")  # fmt: skip

    tendon, loops = "", ""
    if spring := linkage.spring:
        tendon = (f"<tendon><spatial stiffness='{spring.stiffness!r}' springlength='{spring.length!r}'>"
                  f"<site site='hook'/><site site='anchor'/></spatial></tendon>")  # fmt: skip
    k, b = stiffness / dt**2, 2.0 * stiffness**0.5 / dt
    for name, _, _ in ends(linkage):
        if name.endswith("a"):
            loops += (f"<connect site1='{name}' site2='{name[:-1]}b' solref='{-k!r} {-b!r}' "
                      f"solimp='0.9999 0.9999 0.001 0.5 2'/>")  # fmt: skip
    bodies = "".join(element(index) for index in children.get(-1, []))
    return (
        f"<mujoco><compiler angle='radian' autolimits='false'/>"
        f"<option timestep='{dt!r}' integrator='{method}' gravity='{_numbers(linkage.gravity)}' tolerance='1e-15' "
        f"iterations='100'><flag refsafe='disable' contact='disable'/></option>"
        f"<worldbody>{_sites(linkage, -1)}{bodies}</worldbody>{tendon}<equality>{loops}</equality></mujoco>"
    )


def ends(linkage: Linkage) -> list[tuple[str, int, tuple[float, ...]]]:
    """Return the points that meet: name, body, place; a spatial loop's axis has two of them."""
    found = []
    for k, loop in enumerate(linkage.loops):
        for n, shift in enumerate((0.0,) if loop.planar else (-0.5, 0.5)):
            for side, index, point in zip("ab", loop.bodies, loop.points, strict=True):
                place = tuple(x + shift * axis for x, axis in zip(point, loop.axis, strict=True))
                found.append((f"loop_{k}_{n}_{side}", index, place))
    return found


def _sites(linkage: Linkage, index: int) -> str:
    """Return the points of a body that loops and the spring need."""
    points = [(name, place) for name, owner, place in ends(linkage) if owner == index]
    if (spring := linkage.spring) and index in (spring.body, -1):
        points.append(("anchor", spring.anchor) if index < 0 else ("hook", spring.point))
    return "".join(f"<site name='{name}' pos='{_numbers(place)}'/>" for name, place in points)


def _joint(body: Body) -> str:
    return (f"<joint name='{body.name}' type='hinge' axis='{_numbers(body.axis)}' stiffness='{body.stiffness!r}' "
            f"damping='{body.damping!r}'/>")  # fmt: skip


def _inertial(body: Body) -> str:
    ((xx, xy, xz), (_, yy, yz), (_, _, zz)) = body.inertia
    return (f"<inertial pos='{_numbers(body.com)}' mass='{body.mass!r}' "
            f"fullinertia='{_numbers((xx, yy, zz, xy, xz, yz))}'/>")  # fmt: skip


def _quaternion(body: Body) -> str:
    x, y, z, w = Quaternion(np.array(body.rotation)).coeffs()
    return _numbers((w, x, y, z))


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)
