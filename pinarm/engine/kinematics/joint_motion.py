"""Inverse kinematics: positions, velocities and accelerations of joints from those of coordinates, to rounding.

With coordinates w of a mechanism prescribed, the constraints phi of its loops and couplings, and J the rows of both:
``phi(q) = 0`` and ``w(q) = w_d(t)``, then ``J v = (0, w_d')`` and ``J a = (0, w_d'') - J' v``. All rows of the table
are solved at once where the equations are linear; elsewhere a branch is continued (``continuation``).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.kinematics.prescribed import Assembly, PrescribedCoordinates
from pinarm.engine.kinematics.singular import check_rank
from pinarm.errors import AssemblyError
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw, Values
from pinarm.records import AbstractRecord, Record

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


class JointMotion(AbstractRecord, frozen=True):
    """How the joints of a mechanism follow prescribed coordinates.

    Attributes:
        mechanism: The mechanism.
        prescribed: The coordinates with their laws.
    """

    mechanism: Mechanism
    prescribed: PrescribedCoordinates

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The prescribed coordinates."""
        return self.prescribed.coordinates

    @property
    def laws(self) -> tuple[MotionLaw, ...]:
        """Their laws."""
        return self.prescribed.laws

    @property
    def jumps(self) -> tuple[str, ...]:
        """Instants at which velocities jump though the laws do not, in words."""
        return ()

    @abstractmethod
    def begin(self, grid: Grid, start: Array) -> Assembly:
        """Return a configuration at the first of some rows, given that of the drawing or of the start, shape (nq,).

        Raises:
            AssemblyError: It cannot be reached.
            InputError: Several may be meant.
        """

    @abstractmethod
    def follow(self, grid: Grid, start: Array) -> JointTrajectory:
        """Return the motion at the rows of a grid.

        Args:
            grid: Instants.
            start: A configuration near the first one, shape (nq,): it chooses the branch.

        Raises:
            AssemblyError: A position cannot be reached.
        """

    @abstractmethod
    def rates(self, t: float, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        """Return velocities and accelerations at configurations of the motion, each of shape (n, nv).

        Args:
            t: An instant, if the motion is one in time: it tells between which jumps of velocities they are.
            q: Configurations, shape (n, nq).
            dw: Velocities of the prescribed coordinates, shape (k,).
            ddw: Their accelerations, shape (k,).
        """

    def figures(self, states: JointTrajectory) -> Mapping[str, float]:
        """Return how well the rows keep to what is prescribed, by name; nothing where they do to rounding."""
        return {}


class JointTrajectory(Record, frozen=True):
    """The motion of the joints at the rows of a grid.

    Attributes:
        motion: The motion, which has the same branch at other instants.
        grid: The rows, cut also where velocities jump though the laws do not.
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        a: Accelerations, shape (n, nv).
    """

    motion: JointMotion
    grid: Grid
    q: Array
    v: Array
    a: Array


class DeterminedMotion(JointMotion, frozen=True):
    """The motion of a mechanism with as many prescribed coordinates as degrees of freedom."""

    def begin(self, grid: Grid, start: Array) -> Assembly:
        """Return the first position: see ``first_position``."""
        closure, prescribed = self.mechanism.closure, self.prescribed
        if prescribed.linear_in(closure):
            return Assembly(start)
        from pinarm.engine.kinematics.assembly import first_position
        from pinarm.engine.kinematics.closed_configurations import check_excess

        try:
            return first_position(closure, prescribed, prescribed.first(grid), float(grid.t[0]), start)
        except AssemblyError:
            with suppress(AssemblyError):  # whose loops may not close elsewhere either
                check_excess(self.mechanism, prescribed)
            raise

    def follow(self, grid: Grid, start: Array) -> JointTrajectory:
        return JointTrajectory(self, grid, *follow(self.mechanism, self.prescribed, grid, start))

    def rates(self, t: float, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
        if not dw.any() and not ddw.any():  # at rest, which a singular position does not hinder
            return np.zeros((len(q), self.mechanism.model.nv)), np.zeros((len(q), self.mechanism.model.nv))
        from pinarm.engine.kinematics.continuation import branch_rates

        return branch_rates(self.mechanism, self.prescribed, q, dw, ddw)


def follow(
    mechanism: Mechanism, prescribed: PrescribedCoordinates, grid: Grid, start: Array
) -> tuple[Array, Array, Array]:
    """Return the motion of the joints under prescribed coordinates.

    Args:
        mechanism: The mechanism.
        prescribed: As many coordinates as it has degrees of freedom.
        grid: Instants.
        start: A configuration near the first one, shape (nq,): it chooses the branch.

    Returns:
        q of shape (n, nq), v and a of shape (n, nv).

    Raises:
        AssemblyError: The positions cannot be reached; ``data`` holds the closest configuration and its gap.
    """
    if prescribed.linear_in(mechanism.closure):
        return _follow_linear(mechanism, prescribed, grid)
    from pinarm.engine.kinematics.continuation import (
        follow_branch,  # with all that loops need: open chains do not pay for it
    )

    return follow_branch(mechanism, prescribed, grid, prescribed_at_start(mechanism, prescribed, grid, start))


def prescribed_at_start(mechanism: Mechanism, prescribed: PrescribedCoordinates, grid: Grid, start: Array) -> Array:
    """Return the start with the first values of laws that joints follow: from elsewhere the branch may be another."""
    q = start.copy()
    for name, w in zip(prescribed.names, prescribed.first(grid), strict=True):
        if name in mechanism.joints:
            q[mechanism.joints[name].q] = w
    return q


def _follow_linear(mechanism: Mechanism, prescribed: PrescribedCoordinates, grid: Grid) -> tuple[Array, Array, Array]:
    """Solve for all instants at once: the rows are constant and there is no drift."""
    couplings = [constraint for constraint in mechanism.constraints if isinstance(constraint, Coupling)]
    linear = [c for c in prescribed.coordinates if isinstance(c, LinearCoordinate)]
    rows = np.array([one.weights for one in [*(coupling.coordinate for coupling in couplings), *linear]])
    if len(rows) != mechanism.model.nv:
        prescribed.check_mobility(mechanism, pin.neutral(mechanism.model))
    check_rank(rows, (*(coupling.name for coupling in couplings), *prescribed.names), grid.t[0])
    still, n = np.zeros(len(grid.t)), len(grid.t)
    values: list[Values] = [(np.full(n, one.constant), still, still) for one in couplings]
    values += [grid.evaluate(law) for law in prescribed.laws]
    solved = [np.linalg.solve(rows, np.array([value[k] for value in values])).T for k in range(3)]
    q = np.empty_like(solved[0])
    q[:, linear[0].places] = solved[0]
    return q, np.ascontiguousarray(solved[1]), np.ascontiguousarray(solved[2])
