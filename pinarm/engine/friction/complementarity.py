"""Complementarity problem of friction in one state: which joints stick, which begin to slip, and their friction.

Joints that can only move together, such as the pins of a four-bar linkage or a finger and one that mimics it, form a
group with one slip: the rows of its members are multiples c_i of the first. Only the sum ``phi = sum_i c_i f_i`` of a
stuck group is determined. It sticks while ``|phi| <= bound = sum_i |c_i| limit_i``, or begins to slip, ``alpha > 0``
with friction against it, or ``alpha < 0``. Its members share phi in proportion to their limits, so that they reach them
together, as they do when the group begins to slip. Components of one slip, as of a cylindrical joint, count with its
length: as members of one group they have one direction.

Where no bound depends on the reactions there is exactly one solution: that of a convex problem, found by exchanging the
first group that contradicts itself (Murty's least-index rule). Where bounds do depend on them, all combinations are
tried: none or several (Painleve's paradox, jamming) are refused, never chosen from. Beginning to slip is decided by the
friction at rest; only joints that slip have the friction of slip.

Of the share of a stuck group only ``|f_i| <= L_i(f)`` is known: limits depend on loads, and these on f. A quantity that
is linear in f is least and greatest at corners of this set: there all joints of a group but one are at their limits and
that one has the rest, and joints on laws or stops are at their limits, by the equation of slip with the law of rest. A
quantity that is not linear, such as the length of a force, may be less within the set than at its corners. Where the
corners are not known, frictions in all directions stand for them, which tell what depends on the share, and which way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from math import prod
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import one_sided
from pinarm.engine.friction.columns import Slip, SlipGroup
from pinarm.engine.friction.slip_equation import Slipping, SlipResponse
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.contact import sizes, unit_vectors
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.mechanics.friction.contact import FrictionContact

PARALLEL = 1e-9
"""Square of the sine between the free parts of two slips, in the measure of the masses, that rounding leaves."""

MARGIN = 1e-9
"""Part of its terms by which an acceleration may contradict its direction, and a friction exceed its bound."""

MANY = 6
"""Number of groups at rest up to which all 3^n combinations are tried."""

SETTLED, ITERATIONS = 1e-14, 400
"""Change of the limits by which joints share a load, relative to the largest; and steps towards them at most."""


def companions(response: SlipResponse, first: int) -> list[int]:
    """Return the slips that can only take place together with one, itself included; none of one that is driven."""
    mobility = response.mobility
    alike = mobility[first] ** 2 >= (1.0 - PARALLEL) * np.diag(mobility) * mobility[first, first]
    return [int(i) for i in np.flatnonzero(alike & ~response.driven & ~response.driven[first])]


def groups_of(contacts: Sequence[FrictionContact], response: SlipResponse, some: Sequence[int]) -> list[SlipGroup]:
    """Return the groups that some slips form, none of them driven."""
    mobility, groups, left = response.mobility, list[SlipGroup](), list(some)
    while left:
        first, together = left[0], companions(response, left[0])
        members = [i for i in left if i in together]
        left = [i for i in left if i not in together]
        ratios = np.zeros(len(contacts))
        ratios[members] = mobility[members, first] / mobility[first, first]
        groups.append(SlipGroup(ratios, unit_vectors(contacts, ratios)))
    _require_one_direction(contacts, groups)
    firsts = [group.first for group in groups]
    size = np.sqrt(np.diag(mobility)[firsts])
    if groups and np.linalg.eigvalsh(mobility[np.ix_(firsts, firsts)] / np.outer(size, size))[0] < PARALLEL:
        raise DynamicsError(
            f"{len(groups)} frictions at rest hold fewer motions: what each of them carries is not determined",
            expected="no more joints with friction at rest than the mechanism has motions, but for those that always "
            "move together",
        )
    return groups


def _require_one_direction(contacts: Sequence[FrictionContact], groups: Sequence[SlipGroup]) -> None:
    seen = set[str]()
    for group in groups:
        names = {contacts[i].name for i in group.members}
        for name in sorted(names & seen):
            raise DynamicsError(
                f"{name} is at rest and may begin to slip in more than one direction: friction that holds it there is "
                "not supported",
                expected="a mechanism in which it has one motion, or a motion that does not come to rest",
                hint="in place of its friction a force regularised_friction, or friction in joints with one motion",
            )
        seen |= names


def directions_of(groups: Sequence[SlipGroup], signs: Sequence[float], k: int) -> Array:
    """Return the directions of all k slips where the first one of each group has that of its sign, 0 of others."""
    return np.asarray(sum((group.units * sign for group, sign in zip(groups, signs, strict=True)), np.zeros(k)))


class FrictionSolution(NamedTuple):
    """Friction f of k joints in one state, and accelerations alpha of the slips, both of shape (k,).

    ``held`` is phi of every stuck group [N*m or N], ``bounds`` the most that it can be, both of shape (g,).
    """

    f: Array
    alpha: Array
    held: Array
    bounds: Array


class FrictionBalance(Record, frozen=True):
    """The laws of k joints and their response to friction in one state; ``speed`` is |u|, shape (k,)."""

    contacts: Sequence[FrictionContact]
    response: SlipResponse
    speed: Array

    def limits(self, f: Array) -> Array:
        """Return the largest friction at rest, under friction f [N*m or N], shape (k,)."""
        wrench = self.response.loads.at(f)
        return np.array(
            [
                mu * (contact.bearing.load(w) if mu else 0.0) + constant
                for contact, w in zip(self.contacts, wrench, strict=True)
                for mu, constant in [contact.law.resting]
            ]
        )

    def solve(
        self, direction: Array, stuck: Sequence[SlipGroup], resting: Flags, *, any_load: bool = False
    ) -> FrictionSolution | None:
        """Return the friction while some slips take place and some groups are stuck; ``None`` where there is none.

        Args:
            direction: Of joints that slip, 0 of others; see ``Slipping``, shape (k,).
            stuck: Groups that are stuck.
            resting: Which joints that slip have the friction of rest, as they only begin to, shape (k,).
            any_load: Whether there has to be exactly one for loads nearby as well.
        """
        whole = Slipping.of(self.contacts, direction, resting, self.speed, self.response.loads)

        def under(limits: Array) -> Array | None:
            fixed, ways = self._eliminated(direction, self._shares(limits, stuck), stuck)
            slipping = replace(whole, loads=whole.loads.reduced(fixed, ways))
            has_root = slipping.require_one_root(any_load=any_load)
            return fixed + ways @ slipping.friction() if has_root else None

        f, limits = self._shared(under, stuck)
        if f is None:
            return None
        held = np.array([group.ratios @ f for group in stuck])
        bounds = np.array([(group.ratios * group.units) @ limits for group in stuck])
        return FrictionSolution(f, self.response.at(f), held, bounds)

    def _shared(self, under: Callable[[Array], Array | None], stuck: Sequence[SlipGroup]) -> tuple[Array | None, Array]:
        """Return friction whose groups share in proportion to limits, and these limits, which depend on the friction.

        Groups that are held by more than their limits count with these, with which they break loose.
        """
        several, limits = any(len(group.members) > 1 for group in stuck), np.zeros(len(self.contacts))
        if not stuck:
            return under(limits), limits
        limits = self.limits(limits) if several else limits
        for _ in range(ITERATIONS):
            f = under(limits)
            if f is None:
                return None, limits
            before, within = limits, f.copy()
            for group in (group for group in stuck if len(group.members) > 1):
                phi, bound = abs(float(group.ratios @ f)), float((group.ratios * group.units) @ limits)
                within[list(group.members)] *= min(1.0, bound / phi) if phi else 1.0
            limits = self.limits(within)
            if not several or np.abs(limits - before).max() <= SETTLED * np.abs(limits).max():
                return f, limits
        names = dict.fromkeys(self.contacts[i].name for group in stuck for i in group.members)
        raise DynamicsError(
            f"how {', '.join(names)} share the friction that holds them is not found: their limits depend on what they "
            "carry, and what they carry on how they share it",
            expected="friction that raises its load less than once",
            hint="a smaller mu, or friction without a load: constant",
        )

    def _eliminated(self, direction: Array, shares: Array, stuck: Sequence[SlipGroup]) -> tuple[Array, Array]:
        """Return friction as ``fixed + response x`` of that x of slipping joints, stuck ones not accelerating."""
        own, first = np.diag((direction != 0.0).astype(float)), [group.first for group in stuck]
        if not stuck:
            return np.zeros(len(direction)), own
        rows = self.response.mobility[first]
        back = shares @ np.linalg.inv(rows @ shares)
        return -back @ self.response.acceleration[first], own - back @ rows @ own

    def _shares(self, limits: Array, stuck: Sequence[SlipGroup]) -> Array:
        """Return the friction of all joints for ``phi = 1`` of each stuck group, shape (k, g)."""
        shares = np.zeros((len(self.contacts), len(stuck)))
        for g, group in enumerate(stuck):
            own = [contact.name == self.contacts[group.first].name for contact in self.contacts]
            shared = group.units * (limits if (group.units * limits).any() else own)
            shares[:, g] = shared / (group.ratios @ shared)
        return shares


def decided(balance: FrictionBalance, moving: Array, broken: Array, yielding: Array | float = 0.0) -> Slip:
    """Return the slipping joints and the stuck groups from a state on.

    Args:
        balance: The state.
        moving: Directions of the joints that slip, 0 of those at rest, shape (k,).
        broken: Directions of joints at rest that begin to slip in any case, 0 of others, shape (k,).
        yielding: Directions of joints whose friction is at its bound, 0 of others, shape (k,): they begin to slip
            unless others that begin to slip relieve them.
    """
    contacts, resting, alpha = balance.contacts, sizes(balance.contacts, moving) == 0.0, balance.response.acceleration
    driven = balance.response.driven & resting
    begun = np.where(np.abs(alpha) > MARGIN * np.abs(alpha).max(initial=0.0), alpha, 0.0)
    given = moving + unit_vectors(contacts, np.where(driven, begun, 0.0))
    groups = groups_of(contacts, balance.response, np.flatnonzero(resting & ~driven).tolist())
    _require_rest(contacts, given, groups)
    decision = _Decision(balance, given, groups)
    certain, start = (
        [int(np.sign(ways @ group.ratios)) for group in groups]
        for ways in (broken, np.where(broken != 0.0, broken, yielding))
    )
    signs = decision.exchanged(start, certain, slips=any(start))
    if not any(start):
        decision.require_one(signs)
    while (kinetic := decision.exchanged(signs, signs, slips=True)) != signs:
        signs = kinetic
    stuck = tuple(group for group, sign in zip(groups, signs, strict=True) if not sign)
    return Slip(tuple(decision.direction(signs).tolist()), stuck)


def _require_rest(contacts: Sequence[FrictionContact], given: Array, groups: Sequence[SlipGroup]) -> None:
    """Raise where one component of a slip is set in motion by laws or constraints, and another one is free."""
    begun = sizes(contacts, given) > 0.0
    for i in (i for group in groups for i in group.members if begun[i]):
        raise DynamicsError(
            f"{contacts[i].name} begins to slip in a direction that depends on its friction: this is not supported",
            expected="a start at which it moves, or a law for all of its motion",
        )


class _Decision(Record, frozen=True):
    """The g groups at rest in one state; signs are 0 of stuck groups, and else the direction of their first member.

    ``given`` are the directions of all other joints, shape (k,).
    """

    balance: FrictionBalance
    given: Array
    groups: Sequence[SlipGroup]

    def direction(self, signs: Sequence[int]) -> Array:
        return np.asarray(self.given + directions_of(self.groups, signs, len(self.given)))

    def wanted(self, signs: Sequence[int], *, slips: bool) -> tuple[FrictionSolution | None, list[int]]:
        """Return the friction, and by group the sign that it ought to have where it contradicts itself."""
        resting: Flags = (self.given == 0.0) & (not slips)
        stuck = [group for group, sign in zip(self.groups, signs, strict=True) if not sign]
        solution, response = self.balance.solve(self.direction(signs), stuck, resting), self.balance.response
        wanted = list(signs)
        if solution is None:
            return None, wanted
        over = iter(np.where(np.abs(solution.held) > solution.bounds * (1.0 + MARGIN), np.sign(solution.held), 0.0))
        terms = np.abs(response.acceleration) + np.abs(response.mobility) @ np.abs(solution.f)
        for g, (group, sign) in enumerate(zip(self.groups, signs, strict=True)):
            if not sign:
                wanted[g] = -int(next(over))
            elif sign * solution.alpha[group.first] < -MARGIN * terms[group.first]:
                wanted[g] = 0
        return solution, wanted

    def exchanged(self, signs: Sequence[int], frozen: Sequence[int], *, slips: bool) -> list[int]:
        """Return signs that do not contradict themselves, reached by exchanging the first that does."""
        now = list(signs)
        for _ in range(50 * (1 + frozen.count(0))):
            solution, wanted = self.wanted(now, slips=slips)
            changed = [g for g, sign in enumerate(wanted) if sign != now[g]]
            if solution is None or any(frozen[g] for g in changed):
                break
            if not changed:
                return now
            now[changed[0]] = wanted[changed[0]]
        return self._searched(signs, frozen, slips=slips)

    def _searched(self, signs: Sequence[int], frozen: Sequence[int], *, slips: bool) -> list[int]:
        """Return the only signs that do not contradict themselves, of all combinations."""
        choices = [[sign] if kept else [0, 1, -1] for kept, sign in zip(frozen, signs, strict=True)]
        if frozen.count(0) > MANY:
            raise self._refusal("no", "found among those that were tried")
        consistent = self._consistent(choices, slips=slips)
        if len(consistent) != 1:
            raise self._refusal("no" if not consistent else str(len(consistent)), "possible")
        return consistent[0][0]

    def _consistent(self, choices: Sequence[list[int]], *, slips: bool) -> list[tuple[list[int], FrictionSolution]]:
        every = ((list(signs), *self.wanted(signs, slips=slips)) for signs in product(*choices))
        return [(signs, solution) for signs, solution, wanted in every if solution is not None and wanted == signs]

    def require_one(self, signs: Sequence[int]) -> None:
        """Raise where other signs give another motion, bounds depending on reactions, or too many would be tried."""
        loads, contacts = self.balance.response.loads, self.balance.contacts
        if not any(contact.law.loaded and loads.most(i, contact.bearing).any() for i, contact in enumerate(contacts)):
            return
        if len(self.groups) > MANY:
            raise self._refusal(
                "that only one motion", f"shown possible, {len(self.groups)} joints being at rest at once"
            )
        own, _ = self.wanted(signs, slips=False)
        assert own is not None
        scale = max(np.abs(self.balance.response.acceleration).max(initial=0.0), np.abs(own.alpha).max())
        for _, other in self._consistent([[0, 1, -1]] * len(self.groups), slips=False):
            if np.abs(other.alpha - own.alpha).max() > 1e-6 * scale:
                raise self._refusal("several", "possible")

    def _refusal(self, count: str, possible: str) -> DynamicsError:
        names = [contact.name for contact in self.balance.contacts]
        resting = ", ".join(dict.fromkeys(names[i] for group in self.groups for i in group.members))
        sliding = " and ".join(dict.fromkeys(names[int(i)] for i in np.flatnonzero(self.given)))
        ways = f"ways in which {resting} stick or begin to slip are" if resting else f"motion with slip of {sliding} is"
        return DynamicsError(
            f"{count} {ways} {possible}: rigid bodies with friction do not determine the motion",
            expected="exactly one",
            hint="a smaller mu, a longer span of a guide, or friction without a load: constant",
        )


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
    of = np.array([contact.name for contact in balance.contacts])
    names = dict.fromkeys(of[list(group.members)].tolist())
    for free in names:
        rest = group.ratios * (of == free)
        lead = rest[np.flatnonzero(rest)[0]]
        remaining = SlipGroup(rest / lead, group.units * (of == free) * np.sign(lead))
        others = [name for name in names if name != free]
        for signs in product([1.0, -1.0], repeat=len(others)):
            sign = dict(zip(others, signs, strict=True))
            yield remaining, {i: group.units[i] * sign[of[i]] for i in group.members if of[i] != free}


def _exchanges(balance: FrictionBalance, group: SlipGroup) -> Iterator[Array]:
    """Yield the friction that the first joint of a group takes over from each other one, 1 in all, shape (k,)."""
    of, weights = np.array([contact.name for contact in balance.contacts]), group.ratios * group.units
    first, *others = dict.fromkeys(of[list(group.members)].tolist())
    for other in others:
        one, two = of == first, of == other
        yield (one / weights[one].sum() - two / weights[two].sum()) * group.units


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
