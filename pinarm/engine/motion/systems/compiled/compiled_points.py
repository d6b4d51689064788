"""Loops that are closed by points, in compiled code: their states are closed, and singular positions passed, there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.pinocchio_constraints import PROJECTION, CoincidentPoints
from pinarm.engine.kernel.laws import Followed
from pinarm.engine.kernel.library import Flow, library
from pinarm.engine.kernel.loops import POINT, CompiledLoops, LoadedLoops, Tied
from pinarm.engine.kernel.structures import LimitsStructure, ProximalStructure
from pinarm.engine.kernel.tree import AGREEMENT, DISAGREES, CompiledTree
from pinarm.engine.motion.systems import point_motion
from pinarm.engine.motion.systems.compiled.compiled_loops import LoopSystem, State, closed_states, disagreement
from pinarm.engine.motion.systems.point_motion import PointMotion
from pinarm.engine.motion.systems.row_motion import ITERATIONS, LEAST, MET, ROUNDED

if TYPE_CHECKING:
    from pinarm.engine.dynamics.many_points import ManyCoincidentPoints
    from pinarm.mechanics.laws.motion_law import MotionLaw

NEWTON, CLOSED = 20, 1e-14
"""Most steps of Newton's method to close a state, and gap from which one more leaves rounding, relative to the extent:
forces of 1 N at points that are a gap apart put the moments of the bodies off by the gap, of wide linkages 1e-12."""

PROJECTIONS = 3
"""Projections of its velocities: each leaves ``PROJECTION`` of what is left."""

INDEPENDENT = 1e-5
"""Part of the proximal term that rows without redundant ones take in regular steps: it keeps pivots from 0, and one
iteration leaves rounding."""

ALIKE = 1e-4
"""Relative accuracy of squares of singular values: the limits of the regularity have two digits."""


class PointFlow(Flow, frozen=True):
    """The motion of loops by the library, which closes states and passes singular positions as the motion in Python.

    Attributes:
        motion: The motion in Python. It begins, and settles what the library hands back: states at which the rank has
            grown, and those whose accelerations leave the constraints.
    """

    motion: PointMotion

    @classmethod
    def of(cls, loops: LoadedLoops, motion: PointMotion) -> PointFlow | None:
        """Return the motion of loops under their loads; ``None`` where a number is none."""
        compiled, system = library(), _system(loops, motion)
        if compiled is None or system is None:
            return None
        return cls(system.flow((compiled.closing_rates, compiled.closing_settle)), system, motion)

    def ready(self) -> None:
        """Bring the system to the present state of the motion."""
        structure, motion = self.system.structure, self.motion
        self.choose(motion.near, motion.rank)
        structure.regular, structure.limits.rank, structure.open = motion.regular, motion.rank, motion.open
        structure.t, structure.step, structure.floor = motion.t, motion.step, motion.least
        structure.speed, structure.acceleration = motion.speed, motion.largest

    def way(self, t: float) -> Any:
        """Return whether stages are closed, and the rank, in the step that begins at t; see ``PointMotion.since``."""
        clear, rank = self.motion.outlook(t)
        return not clear, rank

    def take(self, way: Any) -> None:
        """Let rates be those of such stages."""
        self.choose(*way)

    def choose(self, near: bool, rank: int) -> None:
        """Choose whether stages are closed, and the rank."""
        structure, settings = self.system.structure, self.motion.settings(rank)
        structure.near, structure.tolerant = near, _proximal(settings) if settings else ProximalStructure()
        if rank == len(self.system.loops.places):
            structure.tolerant = ProximalStructure(INDEPENDENT * structure.tolerant.term, 0.0, 1)

    def advanced(self, ends: Sequence[float], clear: Iterable[float]) -> None:
        """Let the motion know how far it is."""
        structure, motion = self.system.structure, self.motion
        motion.ranks |= dict.fromkeys(ends, motion.rank)
        motion.clear.update(clear)
        motion.near, motion.regular = bool(structure.near), structure.regular
        motion.singular, motion.open = motion.regular < point_motion.NEAR, structure.open
        motion.t, motion.step, motion.least = structure.t, structure.step, structure.floor
        motion.speed, motion.largest = structure.speed, structure.acceleration
        motion.require_known_way(motion.t)


def judged_loops(
    dynamics: Dynamics, motion: PointMotion, near: Array, laws: Sequence[MotionLaw], interval: tuple[float, float]
) -> tuple[LoadedLoops | None, str]:  # fmt: skip
    """Return the loops in compiled code where Pinocchio agrees, and what is to be said where it does not.

    Args:
        dynamics: The forces.
        motion: The motion in Python.
        near: A configuration near closed ones, shape (nq,).
        laws: Those of the joints that are driven.
        interval: Start and end of the motion [s].
    """
    points, t, driven = motion.points, interval[0], list(motion.points.tied.driven)
    guided = [
        Followed(v, q, law.on(*interval)) for v, q, law in zip(driven, motion.places, laws, strict=True)
    ]  # fmt: skip
    loops = _loaded(points.tied, dynamics, guided)
    flow = PointFlow.of(loops, motion) if loops else None
    if flow is None:
        return None, ""

    def rows(q: Array, v: Array) -> tuple[Array, Array]:
        motion.free(t, q, v)
        drift = -points.right()
        points.factorise(q)
        return points.rows()[points.tied.acting], drift[points.tied.acting]

    states = closed_states(near, motion.scale, lambda q, x: pin.integrate(points.tied.model, q, x), _closed(motion))
    flow.choose(False, points.tied.rank)
    apart = disagreement(flow, points.tied.model, dynamics, rows, states, t, driven)
    for q, v in states if driven else ():
        a, expected = flow.slope(t, np.concatenate([q, v]))[len(q) :], motion.free(t, q, v)
        apart = float(np.maximum(apart, np.abs((a - expected)[driven]).max() / np.abs(expected).max()))
    return (loops, "") if apart <= AGREEMENT else (None, DISAGREES.format(apart))


def _loaded(
    tied: CoincidentPoints | ManyCoincidentPoints, dynamics: Dynamics, guided: Sequence[Followed]
) -> LoadedLoops | None:  # fmt: skip
    """Return the loops under their loads; ``None`` where the library does not know one of them, or a law."""
    loops = _loops(tied)
    loaded = loops.tree.loaded(dynamics.steady, dynamics.changing, guided) if loops else None
    return loops.loaded(loaded) if loops and loaded else None


def _closed(motion: PointMotion) -> Any:
    points = motion.points

    def closed(q: Array, v: Array) -> State:
        polished = False
        for _ in range(NEWTON):
            points.factorise(q)
            gap = points.gap()
            if polished:
                rows = points.rows()
                for _ in range(PROJECTIONS):
                    v = v - points.step(rows @ v)
                return q, v
            polished = bool(np.linalg.norm(gap) <= CLOSED * motion.extent)
            q = pin.integrate(points.tied.model, q, points.step(gap))
        return np.full_like(q, np.nan), v

    return closed


@lru_cache(maxsize=16)  # the same for all runs of a mechanism
def _loops(tied: CoincidentPoints | ManyCoincidentPoints) -> CompiledLoops | None:
    """Return the loops for the library; ``None`` where it is missing, or does not know a joint."""
    axes = np.eye(3)
    tree = CompiledTree.of(tied.model)
    held = [axes[acting] for acting in tied.acting.reshape(-1, 3)]
    loops = [
        Tied(POINT, (one.joint1_id, one.joint2_id), (one.joint1_placement, one.joint2_placement), along, 0.0 * along)
        for one, along in zip(tied.needed, held, strict=True)
    ]
    return CompiledLoops(tree, loops) if tree else None


def _system(loops: LoadedLoops, motion: PointMotion) -> LoopSystem | None:
    """Return the system with the numbers by which the motion in Python solves, closes and looks."""
    points, extent = motion.points, motion.extent
    of_motion = (getattr(point_motion, name) for name in ("NEAR", "AHEAD", "COARSE", "CLOSE", "BLIND", "VANISHED"))
    limits = LimitsStructure(
        points.tied.regularity, *of_motion, ALIKE, point_motion.ASIDE, tuple(point_motion.ACROSS),
        point_motion.PASSED * extent, point_motion.FLOOR, point_motion.CLEAR, points.tied.rank,
    )  # fmt: skip
    closing = PROJECTION * points.scale, ROUNDED * extent, point_motion.STALLED * extent, MET * LEAST, ITERATIONS
    return LoopSystem.of(loops, motion.scale, points.tied.model.nq, _proximal(points.beside), closing, limits)


def _proximal(settings: pin.ProximalSettings) -> ProximalStructure:
    return ProximalStructure(settings.mu, settings.absolute_accuracy, settings.max_iter)
