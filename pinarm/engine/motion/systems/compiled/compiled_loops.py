"""Motions of mechanisms with loops for the compiled library, and Pinocchio's judgement of it.

When a motion begins, what the library says of closed states has to satisfy Pinocchio's equations.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kernel.library import Flow, address, pointer
from pinarm.engine.kernel.loops import LoadedLoops
from pinarm.engine.kernel.structures import ClosingStructure, FlowStructure, LimitsStructure, ProximalStructure
from pinarm.records import Record

State = tuple[Array, Array]
"""Configuration, shape (nq,), and velocity, shape (nv,)."""

Rows = Callable[[Array, Array], tuple[Array, Array]]
"""``(q, v) -> G, G' v`` by Pinocchio, shapes (m, nv) and (m,)."""

AWAY = (0.1, 0.01, 0.0)
"""How far from the initial position the states are begun in which the library is judged, before they are closed, in the
unit of every velocity: the first that closes is taken."""

STATES = 2
"""Number of these states."""


class LoopSystem(Record, frozen=True):
    """A motion along loops, for the library.

    Attributes:
        structure: The C structure.
        loops: The loops.
        kept: What else it points to.
    """

    structure: ClosingStructure
    loops: LoadedLoops
    kept: tuple[Array, ...]

    @classmethod
    def of(
        cls, loops: LoadedLoops, scale: Array, nq: int, exact: ProximalStructure,
        closing: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0), limits: LimitsStructure | None = None,
    ) -> LoopSystem | None:  # fmt: skip
        """Return the motion; ``None`` where a number is none.

        Args:
            loops: The loops.
            scale: Unit of every velocity, shape (nv,).
            nq: Number of coordinates.
            exact: How accelerations are solved for.
            closing: Numbers of the closing, as in ``closing.h`` from ``projection`` on; none where Python closes.
            limits: When positions are regular; none where nobody looks.
        """
        nv, kind = len(scale), LimitsStructure()
        kept = scale.copy(), *(np.zeros(nv) for _ in range(3)), *(np.zeros(nq + nv) for _ in range(2))
        if not np.isfinite([exact.term, exact.accuracy, *closing, *scale]).all():
            return None
        structure = ClosingStructure(
            loops.structure, exact, exact, *closing, limits or kind, *map(pointer, kept), t=-np.inf
        )
        return cls(structure, loops, kept)

    def flow(self, functions: tuple[Any, Any]) -> FlowStructure:
        """Return what is integrated, with the functions of the library for rates and for accepted states."""
        place = ctypes.addressof(self.structure)
        floor, clear = place + ClosingStructure.floor.offset, place + ClosingStructure.clear.offset
        return FlowStructure(len(self.kept[-1]), *map(address, functions), floor, clear, place)


def closed_states(q: Array, scale: Array, moved: Callable[[Array, Array], Array], closed: Rows) -> list[State]:
    """Return closed states near a configuration, of no special kind and the same every time.

    Args:
        q: The configuration, shape (nq,).
        scale: Unit of every velocity, shape (nv,).
        moved: From a configuration and a motion to the configuration after it.
        closed: Closes a state; one that is left open has a G' v, or q, that is not finite.
    """
    k, found = np.arange(len(scale)), list[State]()
    for i in range(STATES):
        v = scale * np.cos(2.0 + 3.7 * i + 2.9 * k)
        for away in AWAY:
            state = closed(moved(q, away * scale * np.sin(1.0 + 7.1 * i + 1.3 * k)), v)
            if np.isfinite(state[0]).all():
                found.append(state)
                break
    return found


def disagreement(
    flow: Flow, model: pin.Model, dynamics: Dynamics, rows: Rows, states: Sequence[State], t: float,
    driven: Sequence[int] = (),
) -> float:  # fmt: skip
    """Return how well the library's a and lam satisfy Pinocchio's equations in the worst of some states.

    ``M a + nle - tau - G^T lam`` and ``G a + G' v``, each relative to the sizes of its factors; in a the motion of the
    free tree and ``M^-1 G^T lam`` have cancelled, so that what G makes of the latter counts too. The condition of the
    equations, which grows without bound near singular positions, has no part in it.

    Args:
        flow: The motion in compiled code.
        model: Pinocchio's model.
        dynamics: The forces.
        rows: The rows of the loops.
        states: The states.
        t: The instant at which they are compared [s].
        driven: Velocities that follow laws: their efforts are not those of the forces.
    """
    worst, free = 0.0, np.delete(np.arange(model.nv), driven)
    for q, v in states:
        a, lam = flow.slope(t, np.concatenate([q, v]))[model.nq :], flow.system.loops.multipliers
        load = dynamics.load()(t, q, v)
        nle = np.array(pin.nonLinearEffects(model, dynamics.data, q, v))
        inertial = np.array(pin.rnea(model, dynamics.data, q, v, a)) - nle
        matrix, drift = rows(q, v)
        held = matrix.T @ lam
        largest, forced = float(abs(matrix).max()), float(np.abs(_response(model, dynamics.data, q, held)).max())
        sizes = np.abs(inertial[free]).max(), largest * np.abs(lam).max(), np.abs(nle - load).max()
        worst = _larger(worst, (inertial + nle - load - held)[free], *sizes)
        worst = _larger(worst, matrix @ a + drift, largest * forced, largest * np.abs(a).max(), np.abs(drift).max())
    return worst


def _response(model: pin.Model, data: pin.Data, q: Array, force: Array) -> Array:
    """Return ``M^-1 force``, shape (nv,)."""
    still = np.zeros_like(force)
    return np.asarray(np.array(pin.aba(model, data, q, still, force)) - pin.aba(model, data, q, still, still))


def _larger(worst: float, left: Array, *sizes: float) -> float:
    """Return the larger one of a ratio and that of what is left of a sum to its terms; NaN where that is none."""
    return float(np.maximum(worst, np.abs(left).max() / max(float(sum(sizes)), np.finfo(float).tiny)))
