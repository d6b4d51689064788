"""Bounds of static friction where stuck joints share a load.

Of a group only the sum ``phi = sum_i c_i f_i`` is determined, and ``|f_i| <= L_i(f)``: limits depend on loads, and
these on f. A quantity that is linear in f is least and greatest at corners of this set. Of two joints the set is a
piece of a line, whose ends are searched from the friction of the rows as far as no limit is exceeded; limits may grow
with the friction, as of a worm that locks. Of more joints, corners are where all but one are at their limits and that
one has the rest, by the equation of slip with the law of rest. A quantity that is not linear, such as the length of a
force, may be less within the set than at its corners. Where the set has no end in a direction, or its corners are not
known, a friction in that direction stands for it, which tells what depends on it, and which way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from math import prod
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import one_sided
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.friction.complementarity import FrictionBalance
from pinarm.engine.friction.slip import SlipGroup
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.contact import sizes
from pinarm.records import replace

WITHIN, SAME = 1e-12, 1e-12
"""Part of its bound by which a joint may exceed it at a corner; and of the friction by which corners are one."""

MOST = 1024
"""Corners that are tried at most: those of 8 joints that hold one motion."""

ALONE = 4
"""Joints at rest on laws or stops up to which all 2^n ends are told."""

PARTS, FAR, HALVINGS = 64, 12, 80
"""Steps along a line in which an end is looked for first, up to twice the sum of limits and load; how often the step is
doubled afterwards; and how often the step that holds it is halved."""


class Extremes(NamedTuple):
    """Frictions that hold as well, shape (e, k), and which of them only tell a direction without a known end, (e,)."""

    frictions: Array
    endless: Flags


def extreme_frictions(
    balance: FrictionBalance,
    direction: Array,
    stuck: Sequence[SlipGroup],
    friction: Array,
) -> Extremes:
    """Return the frictions at the corners; none where nothing is open.

    Joints that slip, in a direction that is not 0, keep their friction.
    """
    corners, ways = _shared(balance, direction, stuck, friction)
    corners = corners if len(corners) else friction[None]
    grouped = {i for group in stuck for i in group.members}  # others at rest share the load of a law or a stop
    on_laws = [i for i in np.flatnonzero((direction == 0.0) & balance.response.driven).tolist() if i not in grouped]
    for i in on_laws:
        known = len(on_laws) <= ALONE
        limits = {sign: _limit(balance, direction, stuck, i, sign) if known else None for sign in (-1.0, 1.0)}
        ends = dict.fromkeys(float(friction[i]) if f is None else f for f in limits.values())
        columns = np.arange(len(friction)) == i
        corners = np.concatenate([np.where(columns, f, corners) for f in ends])
        size = max(1.0, float(balance.limits(friction)[i]))
        ways += [sign * size * columns for sign, f in limits.items() if f is None]
    corners = corners if len(corners) > 1 else corners[:0]
    frictions = np.concatenate([corners, friction + np.array(ways).reshape(-1, len(friction))])
    return Extremes(frictions, np.arange(len(frictions)) >= len(corners))


def _limit(balance: FrictionBalance, direction: Array, stuck: Sequence[SlipGroup], i: int, sign: float) -> float | None:
    """Return the friction of joint i at its limit at rest in a direction; ``None`` where it has none that is known."""
    forced, resting = direction.copy(), np.zeros(len(direction), dtype=bool)
    forced[i], resting[i] = -sign, True
    try:
        solution = balance.solve(forced, stuck, resting, any_load=True)
    except DynamicsError:
        return None
    return None if solution is None else float(solution.f[i])


def _shared(
    balance: FrictionBalance, direction: Array, stuck: Sequence[SlipGroup], friction: Array
) -> tuple[Array, list[Array]]:
    """Return the corners of what groups share, shape (e, k), and directions without a known end, shape (k,) each."""
    names = [list(dict.fromkeys(balance.contacts[i].name for i in group.members)) for group in stuck]
    counts = [len(of_group) for of_group in names]
    if sorted(counts)[-2:] in ([2], [1, 2]):
        group = stuck[counts.index(2)]
        return _ends(balance, stuck, group, _exchange(balance, group, names[counts.index(2)][1]), friction)
    corners = _all_corners(balance, direction, stuck, friction)
    if len(corners) or max(counts, default=1) == 1:
        return corners, []
    size = max(1.0, float(balance.limits(friction).max()))
    ways = [_exchange(balance, group, name) for group, own in zip(stuck, names, strict=True) for name in own[1:]]
    return corners, [sign * size * way for way in ways for sign in (-1.0, 1.0)]


def _exchange(balance: FrictionBalance, group: SlipGroup, name: str) -> Array:
    """Return the friction that the first joint of a group takes over from another one, 1 in all, shape (k,)."""
    of = np.array([balance.contacts[i].name for i in group.members])
    weights, exchange = group.ratios * group.units, np.zeros(len(balance.contacts))
    first, other = of == of[0], of == name
    exchange[list(group.members)] = (first / weights[first].sum() - other / weights[other].sum()) * group.units
    return exchange


def _ends(
    balance: FrictionBalance, stuck: Sequence[SlipGroup], group: SlipGroup, exchange: Array, friction: Array
) -> tuple[Array, list[Array]]:
    """Return the ends of what two joints may share, and directions without an end."""
    members, every = list(group.members), [i for group in stuck for i in group.members]
    held = (group.ratios * group.units) @ balance.limits(friction)[members] + abs(group.ratios @ friction[members])
    size = float(held) or 1.0

    def holds(s: float) -> bool:
        f = friction + s * exchange
        return bool((sizes(balance.contacts, f)[every] <= balance.limits(f)[every] * (1.0 + WITHIN)).all())

    ends = {sign: _last(holds, sign * size) for sign in (-1.0, 1.0)}
    corners = [friction + (end if np.isfinite(end) else 0.0) * exchange for end in ends.values()]
    return np.array(corners), [sign * size * exchange for sign, end in ends.items() if not np.isfinite(end)]


def _last(holds: Callable[[float], bool], size: float) -> float:
    """Return the last value, from 0 on towards ``size``, up to which a condition holds; infinite if no end is found."""
    steps = [2.0 * size * k / PARTS for k in range(1, PARTS + 1)]
    steps += [2.0 * size * 2.0**k for k in range(1, FAR + 1)]
    beyond = next((k for k, s in enumerate(steps) if not holds(s)), None)
    if beyond is None:
        return np.inf
    low, high = steps[beyond - 1] if beyond else 0.0, steps[beyond]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _all_corners(balance: FrictionBalance, direction: Array, stuck: Sequence[SlipGroup], friction: Array) -> Array:
    choices, corners = [list(_corners(balance, group)) for group in stuck], list[Array]()
    for choice in product(*choices) if 1 < prod(map(len, choices)) <= MOST else ():
        forced, groups = direction.copy(), [rest for rest, _ in choice]
        for limited in (limited for _, limited in choice):
            forced[list(limited)] = list(limited.values())
        try:
            solution = balance.solve(forced, groups, forced != direction, any_load=True)
        except DynamicsError:  # the equation of slip has not exactly one root
            return np.zeros((0, len(friction)))
        if solution is None or (np.abs(solution.held) > solution.bounds * (1.0 + WITHIN)).any():
            continue
        corner = np.where(direction != 0.0, friction, solution.f)
        slack = SAME * np.abs(corner).max(initial=0.0)
        if all(np.abs(other - corner).max() > slack for other in corners):
            corners.append(corner)
    return np.array(corners).reshape(-1, len(friction))


def _corners(balance: FrictionBalance, group: SlipGroup) -> Iterator[tuple[SlipGroup, dict[int, float]]]:
    """Yield the corners of a group: one joint that takes the rest, and directions of the others, at their limits."""
    of = [balance.contacts[i].name for i in group.members]
    for free in dict.fromkeys(of):
        rest = [k for k, name in enumerate(of) if name == free]
        ratios = group.ratios[rest]
        remaining = replace(
            group,
            members=tuple(group.members[k] for k in rest),
            ratios=ratios / ratios[0],
            units=group.units[rest] * np.sign(ratios[0]),
        )
        others = [name for name in dict.fromkeys(of) if name != free]
        for signs in product([1.0, -1.0], repeat=len(others)):
            sign = dict(zip(others, signs, strict=True))
            members = zip(group.members, group.units.tolist(), of, strict=True)
            limited = {i: unit * sign[name] for i, unit, name in members if name != free}
            yield remaining, limited


def held_part(closure: Closure, lam: Multipliers, other: Multipliers) -> Array:
    """Return the part of the step between two frictions, by multipliers, on which one-sided constraints hold, (n,)."""
    part, slices = np.ones(len(lam)), closure.slices
    for constraint in one_sided(closure.constraints):
        row = slices[constraint.name].start
        pushes = (constraint.side * np.asarray(multipliers)[:, row] for multipliers in (lam, other))
        part = np.minimum(part, pushing_part(*pushes))
    return part


def pushing_part(push: Array, other: Array) -> Array:
    """Return the part of the step from one push to another before it becomes a pull, shape (n,)."""
    gone = (other < 0.0) & (push >= 0.0)
    return np.divide(push, push - other, out=np.ones_like(push), where=gone)


def filled(friction: Array, extremes: Sequence[Extremes]) -> list[tuple[Array, Flags]]:
    """Return other frictions of n rows, shape (n, k) each, and in which rows they only tell a direction, shape (n,).

    Rows with fewer have the given friction, shape (n, k), in place of them.
    """
    count = max((len(row.frictions) for row in extremes), default=0)
    others = [(friction.copy(), np.zeros(len(friction), dtype=bool)) for _ in range(count)]
    for row, own in enumerate(extremes):
        for (other, endless), f, far in zip(others, own.frictions, own.endless, strict=False):
            other[row], endless[row] = f, far
    return others
