"""Equilibria: the configurations at which weights and loads balance without any drive, and whether they are stable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.assembly import start_near
from pinarm.engine.linear.equilibrium import Equilibrium, Modes, equilibrium_near
from pinarm.engine.linear.force_balance import Driven, ForceBalance
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.engine.series import Series
from pinarm.engine.statics.actuation import along
from pinarm.errors import AssemblyError, InputError, Key, Place
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import Deferred, InputStruct, Level
from pinarm.mechanics.coordinates import driven_along
from pinarm.mechanics.joints import METRE
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.joint_values import check_levels
from pinarm.problems.laws import laws_of
from pinarm.problems.loads import LOADS, bind_constant_loads, schema_row
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.mechanics.forces.kinds import Force
    from pinarm.problems.position_bands import FrictionHold, PositionBand
else:  # imported where a file has loads, see LOADS
    Force = Any

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
        own = mechanism.closure
        units = _units(mechanism, own.split_at(row.q[0]).free.shape[1] - len(self.hold))
        columns = {name: Series(name, measured, np.zeros(1)) for name, measured in units.items()}
        return replace(row, columns=columns, separate=True)

    def declaration(self) -> None:
        """Return ``None``, so that the mechanism is not simplified: all free joints have a part in its modes."""

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Prepared:
        if len(mechanism.joints) < mechanism.model.nv:
            raise InputError("equilibria are found for joints with one coordinate only; this model has others")
        held = {name: Constant(value=value) for name, value in self.hold.items()}
        laws_of(mechanism, held, lambda _, name: place("hold", name))
        forces = bind_constant_loads(mechanism, self.loads, place)
        with place("hold"):
            driven = Driven.at(mechanism, self.hold)
            if len(self.hold) >= mechanism.model.nv:
                raise InputError("every coordinate is held: nothing is left to balance", hint="kind: statics")
        balance = ForceBalance(mechanism, Dynamics.of(mechanism.model, forces).on(0.0, 1.0), driven)
        for index, start in enumerate(self.starts):
            check_levels(mechanism, start, partial(place, "starts", index))
            for name in start:
                if name in held:
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
                    _merge(equilibria, _equilibrium(balance, near.q, f"starts[{index}]"), balance.turns)
            except AssemblyError as error:
                failed[index] = error
        if not equilibria:
            raise failed[0]
        solved = outcome(balance, equilibria)
        left = (
            (error.message if error.data.get("start") else f"starts[{index}] leads to no equilibrium: {error.message}")
            + f"; expected {error.expected}"
            for index, error in failed.items()
        )
        return replace(solved, notes=(*notes, *solved.notes, *left))


def _equilibrium(balance: ForceBalance, q: Array, start: str) -> Equilibrium:
    """Return the equilibrium that a start leads to, or a position that friction holds, with NaN for its modes."""
    try:
        return equilibrium_near(balance, q, start)
    except AssemblyError:
        hold = _friction_hold(balance, q)
        if hold is None or not hold.holds(q):
            raise
        return Equilibrium(q, Modes.unknown(1))


def _friction_hold(balance: ForceBalance, q: Array) -> FrictionHold | None:
    """Return the hold by friction; ``None`` without friction, and where several motions are free."""
    if not balance.mechanism.frictions or balance.basis(q).shape[1] > 1:
        return None
    from pinarm.problems.position_bands import FrictionHold  # with all that known motions with friction need

    return FrictionHold(balance)


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


def outcome(balance: ForceBalance, equilibria: Sequence[Equilibrium]) -> Outcome:
    """Return the equilibria as rows numbered from 1, and how many there are."""
    hold = _friction_hold(balance, equilibria[0].q)
    bands = [] if hold is None else [hold.band(equilibrium.q, equilibrium.modes) for equilibrium in equilibria]
    notes = [note for row, state in enumerate(equilibria, 1) for note in _row_notes(row, state)]
    if balance.mechanism.frictions:
        notes += _friction_notes(balance, equilibria, bands)
    stable = sum(equilibrium.modes.stability == 1 for equilibrium in equilibria)
    figures = {"equilibria": float(len(equilibria)), "stable": float(stable)}
    return Outcome(rows_of(balance, equilibria, bands), figures=figures, notes=tuple(notes))


def _row_notes(row: int, equilibrium: Equilibrium) -> Iterator[str]:
    """Yield notes on directions without mass, edges of loads, and positions that rounding leaves uncertain."""
    modes = equilibrium.modes
    if np.isnan(modes.squares).any() and not np.isnan(modes.stability):
        yield f"row {row}: a direction has no mass, so its stability is that of the stiffness alone"
    if modes.edge:
        yield (
            f"row {row}: '{modes.edge}' has an edge here, to either side of which its stiffness is another one, as "
            "where a cable becomes taut: neither stability nor small motions are told"
        )
    if modes.stability == 0.0:
        yield (
            f"row {row}: a stiffness is 0 but for rounding: beside this position the forces balance as well, and what "
            "balances exactly, and whether it is stable, is known no better"
        )


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
            f"{len(equilibria[0].modes.stiffnesses)} free motions they are no band; kind: statics with a drive at "
            "every joint tells of one position whether it holds"
        )
    for row, (equilibrium, band) in enumerate(zip(equilibria, bands, strict=False), 1):
        if np.isnan(equilibrium.modes.stability) and not equilibrium.modes.edge:
            yield f"row {row}: the start, which friction holds as it is, leads to no position that needs no friction"
        if band.reason:
            yield f"row {row}: the band of positions has no end: {band.reason}"
    if balance.driven.names:
        yield (
            f"efforts that hold {', '.join(balance.driven.names)} are those without friction; kind: statics at "
            "these positions tells the band that friction leaves"
        )


def rows_of(balance: ForceBalance, equilibria: Sequence[Equilibrium], bands: Sequence[PositionBand]) -> Trajectory:
    """Return the equilibria as a table; each row is a state of its own, at rest."""
    q = np.array([equilibrium.q for equilibrium in equilibria])
    tau, lam = (np.array(x) for x in zip(*(balance.efforts(row) for row in q), strict=True))
    ends = [band.ends.T.ravel() for band in bands] or [np.zeros(0)] * len(equilibria)
    units = _units(balance.mechanism, len(equilibria[0].modes.squares))
    shown = slice(None if "equilibrium.stiffness_1" in units else 0)
    table = np.array(
        [
            [float(state.starts), state.modes.stability, *state.modes.squares, *state.modes.stiffnesses[shown], *both]
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
        Multipliers.known(lam, mechanism.closure.size),
        along(mechanism, driven.names).closure,
        balance.dynamics,
        columns=columns,
        separate=True,
        driven=driven_along(driven.coordinates, q.shape[1]),
        drives=tuple(driven.names),
    )
