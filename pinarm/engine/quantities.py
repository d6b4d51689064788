"""Quantities by name: what can be asked of a trajectory, and how it is computed.

==========================================  =====================================================================
``t``                                       the parameter that runs along the rows
``joint.J.position .velocity .acceleration``  of a joint with one coordinate
``joint.J.effort .power``                   of its drive, without the rotor's own share
``joint.J.force.x``, ``joint.J.moment.x``   action of the parent on the child at the joint's origin, world axes
``coordinate.C.position`` (and so on)       of any coordinate
``point.P.position.x``, ``.velocity.x`` ...  of a link's origin, world axes; ``.norm`` for the length
``body.B.angular_velocity.x``               of a link, world axes
``drive.D.torque .speed .power``            at the motor
``energy.kinetic .potential .total``        of the whole mechanism, springs and rotors included
==========================================  =====================================================================

Formulas combine them with the published symbols, the model's arguments and ``g``, the magnitude of gravity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.trajectory import Series, Trajectory
from pinarm.errors import InputError, choices
from pinarm.input.expressions import CONSTANTS, Expression
from pinarm.input.units import Unit, unit
from pinarm.mechanics.coordinates import METRE, LinearCoordinate, frame_of
from pinarm.mechanics.forces.joint import effort_unit

COMPONENTS = {"x": 0, "y": 1, "z": 2}
SECOND, JOULE, WATT, NEWTON, NEWTON_METRE = unit("s"), unit("J"), unit("W"), unit("N"), unit("N*m")
MAX_DEPTH = 50
"""Symbols may stand for symbols; deeper nesting would exhaust the interpreter's stack."""
RATES = ("position", "velocity", "acceleration")
ENERGIES = ("kinetic", "potential", "total")


@dataclass
class Quantities:
    """The quantities of one trajectory; what needs a pass over the rows is computed once, when first asked.

    Attributes:
        trajectory: The motion.
        symbols: Formulas by name, beside those of the mechanism.
    """

    trajectory: Trajectory
    symbols: Mapping[str, Expression] = field(default_factory=dict)
    _known: dict[str, Series] = field(default_factory=dict, repr=False)
    _passes: dict[str, Array] = field(default_factory=dict, repr=False)
    _open: list[str] = field(default_factory=list, repr=False)

    def __getitem__(self, name: str) -> Series:
        """Return a quantity by its name, a symbol, or a formula of them.

        Raises:
            InputError: There is no such quantity; the message lists what there is.
        """
        if name not in self._known:
            self._known[name] = self._find(name)
        return self._known[name]

    def names(self) -> list[str]:
        """Return the names of all quantities, for messages and completion."""
        mechanism = self.trajectory.mechanism
        vectors = [f"{rate}.{axis}" for rate in RATES for axis in (*COMPONENTS, "norm")]
        links = [frame.name for frame in mechanism.model.frames if frame.type == pin.FrameType.BODY][1:]
        wrench = [f"{part}.{axis}" for part in ("force", "moment") for axis in COMPONENTS]
        return [
            self.trajectory.parameter, "g", *self.symbols, *mechanism.symbols, *mechanism.arguments,
            *(f"joint.{name}.{part}" for name in mechanism.joints for part in (*RATES, "effort", "power", *wrench)),
            *(f"coordinate.{name}.{rate}" for name in mechanism.coordinates for rate in RATES),
            *(f"point.{name}.{part}" for name in links for part in vectors),
            *(f"body.{name}.angular_velocity.{axis}" for name in links for axis in (*COMPONENTS, "norm")),
            *(f"drive.{name}.{part}" for name in mechanism.drives for part in ("torque", "speed", "power")),
            *(f"energy.{part}" for part in ENERGIES),
        ]  # fmt: skip

    def _find(self, name: str) -> Series:
        mechanism, rows = self.trajectory.mechanism, len(self.trajectory)
        if name == self.trajectory.parameter:
            return Series(name, self.trajectory.unit, self.trajectory.grid.t)
        for symbols in (self.symbols, mechanism.symbols):
            if name in symbols:
                return self._evaluate(name, symbols[name])
        if name in mechanism.arguments:
            return Series(name, mechanism.argument_units.get(name), np.full(rows, mechanism.arguments[name]))
        if name == "g":
            return Series(name, unit("m/s^2"), np.full(rows, mechanism.gravity))
        if name in mechanism.coordinates:
            return self._of_coordinate(f"coordinate.{name}.position", name, "position")
        kind, _, rest = name.partition(".")
        finder = _KINDS.get(kind)
        if finder is not None and rest:
            return finder(self, name, rest)
        return self._evaluate(name, Expression.parse(name), formula=True)

    def _evaluate(self, name: str, expression: Expression, *, formula: bool = False) -> Series:
        """Evaluate a symbol, or a formula that a user wrote where a name could stand."""
        if name in self._open:
            raise InputError(f"the symbol '{name}' is defined by itself: {' -> '.join([*self._open, name])}")
        if len(self._open) >= MAX_DEPTH:
            raise InputError(f"the symbol '{self._open[0]}' stands for symbols nested more than {MAX_DEPTH} deep")
        if formula and expression.names == {name}:
            raise self._unknown(name)
        self._open.append(name)
        try:
            found = self._operands(expression)
        finally:
            self._open.pop()
        values = expression.evaluate({inner: series.values for inner, series in found.items()})
        dimension = expression.dimension({inner: series.unit for inner, series in found.items()})
        alone = found.get(expression.text.strip())
        measured = alone.unit if alone else Unit(1.0, dimension.dimension) if dimension else None
        return Series(name, measured, np.broadcast_to(np.asarray(values, float), len(self.trajectory)))

    def figure(self, text: str) -> Array:
        """Return the value of a formula that holds printed figures, which come without units; shape () or (n,)."""
        expression = Expression.parse(text)
        found = self._operands(expression)
        return np.asarray(expression.evaluate({inner: series.values for inner, series in found.items()}), float)

    def _operands(self, expression: Expression) -> dict[str, Series]:
        return {inner: self[inner] for inner in expression.names if not _is_constant(inner, self)}

    def _unknown(self, name: str) -> InputError:
        available = self.names()
        kind = name.partition(".")[0]
        near = [other for other in available if other.startswith(f"{kind}.")] or available
        expected, hint = choices(name, near, most=16)
        return InputError(f"there is no quantity '{name}'", expected=expected, hint=hint)

    def _of_joint(self, name: str, rest: str) -> Series:
        joint_name, _, part = rest.partition(".")
        joint = self.trajectory.mechanism.joints.get(joint_name)
        if joint is None:
            raise self._unknown(name)
        if part in RATES:
            return self._of_coordinate(name, joint_name, part)
        if part in ("effort", "power"):
            effort = self._effort(joint.v)
            if part == "effort":
                return Series(name, effort_unit(joint), effort)
            return Series(name, WATT, effort * self.trajectory.v[:, joint.v])
        wrench, _, axis = part.partition(".")
        if wrench not in ("force", "moment") or axis not in COMPONENTS:
            raise self._unknown(name)
        column = COMPONENTS[axis] + (3 if wrench == "moment" else 0)
        measured = NEWTON if wrench == "force" else NEWTON_METRE
        return Series(name, measured, self._reactions()[:, joint.index, column])

    def _effort(self, v: int) -> Array:
        """Return the effort between the links, without what accelerates the drive's own rotor."""
        armature = float(self.trajectory.mechanism.model.armature[v])
        return self.trajectory.tau[:, v] - armature * self.trajectory.a[:, v]

    def _of_coordinate(self, name: str, coordinate_name: str, rate: str) -> Series:
        coordinate = self.trajectory.mechanism.coordinates.get(coordinate_name)
        if coordinate is None or rate not in RATES:
            raise self._unknown(name)
        order = RATES.index(rate)
        measured = coordinate.unit / SECOND**order if order else coordinate.unit
        values = self._coordinate_pass(coordinate_name)[:, order]
        return Series(name, _turning(measured, coordinate.unit, order), values)

    def _of_named_coordinate(self, name: str, rest: str) -> Series:
        coordinate_name, _, rate = rest.rpartition(".")
        return self._of_coordinate(name, coordinate_name, rate)

    def _of_point(self, name: str, rest: str) -> Series:
        point, _, part = rest.partition(".")
        rate, _, axis = part.partition(".")
        if rate not in RATES or axis not in (*COMPONENTS, "norm"):
            raise self._unknown(name)
        values = self._frame_pass(point)[:, RATES.index(rate)]
        return Series(name, METRE / SECOND ** RATES.index(rate), _component(values, axis))

    def _of_body(self, name: str, rest: str) -> Series:
        body, _, part = rest.partition(".")
        rate, _, axis = part.partition(".")
        if rate != "angular_velocity" or axis not in (*COMPONENTS, "norm"):
            raise self._unknown(name)
        return Series(name, unit("rad/s"), _component(self._frame_pass(body)[:, 3], axis))

    def _of_drive(self, name: str, rest: str) -> Series:
        drive_name, _, part = rest.partition(".")
        drive = self.trajectory.mechanism.drives.get(drive_name)
        if drive is None or part not in ("torque", "speed", "power"):
            raise self._unknown(name)
        index = self.trajectory.mechanism.joints[drive.joint].v
        v, a = self.trajectory.v[:, index], self.trajectory.a[:, index]
        speed = drive.speed(v)
        if part == "speed":
            return Series(name, unit("rad/s"), speed)
        torque = drive.torque(self._effort(index), self.trajectory.direction(index), a)
        return Series(name, NEWTON_METRE, torque) if part == "torque" else Series(name, WATT, torque * speed)

    def _of_energy(self, name: str, rest: str) -> Series:
        if rest not in ENERGIES:
            raise self._unknown(name)
        if "energy" not in self._passes:
            kinetic, potential = self.trajectory.dynamics.energy(self.trajectory.q, self.trajectory.v)
            self._passes["energy"] = np.array([kinetic, potential, kinetic + potential])
        return Series(name, JOULE, self._passes["energy"][ENERGIES.index(rest)])

    def _coordinate_pass(self, name: str) -> Array:
        """Return a coordinate with its derivatives at every row, shape (n, 3)."""
        coordinate = self.trajectory.mechanism.coordinates[name]
        run = self.trajectory
        if isinstance(coordinate, LinearCoordinate):
            weights = coordinate.weights
            return np.array([run.q[:, coordinate.places] @ weights, run.v @ weights, run.a @ weights]).T
        key = f"coordinate.{name}"
        if key not in self._passes:
            model, data, rows = run.mechanism.model, run.mechanism.model.createData(), np.empty((len(run), 3))
            still = np.zeros(model.nv)
            for i in range(len(run)):
                pin.computeJointJacobians(model, data, run.q[i])
                pin.forwardKinematics(model, data, run.q[i], run.v[i], still)
                pin.updateFramePlacements(model, data)
                row = coordinate.row(model, data)
                rows[i] = (
                    coordinate.value(data, run.q[i]),
                    row @ run.v[i],
                    row @ run.a[i] + coordinate.drift(model, data),
                )
            self._passes[key] = rows
        return self._passes[key]

    def _frame_pass(self, name: str) -> Array:
        """Return position, velocity, acceleration and angular velocity of a link at every row, shape (n, 4, 3)."""
        key = f"frame.{name}"
        if key not in self._passes:
            run, rows = self.trajectory, np.empty((len(self.trajectory), 4, 3))
            model, data = run.mechanism.model, run.mechanism.model.createData()
            frame, world = frame_of(model, name), pin.LOCAL_WORLD_ALIGNED
            for i in range(len(run)):
                pin.forwardKinematics(model, data, run.q[i], run.v[i], run.a[i])
                pin.updateFramePlacement(model, data, frame)
                velocity = pin.getFrameVelocity(model, data, frame, world)
                rows[i, 0], rows[i, 1] = data.oMf[frame].translation, velocity.linear
                rows[i, 2] = pin.getFrameClassicalAcceleration(model, data, frame, world).linear
                rows[i, 3] = velocity.angular
            self._passes[key] = rows
        return self._passes[key]

    def _reactions(self) -> Array:
        """Return the wrench of the parent on the child at every joint and row, world axes, shape (n, njoints, 6)."""
        if "reactions" not in self._passes:
            run = self.trajectory
            model, data = run.mechanism.model, run.mechanism.model.createData()
            rows = np.zeros((len(run), model.njoints, 6))
            for i in range(len(run)):
                pin.forwardKinematics(model, data, run.q[i])
                pin.rnea(model, data, run.q[i], run.v[i], run.a[i])
                for joint in range(1, model.njoints):
                    turn, wrench = data.oMi[joint].rotation, data.f[joint]
                    rows[i, joint, :3], rows[i, joint, 3:] = turn @ wrench.linear, turn @ wrench.angular
            self._passes["reactions"] = rows
        return self._passes["reactions"]


_KINDS: dict[str, Callable[[Quantities, str, str], Series]] = {
    "joint": Quantities._of_joint,
    "coordinate": Quantities._of_named_coordinate,
    "point": Quantities._of_point,
    "body": Quantities._of_body,
    "drive": Quantities._of_drive,
    "energy": Quantities._of_energy,
}


def _component(vectors: Array, axis: str) -> Array:
    return np.linalg.norm(vectors, axis=1) if axis == "norm" else vectors[:, COMPONENTS[axis]]


def _turning(measured: Unit, base: Unit, order: int) -> Unit:
    """Name the unit of an angle's derivative rad/s, not 1/s."""
    if base == METRE:
        return measured
    return (unit("rad"), unit("rad/s"), unit("rad/s^2"))[order]


def _is_constant(name: str, quantities: Quantities) -> bool:
    """Tell whether a name is one of the language's own constants, which every other name overrides."""
    if name not in CONSTANTS:
        return False
    mechanism = quantities.trajectory.mechanism
    return not any(name in names for names in (quantities.symbols, mechanism.symbols, mechanism.arguments))
