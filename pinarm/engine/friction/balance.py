"""Friction in one state: of joints that slip, and of joints that are stuck, whose friction is what keeps them so.

Joints that can only move together, such as the pins of a four-bar linkage or a finger and one that mimics it, form a
group with one slip: the rows of its members are multiples c_i of the first. Only the sum ``phi = sum_i c_i f_i`` of a
group that is stuck is determined. It is stuck as long as ``|phi| <= sum_i |c_i| limit_i``; its members share phi in
proportion to their limits, so that they reach them together, as they do when the group begins to slip. Components
of one slip, as of a cylindrical joint, count with its length: as members of one group they have one direction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.friction.response import SlipResponse
from pinarm.engine.friction.slipping import Slipping
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.slip_vectors import unit_vectors

if TYPE_CHECKING:
    from pinarm.mechanics.friction.contact import FrictionContact

PARALLEL = 1e-9
"""Square of the sine between the free parts of two slips, in the measure of the masses, that rounding leaves."""


@dataclass(frozen=True, eq=False)
class SlipGroup:
    """Slips that can only take place together.

    Attributes:
        members: Their indices, the first stands for all; shape (m,).
        ratios: c, slips of the members per slip of the first, shape (m,).
        units: Directions of the members as the first one slips forwards: 1 or -1, or components of a unit vector, (m,).
    """

    members: tuple[int, ...]
    ratios: Array
    units: Array

    @property
    def first(self) -> int:
        """Index of the slip that stands for all."""
        return self.members[0]

    def directions(self, sign: float, k: int) -> Array:
        """Return the directions of all k slips where the first one has that of ``sign``; 0 of others, shape (k,)."""
        directions = np.zeros(k)
        directions[list(self.members)] = self.units * sign
        return directions


def companions(response: SlipResponse, first: int) -> list[int]:
    """Return the slips that can only take place together with one, itself included; none of one that is driven."""
    mobility = response.mobility
    alike = mobility[first] ** 2 >= (1.0 - PARALLEL) * np.diag(mobility) * mobility[first, first]
    return [int(i) for i in np.flatnonzero(alike & ~response.driven & ~response.driven[first])]


def groups_of(contacts: Sequence[FrictionContact], response: SlipResponse, some: Sequence[int]) -> list[SlipGroup]:
    """Return the groups that some slips form, none of them driven.

    Raises:
        DynamicsError: Groups are not independent: friction would hold a motion in more ways than it has. Or a slip with
            several components can begin in more than one direction.
    """
    mobility, groups = response.mobility, list[SlipGroup]()
    left = list(some)
    while left:
        first, together = left[0], companions(response, left[0])
        members = [i for i in left if i in together]
        left = [i for i in left if i not in together]
        ratios = np.zeros(len(contacts))
        ratios[members] = mobility[members, first] / mobility[first, first]
        groups.append(SlipGroup(tuple(members), ratios[members], unit_vectors(contacts, ratios)[members]))
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
    """Raise where components of one slip are in different groups.

    Raises:
        DynamicsError: Says which joint's.
    """
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


@dataclass(frozen=True, eq=False)
class FrictionBalance:
    """The laws of k joints and what friction does in one state.

    Attributes:
        contacts: The joints.
        response: What friction does.
        speed: |u| [rad/s or m/s], of slips with several components their length, shape (k,).
    """

    contacts: Sequence[FrictionContact]
    response: SlipResponse
    speed: Array

    def limits(self, f: Array) -> Array:
        """Return the largest friction at rest, under friction f [N*m or N], shape (k,)."""
        wrench = self.response.loads.at(f)
        return np.array([mu * (contact.bearing.load(w) if mu else 0.0) + constant
                         for contact, w in zip(self.contacts, wrench, strict=True)
                         for mu, constant in [contact.law.resting]])  # fmt: skip

    def solve(self, direction: Array, stuck: Sequence[SlipGroup], resting: Flags) -> FrictionSolution | None:
        """Return the friction in this state; see ``solve_under_any_load``, which needs one under other loads, too."""
        return self._solution(direction, stuck, resting, Slipping.require_one_root_here)

    def solve_under_any_load(
        self, direction: Array, stuck: Sequence[SlipGroup], resting: Flags
    ) -> FrictionSolution | None:
        """Return the friction while some slips take place and some groups are stuck; ``None`` where there is none.

        Args:
            direction: Of joints that slip, 0 of others; see ``Slipping``, shape (k,).
            stuck: Groups that are stuck.
            resting: Which joints that slip have the friction of rest, as they only begin to, shape (k,).

        Raises:
            DynamicsError: There is more than one solution, or it is not known that there is only one.
        """
        return self._solution(direction, stuck, resting, Slipping.require_one_root)

    def _solution(
        self, direction: Array, stuck: Sequence[SlipGroup], resting: Flags, has_root: Callable[[Slipping], bool]
    ) -> FrictionSolution | None:
        mu, constant = np.array([contact.law.resting if rest else contact.law.slipping(speed) for contact, rest, speed
                                 in zip(self.contacts, resting, self.speed, strict=True)]).reshape(-1, 2).T  # fmt: skip
        slips = (direction != 0.0).astype(float)
        limits = self._shared_limits(direction, mu * slips, constant * slips, stuck)
        fixed, response = self._eliminated(slips, self._shares(limits, stuck), stuck)
        loads = self.response.loads.reduced(fixed, response)
        slipping = Slipping(self.contacts, direction, mu * slips, constant * slips, loads)
        if not has_root(slipping):
            return None
        f = fixed + response @ slipping.friction()
        held = np.array([group.ratios @ f[list(group.members)] for group in stuck])
        most = self.limits(f) if limits is None else limits
        bounds = np.array([(group.ratios * group.units) @ most[list(group.members)] for group in stuck])
        return FrictionSolution(f, self.response.at(f), held, bounds)

    def _shared_limits(self, direction: Array, mu: Array, constant: Array, stuck: Sequence[SlipGroup]) -> Array | None:
        """Return the limits by which the members of groups share, shape (k,); ``None`` where each has one member."""
        if all(len(group.members) == 1 for group in stuck):
            return None
        from pinarm.engine.friction.sharing import SharedFriction

        members = [i for group in stuck if len(group.members) > 1 for i in group.members]
        if self.response.loads.constant:
            return self.limits(np.zeros(len(mu)))
        mu, constant = mu.copy(), constant.copy()
        mu[members], constant[members] = np.array([self.contacts[i].law.resting for i in members]).T
        return self.limits(SharedFriction(self.contacts, self.response, stuck, direction, mu, constant).solve())

    def _eliminated(self, slips: Array, shares: Array, stuck: Sequence[SlipGroup]) -> tuple[Array, Array]:
        """Return friction as ``fixed + response x`` of that x of slipping joints, stuck ones not accelerating."""
        own = np.diag(slips)
        if not stuck:
            return np.zeros(len(slips)), own
        rows, back = self.response.mobility[[group.first for group in stuck]], self._back(shares, stuck)
        return -back @ self.response.acceleration[[group.first for group in stuck]], own - back @ rows @ own

    def _back(self, shares: Array, stuck: Sequence[SlipGroup]) -> Array:
        """Return the friction that undoes accelerations of the stuck groups, shape (k, g)."""
        return np.asarray(shares @ np.linalg.inv(self.response.mobility[[group.first for group in stuck]] @ shares))

    def back(self, stuck: Sequence[SlipGroup]) -> Array:
        """Return the same where limits do not depend on loads, or each group has one member."""
        limits = None if all(len(group.members) == 1 for group in stuck) else self.limits(np.zeros(len(self.contacts)))
        return self._back(self._shares(limits, stuck), stuck)

    def stuck_alone(self, stuck: Sequence[SlipGroup], alpha: Array, carried: Array) -> tuple[Array, Array]:
        """Return phi of groups of one member each while nothing slips, and the most that it can be, shape (n, g).

        Args:
            stuck: The groups.
            alpha: Accelerations of the slips without friction at n instants of this state, shape (n, k).
            carried: What bearings carry without friction, shape (n, k, 6).
        """
        some = [group.first for group in stuck]
        f = -alpha[:, some] @ self.back(stuck).T
        wrenches = carried + np.einsum("nj,kjc->nkc", f, self.response.loads.response)
        laws = [(self.contacts[i], *self.contacts[i].law.resting) for i in some]
        limits = [mu * (contact.bearing.load(wrenches[:, i]) if mu else 0.0) + constant
                  for i, (contact, mu, constant) in zip(some, laws, strict=True)]  # fmt: skip
        return f[:, some], np.array([np.broadcast_to(limit, len(f)) for limit in limits]).T

    def _shares(self, limits: Array | None, stuck: Sequence[SlipGroup]) -> Array:
        """Return the friction of all joints for ``phi = 1`` of each stuck group, shape (k, g)."""
        shares = np.zeros((len(self.contacts), len(stuck)))
        for g, group in enumerate(stuck):
            members = list(group.members)
            own = [self.contacts[i].name == self.contacts[group.first].name for i in members]
            shared = group.units * (limits[members] if limits is not None and limits[members].any() else own)
            shares[members, g] = shared / (group.ratios @ shared)
        return shares


@dataclass(frozen=True, eq=False)
class FrictionSolution:
    """Friction in one state, and what follows from it.

    Attributes:
        f: Friction [N*m or N], shape (k,).
        alpha: Accelerations of the slips [rad/s^2 or m/s^2], shape (k,).
        held: phi of every stuck group [N*m or N], shape (g,).
        bounds: The most that it can be, shape (g,).
    """

    f: Array
    alpha: Array
    held: Array
    bounds: Array
