"""Friction in states whose efforts are given: which joints stick is decided in each by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.complementarity import FrictionBalance, decided
from pinarm.engine.friction.extremes import Extremes, extreme_frictions, filled
from pinarm.engine.friction.response import SlipEquation
from pinarm.errors import DynamicsError
from pinarm.mechanics.friction.contact import FrictionContact, several, sizes, slip_rows, unit_vectors

NOTHING = np.zeros(0)


def friction_under(
    contacts: Sequence[FrictionContact], dynamics: Dynamics, closure: Closure, t: float, q: Array, v: Array, tau: Array
) -> tuple[Array, list[tuple[Array, Flags]]]:
    """Return the friction of k joints under efforts of drives, shape (n, k) [N*m or N], and others that hold as well.

    These are the extremes of shares of joints at rest; see ``extreme_frictions`` and ``filled``. States q and v and
    efforts have the shapes (n, nq), (n, nv) and (n, nv); ``dynamics`` is without this friction.
    """
    if not closure.size and (simple := _in_tree(contacts, dynamics, t, q, v, tau)) is not None:
        return simple, []
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
            raise DynamicsError(
                f"friction of {names} raises the load that it depends on without end: it jams",
                expected="a smaller mu, or a longer span of the guide",
            )
        friction[i] = solution.f
        extremes.append(extreme_frictions(balance, direction, slip.stuck, solution.f))
    return friction, filled(friction, extremes)


def _in_tree(
    contacts: Sequence[FrictionContact], dynamics: Dynamics, t: float, q: Array, v: Array, tau: Array
) -> Array | None:
    """Return the friction of joints of a tree that no load changes, shape (n, k), where all slip or all stick."""
    if any(contact.law.loaded or not isinstance(contact.of, int) for contact in contacts) or several(contacts).any():
        return None
    rows = slip_rows(dynamics.model, contacts, q)
    slips = np.matvec(rows, v)
    laws = [contact.law.slipping(speed)[1] for contact, speed in zip(contacts, np.abs(slips).T, strict=True)]
    friction = np.asarray(-np.sign(slips) * np.array(laws).T)
    limits = np.array([contact.law.static_constant for contact in contacts])
    if slips.all() or not limits.any():
        return friction
    held = np.matvec(rows, dynamics.inverse(t, q, v, np.zeros_like(v)) - tau)
    sticks = (v == 0.0).all(axis=1) & (np.abs(held) <= limits).all(axis=1) & (len(contacts) == v.shape[1])
    simple = (sticks | slips.all(axis=1)).all()
    return np.asarray(np.where(sticks[:, None], held, friction)) if simple else None
