"""Friction between the members of couplings: threads, belts, cams and the gears of drives; teeth are in ``tooth``.

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

from math import atan, cos, sin, tan

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import unit
from pinarm.mechanics.couplings.cam import CamCoupling
from pinarm.mechanics.couplings.cam_contact import along
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.couplings.transmissions import (
    NEWTON,
    NEWTON_METRE,
    Part,
    Strands,
    ThreadContact,
    Transmission,
    at_origin,
)
from pinarm.mechanics.friction.bearing import Bearing
from pinarm.mechanics.friction.contact import CoupledSlip, FrictionContact, FrictionLaw
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE
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

    def acting(self, known: Transmission | None) -> Transmission | None:
        """Return what a unit friction does: a force along the axis and a moment about it on the nut, and back.

        ``None`` where the coupling says nothing of its bodies: it then acts as efforts at the coupled joints.
        """
        if not isinstance(known, ThreadContact):
            return None
        turning, sliding = self.along
        wrench = sliding * at_origin(known.point, known.wrench[:3])
        wrench[3:] -= turning / known.pitch * known.about
        single = {"axial": Part(NEWTON, sliding), "torque": Part(NEWTON_METRE, -turning)}
        return Transmission(known.carrier, known.first, known.second, known.point, wrench, single=single)


def belt_friction(coupling: Coupling, law: FrictionLaw) -> FrictionContact:
    """Return the friction of a belt on its wheels."""
    known = coupling.transmission
    if not isinstance(known, Strands) or not known.pretension:
        raise InputError(f"without a pretension the belt '{coupling.name}' has no grip", expected="its pretension")

    def grip(mu: float) -> float:
        return 2.0 * known.pretension * float(np.tanh(0.5 * mu * known.wrap))

    pull = replace(
        law,
        mu=0.0,
        static_mu=0.0,
        constant=law.constant + grip(law.mu),
        static_constant=law.static_constant + grip(law.static_mu),
    )
    radius, wheels = 1.0 / abs(known.difference), coupling.coordinate
    slip = CoupledSlip(wheels.unit, radius * wheels.weights, wheels.places, known.scaled(radius))
    return FrictionContact(f"coupling.{coupling.name}", unit("N"), pull, Bearing.none(), slip, coupling)


class CamSlip(Record, frozen=True):
    """The slip of a follower on its cam, along the tangent of the contact [m/s].

    Attributes:
        cam: The coupling, whose contact is known.
    """

    cam: CamCoupling

    def row(self, state: Kinematics) -> Array:
        """Return J, shape (nv,): the slip of the follower, and that of the cam under it."""
        cam, (turning, moving) = self.cam, self.cam.known_contact.senses
        touch, row = cam.touch(state.q[None]), np.zeros(cam.nv)
        row[cam.cam_joint.v] = -turning * along(touch.tangent, 1j * touch.point)[0]
        row[cam.follower_joint.v] = moving * along(touch.tangent, touch.velocity)[0]
        return row

    def drift(self, state: Kinematics) -> float:
        """Return J' v: of the slip ``k alpha'`` the part ``k' alpha'^2`` less what the drift of the follower does."""
        q, v, cam = state.q[None], state.v[None], self.cam
        follower = self.row(state)[cam.follower_joint.v] * cam.drifts_at(q, v)[0]
        return float(cam.touch(q, v).slip_rate[0] * state.v[cam.cam_joint.v] ** 2 + follower)

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        touch = self.cam.touch(links.q)
        return self.cam.opposite(links, touch, effort * touch.tangent)


def cam_friction(cam: CamCoupling, pin: float, law: FrictionLaw, *, shared: bool) -> FrictionContact:
    """Return the friction of a cam and its follower.

    Args:
        pin: Radius of the pin of its roller [m]; 0 where it has none.
        shared: See ``FrictionContact``.
    """
    if cam.contact is None:
        raise InputError(
            f"where the cam '{cam.name}' touches its follower is not known", expected="a cam with its roller or face"
        )
    surface, part = cam.contact.follower, 1.0
    if surface.radius:
        if not 0.0 < pin < surface.radius:
            with within("radius"):
                raise InputError(
                    f"friction of the roller of '{cam.name}' needs the radius of its pin",
                    expected=f"a radius below that of the roller, {surface.radius:g} m",
                )
        part = pin / surface.radius
    elif pin:
        with within("radius"):
            raise InputError(f"the follower of '{cam.name}' has no roller, and no pin", expected="no radius")
    return FrictionContact(f"coupling.{cam.name}", unit("N"), law, Bearing.along(part), CamSlip(cam), cam, shared)


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
        """Return what friction does to the driven links; nothing where it acts as joint efforts."""
        return self.gear.coordinate.wrenches(links, 0.5 * effort)


def gear_loss(drive: str, gear: GearedRotor, efficiency: float) -> FrictionContact:
    """Return the friction in the gear of a drive with an efficiency eta, above 0 and below 1."""
    mu = 2.0 * (1.0 - efficiency) / (1.0 + efficiency)
    effort = unit("N" if gear.coordinate.unit == METRE else "N*m")
    law = FrictionLaw(mu, mu, 0.0, 0.0)
    return FrictionContact(f"drive.{drive}", effort, law, Bearing.along(1.0), GearSlip(gear), gear)
