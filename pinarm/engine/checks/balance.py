"""Residuals of energy and power, independent of the solver."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.geometry.vectors import crossed, joined, lengths, moved
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Solution
    from pinarm.engine.motion.segmented.segments import SegmentedMotion

SAMPLE = 64
"""Number of rows that are checked where not all are."""

Whole = Callable[[Array, Array, Array], tuple[Array, Array]]
"""Rows of integrated states to rows of those of the mechanism: ``t, q, v -> q, v``."""

ROUNDING = 1e-15
"""Of an energy, relative to it: a motion so short that it exchanges no more has not lost any."""

LOST = 1e-3
"""Energy that nothing accounts for, relative to the energy exchanged, from which on it is noted, and contradicts bounds
of the error that are far below it. Rounding alone may make up any figure below it, and no figure above: it is left out
there."""

SHARED = 1e-3
"""Part of the largest terms of all joints that loops and couplings tie to one another that the terms of each count with
at least: multipliers that would be 0 are the rounding of those."""

FINE = 2000
"""Steps between samples of controllers from which on each is one part: they are short beside the motion."""

STEPS, GAUSS_NODES = 8, 4
"""Steps within which the energy is looked at, evenly, besides those that have been looked into, as for rows of the
table: there the dense output errs more than at their ends. Nodes of the quadrature of dissipated power over a part of a
step: degree 7, the order of the dense output."""


def relative(residuals: Array, terms: Array) -> Array:
    """Return the largest residual of all rows relative to the largest term, shape (n, ..) to (..); 0 without terms."""
    worst, largest = residuals.max(axis=0, initial=0.0), terms.max(axis=0, initial=0.0)
    return np.asarray(np.divide(worst, largest, out=np.zeros(np.shape(largest)), where=largest != 0.0))


def plain(figures: Mapping[str, Array | float]) -> dict[str, float]:
    """Return the figures of a single mechanism, shape (), as Python's numbers."""
    return {name: float(figure) for name, figure in figures.items()}


@lru_cache(maxsize=256)
def sampled(rows: int, most: int = SAMPLE) -> Indices:
    """Return the indices of the rows that are checked, ascending, shape (n,): all if there are no more than ``most``.

    Every check of a run takes the same, so that what one computes of them serves the others; to be read only.
    """
    places = np.arange(rows) if rows <= most else np.linspace(0, rows - 1, most).astype(np.intp)
    places.flags.writeable = False
    return places


def power_balance(trajectory: Trajectory, most: int = SAMPLE) -> dict[str, Array]:
    """Return the largest violation of d'Alembert's principle, and of the balance of power, relative to their terms.

    For every unit velocity e_k the virtual power of the efforts and loads must equal that of the bodies' momentum
    rates less their weights: ``sum_i J_i^T (I_i A_i + V_i x* I_i V_i)``, with the Jacobians J_i of the bodies and
    their twists from forward kinematics. The recursions that solved the motion pass inertias from link to link in the
    frames of these; here wrenches are summed in world axes, link by link.

    Returns:
        ``equilibrium``: largest residual of a joint relative to its own terms, the largest over the rows, and at least
        to a part ``SHARED`` of those of the joints that it is tied to; see ``virtual_powers``. ``power``: largest
        residual of power along the motion, relative to the largest sum of its terms. Powers count with what every
        link's wrenches could do at its speed, ``|f| |v| + |n| |omega|``: in a steady precession, which exchanges no
        power, they are at right angles, and their joints' powers are rounding. Nothing where no efforts were asked for.
        Shape (), or (k,) of variants.
    """
    if trajectory.no_efforts:
        return {}
    run = trajectory.looked_at(sampled(len(trajectory), most))
    rows = np.arange(len(run))
    parts = [virtual_powers(run.looked_at(rows[k : k + SAMPLE])) for k in range(0, len(rows), SAMPLE)]
    residuals, terms, most_powers = parts[0] if len(parts) == 1 else map(np.concatenate, zip(*parts, strict=True))
    powers, scale = np.vecdot(residuals, run.v), np.vecdot(terms, np.abs(run.v)) + most_powers
    terms = np.maximum(
        terms, SHARED * _largest_of_groups(terms * run.closure.scale, run.closure.groups) / run.closure.scale
    )
    return {
        "equilibrium": relative(np.abs(residuals), terms).max(axis=-1, initial=0.0),
        "power": relative(np.abs(powers), scale),
    }


def _largest_of_groups(terms: Array, groups: Indices) -> Array:
    """Return the largest of the terms, shape (n, .., nv), of all rows and of the group to which each belongs."""
    largest = np.zeros_like(terms[:1].T)
    np.maximum.at(largest, groups, terms.max(axis=0, keepdims=True, initial=0.0).T)
    return np.asarray(largest[groups].T)


def virtual_powers(run: Trajectory) -> tuple[Array, Array, Array]:
    """Return the residual of virtual power for every unit velocity, the size of its terms, and a power.

    Two of shape (n, nv) [W per rad/s or m/s], and the most power that the links' wrenches could have at their speeds,
    shape (n,) [W].
    """
    loads = run.gather(lambda dynamics, part: dynamics.loads(run.grid.t[part], run.q[part], run.v[part]))
    own = run.gather(lambda dynamics, part: dynamics.load_sizes(run.grid.t[part], run.q[part], run.v[part]))
    wrenches, sizes, held = run.closure.acting(run.link_motion[0], run.q, run.lam)
    demanded, terms, most = demanded_powers(run.link_motion, run.demands, wrenches, sizes)
    supplied = run.tau, loads, run.friction_loads, held, -run.mechanism.model.armature * run.a
    return sum(supplied) - demanded, sum(map(np.abs, supplied)) + own + terms, most


def demanded_powers(
    motion: tuple[LinkPlacements, Array, Array, Array], demands: Array, wrenches: Array, sizes: Array
) -> tuple[Array, Array, Array]:
    """Return the virtual power that the motion of the links asks for beside that of wrenches which act on them.

    With what wrenches of their sizes could do at most: ``|f| (|d| + l |w|) + |m| |w|`` for a joint whose unit velocity
    turns the links beyond with w and moves its own origin with d, l being the way along the links from there to the
    origin of the link. Forces that the motion demands have the distance of the centre of mass as an arm besides. So
    terms that vanish in a position, such as the moment of a weight about the joint above it, have a size to compare
    with.

    Args:
        motion: Placements of the links, their twists, the rates of these, and the columns of the world Jacobian.
        demands: What it demands of the links in their own frames, in parts, shape (3, n, .., njoints, 6).
        wrenches: [f; m] at the origins of the links, world axes, shape (n, .., njoints, 6).
        sizes: Of the forces and moments that they are the sums of, shape (n, .., njoints, 2).

    Returns:
        Two of shape (n, .., nv) [W per rad/s or m/s], and ``|f| |v| + |m| |omega|`` of all links, shape (n, ..) [W],
        f and m being what their motion demands.
    """
    links, twists, _, columns = motion
    tree, ways, own = LinkTree.of(links.model), columns.swapaxes(-2, -1), lengths(demands).sum(axis=0)
    demanded, bounds = links.outwards(demands.sum(axis=0)) - wrenches, sizes + own
    bounds[..., 1] += np.linalg.norm(tree.levers, axis=-1) * own[..., 0]
    forces, most = (sums[..., tree.moved, :] for sums in _carried(links, tree, demanded, bounds))
    turning = ways[..., 3:]
    speeds = joined(ways[..., :3] + crossed(turning, links.places[..., tree.moved, :]), turning)
    return np.vecdot(forces, speeds), np.vecdot(most, lengths(speeds)), np.vecdot(own, lengths(twists)).sum(axis=-1)


def _carried(links: LinkPlacements, tree: LinkTree, wrenches: Array, sizes: Array) -> tuple[Array, Array]:
    """Return the sums over every link and those beyond it about the link's origin, of wrenches and of their sizes."""
    forces, bounds = wrenches.copy(order="K"), sizes.copy(order="K")
    arms = links.places - links.places[..., tree.parents, :]
    ways = np.sqrt(np.vecdot(arms, arms))
    for link in range(len(tree.parents) - 1, 0, -1):
        parent, force, bound = tree.parents[link], forces[..., link, :], bounds[..., link, :]
        forces[..., parent, :] += moved(force, arms[..., link, :])
        bounds[..., parent, :] += bound
        bounds[..., parent, 1] += ways[..., link] * bound[..., 0]
    return forces, bounds


class EnergyAccount(Record, frozen=True):
    """Energy balance of an integrated motion, from its steps and the dynamics of every interval.

    ``divided`` are steps within which the energy is looked at, too: those that rows of the table have been taken from.
    """

    solution: Solution
    dynamics: list[Dynamics]
    whole: Whole = lambda t, q, v: (q, v)
    divided: Sequence[int] = ()

    @classmethod
    def each(cls, motion: SegmentedMotion) -> list[EnergyAccount]:
        """Return the energy balances of the segments of a motion."""
        accounts = []
        for part in motion.segments:
            dynamics = part.system.acting(motion.dynamics)
            bound = [dynamics.on(x.start, min(x.end, part.solution.end)) for x in part.solution.intervals]
            accounts.append(cls(part.solution, bound, part.system.whole, part.solution.interpolated_steps))
        return accounts

    def columns(self) -> tuple[Array, Array, Array]:
        """Return kinetic, potential and so far dissipated energy [J] at the ends of all parts, each of shape (n,)."""
        varying, count = [dynamics.exchanging for dynamics in self.dynamics], len(self.solution.steps)
        looked_into = np.arange(count) if any(varying) else sampled(count, STEPS)
        index, start, h = self._parts(sorted({*self.divided, *looked_into.tolist()}))
        owners = self.solution.owners(index)
        ends, last = np.append(start, self.solution.end), index[-1:]
        q, v = self.whole(ends, *self.solution.states_in(np.concatenate([index, last]), ends))
        kinetic, potential = self.dynamics[0].energy(q, v)
        lost = np.zeros(len(h))
        for number, (dynamics, changing) in enumerate(zip(self.dynamics, varying, strict=True)):
            rows = np.flatnonzero(owners == number)
            if dynamics.steady.any() and q.shape == v.shape:
                lost[rows] -= np.diff(q, axis=0)[rows] @ dynamics.steady
            for held in dynamics.held if q.shape == v.shape else ():
                changes = np.array([held.piece(t) for t in start[rows].tolist()], dtype=np.intp)
                lost[rows] -= np.vecdot(np.diff(q, axis=0)[rows], held.load_of(changes))
            if changing and len(rows):  # an event may have ended the motion before this interval
                lost[rows] += self._losses(changing, index[rows], start[rows], h[rows])
        return kinetic, potential, np.concatenate([[0.0], np.cumsum(lost)])

    @cached_property
    def _sampled(self) -> bool:
        return any(interval.sampling for interval in self.solution.intervals)

    def _parts(self, divided: list[int]) -> tuple[Indices, Array, Array]:
        """Return the step of every part, its start and its length [s], each of shape (n,)."""
        steps = self.solution.steps
        counts = np.ones(len(steps), dtype=np.intp)
        if not self._sampled or len(divided) < FINE:
            counts[divided] = self.solution.method.subdivisions
        index = np.arange(len(steps)).repeat(counts)
        part = np.arange(len(index)) - (counts.cumsum() - counts)[index]
        h = ((steps.until - steps.t) / counts)[index]
        return index, steps.t[index] + part * h, h

    def _losses(self, dynamics: Dynamics, index: Indices, start: Array, h: Array) -> Array:
        """Return the energy that elements take out in parts of steps [J], shape (n,)."""
        nodes, weights = gauss()
        t = (start[:, None] + 0.5 * h[:, None] * (nodes + 1.0)).ravel()
        q, v = self.whole(t, *self.solution.states_in(np.repeat(index, GAUSS_NODES), t))
        return np.asarray(0.5 * h * (dynamics.dissipated_power(t, q, v).reshape(-1, GAUSS_NODES) @ weights))


@cache
def gauss() -> tuple[Array, Array]:
    """Return the Gauss nodes from -1 to 1 and their weights, which take 0.1 ms."""
    return np.polynomial.legendre.leggauss(GAUSS_NODES)


def energy_balance(*accounts: EnergyAccount) -> dict[str, float]:
    """Return the largest change of energy that nothing accounts for, at the ends of all steps and within some.

    ``E(t) - E(0) + integral of the dissipated power``, at least the rounding of its terms, relative to the largest
    energy exchanged: between kinetic and potential, and through dampers and drives. For a motion without loads it is
    the drift of the energy. Where a motion has several parts, what impacts between them take is none of its errors.
    Nothing where so little is exchanged, at rest or by a very small motion, that ``LOST`` of it is rounding: it is
    unknown.
    """
    columns = [np.array(account.columns()) for account in accounts if account.solution.steps]
    if not columns:
        return {}
    drift, largest = 0.0, 0.0
    for parts in columns:
        here = drift + (parts - parts[:, :1]).sum(axis=0)
        largest, drift = max(largest, float(np.abs(here).max())), float(here[-1])
    energy = float(unaccounted(np.array(largest), np.concatenate(columns, axis=1)))
    return {} if np.isnan(energy) else {"energy": energy}


def unaccounted(largest: Array, columns: Array) -> Array:
    """Return the largest change of energy that nothing accounts for relative to what is exchanged, shape (..).

    NaN where it is unknown.

    Args:
        largest: That change [J], shape (..).
        columns: Kinetic, potential and so far dissipated energy [J], shape (3, n, ..).
    """
    most, least = columns.max(axis=1), columns.min(axis=1)
    sizes = np.maximum(most, -least)
    exchanged = np.maximum((most - least).max(axis=0), sizes[0])
    rounding = ROUNDING * sizes.max(axis=0)
    known = exchanged * LOST > rounding
    return np.where(known, np.maximum(largest, rounding) / np.where(known, exchanged, 1.0), np.nan)
