"""How the user of each engine computes torques of many variants: the model is built once, its numbers are set anew.

Exudyn has no inverse dynamics. A user of Pinocchio, MuJoCo or Drake closes the loop himself: ``Tree`` is what he needs.
"""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

import numpy as np

from benchmarks.race.variants import ANGLES, QUESTIONS, ROOT, ROWS, SPEED

Run = Callable[[], np.ndarray]
CLOSED = 1e-12
SLIM = 1e-12
"""Inertia of a rod about itself [kg*m^2]: some engines take no 0."""


class Tree(Protocol):
    """Rods that turn about z: mass at its place x along the rod, and inertia about there, of each."""

    def set(self, places: np.ndarray, ends: np.ndarray, bodies: np.ndarray) -> None:
        """Set places of joints along their parents, ends that meet, both (n,), and mass, place, inertia, (n, 3)."""
        ...

    def closing(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the gap between the ends of the coupler and of the rocker [m], and its Jacobian, (2,) and (2, 3)."""
        ...

    def drift(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the second derivative of the gap where the joints do not accelerate, shape (2,)."""
        ...

    def torques(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the efforts at all joints, shape (n,)."""
        ...


def arms(tree: Tree, variants: np.ndarray) -> np.ndarray:
    """Return the largest holding torque of each arm."""
    found, still = np.empty(len(variants)), np.zeros(2)
    for k, (load, rod, length) in enumerate(variants.tolist()):
        mass = load + rod
        centre = (load + rod / 2.0) * length / mass
        inertia = rod * length**2 / 12.0 + rod * (length / 2.0 - centre) ** 2 + load * (length - centre) ** 2
        tree.set(np.array([0.0, 0.25]), np.zeros(2), np.array([[1.0, 0.125, 0.005], [mass, centre, inertia]]))
        found[k] = max(tree.torques(np.array([0.0, angle]), still, still)[1] for angle in ANGLES.tolist())
    return found


def cranks(tree: Tree, variants: np.ndarray) -> np.ndarray:
    """Return the largest torque at the crank of each four-bar."""
    found, step = np.empty(len(variants)), 2.0 * np.pi / SPEED / (ROWS - 1)
    for k, (a, b, c, d, *masses) in enumerate(variants.tolist()):
        lengths = np.array([a, b, c])
        bodies = np.stack([masses, lengths / 2.0, masses * lengths**2 / 12.0], axis=1)
        tree.set(np.array([0.0, a, d]), np.array([0.0, b, c]), bodies)
        q, v, acceleration = np.deg2rad([0.0, 40.0, 80.0]), np.zeros(3), np.zeros(3)
        most = -np.inf
        for row in range(ROWS):
            q = q + step * (v + 0.5 * step * acceleration)
            q[0] = SPEED * step * row
            gap, rows = tree.closing(q)
            while np.abs(gap).max() > CLOSED:
                q[1:] -= np.linalg.solve(rows[:, 1:], gap)
                gap, rows = tree.closing(q)
            v = SPEED * np.append(1.0, -np.linalg.solve(rows[:, 1:], rows[:, 0]))
            acceleration = np.append(0.0, -np.linalg.solve(rows[:, 1:], tree.drift(q, v)))
            most = max(most, float(tree.torques(q, v, acceleration) @ v) / SPEED)
        found[k] = most
    return found


class PinocchioTree:
    """Rods in Pinocchio."""

    def __init__(self, parents: list[int]) -> None:
        import pinocchio as pin

        self.pin, self.model = pin, pin.Model()
        for k, parent in enumerate(parents):
            joint = self.model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Identity(), str(k))
            self.model.addFrame(pin.Frame(f"end{k}", joint, pin.SE3.Identity(), pin.OP_FRAME))
        self.model.gravity.linear = np.array([0.0, -9.81, 0.0])
        self.data = self.model.createData()
        self.frames = [self.model.getFrameId(f"end{k}") for k in range(len(parents))]

    def set(self, places: np.ndarray, ends: np.ndarray, bodies: np.ndarray) -> None:
        pin, model = self.pin, self.model
        for k, (mass, centre, inertia) in enumerate(bodies):
            model.jointPlacements[k + 1].translation = np.array([places[k], 0.0, 0.0])
            model.frames[self.frames[k]].placement = pin.SE3(np.eye(3), np.array([ends[k], 0.0, 0.0]))
            model.inertias[k + 1] = pin.Inertia(mass, np.array([centre, 0.0, 0.0]), np.diag([0.0, inertia, inertia]))

    def closing(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pin, model, data, (_, one, two) = self.pin, self.model, self.data, self.frames
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        aligned = pin.LOCAL_WORLD_ALIGNED
        rows = pin.getFrameJacobian(model, data, one, aligned) - pin.getFrameJacobian(model, data, two, aligned)
        return (data.oMf[one].translation - data.oMf[two].translation)[:2], rows[:2]

    def drift(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        pin, model, data, (_, one, two) = self.pin, self.model, self.data, self.frames
        pin.forwardKinematics(model, data, q, v, np.zeros_like(v))
        first, second = (
            pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).linear
            for frame in (one, two)
        )
        return np.asarray((first - second)[:2])

    def torques(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        return np.asarray(self.pin.rnea(self.model, self.data, q, v, a))


class MujocoTree:
    """Rods in MuJoCo."""

    def __init__(self, parents: list[int]) -> None:
        import mujoco

        self.mujoco, spec = mujoco, mujoco.MjSpec()
        spec.option.gravity = [0.0, -9.81, 0.0]
        bodies = [spec.worldbody]
        for k, parent in enumerate(parents):
            body = bodies[parent].add_body(  # its centre apart from its origin, or MuJoCo takes these for the same
                name=str(k), mass=1.0, ipos=[1.0, 0.0, 0.0], inertia=[1.0, 1.0, 1.0], explicitinertial=True
            )
            body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
            body.add_site(name=f"end{k}", pos=[1.0, 0.0, 0.0])
            bodies.append(body)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.rows = np.zeros((2, 3, len(parents)))
        self.rates = np.zeros_like(self.rows)

    def set(self, places: np.ndarray, ends: np.ndarray, bodies: np.ndarray) -> None:
        model = self.model
        model.body_pos[1:, 0], model.site_pos[:, 0] = places, ends
        model.body_mass[1:], model.body_ipos[1:, 0] = bodies[:, 0], bodies[:, 1]
        model.body_inertia[1:, 0], model.body_inertia[1:, 1:] = SLIM, bodies[:, 2:]

    def closing(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mujoco, model, data = self.mujoco, self.model, self.data
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for k in range(2):
            mujoco.mj_jacSite(model, data, self.rows[k], None, k + 1)
        return (data.site_xpos[1] - data.site_xpos[2])[:2], (self.rows[0] - self.rows[1])[:2]

    def drift(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        mujoco, model, data = self.mujoco, self.model, self.data
        data.qvel[:] = v
        mujoco.mj_comVel(model, data)
        for k in range(2):
            mujoco.mj_jacDot(model, data, self.rates[k], None, data.site_xpos[k + 1], k + 2)
        return np.asarray(((self.rates[0] - self.rates[1]) @ v)[:2])

    def torques(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        data = self.data
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        self.mujoco.mj_inverse(self.model, data)
        return np.asarray(data.qfrc_inverse)


class DrakeTree:
    """Rods in Drake, whose masses and places are parameters of a context."""

    def __init__(self, parents: list[int]) -> None:
        from pydrake.math import RigidTransform
        from pydrake.multibody import plant, tree

        self.tree, self.transform = tree, RigidTransform
        self.plant = plant.MultibodyPlant(0.0)
        self.plant.mutable_gravity_field().set_gravity_vector([0.0, -9.81, 0.0])
        self.frames, self.bodies = [], [self.plant.world_body()]
        for k, parent in enumerate(parents):
            body = self.plant.AddRigidBody(str(k), tree.SpatialInertia.SolidBoxWithMass(1.0, 1.0, 1.0, 1.0))
            made = tree.FixedOffsetFrame(f"on{k}", self.bodies[parent].body_frame(), RigidTransform())
            frame = self.plant.AddFrame(made)
            self.frames.append(frame)
            self.plant.AddJoint(tree.RevoluteJoint(f"j{k}", frame, body.body_frame(), [0.0, 0.0, 1.0]))
            self.bodies.append(body)
        self.plant.Finalize()
        self.context = self.plant.CreateDefaultContext()
        self.forces = tree.MultibodyForces(self.plant)
        self.ends = np.zeros(len(parents))

    def set(self, places: np.ndarray, ends: np.ndarray, bodies: np.ndarray) -> None:
        tree, self.ends = self.tree, ends
        for frame, place in zip(self.frames, places.tolist(), strict=True):
            frame.SetPoseInParentFrame(self.context, self.transform([place, 0.0, 0.0]))
        for body, (mass, centre, inertia) in zip(self.bodies[1:], bodies.tolist(), strict=True):
            unit = (inertia + mass * centre**2) / mass
            made = tree.SpatialInertia(mass, [centre, 0.0, 0.0], tree.UnitInertia(SLIM, unit, unit))
            body.SetSpatialInertiaInBodyFrame(self.context, made)

    def closing(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        plant, context, world = self.plant, self.context, self.plant.world_frame()
        plant.SetPositions(context, q)
        points, rows = [], []
        for k in (1, 2):
            frame, end = self.bodies[k + 1].body_frame(), [self.ends[k], 0.0, 0.0]
            points.append(plant.CalcPointsPositions(context, frame, end, world)[:2, 0])
            rows.append(plant.CalcJacobianTranslationalVelocity(
                context, self.tree.JacobianWrtVariable.kV, frame, end, world, world)[:2])  # fmt: skip
        return points[0] - points[1], rows[0] - rows[1]

    def drift(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        plant, context, world = self.plant, self.context, self.plant.world_frame()
        plant.SetVelocities(context, v)
        first, second = (
            plant.CalcBiasTranslationalAcceleration(
                context, self.tree.JacobianWrtVariable.kV, self.bodies[k + 1].body_frame(),
                [self.ends[k], 0.0, 0.0], world, world)[:2, 0]
            for k in (1, 2)
        )  # fmt: skip
        return np.asarray(first - second)

    def torques(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        plant, context = self.plant, self.context
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        plant.CalcForceElementsContribution(context, self.forces)
        return np.asarray(plant.CalcInverseDynamics(context, a, self.forces))


def looped(kind: Callable[[list[int]], Tree]) -> Callable[[str, np.ndarray], Run]:
    """Return what prepares a loop over variants with an engine's tree."""

    def prepared(name: str, variants: np.ndarray) -> Run:
        if name == "arms":
            tree = kind([0, 1])
            return lambda: arms(tree, variants)
        tree = kind([0, 1, 0])
        return lambda: cranks(tree, variants)

    return prepared


SCENARIOS = {
    "arms": ("gen411_arm_static", {"problem.over.phi.samples": 5}, "C_B"),
    "cranks": ("crank_rocker_turning", {"problem.motion.theta2.speed": "10 rad/s",
               "problem.time.end": f"{2.0 * np.pi / SPEED!r} s", "problem.time.samples": ROWS}, "T"),
}  # fmt: skip


def swept(name: str, variants: np.ndarray) -> Run:
    """Return a sweep over a table of cases, with one process."""
    import pinarm

    scenario, values, result = SCENARIOS[name]
    folder = Path(tempfile.mkdtemp())
    heads = [f"arguments.{key} [{'kg' if key[0] == 'm' else 'm'}]" for key in QUESTIONS[name].ranges]
    with (folder / "cases.csv").open("w", newline="") as file:
        csv.writer(file).writerows([heads, *variants.tolist()])

    def run() -> np.ndarray:
        with ThreadPoolExecutor(1) as executor:  # in this process, whose time is measured
            sweep = pinarm.sweep(ROOT / "scenarios" / f"{scenario}.yaml", values=values, cases=folder / "cases.csv",
                                 results=[result], executor=executor)  # fmt: skip
        return next(series.values for series in sweep.columns if series.name == f"max {result}")

    return run


ROUTES: dict[str, Callable[[str, np.ndarray], Run]] = {
    "pinarm": swept, "pinocchio": looped(PinocchioTree), "mujoco": looped(MujocoTree), "drake": looped(DrakeTree),
}  # fmt: skip
