"""Trees with linear couplings in compiled code: their rows stand beside those of loop joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.kernel.library import Flow, library
from pinarm.engine.kernel.loops import CompiledLoops, Tied
from pinarm.engine.kernel.structures import ProximalStructure
from pinarm.engine.kernel.tree import CompiledTree, HeldFlow
from pinarm.engine.motion.systems.compiled.compiled_loops import LoopSystem
from pinarm.mechanics.forces.force_element import ForceElement

PROXIMAL = 1e-15
"""Proximal term of multipliers, relative to the smallest of ``W M^-1 W^T``: rows are independent, so that one iteration
leaves rounding."""


def coupled_flow(
    model: pin.Model, rows: Array, steady: Array, changing: Sequence[ForceElement]
) -> Flow | None:  # fmt: skip
    """Return the motion ``M a + nle = loads + W^T lam``, ``W a = 0``; ``None`` where the library does not know it.

    Args:
        model: Pinocchio's model.
        rows: W, shape (k, nv).
        steady: The sum of the steady loads [N*m or N], shape (nv,).
        changing: The other force elements; see ``CompiledTree.flow``.
    """
    compiled, tree = library(), CompiledTree.of(model)
    held = [load for one in changing if (load := one.held) is not None]
    loaded = tree.loaded(steady, [one for one in changing if one.held is None]) if tree else None
    if compiled is None or tree is None or loaded is None or len(held) > 1 or (held and loaded.structure.laws):
        return None
    loops, scale = CompiledLoops(tree, [Tied.coupling(row) for row in rows]).loaded(loaded), _scale(model, rows)
    if loops is None or not scale > 0.0:
        return None
    solve = ProximalStructure(PROXIMAL * scale, 0.0, 1)
    system = LoopSystem.of(loops, np.ones(model.nv), model.nq, solve)
    if system is None:
        return None
    structure = system.flow((compiled.closing_rates, None))
    return HeldFlow(structure, system, held[0], steady, loaded) if held else Flow(structure, system)


def _scale(model: pin.Model, rows: Array) -> float:
    """Return the smallest diagonal of ``W M^-1 W^T`` in a position of no special kind; NaN where M is singular."""
    q = pin.integrate(model, pin.neutral(model), np.sin(1.0 + 1.3 * np.arange(model.nv)))
    try:
        return float(np.vecdot(rows, np.linalg.solve(mass_matrix(model, q), rows.T).T).min())
    except np.linalg.LinAlgError:
        return float("nan")
