"""Linear analysis: natural frequencies, damping, mode shapes about an equilibrium, held position or steady motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

import msgspec
import numpy as np

from pinarm.arrays import Array, Complex, Flags, distinct
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.friction.columns import friction_columns
from pinarm.engine.kinematics.assembly import first_position, start_near
from pinarm.engine.kinematics.prescribed import Assembly
from pinarm.engine.labelled_array import LabelledArray
from pinarm.engine.linear.derivatives import Input, input_of, with_inputs
from pinarm.engine.linear.force_balance import (
    Driven,
    ForceBalance,
    SteadyState,
    acting,
    advanced,
    state_row,
    steady_state,
)
from pinarm.engine.linear.linear_states import Drives, Linearisation, participations, require_same, rigid_modes
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.engine.statics.actuation import along
from pinarm.errors import InputError, Key, Place, within
from pinarm.input.units import DIMENSIONLESS as ONE
from pinarm.input.units import HERTZ, Unit, unit
from pinarm.input.yaml.schema import AnyQuantity, Deferred, InputStruct, Level, Rate, check_unit
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.loads import LOADS, Force, bind_loads, require_constant, schema_row
from pinarm.problems.values import check_levels, coordinates_of
from pinarm.records import Record, replace

MODE_UNITS: Mapping[str, Unit] = {
    "frequency": HERTZ,
    "damped_frequency": HERTZ,
    "damping": unit("1"),
    "time_constant": unit("s"),
    "growth": unit("1/s"),
    "error": unit("1/s"),
}
"""Measures of a mode and their units."""

VAGUE = 1e-6
"""Relative error of an eigenvalue from which on it is noted."""

LEAST_DAMPING, UNDAMPED = 1e-4, 1e-2
"""Damping ratio below which a peak would leave the picture, and that whose frequencies such a resonance gets."""

STEPS = np.linspace(-85.0, 85.0, 34)
"""Steps about a resonance [deg], none at it: without damping the response there is infinite."""

NAMED = "{:.9g}"
"""Format of a frequency in the names of rows: the response is that at the frequency of its name."""


class About(InputStruct, frozen=True):
    """The state about which the motion is linearised.

    Attributes:
        equilibrium: Rough joint coordinates near the equilibrium, such as ``{phi: 80 deg}``: Newton's method leads from
            there to the position in which the forces balance.
        hold: Coordinate -> value, such as ``{elbow: 30 deg}``: drives hold it there with constant efforts. It is free
            in the linear motion.
        steady: Joint -> rate, such as ``{spindle: 200 rpm}``: a drive with constant effort keeps it turning; nothing
            else moves.
    """

    equilibrium: dict[str, Level] = {}
    hold: dict[str, Level] = {}
    steady: dict[str, Rate] = {}


class Frequencies(InputStruct, frozen=True, rename={"start": "from", "end": "to"}):
    """Frequencies of a response, spaced by equal factors.

    Attributes:
        start: ``from`` in files: the lowest, such as ``0.1 Hz``.
        end: ``to`` in files: the highest, such as ``100 Hz``.
        samples: How many, such as ``400``; a few more lie about each resonance, so that its peak is among them.
    """

    start: AnyQuantity
    end: AnyQuantity
    samples: Annotated[int, msgspec.Meta(ge=2, le=100_000)] = 200

    def check(self) -> None:
        for key, value in (("from", self.start), ("to", self.end)):
            with within(key):
                check_unit(value, HERTZ)
        if not 0.0 < float(self.start) < float(self.end):
            raise InputError("the frequencies are not in order", expected="{from: 0.1 Hz, to: 100 Hz}")

    def values(self, eigenvalues: Complex) -> Array:
        """Return the frequencies [Hz], ascending, shape (n,).

        About a resonance at ``lambda = -s + i w`` they are ``w + s tan(x)`` with x evenly spaced: even steps on the
        circle that the response takes there in the complex plane.
        """
        decay, sizes = np.abs(eigenvalues.real), np.abs(eigenvalues)
        decay = np.where(decay > LEAST_DAMPING * sizes, decay, UNDAMPED * sizes)
        near = (eigenvalues.imag + decay * np.tan(np.radians(STEPS))[:, None]).ravel() / (2.0 * np.pi)
        low, high = float(self.start), float(self.end)
        near = np.concatenate([np.geomspace(low, high, self.samples), near[(near > low) & (near < high)]])
        return distinct(np.array([float(NAMED.format(x)) for x in near]))


class Prepared(Record, frozen=True):
    """Checked input of a solution, near the state.

    Attributes:
        q: Configuration near the state, shape (nq,).
    """

    dynamics: Dynamics
    driven: Driven
    inputs: Sequence[Input]
    q: Array


class Linear(InputStruct, frozen=True, tag_field="kind", tag="linear"):
    """Small motions about a state at which nothing accelerates: ``x' = A x + B u``.

    Trees and loops, springs, dampers, weights, gyroscopic terms; drives keep the constant efforts that hold the state.
    The results are ``mode.1.frequency``, ``mode.1.damping`` and so on, by ascending frequency, one of each conjugate
    pair: with the eigenvalue lambda of A, ``frequency = |lambda| / (2 pi)``, ``damped_frequency = Im lambda / (2 pi)``,
    ``damping = -Re lambda / |lambda|``, ``time_constant = -1 / Re lambda``, ``growth = Re lambda``, and ``error``, that
    of lambda by rounding. Tables of the result hold the mode shapes, the parts of bodies, springs and dampers in the
    energy of each mode, and A.

    Joints that dry friction holds stay where they are, which a note says; kinks of loads and singular positions are
    refused: no motion is linear there.

    Attributes:
        about: The state, such as ``{equilibrium: {phi: 80 deg}}``.
        inputs: Columns of B and D, such as ``[O, force.shaking]``: efforts along coordinates, torques of motors,
            ``drive.D.torque``, amplitudes of forces that follow a law, and prescribed positions of coordinates that are
            held or turn, ``joint.base.position``. Efforts at all joints where none is named.
        outputs: Quantities or formulas whose derivatives are the rows of C and D, such as ``[point.A.position.y,
            joint.B.force.y]``.
        frequencies: Where the response of every output to every input is computed: ``C (2 pi i f - A)^-1 B + D``.
        loads: Applied constant forces and springs of this run, such as ``{spring: {kind: joint_spring, joint: O,
            stiffness: 20 N*m/rad}}``; those that are inputs may follow any law, and act with 0 in the state.
    """

    kind: ClassVar[str] = "linear"
    deferred: ClassVar[Deferred] = LOADS
    about: About = About()
    inputs: list[str] = []
    outputs: list[str] = []
    frequencies: Frequencies | None = None
    loads: dict[str, Force] = {}

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        drives = along(mechanism, self._driven)
        row = schema_row(mechanism, self.about.equilibrium, self.loads, ROW, unit("1"), drives)
        rest = friction_columns(mechanism.frictions, np.zeros((1, len(mechanism.frictions))))
        modes = _columns(np.full((_most(mechanism, row), len(MODE_UNITS)), np.nan))
        return replace(row, columns={**rest, **modes}, separate=True)

    @property
    def _driven(self) -> list[str]:
        return [*self.about.hold, *self.about.steady]

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Prepared:
        check_levels(mechanism, self.about.equilibrium, place, "about", "equilibrium")
        for order, (key, values) in enumerate((("hold", self.about.hold), ("steady", self.about.steady))):
            coordinates_of(mechanism, values, place, "about", key, order=order)
        for name in self.about.steady:
            if name in self.about.hold:
                with place("about", "steady", Key(name)):
                    raise InputError(f"'{name}' is held and turns", expected="one of them")
        driven = Driven.of(mechanism, self.about.hold, self.about.steady)
        with place("about"):
            q = start_near(mechanism, self.about.equilibrium, driven.held, Grid.cover(np.zeros(1), []))
        forces = with_inputs(mechanism, bind_loads(mechanism, self.loads, place), self.inputs)
        require_constant(forces, place)
        inputs = self._inputs(mechanism, forces, place)
        return Prepared(Dynamics.of(mechanism.model, forces).on(0.0, 1.0), driven, inputs, q)

    def _inputs(self, mechanism: Mechanism, forces: Mapping[str, ForceElement], place: Place) -> list[Input]:
        inputs = list[Input]()
        for index, name in enumerate(self.inputs or [*mechanism.joints]):
            with place("inputs", index):
                inputs.append(input_of(mechanism, forces, name))
                if inputs[-1].position and inputs[-1].position not in self._driven:
                    raise InputError(
                        f"the position '{name}' is prescribed, and about does not say where",
                        expected=f"about: {{hold: {{{inputs[-1].position}: ...}}}}, or steady",
                    )
        return inputs

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Prepared | None = None
    ) -> Outcome:
        begun = prepared or self.prepare(mechanism, accuracy, place)
        with place("about"):
            near, linear = self._about(mechanism, begun)
        tables = linear.tables() | participations(linear) | self._response(place, begun, linear)
        row, drives = linear.state, along(mechanism, self._driven)
        measures = {**row.columns, **_columns(_measures(linear, _most(mechanism, row)))}
        rows = replace(
            row,
            grid=Grid.cover(np.ones(1), []),
            a=np.zeros_like(row.a),
            columns=measures,
            driven=drives.driven,
            drives=(*self._driven,),
        )
        figures = {"unstable modes": float((linear.modes.growths > 0.0).sum())}
        left = ["controllers are left open: their efforts stay those of the state"] if mechanism.control else []
        lossy = ", ".join(name for name, drive in mechanism.drives.items() if drive.efficiency < 1.0)
        left += [f"the small motion has no losses of gears: {lossy}"] if lossy else []
        return Outcome(rows, figures=figures, notes=(*near.notes, *_remarks(linear), *left), arrays=tables)

    def linearisation(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Linearisation:
        """Return the motion linearised about the state; see ``solve``."""
        return self._about(mechanism, self.prepare(mechanism, accuracy, place))[1]

    def _about(self, mechanism: Mechanism, begun: Prepared) -> tuple[Assembly, Linearisation]:
        """Return where the mechanism is assembled, and the motion linearised about the state near it."""
        near = first_position(mechanism.closure, begun.driven.held, begun.driven.values, 0.0, begun.q)
        state = steady_state(ForceBalance(mechanism, begun.dynamics, begun.driven, mechanism.frictions), near.q)
        linear = self._linearised(mechanism, begun, state)
        for later in advanced(mechanism, state.q, state.v):
            require_same(linear, self._linearised(mechanism, begun, replace(state, q=later)))
        return near, linear

    def _linearised(self, mechanism: Mechanism, begun: Prepared, state: SteadyState) -> Linearisation:
        positions = {source.position for source in begun.inputs}
        driven = begun.driven
        prescribed = np.array([name in positions for name in driven.names], dtype=bool)
        drives = Drives(driven.names, driven.coordinates, state.efforts, prescribed)
        tau, _ = acting(mechanism.model.nv, driven.coordinates, state.efforts[:, None])
        row = state_row(mechanism, begun.dynamics, 0.0, state.q, state.v)
        return Linearisation.about(replace(row, tau=tau.T, closure=along(mechanism, self._driven).closure), drives)

    def _response(self, place: Place, begun: Prepared, linear: Linearisation) -> dict[str, LabelledArray]:
        size, inputs, second = len(linear.states), begun.inputs, unit("s")
        names = [f"{input_.position}''" if input_.position else input_.name for input_ in inputs]
        measured = [input_.unit / second**2 if input_.position else input_.unit for input_ in inputs]
        with place("outputs"):
            slopes = linear.slopes(self.outputs)
            load, by_force = linear.force_slopes(self.outputs, [input_.force for input_ in inputs if input_.force])
            quantities = Quantities(linear.state)
            units = [quantities[name].unit for name in self.outputs]
        columns = linear.columns(inputs, load)
        b, d = linear.B @ columns, slopes[:, size:] @ columns
        d[:, [bool(input_.force) for input_ in inputs]] = by_force
        per_input, per_state = [ONE / own for own in measured], [ONE / own for own in linear.state_units]
        arrays = {"B": LabelledArray(b, linear.states, names, [own / second for own in linear.state_units], per_input)}
        if not self.outputs:
            return arrays
        arrays["C"] = LabelledArray(slopes[:, :size], self.outputs, linear.states, units, per_state)
        arrays["D"] = LabelledArray(d, self.outputs, names, units, per_input)
        if self.frequencies is not None:
            f = self.frequencies.values(linear.modes.eigenvalues)
            response = linear.response(f, slopes[:, :size], b) + d
            squares = np.array([bool(input_.position) for input_ in inputs])
            response = response * np.where(squares, -((2.0 * np.pi * f[:, None, None]) ** 2), 1.0)
            shown = [(name, own, input_) for name, own in zip(self.outputs, units, strict=True) for input_ in inputs]
            arrays["response"] = LabelledArray(
                response.reshape(len(f), -1),
                [f"{NAMED.format(x)} Hz" for x in f],
                [f"{name} / {input_.name}" for name, _, input_ in shown],
                [ONE] * len(f),
                [None if own is None else own / input_.unit for _, own, input_ in shown],
            )
        return arrays


def _most(mechanism: Mechanism, row: Trajectory) -> int:
    """Return the largest number of modes: that of free states."""
    closures = mechanism.closure, mechanism.closure.holonomic
    return sum(int(closure.split_at(row.q[0]).free.shape[1]) for closure in closures)


def _measures(linear: Linearisation, count: int) -> Array:
    """Return the measures of modes, shape (count, measures); NaN beyond them, as conjugate pairs are one mode."""
    measures = np.full((count, len(MODE_UNITS)), np.nan)
    measures[: len(linear.modes.errors)] = np.column_stack([*linear.modes.measures.values()])
    return measures


def _columns(measures: Array) -> dict[str, Series]:
    return {
        f"mode.{k}.{name}": Series(f"mode.{k}.{name}", measured, np.array([value]))
        for k, row in enumerate(measures, 1)
        for (name, measured), value in zip(MODE_UNITS.items(), row, strict=True)
    }


def _remarks(linear: Linearisation) -> list[str]:
    """Return notes on what friction holds, modes that grow, and eigenvalues that have few digits."""
    modes, size = linear.modes, np.abs(linear.modes.eigenvalues)
    notes = [linear.friction.note] if linear.friction.note else []
    notes += [] if len(size) else ["nothing is free to move: there are no modes"]
    notes += _modes_that("unstable: {}", modes.growths > 0.0)
    known = size > 0.0
    notes += rigid_modes(linear)
    twins = [(j, k) for j, k in modes.defective if known[j] and known[k]]
    notes += [f"mode {j + 1}, {k + 1}: a defective pair, one mode but for rounding" for j, k in twins]
    known[[k for pair in twins for k in pair]] = False
    return notes + _modes_that(
        "{}: less than six digits hold, where eigenvalues meet or stiffnesses cancel",
        known & (modes.errors > VAGUE * size),
    )


def _modes_that(said: str, which: Flags) -> list[str]:
    numbers = ", ".join(str(k + 1) for k in np.flatnonzero(which))
    return [said.format(f"mode {numbers}")] if numbers else []
