"""Runs of a search: numbers of a scenario solved for values of its unknowns, and how they change with these."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import PinarmError


class Run(NamedTuple):
    """One run of a search.

    Attributes:
        numbers: Its numbers [SI]; none of a run that failed.
        names: What the numbers are of, where this is asked.
        refusal: Why the run does not count; empty where it does.
        error: Makes the error of a run that failed.
    """

    numbers: Array
    names: Sequence[str] = ()
    refusal: str = ""
    error: Callable[[], PinarmError] | None = None

    @classmethod
    def refused(cls, refusal: str, error: Callable[[], PinarmError]) -> Run:
        return cls(np.zeros(0), (), refusal, error)


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs at points of the unknowns, shape (k,): no point is run twice, several are run at once.

    Attributes:
        solve: Runs several points.
        known: Points that have been run, by their bytes.
    """

    solve: Callable[[Sequence[Array]], Iterable[Run]]
    known: dict[bytes, tuple[Array, Run]] = field(default_factory=dict)

    def at(self, points: Iterable[Array]) -> list[Run]:
        """Return the runs at points."""
        asked = [np.array(x, dtype=float) for x in points]
        new = {x.tobytes(): x for x in asked if x.tobytes() not in self.known}
        if new:
            for (key, x), run in zip(new.items(), self.solve([*new.values()]), strict=True):
                self.known[key] = x, run
        return [self.known[x.tobytes()][1] for x in asked]

    def slopes(
        self, of: Callable[[Run], Array], x: Array, widths: Array, low: float = -np.inf, high: float = np.inf
    ) -> Array:
        """Return the slopes of numbers m of runs at a point, shape (m, k), by central differences between bounds.

        Beside a refused run the difference is that of the other side; it is 0 between two refused runs.
        """
        sides = [np.clip(x + sign * step, low, high) for step in np.diag(widths) for sign in (1.0, -1.0)]
        here, *runs = self.at([x, *sides])
        near = [(x, here) if run.refusal else (side, run) for side, run in zip(sides, runs, strict=True)]
        columns = []
        for k, ((ahead, far), (behind, back)) in enumerate(zip(near[::2], near[1::2], strict=True)):
            way, change = ahead[k] - behind[k], of(far) - of(back)
            columns.append(change / way if way else np.zeros_like(change))
        return np.ascontiguousarray(np.array(columns).T)  # SLSQP of scipy 1.17 reads others wrongly
