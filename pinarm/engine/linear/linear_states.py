"""Linear analysis of a mechanism at a state: derivatives, state-space matrices, modes by name, their energies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import AT_KINK, Array, Complex
from pinarm.engine.constraints.constraint_rows import GuidedCoordinate, one_sided
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import accelerations
from pinarm.engine.dynamics.mass_matrix import require_masses
from pinarm.engine.labelled_array import LabelledArray
from pinarm.engine.linear.derivatives import (
    EquationDerivatives,
    element_derivatives,
    equation_derivatives,
    load_at_kink,
    tree_derivatives,
)
from pinarm.engine.linear.force_balance import state_row
from pinarm.engine.linear.friction import with_friction
from pinarm.engine.linear.inputs import Input
from pinarm.engine.linear.linearisation import LinearMotion, Modes
from pinarm.engine.linear.stepped_state import Drives, SteppedState
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities import states
from pinarm.engine.quantities.state_arrays import LeadingAxes, states_of
from pinarm.errors import DynamicsError, InputError
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.link_placements import speeding
from pinarm.mechanics.joints import METRE, links_behind
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

CHANGED = 1e-6
"""Change of A in a steady motion, relative to its largest entry, that is rounding."""


class Linearisation(Record, frozen=True):
    """A motion linearised about a state: ``x' = A x + B u``, with names.

    Attributes:
        states: Names of the states x: deviations of d independent coordinates, then of their velocities ``NAME'``.
        inputs: Names of the inputs u: efforts at joints, then accelerations ``NAME''`` of prescribed coordinates.
        joints: Names of all joints' coordinates.
        acceleration: Accelerations at the state, shape (nv,): 0 at an equilibrium.
        at: The state, and what holds, moves and slips at it.
    """

    motion: LinearMotion
    states: Sequence[str]
    inputs: Sequence[str]
    state_units: Sequence[Unit]
    input_units: Sequence[Unit]
    joints: Sequence[str]
    joint_units: Sequence[Unit]
    acceleration: Array
    at: SteppedState

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
        """Return the frequency response ``C (2 pi i f - A)^-1 B``, with A brought to a triangle first.

        Args:
            frequencies: f [Hz], shape (n,).
            outputs: C, rows over the states, shape (p, 2 d).
            inputs: B, columns over the inputs, shape (2 d, k); that of efforts at all joints where it is left out.

        Returns:
            Shape (n, p, k): per unit of each input.
        """
        from scipy.linalg import schur

        s = 2j * np.pi * np.asarray(frequencies, float)
        triangle, turn = schur(self.A, output="complex")
        right = turn.conj().T @ (self.B if inputs is None else inputs)
        states = np.zeros((len(s), *right.shape), complex)
        for row in range(len(right) - 1, -1, -1):
            carried = right[row] + np.einsum("j,njk->nk", triangle[row, row + 1 :], states[:, row + 1 :])
            states[:, row] = carried / (s - triangle[row, row])[:, None]
        return np.asarray((outputs @ turn) @ states)

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
    lam = Multipliers.least(mechanism.closure, q[None], held, np.zeros((1, 0)))
    slopes = equation_derivatives(dynamics, mechanism.constraints, t, q, v, a, lam[0])
    _require_smooth(mechanism, dynamics, t, q, v, slopes)
    return slopes


def linearise(mechanism: Mechanism, q: Array, v: Array | None, tau: Array | None, t: float) -> Linearisation:
    """Return the linearised motion; see ``Mechanism.linearise``."""
    q, v, _, tau = _one_state(mechanism, q, v=v, a=None, tau=tau)
    dynamics = mechanism.dynamics.on(t, float(np.nextafter(t, np.inf)))
    linear = linearised(replace(state_row(mechanism, dynamics, t, q, v), tau=tau[None]))
    states.check_found(mechanism.closure, LeadingAxes(()), q[None], v[None], linear.acceleration[None])
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
    efforts[: len(guides)] = np.asarray(row.lam)[0, own:]
    drives = Drives(
        (*named,), (*named.values(),), efforts, np.array([name in prescribed for name in named], dtype=bool)
    )
    t = float(row.grid.t[0]) if row.parameter == "t" else 0.0
    state = state_row(mechanism, row.intervals()[0][1], t, row.q[0], row.v[0])
    return linearised(replace(state, tau=row.tau, closure=row.closure), drives)


def linearised(state: Trajectory, drives: Drives | None = None) -> Linearisation:
    """Return the motion linearised about a state.

    Args:
        state: A table of one row with its efforts at joints, those of ``drives`` included; its friction, multipliers
            and accelerations follow from these.
        drives: Drives along coordinates, beside those at joints; none where it is left out.
    """
    drives = drives or Drives()
    mechanism, dynamics, t = state.mechanism, state.dynamics, float(state.grid.t[0])
    at = SteppedState(_completed(state, drives), drives)
    _require_smooth(mechanism, dynamics, t, state.q[0], state.v[0], at.derivatives)
    motion, model = at.motion, mechanism.model
    names = [coordinate_name(model, index) for index in range(model.nv)]
    sliding = {joint.v for joint in mechanism.joints.values() if joint.unit == METRE}
    every = [unit("m") if index in sliding else unit("rad") for index in range(model.nv)]
    moved = [(drives.names[k], drives.coordinates[k].unit) for k in np.flatnonzero(drives.prescribed).tolist()]
    positions, rates = (
        [*((names[index], every[index]) for index in free.tolist()), *moved]
        for free in (motion.placed, motion.independent)
    )
    efforts = [(name, unit("N") if index in sliding else unit("N*m")) for index, name in enumerate(names)]
    inputs = [*efforts, *((f"{name}''", own / unit("s^2")) for name, own in moved)]
    second = unit("s")
    return Linearisation(
        motion,
        [*(name for name, _ in positions), *(f"{name}'" for name, _ in rates)],
        [name for name, _ in inputs],
        [*(own for _, own in positions), *(own / second for _, own in rates)],
        [own for _, own in inputs],
        names,
        every,
        at.state.a[0],
        at,
    )


def _completed(state: Trajectory, drives: Drives) -> Trajectory:
    """Return a state with its friction, accelerations and multipliers; prescribed coordinates do not accelerate."""
    mechanism, dynamics, t, q, v = state.mechanism, state.dynamics, float(state.grid.t[0]), state.q, state.v
    own, moved = mechanism.closure.size, np.flatnonzero(drives.prescribed).tolist()
    closure = mechanism.closure.with_guides([drives.names[k] for k in moved], [drives.coordinates[k] for k in moved])
    _, guided = drives.acting(mechanism.model.nv, drives.efforts[:, None])
    tau = state.tau + guided[:, 0] @ state.closure.rows(state.closure.state(q[0]))[own:]
    if mechanism.frictions:
        from pinarm.engine.friction.given_efforts import friction_under

        state = with_friction(state, friction_under(mechanism.frictions, dynamics, closure, t, q, v, tau)[0])
        tau = tau + state.friction_loads
    if not mechanism.massive:
        require_masses(closure, q, t)
    a = accelerations(dynamics, closure, t, q, v, tau) if closure.size else dynamics.forward(t, q, v, tau)
    held = dynamics.inverse(t, q, v, a) - tau
    lam = np.asarray(Multipliers.least(mechanism.closure, q, held, np.zeros((1, 0))))
    _require_pushes(mechanism, lam[0])
    return replace(state, a=a, lam=Multipliers.known(np.hstack([lam, guided.T]), own))


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
    for relation in mechanism.constraints:
        if isinstance(relation, JointRelation) and relation.has_kink(q[None]):
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
    by ``1 + e`` raises the frequency of an undamped mode by ``e / 2`` times its part (Rayleigh).
    """
    tables = {"masses": _masses(linear), "springs": _stiffness_parts(linear), "dampers": _dampings(linear)}
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
    at, shapes = linear.at, linear.motion.shapes[0]
    loads = _slopes(linear, 0)
    tree = tree_derivatives(at.state.mechanism.model, at.state.q[0], at.state.v[0], at.state.a[0])[1]
    held = at.derivatives.force_q - tree - sum(loads.values(), np.zeros_like(tree))
    least = NONE * float(at.derivatives.terms_q.max(initial=0.0))
    loads |= {name: k for name, k in ((WEIGHTS, tree), (CONSTRAINTS, held)) if np.abs(k).max(initial=0.0) > least}
    return {name: _power(shapes, k) for name, k in loads.items() if k.any()}


def _masses(linear: Linearisation) -> dict[str, Array]:
    """Return ``x^H M_i x / 2`` of all bodies and rotors, shape (k,) each."""
    state, shapes = linear.at.state, linear.motion.shapes[0]
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
    motion, at = linear.motion, linear.at
    velocities = motion.shapes[1]
    powers = {name: _power(velocities, d) for name, d in _slopes(linear, 1).items()}
    slipping = np.flatnonzero(~at.friction.stuck).tolist()
    friction: Complex = motion.friction[:, motion.free] @ linear.modes.vectors
    for row, k, f in zip(at.derivatives.rows[at.rows.slipping], slipping, friction, strict=True):
        powers[f"friction of {at.friction.contacts[k].name}"] = -np.real(np.conj(row @ velocities) * f)
    return {name: parts for name, parts in powers.items() if parts.any()}


def _slopes(linear: Linearisation, order: int) -> dict[str, Array]:
    """Return K or D of force elements by name: less the derivatives of their loads by q, or by v, shape (nv, nv)."""
    state = linear.at.state
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
