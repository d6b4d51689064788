"""Drives: torque and speed of a motor behind its gear for the effort and motion of its joint."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.yaml.schema import Efficiency, Inertia, InputStruct, NotNegative, Positive, Ratio
from pinarm.mechanics.motors import AnyMotor


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
        """Refuse a ratio of 0, infinity or NaN, and a drive at nothing, or at two things."""
        if bool(self.joint) == bool(self.along):
            raise InputError("a drive acts at one joint, or along one coordinate", expected="the key joint, or along")
        if self.elasticity is None and self.backlash:
            with within("backlash"):
                raise InputError("the flanks that meet after the backlash need a stiffness",
                                 expected="elasticity: {stiffness: ...}")  # fmt: skip
        if self.elasticity is not None and not self.rotor_inertia:
            with within("elasticity"):
                raise InputError("a rotor that moves by itself needs an inertia", expected="rotor_inertia: 1e-4 kg*m^2")
        if self.ratio == 0.0 or not math.isfinite(self.ratio):
            with within("ratio"):
                raise InputError(
                    f"the ratio of a gear cannot be {self.ratio:g}", expected="a finite number other than 0"
                )

    @property
    def coordinate(self) -> str:
        return self.joint or self.along

    @property
    def rigid(self) -> bool:
        """Whether its joint moves as its rotor turns."""
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
        gear = np.where(effort * direction < 0.0, self.efficiency, 1.0 / self.efficiency)
        return np.asarray(gear * effort / self.ratio + self.rotor_inertia * self.ratio * a)

    def holding(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Return the least and the largest torque of the motor that hold the joint at rest [N*m], shape (n,) each.

        Less would let the load drive the gear, more would drive the load.

        Args:
            low: Least effort at the joint that holds it [N*m or N], shape (n,).
            high: Largest one.
        """
        ends = (np.where(side * effort > 0.0, 1.0 / self.efficiency, self.efficiency) * effort / self.ratio
                for side, effort in ((-1.0, low), (1.0, high)))  # fmt: skip
        down, up = ends
        return np.minimum(down, up), np.maximum(down, up)

    def speed(self, v: Array) -> Array:
        """Return the motor's speed [rad/s], shape (n,)."""
        return float(self.ratio) * v
