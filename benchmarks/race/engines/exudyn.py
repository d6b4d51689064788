"""Exudyn: a kinematic tree in minimal coordinates with loops between its markers, or planar bodies and their joints.

Trees take explicit Runge-Kutta steps, loops generalised alpha with rho = 0.9: with 1, or by the trapezoidal rule at
index 2, it fails at singular positions. A body that flies has three slides and three turns, about x, y and z.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import pairwise, product
from typing import Any

import exudyn as exu
import numpy as np
from exudyn import itemInterface as item
from exudyn.solver import SolveDynamic
from scipy.spatial.transform import Rotation

from benchmarks.race.engines import WORKERS, Run, Setting, Unable, flown, halvings
from benchmarks.race.mechanisms import ORIGIN, Body, Linkage, Z, diagonal
from benchmarks.race.problems import SAMPLES, Batch, Inverse, Motion, Problem

Array = np.ndarray
AXES = "XYZ"
RHO = 0.9
SMALL = 20
"""Bodies up to which dense matrices are faster."""

MANY = 200
"""Bodies of planar trees from which on they are also tried as planar bodies and their joints."""


def prepare(problem: Problem) -> list[Setting]:
    if isinstance(problem, Inverse):
        raise Unable("has no inverse dynamics")
    if isinstance(problem, Batch):
        return _batch(problem)
    assert isinstance(problem, Motion)
    linkage = problem.linkage
    if linkage.loops:
        names = ["GeneralizedAlpha", "TrapezoidalIndex2"] if problem.regular else ["GeneralizedAlpha"]
        models = [Planar, Tree] if linkage.loops[0].planar else [Tree]
    else:
        names = ["TrapezoidalIndex2", "GeneralizedAlpha", "RK67"] if linkage.damping.any() else ["RK44", "RK67"]
        models = [Tree]
    ways = list(product(models, names))
    if not linkage.loops and len(linkage.bodies) > MANY:  # a tree has a full mass matrix, bodies have sparse equations
        ways = [*product([Planar], ["TrapezoidalIndex2", "GeneralizedAlpha"]), *ways]
    return [_setting(problem, model, name, n) for (model, name), n in product(ways, halvings(1, 8192))]


def _setting(problem: Motion, kind: type[Tree] | type[Planar], name: str, steps: int) -> Setting:
    linkage = problem.linkage

    def make() -> Run:
        model, given = kind(linkage), settings(linkage, problem.end, name, steps)
        return lambda: model.motion(given, linkage.q, linkage.v)

    said = f"{name}, rho {RHO:g}" if name == "GeneralizedAlpha" else name
    return Setting(f"{said}, planar bodies" if kind is Planar else said, problem.end / (SAMPLES * steps), make)


def settings(linkage: Linkage, end: float, name: str, steps: int) -> exu.SimulationSettings:
    """Return the settings of so many steps between samples."""
    found = exu.SimulationSettings()
    time, solution = found.timeIntegration, found.solution
    time.endTime, time.numberOfSteps = end, SAMPLES * steps
    time.solverType = getattr(exu.DynamicSolverType, name)
    time.verboseMode, time.verboseModeFile, time.adaptiveStep = 0, 0, False
    time.generalizedAlpha.spectralRadius = RHO
    time.newton.useModifiedNewton = True
    time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-8, 1e-10
    solution.file.write, solution.sensors.writePeriod = False, end / SAMPLES * (1 - 1e-9)
    dense = len(linkage.bodies) <= SMALL
    found.linearSolver.solverType = getattr(exu.LinearSolverType, "EigenDense" if dense else "EigenSparse")
    found.linearSolver.ignoreSingularJacobian = any(not loop.planar for loop in linkage.loops)
    return found


def _solve(system: exu.MainSystem, given: exu.SimulationSettings) -> None:
    if not SolveDynamic(system, given, showCausingItems=False, autoAssemble=False, storeSolver=False):
        raise ArithmeticError("Exudyn's solver gave up")


def _sensor(system: exu.MainSystem, node: int) -> int:
    """Return a sensor of the coordinates of a node, whose samples stay in memory."""
    return system.AddSensor(item.SensorNode(nodeNumber=node, storeInternal=True, writeToFile=False,
                                            outputVariableType=exu.OutputVariableType.Coordinates))  # fmt: skip


def _spring(system: exu.MainSystem, linkage: Linkage, marker: Callable[[int, tuple[float, ...]], int]) -> None:
    if spring := linkage.spring:
        markers = [marker(spring.body, spring.point), marker(-1, spring.anchor)]
        system.AddObject(item.ObjectConnectorSpringDamper(
            markerNumbers=markers, stiffness=spring.stiffness, referenceLength=spring.length))  # fmt: skip


class Tree:
    """A linkage as a kinematic tree. Exudyn has no axes that point backwards: such coordinates change sign."""

    def __init__(self, linkage: Linkage) -> None:
        self.linkage, self.signs = linkage, np.array([sum(body.axis) for body in linkage.hinged])
        self._container = exu.SystemContainer()
        self.system = self._container.AddSystem()
        self._before = 6 if linkage.flight else 0
        massless = Body("", -1, ORIGIN, Z, 0.0, ORIGIN, diagonal(0.0, 0.0, 0.0))
        bodies = [*[massless] * max(self._before - 1, 0), *linkage.bodies]
        kinds = [f"Prismatic{axis}" for axis in AXES] + [f"Revolute{axis}" for axis in AXES]
        kinds = kinds[: self._before] + [f"Revolute{AXES[int(np.argmax(np.abs(b.axis)))]}" for b in linkage.hinged]
        shift, size, still = max(self._before - 1, 0), len(kinds), [0.0] * len(kinds)
        parents = [*range(-1, self._before - 1), *(b.parent + shift if b.parent >= 0 else -1 for b in linkage.hinged)]
        self._node = self.system.AddNode(item.NodeGenericODE2(
            referenceCoordinates=still, initialCoordinates=still, initialCoordinates_t=still,
            numberOfODE2Coordinates=size))  # fmt: skip
        free = [0.0] * self._before
        self._tree = self.system.AddObject(item.ObjectKinematicTree(
            nodeNumber=self._node, jointTypes=[getattr(exu.JointType, kind) for kind in kinds], linkParents=parents,
            jointTransformations=_list(exu.Matrix3DList(), [body.rotation for body in bodies]),
            jointOffsets=_list(exu.Vector3DList(), [body.place for body in bodies]),
            linkInertiasCOM=_list(exu.Matrix3DList(), [body.inertia for body in bodies]),
            linkCOMs=_list(exu.Vector3DList(), [body.com for body in bodies]),
            linkMasses=[body.mass for body in bodies], gravity=list(linkage.gravity),
            jointForceVector=[*free, *(self.signs * linkage.torque)], jointPositionOffsetVector=still,
            jointVelocityOffsetVector=still, jointPControlVector=[*free, *linkage.stiffness],
            jointDControlVector=[*free, *linkage.damping]))  # fmt: skip
        self._ground = self.system.AddObject(item.ObjectGround())
        self._close()
        self._sensor = _sensor(self.system, self._node)
        self.system.Assemble()

    def _marker(self, body: int, place: tuple[float, ...]) -> int:
        if body < 0:
            return self.system.AddMarker(item.MarkerBodyRigid(bodyNumber=self._ground, localPosition=list(place)))
        return self.system.AddMarker(item.MarkerKinematicTreeRigid(
            objectNumber=self._tree, linkNumber=body, localPosition=list(place)))  # fmt: skip

    def _close(self) -> None:
        for loop in self.linkage.loops:
            markers = [self._marker(*end) for end in zip(loop.bodies, loop.points, strict=True)]
            turns = [int(not x) for x in loop.axis]
            joint = (item.ObjectJointSpherical(markerNumbers=markers, constrainedAxes=[1, 1, 0]) if loop.planar else
                     item.ObjectJointGeneric(markerNumbers=markers, constrainedAxes=[1, 1, 1, *turns]))  # fmt: skip
            self.system.AddObject(joint)
        _spring(self.system, self.linkage, self._marker)

    def motion(self, given: exu.SimulationSettings, q: Array, v: Array) -> Array:
        """Return the answer for angles and velocities of the joints at the start."""
        flight = self.linkage.flight
        before = [*flight.linear, *flight.angular] if flight else []
        start = {"initialCoordinates": [*[0.0] * len(before), *(self.signs * q)],
                 "initialCoordinates_t": [*before, *(self.signs * v)]}  # fmt: skip
        for name, values in start.items():
            self.system.SetNodeParameter(self._node, name, values)
        self.system.Assemble()
        _solve(self.system, given)
        found = np.asarray(self.system.GetSensorStoredData(self._sensor))[-SAMPLES:, 1:]
        joints = self.signs * found[:, self._before :]
        return flown(found[:, :3], Rotation.from_euler("XYZ", found[:, 3:6]), joints) if flight else joints


class Planar:
    """A linkage in the plane x-y as bodies with three coordinates each, and revolute joints."""

    def __init__(self, linkage: Linkage) -> None:
        self.linkage, self._angles = linkage, np.zeros(len(linkage.bodies))
        self._container = exu.SystemContainer()
        self.system = self._container.AddSystem()
        self._ground, self._bodies = self.system.AddObject(item.ObjectGround()), []
        places, rates, nodes = [], [], []
        for index, body in enumerate(linkage.bodies):
            above, sign = body.parent >= 0, body.axis[2]
            turned, about = (self._angles[body.parent], places[body.parent]) if above else (0.0, 0j)
            drift, spin = rates[body.parent] if above else (0j, 0.0)
            arm = np.exp(1j * turned) * complex(*body.place[:2])
            places.append(about + arm)
            rates.append((drift + 1j * spin * arm, spin + sign * body.v))
            self._angles[index] = turned + sign * body.q
            lever = np.exp(1j * self._angles[index]) * complex(*body.com[:2])
            centre, speed = places[-1] + lever, rates[-1][0] + 1j * rates[-1][1] * lever
            nodes.append(self.system.AddNode(item.NodeRigidBody2D(
                referenceCoordinates=[centre.real, centre.imag, self._angles[index]],
                initialVelocities=[speed.real, speed.imag, rates[-1][1]])))  # fmt: skip
            self._bodies.append(self.system.AddObject(item.ObjectRigidBody2D(
                nodeNumber=nodes[-1], mass=body.mass, inertia=body.inertia[2][2])))  # fmt: skip
        self._join()
        _spring(self.system, linkage, self._marker)
        self._sensors = [_sensor(self.system, node) for node in nodes]
        self.system.Assemble()

    def _marker(self, body: int, place: tuple[float, ...]) -> int:
        com = self.linkage.bodies[body].com if body >= 0 else ORIGIN
        return self.system.AddMarker(item.MarkerBodyRigid(
            bodyNumber=self._bodies[body] if body >= 0 else self._ground,
            localPosition=[x - y for x, y in zip(place, com, strict=True)]))  # fmt: skip

    def _join(self) -> None:
        """Add the joints of tree and loops, weights and motors."""
        bodies = self.linkage.bodies
        pairs = [((body.parent, body.place), (index, ORIGIN)) for index, body in enumerate(bodies)]
        pairs += [((loop.bodies[0], loop.points[0]), (loop.bodies[1], loop.points[1])) for loop in self.linkage.loops]
        for one, other in pairs:
            markers = [self._marker(*one), self._marker(*other)]
            self.system.AddObject(item.ObjectJointRevolute2D(markerNumbers=markers))
        for index, body in enumerate(bodies):
            centre = self._marker(index, body.com)
            weight = [body.mass * g for g in self.linkage.gravity]
            self.system.AddLoad(item.LoadForceVector(markerNumber=centre, loadVector=weight))
            if body.torque:
                assert body.parent < 0
                torque = [0.0, 0.0, body.axis[2] * body.torque]
                self.system.AddLoad(item.LoadTorqueVector(markerNumber=centre, loadVector=torque))

    def motion(self, given: exu.SimulationSettings, q: Array, v: Array) -> Array:
        """Return the answer; the start is that of the linkage."""
        _solve(self.system, given)
        turned = [np.asarray(self.system.GetSensorStoredData(sensor))[-SAMPLES:, 3] for sensor in self._sensors]
        angles = np.array(turned).T + self._angles
        bodies = self.linkage.bodies
        above = np.stack([angles[:, b.parent] if b.parent >= 0 else np.zeros(SAMPLES) for b in bodies], axis=1)
        return np.array([body.axis[2] for body in bodies]) * (angles - above)


_own: dict[str, Tree] = {}


def _part(problem: Batch, steps: int, first: int, last: int) -> Array:
    """Return the last angles of some of the starts; the model stays in the process."""
    if problem.name not in _own:
        _own[problem.name] = Tree(problem.linkage)
    q, v = problem.starts()
    given = settings(problem.linkage, problem.end, "RK67", steps)
    return np.array([_own[problem.name].motion(given, q[k], v[k])[-1] for k in range(first, last)])


def _batch(problem: Batch) -> list[Setting]:
    """Return runs in turn, in as many processes as there are cores."""
    pool = ProcessPoolExecutor(WORKERS)
    cuts = np.linspace(0, len(problem.starts()[0]), 4 * WORKERS + 1).astype(int)

    def make(steps: int) -> Run:
        def run() -> Array:
            parts = [pool.submit(_part, problem, steps, *cut) for cut in pairwise(cuts)]
            return np.concatenate([part.result() for part in parts])

        run()  # lets every process build its model
        return run

    return [Setting(f"RK67, processes {WORKERS}", problem.end / (SAMPLES * steps), partial(make, steps))
            for steps in (1, 2, 3, 4, 6, 8, 12, 16)]  # fmt: skip


def _list(empty: Any, rows: list[Any]) -> Any:
    """Return Exudyn's list of vectors or matrices."""
    for row in rows:
        empty.Append(np.array(row))
    return empty
