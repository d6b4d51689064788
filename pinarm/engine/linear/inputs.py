"""Inputs of a linearised motion by name: efforts, motors, amplitudes of forces, positions of prescribed coordinates."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import STEP, Array
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
        return Input(name, effort_unit(along), along.weights)
    return Input(name, effort_unit(along), force=added_name(coordinate))


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
        return effort_unit(force.coordinate)
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
