"""What ends a segment of smooth motion, and what is watched for it."""

from __future__ import annotations

from functools import partial

from pinarm.arrays import Array
from pinarm.engine.integration.events import Watch
from pinarm.engine.integration.integrator import StepsOver
from pinarm.engine.motion.segmented.end_stops import Bound, Held, Stop
from pinarm.engine.motion.segmented.hybrid_system import HybridSystem, Mode
from pinarm.engine.motion.systems import System
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.joints import RADIAN
from pinarm.records import Record, replace

Key = str | tuple[str, int]
"""Name of an event of the user, or what ends a segment: one of ``CAUSES``, or an ``edge``, and which one it is."""

APART = 10.0
"""Errors of steps within which a stop that moves only with others is not met."""

CAUSES = ("hit", "released", "slip", "control")
"""Fields of ``SegmentEnd`` that tell why a segment ended."""


class SegmentEnd(Record, frozen=True):
    """What ended a segment.

    Attributes:
        t: When [s].
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        hit: Stop that is hit.
        released: Stop that lets go.
        slip: Joint that comes to rest, or the complement of a group of stuck joints that breaks loose.
        control: Controller that changes its way; see ``Controls.watches``.
        stops: Whether the run ends.
    """

    t: float
    q: Array
    v: Array
    hit: int | None = None
    released: int | None = None
    slip: int | None = None
    control: int | None = None
    stops: bool = False


def watched(
    hybrid: HybridSystem, mode: Mode, system: System, resting: Held, tied: Held = frozenset()
) -> list[tuple[Key, Watch]]:
    """Return the events, and what ends a segment: stops that are hit or let go, edges of loads, joints that stick.

    Args:
        hybrid: What is integrated.
        mode: What holds joints.
        system: The same as equations; see ``HybridSystem.stretch``.
        resting: Stops that are touched at rest. A joint that leaves its stop from rest does so slower than rounding at
            first: it is given some slack.
        tied: Those of them that move only with stops that hold, within the errors of steps.
    """
    found: list[tuple[Key, Watch]] = list(hybrid.watches.items())
    for k, bound in enumerate(hybrid.bounds):
        slack = 2.0 * bound.slack if k in resting else 0.0
        if k in tied and isinstance(bound, Bound):
            slack = APART * hybrid.method.tolerance * (hybrid.size + abs(bound.limit))
        if k in mode.held:
            push, unit = partial(hybrid.push, mode.held, system, k), "N" if bound.unit != RADIAN else "N*m"
            holds = f"the {bound.title} holds"
            found.append((("released", k), Watch(push, -1, stops=True, loaded=True, what=holds, unit=str(unit))))
        else:
            begins = "" if k in resting else f"contact with the {bound.title} begins"
            gap = partial(_gap, bound, slack)
            found.append((("hit", k), Watch(gap, -1, stops=True, what=begins, unit=str(bound.unit))))
    edges = [edge for force in hybrid.dynamics.forces.values() for edge in force.edges()]
    edges += [edge for one in hybrid.profiled for edge in one.edges()]
    found += [(("edge", k), Watch(edge.value, 0, stops=True, counts=edge.counts)) for k, edge in enumerate(edges)]
    if hybrid.rubbing(mode.held):
        switches = hybrid.friction(mode.held).watches(mode.slip, system)  # type: ignore[arg-type]
        found += [(("slip", index), watch) for index, watch in switches]
    return found


def steps_over(hybrid: HybridSystem, system: System) -> StepsOver | None:
    """Return whether a step in the integrated states may have gone past a piece of a load."""
    forces = [force for force in hybrid.dynamics.forces.values() if force.in_pieces]
    pieces: list[ForceElement | JointRelation] = [*forces, *hybrid.profiled]

    def passed(t: Array, q: Array, v: Array) -> bool:
        whole = system.whole(t, q, v)
        return any(one.passed(*whole) for one in pieces)

    return passed if pieces else None


def of_mechanism(watch: Watch, system: System) -> Watch:
    """Return the watch of integrated states."""
    counts, margin, sensitivity = watch.counts, watch.margin, watch.sensitivity
    return replace(
        watch, value=lambda t, q, v: watch.value(t, *system.whole(t, q, v)),
        counts=counts and (lambda t, q, v: counts(t, *system.whole(t, q, v))),
        margin=margin and (lambda t, q, v: margin(t, *system.whole(t, q, v))),
        sensitivity=sensitivity and (lambda t, q, v: sensitivity(t, *system.whole(t, q, v))),
    )  # fmt: skip


def _gap(bound: Stop, slack: float, t: Array, q: Array, v: Array) -> Array:
    return bound.gap(q) + slack
