"""Arrays over the rows of a trajectory that quantities are computed from, each when it is first asked for."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.constraint_rows import ConstraintRows
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.geometry.vectors import crossed, moved
from pinarm.mechanics.joints import frame_of
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.constraints.self_stresses import Mobility
    from pinarm.engine.quantities.reactions import Reactions


class Evaluation(Record, frozen=True):
    """Coordinates, frames, energies, momenta and reactions of a trajectory.

    Attributes:
        undetermined: ``refuse`` components of reactions that rigid bodies do not determine, or give those of the least
            multipliers.
        judged: Whether it is judged which components are determined. Some states of a run are not: in a single state a
            component may seem to be.
    """

    run: Trajectory
    undetermined: str = "refuse"
    judged: bool = True

    @cached_property
    def reactions(self) -> Reactions:
        """Wrenches of the joints."""
        from pinarm.engine.quantities.reactions import SAMPLE, Reactions

        return Reactions(self.run, SAMPLE if self.judged else 0)

    @cached_property
    def mobility(self) -> Mobility:
        """Mobility of the mechanism where the run begins, and how it is tied."""
        from pinarm.engine.constraints.self_stresses import mobility_of

        return mobility_of(self.run.mechanism, np.real(self.run.q[0]))

    @property
    def doubtful(self) -> bool:
        """Whether rigid bodies may leave something undetermined: loads of constraints, or of frictions."""
        return bool(self.run.closure.constraints or self.run.mechanism.frictions)

    @cached_property
    def friction_doubts(self) -> Mapping[str, str]:
        """Doubts about frictions with undetermined loads, by quantity; see ``friction_law``."""
        if not any(contact.shared for contact in self.run.mechanism.frictions):
            return {}
        from pinarm.engine.quantities.friction_law import friction_doubts

        return friction_doubts(self.run)

    def rate(self, name: str, coordinate: Coordinate, order: int) -> Array:
        """Return a coordinate, or its first or second derivative, shape (n, ..)."""
        run = self.run
        if isinstance(coordinate, LinearCoordinate):
            return coordinate.rate((run.v, run.a)[order - 1]) if order else coordinate.at(run.q)
        if name not in self._coordinates:
            self._coordinates[name] = self._derivatives(coordinate)
        return np.asarray(self._coordinates[name][..., order])

    @cached_property
    def _coordinates(self) -> dict[str, Array]:
        return {}

    def _derivatives(self, coordinate: Coordinate) -> Array:
        """Return a coordinate with its two derivatives, shape (n, .., 3)."""
        here = ConstraintRows.of(self.run.mechanism.model, [coordinate]).at(self.run.q)
        row = here.matrices[..., 0, :]
        speed, growth = ((row * x).sum(axis=-1) for x in (self.run.v, self.run.a))
        return np.stack([here.gaps[..., 0], speed, growth + here.drifts(self.run.v)[..., 0]], axis=-1)

    def frame(self, name: str) -> Array:
        """Return a link's position, velocity, acceleration, angular velocity and acceleration, shape (n, .., 5, 3).

        Of its origin, in world axes [m, m/s, m/s^2, rad/s, rad/s^2]. With the velocity u and the angular velocity
        omega of the joint's origin, and the arm r from there: ``u + omega x r``, and
        ``u' + omega x u + alpha x r + omega x (omega x r)`` with the derivative ``[u'; alpha]`` of the twist.
        """
        return self._frame(name)[0]

    def turn(self, name: str) -> Array:
        """Return a link's rotation matrices, columns its axes in the world's, shape (n, .., 3, 3)."""
        return self._frame(name)[1]

    @cached_property
    def _frames(self) -> dict[str, tuple[Array, Array]]:
        return {}

    def _frame(self, name: str) -> tuple[Array, Array]:
        if name in self._frames:
            return self._frames[name]
        model = self.run.mechanism.model
        frame = frame_of(model, name)
        joint = model.frames[frame].parentJoint
        links, twists, rates, _ = self.run.link_motion
        (turns, places), turned = links.frame(frame), links.turns[..., joint, :, :]
        arms = places - links.places[..., joint, :]
        parts = (part for x in (twists, rates) for part in (x[..., joint, :3], x[..., joint, 3:]))
        u, omega, du, alpha = (np.matvec(turned, part) for part in parts)
        swept = crossed(omega, arms)
        rows = places, u + swept, du + crossed(omega, u) + crossed(alpha, arms) + crossed(omega, swept), omega, alpha
        self._frames[name] = np.stack(np.broadcast_arrays(*rows), axis=-2), turns
        return self._frames[name]

    @cached_property
    def energies(self) -> Array:
        """Kinetic energy, potential energy and their sum [J], springs and rotors included, shape (3, n)."""
        kinetic, potential = self.run.dynamics.energy(self.run.q, self.run.v)
        return np.array([kinetic, potential, kinetic + potential])

    @cached_property
    def momenta(self) -> Array:
        """Momentum of each link and its rate, shape (2, n, njoints, 6).

        [linear; angular] about the world's origin, world axes [kg*m/s, kg*m^2/s] and [N, N*m].
        """
        links, twists, rates, _ = self.run.link_motion
        growth, turning, _ = links.demands(twists, rates)
        parts = links.momenta(twists), growth + turning
        return np.array([moved(links.outwards(part), links.places) for part in parts])

    @cached_property
    def body_energies(self) -> tuple[Array, Array]:
        """Kinetic energy, and potential energy of its weight [J], of each link, shape (n, njoints)."""
        links, twists, _, _ = self.run.link_motion
        return links.energies(twists)

    @cached_property
    def gravity_power(self) -> Array:
        """Power of the weights [W], shape (n,)."""
        links, twists, _, _ = self.run.link_motion
        return links.gravity_power(twists)
