"""What the engine gives back: states and efforts at instants, and the same motion at any other instant."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.equation import Dynamics, parts
from pinarm.engine.mechanism import Mechanism
from pinarm.input.units import Unit
from pinarm.mechanics.laws.motion_law import Grid

STANDSTILL = 1e-12
"""Velocity, relative to the largest of the run, that rounding leaves where a motion begins or ends."""


@dataclass(frozen=True)
class Series:
    """A named array with its unit.

    Attributes:
        name: As it was asked for.
        unit: SI unit of the values; ``None`` where an argument of unknown unit takes part.
        values: One per row of the trajectory, shape (n,), or per state, of the shape in which states were given.
        doubt: Why the values are one choice of many; empty where they are determined.
    """

    name: str
    unit: Unit | None
    values: Array
    doubt: str = ""

    @property
    def label(self) -> str:
        """Name and unit, for headings."""
        text = str(self.unit) if self.unit else "?"
        return self.name if text == "1" else f"{self.name} [{text}]"

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> Array:
        """Let numpy take the values."""
        return np.array(self.values, dtype=dtype, copy=copy)


@dataclass(frozen=True, eq=False)
class Happening:
    """An event of a run, or an impact.

    Attributes:
        name: Of the event, or of the end stop.
        t: When [s].
        q: Configuration, shape (nq,).
        v: Velocity, just after an impact, shape (nv,).
    """

    name: str
    t: float
    q: Array
    v: Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion, or a sequence of positions at rest.

    Attributes:
        mechanism: What moves.
        parameter: Name of what runs along the rows: ``t``, or the coordinate that is swept.
        unit: Unit of the parameter.
        grid: Its values, with the intervals between jumps.
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        a: Accelerations, shape (n, nv).
        tau: Efforts of the drives at joints, rotors included [N*m or N], shape (n, nv).
        lam: Multipliers of the constraints, and efforts of drives along task coordinates [N or N*m].
        closure: The constraints that they belong to: those of the mechanism, then guided task coordinates.
        dynamics: The equation of motion with all the forces of the run.
        again: The same run at other instants.
        figures: What was measured of its accuracy and cost, by name.
        unasked: Why the run has no efforts; empty where it has.
        further: What the problem found beside the motion, by name.
        happenings: Events and impacts, in order of time.
        notes: What the run has to say of itself, such as that its integrator was a poor choice.
        separate: Whether the rows are states of their own, not one motion.
        positions: Parameter, shape (n,) -> configurations, shape (n, nq), as the integration gives them, which costs
            less than ``again``; none where nothing has been integrated.
    """

    mechanism: Mechanism
    parameter: str
    unit: Unit
    grid: Grid
    q: Array = field(repr=False)
    v: Array = field(repr=False)
    a: Array = field(repr=False)
    tau: Array = field(repr=False)
    lam: Multipliers = field(repr=False)
    closure: Closure = field(repr=False)
    dynamics: Dynamics = field(repr=False)
    again: Callable[[Grid], Trajectory] = field(repr=False)
    figures: Mapping[str, float] = field(default_factory=dict)
    unasked: str = ""
    further: Mapping[str, Series] = field(default_factory=dict)
    separate: bool = False
    happenings: Sequence[Happening] = ()
    notes: tuple[str, ...] = ()
    positions: Callable[[Array], Array] | None = field(default=None, repr=False)

    @classmethod
    def still(cls, mechanism: Mechanism, parameter: str, measured: Unit, closure: Closure | None = None) -> Trajectory:
        """Return one row at the neutral configuration: enough to see which quantities there are.

        Args:
            mechanism: The mechanism.
            parameter: What runs along the rows.
            measured: Its unit.
            closure: Constraints with the drives along task coordinates; none of these where it is left out.
        """
        q, idle = np.atleast_2d(pin.neutral(mechanism.model)), np.zeros((1, mechanism.model.nv))
        dynamics, grid = mechanism.dynamics, Grid(np.zeros(1), (0.0, 0.0), (0, 1))
        again, closure = (
            partial(cls._still_again, mechanism, parameter, measured, closure),
            closure or mechanism.closure,
        )
        lam = Multipliers.known(np.zeros((1, closure.size)), mechanism.closure.size)
        return cls(mechanism, parameter, measured, grid, q, idle, idle, idle, lam, closure, dynamics, again)

    @classmethod
    def _still_again(
        cls, mechanism: Mechanism, parameter: str, measured: Unit, closure: Closure | None, grid: Grid
    ) -> Trajectory:
        return cls.still(mechanism, parameter, measured, closure)

    def __len__(self) -> int:
        return len(self.grid.t)

    def intervals(self) -> list[tuple[slice, Dynamics]]:
        """Return the rows between jumps, each with the dynamics that holds there."""
        return parts(self.dynamics, self.grid)

    def gather(self, value: Callable[[Dynamics, slice], Array]) -> Array:
        """Return an array over all rows from a function of the dynamics on each interval and its rows."""
        return np.concatenate([value(dynamics, rows) for rows, dynamics in self.intervals()])

    def direction(self, index: int) -> Array:
        """Return the sign of a joint's motion at every row, shape (n,).

        At standstill it is that of the motion about to begin, at the end of an interval that of the motion just ended,
        and 0 at rest. Of a state that is no part of a motion it is that of the motion about to begin.
        """
        v, a = self.v[:, index], self.a[:, index]
        if self.separate:
            return np.where(v == 0.0, np.sign(a), np.sign(v))
        standstill = np.abs(v) <= STANDSTILL * np.abs(v).max(initial=0.0)
        beside = np.sign(a)
        beside[np.array(self.grid.rows[1:]) - 1] *= -1.0
        return np.where(standstill, beside, np.sign(v))

    def within(self, interval: int, t: Array) -> Trajectory:
        """Return the same motion at other instants of one interval; its ends are this side's values."""
        start, end = self.grid.cuts[interval], self.grid.cuts[interval + 1]
        return self.again(Grid(t, (start, end), (0, len(t))))
