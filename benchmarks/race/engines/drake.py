"""Drake: trees as continuous plants with error control; loops as ball constraints, which only the SAP solver has.

That solver takes fixed steps of first order, and treats constraints as stiff springs with damping.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    LinearSpringDamper,
    MultibodyForces,
    RevoluteJoint,
    RevoluteSpring,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

from benchmarks.race.engines import WORKERS, Run, Setting, Unable, decades, halvings
from benchmarks.race.mechanisms import Body, Linkage
from benchmarks.race.problems import SAMPLES, Batch, Inverse, Motion, Problem

Array = np.ndarray


def prepare(problem: Problem) -> list[Setting]:
    if isinstance(problem, Inverse):
        if problem.linkage.loops:
            raise Unable("inverse dynamics knows no loops")
        return [Setting("CalcInverseDynamics in a loop", 0.0, partial(_inverse, problem))]
    if isinstance(problem, Batch):
        return _batch(problem)
    assert isinstance(problem, Motion)
    if problem.linkage.loops:
        steps = [problem.end / (SAMPLES * n) for n in halvings(16, 16384)]
        return [Setting("SAP", step, partial(_motion, problem, "SAP", step)) for step in steps]
    schemes = ["runge_kutta5", "runge_kutta3"]
    if problem.linkage.damping.any():
        schemes = ["radau3", "runge_kutta5"]
    return [Setting(scheme, tolerance, partial(_motion, problem, scheme, tolerance))
            for scheme in schemes for tolerance in decades(2, 12, 2)]  # fmt: skip


class Model:
    """A plant and its simulator.

    Attributes:
        linkage: The numbers.
        plant: Drake's.
    """

    def __init__(self, linkage: Linkage, step: float = 0.0) -> None:
        self.linkage, self.plant = linkage, MultibodyPlant(step)
        plant, bodies = self.plant, []
        if step:
            plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
        plant.mutable_gravity_field().set_gravity_vector(np.array(linkage.gravity))
        joints = []
        for body in linkage.bodies:
            bodies.append(plant.AddRigidBody(f"link_{body.name}", _inertia(body)))
            if body in linkage.hinged:
                joints.append(self._joint(body, bodies, bodies[-1]))
        world = plant.world_body()
        for loop in linkage.loops:
            for shift in (0.0,) if loop.planar else (-0.5, 0.5):
                ends: list[Any] = []
                for index, point in zip(loop.bodies, loop.points, strict=True):
                    ends += [bodies[index] if index >= 0 else world, np.array(point) + shift * np.array(loop.axis)]
                plant.AddBallConstraint(*ends)
        if spring := linkage.spring:
            plant.AddForceElement(LinearSpringDamper(
                bodies[spring.body], np.array(spring.point), world, np.array(spring.anchor), spring.length,
                spring.stiffness, 0.0))  # fmt: skip
        plant.Finalize()
        self.angles = [joint.position_start() for joint in joints]
        self.rates = [joint.velocity_start() for joint in joints]
        self.hub = bodies[0]

    def _joint(self, body: Body, bodies: list[Any], own: Any) -> RevoluteJoint:
        plant = self.plant
        parent = bodies[body.parent] if body.parent >= 0 else plant.world_body()
        place = RigidTransform(RotationMatrix(np.array(body.rotation)), np.array(body.place))
        frame = plant.AddFrame(FixedOffsetFrame(f"at_{body.name}", parent.body_frame(), place))
        joint = plant.AddJoint(RevoluteJoint(body.name, frame, own.body_frame(), np.array(body.axis), body.damping))
        if body.stiffness:
            plant.AddForceElement(RevoluteSpring(joint, 0.0, body.stiffness))
        return joint

    def simulator(self, scheme: str, tolerance: float) -> Simulator:
        """Return a simulator, with error control but for SAP."""
        simulator = Simulator(self.plant)
        if scheme != "SAP":
            integrator = ResetIntegratorFromFlags(simulator, scheme, 0.1)
            integrator.set_target_accuracy(tolerance)
            integrator.set_requested_minimum_step_size(1e-12)
        context = simulator.get_mutable_context()
        force = np.zeros(self.plant.num_velocities())
        force[self.rates] = self.linkage.torque
        self.plant.get_applied_generalized_force_input_port().FixValue(context, force)
        return simulator

    def motion(self, simulator: Simulator, q: Array, v: Array, times: Array) -> Array:
        """Return the answer for angles and velocities of the joints at the start."""
        context, plant = simulator.get_mutable_context(), self.plant
        position, velocity = np.zeros(plant.num_positions()), np.zeros(plant.num_velocities())
        position[self.angles], velocity[self.rates] = q, v
        if flight := self.linkage.flight:
            position[0], velocity[:6] = 1.0, [*flight.angular, *flight.linear]
        context.SetTime(0.0)
        plant.SetPositions(context, position)
        plant.SetVelocities(context, velocity)
        simulator.Initialize()
        rows = []
        for time in times:
            simulator.AdvanceTo(time)
            row = plant.GetPositions(context)[self.angles]
            if flight:
                pose = plant.EvalBodyPoseInWorld(context, self.hub)
                row = np.concatenate([pose.translation(), pose.rotation().matrix().ravel(), row])
            rows.append(row)
        return np.array(rows)


def _inertia(body: Body) -> SpatialInertia:
    i = np.array(body.inertia)
    central = RotationalInertia(i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
    return SpatialInertia.MakeFromCentralInertia(body.mass, np.array(body.com), central)


def _motion(problem: Motion, scheme: str, value: float) -> Run:
    model = Model(problem.linkage, value if scheme == "SAP" else 0.0)
    simulator, linkage = model.simulator(scheme, value), problem.linkage
    return lambda: model.motion(simulator, linkage.q, linkage.v, problem.times)


_own: dict[float, tuple[Model, Simulator]] = {}


def _part(problem: Batch, tolerance: float, first: int, last: int) -> Array:
    """Return the last angles of some of the starts; the model stays in the process."""
    if tolerance not in _own:
        model = Model(problem.linkage)
        _own[tolerance] = model, model.simulator("runge_kutta5", tolerance)
    model, simulator = _own[tolerance]
    q, v = problem.starts()
    end = np.array([problem.end])
    return np.array([model.motion(simulator, q[k], v[k], end)[-1] for k in range(first, last)])


def _batch(problem: Batch) -> list[Setting]:
    """Return runs in turn, in as many processes as there are cores."""
    pool = ProcessPoolExecutor(WORKERS)
    cuts = np.linspace(0, len(problem.starts()[0]), 4 * WORKERS + 1).astype(int)

    def make(tolerance: float) -> Run:
        def run() -> Array:
            parts = [pool.submit(_part, problem, tolerance, *cut) for cut in pairwise(cuts)]
            return np.concatenate([part.result() for part in parts])

        run()  # lets every process build its model
        return run

    said = f"runge_kutta5, processes {WORKERS}"
    return [Setting(said, tolerance, partial(make, tolerance)) for tolerance in decades(3, 10, 1)]


def _inverse(problem: Inverse) -> Run:
    model = Model(problem.linkage)
    plant, context = model.plant, model.plant.CreateDefaultContext()
    states = problem.states()

    def run() -> Array:
        found, forces = np.empty_like(states[0]), MultibodyForces(plant)
        for k, (q, v, a) in enumerate(zip(*states, strict=True)):
            plant.SetPositions(context, q)
            plant.SetVelocities(context, v)
            plant.CalcForceElementsContribution(context, forces)
            found[k] = plant.CalcInverseDynamics(context, a, forces)
        return found

    return run
