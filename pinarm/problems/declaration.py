"""Declaration of the coordinates that a problem needs: all that simplification knows of the problem."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

from msgspec import field

from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from pinarm.mechanics.forces.kinds import Force
    from pinarm.mechanics.laws import Motion
    from pinarm.problems import Problem

ValueT = TypeVar("ValueT")


class Declaration(ValueRecord, frozen=True):
    """Declaration of the coordinates that a problem holds, moves, drives and watches.

    Attributes:
        without: Names -> the problem on a mechanism that lacks these coordinates: all that it says about them is left
            out, and so are its loads, which are forces of that mechanism.
        held: Coordinate -> its constant value.
        laws: Coordinate -> the law that it follows.
        watched: Coordinates that the problem looks at, so that they are kept.
        drives: Coordinates along which the drives act; empty for those that the kind of problem chooses.
    """

    without: Callable[[Collection[str]], Problem]
    held: Mapping[str, float] = field(default_factory=dict)
    moved: Collection[str] = ()
    laws: Mapping[str, Motion] = field(default_factory=dict)
    watched: Collection[str] = ()
    drives: Sequence[str] = ()
    loads: Mapping[str, Force] = field(default_factory=dict)
    integrated: bool = False

    @property
    def prescribed(self) -> list[str]:
        return [*self.held, *self.moved, *self.laws]

    def differs_by_numbers(self, other: Declaration) -> bool:
        """Tell whether another problem says the same of the same coordinates but for numbers.

        Then the same joints can be left out: that depends on what stands still, moves, and is looked at.
        """
        return self._structure == other._structure

    @property
    def _structure(self) -> tuple[object, ...]:
        laws = [(name, type(law), getattr(law, "of", "")) for name, law in self.laws.items()]
        return [*self.held], [*self.moved], laws, [*self.watched], [*self.drives], [*self.loads]


def others(values: Mapping[str, ValueT], names: Collection[str]) -> dict[str, ValueT]:
    """Return the values of the coordinates that are not among some names."""
    return {name: value for name, value in values.items() if name not in names}
