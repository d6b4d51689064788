"""What every force element promises."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Container, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from pinarm.mechanics.coordinates import RotationCoordinate
    from pinarm.mechanics.geometry.link_placements import LinkPlacements


class Edge(NamedTuple):
    """Where a load stops being smooth: at zeros of a value.

    Attributes:
        value: ``(t, q, v) ->`` the value of n states, shape (n,).
        counts: ``(t, q, v) ->`` whether a zero at these states counts, shape (n,); all do where it is ``None``. One at
            which the load stays smooth must not: the step that begins there sees nothing but what lies beyond the next.
    """

    value: Callable[[Array, Array, Array], Array]
    counts: Callable[[Array, Array, Array], Flags] | None = None


class ElementQuantity(ValueRecord, frozen=True):
    """Something of a force element that can be asked over the rows of a run, as ``force.NAME.MEASURE``.

    Attributes:
        unit: Its unit.
        values: From t, q and v of n rows to a number each, shape (n,), or a vector in world axes, shape (n, 3).
        vector: Whether it is a vector.
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

    The three abstract methods obey ``load . v = -dU/dt - dissipated`` whatever the motion; one test holds every element
    to it. A load that drives the mechanism dissipates a negative power: it supplies it.
    """

    @abstractmethod
    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the generalised load [N*m or N] to ``tau``, shape (..., nv)."""

    @abstractmethod
    def potential_energy(self, q: Array) -> Array:
        """Return U [J], shape (...)."""

    @abstractmethod
    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the power that leaves the mechanism [W], shape (...)."""

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

    def laws(self) -> list[MotionLaw]:
        """Return the laws over time that the load follows; it may jump where they do."""
        return []

    @property
    def jumps(self) -> bool:
        """Whether the load may jump at some instants, so that it is another one before than after: see ``on``."""
        return bool(self.laws()) or self.held is not None

    def on(self, start: float, end: float) -> ForceElement:
        """Return the element as it is on an interval of time in which no law jumps."""
        return self

    @property
    def in_pieces(self) -> bool:
        """Whether the load is made of pieces along a coordinate or a velocity."""
        return False

    def passed(self, q: Array, v: Array) -> bool:
        """Return whether a step may have gone past a piece of the load without having seen it; see ``Pieces``.

        Args:
            q: Configurations along the step, its ends included, shape (n, nq).
            v: Velocities, shape (n, nv).
        """
        return False

    def marked(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        """Return when the load passes points of its pieces where joints follow laws, by their index in v [s]."""
        return []

    def edges(self) -> Sequence[Edge]:
        """Return where the load stops being smooth, if these instants are to be located: steps end there."""
        return ()

    def within(self, kept_q: Indices, kept_v: Indices) -> ForceElement | None:
        """Return the element as it acts on a part of the mechanism, whose other joints are at rest.

        Args:
            kept_q: Places of the part's configuration in that of the whole.
            kept_v: Places of its velocity.

        Returns:
            ``None`` where it takes more than indices to tell.
        """
        return None

    def wrenches(self, t: float, q: Array, v: Array) -> dict[int, Array]:
        """Return what acts on links from outside: joint index -> [f; m] at the world's origin, world axes, shape (6,).

        Elements that act between the two links of a joint have none: their effort is part of what the joint transmits.
        """
        return {}

    def wrenches_at(self, links: LinkPlacements, t: Array, q: Array, v: Array) -> dict[int, Array]:
        """Return the same in n states, each wrench of shape (n, 6); ``links`` are placed as the states say."""
        found: dict[int, Array] = {}
        for k, state in enumerate(zip(t, q, v, strict=True)):
            for joint, wrench in self.wrenches(*state).items():
                found.setdefault(joint, np.zeros((len(q), *wrench.shape), wrench.dtype))[k] = wrench
        return found

    @property
    def points(self) -> tuple[int, ...]:
        """Indices of the frames at whose origins its wrenches act; none where they act at no point."""
        return ()

    def measures(self) -> Mapping[str, ElementQuantity]:
        """Return what can be asked of the element by name, beside its power."""
        return {}

    def refusal(self, q: Array) -> str:
        """Return why the element has no load at a configuration or just beyond it, in words; empty where it has one.

        Such a load is not a number: no step of an integration is taken with it.
        """
        return ""

    def turned_between(self, q: Array) -> RotationCoordinate | None:
        """Return part of the rotation between its frames, if that may pass half a turn between rows of a motion.

        Args:
            q: Configurations of the rows, shape (n, nq).
        """
        return None

    @property
    def description(self) -> str:
        """What it is and where, in words; may be empty."""
        return ""


def refusals(forces: Mapping[str, ForceElement], q: Array) -> str:
    """Return why elements have no load at a configuration, shape (nq,), to be added to a message; usually nothing."""
    reasons = ((name, force.refusal(q)) for name, force in forces.items())
    return "".join(f"; force '{name}': {reason}" for name, reason in reasons if reason)


def check_new(name: str, known: Container[str]) -> None:
    """Raise where the name of a force is that of another one, or of the weights.

    Raises:
        InputError: It is.
    """
    if name in known or name == "gravity":
        raise InputError(f"the mechanism has a force '{name}' already", expected="a name of its own")


def power(element: ForceElement, t: Array | float, q: Array, v: Array) -> Array:
    """Return the power of an element [W], shape (...); positive into the mechanism."""
    tau = np.zeros_like(v)
    element.add_load(t, q, v, tau)
    return np.asarray((tau * v).sum(axis=-1))
