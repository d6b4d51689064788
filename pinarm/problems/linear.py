"""Linear analysis: natural frequencies, damping, mode shapes about an equilibrium, held position or steady motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import msgspec
import numpy as np

from pinarm.arrays import Array, Complex, distinct
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.assembly import first_position, start_near
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.labelled_array import LabelledArray
from pinarm.engine.linear.linear_states import Linearisation, linearised
from pinarm.engine.linear.outputs import output_matrices
from pinarm.engine.linear.steady import SteadyState, steady_state
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.motion.trajectory import ROW, Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.engine.statics.actuation import along
from pinarm.errors import InputError, Key, Place, within
from pinarm.input.units import DIMENSIONLESS as ONE
from pinarm.input.units import HERTZ, Unit, unit
from pinarm.input.yaml.deferred import Deferred
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, Level, Rate, check_unit
from pinarm.mechanics.coordinates import LinearCoordinate, driven_along
from pinarm.mechanics.joints import METRE, joint_of
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.joint_values import check_levels
from pinarm.problems.loads import LOADS, bind_constant_loads, schema_row
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.mechanics.forces.kinds import Force
else:  # imported where a file has loads, see LOADS
    Force = Any

MODE_UNITS: Mapping[str, Unit] = {
    "frequency": HERTZ, "damped_frequency": HERTZ, "damping": unit("1"), "time_constant": unit("s"),
    "growth": unit("1/s"), "error": unit("1/s"),
}  # fmt: skip
"""Measures of a mode and their units."""

LEAST_DAMPING = 1e-4
"""Damping ratio below which a resonance gets no frequencies of its own: its peak would leave the picture."""

STEPS = np.linspace(-85.0, 85.0, 35)
"""Steps about a resonance [deg]."""


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
        """Refuse ends that are no frequencies in order."""
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
        resonant = eigenvalues[np.abs(eigenvalues.real) > LEAST_DAMPING * np.abs(eigenvalues)]
        near = (resonant.imag + np.abs(resonant.real) * np.tan(np.radians(STEPS))[:, None]).ravel() / (2.0 * np.pi)
        low, high = float(self.start), float(self.end)
        return distinct(np.concatenate([np.geomspace(low, high, self.samples), near[(near > low) & (near < high)]]))


class Prepared(Record, frozen=True):
    """What a solution begins with.

    Attributes:
        dynamics: The equation of motion with the loads of the run.
        held: Coordinates that drives hold.
        values: Their values, shape (h,).
        weights: Rows of the coordinates that drives hold or turn, shape (k, nv).
        q: Configuration near the state, shape (nq,).
        v: Velocity of the state, shape (nv,).
    """

    dynamics: Dynamics
    held: PrescribedCoordinates
    values: Array
    weights: Array
    q: Array
    v: Array


class Linear(InputStruct, frozen=True, tag_field="kind", tag="linear"):
    """Small motions about a state at which nothing accelerates: ``x' = A x``.

    Trees and loops, springs, dampers, weights, gyroscopic terms; drives keep the constant efforts that hold the state.
    The results are ``mode.1.frequency``, ``mode.1.damping`` and so on, by ascending frequency, one of each conjugate
    pair: with the eigenvalue lambda of A, ``frequency = |lambda| / (2 pi)``, ``damped_frequency = Im lambda / (2 pi)``,
    ``damping = -Re lambda / |lambda|``, ``time_constant = -1 / Re lambda``, ``growth = Re lambda``, and ``error``, that
    of lambda by rounding. Tables of the result hold the mode shapes and A.

    Dry friction, kinks of loads and singular positions are refused: no motion is linear there.

    Attributes:
        about: The state, such as ``{equilibrium: {phi: 80 deg}}``.
        inputs: Coordinates of joints along which efforts act, such as ``[O]``: the columns of B and D. All joints where
            none is named.
        outputs: Quantities or formulas whose derivatives are the rows of C and D, such as ``[point.A.position.y,
            joint.B.force.y]``: motions, forces of joints, energies.
        frequencies: Where the response of every output to every input is computed: ``C (2 pi i f - A)^-1 B + D``.
        loads: Applied constant forces and springs of this run, such as ``{spring: {kind: joint_spring, joint: O,
            stiffness: 20 N*m/rad}}``.
    """

    kind: ClassVar[str] = "linear"
    deferred: ClassVar[Deferred] = LOADS
    about: About = About()
    inputs: list[str] = []
    outputs: list[str] = []
    frequencies: Frequencies | None = None
    loads: dict[str, Force] = {}

    def schema_row(self, mechanism: Mechanism) -> Trajectory:
        """Return one row near the state: enough to see which quantities there are."""
        drives = along(mechanism, self._driven)
        row = schema_row(mechanism, self.about.equilibrium, self.loads, ROW, unit("1"), drives)
        closure = mechanism.closure
        free = closure.split(closure.rows(closure.state(row.q[0]))).free.shape[1]
        return replace(row, columns=_columns(np.full((2 * free, len(MODE_UNITS)), np.nan)), separate=True)

    @property
    def _driven(self) -> list[str]:
        return [*self.about.hold, *self.about.steady]

    def declaration(self) -> None:
        """Return that the mechanism is not to be simplified: all joints that are free have a part in its modes."""

    def prepare(self, mechanism: Mechanism, accuracy: Accuracy, place: Place) -> Prepared:
        """Check all names and units; return the state to begin with."""
        check_levels(mechanism, self.about.equilibrium, place, "about", "equilibrium")
        held, rows = [], []
        for key, given in (("hold", self.about.hold), ("steady", self.about.steady)):
            for name, value in given.items():
                with place("about", key, Key(name)):
                    coordinate = mechanism.coordinate(name)
                    if not isinstance(coordinate, LinearCoordinate):
                        raise InputError(f"'{name}' is no coordinate of joints", expected="joints, or sums of them")
                    if name in self.about.hold and name in self.about.steady:
                        raise InputError(f"'{name}' is held and turns", expected="one of them")
                with place("about", key, name):
                    check_unit(value, coordinate.unit if key == "hold" else coordinate.unit / unit("s"))
                rows.append(coordinate.weights)
                held += [coordinate] if key == "hold" else []
        v = np.zeros(mechanism.model.nv)
        for name, rate in self.about.steady.items():
            with place("about", "steady", Key(name)):
                v[joint_of(mechanism.joints, name).v] = float(rate)
        values = tuple(map(float, self.about.hold.values()))
        prescribed = PrescribedCoordinates(
            (*self.about.hold,), tuple(held), tuple(Constant(value=value) for value in values)
        )
        with place("about"):
            q = start_near(mechanism, self.about.equilibrium, prescribed, Grid.cover(np.zeros(1), []))
        forces = bind_constant_loads(mechanism, self.loads, place)
        dynamics = Dynamics.of(mechanism.model, forces).on(0.0, 1.0)
        weights = np.array(rows).reshape(-1, mechanism.model.nv)
        return Prepared(dynamics, prescribed, np.array(values), weights, q, v)

    def solve(
        self, mechanism: Mechanism, accuracy: Accuracy, place: Place, prepared: Prepared | None = None
    ) -> Outcome:
        """Return the state as a row, with its modes as columns.

        Raises:
            AssemblyError: No steady state is near the start.
            DynamicsError: The state is singular, or something without mass is free.
        """
        begun = prepared or self.prepare(mechanism, accuracy, place)
        with place("about"):
            near = first_position(mechanism.closure, begun.held, begun.values, 0.0, begun.q)
            state = steady_state(mechanism, begun.dynamics, begun.held, begun.values, begun.weights, near.q, begun.v)
            linear = linearised(mechanism, begun.dynamics, 0.0, state.q, state.v, state.tau)
        rows = _rows(mechanism, begun, state, _columns(_measures(linear)), (*self._driven,))
        figures = {"unstable modes": float((linear.modes.eigenvalues.real > linear.modes.errors).sum())}
        tables = linear.tables() | self._response(mechanism, place, rows, linear)
        return Outcome(rows, figures=figures, notes=(*near.notes, *_remarks(linear)), arrays=tables)

    def _inputs(self, mechanism: Mechanism, place: Place) -> tuple[list[str], Array, list[Unit]]:
        """Return the names of the inputs, their rows of weights, shape (k, nv), and their units."""
        rows, units = [], []
        names = self.inputs or [*mechanism.joints]
        for index, name in enumerate(names):
            with place("inputs", index):
                coordinate = mechanism.coordinate(name)
                if not isinstance(coordinate, LinearCoordinate):
                    raise InputError(f"'{name}' is no coordinate of joints", expected="joints, or sums of them")
            rows.append(coordinate.weights)
            units.append(unit("N" if coordinate.unit == METRE else "N*m"))
        return names, np.array(rows).reshape(-1, mechanism.model.nv), units

    def _response(
        self, mechanism: Mechanism, place: Place, rows: Trajectory, linear: Linearisation
    ) -> dict[str, LabelledArray]:
        """Return B for the inputs, C and D, and the frequency response."""
        inputs, weights, efforts = self._inputs(mechanism, place)
        per_input, per_state = [ONE / own for own in efforts], [ONE / own for own in linear.state_units]
        found = {"B": LabelledArray(
            linear.B @ weights.T, linear.states, inputs, [own / unit("s") for own in linear.state_units], per_input
        )}  # fmt: skip
        if not self.outputs:
            return found
        quantities = Quantities(rows)
        with place("outputs"):
            c, d = output_matrices(rows, linear.motion, {}, self.outputs)
            units = [quantities[name].unit for name in self.outputs]
        found["C"] = LabelledArray(c, self.outputs, linear.states, units, per_state)
        found["D"] = LabelledArray(d @ weights.T, self.outputs, inputs, units, per_input)
        if self.frequencies is not None:
            frequencies = self.frequencies.values(linear.modes.eigenvalues)
            response = linear.response(frequencies, c, linear.B @ weights.T) + d @ weights.T
            named = [(name, own, *other) for name, own in zip(self.outputs, units, strict=True)
                     for other in zip(inputs, per_input, strict=True)]  # fmt: skip
            found["response"] = LabelledArray(
                response.reshape(len(response), -1), [f"{f:.9g} Hz" for f in frequencies],
                [f"{name} / {effort}" for name, _, effort, _ in named], [ONE] * len(response),
                [None if own is None else own * per for _, own, _, per in named],
            )  # fmt: skip
        return found


def _measures(linear: Linearisation) -> Array:
    """Return the measures of modes, shape (2 d, measures); NaN beyond them, as conjugate pairs are one mode."""
    modes = linear.modes
    growth = modes.eigenvalues.real
    with np.errstate(divide="ignore"):
        constants = np.where(np.abs(growth) > modes.errors, -1.0 / growth, np.inf)
    found = np.full((len(linear.states), len(MODE_UNITS)), np.nan)
    found[: len(growth)] = np.column_stack(
        [modes.frequencies, modes.damped_frequencies, modes.damping_ratios, constants, growth, modes.errors]
    )
    return found


def _columns(measures: Array) -> dict[str, Series]:
    return {
        f"mode.{k}.{name}": Series(f"mode.{k}.{name}", measured, np.array([value]))
        for k, row in enumerate(measures, 1)
        for (name, measured), value in zip(MODE_UNITS.items(), row, strict=True)
    }


def _rows(
    mechanism: Mechanism, begun: Prepared, state: SteadyState, columns: Mapping[str, Series], drives: tuple[str, ...]
) -> Trajectory:
    """Return the state as a table of one row."""
    grid, still = Grid.cover(np.ones(1), []), np.zeros((1, mechanism.model.nv))
    coordinates = [mechanism.coordinate(name) for name in drives]
    return Trajectory(
        mechanism, ROW, unit("1"), grid, state.q[None], state.v[None], still, state.tau[None],
        Multipliers.known(state.lam[None], mechanism.closure.size), mechanism.closure, begun.dynamics, columns=columns,
        separate=True, driven=driven_along(coordinates, mechanism.model.nv), drives=drives,
    )  # fmt: skip


def _remarks(linear: Linearisation) -> list[str]:
    """Return notes on modes that grow and on eigenvalues that are not determined to many digits."""
    modes = linear.modes
    numbers = np.arange(1, len(modes.eigenvalues) + 1)
    growing = numbers[modes.eigenvalues.real > modes.errors]
    notes = [f"unstable: mode {', '.join(map(str, growing))} grows"] if len(growing) else []
    rigid = numbers[np.abs(modes.eigenvalues) <= modes.errors * 1e3]
    if len(rigid):
        notes.append(f"mode {', '.join(map(str, rigid))}: nothing drives it back, its frequency is 0")
    vague = numbers[(modes.errors > 1e-6 * np.abs(modes.eigenvalues)) & ~np.isin(numbers, rigid)]
    if len(vague):
        notes.append(f"mode {', '.join(map(str, vague))}: less than six digits hold, as of eigenvalues that meet")
    return notes
