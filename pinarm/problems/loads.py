"""The force elements of a run: those of the mechanism and the loads of the problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import InputError, Place, nowhere
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import Deferred
from pinarm.mechanics.forces.force_element import ForceElement, check_new
from pinarm.mechanics.laws import Constant
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.statics.actuation import Actuation
    from pinarm.mechanics.forces.kinds import Force as Force
else:  # imported where a file has loads, see LOADS
    Force = Any

LOADS: Deferred = {"loads": ("pinarm.mechanics.forces.kinds", "Force")}
"""The field of a problem that holds its loads."""


def bind_constant_loads(
    mechanism: Mechanism, loads: Mapping[str, Force], place: Place, *, moving: bool = False
) -> dict[str, ForceElement]:
    """Return the force elements of states without time, at rest or moving; see ``bind_loads``."""
    forces = bind_loads(mechanism, loads, place)
    require_constant(forces, place)
    for name, force in forces.items():
        if not moving and (law := force.law) is not None and law.gates:
            with place("loads", name):
                raise InputError(
                    f"the force '{name}' acts in one direction of motion, and at rest there is none",
                    expected="the load without while, as it is in the stroke that is meant",
                )
    return forces


def require_constant(forces: Mapping[str, ForceElement], place: Place) -> None:
    """Raise where a force follows a law over time."""
    for name, force in forces.items():
        if not all(isinstance(law, Constant) for law in force.laws()):
            with place("loads", name):
                raise InputError(
                    f"the force '{name}' follows a law over time and has no value at rest", hint="law: constant"
                )


def bind_loads(mechanism: Mechanism, loads: Mapping[str, Force], place: Place) -> dict[str, ForceElement]:
    """Return the force elements of a run by name: the mechanism's own and those of the problem."""
    forces = dict(mechanism.forces)
    for name, load in loads.items():
        with place("loads", name):
            check_new(name, forces)
            forces[name] = load.bind(mechanism.model, mechanism.joints, mechanism.coordinates)
    return forces


def schema_row(
    mechanism: Mechanism,
    start: Mapping[str, float],
    loads: Mapping[str, Force],
    parameter: str,
    measured: Unit,
    drives: Actuation,
) -> Trajectory:
    """Return one row near a start, under the forces of a run: enough to see which quantities there are."""
    from pinarm.engine.kinematics.assembly import generic_near

    forces = bind_loads(mechanism, loads, nowhere)
    row = Trajectory.schema_row(mechanism, generic_near(mechanism, start), parameter, measured, drives.closure)
    names = (*drives.coordinates(mechanism),)
    return replace(row, dynamics=Dynamics.of(mechanism.model, forces), driven=drives.driven, drives=names)
