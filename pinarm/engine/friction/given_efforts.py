"""Friction in states whose efforts are given: which joints stick is decided in each by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.balance import FrictionBalance
from pinarm.engine.friction.extremes import Extremes, extreme_frictions, filled
from pinarm.engine.friction.response import SlipEquation
from pinarm.engine.friction.switching import decided
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.contact import FrictionContact, slip_rows
from pinarm.mechanics.friction.slip_vectors import sizes, unit_vectors

NOTHING = np.zeros(0)


def friction_under(
    contacts: Sequence[FrictionContact], dynamics: Dynamics, closure: Closure, t: float, q: Array, v: Array, tau: Array
) -> tuple[Array, list[tuple[Array, Flags]]]:
    """Return the friction of k joints under efforts, shape (n, k) [N*m or N], and others that hold as well.

    These are the extremes of what several joints at rest share; see ``extreme_frictions`` and ``filled``.

    Args:
        contacts: The joints.
        dynamics: Masses, weights and loads, without this friction.
        closure: The constraints.
        t: Instant [s].
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        tau: Efforts of the drives [N*m or N], shape (n, nv).

    Raises:
        DynamicsError: Rigid bodies with friction do not determine it.
    """
    friction, extremes = np.zeros((len(q), len(contacts))), list[Extremes]()
    slips = np.matvec(slip_rows(closure.model, contacts, q), v)
    speeds = sizes(contacts, slips)
    for i, moving in enumerate(unit_vectors(contacts, slips)):
        equation = SlipEquation(contacts, closure, dynamics, lambda t: (NOTHING, NOTHING, NOTHING), tau[i])
        equation.require_determined(q[i])
        balance = FrictionBalance(contacts, equation.at(t, q[i], v[i]), speeds[i])
        slip = decided(balance, moving, np.zeros(len(contacts)))
        direction = np.array(slip.direction, float)
        solution = balance.solve(direction, slip.stuck, np.zeros(len(contacts), dtype=bool))
        if solution is None:
            names = ", ".join(dict.fromkeys(contact.name for contact in contacts))
            raise DynamicsError(f"friction of {names} raises the load that it depends on without end: it jams",
                                expected="a smaller mu, or a longer span of the guide")  # fmt: skip
        friction[i] = solution.f
        extremes.append(extreme_frictions(balance, direction, slip.stuck, solution.f))
    return friction, filled(friction, extremes)
