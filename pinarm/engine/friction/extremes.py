"""Bounds of static friction where stuck joints share a load.

Of a group only the sum ``phi = sum_i c_i f_i`` is determined, and ``|f_i| <= L_i(f)``: limits depend on loads, and
these on f. A quantity that is linear in f is least and greatest at corners of this set: there all joints of a group but
one are at their limits and that one has the rest, and joints on laws or stops are at their limits, by the equation of
slip with the law of rest. A quantity that is not linear, such as the length of a force, may be less within the set than
at its corners. Where the corners are not known, frictions in all directions stand for them, which tell what depends on
the share, and which way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from math import prod
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import one_sided
from pinarm.engine.friction.complementarity import FrictionBalance
from pinarm.engine.friction.slip import SlipGroup
from pinarm.errors import DynamicsError
from pinarm.records import replace

WITHIN, SAME = 1e-12, 1e-12
"""Part of its bound by which a joint may exceed it at a corner; and of the friction by which corners are one."""

MOST = 1024
"""Corners that are tried at most: those of 8 joints that hold one motion."""

Corner = tuple[SlipGroup | None, Mapping[int, float]]
"""The rest of a group beside joints at their limits, and the directions of these."""


class Extremes(NamedTuple):
    """Frictions that hold as well, shape (e, k), and which of them only tell a direction without a known end, (e,)."""

    frictions: Array
    endless: Flags


def extreme_frictions(
    balance: FrictionBalance, direction: Array, stuck: Sequence[SlipGroup], friction: Array
) -> Extremes:
    """Return the frictions at the corners; none where nothing is open.

    Joints that slip, in a direction that is not 0, keep their friction.
    """
    grouped = {i for group in stuck for i in group.members}  # others at rest share the load of a law or a stop
    resting = np.flatnonzero((direction == 0.0) & balance.response.driven).tolist()
    alone = [i for i in resting if i not in grouped]
    choices: list[list[Corner]] = [list(_corners(balance, group)) for group in stuck]
    choices += [[(None, {i: sign}) for sign in (-1.0, 1.0)] for i in alone]
    count = prod(map(len, choices))
    if count == 1:
        return Extremes(np.zeros((0, len(friction))), np.zeros(0, dtype=bool))
    try:
        corners = [] if count > MOST else list(_solved(balance, direction, friction, choices))
    except DynamicsError:  # the equation of slip has not exactly one root
        corners = []
    if corners:
        return Extremes(np.array(corners), np.zeros(len(corners), dtype=bool))
    size = max(1.0, float(balance.limits(friction).max()))
    ways = [np.eye(len(friction))[i] for i in alone] + [way for group in stuck for way in _exchanges(balance, group)]
    frictions = np.array([friction + sign * size * way for way in ways for sign in (-1.0, 1.0)])
    return Extremes(frictions, np.ones(len(frictions), dtype=bool))


def _solved(
    balance: FrictionBalance, direction: Array, friction: Array, choices: Sequence[Sequence[Corner]]
) -> Iterator[Array]:
    """Yield the corners that are within all limits, each once."""
    known, any_load = list[Array](), not _bounded(balance, choices)
    for choice in product(*choices):
        forced, groups = direction.copy(), [rest for rest, _ in choice if rest]
        for limited in (limited for _, limited in choice):
            forced[list(limited)] = list(limited.values())
        solution = balance.solve(forced, groups, forced != direction, any_load=any_load)
        if solution is None or (np.abs(solution.held) > solution.bounds * (1.0 + WITHIN)).any():
            continue
        corner = np.where(direction != 0.0, friction, solution.f)
        slack = SAME * np.abs(corner).max(initial=0.0)
        if all(np.abs(other - corner).max() > slack for other in known):
            known.append(corner)
            yield corner


def _bounded(balance: FrictionBalance, choices: Sequence[Sequence[Corner]]) -> bool:
    """Return whether constant limits, of all joints of each group but one, bound what they share."""
    loads = balance.response.loads
    loaded = {x.name for i, x in enumerate(balance.contacts) if x.law.loaded and loads.most(i, x.bearing).any()}
    sharing = [{balance.contacts[i].name for _, limited in choice for i in limited} & loaded for choice in choices]
    return all(len(names) <= bool(choice[0][0]) for names, choice in zip(sharing, choices, strict=True))


def _corners(balance: FrictionBalance, group: SlipGroup) -> Iterator[Corner]:
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
            yield remaining, {i: unit * sign[name] for i, unit, name in members if name != free}


def _exchanges(balance: FrictionBalance, group: SlipGroup) -> Iterator[Array]:
    """Yield the friction that the first joint of a group takes over from each other one, 1 in all, shape (k,)."""
    of, weights = np.array([balance.contacts[i].name for i in group.members]), group.ratios * group.units
    for name in dict.fromkeys(of[of != of[0]].tolist()):
        first, other, exchange = of == of[0], of == name, np.zeros(len(balance.contacts))
        exchange[list(group.members)] = (first / weights[first].sum() - other / weights[other].sum()) * group.units
        yield exchange


def held_part(closure: Closure, lam: Array, other: Array) -> Array:
    """Return the part of the step between two frictions, by multipliers, on which one-sided constraints hold, (n,)."""
    part, slices = np.ones(len(lam)), closure.slices
    for constraint in one_sided(closure.constraints):
        row = slices[constraint.name].start
        pushes = (constraint.side * multipliers[:, row] for multipliers in (lam, other))
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
