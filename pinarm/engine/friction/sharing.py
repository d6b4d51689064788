"""How joints that friction holds together share what it holds, where the limits depend on what they carry.

The members i of a group are taken to share in proportion to their limits at rest, ``f_i = sigma u_i L_i(f)``, with
``|sigma| <= 1``; u_i is the direction of member i as the first one slips forwards. Sigma is such that the group does
not accelerate. Where even ``|sigma| = 1`` does not hold the group, that is what the limits are told for: the group then
breaks loose with these. With the frictions of joints that slip, ``f_i = - s_i R_i(f)``, and of groups of one member,
these are as many equations as unknowns f and sigma:

    f_i - e_i R_i(f) = 0,    alpha_g(f) = 0  or  sigma_g = +-1        (1)

Solved by Newton's method; which of the two equations of a group counts is told by ``sigma - rho / b``, with the rest
``rho = alpha / A`` and the limit b of the group (Hintermueller, Ito, Kunisch, The primal-dual active set strategy as a
semismooth Newton method, SIAM J. Optim. 13 (2003), 865-888).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import DynamicsError

if TYPE_CHECKING:
    from pinarm.engine.friction.balance import SlipGroup
    from pinarm.engine.friction.response import SlipResponse
    from pinarm.mechanics.friction.contact import FrictionContact

SETTLED, ITERATIONS = 1e-13, 60
"""Change of f in a step of Newton's method, relative to f, after which it has converged; and its steps at most."""


@dataclass(frozen=True, eq=False)
class SharedFriction:
    """The equations (1) in one state.

    Attributes:
        contacts: The k joints.
        response: What friction does.
        groups: The g groups that are stuck.
        direction: Of joints that slip, 0 of others, shape (k,).
        mu: Of joints that slip those of slip, of stuck ones those at rest, 0 of others, shape (k,).
        constant: Likewise [N*m or N], shape (k,).
    """

    contacts: Sequence[FrictionContact]
    response: SlipResponse
    groups: Sequence[SlipGroup]
    direction: Array = field(repr=False)
    mu: Array = field(repr=False)
    constant: Array = field(repr=False)

    def solve(self) -> Array:
        """Return f, shape (k,).

        Raises:
            DynamicsError: Newton's method does not find it.
        """
        f, sigma = np.zeros(len(self.mu)), np.zeros(len(self.groups))
        for _ in range(ITERATIONS):
            matrix, rest = self._linearised(f, sigma)
            try:
                step = np.linalg.solve(matrix, -rest)
            except np.linalg.LinAlgError:
                break
            f, sigma = f + step[: len(f)], sigma + step[len(f) :]
            if np.abs(step[: len(f)]).max() <= SETTLED * np.abs(f).max():
                return f
        names = dict.fromkeys(self.contacts[i].name for group in self.groups for i in group.members)
        raise DynamicsError(
            f"how {', '.join(names)} share the friction that holds them is not found: their limits depend on what they "
            "carry, and what they carry on how they share it",
            expected="friction that raises its load less than once",
            hint="a smaller mu, or friction without a load: constant",
        )

    def _linearised(self, f: Array, sigma: Array) -> tuple[Array, Array]:
        """Return the derivative of (1), shape (k + g, k + g), and what it leaves, shape (k + g,)."""
        k, loads = len(f), self.response.loads
        wrench, response, factor = loads.at(f), loads.slope(f), -self.direction
        limit = self.constant.copy()
        matrix = np.eye(k + len(sigma))
        for group, share in zip(self.groups, sigma, strict=True):
            factor[list(group.members)] = share * group.units if len(group.members) > 1 else 0.0
        for i in np.flatnonzero(self.mu).tolist():
            bearing = self.contacts[i].bearing
            limit[i] += self.mu[i] * bearing.load(wrench[i])
            matrix[i, :k] -= factor[i] * self.mu[i] * response[i] @ bearing.slope(wrench[i])
        rest = np.concatenate([f - factor * limit, sigma])
        for g, group in enumerate(self.groups):
            self._add_group(k + g, group, f, sigma[g], limit, matrix, rest)
        return matrix, rest

    def _add_group(
        self, row: int, group: SlipGroup, f: Array, sigma: float, limit: Array, matrix: Array, rest: Array
    ) -> None:
        members, (mobility, k) = list(group.members), (self.response.mobility[group.first], len(f))
        single = len(members) == 1
        bound = 1.0 if single else float((group.ratios * group.units) @ limit[members])
        matrix[members, row] = -1.0 if single else -group.units * limit[members]
        if single:
            rest[members] = f[members] - sigma
        left = (self.response.acceleration[group.first] + mobility @ f) / mobility[group.first]
        wanted = sigma - left / max(bound, np.finfo(float).tiny)
        if single or abs(wanted) < 1.0:
            matrix[row], rest[row] = 0.0, left
            matrix[row, :k] = mobility / mobility[group.first]
        else:
            rest[row] = sigma - np.sign(wanted)
