"""Motions of loops that are closed by points, in compiled code.

Pinocchio judges it when a motion begins: what the library says of closed states has to satisfy Pinocchio's equations.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.dynamics.pinocchio_constraints import PROJECTION, PointConstraints
from pinarm.engine.kernel.library import Flow, address, library, pointer
from pinarm.engine.kernel.loops import POINT, CompiledLoops, LoadedLoops, Tied
from pinarm.engine.kernel.structures import ClosingStructure, FlowStructure, LimitsStructure, ProximalStructure
from pinarm.engine.kernel.tree import CompiledTree, rates
from pinarm.engine.motion.systems import point_motion
from pinarm.engine.motion.systems.batch_rows import ITERATIONS, ROUNDED
from pinarm.engine.motion.systems.point_motion import PointMotion
from pinarm.engine.motion.systems.row_motion import LEAST, MET

AWAY = (0.1, 0.01, 0.0)
"""How far from the initial position the states are begun in which the library is judged, before they are closed [m or
rad]: the first that closes is taken."""

STATES = 3
"""Number of these states."""

NEWTON, CLOSED = 20, 1e-14
"""Most steps of Newton's method to close them, and gap at which they count as closed, relative to the extent."""

PROJECTIONS = 3
"""Projections of their velocities: each leaves ``PROJECTION`` of what is left."""

ALIKE = 1e-6
"""Relative accuracy of squares of singular values."""

State = tuple[Array, Array]
"""Configuration, shape (nq,), and velocity, shape (nv,)."""


class _System(NamedTuple):
    """A motion along loops, for the library.

    Attributes:
        structure: The C structure.
        loops: The loops.
        kept: What else it points to.
    """

    structure: ClosingStructure
    loops: LoadedLoops
    kept: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class PointFlow(Flow):
    """The motion of loops by the library, which closes states and passes singular positions as the motion in Python.

    Attributes:
        motion: The motion in Python. It begins, and settles what the library hands back: states at which the rank has
            grown, and those whose accelerations leave the constraints.
    """

    motion: PointMotion

    @classmethod
    def of(cls, loops: CompiledLoops, dynamics: Dynamics, motion: PointMotion) -> PointFlow | None:
        """Return the motion of loops under their loads; ``None`` where the library does not know one, or refuses."""
        compiled, loaded = library(), loops.tree.loaded(dynamics.steady, dynamics.changing)
        if compiled is None or loaded is None:
            return None
        system = _system(loops.loaded(loaded), motion)
        if compiled.closing_check(ctypes.byref(system.structure)):
            return None
        functions, place = (compiled.closing_rates, compiled.closing_settle), ctypes.addressof(system.structure)
        floor = place + ClosingStructure.floor.offset
        return cls(FlowStructure(len(system.kept[-1]), *map(address, functions), floor, place), system, motion)

    def ready(self) -> None:
        """Bring the system to the present state of the motion."""
        structure, motion = self.system.structure, self.motion
        self.take((motion.near, motion.rank))
        structure.regular, structure.limits.rank = motion.regular, motion.rank
        structure.t, structure.step, structure.floor = motion.t, motion.step, motion.least

    def way(self, t: float) -> Any:
        """Return whether the stages were closed in the step that begins at t, and the rank."""
        return self.motion.chosen(t)

    def take(self, way: Any) -> None:
        """Let rates be those of steps that were taken in a way."""
        near, rank = way
        structure, settings = self.system.structure, self.motion.settings(rank)
        structure.near, structure.tolerant = near, _proximal(settings) if settings else ProximalStructure()

    def advanced(self, ends: Sequence[float], marks: Sequence[int]) -> None:
        """Let the motion know how far it is."""
        structure, motion = self.system.structure, self.motion
        motion.choices |= {t: (bool(near), motion.rank) for t, near in zip(ends, marks, strict=True)}
        motion.near, motion.regular = bool(structure.near), structure.regular
        motion.singular = motion.regular < point_motion.NEAR
        motion.t, motion.step, motion.least = structure.t, structure.step, structure.floor


def compiled_loops(points: PointConstraints) -> CompiledLoops | None:
    """Return the loops for the library; ``None`` where it is missing, or does not know a joint."""
    tied, axes = points.tied, np.eye(3)
    tree = None if len(tied.driven) else CompiledTree.of(tied.model)
    held = [axes[acting] for acting in tied.acting.reshape(-1, 3)]
    loops = [
        Tied(POINT, (one.joint1_id, one.joint2_id), (one.joint1_placement, one.joint2_placement), along, 0.0 * along)
        for one, along in zip(tied.needed, held, strict=True)
    ]
    return CompiledLoops(tree, loops) if tree else None


def _system(loops: LoadedLoops, motion: PointMotion) -> _System:
    """Return the system with the numbers by which the motion in Python solves, closes and looks."""
    points, extent = motion.points, motion.extent
    nq, nv = points.tied.model.nq, points.tied.model.nv
    of_motion = (getattr(point_motion, name) for name in ("NEAR", "AHEAD", "COARSE", "CLOSE", "BLIND", "VANISHED"))
    across = tuple(point_motion.ACROSS)
    limits = LimitsStructure(
        points.tied.regularity, *of_motion, ALIKE, point_motion.ASIDE, across, point_motion.FLOOR, points.tied.rank
    )
    kept = motion.scale.copy(), *(np.zeros(nv) for _ in range(4)), *(np.zeros(nq + nv) for _ in range(2))
    structure = ClosingStructure(
        loops.structure, _proximal(motion.exact), ProximalStructure(), PROJECTION * points.scale, ROUNDED * extent,
        point_motion.STALLED * extent, MET * LEAST, ITERATIONS, limits, *map(pointer, kept), 1, 0.0, -np.inf, 0.0, 0.0,
    )  # fmt: skip
    return _System(structure, loops, kept)


def _proximal(settings: pin.ProximalSettings) -> ProximalStructure:
    return ProximalStructure(settings.mu, settings.absolute_accuracy, settings.max_iter)


def disagreement(flow: PointFlow, points: PointConstraints, dynamics: Dynamics, states: Sequence[State]) -> float:
    """Return how well the library's a and lam satisfy Pinocchio's equations in the worst of some states.

    ``M a + nle - tau - G^T lam`` and ``G a + G' v``, each relative to the largest of its terms: so the condition of the
    equations, which grows without bound near singular positions, has no part in it.
    """
    return max((max(_residuals(flow, points, dynamics, q, v)) for q, v in states), default=0.0)


def _residuals(
    flow: PointFlow, points: PointConstraints, dynamics: Dynamics, q: Array, v: Array
) -> tuple[float, float]:
    model = points.tied.model
    flow.take((False, points.tied.rank))
    a, lam = rates(flow, np.concatenate([q, v]))[model.nq :], flow.system.loops.multipliers.copy()
    load = dynamics.load()(0.0, q, v).copy()
    nle, mass = np.array(pin.nonLinearEffects(model, points.data, q, v)), mass_matrix(model, q)
    flow.motion.free(0.0, q, v)
    bend = -points.right()
    points.factorise(q)
    rows = points.rows()
    force = rows[points.tied.acting].T @ lam
    forces = np.abs(mass) @ np.abs(a) + np.abs(nle) + np.abs(load) + np.abs(rows[points.tied.acting].T) @ np.abs(lam)
    motions = np.abs(rows) @ np.abs(a) + np.abs(bend)
    return _ratio(mass @ a + nle - load - force, forces), _ratio(rows @ a + bend, motions)


def _ratio(left: Array, terms: Array) -> float:
    return float(np.abs(left).max() / max(terms.max(), np.finfo(float).tiny))


def closed_states(points: PointConstraints, q: Array, extent: float, scale: Array) -> list[State]:
    """Return closed states near a configuration, of no special kind and the same every time."""
    k, model = np.arange(points.tied.model.nv), points.tied.model
    found = []
    for i in range(STATES):
        for away in AWAY:
            here = pin.integrate(model, q, away * scale * np.sin(1.0 + 7.1 * i + 1.3 * k))
            for _ in range(NEWTON):
                points.factorise(here)
                gap = points.gap()
                if np.linalg.norm(gap) <= CLOSED * extent:
                    break
                here = pin.integrate(model, here, points.step(gap))
            if np.linalg.norm(gap) <= CLOSED * extent:
                v, rows = scale * np.cos(2.0 + 3.7 * i + 2.9 * k), points.rows()
                for _ in range(PROJECTIONS):
                    v = v - points.step(rows @ v)
                found.append((here, v))
                break
    return found
