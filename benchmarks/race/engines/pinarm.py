"""pinarm, as a user runs it: a scenario's ``run``, or arrays through a mechanism; stamp included, files not.

It comes before Pinocchio, as where a user imports nothing else, and then says how OpenMP's threads wait.
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import pinarm
from benchmarks.race.engines import Run, Setting, decades, flown
from benchmarks.race.mechanisms import ORIGIN, Body, Linkage, Vector, Z
from benchmarks.race.problems import Batch, Inverse, Motion, Problem
from pinarm.engine.integration.methods import METHODS

PASSED_OVER = frozenset({"rk4", "dopri5"})
"""Methods for other purposes: never the fastest of a single motion here."""


def prepare(problem: Problem) -> list[Setting]:
    if isinstance(problem, Inverse):
        return _inverse(problem)
    if isinstance(problem, Batch):
        return _batch(problem)
    assert isinstance(problem, Motion)
    methods = [name for name in METHODS if METHODS[name].setting == "tolerance" and name not in PASSED_OVER]
    methods.sort(key=lambda name: name != "stiff")
    if not problem.linkage.damping.any():
        methods.remove("stiff")
    return [Setting(method, tolerance, partial(_motion, problem, method, tolerance))
            for method in methods for tolerance in decades(3, 13, 4)]  # fmt: skip


def _motion(problem: Motion, method: str, tolerance: float) -> Run:
    linkage = problem.linkage
    scenario = _scenario(linkage, problem.end, len(problem.times) + 1, method, tolerance)
    columns = [scenario.mechanism.joints[body.name].q for body in linkage.hinged]

    def run() -> np.ndarray:
        q = scenario.run().trajectory.q[1:]
        if not linkage.flight:
            return q[:, columns]
        return flown(q[:, :3], Rotation.from_quat(q[:, 3:7]), q[:, columns])

    return run


def evaluations(problem: Motion, setting: Setting) -> float:
    """Return how many accelerations a run computes for its steps."""
    linkage, samples = problem.linkage, len(problem.times) + 1
    return _scenario(linkage, problem.end, samples, setting.method, setting.value).run().figures["evaluations"]


def _batch(problem: Batch) -> list[Setting]:
    ways = [*(("dopri5", tolerance) for tolerance in decades(3, 8, 4)),
            *(("dop853", tolerance) for tolerance in decades(3, 12, 4))]  # fmt: skip
    return [Setting(f"{method}, pinarm.batch", tolerance, partial(_motions, problem, method, tolerance))
            for method, tolerance in ways]  # fmt: skip


def _motions(problem: Batch, method: str, tolerance: float) -> Run:
    """Return what advances many starts in one call; their states are taken, not the measures of each motion."""
    scenario = _scenario(problem.linkage, problem.end, 2, method, tolerance)
    names = [body.name for body in problem.linkage.bodies]
    columns = [scenario.mechanism.joints[name].q for name in names]
    position, velocity = (dict(zip(names, x.T, strict=True)) for x in problem.starts())

    def run() -> np.ndarray:
        motions = pinarm.batch(scenario, position, velocity)
        q, _ = motions.states()
        if motions.failures:
            raise ArithmeticError(f"{len(motions.failures)} motions failed")
        return q[:, -1, columns]

    return run


def _inverse(problem: Inverse) -> list[Setting]:
    def make() -> Run:
        mechanism = _scenario(problem.linkage, 1.0, 2, "dop853", 1e-9).mechanism
        columns = [mechanism.joints[body.name].v for body in problem.linkage.bodies]
        q, v, a = (np.ascontiguousarray(x[:, np.argsort(columns)]) for x in problem.states())
        if problem.drive is None:
            return lambda: mechanism.inverse(q, v, a)[:, columns]
        drives, index = [problem.linkage.bodies[problem.drive].name], columns[problem.drive]
        return lambda: mechanism.inverse(q, v, a, drives=drives)[:, [index]]

    return [Setting("Mechanism.inverse", 0.0, make)]


def _scenario(linkage: Linkage, end: float, samples: int, method: str, tolerance: float) -> pinarm.Scenario:
    """Return the scenario of a free motion, its mechanism loaded."""
    names = [body.name for body in linkage.hinged]
    position = _map(names, linkage.q, "rad")
    velocity = _map(names, linkage.v, "rad/s")
    if flight := linkage.flight:
        velocity += "".join(f", root.{axis}: {x!r} m/s" for axis, x in zip("xyz", flight.linear, strict=True))
        velocity += "".join(
            f", root.angular_velocity.{axis}: {x!r} rad/s" for axis, x in zip("xyz", flight.angular, strict=True)
        )
    text = (
        f"pinarm: 1\nmechanism: mechanism.yaml\nproblem:\n  kind: forward\n"
        f"  time: {{end: {end!r} s, samples: {samples}}}\n"
        f"  initial:\n    position: {{{position}}}\n    velocity: {{{velocity}}}\n"
        f"outputs: [{', '.join(f'joint.{name}.position' for name in names)}]\n"
        f"accuracy: {{method: {method}, tolerance: {tolerance!r}}}\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, content in (
            ("model.urdf", urdf(linkage)), ("mechanism.yaml", _mechanism(linkage)), ("scenario.yaml", text),
        ):  # fmt: skip
            Path(folder, name).write_text(content)
        scenario = pinarm.load(Path(folder, "scenario.yaml"))
        assert scenario.mechanism
    return scenario


def _map(names: list[str], values: np.ndarray, unit: str) -> str:
    return ", ".join(f"{name}: {value!r} {unit}" for name, value in zip(names, values.tolist(), strict=True))


def _mechanism(linkage: Linkage) -> str:
    """Return the mechanism file: gravity, loops, springs and motors."""
    pull = -linkage.gravity[1]
    lines = ["pinarm: 1", "robot: model.urdf", f"base: {'floating' if linkage.flight else 'fixed'}",
             f"gravity: {{direction: -y, magnitude: {pull!r} m/s^2}}" if pull else "gravity: none"]  # fmt: skip
    if linkage.loops:
        axis = ["xyz"[int(np.argmax(loop.axis))] for loop in linkage.loops]
        lines += ["loops:", *(f"  loop_{k}: {{kind: revolute, between: [loop_{k}_0, loop_{k}_1], axis: {axis[k]}}}"
                              for k in range(len(linkage.loops)))]  # fmt: skip
    forces = [line for body in linkage.hinged for line in _joint_forces(body)]
    if spring := linkage.spring:
        forces.append(f"spring: {{kind: point_spring, between: [spring_0, spring_1], "
                      f"stiffness: {spring.stiffness!r} N/m, free_length: {spring.length!r} m}}")  # fmt: skip
    if forces:
        lines += ["forces:", *(f"  {force}" for force in forces)]
    return "\n".join(lines) + "\n"


def _joint_forces(body: Body) -> list[str]:
    found = []
    if body.torque:
        found.append(f"motor_{body.name}: {{kind: joint_effort, joint: {body.name}, "
                     f"effort: {{law: constant, value: {body.torque!r} N*m}}}}")  # fmt: skip
    if body.stiffness or body.damping:
        found.append(f"spring_{body.name}: {{kind: joint_spring, joint: {body.name}, "
                     f"stiffness: {body.stiffness!r} N*m/rad, damping: {body.damping!r} N*m*s/rad}}")  # fmt: skip
    return found


def urdf(linkage: Linkage) -> str:
    """Return the model; points that loops and the spring need are links of their own."""
    from pinocchio.rpy import matrixToRpy

    links = ["ground", *(f"link_{body.name}" for body in linkage.bodies)]
    parts = [] if linkage.flight else ["<link name='ground'/>"]
    for body in linkage.bodies:
        parts.append(_link(f"link_{body.name}", body))
        if body in linkage.hinged:
            kind, turned = "prismatic" if body.slides else "continuous", matrixToRpy(np.array(body.rotation)).tolist()
            parts.append(_joint(body.name, kind, links[body.parent + 1], f"link_{body.name}", body.place, turned,
                                body.axis))  # fmt: skip
    points = [(f"loop_{k}_{side}", loop.bodies[side], loop.points[side])
              for k, loop in enumerate(linkage.loops) for side in (0, 1)]  # fmt: skip
    if spring := linkage.spring:
        points += [("spring_0", spring.body, spring.point), ("spring_1", -1, spring.anchor)]
    for name, body_index, place in points:
        parts.append(f"<link name='{name}'/>")
        parts.append(_joint(f"{name}_fixed", "fixed", links[body_index + 1], name, place))
    return "<robot name='race'>\n" + "\n".join(parts) + "\n</robot>\n"


def _link(name: str, body: Body) -> str:
    ((xx, xy, xz), (_, yy, yz), (_, _, zz)) = body.inertia
    return (
        f"<link name='{name}'><inertial><origin xyz='{_numbers(body.com)}'/><mass value='{body.mass!r}'/><inertia "
        f"ixx='{xx!r}' ixy='{xy!r}' ixz='{xz!r}' iyy='{yy!r}' iyz='{yz!r}' izz='{zz!r}'/></inertial></link>"
    )


def _joint(
    name: str, kind: str, parent: str, child: str, place: Vector, turned: Vector = ORIGIN, axis: Vector = Z
) -> str:  # fmt: skip
    return (
        f"<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>"
        f"<origin xyz='{_numbers(place)}' rpy='{_numbers(turned)}'/><axis xyz='{_numbers(axis)}'/>"
        f"<limit lower='-100' upper='100' effort='1e6' velocity='100'/></joint>"
    )


def _numbers(values: Vector) -> str:
    return " ".join(repr(float(value)) for value in values)
