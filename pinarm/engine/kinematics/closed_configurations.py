"""Closed configurations of no special kind: mobility of a mechanism, and the number of laws that it needs.

The rank of G is the same at nearly all configurations of a branch, and smaller at singular positions, such as a linkage
folded flat. The zero position of a model may be open, or singular.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.kinematics.assembly import closed_drawing
from pinarm.engine.kinematics.newton import assembled, start_configuration
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.errors import AssemblyError

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.mechanics.laws.motion_law import MotionLaw

BESIDE, STEP = 4, 0.2
"""Number of closed configurations that are compared with the first one, and how far each is from the one before
[rad, or units of length]."""

GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
"""Its multiples, but for whole numbers, are spread evenly over 0 to 1 and never repeat (``numpy.random`` is slow to
import)."""


def closed_near(mechanism: Mechanism, start: Mapping[str, float]) -> Array:
    """Return a closed configuration, shape (nq,), near rough joint coordinates if there is one; see ``closed_drawing``.

    Raises:
        AssemblyError: The loops cannot be closed, neither from there nor from elsewhere.
    """
    return closed_drawing(mechanism.closure, start_configuration(mechanism, start)).q


def generic_near(mechanism: Mechanism, start: Mapping[str, float]) -> Array:
    """Return a closed configuration of no special kind, shape (nq,), near rough joint coordinates if there is one.

    Where the loops cannot be closed at all it is the rough one: what is solved says what stays open.
    """
    try:
        return closed_generic(mechanism, start)
    except AssemblyError:
        return start_configuration(mechanism, start)


def closed_generic(mechanism: Mechanism, start: Mapping[str, float]) -> Array:
    """Return the same, shape (nq,), of a mechanism that has to close.

    Raises:
        AssemblyError: The loops cannot be closed, neither from there nor from elsewhere.
    """
    q = closed_near(mechanism, start)
    return generic(mechanism, beside(mechanism, q)) if mechanism.closure.size else q


def mobility_when_closed(mechanism: Mechanism) -> int:
    """Return the degrees of freedom in closed configurations of no special kind.

    Raises:
        AssemblyError: The loops cannot be closed.
    """
    closure = mechanism.closure
    return int(closure.split(closure.rows(closure.state(closed_generic(mechanism, mechanism.start)))).free.shape[1])


def determining(mechanism: Mechanism, motion: Mapping[str, MotionLaw]) -> PrescribedCoordinates:
    """Return the prescribed coordinates of a mechanism all of whose joints are to follow.

    Checked here: that they are not fewer than coordinates less constraint rows, and not more than coordinates. The rest
    is checked once the mechanism is assembled.

    Raises:
        InputError: A coordinate does not exist, or there are too few or too many.
        AssemblyError: There are too many, and loops that cannot be closed.
    """
    prescribed, closure = PrescribedCoordinates.bound(mechanism, motion), mechanism.closure
    least = mechanism.model.nv - closure.size  # redundant rows leave more freedom than this says
    if len(prescribed.names) < least:
        with suppress(AssemblyError):
            least = mobility_when_closed(mechanism)
        raise prescribed.miscounted(mechanism, least)
    if len(prescribed.names) > mechanism.model.nv - int(closure.ties):
        check_excess(mechanism, prescribed)
    return prescribed


def check_excess(mechanism: Mechanism, prescribed: PrescribedCoordinates) -> None:
    """Raise where coordinates are more than the degrees of freedom: their values fit one another nowhere, or by chance.

    Raises:
        InputError: Says how many of them can follow laws.
        AssemblyError: The loops cannot be closed.
    """
    mobility = mobility_when_closed(mechanism)
    if len(prescribed.names) > mobility:
        raise prescribed.miscounted(mechanism, mobility)


def beside(mechanism: Mechanism, q: Array) -> list[Array]:
    """Return a closed configuration, shape (nq,), and others on its branch, each a step along free motions further."""
    closure, found, nv = mechanism.closure, [q], mechanism.model.nv
    for step in range(BESIDE if closure.size else 0):
        free = closure.split(closure.rows(closure.state(found[-1]))).free
        spread = 2.0 * np.remainder(GOLDEN * np.arange(1 + step * nv, 1 + (step + 1) * nv), 1.0) - 1.0
        way = free @ (free.T @ (closure.scale * spread))
        size = float(np.abs(way / closure.scale).max(initial=0.0))
        if not size:
            break
        try:
            found.append(_closed(mechanism, pin.integrate(mechanism.model, found[-1], STEP / size * way)))
        except AssemblyError:  # the step was too long, as next to the end of a reach
            break
    return found


def generic(mechanism: Mechanism, q: Sequence[Array]) -> Array:
    """Return the first of some closed configurations, shape (nq,), whose rank most of them have."""
    closure = mechanism.closure
    ranks = [closure.split(closure.rows(closure.state(configuration))).rank for configuration in q]
    counted = Counter(ranks)
    usual = max(counted, key=lambda rank: (counted[rank], rank))
    return q[ranks.index(usual)]


def _closed(mechanism: Mechanism, q: Array) -> Array:
    return assembled(mechanism.closure, PrescribedCoordinates((), (), ()), q, np.zeros(0), 0.0)
