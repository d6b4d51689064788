"""Singular positions of prescribed motions: whether a step passes one, and what depends on what."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.nullspace import RANK
from pinarm.errors import AssemblyError
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.mechanics.joints import RADIAN

_running: ContextVar[tuple[str, Unit] | None] = ContextVar("running", default=None)


@contextmanager
def running(name: str = "", measured: Unit = DIMENSIONLESS) -> Iterator[None]:
    """Let messages of the block name what runs along the rows.

    Args:
        name: ``t``, or the coordinate that is swept; empty where every row is a state of its own, without an instant.
        measured: Its unit; that of a number where rows are counted, which have no name.
    """
    token = _running.set((name, measured) if not name or str(measured) != "1" else None)
    try:
        yield
    finally:
        _running.reset(token)


def is_in_states() -> bool:
    """Tell whether every row is a state of its own."""
    return _running.get() == ("", DIMENSIONLESS)


def at(value: float) -> str:
    """Return a value [SI] as `` at t = 0.5 s``; nothing in states of their own."""
    return "" if is_in_states() else f" at {instant(value)}"


def instant(value: float) -> str:
    """Return a value [SI] as ``t = 0.5 s`` or ``C = 30 deg``; the number alone where nothing says what runs."""
    known = _running.get()
    if known is None:
        return f"{value:.9g}"
    name, measured = known
    if measured == RADIAN:
        return f"{name} = {math.degrees(value):.9g} deg"
    return f"{name} = {value:.9g} {measured}"


ENOUGH = 1e-9
"""Correction that is the last: Newton's method doubles the digits, the next one would be below rounding."""

CROSSED, AIMED, NEARER = 5e-6, 2e-6, 0.3
"""Largest ratio of singular values of J on both sides of a singular position that a step goes through, the one that the
step before it aims at, and how much smaller than the last one it becomes at once."""

SINGULAR = 1e-6
"""Smallest ratio of singular values of J that still determines velocities. Near a stretched position Newton's method
leaves an angle of the square root of ``CLOSED``, so a smaller ratio is not told from 0."""

PART = 0.1
"""Part of a combination of rows, of length 1, from which on a row is named."""


def on_branch(turned: Array, correction: Array) -> Flags:
    """Return a mask of the solutions on the branch of their predictions: other branches have other velocities.

    With an error of the predicted position ``h^3 j / 6`` that of the velocity is three times as much, over h.

    Args:
        turned: Errors of the predicted velocities, times h, shape (.., nv).
        correction: Largest errors of the predicted coordinates, shape (..).
    """
    return np.asarray(np.abs(turned).max(axis=-1) <= 10.0 * correction + ENOUGH)


def part_of_leap(rows: Array, there: Array) -> float:
    """Return the part of a step to take, from J before and after it: 1, unless the step passes a singularity.

    The least singular value is taken to change linearly, through 0. A shorter step aims at a position nearer to the
    singularity; a step that begins very near it goes through, over twice the distance. Where branches come close but
    do not meet, the shorter steps follow their branch.
    """
    nv = rows.shape[1]
    if np.linalg.slogdet(rows.T @ there)[0] > 0.0:
        return 1.0
    values = [np.linalg.svd(matrix, compute_uv=False) for matrix in (rows, there)]
    before, after = (float(value[nv - 1] / value[0]) for value in values)
    if max(before, after) <= CROSSED:
        return 1.0
    wanted = max(NEARER * before, AIMED) if before > CROSSED else -before
    return (before - wanted) / (before + after)


def tied(rows: Array, rank: int, names: Sequence[str]) -> str:
    """Return in words which rows depend on each other: those with a part in a combination that nearly vanishes."""
    size = np.linalg.norm(rows, axis=1)
    units = np.where(size > RANK * size.max(), size, 1.0)  # a part does not hang on the unit of its row
    weak = np.linalg.svd(rows / units[:, None])[0][:, rank - 1]
    tied = dict.fromkeys(name for name, part in zip(names, weak, strict=True) if abs(part) > PART)
    return f"{', '.join(tied)} {'do' if len(tied) > 1 else 'does'} not move independently"


def check_rank(rows: Array, names: Sequence[str], t: float) -> None:
    """Raise where rows do not determine the velocity of every joint."""
    nv = rows.shape[1]
    singular = np.linalg.svd(rows, compute_uv=False)
    if len(rows) < nv or not singular[nv - 1] > SINGULAR * singular[0]:
        raise AssemblyError(
            f"the position is singular{at(t)}: {tied(rows, min(len(rows), nv), names)} there",
            expected="prescribed coordinates that determine the velocity of every joint",
            hint="a motion that keeps clear of the straight or folded position; at a change point a start and rows "
            "beside it, between which the motion passes it; or other coordinates",
            t=t,
        )
