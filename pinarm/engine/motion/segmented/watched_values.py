"""Values that are watched in a segment of smooth motion, and decisions where they turn, with margin and error."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.integration.integrator import StepsOver, Watch
from pinarm.engine.motion.outcome import Decision
from pinarm.engine.motion.segmented.end_stops import Bound, Held
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem, Mode
from pinarm.engine.motion.systems import System
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.joints import RADIAN
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Turn

Cause = tuple[str, int]
"""Cause of a segment end, with its number: ``hit`` and ``released`` stops, ``slip`` of a joint that comes to rest, or
the complement of a group of stuck joints that breaks loose, ``control`` of a controller, ``edge`` of a load."""

STOP: Cause = ("stop", -1)
"""An event of the user that ends the run."""

Margin = Callable[[Array, Array, Array], Array]
"""``(t, q, v) -> margins`` of n states of a mechanism, shape (n,)."""

APART = 10.0
"""Errors of steps within which a stop that moves only with others is not met."""

PART = 1e-6
"""Change of a state, over the size that errors are relative to, by which a sensitivity is measured: larger than the
rounding of loads, and so small that their curvature does not matter."""


def watched(
    hybrid: HybridSystem, mode: Mode, system: System, resting: Held, tied: Held = frozenset()
) -> list[tuple[str | Cause, Watch]]:
    """Return the events of the user, by name, and the ends of a segment, by their causes.

    ``resting`` are stops that are touched at rest: a joint that leaves its stop from rest does so slower than rounding
    at first, and is given some slack. ``tied`` ones of them move only with stops that hold, within the errors of steps.
    """
    watches: list[tuple[str | Cause, Watch]] = list(hybrid.watches.items())
    for k, bound in enumerate(hybrid.bounds):
        if k in mode.held:
            push, unit = partial(hybrid.push, mode.held, system, k), "N" if bound.unit != RADIAN else "N*m"
            holds = f"the {bound.title} holds"
            watches.append((("released", k), Watch(push, -1, stops=True, loaded=True, what=holds, unit=unit)))
            continue
        slack = 2.0 * bound.slack if k in resting else 0.0
        if k in tied and isinstance(bound, Bound):
            slack = APART * hybrid.method.tolerance * (hybrid.size + abs(bound.limit))
        begins = "" if k in resting else f"contact with the {bound.title} begins"
        gap = partial(_sum, bound.gap, slack)
        watches.append((("hit", k), Watch(gap, -1, stops=True, what=begins, unit=str(bound.unit))))
    edges = [edge for force in hybrid.dynamics.forces.values() for edge in force.edges()]
    edges += [edge for relation in hybrid.profiled for edge in relation.edges()]
    watches += [
        (("edge", k), Watch(edge.value, edge.direction, stops=True, counts=edge.counts)) for k, edge in enumerate(edges)
    ]
    if hybrid.rubbing(mode.held):
        watches += [(("slip", index), watch) for index, watch in system.watches()]  # type: ignore[attr-defined]
    return watches


def _sum(gap: Callable[[Array], Array], slack: float, t: Array, q: Array, v: Array) -> Array:
    return gap(q) + slack


def steps_over(hybrid: HybridSystem, system: System) -> StepsOver | None:
    """Return whether a step in the integrated states may have gone past a piece of a load."""
    forces = [force for force in hybrid.dynamics.forces.values() if force.in_pieces]
    pieces: list[ForceElement | JointRelation] = [*forces, *hybrid.profiled]

    def passed(t: Array, q: Array, v: Array) -> bool:
        whole = system.whole(t, q, v)
        return any(piece.passed(*whole) for piece in pieces)

    return passed if pieces else None


def of_mechanism(watch: Watch, system: System) -> Watch:
    """Return the watch of integrated states."""
    functions = {name: getattr(watch, name) for name in ("value", "counts", "margin", "sensitivity")}
    return replace(watch, **{name: partial(_whole, system, of) if of else None for name, of in functions.items()})


def _whole(system: System, function: Callable[[Array, Array, Array], object], t: Array, q: Array, v: Array) -> object:
    return function(t, *system.whole(t, q, v))


def deciding(hybrid: HybridSystem, watch: Watch) -> Watch:
    """Return a watch of a mechanism's states, with the sensitivity of its margin where it decides something."""
    if not watch.what:
        return watch
    return replace(watch, sensitivity=partial(sensitivity, hybrid, watch.margin or watch.value))


def sensitivity(hybrid: HybridSystem, margin: Margin, t: Array, q: Array, v: Array) -> float:
    """Return the change of a margin by errors of 1 in all coordinates and velocities of one state, added up.

    The errors are relative to ``size + |y|``, as those of steps are. Shapes (1,), (1, nq) and (1, nv).
    """
    model, n = hybrid.closure.model, hybrid.closure.model.nv
    moves = PART * np.diag(hybrid.size + (np.abs(q[0]) if model.nq == n else np.ones(n)))
    positions = [q[0], *(pin.integrate(model, q[0], move) for move in moves), *np.repeat(q, n, axis=0)]
    velocities = np.vstack([np.repeat(v, n + 1, axis=0), v + PART * np.diag(hybrid.size + np.abs(v[0]))])
    margins = margin(np.repeat(t, 2 * n + 1), np.array(positions), velocities)
    return float(np.abs(margins[1:] - margins[0]).sum()) / PART


def decision(watch: Watch, turn: Turn, event: str = "") -> Decision:
    """Return the decision where a watched value turns.

    ``event`` is the name of an event that is only recorded there; empty for a watch that changes the motion.
    """
    passed = -turn.sign * turn.margin
    if watch.loaded:  # watched for its end
        return Decision(watch.what, turn.t, -passed, turn.error, watch.unit, passed < 0.0)
    touches = turn.is_open and watch.level is not None
    happens = watch.direction in (0, -turn.sign) if touches else passed > 0.0
    return Decision(watch.what, turn.t, passed, turn.error, watch.unit, happens, event)
