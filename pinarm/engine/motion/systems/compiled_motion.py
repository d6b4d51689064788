"""Motions in compiled code: of trees, and along loops and couplings, where states are closed and singular ones passed.

When a motion begins, what the library says of closed states has to satisfy Pinocchio's equations.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, lru_cache

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.nullspace import RANK, Decomposition
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import mass_matrix
from pinarm.engine.integration.integrator import Interval
from pinarm.engine.kernel.library import (
    SETTLE,
    ClosingStructure,
    Flow,
    FlowStructure,
    HeldEfforts,
    LimitsStructure,
    ProximalStructure,
    address,
    library,
    pointer,
)
from pinarm.engine.kernel.loops import LOWER, ROD, UNIVERSAL, CompiledLoops, LoadedLoops, Tied
from pinarm.engine.kernel.tree import DEGREES, CompiledTree, Followed, LoadedTree
from pinarm.engine.motion.systems import loop_motion
from pinarm.engine.motion.systems.loop_motion import LEAST, MET, LoopMotion, Regularity, places
from pinarm.errors import PinarmError
from pinarm.mechanics.coordinates import Constraint
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.geometry.pairs import LowerPair, Tie
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.mechanics.loops.kinds import ORIGINS, Cross
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import Thread, Tilt
from pinarm.records import Record

Settled = Callable[[Array, Array, Array, Array, Array], tuple[Array, Array, Decomposition]]
"""``(q, v, w, dw, t) -> q, v`` closed, of many states, and the rows there; see ``LoopSystem.settled``."""

State = tuple[Array, Array]
"""Configuration, shape (nq,), and velocity, shape (nv,)."""

PROXIMAL, SOLVED, BESIDE = 1e-10, 1e-12, 20
"""Proximal term of multipliers, relative to the smallest diagonal of ``S = G M^-1 G^T``, what the iteration may leave
of the rows [m/s^2 or rad/s^2], and most iterations. Next to singular positions the least eigenvalue of S comes down to
the term, and each iteration leaves the term, over the sum of both, of what is missing."""

INDEPENDENT = 1e-15
"""Relative proximal term in regular steps with independent rows: it keeps pivots from 0; one iteration is enough."""

TOLERANT, REPEATS = 1e-3, 8
"""Proximal term where rows are dependent only if loops are closed, relative to the least eigenvalue of S that is not 0,
and most iterations: rows that contradict one another within steps do not magnify errors."""

UNEVEN = 1e6
"""Condition number of S, scaled to a diagonal of ones, in the better of two positions of no special kind, above which
rounding is magnified too much. Bodies of one linkage reach 1e4; one 1e8 times lighter than its neighbours, 1e9."""

TRUSTED = 1e-10
"""Smallest eigenvalue of M, scaled to a diagonal of ones, with which M counts as regular."""

ALIKE = 1e-4
"""Relative accuracy of squares of singular values: the limits of the regularity have two digits."""

AGREEMENT = 1e-12
"""Largest residual of Pinocchio's equations: a thousand times the rounding on usual mechanisms, and below what any
tolerance of an integration asks for."""

DISAGREES = "the compiled kernel is not used: its accelerations differ from Pinocchio's by {:.1e}"

IMMOVABLE = 1e20
"""Armature of a driven joint, relative to the largest inertia of the tree: what else acts there is below rounding."""

AWAY, STATES = (0.1, 0.01, 0.0), 2
"""Distances from the initial position at which test states of the library start, in the unit of every velocity: the
first that closes is used; and the number of these states."""


class CompiledMotion(Record, frozen=True):
    """A mechanism in compiled code under its loads, and how its multipliers are solved for.

    Attributes:
        loops: Loops and couplings; ``None`` for a tree that has none.
        term: Proximal term for accelerations of closed states, and for projections [1/kg].
        tree: The tree with its loads; ``alone`` where these are all loads.
        held: The loads that are held between samples, where the library reads them.
    """

    loops: LoadedLoops | None
    measure: Regularity
    term: float
    tree: LoadedTree
    held: HeldEfforts | None
    alone: bool

    @property
    def exact(self) -> ProximalStructure:
        """Proximal iteration for accelerations of closed states."""
        return ProximalStructure(self.term, SOLVED, BESIDE)

    def tolerant(self, q: Array, rank: int) -> ProximalStructure:
        """Return the proximal iteration for accelerations within regular steps from a closed position and its rank."""
        if rank == len(self.measure.kept):
            return ProximalStructure(INDEPENDENT / PROXIMAL * self.term, 0.0, 1)
        return self._tolerant(rank, tuple(q.tolist()))

    @cached_property
    def _tolerant(self) -> Callable[[int, tuple[float, ...]], ProximalStructure]:
        """The iteration with dependent rows, kept for a position: every beginning of a step in Python asks for it."""

        def at(rank: int, q: tuple[float, ...]) -> ProximalStructure:
            delassus = _delassus(self.measure, np.array(q)) if rank and q else None
            if delassus is None:
                return ProximalStructure()
            return ProximalStructure(TOLERANT * float(np.linalg.eigvalsh(delassus)[-rank]), SOLVED, REPEATS)

        return lru_cache(maxsize=1)(at)

    def flow(self, motion: LoopMotion) -> Flow:
        """Return the motion, with the numbers by which that in Python solves, closes and looks."""
        if self.loops is None:
            return self.tree.flow(self.held)
        compiled, coarse = library(), motion.coarse
        assert compiled is not None
        of_motion = (getattr(loop_motion, name) for name in ("NEAR", "AHEAD", "BLIND"))
        limits = LimitsStructure(
            self.measure.usual, *of_motion, RANK**2, ALIKE, loop_motion.ASIDE, tuple(loop_motion.ACROSS),
            loop_motion.PASSED * coarse, loop_motion.FLOOR, self.measure.rank,
        )  # fmt: skip
        gaps = loop_motion.ROUNDED * coarse, loop_motion.STALLED * coarse
        settings = self.exact, self.exact, self.term, *gaps, MET * LEAST, loop_motion.ITERATIONS, limits
        nv, nq = len(motion.scale), motion.rows.model.nq
        buffers = motion.scale.copy(), *(np.zeros(nv) for _ in range(3)), *(np.zeros(nq + nv) for _ in range(2))
        places = dict(zip(("scale", "sum", "part", "aside", "state", "saved"), map(pointer, buffers), strict=True))
        closing = ClosingStructure(self.loops.structure, *settings, **places, t=-np.inf)
        place, functions = ctypes.addressof(closing), map(address, (compiled.closing_rates, compiled.closing_settle))
        structure = FlowStructure(nq + nv, *functions, place + ClosingStructure.floor.offset, place)
        return LoopFlow(structure, (closing, buffers, self.loops), self.held, closing, motion, self)


class LoopFlow(Flow, frozen=True):
    """The motion of loops by the library, which closes states and passes singular positions as the motion in Python.

    That begins it, and settles what the library hands back: states at which the rank has grown, and those whose
    accelerations leave the constraints.
    """

    closing: ClosingStructure
    motion: LoopMotion
    compiled: CompiledMotion

    @property
    def begun(self) -> bool:
        return self.motion.looked

    def ready(self) -> None:
        """Bring the system to the present state of the motion, with the loads in force."""
        super().ready()
        structure, motion = self.closing, self.motion
        structure.near, structure.tolerant = motion.near, self.compiled.tolerant(motion.q, motion.rank)
        structure.regular, structure.limits.rank, structure.open = motion.regular, motion.rank, motion.open
        structure.t, structure.step, structure.floor = motion.t, motion.step, motion.least

    def within(self, start: float) -> None:
        super().within(start)
        self.closing.near = True

    def advanced(self, ends: Sequence[float]) -> None:
        structure, motion = self.closing, self.motion
        motion.near, motion.regular = bool(structure.near), structure.regular
        motion.met = motion.met or bool(structure.met)
        motion.singular, motion.open = motion.regular < loop_motion.NEAR, structure.open
        motion.t, motion.step, motion.least = structure.t, structure.step, structure.floor
        motion.require_known_way(motion.t)


class LoadedMotion:
    """The motion by the library under loads and laws that Python computes: Python takes the steps."""

    def __init__(self, compiled: CompiledMotion, motion: LoopMotion) -> None:
        self.flow, self.motion, self.load = compiled.flow(motion), motion, motion.dynamics.load()
        self.driven = np.array(compiled.measure.driven, dtype=np.intp)
        degrees, self.places = compiled.tree.arrays[DEGREES], scalar_places(motion.rows.model)[self.driven]
        self.efforts: Array = degrees["effort"]
        self.inertia = degrees["armature"][self.driven]
        self.closes = SETTLE(self.flow.structure.settle) if self.flow.settles else None

    def interval(self, start: float, end: float) -> Interval:
        floor, closed = self.floor if self.closes else float, lambda _: self.closed_acceleration
        return Interval(start, end, self.acceleration, self.settle, floor, closed, near=lambda: self.motion.met)

    def floor(self) -> float:
        return float(ctypes.c_double.from_address(self.flow.structure.floor).value)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration; of the first state, and of those that Python has settled, that of Python."""
        if self.motion.looked and t != self.motion.unchecked:
            return self._rates(t, q, v)
        a = self.motion.acceleration(t, q, v)
        self.flow.ready()
        return a

    def _rates(self, t: float, q: Array, v: Array) -> Array:
        self._load(t, q, v)
        return self.flow.rates(t, np.concatenate([q, v]))[len(q) :]

    def _load(self, t: float, q: Array, v: Array) -> None:
        self.efforts[:] = self.load(t, q, v)
        if len(self.driven):
            self.efforts[self.driven] = self.inertia * self.motion.targets(t)[2]

    def settle(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the closed state, by Python where the library hands it back, and choose by it how to go on."""
        if len(self.driven):
            q[self.places], v[self.driven], _ = self.motion.targets(t)
        if self.closes is None:
            return q, v
        self._load(t, q, v)
        y, slope = np.concatenate([q, v]), np.empty(len(q) + len(v))
        if not self.closes(self.flow.structure.system, t, pointer(y), pointer(slope)):
            return self.motion.settle(t, q, v)
        self.flow.advanced([t])
        return y[: len(q)], y[len(q) :]

    def closed_acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return the acceleration of a state that is closed first; see ``LoopMotion.closed_acceleration``."""
        self.flow.within(t)
        a = self._rates(t, q, v)
        self.flow.ready()
        return a


def compiled_motion(
    motion: LoopMotion, settled: Settled, near: Array, laws: Mapping[int, MotionLaw], interval: tuple[float, float]
) -> tuple[CompiledMotion | None, str]:
    """Return a motion in compiled code where Pinocchio agrees, and what is to be said where it does not.

    ``motion`` is that in Python on an interval [s], ``settled`` closes states, ``near`` is a configuration near
    closed ones, shape (nq,); ``laws`` are those of joints that are driven, by index in v. Where the library does not
    know all loads, the motion has none of them.
    """
    measure, dynamics, compiled = motion.measure, motion.dynamics, _loops(motion.measure)
    if compiled is None:
        return None, ""
    places = scalar_places(compiled.tree.model)
    guided = [Followed(v, int(places[v]), law.on(*interval)) for v, law in laws.items()]
    if loaded := compiled.tree.under(dynamics.steady, dynamics.changing, guided):
        return _judged(compiled, *loaded, motion, closed_states(motion, settled, near, interval[0]), near, interval[0])
    if not motion.rows.size:
        return None, ""
    if not measure.bare and (bare := compiled.tree.loaded(np.zeros(len(motion.scale)), ())):
        states = closed_states(motion, settled, near, interval[0])
        measure.bare.append(_judged(compiled, bare, None, motion, states, near, interval[0], alone=False))
    return measure.bare[0] if measure.bare else (None, "")


def _judged(
    compiled: CompiledLoops,
    tree: LoadedTree,
    held: HeldEfforts | None,
    motion: LoopMotion,
    states: Sequence[State],
    near: Array,
    t: float,
    *,
    alone: bool = True,
) -> tuple[CompiledMotion | None, str]:
    """Return a tree with loads, or without any where these are not known, and its loops; and what is to be said."""
    measure, dynamics, loops, term = motion.measure, motion.dynamics, None, 0.0
    if compiled.tied:
        units = measure.closure.scale.copy()
        units[list(measure.driven)] = 0.0
        loops = compiled.loaded(tree, units**2, 1.0 / measure.closure.measure[measure.kept])
        term = _term(measure, near)
    if not states or (compiled.tied and not (loops and term)):
        return None, ""
    known = CompiledMotion(loops, measure, term, tree, held, alone)
    apart = disagreement(known, motion, dynamics if alone else Dynamics.of(dynamics.model), states, t)
    return (known, "") if apart <= AGREEMENT else (None, DISAGREES.format(apart))


def heavy(model: pin.Model, driven: Sequence[int]) -> pin.Model:
    """Return a model with armatures that outweigh the tree at driven joints, by their indices in v."""
    copy = pin.Model(model)
    copy.armature[list(driven)] += IMMOVABLE * float(np.diag(mass_matrix(model, pin.neutral(model))).max(initial=0.0))
    return copy


def scalar_places(model: pin.Model) -> Indices:
    """Return the first place in q of the joint of every velocity, shape (nv,)."""
    places = np.zeros(model.nv, dtype=np.intp)
    for joint in model.joints.tolist()[1:]:
        places[joint.idx_v : joint.idx_v + joint.nv] = joint.idx_q
    return places


@lru_cache(maxsize=16)  # the same for all runs of a mechanism
def _loops(measure: Regularity) -> CompiledLoops | None:
    """Return the loops for the library; ``None`` where it is missing, or does not know one, or rows are too rounded."""
    closure = measure.closure
    tied = [
        record
        for constraint, part in zip(closure.constraints, closure.slices.values(), strict=True)
        if (record := _tied(closure.model, constraint, measure.kept, part)) is None or len(record.along)
    ]
    known = [loop for loop in tied if loop is not None]
    if len(known) < len(tied) or not measure.exact:
        return None
    tree = CompiledTree.of(heavy(closure.model, measure.driven))
    return CompiledLoops.of(tree, known) if tree else None


def _tied(model: pin.Model, constraint: Constraint, kept: Indices, part: slice) -> Tied | None:
    """Return the record of a constraint's kept rows for the library; ``None`` of a kind that the library lacks."""
    rows = kept[(kept >= part.start) & (kept < part.stop)] - part.start
    if isinstance(constraint, Coupling):
        return Tied.coupling(constraint.coordinate.weights[None][rows])
    if not isinstance(constraint, LoopJoint):
        return None
    first, second = model.frames[constraint.first], model.frames[constraint.second]
    frames, pair = ((first.parentJoint, second.parentJoint), (first.placement, second.placement)), constraint.pair
    if isinstance(pair, LowerPair):
        turn = pair.rotation
        axis = pair.axis if isinstance(turn, Tilt | Thread) else np.zeros(3)
        size = turn.offset if isinstance(turn, Thread) else 0.0
        return Tied(LOWER, *frames, pair.e[rows], pair.w[rows], axis, size)
    if isinstance(pair, Cross):
        along, about = ORIGINS.copy(), np.zeros((4, 3))
        along[3], about[3] = pair.first, pair.second
        return Tied(UNIVERSAL, *frames, along[rows], about[rows])
    nothing = np.zeros((len(rows), 3))
    return Tied(ROD, *frames, nothing, nothing, size=pair.length) if isinstance(pair, Tie) else None


def _term(measure: Regularity, near: Array) -> float:
    """Return the proximal term by ``G M^-1 G^T`` [1/kg]; 0 where M is singular, or bodies differ too much."""
    uneven, here = list[float](), _delassus(measure, near)
    for delassus in (_delassus(measure, q) for q in places(measure.closure)):
        if delassus is None or here is None:
            return 0.0
        size = np.sqrt(np.diag(delassus))
        values = np.linalg.eigvalsh(delassus / np.outer(size, size))
        uneven.append(float(values[-1] / max(values[-measure.rank], np.finfo(float).tiny)))
    if here is None or not min(uneven) <= UNEVEN:
        return 0.0
    diagonal = np.diag(here)
    return PROXIMAL * float(diagonal[diagonal > RANK**2 * diagonal.max()].min())


def _delassus(measure: Regularity, q: Array) -> Array | None:
    """Return ``G M^-1 G^T`` of the rows that are kept, shape (k, k); ``None`` where M is singular."""
    closure, free = measure.closure, np.delete(np.arange(measure.closure.model.nv), measure.driven)
    rows, mass = closure.rows(closure.state(q))[measure.kept][:, free], mass_matrix(closure.model, q)[free][:, free]
    size = np.sqrt(np.diag(mass))
    if not (size > 0.0).all() or np.linalg.eigvalsh(mass / np.outer(size, size))[0] < TRUSTED:
        return None
    return np.asarray(rows @ np.linalg.solve(mass, rows.T))


def closed_states(motion: LoopMotion, settled: Settled, near: Array, t: float) -> list[State]:
    """Return closed states near a configuration, of no special kind and the same every time."""
    k, states, scale, (w, dw, _) = np.arange(len(motion.scale)), list[State](), motion.scale, motion.targets(t)
    for i in range(STATES):
        v = scale * np.cos(2.0 + 3.7 * i + 2.9 * k)
        for away in AWAY:
            q = pin.integrate(motion.rows.model, near, away * scale * np.sin(1.0 + 7.1 * i + 1.3 * k))
            try:
                closed, rates, _ = settled(q[None], v[None], w[None], dw[None], np.array([t]))
            except (PinarmError, np.linalg.LinAlgError):
                continue
            states.append((closed[0], rates[0]))
            break
    return states


def disagreement(
    compiled: CompiledMotion, motion: LoopMotion, dynamics: Dynamics, states: Sequence[State], t: float
) -> float:
    """Return the residual of Pinocchio's equations for the library's a and lam, the largest over some states.

    ``M a + nle - tau - G^T lam`` and ``G a + G' v``, each relative to the sizes of its factors. The motion of the free
    tree and ``M^-1 G^T lam`` cancel in a, so G times the latter is a term as well. The condition of the equations,
    which grows without bound near singular positions, does not enter; nor do efforts of joints that follow laws, which
    have to have the accelerations of these.
    """
    flow, measure, model, data, worst = compiled.flow(motion), compiled.measure, dynamics.model, dynamics.data, [0.0]
    flow.ready()
    if isinstance(flow, LoopFlow):
        flow.closing.near, flow.closing.tolerant = 0, compiled.exact
    closure, driven = measure.closure, list(measure.driven)
    free, still = np.delete(np.arange(model.nv), driven), np.zeros(model.nv)
    for q, v in states:
        a = flow.rates(t, np.concatenate([q, v]))[model.nq :]
        lam = compiled.loops.multipliers if compiled.loops else np.zeros(0)
        load = dynamics.load()(t, q, v)
        nle = np.array(pin.nonLinearEffects(model, data, q, v))
        inertial, state = np.array(pin.rnea(model, data, q, v, a)) - nle, closure.state(q, v)
        matrix, drift = closure.rows(state)[measure.kept], closure.drift(state)[measure.kept]
        held, largest = matrix.T @ lam, _size(matrix)
        moved = np.array(pin.aba(model, data, q, still, held)) - pin.aba(model, data, q, still, still)
        moving = _size(a) + _size(moved) + _size(np.array(pin.aba(model, data, q, v, load)))
        sizes = _size(inertial[free]) + largest * _size(lam) + _size(nle - load)
        worst.append(_size((inertial + nle - load - held)[free]) / max(sizes, np.finfo(float).tiny))
        sizes = largest * moving + _size(drift)
        worst.append(_size(matrix @ a + drift) / max(sizes, np.finfo(float).tiny))
        if driven and compiled.alone:
            worst.append(_size(a[driven] - motion.targets(t)[2]) / max(moving, np.finfo(float).tiny))
    return float(np.max(worst))  # NaN included


def _size(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
