"""What several joints at rest may hold of a load that they hold together: the ends of what rigid bodies leave open.

Of a group only the sum ``phi = sum_i c_i f_i`` is determined, and ``|f_i| <= L_i(f)``: limits depend on loads, and
these on f. A quantity that is linear in f is least and greatest at corners of this set. Of two joints the set is a
piece of a line: its ends are looked for from the friction of the rows, as far as no limit is exceeded; limits may grow
with the friction, as of a worm that locks. Of more joints corners are where all but one are at their limits and that
one has the rest, by the equation of slip with the law of rest. A quantity that is not linear, such as the length of a
force, may be less within the set than at its corners. Where the set has no end in a direction, or its corners are not
found, a friction in that direction stands for it, which tells what depends on it, and which way.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint import one_sided
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.friction.balance import FrictionBalance, SlipGroup
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.slip_vectors import sizes
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


class Corner(NamedTuple):
    """Which members of a group are at their limits.

    Attributes:
        limited: Their positions in the group.
        signs: In which directions, 1 or -1.
        rest: Positions of the others, which are those of one joint.
    """

    limited: list[int]
    signs: list[float]
    rest: list[int]


class Extremes(NamedTuple):
    """Frictions that hold as well.

    Attributes:
        frictions: Shape (e, k).
        endless: Which of them only tell a direction in which there is no end, or none that is known, shape (e,).
    """

    frictions: Array
    endless: Flags


class Shares(NamedTuple):
    """What joints at rest share.

    Attributes:
        corners: Frictions at the corners, shape (e, k).
        directions: What is added to the friction in directions without a known end, shape (k,) each.
    """

    corners: Array
    directions: list[Array]


def joints_of(balance: FrictionBalance, group: SlipGroup) -> list[str]:
    """Return the names of the joints of a group."""
    return list(dict.fromkeys(balance.contacts[i].name for i in group.members))


def extreme_frictions(
    balance: FrictionBalance, direction: Array, stuck: Sequence[SlipGroup], friction: Array,
    unknown: Collection[int] = (),
) -> Extremes:  # fmt: skip
    """Return the frictions at the corners; none where nothing is open.

    Args:
        balance: The state.
        direction: Of joints that slip, 0 of others, shape (k,).
        stuck: The groups at rest.
        friction: Of the rows, shape (k,): joints that slip keep theirs.
        unknown: Joints whose limits rigid bodies do not determine.
    """
    shared = _shared(balance, direction, stuck, friction)
    corners, directions = shared.corners if len(shared.corners) else friction[None], shared.directions
    on_laws = _at_rest_on_laws(balance, direction, stuck)
    for i in on_laws:
        known = len(on_laws) <= ALONE and i not in unknown
        limits = {sign: _limit(balance, direction, stuck, i, sign) if known else None for sign in (-1.0, 1.0)}
        values = [float(friction[i]) if f is None else f for f in limits.values()]
        corners = np.concatenate([_with(corners, i, f) for f in dict.fromkeys(values)])
        size = max(1.0, float(balance.limits(friction)[i]))
        directions = [*directions, *(sign * size * np.eye(len(friction))[i] for sign, f in limits.items() if f is None)]
    ends = corners if len(corners) > 1 else corners[:0]
    frictions = np.concatenate([ends, friction + np.array(directions).reshape(-1, len(friction))])
    return Extremes(frictions, np.arange(len(frictions)) >= len(ends))


def _at_rest_on_laws(balance: FrictionBalance, direction: Array, stuck: Sequence[SlipGroup]) -> list[int]:
    """Return joints at rest where a law or a stop holds them: friction shares that load with it."""
    grouped = {i for group in stuck for i in group.members}
    return [i for i in np.flatnonzero((direction == 0.0) & balance.response.driven).tolist() if i not in grouped]


def _limit(balance: FrictionBalance, direction: Array, stuck: Sequence[SlipGroup], i: int, sign: float) -> float | None:
    """Return the friction of joint i at its limit at rest in a direction; ``None`` where it has none that is known."""
    forced, resting = direction.copy(), np.zeros(len(direction), dtype=bool)
    forced[i], resting[i] = -sign, True
    try:
        solution = balance.solve_under_any_load(forced, stuck, resting)
    except DynamicsError:
        return None
    return None if solution is None else float(solution.f[i])


def _with(corners: Array, i: int, f: float) -> Array:
    """Return frictions with another one of joint i, shape (e, k)."""
    changed = corners.copy()
    changed[:, i] = f
    return changed


def _shared(balance: FrictionBalance, direction: Array, stuck: Sequence[SlipGroup], friction: Array) -> Shares:
    """Return what groups share."""
    counts = [len(joints_of(balance, group)) for group in stuck]
    if sorted(counts)[-2:] in ([2], [1, 2]):
        return _ends(balance, stuck, stuck[counts.index(2)], friction)
    corners = _all_corners(balance, direction, stuck, friction)
    if len(corners) or max(counts, default=1) == 1:
        return Shares(corners, [])
    size = max(1.0, float(balance.limits(friction).max()))
    ways = [
        way for group in stuck for name in joints_of(balance, group)[1:] for way in [_exchange(balance, group, name)]
    ]
    return Shares(corners, [sign * size * way for way in ways for sign in (-1.0, 1.0)])


def _exchange(balance: FrictionBalance, group: SlipGroup, name: str) -> Array:
    """Return the friction that the first joint of a group takes over from another one, 1 in all, shape (k,)."""
    of = np.array([balance.contacts[i].name for i in group.members])
    weights, exchange = group.ratios * group.units, np.zeros(len(balance.contacts))
    first, other = of == joints_of(balance, group)[0], of == name
    exchange[list(group.members)] = (first / weights[first].sum() - other / weights[other].sum()) * group.units
    return exchange


def _ends(balance: FrictionBalance, stuck: Sequence[SlipGroup], group: SlipGroup, friction: Array) -> Shares:
    """Return the ends of what two joints may share."""
    members, exchange = list(group.members), _exchange(balance, group, joints_of(balance, group)[1])
    every = [i for each in stuck for i in each.members]
    held = (group.ratios * group.units) @ balance.limits(friction)[members] + abs(group.ratios @ friction[members])
    size = float(held) or 1.0

    def holds(s: float) -> bool:
        f = friction + s * exchange
        return bool((sizes(balance.contacts, f)[every] <= balance.limits(f)[every] * (1.0 + WITHIN)).all())

    ends = {sign: _last(holds, sign * size) for sign in (-1.0, 1.0)}
    corners = [friction + (end if np.isfinite(end) else 0.0) * exchange for end in ends.values()]
    return Shares(np.array(corners), [sign * size * exchange for sign, end in ends.items() if not np.isfinite(end)])


def _last(holds: Callable[[float], bool], size: float) -> float:
    """Return how far from 0 on a condition holds without a break, in the direction of ``size``; infinite for ever."""
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
    choices = [list(_corners(balance, group)) for group in stuck]
    count = int(np.prod([len(each) for each in choices]))
    corners = list[Array]()
    for choice in product(*choices) if 1 < count <= MOST else ():
        try:
            corner = _at(balance, direction, stuck, choice)
        except DynamicsError:  # the equation of slip has not exactly one root
            return np.zeros((0, len(friction)))
        if corner is not None:
            corner = np.where(direction != 0.0, friction, corner)
            slack = SAME * np.abs(corner).max(initial=0.0)
            if all(np.abs(other - corner).max() > slack for other in corners):
                corners.append(corner)
    return np.array(corners).reshape(-1, len(friction))


def _corners(balance: FrictionBalance, group: SlipGroup) -> Iterator[Corner]:
    """Yield the corners of a group; one of a single joint, which has nothing at a limit."""
    names, of = joints_of(balance, group), [balance.contacts[i].name for i in group.members]
    for free in names:
        rest = [k for k, name in enumerate(of) if name == free]
        limited = [k for k, name in enumerate(of) if name != free]
        others = [name for name in names if name != free]
        for signs in product([1.0, -1.0], repeat=len(others)):
            sign = dict(zip(others, signs, strict=True))
            yield Corner(limited, [sign[of[k]] for k in limited], rest)


def _at(
    balance: FrictionBalance, direction: Array, stuck: Sequence[SlipGroup], corners: Sequence[Corner]
) -> Array | None:
    """Return the friction at corners of the groups, shape (k,); ``None`` where the rest exceeds its own limit."""
    forced, resting, groups = direction.copy(), np.zeros(len(direction), dtype=bool), []
    for group, corner in zip(stuck, corners, strict=True):
        limited = [group.members[k] for k in corner.limited]
        forced[limited], resting[limited] = group.units[corner.limited] * corner.signs, True
        first = corner.rest[0]
        groups.append(replace(
            group, members=tuple(group.members[k] for k in corner.rest),
            ratios=group.ratios[corner.rest] / group.ratios[first],
            units=group.units[corner.rest] * np.sign(group.ratios[first]),
        ))  # fmt: skip
    solution = balance.solve_under_any_load(forced, groups, resting)
    if solution is None or (np.abs(solution.held) > solution.bounds * (1.0 + WITHIN)).any():
        return None
    return solution.f


def held_part(closure: Closure, lam: Multipliers, other: Multipliers) -> Array:
    """Return how far from one friction to another one constraints that push or pull only hold, shape (n,).

    Args:
        closure: The constraints.
        lam: Multipliers under the first friction, shape (n, m).
        other: Those under the other one.
    """
    part, slices = np.ones(len(lam)), closure.slices
    for constraint in one_sided(closure.constraints):
        row = slices[constraint.name].start
        pushes = (constraint.side * np.asarray(multipliers)[:, row] for multipliers in (lam, other))
        part = np.minimum(part, pushing_part(*pushes))
    return part


def pushing_part(push: Array, other: Array) -> Array:
    """Return how far from one push to another one it does not become a pull, shape (n,)."""
    gone = (other < 0.0) & (push >= 0.0)
    return np.divide(push, push - other, out=np.ones_like(push), where=gone)


def filled(friction: Array, extremes: Sequence[Extremes]) -> list[tuple[Array, Flags]]:
    """Return other frictions of n rows, shape (n, k) each, and in which rows they only tell a direction, shape (n,).

    Rows with fewer have the given friction, shape (n, k), in place of them.
    """
    count = max((len(each.frictions) for each in extremes), default=0)
    others = [(friction.copy(), np.zeros(len(friction), dtype=bool)) for _ in range(count)]
    for row, each in enumerate(extremes):
        for (other, endless), f, far in zip(others, each.frictions, each.endless, strict=False):
            other[row], endless[row] = f, far
    return others
