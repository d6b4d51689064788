"""Equations of motion that are integrated, of trees and of loops: states at the start, in steps and at rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from msgspec import field

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics, parts
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.mechanics.ball_joints import coordinate_at, coordinate_name
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Interval, Manifold
    from pinarm.mechanics.coordinates import Coordinate
    from pinarm.mechanics.joints import Joint


KEPT = 16
"""Number of intervals of a system kept for the next run: a motion mostly has one, and one more for every jump of a
load."""


class Initial(Record, frozen=True):
    """The state that a motion begins with, as far as it is given.

    Attributes:
        q: The given coordinates, and rough values of the others, shape (nq,).
        v: The given velocities, and 0, shape (nv,).
        positions: Indices in v of the joints whose coordinates are given.
        velocities: Indices in v of the joints whose velocities are given.
        rates: Other coordinates whose rates are given, and these [rad/s or m/s].
        drawn: Configuration from which the mechanism is assembled, shape (nq,); q itself where it is left out.
    """

    q: Array
    v: Array
    positions: tuple[int, ...] = ()
    velocities: tuple[int, ...] = ()
    rates: tuple[tuple[Coordinate, float], ...] = ()
    followers: tuple[Follower, ...] = ()
    drawn: Array | None = None

    def known(self, prescribed: PrescribedCoordinates, closure: Closure) -> tuple[PrescribedCoordinates, list[float]]:
        """Return coordinates that follow laws and those that are given, and the values of the latter."""
        names = [coordinate_name(closure.model, index) for index in self.positions]
        coordinates, here = [coordinate_at(closure.model, index) for index in self.positions], closure.state(self.q)
        values = [coordinate.value(here) for coordinate in coordinates]
        return prescribed.holding(names, coordinates, values), values

    def given_rates(self) -> Array:
        """Return the given velocities, not a number where none is given, shape (nv,)."""
        rates = np.full(len(self.v), np.nan)
        rates[list(self.velocities)] = self.v[list(self.velocities)]
        return rates


class Follower(ValueRecord, frozen=True):
    """A rotor that begins where, and as fast as, what it drives by an elastic gear, if nothing else is given."""

    rotor: Joint
    coordinate: Coordinate
    position: bool
    velocity: bool


class CompletedStates(Record, frozen=True):
    """The motion of a mechanism at the n rows of a grid.

    Attributes:
        tau: Efforts of the drives at joints, and pushes of end stops [N*m or N], shape (n, nv).
        lam: Multipliers of the constraints [N or N*m].
        friction: Friction that sticks, along the slips of k joints [N*m or N], shape (n, k).
        opened: Whether a one-sided constraint is open, shape (n,); ``None`` where none ever is.
        others: The same motion with other efforts, multipliers and frictions that hold it as well: the ends of what
            rigid bodies leave open where several joints at rest share a load.
        endless: Of such a motion, in which rows it only tells a direction without a known end; ``None`` for none, (n,).
        pushed: What of ``tau`` end stops push, shape (n, nv); ``None`` where nothing rests on any.
    """

    q: Array
    v: Array
    a: Array
    tau: Array
    lam: Array
    friction: Array = field(default_factory=lambda: np.zeros((0, 0)))
    opened: Flags | None = None
    others: tuple[CompletedStates, ...] = ()
    endless: Flags | None = None
    pushed: Array | None = None

    @classmethod
    def joined(cls, motions: Sequence[CompletedStates]) -> CompletedStates:
        """Return the rows of several, one after another."""
        if len(motions) == 1:
            return motions[0]
        names = ("q", "v", "a", "tau", "lam", "friction")
        arrays = ([getattr(motion, name) for motion in motions] for name in names)
        q, v, a, tau, lam, friction = map(np.concatenate, arrays)
        others = [
            cls.joined([x.others[k] if k < len(x.others) else replace(x, others=()) for x in motions])
            for k in range(max(len(motion.others) for motion in motions))
        ]

        def known(name: str, nothing: Callable[[CompletedStates], Array]) -> Any:
            parts = [getattr(motion, name) for motion in motions]
            some = any(part is not None for part in parts)
            pairs = zip(motions, parts, strict=True)
            return np.concatenate([nothing(x) if part is None else part for x, part in pairs]) if some else None

        opened, endless = (known(name, lambda x: np.zeros(len(x.q), dtype=bool)) for name in ("opened", "endless"))
        return cls(q, v, a, tau, lam, friction, opened, tuple(others), endless, known("pushed", lambda x: 0.0 * x.tau))


def demand(dynamics: Dynamics, grid: Grid, q: Array, v: Array, a: Array) -> Array:
    """Return ``M a + nle - loads`` at the rows of a grid [N*m or N], shape (n, nv)."""
    states = ((local, grid.t[rows], q[rows], v[rows], a[rows]) for rows, local in parts(dynamics, grid))
    return np.concatenate([local.inverse(*state) for local, *state in states])


def efforts_of(
    prescribed: PrescribedCoordinates, closure: Closure, q: Array, needed: Array, along: Array
) -> tuple[Array, Array]:
    """Return efforts at joints, and multipliers, that carry what a motion needs, shape (n, nv).

    ``along`` are the efforts along the prescribed coordinates, those of joints and sums of joints last; ``closure`` has
    rows of the others behind those of the constraints.
    """
    linear = [coordinate.weights for coordinate in prescribed.coordinates if isinstance(coordinate, LinearCoordinate)]
    others = along.shape[1] - len(linear)
    tau = along[:, others:] @ np.reshape(linear, (-1, needed.shape[1]))
    return tau, closure.multipliers(q, needed - tau, along[:, :others])


class System(Protocol):
    """The state of an integration and how it belongs to that of the mechanism."""

    @property
    def manifold(self) -> Manifold: ...

    @property
    def closure(self) -> Closure:
        """Constraints with multipliers: those of the mechanism, then task coordinates that follow laws."""
        ...

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        """Return the motion of the integrated state on an interval without jumps."""
        ...

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the mechanism's states, shapes (..., n, nq) and (..., n, nv), from integrated ones at n times t.

        Integrated ones may have integrals of controllers behind the velocities.
        """
        ...

    def acting(self, dynamics: Dynamics) -> Dynamics:
        """Return the equation of motion, with the friction of joints that slip."""
        ...

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the motion of the mechanism at the rows of a grid, from the integrated states there."""
        ...
