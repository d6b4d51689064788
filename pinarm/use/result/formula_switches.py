"""Where formulas go from one smooth part to another, as ``abs``, ``min``, ``%`` and comparisons do.

What lies between two such places may be narrow. The arguments on which they hang are smooth, and tell where it is;
those that switch themselves, as in ``min(abs(x), y)``, are smooth between the places where these do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, distinct
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.use.result.figures.bracket_fit import BracketFit

if TYPE_CHECKING:
    from pinarm.use.result.row_lookup import Lookup

MOST = 100
"""Places of a run at most: of more, as of a sawtooth, each tooth is seen by what looks at the curve."""

MISPLACED = 4e-15
"""Part of an instant by which such a place may be off: a formula may jump there, or rise from 0 as a root."""

NESTED = 4
"""How deep functions that switch are looked into."""


class _Bracket(NamedTuple):
    """Two neighbouring places of an interval between which a function changes its sign."""

    function: int
    interval: int
    low: float
    high: float

    @property
    def places(self) -> tuple[int, Array]:
        return self.interval, BracketFit.places(self.low, self.high)


def switches(run: Lookup, name: str) -> list[Array]:
    """Return where formulas behind a name go from one smooth part to another, interval by interval, ascending.

    They are looked for between rows and between the places at which extremes are. None are returned where there are
    more than ``MOST``, and none of functions that are not smooth between others' places.

    Args:
        run: A run.
        name: A quantity, a symbol or a formula.
    """
    none = [np.empty(0)] * len(run.intervals)
    try:
        count = len(run.quantities.switches(name)) if run.motion is not None else 0
    except InputError:  # a name from a model, with marks of formulas in it
        return none
    known: list[list[Array]] = [none] * count
    for _ in range(NESTED if count else 0):
        brackets = [bracket for k in range(count) for bracket in _brackets(run, name, k, known)]
        if not brackets:
            break
        if len(brackets) + sum(len(t) for own in known for t in own) > MOST:
            return none
        run.announce([bracket.places for bracket in brackets])
        known = [_with_crossings(run, name, k, known[k], brackets) for k in range(count)]
    return [distinct(np.concatenate(of)) if of else none[0] for of in zip(*known, strict=True)] or none


def _brackets(run: Lookup, name: str, function: int, known: list[list[Array]]) -> list[_Bracket]:
    """Return the brackets of one function, between which and others places are known."""
    parts = [part.places for part in run.parts]
    spots = [*enumerate(run.run.grid.t[own] for _, _, own in run.intervals), *parts]
    spots += [(interval, t) for own in known for interval, t in enumerate(own) if len(t)]
    spots = [(interval, t) for interval, t in spots if len(t)]
    values, found = _values(run, name, function, spots), []
    for interval in sorted({number for number, _ in parts}):
        here = [k for k, (number, _) in enumerate(spots) if number == interval]
        t, first = np.unique(np.concatenate([spots[k][1] for k in here]), return_index=True)
        signs = np.sign(np.concatenate([values[k] for k in here])[first])
        signs[np.isin(t, known[function][interval])] = 0.0
        found += [_Bracket(function, interval, float(t[k]), float(t[k + 1]))
                  for k in np.flatnonzero(signs[:-1] * signs[1:] < 0.0)]  # fmt: skip
    return found


def _with_crossings(run: Lookup, name: str, function: int, known: list[Array], brackets: list[_Bracket]) -> list[Array]:
    """Return the known places of one function, and those in its brackets between which it is smooth."""
    own = [bracket for bracket in brackets if bracket.function == function]
    curves = _values(run, name, function, [one.places for one in own])
    fits = [(one.interval, BracketFit(one.low, one.high, values)) for one, values in zip(own, curves, strict=True)]
    near = [(interval, fit, fit.crossings()[:1]) for interval, fit in fits if fit.is_resolved]
    near = [(interval, fit, t) for interval, fit, t in near if len(t)]
    gaps = _values(run, name, function, [(interval, t) for interval, _, t in near])
    places = [list(t) for t in known]
    for (interval, fit, t), gap in zip(near, gaps, strict=True):
        places[interval].append(_corrected(fit, float(t[0]), float(gap[0])))
    return [np.array(t) for t in places]


def _values(run: Lookup, name: str, function: int, spots: list[tuple[int, Array]]) -> list[Array]:
    """Return the values of one function at places of intervals."""

    def values(rows: Quantities) -> Array:
        return rows.switches(name)[function]

    return run.heights(values, spots)


def _corrected(fit: BracketFit, t: float, gap: float) -> float:
    """Return a zero after a step of Newton's method from that of its polynomial, which leaves rounding.

    Args:
        fit: The polynomial.
        t: Its zero.
        gap: Value of the curve there.
    """
    slope = fit.slope(t)
    return min(max(t - gap / slope, fit.low), fit.high) if slope else t
