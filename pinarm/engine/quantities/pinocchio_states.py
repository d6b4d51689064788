"""States of a mechanism from those of ``pin.buildModelFromUrdf``, and back: arrays of any leading axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pinarm.arrays import Array
from pinarm.engine.quantities.broadcasting import Leading

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism


def from_pinocchio(mechanism: Mechanism, q: ArrayLike, v: ArrayLike | None) -> tuple[Array, Array]:
    """Return pinarm's q and v; see ``Mechanism.from_pinocchio``."""
    layout = mechanism.pinocchio_layout
    leading, rows = _folded(q, v, layout.p_nq, layout.p_nv)
    found, rates = layout.take(*rows)
    return leading.unfold(found), leading.unfold(rates)


def to_pinocchio(mechanism: Mechanism, q: ArrayLike, v: ArrayLike | None) -> tuple[Array, Array]:
    """Return Pinocchio's q and v; see ``Mechanism.to_pinocchio``."""
    layout = mechanism.pinocchio_layout
    leading, rows = _folded(q, v, layout.nq, layout.nv)
    found, rates = layout.give(*rows)
    return leading.unfold(found), leading.unfold(rates)


def _folded(q: ArrayLike, v: ArrayLike | None, nq: int, nv: int) -> tuple[Leading, list[Array]]:
    """Return the leading axes of q and v, and both as rows; velocities that are left out are 0."""
    if v is None:
        leading, (rows,) = Leading.fold(q=(q, nq))
        return leading, [rows, np.zeros((len(rows), nv))]
    return Leading.fold(q=(q, nq), v=(v, nv))
