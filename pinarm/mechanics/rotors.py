"""Rotors that are joints of their own: of motors along a coordinate which is no joint's, or behind a gear with losses.

An angle that configurations tell up to whole turns is counted by a joint in the same way, one without inertia.

A rotor of inertia J behind a gear of ratio N, which turns with ``N w``, has the energy ``N^2 J w'^2 / 2``. It is a
joint of the model with the armature ``N^2 J`` and no body, whose coordinate x is reflected to the driven side and tied
to it, ``x - w(q) = 0``. As armatures of joints, rotors have no weight, and their bearings carry nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import Efficiency, Inertia, InputStruct, NotNegative, Positive, Ratio
from pinarm.mechanics.coordinates import Coordinate, HeldCoordinate, LinearCoordinate, Parts
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.pairs import whole_turns
from pinarm.mechanics.joints import METRE, RADIAN, Joint
from pinarm.mechanics.motors import AnyMotor
from pinarm.records import replace


class Elasticity(InputStruct, frozen=True):
    """A spring and damper between the rotor, reflected to the joint by the ratio, and the joint.

    With the deflection w, the rotor's angle over the ratio less the joint's, the joint gets ``k w + c w'``. Behind a
    backlash b it is ``k d + c w'`` with ``d = |w| - b/2``, towards the free travel, while flanks touch and this pushes.

    The parts are, from the motor on: its rotor with its inertia, the elastic input shaft, with the backlash, the teeth
    with their ``efficiency``, the joint; with an output shaft: rotor, teeth, shaft, joint. An efficiency of 1 makes no
    difference between both.

    Attributes:
        stiffness: k at the joint, effort per deflection; of an input shaft N^2 times that at the motor.
        damping: c at the joint, effort per rate of the deflection.
        shaft: Which shaft of the gear is elastic: ``input``, between rotor and teeth, or ``output``, behind them.
    """

    stiffness: Positive
    damping: NotNegative = 0.0
    shaft: Literal["input", "output"] = "input"


class Drive(InputStruct, frozen=True):
    """A motor that turns ``ratio`` times as fast as its joint, through a gear of constant efficiency.

    In place of a joint of the tree it may drive another coordinate: of a loop joint (``L.angle``, ``L.position``), or
    one defined in ``coordinates``, such as a weighted sum of joints behind a differential. The rotor then is a joint
    ``D.rotor`` whose coordinate is the driven one; torques are known where the run has a drive along the coordinate
    (``drives: [C]``).

    With v the velocity of the joint, N the ratio and tau the effort that goes through the gear, that of the drive
    (``coordinate.C.effort``; of a joint through which no other drive acts ``joint.J.effort``) less ``N^2 J a`` of the
    rotor: the motor turns at ``N v`` and gives
    ``tau / (N eta)`` while it drives (tau v > 0), ``eta tau / N`` while the load drives it, plus ``J N a`` for its
    rotor. An armature that the model gives the joint is a load of the gear.
    Where the speed passes through zero the motion that follows counts, at the end of a smooth part of a law that which
    has ended. At rest friction in the gear helps to hold, and the torque given is that which would set the load in
    motion, ``tau / (N eta)``: the safe side for sizing. A motor that is off, at a free joint, has no torque; its rotor
    is moved without loss.

    Where a controller commands the ``motor`` of a drive, a drive with an elasticity, or one along a coordinate, its
    losses act in the motion: the rotor is a joint of its own, ``D.rotor``, and ``drive.D.friction`` is what the gear
    takes; see ``mechanics.friction.coupling_friction``.

    Attributes:
        joint: Joint that it drives; this or ``along``.
        along: Coordinate that it drives, such as ``height``.
        ratio: N, motor turns per turn of the joint, or radians per metre; a number, or a fraction such as ``43/17``;
            negative where they turn against each other.
        efficiency: eta, between 0 (excluded) and 1.
        rotor_inertia: J of everything that turns with the motor, about its axis [kg*m^2].
        elasticity: Of the gear or the shaft between rotor and joint; the rotor then has a motion of its own.
        backlash: Play between both flanks, at the joint [rad or m]; with an ``elasticity``, that of the flanks.
        motor: In forward runs: a controller of the drive then commands the voltage of a motor of the kind ``dc``, or
            the torque of one of the kind ``ideal``, which may have limits over its speed.
    """

    joint: str = ""
    along: str = ""
    ratio: Ratio = 1.0
    efficiency: Efficiency = 1.0
    rotor_inertia: Inertia = 0.0
    elasticity: Elasticity | None = None
    backlash: NotNegative = 0.0
    motor: AnyMotor | None = None

    def check(self) -> None:
        if bool(self.joint) == bool(self.along):
            raise InputError("a drive acts at one joint, or along one coordinate", expected="the key joint, or along")
        if self.elasticity is None and self.backlash:
            with within("backlash"):
                raise InputError(
                    "the flanks that meet after the backlash need a stiffness", expected="elasticity: {stiffness: ...}"
                )
        if self.elasticity is not None and not self.rotor_inertia:
            with within("elasticity"):
                raise InputError("a rotor that moves by itself needs an inertia", expected="rotor_inertia: 1e-4 kg*m^2")

    @property
    def coordinate(self) -> str:
        return self.joint or self.along

    @property
    def rigid(self) -> bool:
        return self.elasticity is None

    @property
    def turns_rotor(self) -> bool:
        """Whether its rotor is a joint of its own, ``D.rotor``: it drives no joint, or its gear comes between them."""
        lossy = self.motor is not None and self.efficiency < 1.0
        return bool(self.along) or lossy or not self.rigid

    @property
    def armature(self) -> float:
        """Inertia of the rotor reflected to the joint, N^2 J [kg*m^2]."""
        return float(self.ratio * self.ratio * self.rotor_inertia)

    def torque(self, effort: Array, direction: Array, a: Array) -> Array:
        """Return the torque of the motor [N*m], shape (n,): ``tau / (N eta) + N J a``, or ``eta tau / N + N J a``.

        Args:
            effort: Effort at the joint, without the rotor's share [N*m], shape (n,).
            direction: Sign of the joint's motion: of its velocity, at standstill of the motion about to begin or just
                ended, 0 at rest; shape (n,).
            a: Joint acceleration [rad/s^2], shape (n,).
        """
        if self.efficiency < 1.0 and np.iscomplexobj(effort) and not (np.real(effort) * direction).all():
            raise FloatingPointError("the losses of a gear have a kink where it passes no power")
        gear = np.where(np.real(effort) * direction < 0.0, self.efficiency, 1.0 / self.efficiency)
        return np.asarray(gear * effort / self.ratio + self.rotor_inertia * self.ratio * a)

    def holding(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Return the least and the largest torque of the motor that hold the joint at rest [N*m], shape (n,) each.

        Less would let the load drive the gear, more would drive the load.

        Args:
            low: Least effort at the joint that holds it [N*m or N], shape (n,).
        """
        ends = (
            np.where(side * effort > 0.0, 1.0 / self.efficiency, self.efficiency) * effort / self.ratio
            for side, effort in ((-1.0, low), (1.0, high))
        )
        down, up = ends
        return np.minimum(down, up), np.maximum(down, up)

    def speed(self, v: Array) -> Array:
        """Return the motor's speed [rad/s], shape (n,)."""
        return float(self.ratio) * v


ENDLESS = np.array([np.inf])


class GearedRotor(HeldCoordinate, frozen=True, kw_only=True):
    """``x - w(q) = 0`` of a rotor, or another joint without a body, and a coordinate; its multiplier acts on the rotor.

    Attributes:
        name: ``gear of D``, ``shaft of D``, or ``turns of L.angle``.
        own: Its coordinate x.
    """

    rotor: Joint
    own: LinearCoordinate

    @property
    def follower(self) -> int | None:  # type: ignore[override]
        """Index in v of the rotor where the tie is the same in all configurations: it has no drive of its own."""
        return self.rotor.v if isinstance(self.coordinate, LinearCoordinate) else None

    @property
    def parts(self) -> Parts:
        return [(1.0, self.own), *((-sense, part) for sense, part in self.coordinate.parts)]

    @property
    def turning(self) -> GearedRotor | None:
        """Itself where w is told up to whole turns, which x or other joints count."""
        return self if self.coordinate.wraps or self.coordinate.turning is not None else None

    def helical(self, row: int) -> bool:
        return self.coordinate.wraps

    def gap(self, state: Kinematics) -> Array:
        apart = np.array([self.own.value(state) - self.coordinate.value(state)])
        return apart + self.missing_turns(apart, state.q) if self.coordinate.wraps else apart

    def missing_turns(self, gap: Array, q: Array) -> Array:
        """Return the whole turns that gaps of an angle lack at configurations [rad]."""
        if self.coordinate.wraps or self.coordinate.turning is None:
            return -whole_turns(gap)
        return -self.coordinate.turning.missing_turns(self.own.at(q) - gap, q)

    def rows(self, state: Kinematics) -> Array:
        return np.asarray(self.own.weights - self.coordinate.row(state))[None]

    def drift(self, state: Kinematics) -> Array:
        return np.array([-self.coordinate.drift(state)])

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        wrenches = self.coordinate.wrenches(links, -lam[..., 0])
        axis = np.eye(6)[0 if self.coordinate.unit == METRE else 3]  # of the rotor's joint, at the world's origin
        return {**wrenches, self.rotor.index: np.multiply.outer(lam[..., 0], axis)} if wrenches else {}


def tied_joint(name: str, coordinate: Coordinate, joint: Joint, coordinates: Mapping[str, Coordinate]) -> GearedRotor:
    """Return the tie of a joint without a body to a coordinate."""
    own = coordinates[joint.name]
    assert isinstance(own, LinearCoordinate)
    return GearedRotor(name, coordinate, rotor=joint, own=own)


def rotor_name(drive: str) -> str:
    """Return the name of the joint of a drive's rotor."""
    return f"{drive}.rotor"


def gear_name(drive: str) -> str:
    """Return the name of what ties both sides of the gear of a drive."""
    return f"gear of {drive}"


def wheel_name(drive: str) -> str:
    """Return the name of the joint of the wheel of a drive, at which an elastic output shaft begins."""
    return f"{drive}.wheel"


def shaft_name(drive: str) -> str:
    """Return the name of the joint at the end of the elastic shaft of a drive."""
    return f"{drive}.shaft"


class DriveTrain(NamedTuple):
    """The joints of its own between the motor of a drive and what it drives; none of them but the rotor has an inertia.

    Attributes:
        wheel: Whether the wheel of a gear with losses is one, ``D.wheel``: an elastic output shaft begins there.
        shaft: Whether the end of an elastic shaft is one, ``D.shaft``: it ends in teeth with losses, or drives a
            coordinate that is no sum of joints.
    """

    drive: str
    wheel: bool
    shaft: bool
    losses_behind: bool

    @classmethod
    def of(cls, name: str, drive: Drive, coordinate: Coordinate) -> DriveTrain:
        if drive.elasticity is None:
            return cls(name, False, False, False)
        lossy, output = drive.efficiency < 1.0, drive.elasticity.shaft == "output"
        behind = lossy and not output
        return cls(name, lossy and output, behind or not isinstance(coordinate, LinearCoordinate), behind)

    def joints(self, armature: float) -> dict[str, float]:
        others = ((wheel_name(self.drive), self.wheel), (shaft_name(self.drive), self.shaft))
        return {rotor_name(self.drive): armature, **{name: 0.0 for name, exists in others if exists}}

    def ties(
        self, drive: Drive, joints: Mapping[str, Joint], coordinates: Mapping[str, Coordinate]
    ) -> Iterator[GearedRotor]:
        driven, rotor, gear = coordinates[drive.coordinate], rotor_name(self.drive), gear_name(self.drive)

        def tie(name: str, coordinate: Coordinate, joint: str) -> GearedRotor:
            return tied_joint(name, coordinate, joints[joint], coordinates)

        if drive.elasticity is None:
            yield tie(gear, driven, rotor)
        if self.wheel:
            yield tie(gear, coordinates[rotor], wheel_name(self.drive))
        if self.shaft:
            yield tie(gear if self.losses_behind else f"shaft of {self.drive}", driven, shaft_name(self.drive))

    def deflection(self, drive: Drive, coordinates: Mapping[str, Coordinate]) -> LinearCoordinate:
        front = coordinates[wheel_name(self.drive) if self.wheel else rotor_name(self.drive)]
        back = coordinates[shaft_name(self.drive) if self.shaft else drive.coordinate]
        assert isinstance(front, LinearCoordinate) and isinstance(back, LinearCoordinate)
        return replace(front, weights=np.asarray(front.weights - back.weights, dtype=np.float64))


def with_rotors(model: pin.Model, drives: Mapping[str, Drive], coordinates: Mapping[str, Coordinate]) -> pin.Model:
    """Return a copy of the model with the joints of drives, whose rotors are joints of their own, at the end."""
    copy = pin.Model(model)
    for name, drive in drives.items():
        driven = coordinates[drive.coordinate]
        for joint, armature in DriveTrain.of(name, drive, driven).joints(drive.armature).items():
            _add_joint(copy, f"part of the drive '{name}'", joint, driven.unit, armature)
    return copy


def counter_name(angle: str) -> str:
    """Return the name of the joint that counts the turns of an angle."""
    return f"{angle}.counter"


def counted_angle(joint: str) -> str | None:
    """Return the angle whose turns a joint counts, by its name; ``None`` of other joints."""
    angle = joint.removesuffix(counter_name(""))
    return angle if angle != joint else None


def with_counters(model: pin.Model, angles: Sequence[str]) -> pin.Model:
    """Return a copy of the model with joints at the end that count the turns of angles."""
    copy = pin.Model(model)
    for angle in angles:
        _add_joint(copy, f"counter of '{angle}'", counter_name(angle), RADIAN, 0.0)
    return copy


def _add_joint(model: pin.Model, part: str, name: str, unit: Unit, armature: float) -> None:
    if model.existJointName(name):
        raise InputError(f"the model has a joint '{name}', as the {part} is named", expected="another name of one")
    kind = pin.JointModelPX() if unit == METRE else pin.JointModelRX()
    index = model.addJoint(0, kind, pin.SE3.Identity(), name, ENDLESS, ENDLESS, -ENDLESS, ENDLESS)
    model.armature[model.joints[index].idx_v] = armature
