"""Motions of loops that are closed by points, in compiled code wherever they are far from singular positions.

The library takes steps as long as every closed position is regular, and hands back the first that is not. Pinocchio
judges it when a motion begins: what the library says of closed states has to satisfy Pinocchio's equations.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.dynamics.pinocchio_constraints import PROJECTION, PointConstraints
from pinarm.engine.kernel.library import Flow, address, library
from pinarm.engine.kernel.loops import POINT, CompiledLoops, Settings, Tied
from pinarm.engine.kernel.structures import FlowStructure, ProximalStructure, RegularityStructure
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


@dataclass(frozen=True, eq=False)
class PointFlow(Flow):
    """The motion of loops by the library, which goes on where the motion in Python finds a position regular.

    Attributes:
        motion: The motion in Python, which decides.
    """

    motion: PointMotion

    @classmethod
    def of(cls, loops: CompiledLoops, dynamics: Dynamics, motion: PointMotion) -> PointFlow | None:
        """Return the motion of loops under their loads; ``None`` where the library does not know one, or refuses."""
        compiled, loaded = library(), loops.tree.loaded(dynamics.steady, dynamics.changing)
        system = loops.system(loaded, _settings(motion)) if loaded else None
        if compiled is None or system is None:
            return None
        n, place = loops.tree.model.nq + loops.tree.model.nv, ctypes.addressof(system.structure)
        functions = address(compiled.constraints_rates), address(compiled.constraints_settle)
        return cls(FlowStructure(n, *functions, place), system, motion)

    def ready(self) -> bool:
        """Return whether stages need no closing; the library then goes on from what the motion knows."""
        if self.motion.near:
            return False
        structure, motion = self.system.structure, self.motion
        structure.regular, structure.limits.rank = motion.regular, motion.rank
        structure.solve = _proximal(motion.way[0])
        return True

    def knows(self, t: float) -> bool:
        """Return whether the step that begins at t was taken without closing its stages, at the present rank."""
        return self.motion.choices.get(t) == (False, self.motion.rank)

    def advanced(self, ends: Sequence[float]) -> None:
        """Let the motion know how far it is."""
        self.motion.advanced(ends, self.system.structure.regular)


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


def _settings(motion: PointMotion) -> Settings:
    """Return the numbers by which the motion in Python solves, closes and looks."""
    points, extent = motion.points, motion.extent
    limits = point_motion.NEAR, point_motion.AHEAD, point_motion.COARSE, point_motion.CLOSE
    return Settings(
        _proximal(motion.exact), PROJECTION * points.scale, ROUNDED * extent, point_motion.STALLED * extent,
        MET * LEAST, ITERATIONS,
        RegularityStructure(points.tied.regularity, *limits, point_motion.VANISHED, ALIKE, points.tied.rank),
    )  # fmt: skip


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
    a, lam = rates(flow, np.concatenate([q, v]))[model.nq :], flow.system.multipliers.copy()
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
