"""Root finding: values of a scenario's numbers at which quantities of the run take wanted values; runs of searches.

With x the unknown numbers and r(x) the wanted quantities less their targets over all rows of the run, x minimises
``|r(x)|^2`` by Levenberg-Marquardt steps (MINPACK; More, Garbow and Hillstrom, ANL-80-74, 1980) with slopes by central
differences whose widths follow the numbers. Quantities are taken as they are reported: an angle that jumps from 180 to
-180 degrees is found on that side of the jump from which the search comes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, IntegrationError, PinarmError
from pinarm.use.scenario.find import Find

ITERATIONS, SETTLED = 200, 1e-13
"""Largest number of runs of a search, slopes apart; change of the values, relative to them, at which it ends."""

BARRIER, BARRED = 1e3, 1e-3
"""Relative to the residuals at the start: those of refused runs, from which the search turns back; those above which a
refused run is reported as what stopped the search."""

MET = 1e-9
"""Largest remainder of a wanted quantity that is met, relative to its remainder at the start."""

INDEPENDENT = 1e-9
"""Smallest singular value of the scaled Jacobian, relative to the largest, with which the values are determined."""

WIDTH = 1e-3
"""Half width of differences, relative to the size of the number, which is at least this part of its start."""


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


@dataclass(frozen=True)
class FoundValues:
    """Result of a search.

    Attributes:
        values: Values in SI, shape (k,).
        residuals: Quantity -> largest remainder over the rows, in SI.
        before: The same at the start.
    """

    values: Array
    residuals: Mapping[str, float]
    before: Mapping[str, float]

    @property
    def missed(self) -> list[str]:
        """Quantities that are not met."""
        return [name for name, left in self.residuals.items() if left > MET * self.before[name]]


def find_root(search: Find, runs: Runs) -> FoundValues:
    """Return the values that a search finds from its start.

    Args:
        search: Unknown numbers and wanted quantities.
        runs: Remainders of the wanted quantities, each with the name of its quantity.
    """
    from scipy.optimize import least_squares

    start, tried = search.start, len(runs.known)
    (begin,) = runs.at([start])
    if begin.error:
        raise begin.error()
    first = begin.numbers
    barrier = BARRIER * np.maximum(np.abs(first), np.linalg.norm(first) or 1.0)

    def residuals(x: Array) -> Array:
        (run,) = runs.at([x])
        return barrier if run.error else _same_rows(run, begin)

    def slopes(x: Array) -> Array:
        return runs.slopes(lambda run: _same_rows(run, begin), x, WIDTH * _sizes(search, x))

    if len(first) < len(start) or not slopes(start).any():
        raise _stopped(search, runs, tried) or _undetermined([*search.unknown])
    options = {"ftol": 1e-15, "xtol": SETTLED, "gtol": 1e-15, "max_nfev": ITERATIONS}
    ended = least_squares(residuals, start, slopes, method="lm", x_scale=_sizes(search, start), **options)
    if not ended.status:
        raise IntegrationError(
            f"the values of {', '.join(search.unknown)} do not settle in {ITERATIONS} steps",
            hint="other starts, or quantities that depend on them more smoothly",
        )
    if tied := _tied(search, ended.jac):
        raise _undetermined(tied)
    if np.sqrt(2.0 * ended.cost) > BARRED * np.linalg.norm(first) and (error := _stopped(search, runs, tried)):
        raise error
    (end,) = runs.at([ended.x])
    after, before = (
        {name: float(np.abs(run.numbers[np.array(begin.names) == name]).max()) for name in begin.names}
        for run in (end, begin)
    )
    return FoundValues(ended.x, after, before)


def _same_rows(run: Run, begin: Run) -> Array:
    """Return the numbers of a run that has as many as that at the start, or raise."""
    if len(run.numbers) != len(begin.numbers):
        raise InputError(
            "so_that compares runs row by row, and they have not as many rows: one ends earlier, or has other impacts",
            expected="runs with the same rows",
            hint="a number of the run, such as 'C_B @ end' or 'C_B @ max'",
        )
    return run.numbers


def _sizes(search: Find, x: Array) -> Array:
    """Return the sizes of the numbers at a point, shape (k,): of 0 that of its unit."""
    units = np.array([unknown.factor for unknown in search.unknown.values()])
    sizes = np.maximum(np.abs(x), WIDTH * np.abs(search.start))
    return np.where(sizes > 0.0, sizes, units)


def _stopped(search: Find, runs: Runs, tried: int) -> PinarmError | None:
    """Return the error of the first refused run after those that have been tried before; none where there is none."""
    for x, run in [*runs.known.values()][tried:]:
        if run.error:
            error, values = run.error(), search.figures(x).items()
            where = ", ".join(f"{path} = {value:.6g}" for path, value in values)
            error.message = f"the search is stopped by a run that is refused, at {where}: {error.message}"
            error.hint = error.hint or "another start, or a wish that runs on this side can meet"
            return error
    return None


def _tied(search: Find, jacobian: Array) -> list[str]:
    """Return the paths of numbers that slopes, shape (rows, k), do not determine."""
    columns = np.linalg.norm(jacobian, axis=0)
    _, s, vt = np.linalg.svd(jacobian / np.where(columns > 0.0, columns, 1.0))
    if (s > INDEPENDENT * s[0]).all():
        return []
    return [path for path, share in zip(search.unknown, vt[-1], strict=True) if abs(share) > 0.1]


def _undetermined(paths: Sequence[str]) -> InputError:
    return InputError(
        f"what is wanted does not determine {', '.join(paths)}",
        expected="unknowns that change what is wanted, each in its own way",
        hint="fewer unknowns, another start, or more quantities in so_that",
    )
