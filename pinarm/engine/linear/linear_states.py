"""Linear analysis of a mechanism at a state: state-space matrices, derivatives of quantities, modes, their energies.

Every state and input of the linear motion is an imaginary step of configuration, velocities, accelerations, efforts,
multipliers and friction; a quantity of these states, divided by the step, is its derivative: the matrices C and D. See
``derivatives``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import AT_KINK, STEP, Array, Complex, Flags
from pinarm.engine.constraints.constraint_rows import ConstraintRows, Measured, one_sided
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import accelerations, require_masses
from pinarm.engine.labelled_array import LabelledArray
from pinarm.engine.linear.derivatives import (
    EquationDerivatives,
    Input,
    complex_kept,
    element_derivatives,
    equation_derivatives,
    force_load,
    load_at_kink,
    stepped_force,
    tree_derivatives,
)
from pinarm.engine.linear.force_balance import (
    FrictionState,
    acting,
    friction_slopes,
    friction_state,
    measured,
    state_row,
    with_friction,
)
from pinarm.engine.linear.linearisation import DEPENDENT, LinearMotion, Modes, Rows, linear_motion
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities import states
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.quantities.state_arrays import LeadingAxes, states_of
from pinarm.errors import DynamicsError, InputError
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.coordinates import Coordinate, GuidedCoordinate
from pinarm.mechanics.couplings.coupling import cams_of
from pinarm.mechanics.geometry.link_placements import speeding
from pinarm.mechanics.joints import METRE, effort_unit, links_behind
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

CHANGED = 1e-6
"""Change of A in a steady motion, relative to its largest entry, that is rounding."""

SHARED = 1e-9
"""Change of an output by a self-stress of length 1 that is rounding."""


class Drives(Record, frozen=True):
    """Drives along coordinates at a state.

    Attributes:
        efforts: Efforts along them [N*m or N], shape (k,): constant in the small motion, but of prescribed ones.
        prescribed: Which of them have prescribed positions, shape (k,).
    """

    names: Sequence[str] = ()
    coordinates: Sequence[Coordinate] = ()
    efforts: Array = np.zeros(0)
    prescribed: Flags = np.zeros(0, dtype=bool)


class Linearisation(Record, frozen=True):
    """A motion linearised about a state: ``x' = A x + B u``, with names.

    States x are deviations of d independent coordinates, then of their velocities ``NAME'``. Inputs u are efforts at
    joints, then accelerations ``NAME''`` of prescribed coordinates.

    Attributes:
        state: A table of one row with its accelerations, efforts, multipliers and friction; its closure has the
            constraints of the mechanism, then the drives along task coordinates.
        drives: Drives along coordinates, beside those at joints.
    """

    state: Trajectory
    drives: Drives = Drives()

    @classmethod
    def about(cls, state: Trajectory, drives: Drives | None = None) -> Linearisation:
        """Return the motion linearised about a state.

        Args:
            state: A table of one row with its efforts at joints, those of ``drives`` included; its friction,
                multipliers and accelerations follow from these.
            drives: Drives along coordinates, beside those at joints; none where it is left out.
        """
        drives = drives or Drives()
        linear = cls(_completed(state, drives), drives)
        _require_smooth(
            state.mechanism, state.dynamics, float(state.grid.t[0]), state.q[0], state.v[0], linear.derivatives
        )
        linear.motion  # noqa: B018  refuses singular positions
        return linear

    @property
    def A(self) -> Array:
        """State matrix, shape (2 d, 2 d)."""
        return self.motion.a

    @property
    def B(self) -> Array:
        """Input matrix, shape (2 d, k)."""
        return self.motion.b

    @property
    def modes(self) -> Modes:
        """Eigenvalues, frequencies, damping ratios, eigenvectors and their errors."""
        return self.motion.modes

    @property
    def acceleration(self) -> Array:
        """Accelerations at the state, shape (nv,): 0 at an equilibrium."""
        return np.asarray(self.state.a[0])

    @cached_property
    def joints(self) -> list[str]:
        """Names of all joints' coordinates."""
        model = self.state.mechanism.model
        return [coordinate_name(model, index) for index in range(model.nv)]

    @cached_property
    def joint_units(self) -> list[Unit]:
        """Units of all joints' coordinates."""
        sliding = {joint.v for joint in self.state.mechanism.joints.values() if joint.unit == METRE}
        return [METRE if index in sliding else unit("rad") for index in range(len(self.joints))]

    @cached_property
    def _labels(self) -> tuple[list[tuple[str, Unit]], list[tuple[str, Unit]]]:
        """Names and units of the states, and of the inputs."""
        joints, motion = list(zip(self.joints, self.joint_units, strict=True)), self.motion
        places = np.flatnonzero(self.drives.prescribed).tolist()
        moved = [(self.drives.names[k], self.drives.coordinates[k].unit) for k in places]
        positions, rates = ([*(joints[k] for k in own.tolist()), *moved] for own in (motion.placed, motion.independent))
        efforts = [(name, effort_unit(own)) for name, own in joints]
        states = [*positions, *((f"{name}'", own / unit("s")) for name, own in rates)]
        return states, [*efforts, *((f"{name}''", own / unit("s^2")) for name, own in moved)]

    @property
    def states(self) -> list[str]:
        """Names of the states x."""
        return [name for name, _ in self._labels[0]]

    @property
    def state_units(self) -> list[Unit]:
        """Units of the states x."""
        return [own for _, own in self._labels[0]]

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs u."""
        return [name for name, _ in self._labels[1]]

    @property
    def input_units(self) -> list[Unit]:
        """Units of the inputs u."""
        return [own for _, own in self._labels[1]]

    def shapes(self) -> Complex:
        """Return the mode shapes in all joint velocities, shape (nv, k), the largest component of each 1."""
        shapes = self.motion.shapes[0]
        largest = np.abs(shapes).argmax(axis=0)
        return np.asarray(shapes / shapes[largest, np.arange(shapes.shape[1])])

    def columns(self, inputs: Sequence[Input], loads: Array) -> Array:
        """Return inputs as combinations of the columns of B, shape (i, k).

        Args:
            loads: Loads of the forces among them per amplitude, shape (nv, forces).
        """
        columns, forces = np.zeros((len(self.inputs), len(inputs))), iter(loads.T)
        for k, driven in enumerate(inputs):
            if driven.position:
                columns[list(self.inputs).index(f"{driven.position}''"), k] = 1.0
            else:
                columns[: len(self.joints), k] = next(forces) if driven.weights is None else driven.weights
        return columns

    def response(self, frequencies: Array, outputs: Array, inputs: Array | None = None) -> Complex:
        """Return the frequency response ``C (2 pi i f - A)^-1 B``.

        Args:
            frequencies: f [Hz], shape (n,).
            outputs: C, rows over the states, shape (p, 2 d).
            inputs: B, columns over the inputs, shape (2 d, k); that of efforts at all joints where it is left out.

        Returns:
            Shape (n, p, k): per unit of each input.
        """
        b, unity = self.B if inputs is None else inputs, np.eye(len(self.A))
        return np.array([outputs @ np.linalg.solve(2j * np.pi * f * unity - self.A, b) for f in frequencies.tolist()])

    def __repr__(self) -> str:
        """Return the states and the frequencies."""
        frequencies = ", ".join(f"{frequency:.4g}" for frequency in self.modes.frequencies)
        positions = ", ".join(name for name in self.states if not name.endswith("'"))
        return f"<Linearisation of {positions}; frequencies [Hz]: {frequencies}>"

    def tables(self) -> dict[str, LabelledArray]:
        """Return eigenvalues, mode shapes and the matrices A and B as tables with names and units."""
        modes = [f"mode.{k}" for k in range(1, len(self.modes.eigenvalues) + 1)]
        rate, pure = unit("1/s"), [unit("1")] * len(modes)
        inverse = [unit("1") / measured for measured in self.state_units]
        return {
            "eigenvalues": LabelledArray(self.modes.eigenvalues[None], ["eigenvalue"], modes, [rate], pure),
            "shapes": LabelledArray(self.shapes(), self.joints, modes, self.joint_units, pure),
            "A": LabelledArray(self.A, self.states, self.states, [own * rate for own in self.state_units], inverse),
            "B": LabelledArray(
                self.B,
                self.states,
                self.inputs,
                [own * rate for own in self.state_units],
                [unit("1") / measured for measured in self.input_units],
            ),
        }

    @cached_property
    def friction(self) -> FrictionState:
        """Friction at the state."""
        return friction_state(self.state)

    @cached_property
    def _own(self) -> int:
        """Number of rows of the mechanism's constraints."""
        return self.state.mechanism.closure.size

    @cached_property
    def rows(self) -> Rows:
        """Rows of constraints, drives and slips, in this order, that hold, move or slip."""
        drives, slips = self._own + np.arange(len(self.drives.names)), self._own + len(self.drives.names)
        prescribed, stuck = drives[self.drives.prescribed], self.friction.stuck
        holding = np.concatenate([np.arange(self._own), prescribed, slips + np.flatnonzero(stuck)])
        return Rows(
            holding,
            self._own + np.arange(len(prescribed)),
            slips + np.flatnonzero(~stuck),
            self.state.mechanism.closure.rolling,
        )

    @cached_property
    def _measured(self) -> list[Measured]:
        """Constraints, coordinates of drives, and slips."""
        return [*self.state.mechanism.constraints, *self.drives.coordinates, *map(measured, self.friction.contacts)]

    @cached_property
    def derivatives(self) -> EquationDerivatives:
        """Derivatives of the equation of motion, with constraints, drives and slips."""
        state = self.state
        lam = np.concatenate([state.lam[0, : self._own], self.drives.efforts, self.friction.f])
        t, q, v, a = float(state.grid.t[0]), state.q[0], state.v[0], state.a[0]
        return equation_derivatives(state.dynamics, self._measured, t, q, v, a, lam)

    @cached_property
    def motion(self) -> LinearMotion:
        """The motion linearised about the state."""
        model, v, friction = self.state.mechanism.model, self.state.v[0], self.friction
        scale = self.state.mechanism.closure.scale
        if not len(self.rows.slipping):
            return linear_motion(model, self.derivatives, v, self.rows, scale)
        slipping = [contact for contact, stuck in zip(friction.contacts, friction.stuck, strict=True) if not stuck]
        return linear_motion(
            model, self.derivatives, v, self.rows, scale, lambda motion: friction_slopes(self.steps(motion), slipping)
        )

    def steps(self, motion: LinearMotion) -> Trajectory:
        """Return the state with an imaginary step along each state and each input of a motion, one a row."""
        size, nv = motion.b.shape[0], self.state.mechanism.model.nv
        nothing, tau = np.zeros((nv, motion.b.shape[1])), np.zeros_like(motion.whole_a)
        tau[:, size : size + nv] = np.eye(nv)
        position, velocity = (np.hstack([x, nothing]) for x in (motion.position, motion.velocity))
        return self._stepped(position, velocity, motion.whole_a, tau, motion.whole_lam, motion.friction)

    def _stepped(
        self, q: Array, v: Array, a: Array, tau: Array, lam: Array, slipping: Array, **changes: Any
    ) -> Trajectory:
        """Return the state with c imaginary steps, a row each.

        Args:
            q: Steps of positions, shape (nv, c).
            v: Of velocities, likewise.
            a: Of accelerations.
            tau: Of efforts at joints.
            lam: Of the multipliers of rows that hold, shape (m, c).
            slipping: Of friction that slips, shape (k, c).
        """
        state, model, count = self.state, self.state.mechanism.model, q.shape[1]
        efforts, f = np.zeros((len(self.drives.names), count)), np.zeros((len(self.friction.f), count))
        own, held = self._own, self._own + int(self.drives.prescribed.sum())
        efforts[self.drives.prescribed] = lam[own:held]
        f[self.friction.stuck], f[~self.friction.stuck] = lam[held:], slipping
        driven, guides = acting(model.nv, self.drives.coordinates, efforts)
        t, tangent = float(state.grid.t[0]), pin.tangentMap(model, state.q[0])
        stepped = replace(
            state,
            grid=Grid(np.full(count, t), (t, float(np.nextafter(t, np.inf))), (0, count)),
            columns={},
            q=state.q[0] + 1j * STEP * (tangent @ q).T,
            v=state.v[0] + 1j * STEP * v.T,
            a=state.a[0] + 1j * STEP * a.T,
            tau=state.tau[0] + 1j * STEP * (tau + driven).T,
            lam=state.lam[0] + 1j * STEP * np.vstack([lam[:own], guides]).T,
            directions=np.sign(np.broadcast_to(state.v, (count, model.nv))),
            **changes,
        )
        return with_friction(stepped, state.friction[0] + 1j * STEP * f.T)

    def slopes(self, names: Sequence[str]) -> Array:
        """Return the derivatives of quantities or formulas by all states and inputs, shape (p, n + i)."""
        self._require_shared(names)
        return _slopes(self.steps(self.motion), names)

    def force_slopes(self, names: Sequence[str], forces: Sequence[str]) -> tuple[Array, Array]:
        """Return loads of forces per amplitude, shape (nv, k), and derivatives of quantities by these, shape (p, k)."""
        loads, slopes = np.zeros((len(forces), self.state.v.shape[1])), np.zeros((len(forces), len(names)))
        for k, name in enumerate(forces):
            loads[k] = force_load(self.state, name)
            slopes[k] = self._force_slopes(names, name, loads[k])
        return loads.T, slopes.T

    def _force_slopes(self, names: Sequence[str], name: str, load: Array) -> Array:
        motion, size, nv = self.motion, len(self.motion.a), len(load)
        a, lam, slipping = (
            (x[:, size : size + nv] @ load)[:, None] for x in (motion.whole_a, motion.whole_lam, motion.friction)
        )
        still, dynamics = np.zeros((nv, 1)), self.state.dynamics
        changed = replace(dynamics, forces={**dynamics.forces, name: stepped_force(dynamics.forces[name])})
        return _slopes(self._stepped(still, still, a, still, lam, slipping, dynamics=changed), names)[:, 0]

    def _require_shared(self, names: Sequence[str]) -> None:
        """Raise where an output depends on how joints that friction holds share a load with constraints."""
        held = self._own + int(self.drives.prescribed.sum())
        if not self.friction.stuck.any() or not names:
            return
        rows = ConstraintRows.of(self.state.mechanism.model, self._measured).at(self.state.q).matrices[0]
        left, values, _ = np.linalg.svd(rows[self.rows.holding])
        rank = int((values > DEPENDENT * values.max(initial=0.0)).sum())
        stresses = left[:, rank:]
        stresses = stresses[:, np.abs(stresses[held:]).max(axis=0, initial=0.0) > SHARED]
        if not stresses.size:
            return
        still = np.zeros((rows.shape[1], stresses.shape[1]))
        slipping = np.zeros((int((~self.friction.stuck).sum()), stresses.shape[1]))
        slopes = _slopes(self._stepped(still, still, still, still, stresses, slipping), names)
        for name, slope in zip(names, slopes, strict=True):
            if np.abs(slope).max() > SHARED:
                raise InputError(
                    f"'{name}' depends on how joints that friction holds share their load with each other",
                    expected="an output that they do not change, or friction in fewer joints",
                )


def _slopes(steps: Trajectory, names: Sequence[str]) -> Array:
    """Return the derivatives of quantities along imaginary steps, shape (p, c)."""
    values, slopes = Quantities(steps), np.zeros((len(names), len(steps)))
    for k, name in enumerate(names):
        try:
            with complex_kept():
                slopes[k] = np.imag(values[name].values) / STEP
        except FloatingPointError:
            raise InputError(
                f"'{name}' has a kink here: it depends on the size of something that is 0 in this state",
                expected="its components, or a state in which it is not 0",
            ) from None
        except (TypeError, np.exceptions.ComplexWarning):  # of Pinocchio, and of functions of real numbers
            raise InputError(f"the linear analysis has no derivatives of '{name}'", expected="another output") from None
    return slopes


def derivatives(mechanism: Mechanism, q: Array, v: Array, a: Array, tau: Array | None, t: float) -> EquationDerivatives:
    """Return the derivatives of the equation of motion; see ``Mechanism.derivatives``."""
    q, v, a, tau = _one_state(mechanism, q, v=v, a=a, tau=tau)
    dynamics = mechanism.dynamics.on(t, float(np.nextafter(t, np.inf)))
    if mechanism.frictions:
        joints = ", ".join(dict.fromkeys(friction.name for friction in mechanism.frictions))
        raise InputError(
            f"the equation of motion has no derivative where dry friction sticks: {joints}",
            expected="a mechanism without dry friction",
            hint="friction: none in the mechanism file, or linearise, which holds joints that stick",
        )
    held = dynamics.inverse(t, q[None], v[None], a[None]) - tau
    lam = mechanism.closure.multipliers(q[None], held)
    slopes = equation_derivatives(dynamics, mechanism.constraints, t, q, v, a, lam[0])
    _require_smooth(mechanism, dynamics, t, q, v, slopes)
    return slopes


def linearise(mechanism: Mechanism, q: Array, v: Array | None, tau: Array | None, t: float) -> Linearisation:
    """Return the linearised motion; see ``Mechanism.linearise``."""
    q, v, _, tau = _one_state(mechanism, q, v=v, a=None, tau=tau)
    dynamics = mechanism.dynamics.on(t, float(np.nextafter(t, np.inf)))
    linear = Linearisation.about(replace(state_row(mechanism, dynamics, t, q, v), tau=tau[None]))
    states.check_closed(mechanism.closure, LeadingAxes(()), q[None], v[None], linear.acceleration[None], found=True)
    return linear


def linearised_row(row: Trajectory, prescribed: Sequence[str]) -> Linearisation:
    """Return the motion linearised about a row of a run; see ``Result.linearise``."""
    if row.no_efforts:
        raise InputError(f"the run has no efforts to linearise with: {row.no_efforts}")
    stops = [name for name, column in row.columns.items() if name.endswith(".stop") and column.values.any()]
    if stops or (row.opened is not None and row.opened.any()):
        said = f"{stops[0].split('.')[1]} rests on its end stop" if stops else "a cable or cam is open"
        raise InputError(f"{said} at this instant: the motion beside it is not linear", expected="another instant")
    mechanism, own = row.mechanism, row.mechanism.closure.size
    guides = {
        constraint.name: constraint.coordinate
        for constraint in row.closure.constraints
        if isinstance(constraint, GuidedCoordinate)
    }
    named = {**guides, **{name: mechanism.coordinate(name) for name in prescribed}}
    efforts = np.zeros(len(named))
    efforts[: len(guides)] = row.lam[0, own:]
    drives = Drives(
        (*named,), (*named.values(),), efforts, np.array([name in prescribed for name in named], dtype=bool)
    )
    t = float(row.grid.t[0]) if row.parameter == "t" else 0.0
    state = state_row(mechanism, row.intervals()[0][1], t, row.q[0], row.v[0])
    return Linearisation.about(replace(state, tau=row.tau, closure=row.closure), drives)


def _completed(state: Trajectory, drives: Drives) -> Trajectory:
    """Return a state with its friction, accelerations and multipliers; prescribed coordinates do not accelerate."""
    mechanism, dynamics, t, q, v = state.mechanism, state.dynamics, float(state.grid.t[0]), state.q, state.v
    own, moved = mechanism.closure.size, np.flatnonzero(drives.prescribed).tolist()
    closure = mechanism.closure.with_guides([drives.names[k] for k in moved], [drives.coordinates[k] for k in moved])
    _, guided = acting(mechanism.model.nv, drives.coordinates, drives.efforts[:, None])
    tau = state.tau + guided[:, 0] @ state.closure.rows(state.closure.state(q[0]))[own:]
    if mechanism.frictions:
        from pinarm.engine.friction.given_efforts import friction_under

        state = with_friction(state, friction_under(mechanism.frictions, dynamics, closure, t, q, v, tau)[0])
        tau = tau + state.friction_loads
    if not mechanism.massive:
        require_masses(closure, q, t)
    a = accelerations(dynamics, closure, t, q, v, tau) if closure.size else dynamics.forward(t, q, v, tau)
    held = dynamics.inverse(t, q, v, a) - tau
    lam = mechanism.closure.multipliers(q, held)
    _require_pushes(mechanism, lam[0])
    return replace(state, a=a, lam=np.hstack([lam, guided.T]))


def _require_pushes(mechanism: Mechanism, lam: Array) -> None:
    """Raise where a constraint that pulls or pushes only carries nothing, or would have to do the other."""
    for constraint in one_sided(mechanism.constraints):
        if constraint.side * lam[mechanism.closure.slices[constraint.name].start] <= AT_KINK * np.abs(lam).max():
            raise InputError(
                f"{constraint.kind} '{constraint.name}' carries no load here: {constraint.opens}",
                expected="a state in which it holds",
            )


def require_same(linear: Linearisation, later: Linearisation) -> None:
    """Raise where a steady motion has other coefficients later: its small motions then have no modes."""
    if linear.states != later.states or np.abs(linear.A - later.A).max() > CHANGED * np.abs(linear.A).max():
        raise DynamicsError(
            "the linear motion about this steady one has periodic coefficients, and no modes: it depends on how far "
            "the mechanism has turned",
            hint="a rotor with equal moments of inertia about its axis, or equal springs around it",
        )


def _one_state(mechanism: Mechanism, q: Array, **given: Array | None) -> list[Array]:
    """Return q, v, a and tau of one state as arrays, shapes (nq,) and (nv,); 0 where nothing is given."""
    leading, rows = states_of(mechanism, q, **given)
    if leading.shape:
        raise InputError(f"q has the shape {np.shape(q)}", expected=f"one state, shape ({mechanism.model.nq},)")
    return [rows.get(name, np.zeros((1, mechanism.model.nv)))[0] for name in ("q", "v", "a", "tau")]


def _require_smooth(
    mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array, slopes: EquationDerivatives
) -> None:
    """Raise where a load or the profile of a cam has a kink."""
    least = max(float(terms.max(initial=0.0)) for terms in (slopes.terms_q, slopes.terms_v))
    if name := load_at_kink(dynamics, t, q, v, mechanism.closure.scale, least):
        raise InputError(
            f"the load '{name}' has a kink here: it is not linear on either side of it",
            expected="a state beside the kink, such as with a cable taut",
        )
    for relation in cams_of(mechanism.constraints):
        if relation.has_kink(q[None]):
            raise InputError(
                f"the profile of '{relation.name}' has a kink here: its second derivative jumps",
                expected="a state beside it, or a profile that is smooth there, such as cycloidal or polynomial",
            )


NONE = 1e-9
"""Sum of parts, relative to the sum of their sizes, that is rounding of none."""

WEIGHTS, CONSTRAINTS = "weights and velocities", "forces of constraints"
"""Parts of the stiffness beside force elements."""


def participations(linear: Linearisation) -> dict[str, LabelledArray]:
    """Return the parts of bodies, springs and dampers in the energy of each mode as tables: rows are their names.

    With the mode shape x of all joints, the velocities v of the mode, a body's mass matrix ``M_i``, and the derivatives
    ``K_F = -dtau_F/dq`` and ``D_F = -dtau_F/dv`` of the load of a force element, the parts are

        x^H M_i x,    Re x^H K_F x,    Re v^H D_F v

    each relative to their sum. K_F has the geometric stiffness of a prestressed element; those of the weights, of what
    moves and of the forces of constraints are parts as well, so that the sum is the whole stiffness. Scaling a spring
    by ``1 + e`` raises the frequency of an undamped mode by ``e / 2`` times its part (Rayleigh). Modes with the
    eigenvalue 0 have no stiffness, and NaN for its parts.
    """
    rigid = linear.modes.eigenvalues == 0.0
    springs = {name: np.where(rigid, np.nan, part) for name, part in _stiffness_parts(linear).items()}
    tables = {"masses": _masses(linear), "springs": springs, "dampers": _dampings(linear)}
    modes = [f"mode.{k}" for k in range(1, len(linear.modes.eigenvalues) + 1)]
    return {
        name: LabelledArray(_shares(parts), [*parts], modes, [DIMENSIONLESS] * len(parts), [DIMENSIONLESS] * len(modes))
        for name, parts in tables.items()
        if parts
    }


def rigid_modes(linear: Linearisation) -> list[str]:
    """Return notes on the modes with the eigenvalue 0, with what acts in them."""
    modes, shapes = linear.modes, np.abs(linear.shapes())
    parts, rigid = _stiffness_parts(linear), dict[str, list[str]]()
    for k in np.flatnonzero(modes.eigenvalues == 0.0).tolist():
        moving = [name for name, part in zip(linear.joints, shapes[:, k], strict=True) if part > 1e-6]
        largest = max((abs(part).max() for part in parts.values()), default=0.0)
        acting = ", ".join(name for name, part in parts.items() if abs(part[k]) > NONE * largest)
        slow = f"{acting} cancel each other, or leave less than {modes.errors[k] / (2.0 * np.pi):.2g} Hz"
        why = slow if acting else "no force depends on where they are"
        rigid.setdefault(f"nothing drives {', '.join(moving)} back: {why}", []).append(str(k + 1))
    return [f"mode {', '.join(numbers)}: {why}" for why, numbers in rigid.items()]


def _stiffness_parts(linear: Linearisation) -> dict[str, Array]:
    """Return ``Re x^H K x`` of force elements, weights and constraints that have any stiffness, shape (k,) each."""
    shapes = linear.motion.shapes[0]
    loads = _element_slopes(linear, 0)
    tree = tree_derivatives(linear.state.mechanism.model, linear.state.q[0], linear.state.v[0], linear.state.a[0])[1]
    held = linear.derivatives.force_q - tree - sum(loads.values(), np.zeros_like(tree))
    least = NONE * float(linear.derivatives.terms_q.max(initial=0.0))
    loads |= {name: k for name, k in ((WEIGHTS, tree), (CONSTRAINTS, held)) if np.abs(k).max(initial=0.0) > least}
    return {name: _power(shapes, k) for name, k in loads.items() if k.any()}


def _masses(linear: Linearisation) -> dict[str, Array]:
    """Return ``x^H M_i x / 2`` of all bodies and rotors, shape (k,) each."""
    state, shapes = linear.state, linear.motion.shapes[0]
    model, masses = state.mechanism.model, dict[str, Array]()
    both = np.hstack([shapes.real, shapes.imag]).T
    links, twists = speeding(model, np.broadcast_to(state.q, (len(both), model.nq)), both)
    halves = links.energies(twists)[0]
    energies = halves.reshape(2, shapes.shape[1], halves.shape[-1]).sum(axis=0)
    for index, names in enumerate(links_behind(model)[1:], 1):
        if model.inertias[index].mass:
            masses[names[0] if names else str(model.names[index])] = energies[:, index]
    rotors = 0.5 * model.armature[:, None] * np.abs(shapes) ** 2
    return masses | {f"rotor at {linear.joints[k]}": rotors[k] for k in np.flatnonzero(model.armature).tolist()}


def _dampings(linear: Linearisation) -> dict[str, Array]:
    """Return ``Re v^H D v`` of force elements and of friction that slips, shape (k,) each; those that have any."""
    motion = linear.motion
    velocities = motion.shapes[1]
    powers = {name: _power(velocities, d) for name, d in _element_slopes(linear, 1).items()}
    slipping = np.flatnonzero(~linear.friction.stuck).tolist()
    friction: Complex = motion.friction[:, motion.free] @ linear.modes.vectors
    for row, k, f in zip(linear.derivatives.rows[linear.rows.slipping], slipping, friction, strict=True):
        powers[f"friction of {linear.friction.contacts[k].name}"] = -np.real(np.conj(row @ velocities) * f)
    return {name: parts for name, parts in powers.items() if parts.any()}


def _element_slopes(linear: Linearisation, order: int) -> dict[str, Array]:
    """Return K or D of force elements by name: less the derivatives of their loads by q, or by v, shape (nv, nv)."""
    state = linear.state
    t, q, v = float(state.grid.t[0]), state.q[0], state.v[0]
    return {
        name: -element_derivatives(state.mechanism.model, force, t, q, v)[order]
        for name, force in state.dynamics.forces.items()
        if not force.steady
    }


def _power(shapes: Complex, matrix: Array) -> Array:
    return np.asarray(np.real(np.einsum("ik,ij,jk->k", shapes.conj(), matrix, shapes)))


def _shares(parts: Mapping[str, Array]) -> Array:
    """Return parts relative to their sum, NaN where that is rounding, shape (rows, k)."""
    table = np.array([*parts.values()])
    total, sizes = table.sum(axis=0), np.abs(table).sum(axis=0)
    known = np.abs(total) > NONE * sizes
    return np.where(known, table / np.where(known, total, 1.0), np.nan)
