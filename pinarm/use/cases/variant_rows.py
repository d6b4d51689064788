"""Quantities of variants along one motion: at its rows, and their extremes between these.

An extreme is looked for as in a single run: in the brackets about the highest row, and about each that may be passed by
a place beside it, by the polynomial through Chebyshev points (``bracket_fit``). Here it is also the extreme's value, so
that all variants of a bracket are solved at the same places; one that it does not resolve is left to be solved alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.use.result.figures.bracket_fit import BracketFit
from pinarm.use.result.figures.crossings import FLAT
from pinarm.use.result.row_lookup import HEIGHTS, PLATEAU, rivals

BRACKETS = 8
"""Brackets in which variants are solved at once: 136 rows beside those of the motion."""

Bracket = tuple[int, float, float]
"""An interval of the motion, and the bounds of a bracket in it."""


@dataclass(frozen=True, eq=False)
class VariantRows:
    """What variants tell along a motion.

    Attributes:
        quantities: At its rows, of k variants.
        between: Numbers of some of the variants, shape (c,), and a grid with further rows -> their quantities there,
            and which of them are on the branch of the first, shape (c,), which has to be among them.
    """

    quantities: Quantities
    between: Callable[[Indices, Grid], tuple[Quantities, Flags]]

    def values(self, name: str) -> Array:
        """Return a quantity, shape (n, k) or (n, 1)."""
        return _columns(self.quantities, name)

    def extreme(self, which: str, of: str, name: str) -> Array:
        """Return a quantity where one is ``max``, ``min`` or ``largest``, shape (k,); NaN where it is not resolved."""
        heights, values = np.broadcast_arrays(HEIGHTS[which](self.values(of)), self.values(name))
        told, wanted = np.empty(heights.shape[1]), dict[Bracket, list[int]]()
        tops, limits = np.full(len(told), -np.inf), np.empty(len(told))
        for variant, column in enumerate(heights.T):
            if not np.isfinite(column).all():
                told[variant] = np.nan
                continue
            slack = PLATEAU * float(np.abs(column).max())
            best = int((column >= column.max() - slack).argmax())
            told[variant], limits[variant] = values[best, variant], column[best] + slack
            for row in (best, *rivals(column, best, slack)):
                for bracket in self._brackets(row):
                    wanted.setdefault(bracket, []).append(variant)
        left = iter(sorted(wanted))
        while some := list(islice(left, BRACKETS)):
            self._refine(which, of, name, {bracket: wanted[bracket] for bracket in some}, told, tops, limits)
        return told

    def _brackets(self, row: int) -> list[Bracket]:
        """Return the brackets about a row: from the row before to that behind, in parts at bounds of intervals."""
        grid = self.quantities.trajectory.grid
        low, high = sorted((grid.t[max(row - 1, 0)], grid.t[min(row + 1, len(grid.t) - 1)]))
        parts = ((k, max(low, min(start, end)), min(high, max(start, end)))
                 for k, (start, end, _) in enumerate(grid.intervals()))  # fmt: skip
        return [(k, float(begin), float(end)) for k, begin, end in parts if begin < end]

    def _refine(
        self, which: str, of: str, name: str, wanted: dict[Bracket, list[int]], told: Array, tops: Array, limits: Array
    ) -> None:
        """Replace what is told of variants where a bracket has a higher place than all before."""
        variants = np.array(sorted({0, *(variant for some in wanted.values() for variant in some)}))
        grid, nodes = _with_nodes(self.quantities.trajectory.grid, list(wanted))
        quantities, sound = self.between(variants, grid)
        shape = len(grid.t), len(variants)
        heights, values = (np.broadcast_to(_columns(quantities, each), shape) for each in (of, name))
        for ((_, low, high), some), places in zip(wanted.items(), nodes, strict=True):
            for variant in some:
                column = int(np.searchsorted(variants, variant))
                curves = HEIGHTS[which](heights[places, column]), values[places, column]
                top, found = _highest(low, high, *curves) if sound[column] else (np.inf, np.nan)
                if top > max(tops[variant], limits[variant]):
                    tops[variant], told[variant] = top, found


def _columns(quantities: Quantities, name: str) -> Array:
    """Return a quantity of variants, shape (n, k), or (n, 1) where it is the same in all."""
    values = quantities[name].values
    return values if values.ndim == 2 else values[:, None]


def _highest(low: float, high: float, heights: Array, values: Array) -> tuple[float, float]:
    """Return the largest height in a bracket and the value there; infinity and NaN where these are not resolved."""
    peak = int(heights.argmax())
    top, value = float(heights[peak]), float(values[peak])
    if not np.ptp(heights) > FLAT * np.abs(heights).max():
        return top, value
    fit, of_values = BracketFit(low, high, heights), BracketFit(low, high, values)
    if not fit.is_resolved or not (of_values.is_resolved or np.ptp(values) <= FLAT * np.abs(values).max()):
        return np.inf, np.nan
    places = fit.extremes()
    if len(places):
        found = fit.at(places)
        best = int(found.argmax())
        if found[best] > top:
            return float(found[best]), float(of_values.at(places[best : best + 1])[0])
    return top, value


def _with_nodes(grid: Grid, brackets: Sequence[Bracket]) -> tuple[Grid, list[Indices]]:
    """Return a grid with the points of brackets as further rows, and which rows these are, shape (17,) each."""
    parts, bounds, nodes = list[Array](), [0], dict[int, Indices]()
    for interval, (start, end, rows) in enumerate(grid.intervals()):
        own = {k: BracketFit.places(low, high) for k, (at, low, high) in enumerate(brackets) if at == interval}
        t = np.concatenate([grid.t[rows], *own.values()])
        order = np.argsort(t if start <= end else -t, kind="stable")
        place = np.empty(len(t), dtype=int)
        place[order] = bounds[-1] + np.arange(len(t))
        ends = np.split(place[rows.stop - rows.start :], len(own)) if own else []
        nodes |= zip(own, ends, strict=True)
        parts.append(t[order])
        bounds.append(bounds[-1] + len(t))
    return Grid(np.concatenate(parts), grid.cuts, tuple(bounds)), [nodes[k] for k in range(len(brackets))]
