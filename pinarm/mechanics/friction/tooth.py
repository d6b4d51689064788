"""Friction in the teeth of wheels and racks, on the mean of a mesh.

At the distance g from the pitch point along the line of action the flanks slide on each other with ``(w1 - w2) g``, the
part of the angular velocity of the first member against the second along the pitch line times g. G being the mean of
``|g|`` over a mesh, with a normal force N that the pairs in contact share evenly, friction ``mu N`` takes the power
``mu N G |w1 - w2|``: the mean slip is ``u = G (w1 - w2)`` under the load N. With the base pitch p and the parts e1 and
e2 of the contact ratio that belong to the addenda of the members, both below 1,

    G = p / 2 (1 - e1 - e2 + e1^2 + e2^2)

- Helical wheels slide on each other like spur ones with their transverse section: the pressure angle there is
  ``tan(alpha_t) = tan(alpha) / cos(beta)``, the addendum the normal module. The normal force is larger,
  ``N = F_t / (cos(alpha) cos(beta)) = F_t / (cos(alpha_t) cos(beta_b))``, with the helix angle beta_b on the base
  cylinder. That contact lines are oblique, so that more pairs share the force where the wheels are wide, is left out.
- A rack is a wheel of infinite radius.
- Bevel wheels mesh like spur wheels on their back cones, with the radii ``r / cos(delta)`` at the pitch point, delta
  being the angles of the pitch cones (Tredgold); ``plane`` of the gear says where the pitch point is, such as at the
  mean cone distance.

Of outer teeth the part ``mu H_V`` of the power is lost, ``H_V = pi (1/z1 + 1/z2) (1 - e1 - e2 + e1^2 + e2^2) /
cos(beta_b)``, with the virtual numbers of teeth ``z / cos(delta)`` of bevel wheels.
Friction acts as opposite moments G f about the pitch line; its mean force along the flanks, ``mu N (e1 - e2)``, is left
out.
Source: the gear loss factor ``H_V`` of Ohlendorf (1958), as in ISO/TR 14179-2:2001; Niemann, Winter, Maschinenelemente
II, section 21.11 (losses), and III, section 33 (virtual spur wheels of bevel wheels).
"""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import unit
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.couplings.transmissions import PitchSurfaces, ToothContact, Transmission
from pinarm.mechanics.friction.bearing import Bearing
from pinarm.mechanics.friction.contact import CoupledSlip, FrictionContact, FrictionLaw
from pinarm.mechanics.joints import RADIAN
from pinarm.records import Record

ALIGNED = 1e-9
"""Rounding of a number of teeth."""

POINTED = float(np.arctan(np.pi / 4.0))
"""Pressure angle [rad] at which a rack's teeth, half a pitch thick, end in a point one module above the pitch line."""


class ToothMesh(Record, frozen=True):
    """Two members in mesh with the standard addendum of one normal module, in the section across the pitch line.

    Attributes:
        teeth: z1.
    """

    teeth: int
    surfaces: PitchSurfaces

    @property
    def addendum(self) -> float:
        """Normal module of the teeth [m]."""
        return 2.0 * self.surfaces.radii[0] / self.teeth * float(np.cos(self.surfaces.helix_angle))

    @property
    def pressure_angle(self) -> float:
        """alpha_t, across the pitch line [rad]."""
        return float(np.arctan(np.tan(self.surfaces.pressure_angle) / np.cos(self.surfaces.helix_angle)))

    @property
    def base_pitch(self) -> float:
        """Distance p of the flanks along the line of action [m]."""
        return 2.0 * float(np.pi * self.surfaces.radii[0] / self.teeth * np.cos(self.pressure_angle))

    @property
    def contact_ratios(self) -> tuple[float, float]:
        """e1 and e2: ``(sqrt((r + m)^2 - (r cos alpha_t)^2) - r sin alpha_t) / p`` with the addendum m.

        Multiplied out, so that it holds for a rack, ``1/r = 0``, and inner teeth, ``1/r < 0``, too.
        """
        sine, m = float(np.sin(self.pressure_angle)), self.addendum
        first, second = (
            (2.0 * m + m * m * k) / (np.sqrt(max(sine**2 + 2.0 * m * k + (m * k) ** 2, 0.0)) + sine)
            for k in self.surfaces.curvatures
        )
        return float(first / self.base_pitch), float(second / self.base_pitch)

    @property
    def mean_distance(self) -> float:
        """G [m]: k pairs share the force, and k + 1 for the rest of the contact ratio above k of every mesh."""
        e1, e2 = self.contact_ratios
        pairs = int(e1 + e2)
        rest, begins = e1 + e2 - pairs, np.arange(pairs + 1, dtype=np.float64) - e2
        more = _integral(begins, begins + rest) / (pairs + 1)
        return self.base_pitch * (more + _integral(begins[:-1] + rest, begins[1:]) / pairs)

    def check(self) -> None:
        """Refuse teeth that are pointed, do not fit, interfere, or are not always in contact."""
        if self.surfaces.pressure_angle >= POINTED:
            raise InputError(
                f"teeth with a pressure angle of {np.rad2deg(self.surfaces.pressure_angle):g} deg are pointed below "
                "their addendum of one module",
                expected=f"a pressure_angle below {np.rad2deg(POINTED):.3g} deg",
            )
        other = self.teeth * self.surfaces.radii[1] / self.surfaces.radii[0]
        if np.isfinite(other) and abs(other - round(other)) > ALIGNED * other:
            raise InputError(
                f"a wheel with {self.teeth} teeth would mesh with one of {other:.6g}",
                expected="numbers of teeth that have the ratio of the gear",
            )
        e1, e2 = self.contact_ratios
        foot1, foot2 = (np.sin(self.pressure_angle) / k if k > 0.0 else np.inf for k in self.surfaces.curvatures)
        if e1 + e2 < 1.0 or e2 * self.base_pitch > foot1 or e1 * self.base_pitch > foot2:
            mates = f"{round(other)} teeth" if np.isfinite(other) else "a rack"
            raise InputError(
                f"with addenda of one module wheels with {self.teeth} and {mates} interfere, or are not "
                f"always in contact: contact ratios {e1:.3g} and {e2:.3g}",
                expected="wheels that mesh without correction",
                hint="more teeth",
            )


def _integral(begins: Array, ends: Array) -> float:
    """Return the sum of the integrals of ``|x|``."""
    return float((ends * np.abs(ends) - begins * np.abs(begins)).sum() / 2.0)


def tooth_friction(coupling: Coupling, teeth: int, law: FrictionLaw, *, shared: bool) -> FrictionContact:
    """Return the friction of the teeth of a gear or of a rack and its pinion.

    Args:
        coupling: The gear, or the rack.
        shared: See ``FrictionContact``.
    """
    known = coupling.transmission
    if not isinstance(known, ToothContact) or not known.surfaces.pressure_angle:
        raise InputError(
            f"the teeth of the {coupling.kind} '{coupling.name}' are not known",
            expected="a gear or a rack with its pressure_angle",
        )
    mesh = ToothMesh(teeth, known.surfaces)
    with within("teeth"):
        mesh.check()
    weights = np.zeros(len(coupling.coordinate.weights))
    for joint, rate in known.surfaces.rates.items():
        weights[joint.v] = mesh.mean_distance * rate
    couple = np.concatenate([np.zeros(3), mesh.mean_distance * known.surfaces.line])
    acting = Transmission(known.carrier, known.first, known.second, known.point, -couple)
    slip = CoupledSlip(RADIAN, weights, coupling.coordinate.places, acting)
    pressing = known.wrench[:3] + known.folds[0][1][:3]
    return FrictionContact(
        f"coupling.{coupling.name}",
        unit("N"),
        law,
        Bearing.along(float(np.linalg.norm(pressing))),
        slip,
        coupling,
        shared,
    )
