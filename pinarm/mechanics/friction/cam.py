"""Friction between a cam and its follower: of a sliding contact, or in the pin of a roller.

The follower's material point at the contact slips along the cam with u, and the normal force N is that of the contact.
A flat face or a knife edge has the friction ``mu N`` against u. A roller of radius R turns on a pin of radius r with
``u / R``, so that the moment ``mu N r`` of the pin acts as ``mu N r / R`` along the tangent. That it rolls without slip
on the cam, and that the pin's load is N alone, is taken for granted.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.units import unit
from pinarm.mechanics.couplings.cams.cam_contact import Roller
from pinarm.mechanics.couplings.cams.cam_coupling import CamContact, CamCoupling
from pinarm.mechanics.couplings.coupling import outwards
from pinarm.mechanics.friction.bearing import Bearing
from pinarm.mechanics.friction.coupling_contact import CouplingContact
from pinarm.mechanics.friction.law import FrictionLaw
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import crossed


@dataclass(frozen=True, eq=False)
class CamFriction(CouplingContact):
    """The slip of a follower on its cam, along the tangent of the contact [m/s].

    Attributes:
        contact: Where they touch.
    """

    coupling: CamCoupling
    contact: CamContact = field(kw_only=True)

    @property
    def row_is_constant(self) -> bool:
        """See ``FrictionContact``: the tangent turns with the cam."""
        return False

    def row(self, state: Kinematics) -> Array:
        """Return J, shape (nv,): the slip of the follower, and that of the cam under it."""
        return np.asarray(self._row(state.q[None])[0])

    def _row(self, q: Array) -> Array:
        touch, (turning, moving) = self.contact.touch(self.coupling.values(q)), self.contact.senses
        found = np.zeros((len(q), self.coupling.nv))
        found[:, self.coupling.cam_joint.v] = -turning * (np.conj(touch.tangent) * 1j * touch.point).real
        found[:, self.coupling.follower_joint.v] = moving * (np.conj(touch.tangent) * touch.velocity).real
        return found

    def drift(self, state: Kinematics) -> float:
        """Return J' v: of the slip ``k alpha'`` the part ``k' alpha'^2`` less what the drift of the follower does."""
        q, v = state.q[None], state.v[None]
        touch, rate = self.contact.touch(self.coupling.values(q, v)), float(state.v[self.coupling.cam_joint.v])
        follower = self._row(q)[0, self.coupling.follower_joint.v] * self.coupling.drifts_at(q, v)[0]
        return float(touch.slip_rate[0] * rate**2 + follower)

    def wrenches(self, links: LinkPlacements, f: Array) -> dict[int, Array]:
        touch, plane = self.contact.touch(self.coupling.values(links.q)), self.contact.plane
        point, force = plane.origin + plane.vectors(touch.point), plane.vectors(f * touch.tangent)
        wrench = outwards(links, plane.pair.carrier, np.concatenate([force, crossed(point, force)], axis=1))
        return {plane.pair.second.body: wrench, plane.pair.first.body: -wrench}

    def transmitted(self, links: LinkPlacements, joints: Array, lam: dict[str, Array]) -> Array:
        found, touch = np.zeros((len(joints), 6)), self.contact.touch(self.coupling.values(links.q))
        found[:, 0] = self.contact.force(touch, lam[self.coupling.name][:, 0])
        return found


def cam_friction(coupling: CamCoupling, pin: float, law: FrictionLaw, *, shared: bool) -> CamFriction:
    """Return the friction of a cam and its follower.

    Args:
        coupling: The cam.
        pin: Radius of the pin of its roller [m]; 0 where it has none.
        law: Of friction.
        shared: See ``FrictionContact``.

    Raises:
        InputError: The contact is not known, or the pin does not fit the follower.
    """
    if coupling.contact is None:
        raise InputError(f"where the cam '{coupling.name}' touches its follower is not known",
                         expected="a cam with its roller or face")  # fmt: skip
    surface, part = coupling.contact.surface, 1.0
    if isinstance(surface, Roller) and surface.radius:
        if not 0.0 < pin < surface.radius:
            with within("radius"):
                raise InputError(f"friction of the roller of '{coupling.name}' needs the radius of its pin",
                                 expected=f"a radius below that of the roller, {surface.radius:g} m")  # fmt: skip
        part = pin / surface.radius
    elif pin:
        with within("radius"):
            raise InputError(f"the follower of '{coupling.name}' has no roller, and no pin", expected="no radius")
    bearing = Bearing.thread(np.array([1.0, 0.0, 0.0]), part)
    return CamFriction(f"coupling.{coupling.name}", unit("N"), coupling, law, bearing, shared,
                       contact=coupling.contact)  # fmt: skip
