"""The controllers of a run, bound to its mechanism."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.control.controls import CONTROL, Controls, require_samples
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import mass_matrix, solve
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import InputError, Place, choices, nowhere, within
from pinarm.input.units import Unit, unit
from pinarm.mechanics.control.controller import Controller, Reader, Signal
from pinarm.mechanics.control.function import FunctionControl
from pinarm.mechanics.control.kinds import ControlDefinition, PidController
from pinarm.mechanics.control.motor_control import motor_behind
from pinarm.mechanics.joints import Joint, effort_unit
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw
from pinarm.mechanics.limited_states import FREE
from pinarm.mechanics.motors import AnyMotor, CommandOfEffort
from pinarm.mechanics.rotors import GearedRotor, gear_name
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.quantities.names import Quantities

ControlOfRun = ControlDefinition | FunctionControl
"""A controller as a file, or Python, gives it."""


@dataclass(frozen=True, eq=False)
class MechanismPlant:
    """A mechanism as controllers see it.

    Attributes:
        laws: Coordinate -> the law that it follows.
    """

    mechanism: Mechanism
    dynamics: Dynamics
    laws: Mapping[str, MotionLaw] = field(default_factory=dict)

    def drive(self, name: str) -> Joint:
        mechanism = self.mechanism
        if name in mechanism.drives:
            joint = mechanism.driven_joint(name)
        elif name in mechanism.joints:
            joint = mechanism.joints[name]
        else:
            expected, hint = choices(name, [*mechanism.drives, *mechanism.joints])
            along = f"drives: {{D: {{along: {name}}}}} in the mechanism file" if name in mechanism.coordinates else ""
            raise InputError(f"the mechanism has no drive or joint '{name}'", expected=expected, hint=along or hint)
        if {name, joint.name} & self.laws.keys():
            raise InputError(f"'{joint.name}' follows a law", expected="controllers of free joints only")
        return joint

    def command_unit(self, name: str) -> Unit:
        drive = self.mechanism.drives.get(name)
        return drive.motor.command if drive is not None and drive.motor else effort_unit(self.drive(name).unit)

    def motor_inverse(self, name: str) -> CommandOfEffort | None:
        drive = self.mechanism.drives.get(name)
        return CommandOfEffort(1.0, 0.0) if drive is None or drive.motor is None else drive.motor.inverse(drive.ratio)

    def signal(self, name: str) -> Signal:
        mechanism = self.mechanism
        named = mechanism.driven_joint(name).name if name in mechanism.drives else name
        return Signal(mechanism.model, mechanism.coordinate(named), name=named)

    def reader(self, name: str) -> Reader:
        words = name.split(".")
        if name in self.mechanism.coordinates:
            signal = self.signal(name)
            return lambda t, q, v: float(signal.measure(q, v)[0])
        if len(words) == 3 and words[0] in ("joint", "coordinate") and words[1] in self.mechanism.coordinates:
            measured = self.signal(words[1])
            if words[2] in ("position", "velocity"):
                order = ("position", "velocity").index(words[2])
                return lambda t, q, v: float(measured.measure(q, v)[order])
        series = self._quantities(0.0, np.asarray(self._start), np.zeros(self.mechanism.model.nv))[name]
        if not np.isfinite(series.values).all():
            raise InputError(f"'{name}' is not determined by positions and velocities")
        return lambda t, q, v: float(self._quantities(t, q, v)[name].values[0])

    @cached_property
    def _start(self) -> Array:
        from pinarm.engine.kinematics.assembly import generic_near

        return generic_near(self.mechanism, self.mechanism.start)

    def _quantities(self, t: float, q: Array, v: Array) -> Quantities:
        from pinarm.engine.quantities.names import Quantities

        grid = Grid(np.array([t]), (t, t), (0, 1))
        row = Trajectory.schema_row(self.mechanism, q, "t", unit("s"))
        unknown = "a controller sees positions and velocities; accelerations and efforts depend on what it does"
        never = np.full((1, len(v)), np.nan)
        return Quantities(replace(row, grid=grid, v=v[None], a=never, no_efforts=unknown, unknown=unknown))

    def inverse(self, joints: Sequence[Joint]) -> Callable[[Array | float, Array, Array, Array], Array]:
        mechanism = self.mechanism
        names = [joint.name for joint in joints]
        closure = mechanism.closure
        if not closure.size and len(joints) == mechanism.model.nv:
            return InverseOfTree(self.dynamics, np.array([joint.v for joint in joints]))
        guided = [*self.laws, *names]
        rows = closure.with_guides(guided, [mechanism.coordinate(name) for name in guided])
        here = rows.split_at(self._start)
        own = closure.split_at(self._start)
        if here.rank < own.rank + len(guided):
            raise InputError(
                f"{', '.join(guided)} do not move independently", expected="as many drives as move independently"
            )
        return InverseOfLoops(self.dynamics, rows, tuple(self.laws.values()), len(joints))


def bind_controls(
    mechanism: Mechanism,
    control: Sequence[ControlOfRun],
    dynamics: Dynamics,
    laws: Mapping[str, MotionLaw],
    duration: float,
    place: Place,
) -> Controls:
    """Return the controllers of a run, those of the mechanism first.

    Args:
        duration: Of the run [s].
    """
    plant = MechanismPlant(mechanism, dynamics, laws)
    if CONTROL in dynamics.forces:
        raise InputError(
            f"a force is called '{CONTROL}', which stands for the efforts of controllers",
            expected="another name of the force",
        )
    controllers: list[Controller] = []
    places = _places(mechanism, place)
    for number, definition in enumerate([*mechanism.control, *control]):
        with places(number):
            controllers.append(definition.bind(plant))
            require_samples(controllers[-1], duration)
            names = [joint.name for controller in controllers for joint in controller.joints]
            if twice := [name for name in names if names.count(name) > 1]:
                raise InputError(f"the joint '{twice[0]}' has two controllers", expected="one for each joint")
    return Controls(tuple(_with_motors(controllers, mechanism, places)), dynamics)


def _places(mechanism: Mechanism, place: Place) -> Callable[[int], AbstractContextManager[None]]:
    """Return a map from the number of a controller to the place of its errors; the mechanism's come first."""
    own, written = len(mechanism.control), len(mechanism.description.control)

    def places(number: int) -> AbstractContextManager[None]:
        if number >= own:
            return place("control", number - own)
        return mechanism.locate("control", number) if number < written else nowhere()

    return places


def _with_motors(
    controllers: Sequence[Controller], mechanism: Mechanism, places: Callable[[int], AbstractContextManager[None]]
) -> list[Controller]:
    complete = list[Controller]()
    for number, controller in enumerate(controllers):
        with places(number), within("drive"):
            motors = _motors(controller.drives, mechanism)
        if motors:
            source = replace(controller, supply=next(iter(motors.values())).supply)
            behind = [
                motor_behind(source, k, motor, mechanism.drives[drive].ratio)
                for k, (drive, motor) in enumerate(motors.items())
            ]
            with places(number):
                winds = isinstance(source, PidController) and source.integrals and np.isinf(source.law.tracking)
                if winds and any(motor.switches(FREE) for motor in behind):
                    raise InputError(
                        "the motor has a limit at which the integral winds up, and without kp there is no time in "
                        "which it follows the motor",
                        expected="tracking_time: such as 50 ms",
                    )
            complete += [source, *behind]
        else:
            complete.append(controller)
    return complete


def _motors(drives: Sequence[str], mechanism: Mechanism) -> dict[str, AnyMotor]:
    """Return the motors of the drives of one controller, by drive; none where they have none."""
    known = {drive: mechanism.drives[drive].motor for drive in drives if drive in mechanism.drives}
    motors: dict[str, AnyMotor] = {drive: motor for drive, motor in known.items() if motor is not None}
    if motors and (len(motors) < len(drives) or len({motor.supply for motor in motors.values()}) > 1):
        raise InputError(
            f"{', '.join(drives)} have one controller, but not motors of one kind",
            expected="motors of one kind for all drives of a controller, or a controller for each",
        )
    return motors


@dataclass(frozen=True, eq=False)
class InverseOfTree:
    """Inverse dynamics of an open chain whose joints are all driven: ``M a + nle - loads``.

    Attributes:
        order: Indices in v of the drives, shape (nv,).
    """

    dynamics: Dynamics
    order: Array

    def __call__(self, t: Array | float, q: Array, v: Array, a: Array) -> Array:
        whole = np.empty_like(v)
        whole[..., self.order] = a
        efforts = self.dynamics.inverse(t, *(np.atleast_2d(x) for x in (q, v, whole)))
        return efforts[:, self.order].reshape(np.shape(a))


@dataclass(frozen=True, eq=False)
class InverseOfLoops:
    """Inverse dynamics where other joints follow: ``M a + nle = loads + G^T lam``, see ``dynamics.equation``."""

    dynamics: Dynamics
    rows: Closure
    laws: tuple[MotionLaw, ...]
    count: int

    def __call__(self, t: Array | float, q: Array, v: Array, a: Array) -> Array:
        """Return the efforts of the drives that give them accelerations a, shape (.., k)."""
        if q.ndim == 1:
            return self._efforts(float(t), q, v, a)
        times = np.broadcast_to(np.asarray(t, float), len(q)).tolist()
        states = zip(times, q, v, a, strict=True)
        return np.array([self._efforts(*state) for state in states]).reshape(len(q), self.count)

    def _efforts(self, t: float, q: Array, v: Array, a: Array) -> Array:
        state, wanted = self.rows.state(q, v), [law.on(t, t)(np.array([t]))[2][0] for law in self.laws]
        right = -self.rows.drift(state)
        right[len(right) - self.count - len(wanted) :] += [*wanted, *a]
        split, mass = self.rows.split(self.rows.rows(state)), mass_matrix(self.dynamics.model, q)
        force = -self.dynamics.inverse(t, q[None], v[None], np.zeros((1, len(v))))[0]
        moved = solve(split, mass, force, right)
        return split.multipliers(mass @ moved - force)[-self.count :]


def with_gear_losses(mechanism: Mechanism, control: Sequence[ControlOfRun]) -> Mechanism:
    """Return a mechanism with the friction of gears whose motors have controllers; itself where none has losses."""
    commanded = {drive for controller in control for drive in controller.drives}
    known = {friction.name for friction in mechanism.frictions}
    gears = {constraint.name: constraint for constraint in mechanism.constraints if isinstance(constraint, GearedRotor)}
    losing = {
        name: drive
        for name, drive in mechanism.drives.items()
        if name in commanded and drive.efficiency < 1.0 and gear_name(name) in gears
    }
    if not losing:
        return mechanism
    from pinarm.mechanics.friction.coupling_friction import gear_loss

    losses = [gear_loss(name, gears[gear_name(name)], drive.efficiency) for name, drive in losing.items()]
    return replace(mechanism, frictions=(*mechanism.frictions, *(loss for loss in losses if loss.name not in known)))
