"""Residuals of a table, and limits that it goes beyond.

Residuals are the closure of loops, regularity of positions, condition of masses, and forward dynamics. A fixed, even
choice of rows is checked, so that the cost of large tables stays bounded. A run is not held to limits of joints, cams,
cables and belts, but they are reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.engine.checks.balance import SAMPLE, relative, sampled
from pinarm.engine.constraints.constraint_rows import one_sided
from pinarm.engine.constraints.nullspace import RANK, UNCLOSED
from pinarm.engine.dynamics.equation import MASSLESS, NOTHING
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import PinarmError
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.mechanics.coordinates import Constraint
from pinarm.mechanics.couplings.coupling import cams_of
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.joints import RADIAN, Joint, effort_unit
from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.motion.outcome import SolvedMotion


NUMBERS, FEWEST = 8_000_000, 4
"""Numbers of the matrices of all rows that are looked at together, and rows that are looked at in any case."""

CLOSURE = "closure", "closure rate", "closure acceleration"

LARGEST = 2000
"""Velocities up to which the masses of a mechanism are judged: the eigenvalues of larger ones take minutes."""


def residual_figures(run: Trajectory, motion: SolvedMotion | None = None, most: int = SAMPLE) -> dict[str, Any]:
    """Return the residuals of the rows of a run, with its regularity and condition.

    Args:
        motion: The motion of these states; if given, regularity is sought between rows too.
        most: Largest number of rows to check.

    Returns:
        Of rows at which all constraints hold: ``closure``, ``closure rate`` and ``closure acceleration``: largest gap
        of a loop [m or rad], and of its two derivatives. ``regularity``: smallest singular value of the constraints'
        rows relative to the largest, of as many as are independent at any row, sought between rows where it becomes
        small; 0 at a singular position. ``least regular at``: its place. ``relative regularity``: the smallest
        singular value there relative to its largest value in the run. ``condition``: largest condition number of the
        mass matrix of the free motions, scaled to a diagonal of ones. ``return trip``: largest difference of the
        accelerations that the efforts give by forward dynamics to those of the table, relative to the largest
        acceleration that efforts and loads would give if none of them cancelled; weights count with the most that they
        can do, ``g sqrt(m M_kk)`` for the mass m of all bodies (Cauchy-Schwarz), and forces of a motion at constant
        rates, which cancel in a steady precession, with ``omega sqrt(2 T M_kk)`` for the largest angular velocity omega
        of a body and the kinetic energy T. The last two are arrays, of variants of shape (k,), NaN where M is singular.
    """
    if run.no_efforts and not run.mechanism.closure.size:
        return {}
    nv, m = int(run.mechanism.model.nv), run.mechanism.closure.size
    rows = sampled(len(run), max(FEWEST, min(most, NUMBERS // max(1, nv * max(nv, m)))))
    if run.opened is not None:  # what is open is not to be closed
        rows = rows[~run.opened[rows]]
    if not len(rows):
        return {}
    checked, own = run.looked_at(rows), run.mechanism.closure
    (gaps, matrices), drift = checked.closure.at(checked.q), checked.closure.drifts(checked.q, checked.v)[..., :m]
    figures = dict[str, Any]()
    if m:
        g = matrices[..., :m, :]
        parts = gaps[..., :m], np.matvec(g, checked.v), np.matvec(g, checked.a) + drift
        largest = {name: _largest(part) for name, part in zip(CLOSURE, parts, strict=True)}
        figures = {name: gap for name, gap in largest.items() if not (run.unknown and np.isnan(gap).any())}
        figures |= nearest_singularity(run, motion, rows, own.values_of(g))
    if run.no_efforts or nv > LARGEST:
        return figures
    along, mass = checked.lam[..., m:], checked.dynamics.mass_matrices(checked.q)
    guided = np.vecmat(along, matrices[..., m:, :]) if along.size else np.zeros_like(checked.v)
    split = own.split(matrices[..., :m, :]) if m else None
    alike = [*split.by_freedom()] if split else [(np.arange(len(rows)), None)]
    particular = split.particular(-drift) if split else np.zeros_like(checked.v)
    condition = np.max([condition_along(mass[some], free) for some, free in alike], axis=0)
    if not np.isfinite(condition).all():
        return figures
    trips = (
        _return_trip(checked.looked_at(some), mass[some], free, particular[some], guided[some]) for some, free in alike
    )
    error, size = (np.array(parts) for parts in zip(*trips, strict=True))
    return figures | {"condition": condition, "return trip": relative(error, size)}


def _return_trip(
    run: Trajectory, mass: Array, free: Array | None, particular: Array, guided: Array
) -> tuple[Array, Array]:
    """Return the largest difference of accelerations, and the largest one that efforts and loads could give.

    Args:
        run: Rows with as many free motions, of which there are more at singular positions.
        mass: M, shape (n, .., nv, nv).
        free: T, bases of the free motions, shape (n, .., nv, f); ``None`` for the identity.
        particular: The shortest accelerations that the constraints allow, shape (n, nv).
        guided: Loads of the drives along task coordinates, shape (n, nv).
    """
    t, q, v, still = run.grid.t, run.q, run.v, np.zeros_like(run.a)
    resisting = run.gather(lambda dynamics, part: dynamics.inverse(t[part], q[part], v[part], still[part]))
    sizes = run.gather(lambda dynamics, part: dynamics.load_sizes(t[part], q[part], v[part]))
    supplied = run.tau + run.friction_loads + guided
    turning = run.link_motion[1][..., 3:]
    omega = np.sqrt((turning * turning).sum(axis=-1).max(axis=-1))
    whirl = omega * np.sqrt(np.maximum(np.vecdot(v, np.matvec(mass, v)), 0.0))
    pull = run.mechanism.gravity * np.sqrt(LinkTree.of(run.mechanism.model).mass)
    levers = np.sqrt(np.maximum(mass.diagonal(axis1=-2, axis2=-1), 0.0))
    left = supplied - resisting - np.matvec(mass, particular)
    most = np.abs(supplied) + np.abs(resisting) + sizes + (pull + whirl)[..., None] * levers
    if free is None:
        both = np.linalg.solve(mass, np.stack([left, most], axis=-1))
    else:
        along = np.stack([np.vecmat(left, free), np.vecmat(most, np.abs(free))], axis=-1)
        both = free @ np.linalg.solve(free.swapaxes(-2, -1) @ mass @ free, along)
    return _largest(particular + both[..., 0] - run.a), np.maximum(_largest(run.a), _largest(both[..., 1]))


def condition_along(mass: Array, free: Array | None = None) -> Array:
    """Return the largest condition number of masses along free motions, infinite if one is singular, shape (..).

    Coordinates are scaled so that M has a diagonal of ones, and T is a basis of right angles then: which basis is given
    has no part in it. A motion may move no mass at some positions only, such as a light crank at the dead centre of its
    slider.
    """
    square = np.maximum(mass.diagonal(axis1=-2, axis2=-1), 0.0)
    idle = square <= NOTHING * square.max(axis=(0, -1), keepdims=True, initial=0.0)
    size = np.sqrt(np.where(idle, 1.0, square))
    along, massless = mass / (size[..., :, None] * size[..., None, :]), idle.any(axis=-1)
    if free is not None:
        ways = np.where(idle, 0.0, size)[..., None] * free
        lengths = np.linalg.norm(ways, axis=-2, keepdims=True)  # units may lie many orders apart
        basis, triangle = np.linalg.qr(ways / np.where(lengths > 0.0, lengths, 1.0))
        pivots = np.abs(triangle.diagonal(axis1=-2, axis2=-1))
        massless = (pivots**2 <= NOTHING).any(axis=-1)
        along = basis.swapaxes(-2, -1) @ along @ basis
    if not along.shape[-1]:
        return np.ones(along.shape[1:-2])
    values = np.asarray(np.linalg.eigvalsh(along))
    least, most = values[..., 0], values[..., -1]
    massless |= ~(least > MASSLESS)
    return np.asarray(np.where(massless, np.inf, most / np.where(massless, 1.0, least)).max(axis=0))


def _largest(x: Array) -> Array:
    """Return the largest size in all rows and velocities, shape (n, .., nv) to (..)."""
    return np.asarray(np.abs(x).max(axis=(0, -1), initial=0.0))


NEAR = 0.1
"""Regularity at the rows from which on it is looked for between them."""

ROUNDS, PLACES = 7, 21
"""Times that the interval about the least regularity is divided, and places in it: 1e-7 of it are resolved."""

SAME = 1e-9
"""Difference of regularities, relative to them, that is rounding: of positions that a motion takes twice the first
counts, whatever the processor."""


def nearest_singularity(
    run: Trajectory, motion: SolvedMotion | None, rows: Indices, values: Array
) -> dict[str, float | Array]:
    """Return where a run is nearest to a singular position; see ``residual_figures``.

    The regularity is ``s_r / max s_1``, s being the singular values of G in descending order, r its rank, and
    ``max s_1`` the largest in the run: a single row has one singular value, which vanishes at a singular position like
    any other. Relative to the largest s_r in the run it is 1 where the loops transmit alike everywhere, however large
    or small the ratios of gears and arms are.

    Args:
        motion: What they are states of; none where nothing is looked for between rows.
        rows: Those of its rows that have been looked at, shape (n,).
        values: Singular values of the constraints there, descending, shape (n, s), of variants (n, k, s): what is told
            of these has the shape (k,), and is NaN where it would have to be looked for between rows.
    """
    closure, t = run.mechanism.closure, run.grid.t[rows]
    rank, shape = closure.rank(values), values.shape[1:-1]
    t = np.broadcast_to(t.reshape(len(t), -1), (len(t), *shape)) if shape else t
    if not rank:  # a second bearing in line with the first holds nothing that could be lost
        ones = np.ones(shape)
        return {"regularity": ones, "least regular at": t[0] * ones, "relative regularity": ones}
    largest = values[..., 0].max(axis=0)
    regular = values[..., rank - 1] / largest
    first = np.asarray(np.argmax(regular <= (1.0 + SAME) * regular.min(axis=0), axis=0))
    least, at = (np.take_along_axis(x, first[None], axis=0)[0] for x in (regular, t))
    inside = (first > 0) & (first < len(t) - 1) & (least > RANK) & (least < (RANK if run.separate else NEAR))
    if shape:
        least = np.where(inside, np.nan, least)
    elif inside and motion is not None:
        ends = float(t[first - 1]), float(t[first + 1])
        least, at = _between(lambda x: closure.values(motion.positions(x))[:, rank - 1] / largest, *ends, least, at)
    return {"regularity": least, "least regular at": at, "relative regularity": least / regular.max(axis=0)}


def _between(
    regularity: Callable[[Array], Array], start: float, end: float, least: Array, at: Array
) -> tuple[Array, Array]:
    """Return the least regularity between two values of the parameter, and its place, or those known already."""
    best = float(least), float(at)
    for _ in range(ROUNDS):
        t = np.linspace(start, end, PLACES)
        try:
            values = regularity(t)
        except PinarmError:  # singular: nothing closer can be looked at
            break
        k = int(values.argmin())
        best = min(best, (float(values[k]), float(t[k])))
        start, end = float(t[max(k - 1, 0)]), float(t[min(k + 1, PLACES - 1)])
    return np.array(best[0]), np.array(best[1])


ROUNDED = 1e-13
"""Gap of a row by rounding, relative to the length that it can have: 64-bit numbers round by 1e-16 in each step."""


def unclosed(run: Trajectory) -> list[str]:
    """Return a note on loops that stay open by more than the rounding of numbers; empty if all close."""
    closure = run.mechanism.closure
    if not closure.size:
        return []
    rows = sampled(len(run))
    gaps = closure.at(run.q[rows])[0]
    if (np.abs(gaps) <= ROUNDED * closure.reach).all():  # nearly always
        return []
    left = np.abs(gaps - closure.split_at(run.q[rows]).reached(gaps))
    worst = left.max(axis=0)
    if (worst <= ROUNDED * closure.reach).all():
        return []
    from pinarm.engine.constraints.self_stresses import mobility_of

    mobility = mobility_of(run.mechanism, run.q[rows[left.max(axis=1).argmax()]])
    torn: dict[str, float] = {}
    for (constraint, row), size, reach in zip(closure.owners(), worst.tolist(), closure.reach.tolist(), strict=True):
        if size > ROUNDED * reach:
            owner = f"{constraint.unit(row)} of {constraint.name}"
            torn[owner] = max(size, torn.get(owner, 0.0))
    said = ", ".join(f"{size:.2g} {owner}" for owner, size in torn.items())
    return [
        f"loops close but for {said}: up to {UNCLOSED:g} of the extent, or rad, counts as rounding of the file; "
        f"{mobility.shared}"
    ]


ROUNDING = 1e-9
"""Part of a limit by which it may be passed: a motion that ends at a limit ends there to rounding."""


class Excess(ValueRecord, frozen=True):
    """A limit that a run goes beyond.

    Attributes:
        joint: Name of the joint, the cam, the cable or the belt.
        of: ``position``, ``velocity`` or ``effort``; ``contact`` of a cam or a cable that would have to act against its
            sense, ``tension`` of a belt with a slack strand, ``outline`` of a cam that cannot be made.
        limit: The limit; that of velocities and efforts holds both ways.
        value: The value farthest beyond it, with its sign, for ``contact`` between the rows too.
        at: Parameter of the first row beyond it; where no row is, of the largest value.
        sentence: What happens, with ``{where}`` and ``{count}`` in place of the parameter and the number of rows.
    """

    joint: str
    of: str
    unit: Unit
    limit: float
    value: float
    at: float
    rows: int
    sentence: str

    def words(self, run: Trajectory) -> str:
        """Return it as a sentence."""
        where = f"{run.parameter} = {self.at:.6g} {'' if str(run.unit) == '1' else run.unit}".rstrip()
        return self.sentence.replace("{where}", where).replace("{count}", f"({self.rows} of {len(run)} rows)")


Highest = Callable[[Callable[[Trajectory], Array]], Trajectory]
"""A function of rows, of shape (n,) for n of them -> the row of a run at which it is largest, between its rows too."""


def highest_row(run: Trajectory, height: Callable[[Trajectory], Array]) -> Trajectory:
    """Return the row at which a function of rows is largest."""
    return run.some(np.array([height(run).argmax()]))


def excesses(run: Trajectory, highest: Highest | None = None) -> list[Excess]:
    """Return the limits that a run goes beyond, joint by joint; efforts are those of drives, or of couplings.

    Then cams and cables that would have to act against their sense, belts with a slack strand, and cams that cannot be
    made.

    Args:
        highest: Finds what is largest between the rows too, for cams and cables; the rows alone where it is left out.
    """
    limits = [excess for joint in run.mechanism.joints.values() for excess in _of_joint(run, joint)]
    return [*limits, *_openings(run, highest or partial(highest_row, run)), *_slack_belts(run), *_flaws(run)]


def beyond_points(run: Trajectory) -> list[str]:
    """Return a note for each load that is used beyond the points of its law: there it goes on with its last slope."""
    return [
        f"the law of the force '{name}' leaves its points: {said}, beyond them with its last slope"
        for name, force in run.dynamics.forces.items()
        if (law := force.law) is not None and (said := law.beyond(run.grid.t, run.q))
    ]


def _of_joint(run: Trajectory, joint: Joint) -> Iterator[Excess]:
    model, q, v = run.mechanism.model, run.q[:, joint.q], run.v[:, joint.v]
    low, high = model.lowerPositionLimit[joint.q], model.upperPositionLimit[joint.q]
    fastest, most = model.velocityLimit[joint.v], model.effortLimit[joint.v]
    tau = run.effort(joint.v) if np.isfinite(most) else run.tau[:, joint.v]
    rate = unit("rad/s") if joint.unit == RADIAN else joint.unit / unit("s")
    for of, measure, limit, values, beyond in (
        ("position", joint.unit, low, q, low - q),
        ("position", joint.unit, high, q, q - high),
        ("velocity", rate, fastest, v, np.abs(v) - fastest),
        ("effort", effort_unit(joint.unit), most, tau, np.abs(tau) - most),
    ):
        rows = np.flatnonzero(beyond > ROUNDING * max(abs(limit), 1e-3))  # infinite limits are not passed
        if len(rows):
            value = float(values[beyond.argmax()])
            passes = "is below" if of == "position" and value < limit else "exceeds"
            text = f"joint {joint.name}: {of} {value:.6g} {measure} {passes} its limit {limit:.6g} {measure}, first at "
            yield Excess(joint.name, of, measure, float(limit), value, *_first(run, rows), text + "{where} {count}")


def _first(run: Trajectory, rows: Indices) -> tuple[float, int]:
    return float(run.grid.t[rows[0]]), len(rows)


def _openings(run: Trajectory, highest: Highest) -> Iterator[Excess]:
    """Yield cams and cables that would have to pull, or push, where they cannot: the limit is 0."""
    for tie in () if run.no_efforts else one_sided(run.mechanism.constraints):
        pull = partial(_pull, tie)
        pulls, worst = pull(run), highest(pull)
        rows, most = np.flatnonzero(pulls > ROUNDING * np.abs(pulls).max()), float(pull(worst)[0])
        if most <= ROUNDING * max(most, float(np.abs(pulls).max())):
            continue
        first = run.some(rows[:1]) if len(rows) else worst
        where = "first at {where} {count}" if len(rows) else "between two rows, most at {where}"
        act = f"would have to {'push' if tie.kind == 'cable' else 'pull'} with {most:.6g} {tie.push_unit()}"
        sentence = f"{tie.kind} {tie.name} {act}: {tie.opens}, {where}; from there on it moves otherwise"
        at = float(first.grid.t[0])
        yield Excess(tie.name, "contact", tie.push_unit(), 0.0, -most, at, len(rows), sentence)


def _pull(tie: Constraint, run: Trajectory) -> Array:
    """Return with what a one-sided constraint acts against its sense, shape (n,)."""
    return -tie.push(run.q, run.lam[:, run.closure.slices[tie.name].start])


def _slack_belts(run: Trajectory) -> Iterator[Excess]:
    """Yield the belts whose pretension a run uses up; chains, which have none, have a slack strand at all times."""
    if run.no_efforts or not run.mechanism.relations:
        return
    from pinarm.mechanics.couplings.coupling import Coupling
    from pinarm.mechanics.couplings.transmissions import Strands

    for tie in run.mechanism.relations:
        known = tie.transmission if isinstance(tie, Coupling) else None
        if not isinstance(known, Strands):
            continue
        apart = np.abs(known.difference * run.lam[:, run.closure.slices[tie.name].start])
        rows, limit = np.flatnonzero(apart > 2.0 * known.pretension * (1.0 + ROUNDING)), known.pretension
        if len(rows) and limit:
            most = float(apart.max())
            sentence = (
                f"belt {tie.name}: a strand is slack, as the tensions differ by {most:.6g} N, more than twice the "
                f"pretension of {limit:.6g} N, first at {{where}} {{count}}; the other strand carries all of it"
            )
            yield Excess(tie.name, "tension", unit("N"), 2.0 * limit, most, *_first(run, rows), sentence)


def _flaws(run: Trajectory) -> Iterator[Excess]:
    """Yield cams that cannot be made."""
    for tie in cams_of(run.mechanism.constraints):
        rows = np.flatnonzero(tie.flawed(run.q))
        if len(rows):
            flaw = f"is undercut: no cam has this profile with its {tie.known.words}"
            sentence = f"{tie.kind} {tie.name} {flaw}, first at {{where}} {{count}}"
            count = float(len(rows))
            yield Excess(tie.name, "outline", DIMENSIONLESS, 0.0, count, *_first(run, rows), sentence)
