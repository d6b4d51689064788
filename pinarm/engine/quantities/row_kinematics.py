"""Kinematics, energies and momenta at all rows of a trajectory, each computed once when it is first asked for."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.pinocchio_data import new_data
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.mechanics.joints import frame_of


class RowKinematics:
    """Arrays over the rows of one trajectory, kept once computed.

    Args:
        run: The trajectory.
    """

    def __init__(self, run: Trajectory) -> None:
        self.run = run
        self.model = run.mechanism.model
        self._frames: dict[str, Array] = {}
        self._turns: dict[str, Array] = {}
        self._coordinates: dict[str, Array] = {}

    @cached_property
    def data(self) -> pin.Data:
        """Pinocchio's buffers; every pass over the rows fills them anew."""
        return new_data(self.model)

    def rate(self, name: str, coordinate: Coordinate, order: int) -> Array:
        """Return a coordinate, or its first or second derivative, shape (n, ..)."""
        run = self.run
        if isinstance(coordinate, LinearCoordinate):
            return coordinate.rate((run.v, run.a)[order - 1]) if order else coordinate.at(run.q)
        if name not in self._coordinates:
            self._coordinates[name] = self._coordinate(coordinate)
        return self._coordinates[name][:, order]

    def _coordinate(self, coordinate: Coordinate) -> Array:
        """Return a coordinate with its two derivatives, shape (n, 3)."""
        run = self.run
        rows = np.empty((len(run), 3))
        for i in range(len(run)):
            state = Kinematics.at(self.model, run.q[i], run.v[i])
            row, drift = coordinate.row(state), coordinate.drift(state)
            rows[i] = coordinate.value(state), row @ run.v[i], row @ run.a[i] + drift
        return rows

    def frame(self, name: str) -> Array:
        """Return a link's position, velocity, acceleration, angular velocity and acceleration, shape (n, .., 5, 3).

        Of its origin, in world axes [m, m/s, m/s^2, rad/s, rad/s^2]. With the velocity u and the angular velocity
        omega of the joint's origin, and the arm r from there: ``u + omega x r``, and
        ``u' + omega x u + alpha x r + omega x (omega x r)`` with the derivative ``[u'; alpha]`` of the twist.
        """
        self._frame(name)
        return self._frames[name]

    def turn(self, name: str) -> Array:
        """Return a link's rotation matrices, columns its axes in the world's, shape (n, .., 3, 3)."""
        self._frame(name)
        return self._turns[name]

    def _frame(self, name: str) -> None:
        if name in self._frames:
            return
        frame = frame_of(self.model, name)
        joint = self.model.frames[frame].parentJoint
        links, twists, rates, _ = self.run.link_motion
        (turns, places), turned = links.frame(frame), links.turns[..., joint, :, :]
        arms = places - links.places[..., joint, :]
        u, omega, du, alpha = (np.matvec(turned, part) for x in (twists, rates)
                               for part in (x[..., joint, :3], x[..., joint, 3:]))  # fmt: skip
        swept = crossed(omega, arms)
        rows = places, u + swept, du + crossed(omega, u) + crossed(alpha, arms) + crossed(omega, swept), omega, alpha
        self._frames[name], self._turns[name] = np.stack(np.broadcast_arrays(*rows), axis=-2), turns

    @cached_property
    def energies(self) -> Array:
        """Kinetic energy, potential energy and their sum [J], springs and rotors included, shape (3, n)."""
        kinetic, potential = self.run.dynamics.energy(self.run.q, self.run.v)
        return np.array([kinetic, potential, kinetic + potential])

    @cached_property
    def momenta(self) -> Array:
        """Momentum and its rate of what each joint moves by itself, shape (n, njoints, 2, 6).

        [linear; angular] about the world's origin, world axes [kg*m/s, kg*m^2/s] and [N, N*m].
        """
        run, model, data = self.run, self.model, self.data
        rows = np.zeros((len(run), model.njoints, 2, 6))
        for i in range(len(run)):
            pin.forwardKinematics(model, data, run.q[i], run.v[i], run.a[i])
            for joint in range(1, model.njoints):
                inertia, twist, place = model.inertias[joint], data.v[joint], data.oMi[joint]
                momentum = inertia * twist
                rows[i, joint, 0] = place.act(momentum).vector
                rows[i, joint, 1] = place.act(inertia * data.a[joint] + twist.cross(momentum)).vector
        return rows

    @cached_property
    def body_energies(self) -> Array:
        """Kinetic and potential energy [J] of what each joint moves by itself, shape (n, njoints, 2)."""
        run, model, data = self.run, self.model, self.data
        rows, gravity = np.zeros((len(run), model.njoints, 2)), model.gravity.linear
        for i in range(len(run)):
            pin.forwardKinematics(model, data, run.q[i], run.v[i])
            for joint in range(1, model.njoints):
                inertia = model.inertias[joint]
                rows[i, joint, 0] = inertia.vtiv(data.v[joint]) / 2
                rows[i, joint, 1] = -inertia.mass * gravity @ data.oMi[joint].act(inertia.lever)
        return rows

    @cached_property
    def gravity_power(self) -> Array:
        """Power of the weights [W], shape (n,)."""
        run, model, data = self.run, self.model, self.data
        still = np.zeros(model.nv)
        weights = np.array([pin.computeGeneralizedGravity(model, data, q) for q in run.q]).reshape(len(run), len(still))
        return np.asarray(-(weights * run.v).sum(axis=1))
