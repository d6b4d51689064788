"""Which joints stick and which begin to slip, where some are at rest: a complementarity problem.

Every group of joints at rest is stuck, with ``|phi| <= bound``, or begins to slip, ``alpha > 0`` with friction against
it, or ``alpha < 0``. Where no bound depends on the reactions there is exactly one solution: that of a convex problem,
found by exchanging the first group that contradicts itself (Murty's least-index rule). Where bounds do depend on them,
all combinations are tried: none or several (Painleve's paradox, jamming) are refused, never chosen from. Beginning to
slip is decided by the friction at rest; only what slips has the friction of slip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.friction.balance import FrictionBalance, FrictionSolution, SlipGroup, groups_of
from pinarm.engine.friction.slip import Slip
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.contact import FrictionContact
from pinarm.mechanics.friction.slip_vectors import sizes, unit_vectors

MARGIN = 1e-9
"""Part of its terms by which an acceleration may contradict its direction, and a friction exceed its bound."""

MANY = 6
"""Number of groups at rest up to which all 3^n combinations are tried."""


def decided(balance: FrictionBalance, moving: Array, broken: Array, yielding: Array | float = 0.0) -> Slip:
    """Return what joints at rest begin to do.

    Args:
        balance: The state.
        moving: Directions of the joints that slip, 0 of those at rest, shape (k,).
        broken: Directions of joints at rest that begin to slip in any case, 0 of others, shape (k,).
        yielding: Those of joints whose friction is at its bound, 0 of others, shape (k,): they begin to slip unless the
            others that do so relieve them.

    Raises:
        DynamicsError: There is no solution, or more than one.
    """
    contacts, resting = balance.contacts, sizes(balance.contacts, moving) == 0.0
    driven = balance.response.driven & resting
    given = moving + unit_vectors(contacts, np.where(driven, _significant(balance.response.acceleration), 0.0))
    groups = groups_of(contacts, balance.response, np.flatnonzero(resting & ~driven).tolist())
    _require_rest(contacts, given, groups)
    decision = _Decision(balance, given, groups)
    certain, start = ([int(np.sign(given[list(group.members)] @ group.ratios)) for group in groups]
                      for given in (broken, np.where(broken != 0.0, broken, yielding)))  # fmt: skip
    signs = decision.exchanged(start, frozen=[g for g, sign in enumerate(certain) if sign], slips=any(start))
    if not any(start):
        decision.require_one(signs)
    while (kinetic := decision.exchanged(signs, frozen=[g for g, s in enumerate(signs) if s], slips=True)) != signs:
        signs = kinetic
    direction = decision.direction(signs)
    stuck = tuple(group for group, sign in zip(groups, signs, strict=True) if not sign)
    return Slip(tuple(direction.tolist()), stuck)


def _significant(alpha: Array) -> Array:
    return np.where(np.abs(alpha) > MARGIN * np.abs(alpha).max(initial=0.0), alpha, 0.0)


def _require_rest(contacts: Sequence[FrictionContact], given: Array, groups: Sequence[SlipGroup]) -> None:
    """Raise where one component of a slip is set in motion by laws or constraints, and another one is free.

    Raises:
        DynamicsError: Says which joint's.
    """
    begun = sizes(contacts, given) > 0.0
    for i in (i for group in groups for i in group.members if begun[i]):
        raise DynamicsError(
            f"{contacts[i].name} begins to slip in a direction that depends on its friction: this is not supported",
            expected="a start at which it moves, or a law for all of its motion",
        )


@dataclass(frozen=True, eq=False)
class _Decision:
    """The groups at rest in one state; signs are 0 of stuck groups, and else the direction of their first member.

    Attributes:
        balance: The state.
        given: Directions of all other joints, shape (k,).
        groups: The g groups.
    """

    balance: FrictionBalance
    given: Array
    groups: Sequence[SlipGroup]

    def direction(self, signs: Sequence[int]) -> Array:
        """Return the directions of all joints, shape (k,)."""
        parts = (group.directions(sign, len(self.given)) for group, sign in zip(self.groups, signs, strict=True))
        return np.asarray(sum(parts, self.given))

    def solution(self, signs: Sequence[int], *, slips: bool) -> FrictionSolution | None:
        """Return the friction, that of slip or that of rest where slip begins."""
        resting: Flags = (self.given == 0.0) & (not slips)
        stuck = [group for group, sign in zip(self.groups, signs, strict=True) if not sign]
        return self.balance.solve(self.direction(signs), stuck, resting)

    def wrong(self, signs: Sequence[int], solution: FrictionSolution) -> list[int]:
        """Return by group the sign that it ought to have where it contradicts itself, and its own elsewhere."""
        response, wanted, stuck = (
            self.balance.response,
            list(signs),
            iter(zip(solution.held, solution.bounds, strict=True)),
        )
        terms = np.abs(response.acceleration) + np.abs(response.mobility) @ np.abs(solution.f)
        for g, (group, sign) in enumerate(zip(self.groups, signs, strict=True)):
            if not sign:
                held, bound = next(stuck)
                if abs(held) > bound * (1.0 + MARGIN):
                    wanted[g] = -int(np.sign(held))
            elif sign * solution.alpha[group.first] < -MARGIN * terms[group.first]:
                wanted[g] = 0
        return wanted

    def exchanged(self, signs: Sequence[int], frozen: Sequence[int], *, slips: bool = False) -> list[int]:
        """Return signs that do not contradict themselves, reached by exchanging the first that does.

        Raises:
            DynamicsError: None are reached.
        """
        now, free = list(signs), [g for g in range(len(self.groups)) if g not in frozen]
        for _ in range(50 * (1 + len(free))):
            solution = self.solution(now, slips=slips)
            wanted = now if solution is None else self.wrong(now, solution)
            changed = [g for g in free if wanted[g] != now[g]]
            if solution is None or any(wanted[g] != now[g] for g in frozen):
                break
            if not changed:
                return now
            now[changed[0]] = wanted[changed[0]]
        return self._searched(signs, frozen, slips=slips)

    def _searched(self, signs: Sequence[int], frozen: Sequence[int], *, slips: bool) -> list[int]:
        """Return the only signs that do not contradict themselves, of all combinations."""
        choices = [[sign] if g in frozen else [0, 1, -1] for g, sign in enumerate(signs)]
        if sum(len(choice) > 1 for choice in choices) > MANY:
            raise self._refusal("no", "found among those that were tried")
        consistent = [choice for choice in product(*choices) if self._is_consistent(choice, slips=slips)]
        if len(consistent) != 1:
            raise self._refusal("no" if not consistent else str(len(consistent)), "possible")
        return list(consistent[0])

    def _is_consistent(self, signs: Sequence[int], *, slips: bool = False) -> bool:
        solution = self.solution(signs, slips=slips)
        return solution is not None and self.wrong(signs, solution) == list(signs)

    def require_one(self, signs: Sequence[int]) -> None:
        """Raise where other signs give another motion, bounds depending on reactions.

        Raises:
            DynamicsError: Some do, or there are too many to be tried.
        """
        loads, contacts = self.balance.response.loads, self.balance.contacts
        if not any(contact.law.loaded and loads.most(i, contact.bearing).any() for i, contact in enumerate(contacts)):
            return
        if len(self.groups) > MANY:
            raise self._refusal(
                "that only one motion", f"shown possible, {len(self.groups)} joints being at rest at once"
            )
        own = self.solution(signs, slips=False)
        assert own is not None
        scale = np.abs(self.balance.response.acceleration).max(initial=0.0)
        for other in product([0, 1, -1], repeat=len(self.groups)):
            solution = self.solution(other, slips=False)
            if solution is None or self.wrong(other, solution) != list(other):
                continue
            if np.abs(solution.alpha - own.alpha).max() > 1e-6 * max(scale, np.abs(own.alpha).max()):
                raise self._refusal("several", "possible")

    def _refusal(self, count: str, possible: str) -> DynamicsError:
        names = [contact.name for contact in self.balance.contacts]
        resting = ", ".join(dict.fromkeys(names[i] for group in self.groups for i in group.members))
        sliding = " and ".join(dict.fromkeys(names[int(i)] for i in np.flatnonzero(self.given)))
        ways = f"ways in which {resting} stick or begin to slip are" if resting else f"motion with slip of {sliding} is"
        return DynamicsError(
            f"{count} {ways} {possible}: rigid bodies with friction do not determine the motion",
            expected="exactly one", hint="a smaller mu, a longer span of a guide, or friction without a load: constant",
        )  # fmt: skip
