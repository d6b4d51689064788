"""Where on a run a quantity is asked: an instant, a coordinate's value, an extreme; solved there, not interpolated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, Key, within
from pinarm.use.result.expectation import in_si

POINTS, ROUNDS = 17, 14
"""A bracket is cut in 16 parts 14 times: 16^14 is beyond the digits of a double, so it ends at rounding."""

_HEIGHTS: dict[str, Callable[[Array], Array]] = {
    "max": lambda x: x,
    "min": lambda x: -x,
    "largest": lambda x: np.abs(x),
}

SAME = 1e-9
"""Relative difference between two sides of an instant below which there is no jump to be asked about."""


def at(quantities: Quantities, where: str | dict[str, str | int | float], name: str) -> Quantities:
    """Return the quantities of one row: the place that ``where`` names.

    Args:
        quantities: Those of the run.
        where: As in ``Expectation.at``, without ``all``.
        name: The quantity that is asked, of which an extreme or a jump is meant.

    Raises:
        InputError: The place does not exist, or it is ambiguous.
    """
    run = quantities.trajectory
    if where == "start":
        return _at_row(quantities, 0, float(run.grid.t[0]))
    if where == "end":
        return _at_row(quantities, len(run.grid.cuts) - 2, float(run.grid.t[-1]))
    if isinstance(where, str):
        return _extreme(quantities, where, name)
    keys = {key: value for key, value in where.items() if key not in ("side", "occurrence")}
    if len(keys) != 1:
        raise InputError("an instant names one coordinate", expected="such as {t: 1.5 s, side: left}")
    (along, text), *_ = keys.items()
    with within(Key(along)):
        measured = quantities[along].unit
    with within(along):
        value = in_si(text, measured)
    places = _on_parameter(run, value) if along == run.parameter else _crossings(quantities, along, value)
    return _choose(quantities, places, where, name, f"{along} = {text}")


Spot = tuple[int, float]
"""An interval of the run and a value of its parameter within it."""


def _on_parameter(run: Trajectory, value: float) -> list[Spot]:
    spots = []
    for k, (start, end) in enumerate(zip(run.grid.cuts, run.grid.cuts[1:], strict=False)):
        slack = 1e-12 * abs(end - start)
        if min(start, end) - slack <= value <= max(start, end) + slack:
            spots.append((k, float(np.clip(value, min(start, end), max(start, end)))))
    return spots


def _crossings(quantities: Quantities, along: str, value: float) -> list[Spot]:
    """Return where a quantity takes a value, in order."""
    run, spots = quantities.trajectory, []
    for interval, (start, end, rows) in enumerate(run.grid.intervals()):
        t = run.grid.t[rows]
        t = np.concatenate(
            [t[:0] if len(t) and t[0] == start else [start], t, [] if len(t) and t[-1] == end else [end]]
        )
        difference = _asked(quantities, interval, t)[along].values - value
        for k in range(len(t) - 1):
            if difference[k] == 0.0:
                spots.append((interval, float(t[k])))
            elif difference[k] * difference[k + 1] < 0.0:
                spots.append((interval, _root(quantities, interval, along, value, (t[k], t[k + 1]))))
        if difference[-1] == 0.0:
            spots.append((interval, float(t[-1])))
    return spots


def _choose(
    quantities: Quantities, spots: list[Spot], where: dict[str, str | int | float], name: str, text: str
) -> Quantities:
    """Return the row that is meant among those found: by occurrence, then by side."""
    occurrence = where.get("occurrence", 1)
    if isinstance(occurrence, bool) or not isinstance(occurrence, int) or occurrence < 1:
        raise InputError(f"'{occurrence}' is no occurrence", expected="a whole number from 1")
    instants = sorted({round(t, 14) for _, t in spots}, key=lambda t: [round(s, 14) for _, s in spots].index(t))
    if not instants:
        raise InputError(f"{text} is not reached in this run")
    if len(instants) > 1 and "occurrence" not in where:
        raise InputError(f"{text} is reached {len(instants)} times", expected=f"occurrence: 1 to {len(instants)}")
    if occurrence > len(instants):
        raise InputError(f"{text} is reached {len(instants)} times only", expected=f"at most {len(instants)}")
    chosen = [spot for spot in spots if round(spot[1], 14) == instants[occurrence - 1]]
    sides = [_at_row(quantities, *chosen[0]), _at_row(quantities, *chosen[-1])]
    side = where.get("side")
    if side not in (None, "left", "right"):
        raise InputError(f"there is no side '{side}'", expected="left or right")
    if side is None and len(chosen) > 1:
        left, right = (float(rows[name].values[0]) for rows in sides)
        if abs(left - right) > SAME * max(abs(left), abs(right)):
            raise InputError(
                f"{name} jumps at {text}: {left:.9g} before, {right:.9g} after", expected="side: left or side: right"
            )
    return sides[0 if side == "left" else 1]


def _extreme(quantities: Quantities, which: str, name: str) -> Quantities:
    """Return the row at which a quantity is largest, smallest, or largest in size, refined between the samples."""
    run = quantities.trajectory
    height = _HEIGHTS[which]
    values = height(quantities[name].values)
    if not np.isfinite(values).all():
        raise InputError(f"{name} is not finite everywhere: it has no extreme")
    best = int(values.argmax())
    low, high = sorted((run.grid.t[max(best - 1, 0)], run.grid.t[min(best + 1, len(values) - 1)]))
    spots = []
    for interval, (start, end, _) in enumerate(run.grid.intervals()):
        bracket = max(low, min(start, end)), min(high, max(start, end))
        if bracket[0] <= bracket[1]:
            spots.append(_refined(quantities, interval, name, height, bracket))
    _, interval, t = max(spots, key=lambda spot: spot[0])
    return _at_row(quantities, interval, t)


def _refined(
    quantities: Quantities, interval: int, name: str, height: Callable[[Array], Array], bracket: tuple[float, float]
) -> tuple[float, int, float]:
    """Return the largest height in a bracket of one interval, the interval, and where it is."""
    (low, high), spot, top = bracket, bracket[0], -np.inf
    for _ in range(ROUNDS // 2):  # near a maximum only half of the digits of its place matter
        t = np.linspace(low, high, POINTS)
        heights = height(_asked(quantities, interval, t)[name].values)
        peak = int(heights.argmax())
        if heights[peak] > top:
            spot, top = float(t[peak]), float(heights[peak])
        low, high = t[max(peak - 1, 0)], t[min(peak + 1, POINTS - 1)]
    return top, interval, spot


def _root(quantities: Quantities, interval: int, along: str, value: float, bracket: tuple[float, float]) -> float:
    """Return where a quantity takes a value between two neighbouring samples."""
    low, high = bracket
    for _ in range(ROUNDS):
        t = np.linspace(low, high, POINTS)
        difference = _asked(quantities, interval, t)[along].values - value
        change = np.flatnonzero((difference[:-1] == 0.0) | (difference[:-1] * difference[1:] < 0.0))
        if not len(change):
            break
        low, high = t[change[0]], t[change[0] + 1]
        if difference[change[0]] == 0.0:
            return float(low)
    return 0.5 * float(low + high)


def _asked(quantities: Quantities, interval: int, t: Array) -> Quantities:
    return Quantities(quantities.trajectory.within(interval, t), quantities.symbols)


def _at_row(quantities: Quantities, interval: int, t: float) -> Quantities:
    return _asked(quantities, interval, np.array([t]))
