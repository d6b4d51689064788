"""Friction between the members of couplings: threads, teeth, belts, cams and the gears of drives.

**Threads**: screws that close loops, and screws and worms between joints. On the mean radius r a thread rises with the
lead angle ``tan L = h / r``, h being the way per angle. The parts slip along the thread, with ``u = r cos L omega + sin
L z'``. The axial force Q that holds way and angle together is that of the normal force of the flanks, ``N = Q / (cos L
cos A)``; the angle A of the flank in the section normal to the thread follows from that in the axial section, ``tan A =
tan flank cos L``. With friction ``mu N`` along the thread the torque that raises a load W is ``W r tan(L + atan(mu /
cos A))``. A worm is such a screw, its wheel, of radius R, the nut, with ``h = R q2 / q1``. Source: Shigley, Mechanical
Engineering Design, sections 8-2 (power screws) and 13-17 (worm gears).

**Belts**: on the wheel with the smaller angle of wrap theta the tensions of the strands differ at most by the factor
``exp(mu theta)`` (Euler, Eytelwein). With ``T1 + T2 = 2 F0``, F0 being the pretension, the pull on the wheels' rims is
at most ``T1 - T2 = 2 F0 tanh(mu theta / 2)``, whatever else acts: a dry friction with this constant, against the slip
``r2 q2' - r1 q1'`` of the belt. Up to it the belt sticks and ties the wheels; beyond, each is free. The belt has no
mass, so that no speed loosens it; creep of elastic belts is left out. Source: Shigley, section 17-2 (flat- and
round-belt drives).

**Cams**: the follower's material point at the contact slips along the cam with u, and the normal force N is that of the
contact. A flat face or a knife edge has the friction ``mu N`` against u. A roller of radius R turns on a pin of radius
r with ``u / R``, so that the moment ``mu N r`` of the pin acts as ``mu N r / R`` along the tangent. That it rolls
without slip on the cam, and that the pin's load is N alone, is taken for granted.

**Gears of drives**, between a rotor and what it drives: the gear transmits T from the rotor, whose coordinate is
reflected to the driven side, to what it drives, both of the velocity v. With the friction ``f = mu |T|`` against the
mean of the two velocities, which are one, each side bears half of it. The rotor gives ``T + f/2`` and the driven side
gets ``T - f/2`` while the motor drives; with the signs turned round while it is driven. The efficiency is the same in
both directions of power, ``eta = (1 - mu/2) / (1 + mu/2)``, ``mu = 2 (1 - eta) / (1 + eta)``. At rest f is whatever
holds the gear, up to ``mu |T|``: between ``eta tau`` and ``tau / eta`` of the motor hold a load tau. A motor without
torque is turned by any load: such a gear never locks.
"""

from __future__ import annotations

from math import atan, cos, sin, sqrt, tan, tanh

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.mechanics.couplings.cam import CamContact, CamCoupling, along
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.couplings.transmissions import (
    NEWTON,
    NEWTON_METRE,
    FixedContact,
    Part,
    PitchSurfaces,
    Strands,
    Transmission,
    at_origin,
    outwards,
)
from pinarm.mechanics.friction.contact import Bearing, CoupledSlip, FrictionContact, FrictionLaw
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import RADIAN, effort_unit
from pinarm.mechanics.rotors import GearedRotor
from pinarm.records import Record, ValueRecord, replace


class ThreadGeometry(ValueRecord, frozen=True):
    """The mean helix of a thread.

    Attributes:
        radius: r [m].
        pitch: h, way per angle [m/rad], negative of a left-handed thread.
        flank: Angle of the flank in the axial section [rad]: 0 of a square thread, 30 deg of a metric one.
    """

    radius: float
    pitch: float
    flank: float

    @property
    def lead_angle(self) -> float:
        """L [rad], of the sign of the pitch."""
        return atan(self.pitch / self.radius)

    @property
    def along(self) -> tuple[float, float]:
        """Slip along the thread per angle [m/rad], and per way."""
        return self.radius * cos(self.lead_angle), sin(self.lead_angle)

    @property
    def lever(self) -> float:
        """Normal force of the flanks per axial force, ``1 / (cos L cos A)``."""
        normal = atan(tan(self.flank) * cos(self.lead_angle))
        return 1.0 / (cos(self.lead_angle) * cos(normal))

    def acting(self, known: Transmission | None) -> FixedContact | None:
        """Return the wrenches of a unit friction: axial force and moment on the nut, the opposite on the screw.

        ``None`` where the contact of the thread is not known: friction then acts as efforts at the coupled joints.
        """
        if not isinstance(known, FixedContact) or "torque" not in known.single:
            return None
        turning, sliding = self.along
        force = at_origin(known.point, known.wrench[:3])
        wrench = sliding * force - turning / known.single["torque"].size * (known.wrench - force)
        single = {"axial": Part(NEWTON, sliding), "torque": Part(NEWTON_METRE, -turning)}
        return FixedContact(known.carrier, known.first, known.second, point=known.point, wrench=wrench, single=single)


def belt_grip(coupling: Coupling, law: FrictionLaw) -> tuple[FrictionLaw, CoupledSlip]:
    """Return the law of a belt's pull on its wheels, and its slip."""
    known, wheels = coupling.transmission, coupling.coordinate
    if not isinstance(known, Strands) or not known.pretension:
        raise InputError(f"without a pretension the belt '{coupling.name}' has no grip", expected="its pretension")
    slipping, resting = (2.0 * known.pretension * tanh(0.5 * mu * known.wrap) for mu in (law.mu, law.static_mu))
    constants = {"constant": law.constant + slipping, "static_constant": law.static_constant + resting}
    radius = 1.0 / abs(known.difference)
    slip = CoupledSlip(wheels.unit, radius * wheels.weights, wheels.places, known.scaled(radius))
    return replace(law, mu=0.0, static_mu=0.0, **constants), slip


class CamSlip(Record, frozen=True):
    """The slip of a follower on its cam, along the tangent of the contact [m/s].

    Attributes:
        cam: The coupling, whose contact is known.
    """

    cam: CamCoupling

    @property
    def contact(self) -> CamContact:
        assert self.cam.contact is not None
        return self.cam.contact

    def row(self, state: Kinematics) -> Array:
        """Return J, shape (nv,): the slip of the follower, and that of the cam under it."""
        cam, (turning, moving) = self.cam, self.contact.senses
        touch, row = self.contact.touch(state.q[None]), np.zeros(cam.nv)
        row[cam.cam_joint.v] = -turning * along(touch.tangent, 1j * touch.point)[0]
        row[cam.follower_joint.v] = moving * along(touch.tangent, touch.velocity)[0]
        return row

    def drift(self, state: Kinematics) -> float:
        """Return J' v: of the slip ``k alpha'`` the part ``k' alpha'^2`` less what the drift of the follower does."""
        q, v, cam = state.q[None], state.v[None], self.cam
        follower = self.row(state)[cam.follower_joint.v] * cam.drifts_at(q, v)[0]
        return float(self.contact.touch(q, v).slip_rate[0] * state.v[cam.cam_joint.v] ** 2 + follower)

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        touch = self.contact.touch(links.q)
        acting = self.contact.opposite(touch, effort * touch.tangent)
        return {body: outwards(links, self.contact.carrier, wrench) for body, wrench in acting.items()}


def part_of_roller(cam: CamCoupling, pin: float) -> float:
    """Return the friction of a cam's contact per normal force and mu: that of the pin of its roller, or 1.

    Args:
        pin: Radius of the pin of its roller [m]; 0 where it has none.
    """
    if cam.contact is None:
        raise InputError(
            f"where the cam '{cam.name}' touches its follower is not known", expected="a cam with its roller or face"
        )
    radius = cam.contact.follower.radius
    if radius and not 0.0 < pin < radius:
        with within("radius"):
            raise InputError(
                f"friction of the roller of '{cam.name}' needs the radius of its pin",
                expected=f"a radius below that of the roller, {radius:g} m",
            )
    if pin and not radius:
        with within("radius"):
            raise InputError(f"the follower of '{cam.name}' has no roller, and no pin", expected="no radius")
    return pin / radius if radius else 1.0


class GearSlip(Record, frozen=True):
    """Mean of the velocities of a rotor and of what it drives."""

    gear: GearedRotor

    def row(self, state: Kinematics) -> Array:
        row = 0.5 * np.asarray(self.gear.coordinate.row(state), dtype=np.float64)
        row[self.gear.rotor.v] += 0.5
        return row

    def drift(self, state: Kinematics) -> float:
        return 0.5 * self.gear.coordinate.drift(state)

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        """Return the wrenches of friction on the driven links; empty where it acts as joint efforts."""
        return self.gear.coordinate.wrenches(links, 0.5 * effort)


def gear_loss(drive: str, gear: GearedRotor, efficiency: float) -> FrictionContact:
    """Return the friction in the gear of a drive with an efficiency eta, above 0 and below 1."""
    mu = 2.0 * (1.0 - efficiency) / (1.0 + efficiency)
    effort = effort_unit(gear.coordinate.unit)
    law = FrictionLaw(mu, mu, 0.0, 0.0)
    return FrictionContact(f"drive.{drive}", effort, law, Bearing.along(1.0), GearSlip(gear), gear)


ALIGNED = 1e-9
"""Rounding of a number of teeth."""

POINTED = float(np.arctan(np.pi / 4.0))
"""Pressure angle [rad] at which a rack's teeth, half a pitch thick, end in a point one module above the pitch line."""


class ToothMesh(Record, frozen=True):
    """Two members in mesh with the standard addendum of one normal module, in the section across the pitch line.

    At the distance g from the pitch point along the line of action the flanks slide on each other with ``(w1 - w2)
    g``, the part of the angular velocity of the first member against the second along the pitch line times g. G being
    the mean of ``|g|`` over a mesh, with a normal force N that the pairs in contact share evenly, friction ``mu N``
    takes the power ``mu N G |w1 - w2|``: the mean slip is ``u = G (w1 - w2)`` under the load N. With the base pitch p
    and the parts e1 and e2 of the contact ratio that belong to the addenda of the members, both below 1,

        G = p / 2 (1 - e1 - e2 + e1^2 + e2^2)

    - Helical wheels slide on each other like spur ones with their transverse section: the pressure angle there is
      ``tan(alpha_t) = tan(alpha) / cos(beta)``, the addendum the normal module. The normal force is larger, ``N = F_t
      / (cos(alpha) cos(beta)) = F_t / (cos(alpha_t) cos(beta_b))``, with the helix angle beta_b on the base cylinder.
      That contact lines are oblique, so that more pairs share the force where the wheels are wide, is left out.
    - A rack is a wheel of infinite radius.
    - Bevel wheels mesh like spur wheels on their back cones, with the radii ``r / cos(delta)`` at the pitch point,
      delta being the angles of the pitch cones (Tredgold); ``plane`` of the gear says where the pitch point is, such
      as at the mean cone distance.

    Of outer teeth the part ``mu H_V`` of the power is lost, ``H_V = pi (1/z1 + 1/z2) (1 - e1 - e2 + e1^2 + e2^2) /
    cos(beta_b)``, with the virtual numbers of teeth ``z / cos(delta)`` of bevel wheels. Friction acts as opposite
    moments G f about the pitch line; its mean force along the flanks, ``mu N (e1 - e2)``, is left out. Source: the
    gear loss factor ``H_V`` of Ohlendorf (1958), as in ISO/TR 14179-2:2001; Niemann, Winter, Maschinenelemente II,
    section 21.11 (losses), and III, section 33 (virtual spur wheels of bevel wheels).

    Attributes:
        teeth: z1.
        section_angle: alpha_t, the pressure angle across the pitch line [rad].
        base_pitch: p, the distance of the flanks along the line of action [m].
        contact_ratios: e1 and e2: ``(sqrt((r + m)^2 - (r cos alpha_t)^2) - r sin alpha_t) / p`` with the addendum m,
            multiplied out, so that it holds for a rack, ``1/r = 0``, and inner teeth, ``1/r < 0``, too.
    """

    teeth: int
    surfaces: PitchSurfaces
    section_angle: float
    base_pitch: float
    contact_ratios: tuple[float, float]

    @classmethod
    def of(cls, teeth: int, surfaces: PitchSurfaces) -> ToothMesh:
        """Return the mesh of a member with a number of teeth."""
        angle = atan(tan(surfaces.pressure_angle) / cos(surfaces.helix_angle))
        module = 2.0 * surfaces.radii[0] / teeth
        pitch, sine, m = np.pi * module * cos(angle), sin(angle), module * cos(surfaces.helix_angle)
        first, second = (
            (2.0 * m + m * m * k) / (sqrt(max(sine**2 + 2.0 * m * k + (m * k) ** 2, 0.0)) + sine) / pitch
            for k in surfaces.curvatures
        )
        return cls(teeth, surfaces, angle, pitch, (first, second))

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
        foot1, foot2 = (sin(self.section_angle) / k if k > 0.0 else np.inf for k in self.surfaces.curvatures)
        if e1 + e2 < 1.0 or e2 * self.base_pitch > foot1 or e1 * self.base_pitch > foot2:
            mates = f"{round(other)} teeth" if np.isfinite(other) else "a rack"
            raise InputError(
                f"with addenda of one module wheels with {self.teeth} and {mates} interfere, or are not "
                f"always in contact: contact ratios {e1:.3g} and {e2:.3g}",
                expected="wheels that mesh without correction",
                hint="more teeth",
            )


def _integral(begins: Array, ends: Array) -> float:
    return float((ends * np.abs(ends) - begins * np.abs(begins)).sum() / 2.0)


def tooth_friction(coupling: Coupling, teeth: int) -> tuple[Bearing, CoupledSlip]:
    """Return the load of the teeth of a gear or of a rack and its pinion, and their mean slip."""
    known = coupling.transmission
    if not isinstance(known, FixedContact) or not (surfaces := known.surfaces) or not surfaces.pressure_angle:
        raise InputError(
            f"the teeth of the {coupling.kind} '{coupling.name}' are not known",
            expected="a gear or a rack with its pressure_angle",
        )
    mesh = ToothMesh.of(teeth, surfaces)
    with within("teeth"):
        mesh.check()
    weights = np.zeros(len(coupling.coordinate.weights))
    for joint, rate in surfaces.rates.items():
        weights[joint.v] = mesh.mean_distance * rate
    couple = np.concatenate([np.zeros(3), mesh.mean_distance * surfaces.line])
    acting = FixedContact(known.carrier, known.first, known.second, point=known.point, wrench=-couple)
    pressing = known.wrench[:3] + known.folds[0][1][:3]
    slip = CoupledSlip(RADIAN, weights, coupling.coordinate.places, acting)
    return Bearing.along(float(np.linalg.norm(pressing))), slip
