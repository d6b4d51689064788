"""Results of a problem: a table of states, the motion between its rows where there is one, and its decisions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from msgspec import field

from pinarm.arrays import Array, distinct
from pinarm.engine.labelled_array import LabelledArray
from pinarm.engine.motion.trajectory import EventRecord, Trajectory
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, ValueRecord


class SolvedMotion:
    """A motion that has been solved, or a path of positions: it has states at any value of its parameter."""

    def at(self, grid: Grid) -> Trajectory:
        """Return the states at other values of the parameter; each interval lies within one of the solved ones."""
        raise NotImplementedError

    def positions(self, t: Array) -> Array:
        """Return the configurations at values of the parameter, shape (n,), as an array of shape (n, nq)."""
        raise NotImplementedError

    def steps(self) -> Array:
        """Return where the steps of an integrator end [s], ascending, shape (n,): short where the motion changes."""
        return np.empty(0)

    def knots(self) -> Array:
        """Return where curves of laws have points between which they may do anything, ascending, shape (n,).

        None where they end steps of an integrator.
        """
        return np.empty(0)

    def jumps(self) -> Array:
        """Return where loads jump within intervals, as those of sampled controllers do [s], ascending, shape (n,)."""
        return np.empty(0)


class RelayedMotion(SolvedMotion):
    """A motion whose steps, knots and jumps are those of another one."""

    @property
    def relayed(self) -> SolvedMotion:
        """The other motion."""
        raise NotImplementedError

    def steps(self) -> Array:
        return self.relayed.steps()

    def knots(self) -> Array:
        return self.relayed.knots()

    def jumps(self) -> Array:
        return self.relayed.jumps()


class Decision(ValueRecord, frozen=True):
    """Whether something happens in a motion: an event, contact with a stop, friction that holds, a switch.

    Attributes:
        what: What happens or not, such as ``event 'back' takes place``: the same words in every solution of a run.
        t: Instant at which the motion is nearest to the threshold [s].
        margin: Distance to the threshold: positive where the solution is beyond it, negative where it falls short.
        happens: Whether the run goes on as if it happens.
        event: Name of an event that is only recorded, so that no other output depends on it; else empty.
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
        """Sentence on the decision: event, instant, margin, error, and the outcome in this run."""
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


class Outcome(Record, frozen=True):
    """Result of a problem: states, motion, figures, events and notes.

    Attributes:
        rows: The requested states.
        motion: The motion or path through these states; ``None`` of separate states.
        figures: Measures of accuracy and cost, by name.
        measures: Computes further measures of accuracy, when these are asked for.
        events: Events and impacts, in order of time.
        notes: Remarks on the solution, such as a poor choice of integrator.
        decisions: Least certain decision of each event, contact or switch that happens or not.
        arrays: Results other than columns over the rows, such as mode shapes, by name.
    """

    rows: Trajectory
    motion: SolvedMotion | None = None
    figures: Mapping[str, float] = field(default_factory=dict)
    measures: Callable[[], Mapping[str, float]] = dict
    events: Sequence[EventRecord] = ()
    notes: tuple[str, ...] = ()
    decisions: tuple[Decision, ...] = ()
    arrays: Mapping[str, LabelledArray] = field(default_factory=dict)


def on_interval(motion: SolvedMotion, cuts: Sequence[float], interval: int, t: Array) -> Trajectory:
    """Return a motion at values of one interval, by its number; at its ends, those of this side of a jump."""
    return motion.at(Grid(t, (cuts[interval], cuts[interval + 1]), (0, len(t))))


def positions_by_interval(motion: SolvedMotion, cuts: Sequence[float], t: Array) -> Array:
    """Return the configurations of a motion, shape (n, nq), solved interval by interval at values of its parameter.

    ``cuts`` are the bounds of its intervals, ascending or descending.
    """
    sign = 1.0 if cuts[0] <= cuts[-1] else -1.0
    intervals = np.searchsorted(sign * np.array(cuts[1:-1]), sign * t)
    rows = [(k, np.flatnonzero(intervals == k)) for k in distinct(intervals).tolist()]
    parts = [on_interval(motion, cuts, k, t[here]).q for k, here in rows]
    return np.concatenate(parts)[np.argsort(np.concatenate([here for _, here in rows]))]
