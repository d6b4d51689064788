"""Derivatives of the equation of motion at one state, for trees and loops, and inputs by name.

With the rows G of the constraints and their multipliers lam,

    M a + nle - loads - G^T lam = tau,    G a + G' v = 0,    G v = 0

Pinocchio differentiates ``M a + nle`` (``computeRNEADerivatives``). Loads, ``G^T lam``, ``G a``, ``G' v`` and ``G v``
are differentiated by complex steps of the numpy evaluation: ``f'(x) = Im f(x + i h) / h`` is exact to rounding, as no
difference is taken. Derivatives by q are those along unit velocities, ``d/ds f(q + s e_k)`` on the space of
configurations.

Source: Squire and Trapp, Using complex variables to estimate derivatives of real functions, SIAM Review 40 (1998);
Carpentier and Mansard, Analytical derivatives of rigid body dynamics algorithms, RSS (2018).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import STEP, Array
from pinarm.engine.constraints.constraint_rows import ConstraintRows, Measured
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import weight_bounds
from pinarm.errors import InputError, choices
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.forces.along_coordinate import EffortAlong
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.forces.load_laws import LoadLaw
from pinarm.mechanics.forces.points import AppliedWrench
from pinarm.mechanics.joints import effort_unit
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import MotionLaw, Values
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.motion.trajectory import Trajectory


KINK_STEP, KINK, ROUNDED = 2e-5, 1e-2, 1e-6
"""Step over which the slopes of a load to both sides are compared [rad or m, rad/s or m/s]; part of the slope by which
they may differ, and part of the largest stiffness or damping that is rounding of these differences."""

MOST_VELOCITIES = 250
"""Largest number of velocities: Pinocchio's whole buffers take about 60 nv^3 bytes, 1 GB."""


class EquationDerivatives(Record, frozen=True):
    """Derivatives of the equation of motion at one state; m rows of constraints.

    Attributes:
        mass: M, shape (nv, nv).
        force_q: Of ``M a + nle - loads - G^T lam`` by q, shape (nv, nv).
        force_v: The same by v, shape (nv, nv).
        rows: G, shape (m, nv).
        rows_q: Of G by q, the velocity of the step first, shape (nv, m, nv).
        acceleration_q: Of ``G a + G' v`` by q, shape (m, nv).
        acceleration_v: The same by v, shape (m, nv).
        terms_q: Sizes of the terms that ``force_q`` is the sum of, shape (nv, nv): its rounding is relative to them.
        terms_v: The same of ``force_v``.
    """

    mass: Array
    force_q: Array
    force_v: Array
    rows: Array
    rows_q: Array
    acceleration_q: Array
    acceleration_v: Array
    terms_q: Array
    terms_v: Array


def equation_derivatives(
    dynamics: Dynamics, constraints: Sequence[Measured], t: float, q: Array, v: Array, a: Array, lam: Array
) -> EquationDerivatives:
    """Return the derivatives at a state.

    Args:
        constraints: Its constraints, and coordinates along which efforts act.
        t: Instant of loads that follow laws [s].
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        a: Acceleration, shape (nv,).
        lam: Multipliers of the constraints, and these efforts, shape (m,).
    """
    mass, force_q, force_v, speed = tree_derivatives(dynamics.model, q, v, a)
    rows, rows_q, drift_q, drift_v = _row_derivatives(dynamics.model, constraints, q, v)
    pulls, levers = weight_bounds(dynamics.model, mass), np.sqrt(np.maximum(np.diag(mass), 0.0))
    whirl = speed * np.outer(levers, levers)
    terms_q = np.abs(force_q) + np.minimum.outer(pulls, pulls) + speed * whirl
    terms_q += np.einsum("kmj,m->jk", np.abs(rows_q), np.abs(lam))
    terms_v = np.abs(force_v) + whirl
    force_q -= np.einsum("kmj,m->jk", rows_q, lam)
    for force in dynamics.changing:
        load_q, load_v = element_derivatives(dynamics.model, force, t, q, v)
        force_q, terms_q = force_q - load_q, terms_q + np.abs(load_q)
        force_v, terms_v = force_v - load_v, terms_v + np.abs(load_v)
    acceleration_q = np.einsum("kmj,j->mk", rows_q, a) + drift_q
    return EquationDerivatives(mass, force_q, force_v, rows, rows_q, acceleration_q, drift_v, terms_q, terms_v)


def tree_derivatives(model: pin.Model, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array, float]:
    """Return M, the derivatives of ``M a + nle`` by q and by v, shape (nv, nv) each, and the fastest turn [rad/s]."""
    if model.nv > MOST_VELOCITIES:
        raise InputError(
            f"the linear analysis of {model.nv} velocities would take {60e-9 * model.nv**3:.0f} GB",
            expected=f"a mechanism with {MOST_VELOCITIES} velocities at most",
        )
    data = model.createData()
    pin.computeRNEADerivatives(model, data, q, v, a)
    upper = np.triu(data.M)
    speed = max(float(np.linalg.norm(twist.angular)) for twist in data.v)
    return upper + np.triu(upper, 1).T, data.dtau_dq.copy(), data.dtau_dv.copy(), speed


def element_derivatives(model: pin.Model, force: ForceElement, t: float, q: Array, v: Array) -> tuple[Array, Array]:
    """Return the derivatives of the load of one force element by q and by v, shape (nv, nv) each."""
    nv = model.nv
    q_steps, v_steps = _steps(model, q), v + 1j * STEP * np.eye(nv)
    q_many = np.concatenate([q_steps, np.broadcast_to(q, q_steps.shape)])
    v_many = np.concatenate([np.broadcast_to(v, v_steps.shape), v_steps])
    tau = np.zeros((2 * nv, nv), dtype=complex)
    with complex_kept():
        force.add_load(t, q_many, v_many, tau)
    slopes = np.imag(tau) / STEP
    return slopes[:nv].T, slopes[nv:].T


def _row_derivatives(
    model: pin.Model, constraints: Sequence[Measured], q: Array, v: Array
) -> tuple[Array, Array, Array, Array]:
    """Return G, its derivative by q, and those of ``G' v`` by q and by v."""
    rows, nv = ConstraintRows.of(model, constraints), model.nv
    steps = _steps(model, q)
    with complex_kept():
        moved, still = rows.at(steps), rows.at(np.broadcast_to(q + 0j, steps.shape))
        rows_q = np.imag(moved.matrices) / STEP
        drift_q = np.imag(moved.drifts(np.broadcast_to(v + 0j, (nv, nv)))) / STEP
        drift_v = np.imag(still.drifts(v + 1j * STEP * np.eye(nv))) / STEP
    return rows.at(q[None]).matrices[0], rows_q, drift_q.T, drift_v.T


def _steps(model: pin.Model, q: Array) -> Array:
    """Return a configuration with an imaginary step along every velocity, shape (nv, nq)."""
    return q + 1j * STEP * pin.tangentMap(model, q).T  # type: ignore[no-any-return]


def load_at_kink(dynamics: Dynamics, t: float, q: Array, v: Array, scale: Array, least: float) -> str:
    """Return the name of a load that has other slopes to both sides of a state; empty where there is none.

    The change of a slope at a kink stays as it is over half the step, that of a curve is half of it.

    Args:
        t: Instant of loads that follow laws [s].
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,).
        scale: Size of each joint's coordinate [rad or m], shape (nv,).
        least: Size of the largest terms of stiffness and damping: a part of it is rounding.
    """
    step = KINK_STEP * np.minimum(scale, 1.0)
    for name, force in dynamics.forces.items():
        wide, near = (_slope_changes(dynamics.model, force, t, q, v, part * step) for part in (1.0, 0.5))
        slopes = KINK * wide[1].max(axis=(1, 2), keepdims=True, initial=0.0)
        if ((wide[0] > slopes + ROUNDED * least) & (near[0] > 0.75 * wide[0])).any():
            return name
    return ""


def _slope_changes(
    model: pin.Model, force: ForceElement, t: float, q: Array, v: Array, h: Array
) -> tuple[Array, Array]:
    """Return differences of the slopes of a load to both sides by q and by v, and the slopes, shape (2, nv, nv)."""
    nv = model.nv
    steps = np.concatenate([np.zeros((1, nv)), np.diag(h), -np.diag(h)])
    moved, still = np.array([pin.integrate(model, q, step) for step in steps]), np.broadcast_to(q, (len(steps), len(q)))
    tau = np.zeros((2 * len(steps), nv))
    force.add_load(t, np.concatenate([moved, still]), np.concatenate([0.0 * steps + v, v + steps]), tau)
    parts = tau.reshape(2, len(steps), nv)
    here, ahead, behind = parts[:, :1], parts[:, 1 : nv + 1], parts[:, nv + 1 :]
    return np.abs(ahead + behind - 2.0 * here) / h[:, None], np.abs(ahead - behind) / h[:, None]


@contextmanager
def complex_kept() -> Iterator[None]:
    """Raise where an imaginary part would be dropped: the derivative would be wrong without a word."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", np.exceptions.ComplexWarning)
        yield


class Input(Record, frozen=True):
    """An input of a linearised motion: an effort at joints, the amplitude of a force, or the position of a coordinate.

    Attributes:
        weights: Efforts at joints per unit, shape (nv,); ``None`` of other inputs.
        force: Name of the force element; empty of other inputs.
        position: Name of the coordinate whose position it is; empty of other inputs.
    """

    name: str
    unit: Unit
    weights: Array | None = None
    force: str = ""
    position: str = ""


def input_of(mechanism: Mechanism, forces: Mapping[str, ForceElement], name: str) -> Input:
    """Return an input by name.

    ``C`` or ``joint.C.effort`` is the effort along a coordinate, ``drive.D.torque`` that of a motor, ``force.F`` the
    amplitude of a force that follows a law, ``joint.C.position`` the prescribed position of a coordinate.
    """
    word, _, rest = name.partition(".")
    stem, _, last = rest.rpartition(".")
    known = mechanism.coordinates
    if word in ("joint", "coordinate") and stem in known and last == "position":
        return Input(name, known[stem].unit, position=stem)
    if name in known or (word in ("joint", "coordinate") and stem in known and last == "effort"):
        return _effort(name, known, name if name in known else stem)
    if word == "drive" and last == "torque" and stem in mechanism.drives:
        return _torque(mechanism, name, stem)
    if word == "force" and rest in forces:
        return Input(name, _amplitude_unit(mechanism, forces[rest], rest), force=rest)
    driven = (f"force.{key}" for key, force in forces.items() if force.laws())
    expected, hint = choices(name, [*known, *driven, *(f"drive.{key}.torque" for key in mechanism.drives)])
    raise InputError(
        f"there is no input '{name}'",
        expected=expected,
        hint=hint or "joint.J.position for the prescribed position of a joint",
    )


def _effort(name: str, known: Mapping[str, Coordinate], coordinate: str) -> Input:
    along = known[coordinate]
    if isinstance(along, LinearCoordinate):
        return Input(name, effort_unit(along.unit), along.weights)
    return Input(name, effort_unit(along.unit), force=added_name(coordinate))


def added_name(coordinate: str) -> str:
    """Return the name of the force element that stands for an effort along a task coordinate."""
    return f"effort along {coordinate}"


def _torque(mechanism: Mechanism, name: str, drive: str) -> Input:
    """Return the torque of a motor: ``ratio`` times that at its joint, or at its rotor."""
    definition, joint = mechanism.drives[drive], mechanism.driven_joint(drive)
    if definition.efficiency < 1.0:
        raise InputError(
            f"the losses of the gear of '{drive}' depend on the direction of power: they are not linear",
            expected=f"the effort at its joint, '{definition.coordinate}'",
        )
    weights = np.zeros(mechanism.model.nv)
    weights[joint.v] = float(definition.ratio)
    return Input(name, unit("N*m"), weights)


def with_inputs(mechanism: Mechanism, forces: Mapping[str, ForceElement], names: list[str]) -> dict[str, ForceElement]:
    """Return forces with an effort of 0 along each task coordinate that is an input.

    Those of inputs that follow a law over time act with 0 in the state: it is their mean.
    """
    elements = dict(forces)
    for name in names:
        key = name.partition(".")[2] if name.startswith("force.") else ""
        law = forces[key].law if key in forces else None
        if law is not None and not isinstance(law.over_time, Constant):
            elements[key] = replace(forces[key], law=replace(law, over_time=Constant(value=0.0)))
        key = name.removeprefix("coordinate.").removeprefix("joint.").removesuffix(".effort")
        along = mechanism.coordinates.get(name) or mechanism.coordinates.get(key)
        if along is not None and not isinstance(along, LinearCoordinate) and not name.endswith(".position"):
            elements[added_name(key)] = EffortAlong(mechanism.model, along, LoadLaw(Constant(value=0.0)))
    return elements


def _amplitude_unit(mechanism: Mechanism, force: ForceElement, name: str) -> Unit:
    """Return the unit of the amplitude of a force element; see ``_factor``."""
    if isinstance(force, AppliedWrench) and force.law.over_time_alone:
        pushes, turns = force.wrench[:3].any(), force.wrench[3:].any()
        return DIMENSIONLESS if pushes and turns else unit("N*m" if turns else "N")
    if isinstance(force, EffortAlong) and force.law.over_time_alone:
        return effort_unit(force.coordinate.unit)
    raise InputError(
        f"the force '{name}' has no amplitude: it follows no law over time",
        expected="a wrench, joint_effort or coordinate_effort",
    )


def _factor(force: ForceElement) -> float:
    """Return the factor of a wrench per unit of its force or its moment; 1 of one with both, and of efforts."""
    sizes = np.linalg.norm(force.wrench.reshape(2, 3), axis=1) if isinstance(force, AppliedWrench) else np.zeros(2)
    return 1.0 if sizes.all() or not sizes.any() else 1.0 / float(sizes.max())


class SteppedLaw(Record, frozen=True):
    """A law with an imaginary step."""

    law: MotionLaw
    step: complex

    def on(self, start: float, end: float) -> Callable[[Array], Values]:
        """Return the function on an interval; see ``MotionLaw``."""
        function = self.law.on(start, end)

        def stepped(t: Array) -> Values:
            value, rate, growth = function(t)
            return np.asarray(value + self.step), rate, growth

        return stepped


def stepped_force(force: ForceElement) -> ForceElement:
    """Return a force element with an imaginary step of its amplitude, on any interval."""
    assert isinstance(force, AppliedWrench | EffortAlong)
    stepped = SteppedLaw(force.law.over_time, 1j * STEP * _factor(force))
    return replace(force, law=replace(force.law, over_time=stepped))


def force_load(state: Trajectory, name: str) -> Array:
    """Return the load of a force per unit of its amplitude at a state of one row, shape (nv,)."""
    t, tau = float(state.grid.t[0]), np.zeros((1, state.v.shape[1]), complex)
    force = stepped_force(state.dynamics.forces[name]).on(t, float(np.nextafter(t, np.inf)))
    q, v = (np.asarray(x[:1] + 0j) for x in (state.q, state.v))
    force.add_load(t, q, v, tau)
    return np.asarray(np.imag(tau[0]) / STEP)
