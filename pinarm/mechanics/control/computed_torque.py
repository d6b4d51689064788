"""Computed torque: feed-forward by inverse dynamics, with PD feedback of accelerations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import unit
from pinarm.input.yaml.schema import AnyQuantity, check_unit
from pinarm.mechanics.control.controller import Controller, Given, Plant
from pinarm.mechanics.control.definition import ControlDefinition, measured
from pinarm.mechanics.control.references import References


class ComputedTorque(ControlDefinition, frozen=True, kw_only=True, tag_field="kind", tag="computed_torque"):
    """The efforts that inverse dynamics asks for the accelerations ``r'' + kd e' + kp e`` of the drives.

    Inverse dynamics is that of the mechanism with all its forces at the measured state: the errors obey
    ``e'' + kd e' + kp e = 0`` and vanish. What the drives do not move directly, such as free joints, follows from the
    equation of motion. Source: Siciliano et al., Robotics (2009), section 8.5.2.

    Good values: ``kp = w^2``, ``kd = 2 w`` with the pulsation w at which errors are to vanish.

    Attributes:
        follows: Laws of the drives' coordinates: one for each drive in their order, or drive -> law.
        kp: Acceleration per error [1/s^2].
        kd: Acceleration per rate of the error [1/s].
    """

    follows: References
    kp: AnyQuantity = 0.0
    kd: AnyQuantity = 0.0

    def bind(self, plant: Plant) -> Controller:
        """Return the controller of one mechanism.

        Raises:
            InputError: A drive does not exist, a unit is another, or the drives do not move independently.
        """
        joints = self.joints(plant)
        signals = measured(plant, self.drives)
        laws = self.follows.laws(self.drives, signals)
        for key, per in (("kp", "1/s^2"), ("kd", "1/s")):
            with within(key):
                check_unit(getattr(self, key), unit(per))
        with within("drive"):
            found = [plant.motor_inverse(name) for name in self.drives]
            motors = [motor for motor in found if motor is not None]
            if len(motors) < len(found):
                raise InputError("the current of a motor with inductance follows its voltage late: no voltage gives an "
                                 "effort at once", expected="a motor without inductance, or an ideal one",
                                 hint="kind: pid, or the joint's name in place of the drive's")  # fmt: skip
            inverse = plant.inverse(joints)
        bounds, sampling = self.bounds(self.units(plant)), self.sampling(signals)
        gains = float(self.kp), float(self.kd)
        return ComputedTorqueController(
            tuple(self.drives), joints, signals, laws, *bounds, sampling, *gains, np.array(motors).T, inverse
        )


@dataclass(frozen=True, eq=False)
class ComputedTorqueController(Controller):
    """Computed torque of one mechanism.

    Attributes:
        kp: Acceleration per error [1/s^2].
        kd: Acceleration per rate of the error [1/s].
        motors: Command of each drive per effort and per velocity of its joint, shape (2, k); see ``CommandOfEffort``.
        inverse: ``(t, q, v, a) -> efforts`` of the drives; see ``Plant.inverse``.
    """

    kp: float
    kd: float
    motors: Array = field(repr=False)
    inverse: Callable[[Array | float, Array, Array, Array], Array] = field(repr=False)

    def command(self, given: Given) -> Array:
        """Return the efforts of the accelerations ``r'' + kd e' + kp e``, or the commands of motors that give them."""
        error = given.error
        wanted = given.reference[..., 2] + self.kd * error[..., 1] + self.kp * error[..., 0]
        per_effort, per_velocity = self.motors
        velocities = given.v[..., [joint.v for joint in self.joints]]
        efforts = self.inverse(given.t, given.q, given.v, wanted)
        return np.asarray(per_effort * efforts + per_velocity * velocities)
