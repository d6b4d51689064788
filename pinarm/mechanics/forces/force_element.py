"""Force elements in general, and where their loads stop being smooth."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Container, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.records import Record, ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.mechanics.coordinates import MeasuredCoordinate, PairCoordinate
    from pinarm.mechanics.forces.load_laws import LoadLaw
    from pinarm.mechanics.geometry.link_placements import LinkPlacements


SLIVER = 1e-12
"""Width of a piece, relative to where it is, that rounding makes."""


class Pieces(Record, frozen=True):
    """The intervals of a coordinate or a velocity w on which a load is one smooth function of it.

    Attributes:
        bounds: Where one meets the next, ascending, shape (k,); those from 0 on of the first period where they repeat.
        period: After which they repeat; infinite where they do not.
    """

    bounds: Array
    period: float = math.inf

    def passed(self, w: Array) -> bool:
        """Return whether a whole piece is between values: no stage of a step may have been in it.

        Args:
            w: Values along a step, its ends included, shape (n,).
        """
        low, high = float(w.min()), float(w.max())
        if high - low > self.period:
            return True
        bounds = self.bounds
        if self.period < math.inf:
            turn = self.period * math.floor(low / self.period)
            bounds = turn + np.concatenate([bounds, self.period + bounds])
        inside = bounds[(bounds > low) & (bounds < high)]
        return bool(len(inside) > 1 and inside[-1] - inside[0] > SLIVER * (1.0 + abs(inside[-1])))


class Edge(NamedTuple):
    """Where a load stops being smooth: at zeros of a value.

    Attributes:
        value: ``(t, q, v) ->`` the value of n states, shape (n,).
        counts: ``(t, q, v) ->`` whether a zero at these states counts, shape (n,); all do where it is ``None``. One at
            which the load stays smooth must not: the step that begins there sees nothing but what lies beyond the next.
        direction: -1 where only falling values count, 0 where all do.
    """

    value: Callable[[Array, Array, Array], Array]
    counts: Callable[[Array, Array, Array], Flags] | None = None
    direction: int = 0


def edge_along(
    along: MeasuredCoordinate, value: Callable[[Array, Array], Array],
    counts: Callable[[Array], Flags] | None = None, direction: int = 0,
) -> Edge:  # fmt: skip
    """Return an edge at zeros of a function of w and its rate, which count where another one of w says so."""

    def counted(t: Array, q: Array, v: Array) -> Flags:
        assert counts
        return counts(along.values(q))

    return Edge(lambda t, q, v: value(*along.moving(q, v)[:2]), counted if counts else None, direction)


class ElementQuantity(ValueRecord, frozen=True):
    """Something of a force element that can be asked over the rows of a run, as ``force.NAME.MEASURE``.

    Attributes:
        values: From t, q and v of n rows to a number each, shape (n,), or a vector in world axes, shape (n, 3).
    """

    unit: Unit
    values: Callable[[Array, Array, Array], Array]
    vector: bool = False


class HeldLoad(Protocol):
    """A load that is the same in all states between the instants at which it changes."""

    @property
    def present(self) -> Array:
        """The load in force [N*m or N], shape (nv,)."""
        ...

    def piece(self, t: float) -> int:
        """Return the number of the change at t [s], or of the last one before."""
        ...

    def load_of(self, pieces: Indices) -> Array:
        """Return the loads from changes on [N*m or N], shape (n, nv), by their numbers."""
        ...


class ForceElement(ABC):
    """An element of one mechanism, ready for evaluation at one state or at many (leading axes).

    Loads, energy and dissipated power obey ``load . v = -dU/dt - dissipated`` whatever the motion; one test holds every
    element to it. A load that drives the mechanism dissipates a negative power: it supplies it. Without an energy of
    its own an element supplies, or takes, all of its power.
    """

    @abstractmethod
    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the generalised load [N*m or N] to ``tau``, shape (..., nv)."""

    def potential_energy(self, q: Array) -> Array:
        """Return U [J], shape (...)."""
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the power that leaves the mechanism [W], shape (...)."""
        return np.zeros(v.shape[:-1]) if self.conservative else -power(self, t, q, v)

    @property
    def conservative(self) -> bool:
        """Whether all of the power goes into U and comes from it."""
        return False

    @property
    def steady(self) -> bool:
        """Whether the load is the same in all states and at all times."""
        return False

    @property
    def held(self) -> HeldLoad | None:
        """The load where it is the same in all states between changes in time that no law tells; ``None`` elsewhere."""
        return None

    @property
    def law(self) -> LoadLaw | None:
        """The law that the load follows, over time or over a coordinate; ``None`` where it follows none."""
        return None

    def laws(self) -> list[MotionLaw]:
        """Return the laws over time that the load follows; it may jump where they do."""
        return [self.law.over_time] if self.law else []

    @property
    def jumps(self) -> bool:
        """Whether the load may jump at some instants, so that it is another one before than after: see ``on``."""
        return bool(self.laws()) or self.held is not None

    def on(self, start: float, end: float) -> ForceElement:
        """Return the element as it is on an interval of time in which no law jumps."""
        return replace(self, law=self.law.on(start, end)) if self.law else self

    @property
    def in_pieces(self) -> bool:
        """Whether the load is made of pieces along a coordinate or a velocity."""
        return self.law is not None and self.law.profile is not None

    def passed(self, q: Array, v: Array) -> bool:
        """Return whether a step may have gone past a piece of the load without having seen it; see ``Pieces``.

        Args:
            q: Configurations along the step, its ends included, shape (n, nq).
            v: Velocities, shape (n, nv).
        """
        return self.law is not None and self.law.passed(q)

    def edges(self) -> Sequence[Edge]:
        """Return where the load stops being smooth, if these instants are to be located: steps end there."""
        return self.law.edges() if self.law else ()

    def wrenches(self, links: LinkPlacements, t: Array, v: Array) -> dict[int, Array]:
        """Return the external wrenches on links in n states: joint index -> [f; m] at the world's origin, (n, 6).

        An element between the two links of a joint has none: its effort is part of the wrench in the joint. ``links``
        are the placements in these states.
        """
        return {}

    @property
    def points(self) -> tuple[int, ...]:
        """Indices of the frames at whose origins its wrenches act; none where they act at no point."""
        return ()

    def measures(self) -> Mapping[str, ElementQuantity]:
        """Return the quantities of the element by name, beside its power."""
        return {}

    def refusal(self, q: Array) -> str:
        """Return why the element has no load at a configuration or just beyond it, in words; empty where it has one.

        Such a load is not a number: no step of an integration is taken with it.
        """
        return ""

    def turned_between(self, q: Array) -> PairCoordinate | None:
        """Return part of the rotation between its frames, if that may pass half a turn between rows of a motion.

        Args:
            q: Configurations of the rows, shape (n, nq).
        """
        return None

    @property
    def description(self) -> str:
        """Kind and place of the element, in words; may be empty."""
        return ""


def refusals(forces: Mapping[str, ForceElement], q: Array) -> str:
    """Return why elements have no load at a configuration, shape (nq,), to be added to a message; usually nothing."""
    reasons = ((name, force.refusal(q)) for name, force in forces.items())
    return "".join(f"; force '{name}': {reason}" for name, reason in reasons if reason)


def check_new(name: str, known: Container[str]) -> None:
    """Raise where the name of a force is that of another one, or of the weights."""
    if name in known or name == "gravity":
        raise InputError(f"the mechanism has a force '{name}' already", expected="a name of its own")


def power(element: ForceElement, t: Array | float, q: Array, v: Array) -> Array:
    """Return the power of an element [W], shape (...); positive into the mechanism."""
    tau = np.zeros_like(v)
    element.add_load(t, q, v, tau)
    return np.asarray((tau * v).sum(axis=-1))
