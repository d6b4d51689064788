"""Equilibria: the configurations at which weights and loads balance without any drive, and whether they are stable.

Dry friction holds further positions, of mechanisms with one free motion a band about each equilibrium. At a position
the efforts ``lower`` and ``upper`` begin to move a free joint down and up against the friction at rest; friction holds
the mechanism there without any effort where ``lower <= 0 <= upper``. From a position that it holds the free motion is
followed both ways to the first position where one of the two efforts is 0: the ends of the band.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import Annotated, ClassVar, NamedTuple

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import MASSLESS
from pinarm.engine.friction.columns import BANDS, own_effort
from pinarm.engine.kinematics.assembly import OPEN, start_near
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.linear.derivatives import load_at_kink
from pinarm.engine.linear.force_balance import ZERO, Driven, ForceBalance
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.motion.prescribed_motion import Prescription
from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.engine.series import Series
from pinarm.engine.statics.actuation import along
from pinarm.errors import AssemblyError, DynamicsError, InputError, Key, Place
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import Deferred, InputStruct, Level
from pinarm.mechanics.coordinates import driven_along
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.loads import LOADS, Force, bind_constant_loads, schema_row
from pinarm.problems.values import check_levels, coordinates_of
from pinarm.records import Record, replace

SAME, SAME_FLAT = 1e-8, 1e-4
"""Distance below which two configurations are one, relative to ``1 + |q|`` [rad or m]: usually, and where a stiffness
of 0 leaves Newton's method with the cube root of its tolerance."""

TURN, GROWTH, STEPS = 0.05, 1.25, 150
"""Largest turn of a joint in a step along a band [rad]; growth of the steps; steps at most."""

PARTS = np.linspace(0.0, 1.0, 9)
"""Places in a step that are looked at: a catch, in which friction does not hold, is found where it is 0.4 deg wide."""

FIRST = 0.25
"""First step, relative to the end that the stiffness at the start predicts."""

FULL_TURN = "friction holds every position of a full turn"

Prepared = tuple[ForceBalance, list[Array]]
"""The balance of forces, and the configuration of every start."""


class Equilibria(InputStruct, frozen=True, tag_field="kind", tag="equilibria"):
    """Configurations at rest at which the generalised force of weights and loads vanishes; drives give none.

    With the potential energy U the force is ``f = -dU/dq``, the stiffness ``K = -df/dq``, and small motions about an
    equilibrium are those of ``M x'' + K x = 0``: stable if every ``w^2`` of ``K x = w^2 M x`` is positive, unstable if
    one is negative (or, under loads without a potential, not real), indifferent if one is 0 to rounding. Damping and
    friction have no part in it. In directions without mass there is no ``w^2``: the eigenvalues of K itself decide.

    Dry friction holds other positions as well. Where one motion is free they are a band about each equilibrium, whose
    ends are told; a start that leads to no equilibrium, but that friction holds, is a row of its own.

    Every start leads to the equilibrium that damped Newton steps reach; several may lead to one. It is meant for starts
    within about 0.5 rad of what is looked for, and finds unstable equilibria as well as stable ones. Starts that lead
    to none are named in notes, and refused where no start leads to one.

    Attributes:
        starts: Rough joint coordinates, one map for each start, such as ``[{left: 10 deg}, {left: -10 deg}]``; what is
            not given is 0. Where they contradict what is held the nearest configuration is taken that does not.
        hold: Coordinate -> value, for coordinates that drives hold.
        loads: Applied constant forces and springs of this run, such as ``{spring: {kind: joint_spring, joint: O,
            stiffness: 20 N*m/rad}}``.
    """

    kind: ClassVar[str] = "equilibria"
    deferred: ClassVar[Deferred] = LOADS
    starts: Annotated[list[dict[str, Level]], msgspec.Meta(min_length=1)]
    hold: dict[str, Level] = {}
    loads: dict[str, Force] = {}

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        drives = along(mechanism, self.hold)
        row = schema_row(mechanism, self.starts[0], self.loads, ROW, unit("1"), drives)
        units = _units(mechanism, mechanism.closure.split_at(row.q[0]).free.shape[1] - len(self.hold))
        columns = {name: Series(name, measured, np.zeros(1)) for name, measured in units.items()}
        return replace(row, columns=columns, separate=True)

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Prepared:
        if len(mechanism.joints) < mechanism.model.nv:
            raise InputError("equilibria are found for joints with one coordinate only; this model has others")
        coordinates_of(mechanism, self.hold, place, "hold")
        forces, driven = bind_constant_loads(mechanism, self.loads, place), Driven.of(mechanism, self.hold, {})
        if len(self.hold) >= mechanism.model.nv:
            with place("hold"):
                raise InputError("every coordinate is held: nothing is left to balance", hint="kind: statics")
        balance = ForceBalance(mechanism, Dynamics.of(mechanism.model, forces).on(0.0, 1.0), driven)
        for index, start in enumerate(self.starts):
            check_levels(mechanism, start, partial(place, "starts", index))
            for name in start:
                if name in self.hold:
                    with place("starts", index, Key(name)):
                        raise InputError(f"'{name}' is held", expected="starting values of the other joints")
        grid = Grid.cover(np.zeros(1), [])
        return balance, [start_near(mechanism, start, driven.held, grid) for start in self.starts]

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Prepared | None = None
    ) -> Outcome:
        """Return the equilibria, one a row in the order in which they are found.

        Each row has beside its quantities ``equilibrium.starts``, how many starts led to it,
        ``equilibrium.stability`` (1 stable, 0 indifferent, -1 unstable), ``equilibrium.frequency2_1`` and so on, its
        ``w^2`` in ascending order, and ``equilibrium.stiffness_1`` and so on, the eigenvalues of K, of trees whose
        joints all turn or all slide. With friction and one free motion ``equilibrium.end_1.J`` and
        ``equilibrium.end_2.J`` are the coordinates of a joint J at the two ends of the band of positions that friction
        holds, in the sense in which the joint that moves most goes down and up.
        """
        balance, starts = prepared or self.prepare(mechanism, accuracy, place)
        equilibria: list[Equilibrium] = []
        failed: dict[int, AssemblyError] = {}
        notes: list[str] = []
        for index, q in enumerate(starts):
            try:
                with place("starts", index):
                    near = balance.begun(q)
                    notes += (f"starts[{index}]: {note}" for note in near.notes)
                    _merge(equilibria, Equilibrium.near(balance, near.q, f"starts[{index}]"), balance.turns)
            except AssemblyError as error:
                failed[index] = error
        if not equilibria:
            raise failed[0]
        left = (
            (error.message if error.data.get("start") else f"starts[{index}] leads to no equilibrium: {error.message}")
            + f"; expected {error.expected}"
            for index, error in failed.items()
        )
        held = equilibria if _has_bands(balance, equilibria[0].q) else []
        bands = [_band(balance, equilibrium) for equilibrium in held]
        for row, equilibrium in enumerate(equilibria, 1):
            notes += (f"row {row}: {note}" for note in equilibrium.notes())
        if mechanism.frictions:
            notes += _friction_notes(balance, equilibria, bands)
        stable = sum(equilibrium.stability == 1 for equilibrium in equilibria)
        figures = {"equilibria": float(len(equilibria)), "stable": float(stable)}
        return Outcome(_rows(balance, equilibria, bands), figures=figures, notes=(*notes, *left))


class Equilibrium(Record, frozen=True):
    """A configuration at which the forces balance, or that friction holds; small motions are ``M x'' + K x = 0``.

    Attributes:
        q: Configuration [rad or m], shape (nq,).
        squares: ``w^2`` of ``K x = w^2 M x`` [rad^2/s^2], ascending, shape (n,); NaN where a direction has no mass.
        stiffnesses: Eigenvalues of K, ascending, shape (n,).
        stability: 1 stable, 0 indifferent, -1 unstable; that of K alone where a direction has no mass; NaN where the
            forces do not balance.
        edge: Name of a load whose slope is another one to either side: then all of these are NaN; empty for none.
        starts: How many starts led to it.
    """

    q: Array
    squares: Array
    stiffnesses: Array
    stability: float
    edge: str = ""
    starts: int = 1

    @classmethod
    def near(cls, balance: ForceBalance, q: Array, start: str) -> Equilibrium:
        """Return the equilibrium that Newton steps from q reach, or q itself where friction holds it.

        ``start`` names q in errors.
        """
        balance.basis(q)  # there has to be one
        try:
            q, forces = balance.solved(q, start)
        except AssemblyError:
            if not _has_bands(balance, q) or reserve(balance, q, _mover(balance, balance.basis(q))) < 0.0:
                raise
            return cls(q, np.full(1, np.nan), np.full(1, np.nan), np.nan)
        slopes, basis = balance.slopes(q, forces), forces.free
        scale, still = balance.closure.scale, np.zeros_like(forces.v)
        if edge := load_at_kink(balance.dynamics, 0.0, q, still, scale, float(slopes.terms_q.max())):
            unknown = np.full(basis.shape[1], np.nan)
            return cls(q, unknown, unknown, np.nan, edge)
        stiffness, mass = basis.T @ slopes.force_q @ basis, basis.T @ slopes.mass @ basis
        return cls.of(q, stiffness, mass, ZERO * (np.abs(basis).T @ slopes.terms_q @ np.abs(basis)))

    @classmethod
    def of(cls, q: Array, stiffness: Array, mass: Array, doubt: Array) -> Equilibrium:
        """Return an equilibrium with its small motions.

        Args:
            stiffness: K, shape (n, n); not symmetric under loads without a potential.
            mass: M, shape (n, n).
            doubt: How large an entry of K may be and still be 0, shape (n, n).
        """
        size, unity = np.sqrt(np.diag(mass)), np.eye(len(mass))
        massless = bool((size == 0.0).any() or np.linalg.eigvalsh(mass / np.outer(size, size))[0] < MASSLESS)
        springs, _ = _modes(stiffness, unity, doubt)
        squares, modes = _modes(stiffness, unity if massless else mass, doubt)
        unsure = np.einsum("ik,ij,jk->k", np.abs(modes), doubt, np.abs(modes))
        falls = (squares.real < -unsure) | (np.abs(squares.imag) > unsure)
        stability = -1.0 if falls.any() else float((squares.real > unsure).all())
        ascending = np.full(len(mass), np.nan) if massless else np.sort(squares.real)
        return cls(q, ascending, np.sort(springs.real), stability)

    def is_at(self, q: Array, turns: Array) -> bool:
        """Tell whether a configuration is this one but for full turns; ``turns`` are 1 for joints that turn, else 0."""
        apart = q - self.q
        apart -= turns * 2 * np.pi * np.round(apart / (2 * np.pi))
        tolerance = SAME if self.stability else SAME_FLAT
        return bool((np.abs(apart) <= tolerance * (1.0 + np.abs(q))).all())

    def notes(self) -> Iterator[str]:
        """Yield notes on directions without mass, edges of loads, and positions that rounding leaves uncertain."""
        if np.isnan(self.squares).any() and not np.isnan(self.stability):
            yield "a direction has no mass, so its stability is that of the stiffness alone"
        if self.edge:
            yield (
                f"'{self.edge}' has an edge here, to either side of which its stiffness is another one, as where a "
                "cable becomes taut: neither stability nor small motions are told"
            )
        if self.stability == 0.0:
            yield (
                "a stiffness is 0 but for rounding: beside this position the forces balance as well, and what "
                "balances exactly, and whether it is stable, is known no better"
            )


def _modes(stiffness: Array, mass: Array, doubt: Array) -> tuple[Array, Array]:
    """Return the eigenvalues of ``K x = w^2 M x``, shape (n,), and x with ``x^H M x = 1`` as columns, shape (n, n).

    Where K is symmetric within ``doubt`` they are real; under loads without a potential they may be complex.
    """
    from scipy.linalg import eig, eigh

    if (np.abs(stiffness - stiffness.T) <= doubt).all():
        squares, modes = eigh(0.5 * (stiffness + stiffness.T), mass)
    else:
        squares, modes = eig(stiffness, mass)
        modes = modes / np.sqrt(np.einsum("ik,ij,jk->k", modes.conj(), mass, modes).real)
    return squares, modes


def _merge(equilibria: list[Equilibrium], new: Equilibrium, turns: Array) -> None:
    for index, old in enumerate(equilibria):
        if old.is_at(new.q, turns):
            equilibria[index] = replace(old, starts=old.starts + 1)
            return
    equilibria.append(new)


def _units(mechanism: Mechanism, free: int) -> dict[str, Unit | None]:
    """Return the quantities of an equilibrium and their units, for so many free coordinates.

    Eigenvalues of K are for motions of length 1 in all joints. Where angles and lengths are added up in these they have
    no unit, and with loops they would be others where these are opened elsewhere: they are not told.
    """
    joints = mechanism.joints.items() if mechanism.frictions and free == 1 else ()
    sliding = {joint.unit == METRE for joint in mechanism.joints.values()}
    resistance, numbers = unit("N/m" if sliding == {True} else "N*m/rad"), range(1, free + 1)
    shown = numbers if len(sliding) == 1 and not mechanism.closure.size else ()
    return {
        "equilibrium.starts": unit("1"),
        "equilibrium.stability": unit("1"),
        **{f"equilibrium.frequency2_{k}": unit("rad^2/s^2") for k in numbers},
        **{f"equilibrium.stiffness_{k}": resistance for k in shown},
        **{f"equilibrium.end_{k}.{name}": joint.unit for name, joint in joints for k in (1, 2)},
    }


def _friction_notes(
    balance: ForceBalance, equilibria: Sequence[Equilibrium], bands: Sequence[PositionBand]
) -> Iterator[str]:
    """Yield notes on friction that sticks."""
    names = ", ".join(dict.fromkeys(friction.name for friction in balance.mechanism.frictions))
    if bands:
        yield f"friction of {names} holds the positions between equilibrium.end_1 and equilibrium.end_2"
    else:
        yield (
            f"friction of {names} holds positions beside these as well: the table has those that need none. With "
            f"{len(equilibria[0].stiffnesses)} free motions they are no band; kind: statics with a drive at "
            "every joint tells of one position whether it holds"
        )
    for row, (equilibrium, band) in enumerate(zip(equilibria, bands, strict=False), 1):
        if np.isnan(equilibrium.stability) and not equilibrium.edge:
            yield f"row {row}: the start, which friction holds as it is, leads to no position that needs no friction"
        if band.reason:
            yield f"row {row}: the band of positions has no end: {band.reason}"
    if balance.driven.names:
        yield (
            f"efforts that hold {', '.join(balance.driven.names)} are those without friction; kind: statics at "
            "these positions tells the band that friction leaves"
        )


def _rows(balance: ForceBalance, equilibria: Sequence[Equilibrium], bands: Sequence[PositionBand]) -> Trajectory:
    """Return the equilibria as a table; each row is a state of its own, at rest."""
    q = np.array([equilibrium.q for equilibrium in equilibria])
    tau, lam = (np.array(x) for x in zip(*(balance.efforts(row) for row in q), strict=True))
    ends = [band.ends.T.ravel() for band in bands] or [np.zeros(0)] * len(equilibria)
    units = _units(balance.mechanism, len(equilibria[0].squares))
    shown = slice(None if "equilibrium.stiffness_1" in units else 0)
    table = np.array(
        [
            [float(state.starts), state.stability, *state.squares, *state.stiffnesses[shown], *both]
            for state, both in zip(equilibria, ends, strict=True)
        ]
    )
    columns = {name: Series(name, units[name], column) for name, column in zip(units, table.T, strict=True)}
    mechanism, driven = balance.mechanism, balance.driven
    return Trajectory(
        mechanism,
        ROW,
        unit("1"),
        Grid.cover(np.arange(1.0, len(equilibria) + 1.0), []),
        q,
        np.zeros_like(q),
        np.zeros_like(q),
        tau,
        lam,
        along(mechanism, driven.names).closure,
        balance.dynamics,
        columns=columns,
        separate=True,
        driven=driven_along(driven.coordinates, q.shape[1]),
        drives=tuple(driven.names),
    )


class PositionBand(NamedTuple):
    """The positions that friction holds about a given one.

    Attributes:
        ends: Configurations where it holds no longer [rad or m], NaN where there is no end, shape (2, nq).
        reason: Why an end is missing; empty where both are known.
    """

    ends: Array
    reason: str = ""


def _has_bands(balance: ForceBalance, q: Array) -> bool:
    """Tell whether friction holds bands of positions: with one free motion."""
    return bool(balance.mechanism.frictions) and balance.basis(q).shape[1] == 1


def _mover(balance: ForceBalance, basis: Array) -> str:
    """Return the joint that moves most in the free motion."""
    return list(balance.mechanism.joints)[int(np.abs(basis[:, 0]).argmax())]


def reserve(balance: ForceBalance, q: Array, joint: str) -> float:
    """Return the smaller of ``-lower`` and ``upper`` at a position [N*m or N]; at least 0 where friction holds."""
    mechanism, dynamics = balance.mechanism, balance.dynamics
    drives = along(mechanism, [*balance.driven.names, joint])
    row = Trajectory.schema_row(mechanism, q, ROW, unit("1"), drives.closure)
    motion = DeterminedMotion(mechanism, OPEN)
    known = Prescription(mechanism, motion, drives, dynamics, ROW, row.unit)
    solved = known.solved(replace(row, dynamics=dynamics, separate=True), None)
    effort = own_effort(mechanism.joints, drives.coordinates(mechanism), joint)
    lower, upper = (float(solved.columns[f"{effort}.{part}"].values[0]) for part in BANDS)
    return min(-lower, upper)


def _band(balance: ForceBalance, at: Equilibrium) -> PositionBand:
    """Return the band about a position that friction holds, with the stiffness there."""
    try:
        basis = balance.basis(at.q)
        held = reserve(balance, at.q, _mover(balance, basis))
        if held <= 0.0:
            return PositionBand(np.array([at.q, at.q]))
        stiffness = abs(float(at.stiffnesses[0]))
        step = FIRST * held * np.abs(basis).max() / stiffness if stiffness > 0.0 else np.inf
        down, why = _end(balance, at.q, -basis, step)
        up, other = (down, why) if why == FULL_TURN else _end(balance, at.q, basis, step)
    except (AssemblyError, DynamicsError) as error:
        return PositionBand(np.full((2, len(at.q)), np.nan), error.message)
    return PositionBand(np.array([down, up]), why or other)


def _end(balance: ForceBalance, q: Array, basis: Array, step: float) -> tuple[Array, str]:
    """Return where the band ends in the direction of a free motion, or NaN and why it does not."""
    from scipy.optimize import brentq  # few runs need it

    turned, turns, nowhere = 0.0, balance.turns, np.full(len(q), np.nan)
    step = step if np.isfinite(step) else TURN * (1.0 + float(np.abs(q).max()))
    for _ in range(STEPS):
        joint, way, begin = _mover(balance, basis), basis[:, 0], q
        step = min(step, TURN / max(float((turns * np.abs(way)).max()), 1e-300))

        def left(s: float, begin: Array = begin, way: Array = way, joint: str = joint) -> float:
            return reserve(balance, balance.nearest(begin + s * way), joint)

        for before, end in pairwise((step * PARTS).tolist()):
            if left(end) < 0.0:
                return balance.nearest(begin + brentq(left, before, end, xtol=1e-15 * end) * way), ""
        q = balance.nearest(begin + step * way)
        turned += float((turns * np.abs(q - begin)).max())
        if turned >= 2.0 * np.pi:
            return nowhere, FULL_TURN
        basis, step = balance.basis(q, basis), GROWTH * step
    return nowhere, "friction holds every position as far as it was followed"
