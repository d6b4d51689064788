"""The controllers of a run, bound to its mechanism."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.control.controls import CONTROL, Controls
from pinarm.engine.control.memory import require_samples
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import solve
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import InputError, Place, choices, nowhere, within
from pinarm.input.units import Unit, unit
from pinarm.mechanics.control.controller import Controller, Plant, Reader, Signal
from pinarm.mechanics.control.kinds import PidController
from pinarm.mechanics.control.motor_control import MotorController
from pinarm.mechanics.joints import Joint, effort_unit
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw
from pinarm.mechanics.limited_states import FREE
from pinarm.mechanics.motors import Actuator, AnyMotor, CommandOfEffort
from pinarm.mechanics.rotors import GearedRotor, gear_name
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.quantities.names import Quantities


class ControlOfRun(Protocol):
    """A controller as a file, or Python, gives it."""

    @property
    def drives(self) -> Sequence[str]:
        """Names of the drives."""
        ...

    @property
    def description(self) -> str:
        """Text for people: the kind of the controller and the instants at which it acts."""
        ...

    def bind(self, plant: Plant) -> Controller:
        """Return the controller of one mechanism."""
        ...


@dataclass(frozen=True, eq=False)
class MechanismPlant:
    """A mechanism as controllers see it.

    Attributes:
        mechanism: The mechanism.
        dynamics: Its equation of motion with the forces of the run, without controllers.
        laws: Coordinate -> the law that it follows.
    """

    mechanism: Mechanism
    dynamics: Dynamics
    laws: Mapping[str, MotionLaw] = field(default_factory=dict)

    def drive(self, name: str) -> Joint:
        """Return the joint that a drive moves; see ``Plant``."""
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
        """Return the unit of the command of a drive; see ``Plant``."""
        drive = self.mechanism.drives.get(name)
        return drive.motor.command if drive is not None and drive.motor else effort_unit(self.drive(name))

    def motor_inverse(self, name: str) -> CommandOfEffort | None:
        """Return the command of a drive as a function of the effort at its joint; see ``Plant``."""
        drive = self.mechanism.drives.get(name)
        return CommandOfEffort(1.0, 0.0) if drive is None or drive.motor is None else drive.motor.inverse(drive.ratio)

    def signal(self, name: str) -> Signal:
        """Return a coordinate that can be measured; see ``Plant``."""
        mechanism = self.mechanism
        named = mechanism.driven_joint(name).name if name in mechanism.drives else name
        return Signal(named, mechanism.coordinate(named), mechanism.closure.state)

    def reader(self, name: str) -> Reader:
        """Return a quantity of the state by name; see ``Plant``."""
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
        """Return the efforts that give joints accelerations; see ``Plant``."""
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
        mechanism: The mechanism.
        control: The controllers of the problem.
        dynamics: The equation of motion with the other forces of the run.
        laws: Coordinates that follow laws.
        duration: Of the run [s].
        place: Gives mistakes their place.

    Raises:
        InputError: A name does not exist, a unit is another, or two controllers have the same drive.
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
            _require_own_joints(controllers)
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
    """Return controllers with the motors behind those that command their voltages or torques."""
    complete, place = list[Controller](), 0
    for number, controller in enumerate(controllers):
        with places(number), within("drive"):
            motors = _motors(controller.drives, mechanism)
        if motors:
            source = replace(controller, supply=next(iter(motors.values())).supply)
            actuators = [motor.behind(mechanism.drives[drive].ratio) for drive, motor in motors.items()]
            with places(number):
                _require_tracking(source, actuators)
            behind = MotorController.of(source, actuators, place)
            complete += [source, behind] if controller.sampling else [behind]
        else:
            complete.append(controller)
        place += len(controller.joints) if controller.sampling else 0
    return complete


def _motors(drives: Sequence[str], mechanism: Mechanism) -> dict[str, AnyMotor]:
    """Return the motors of the drives of one controller, by drive; none where they have none.

    Raises:
        InputError: They are of different kinds, or some drives have none.
    """
    known = {drive: mechanism.drives[drive].motor for drive in drives if drive in mechanism.drives}
    motors: dict[str, AnyMotor] = {drive: motor for drive, motor in known.items() if motor is not None}
    if motors and (len(motors) < len(drives) or len({motor.supply for motor in motors.values()}) > 1):
        raise InputError(
            f"{', '.join(drives)} have one controller, but not motors of one kind",
            expected="motors of one kind for all drives of a controller, or a controller for each",
        )
    return motors


def _require_tracking(controller: Controller, actuators: Sequence[Actuator]) -> None:
    """Raise where an integral would wind up beside a motor at its limit.

    Raises:
        InputError: Says which key prevents it.
    """
    winds = isinstance(controller, PidController) and controller.integrals and np.isinf(controller.tracking_time)
    if winds and any(motor.switches(FREE) for motor in actuators):
        raise InputError(
            "the motor has a limit at which the integral winds up, and without kp there is no time in "
            "which it follows the motor",
            expected="tracking_time: such as 50 ms",
        )


def _require_own_joints(controllers: Sequence[Controller]) -> None:
    """Raise where a joint has two controllers.

    Raises:
        InputError: Names it.
    """
    names = [joint.name for controller in controllers for joint in controller.joints]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"the joint '{twice[0]}' has two controllers", expected="one controller for each joint")


def demanded(dynamics: Dynamics, t: float, q: Array, v: Array, a: Array) -> Array:
    """Return ``M a + nle - loads`` of one state, shape (nv,)."""
    efforts = np.asarray(pin.rnea(dynamics.model, dynamics.data, q, v, a))
    return efforts - dynamics.loads(t, q, v) if dynamics.forces else efforts


@dataclass(frozen=True, eq=False)
class InverseOfTree:
    """Inverse dynamics of an open chain whose joints are all driven: ``M a + nle - loads``.

    Attributes:
        dynamics: The equation of motion.
        order: Indices in v of the drives, shape (nv,).
    """

    dynamics: Dynamics
    order: Array

    def __call__(self, t: Array | float, q: Array, v: Array, a: Array) -> Array:
        whole = np.empty_like(v)
        whole[..., self.order] = a
        if q.ndim > 1:
            return np.asarray(self.dynamics.inverse(t, q, v, whole)[:, self.order])
        return np.asarray(demanded(self.dynamics, t, q, v, whole)[self.order])  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class InverseOfLoops:
    """Inverse dynamics where other joints follow: ``M a + nle = loads + G^T lam``, see ``dynamics.equation``.

    Attributes:
        dynamics: The equation of motion.
        rows: G: the constraints, coordinates that follow laws, and at the end the drives.
        laws: Of these coordinates.
        count: Number of drives.
    """

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
    """Return a mechanism with the friction of gears whose motors have controllers; itself where none has losses.

    Args:
        mechanism: The mechanism, or one that has them already, as that of a result.
        control: The controllers of the run, those of the mechanism included.
    """
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
