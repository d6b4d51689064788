"""Decisions of a motion at thresholds: what happens or not, the margin, and the error of the margin."""

from __future__ import annotations

import math
from collections.abc import Iterable

from pinarm.records import ValueRecord


class Decision(ValueRecord, frozen=True):
    """Whether something happens in a motion: an event, contact with a stop, friction that holds, a switch.

    Attributes:
        what: What happens or not, such as ``event 'back' takes place``: the same words in every solution of a run.
        t: Instant at which the motion is nearest to the threshold [s].
        margin: Distance to the threshold: positive where the solution is beyond it, negative where it falls short.
        error: Estimated error of the margin.
        unit: Unit of both.
        happens: Whether the run goes on as if it happens.
        event: Name of an event that is only recorded: no other output depends on it; empty where all outputs do.
    """

    what: str
    t: float
    margin: float
    error: float
    unit: str
    happens: bool
    event: str = ""

    @property
    def is_open(self) -> bool:
        """Whether the error of the margin allows both outcomes."""
        return not abs(self.margin) > self.error or self.happens != (self.margin > 0.0)

    @property
    def doubt(self) -> float:
        """Error over margin: 1 or more where it is open."""
        return self.error / abs(self.margin) if self.margin else math.inf

    @property
    def words(self) -> str:
        """What is decided, when, with which margin and error."""
        outcome = "happens" if self.happens else "does not happen"
        return (
            f"not decided: whether {self.what} at t = {self.t:.6g} s: margin {self.margin:.2g} {self.unit}, "
            f"error {self.error:.2g} {self.unit}; in this run it {outcome}"
        )

    def touches(self, name: str) -> bool:
        """Tell whether an output or a number of a name depends on the outcome."""
        return not self.event or f"event.{self.event}." in name


def open_notes(decisions: Iterable[Decision]) -> list[str]:
    """Return a note for each decision that is not certain."""
    return [decision.words for decision in decisions if decision.is_open]
