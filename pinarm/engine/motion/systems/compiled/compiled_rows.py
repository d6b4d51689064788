"""Loops of any kind, in compiled code for the accelerations within steps; accepted states are settled in Python."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache, partial

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint import Constraint
from pinarm.engine.constraints.nullspace import RANK
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.pinocchio_constraints import NOISE, UNEVEN, inverse_mass, places_of
from pinarm.engine.kernel.library import Flow, library
from pinarm.engine.kernel.loops import LOWER, ROD, UNIVERSAL, CompiledLoops, LoadedLoops, Tied
from pinarm.engine.kernel.structures import ProximalStructure
from pinarm.engine.kernel.tree import AGREEMENT, DISAGREES, CompiledTree
from pinarm.engine.motion.systems.compiled.compiled_loops import LoopSystem, State, closed_states, disagreement
from pinarm.engine.motion.systems.row_motion import RowMotion, Settled
from pinarm.errors import PinarmError
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import LowerPair
from pinarm.mechanics.loops.rod import Tie
from pinarm.mechanics.loops.universal import ORIGINS, Cross

PROXIMAL, PIVOT, LEFT, ITERATIONS = 1e-12, 1e-13, 1e-12, 4
"""Proximal term of accelerations, relative to the smallest Delassus diagonal and, at least, to the largest one, what
the iteration may leave of the rows where it ends [m/s^2 or rad/s^2], and most iterations. Rows that reach 1e-5 of the
others count in full, as in the singular values in Python; the pivots of rows that repeat others are the term, and not
what rounding leaves of large diagonals."""

REPEATED = 1e-12
"""The same, up to which rows repeat others but for rounding. Rows of files that are rounded stay above it: they would
be solved for as if they were independent."""

CLEAR = 1e-4
"""Singular value of rows of length 1, relative to the largest, above which they are independent beyond doubt."""


def compiled_rows(motion: RowMotion, dynamics: Dynamics, near: Array, t: float) -> tuple[Flow | None, str]:
    """Return the motion in compiled code where Pinocchio agrees, and what is to be said where it does not.

    There is none where a constraint is no loop joint, or where the library does not know a load or a joint. Nor is
    there one where the rank of the rows is lower on the constraints than beside them: within steps, where loops are a
    little open, redundant rows then contradict each other, and only their singular values tell which.

    Args:
        motion: The motion in Python.
        dynamics: The forces.
        near: A configuration near closed ones, shape (nq,).
        t: The instant at which they are compared [s].
    """
    loops, closure = _loops(motion.rows), motion.rows
    loaded = loops.tree.loaded(dynamics.steady, dynamics.changing) if loops else None
    there = loops.loaded(loaded) if loops and loaded else None
    if there is None:
        return None, ""
    states: list[State] = []

    def configurations() -> Iterator[Array]:
        """Yield those on the constraints last: to close many loops takes longer than to look at their rows."""
        yield from places_of(closure.model)
        moved, closed = partial(pin.integrate, closure.model), partial(_closed, motion.settled)
        states.extend(closed_states(near, closure.scale, moved, closed))
        yield from (q for q, _ in states)

    flow = _flow(there, closure, configurations())
    if flow is None or not states:
        return None, ""

    def rows(q: Array, v: Array) -> tuple[Array, Array]:
        state = closure.state(q, v)
        return closure.rows(state), closure.drift(state)

    apart = disagreement(flow, closure.model, dynamics, rows, states, t)
    return (flow, "") if apart <= AGREEMENT else (None, DISAGREES.format(apart))


def _flow(loops: LoadedLoops, closure: Closure, configurations: Iterable[Array]) -> Flow | None:
    """Return the motion of loops; ``None`` where it is not exact at some configurations."""
    compiled, term = library(), _proximal_term(closure, configurations)
    if compiled is None or not term:
        return None
    solve = ProximalStructure(term, LEFT, ITERATIONS)
    system = LoopSystem.of(loops, closure.scale, closure.model.nq, solve)
    return Flow(system.flow((compiled.closing_rates, compiled.closing_settle)), system) if system else None


def _closed(settled: Settled, q: Array, v: Array) -> State:
    """Return the closed state nearest to one, or one that is not finite."""
    nothing = np.zeros((1, 0))
    try:
        closed, rates, _ = settled(q[None], v[None], nothing, nothing, np.zeros(1))
    except (PinarmError, np.linalg.LinAlgError):
        return np.full_like(q, np.nan), v
    return closed[0], rates[0]


def _proximal_term(closure: Closure, configurations: Iterable[Array]) -> float:
    """Return the proximal term, by the diagonals of ``G M^-1 G^T`` that are not 0 [1/kg].

    0 where the mass matrix is singular, where bodies differ so much that rounding is magnified (``UNEVEN``), or where
    the rank is not the same, and clear, at configurations on the constraints and beside them.
    """
    model, ranks, term = closure.model, set[int](), 0.0
    for q in configurations:
        rows, inverse = closure.rows(closure.state(q)), inverse_mass(model, q)
        turning = np.linalg.norm(rows, axis=1).max() > NOISE  # rows of redundant loops alone are rounding
        if inverse is None or not turning:
            return 0.0
        delassus = rows @ inverse @ rows.T
        size = np.sqrt(np.diag(delassus))
        kept = size > RANK * size.max()
        if (size[~kept] > REPEATED * size.max()).any():
            return 0.0
        s = np.linalg.svd(rows[kept] / size[kept, None] @ np.linalg.cholesky(inverse), compute_uv=False)
        rank = int((s > CLEAR * s[0]).sum())
        if (s[rank:] > REPEATED * s[0]).any() or s[0] > UNEVEN**0.5 * s[rank - 1]:
            return 0.0
        ranks.add(rank)
        diagonals = size[kept] ** 2
        term = max(term or PROXIMAL * float(diagonals.min()), PIVOT * float(diagonals.max()))
    return term if len(ranks) == 1 else 0.0


@lru_cache(maxsize=16)  # the same for all runs of a mechanism
def _loops(closure: Closure) -> CompiledLoops | None:
    """Return the loops for the library; ``None`` where it is missing, or does not know a joint."""
    tree, tied = CompiledTree.of(closure.model), [_tied(closure.model, one) for one in closure.constraints]
    known = [one for one in tied if one is not None]
    return CompiledLoops(tree, known) if tree and len(known) == len(tied) else None


def _tied(model: pin.Model, constraint: Constraint) -> Tied | None:
    if not isinstance(constraint, LoopJoint):
        return None
    one, two = model.frames[constraint.first], model.frames[constraint.second]
    frames, pair = ((one.parentJoint, two.parentJoint), (one.placement, two.placement)), constraint.pair
    if isinstance(pair, LowerPair):
        return Tied(LOWER, *frames, pair.e, pair.w)
    if isinstance(pair, Cross):
        along, about = ORIGINS.copy(), np.zeros((4, 3))
        along[3], about[3] = pair.first, pair.second
        return Tied(UNIVERSAL, *frames, along, about)
    return Tied(ROD, *frames, np.zeros((1, 3)), np.zeros((1, 3))) if isinstance(pair, Tie) else None
