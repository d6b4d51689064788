"""Friction in the teeth of spur wheels, on the mean of a mesh.

At the distance g from the pitch point along the line of action the flanks slide on each other with ``(w1 - w2) g``, w1
and w2 being the angular velocities of the wheels about parallel axes. G being the mean of ``|g|`` over a mesh, with a
normal force N that the pairs in contact share evenly, friction ``mu N`` takes the power ``mu N G |w1 - w2|``: the mean
slip is ``u = G (w1 - w2)`` under the load N. With the base pitch p and the parts e1 and e2 of the contact ratio that
belong to the addenda of the wheels, both below 1,

    G = p / 2 (1 - e1 - e2 + e1^2 + e2^2)

and of outer teeth the part ``mu pi (1/z1 + 1/z2) (1 - e1 - e2 + e1^2 + e2^2)`` of the power is lost.
Friction acts as opposite moments G f on the wheels; its mean force along the flanks, ``mu N (e1 - e2)``, is left out.
Source: the gear loss factor ``H_V`` of Ohlendorf (1958), as in ISO/TR 14179-2:2001, of outer teeth without helix.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import unit
from pinarm.mechanics.couplings.coupling import Coupling, outwards
from pinarm.mechanics.couplings.transmissions import ToothContact
from pinarm.mechanics.friction.bearing import Bearing
from pinarm.mechanics.friction.coupling_contact import CouplingContact
from pinarm.mechanics.friction.law import FrictionLaw
from pinarm.mechanics.geometry.link_placements import LinkPlacements

ALIGNED = 1e-9
"""Rounding of cosines, and of a number of teeth."""


@dataclass(frozen=True)
class SpurMesh:
    """Two spur wheels with the standard addendum of one module.

    Attributes:
        teeth: z1.
        radii: Pitch radii r1 and r2, that of a wheel with inner teeth negative [m].
        pressure_angle: alpha [rad].
    """

    teeth: int
    radii: tuple[float, float]
    pressure_angle: float

    @property
    def module(self) -> float:
        """Of the teeth [m]."""
        return 2.0 * self.radii[0] / self.teeth

    @property
    def contact_ratios(self) -> tuple[float, float]:
        """e1 and e2: ``(sqrt((r + m)^2 - (r cos alpha)^2) - r sin alpha) / p``."""
        cosine, sine = np.cos(self.pressure_angle), np.sin(self.pressure_angle)
        found = []
        for r in self.radii:
            tip = (r + self.module) ** 2 - (r * cosine) ** 2
            found.append(float((np.sign(r) * np.sqrt(max(tip, 0.0)) - r * sine) / self.base_pitch))
        return found[0], found[1]

    @property
    def base_pitch(self) -> float:
        """Distance p of the flanks along the line of action [m]."""
        return float(np.pi * self.module * np.cos(self.pressure_angle))

    @property
    def mean_distance(self) -> float:
        """G [m]: k pairs share the force, and k + 1 for the rest of the contact ratio above k of every mesh."""
        e1, e2 = self.contact_ratios
        pairs = int(e1 + e2)
        rest, begins = e1 + e2 - pairs, np.arange(pairs + 1, dtype=np.float64) - e2
        more = _integral(begins, begins + rest) / (pairs + 1)
        return self.base_pitch * (more + _integral(begins[:-1] + rest, begins[1:]) / pairs)

    def check(self) -> None:
        """Refuse numbers of teeth that do not fit, and wheels that are not always in contact or interfere."""
        other = abs(self.teeth * self.radii[1] / self.radii[0])
        if abs(other - round(other)) > ALIGNED * other:
            raise InputError(f"a wheel with {self.teeth} teeth would mesh with one of {other:.6g}",
                             expected="numbers of teeth that have the ratio of the gear")  # fmt: skip
        (e1, e2), (r1, r2), sine = self.contact_ratios, self.radii, np.sin(self.pressure_angle)
        feet = r1 * sine, r2 * sine if r2 > 0.0 else np.inf
        if e1 + e2 < 1.0 or e2 * self.base_pitch > feet[0] or e1 * self.base_pitch > feet[1]:
            raise InputError(
                f"with addenda of one module wheels with {self.teeth} and {round(other)} teeth interfere, or are not "
                f"always in contact: contact ratios {e1:.3g} and {e2:.3g}",
                expected="wheels that mesh without correction", hint="more teeth",
            )  # fmt: skip


def _integral(begins: Array, ends: Array) -> float:
    """Return the sum of the integrals of ``|x|``."""
    return float((ends * np.abs(ends) - begins * np.abs(begins)).sum() / 2.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class ToothFriction(CouplingContact):
    """The mean slip of spur teeth in a coupling.

    Attributes:
        couple: Moment on the first wheel of a unit friction, in the carrier [m], shape (3,).
    """

    couple: Array = field(repr=False)

    def wrenches(self, links: LinkPlacements, f: Array) -> dict[int, Array]:
        """Return the opposite moments on the two wheels."""
        known = self.coupling.transmission
        assert isinstance(known, ToothContact)
        wrench = outwards(links, known.carrier, np.multiply.outer(f, np.concatenate([np.zeros(3), self.couple])))
        return {known.first: wrench, known.second: -wrench}


def tooth_friction(
    model: pin.Model, coupling: Coupling, teeth: int, law: FrictionLaw, *, shared: bool
) -> ToothFriction:
    """Return the friction of a gear whose wheels turn about fixed parallel axes.

    Args:
        model: Pinocchio's model.
        coupling: The gear.
        teeth: Number of teeth of the first one.
        law: Of friction.
        shared: See ``FrictionContact``.

    Raises:
        InputError: Its teeth are not known, or are not those of spur wheels about fixed axes.
    """
    known = coupling.transmission
    if not isinstance(known, ToothContact) or not np.any(known.apart):
        raise InputError(f"the teeth of the gear '{coupling.name}' are not known", expected="its pressure_angle")
    axis = np.cross(known.apart, known.along) / (np.linalg.norm(known.apart) * np.linalg.norm(known.along))
    members = [int(model.joints[index].idx_v) for index in (known.first, known.second)]
    senses = [_sense(model, v, axis) for v in members]
    if known.carrier or any(abs(abs(sense) - 1.0) > ALIGNED for sense in senses):
        raise InputError(f"'{coupling.name}' is not a pair of spur wheels about fixed parallel axes",
                         expected="no carrier, helix_angle or bevel wheels, or drives with an efficiency")  # fmt: skip
    ratio, second = -float(coupling.coordinate.weights[members[0]]), 1.0 / float(np.linalg.norm(known.along))
    inner = -np.sign(ratio * senses[0] * senses[1])
    alpha = float(np.arctan(np.linalg.norm(known.apart) * second))
    mesh = SpurMesh(teeth, (second * abs(ratio), inner * second), alpha)
    with within("teeth"):
        mesh.check()
    slip = np.zeros(model.nv)
    slip[members] = mesh.mean_distance * senses[0], -mesh.mean_distance * senses[1]
    normal = Bearing.thread(np.array([1.0, 0.0, 0.0]), 1.0 / (second * float(np.cos(alpha))))
    return ToothFriction(
        f"coupling.{coupling.name}", unit("N"), coupling, slip, law, normal, shared, couple=mesh.mean_distance * axis
    )


def _sense(model: pin.Model, v: int, axis: Array) -> float:
    """Return the cosine between a joint's axis and a unit vector of the ground; 0 where the joint is not on it."""
    index = next(joint.id for joint in model.joints if joint.nv == 1 and joint.idx_v == v)
    if model.parents[index]:
        return 0.0
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    return float(data.J[3:, v] @ axis)
