"""A cam and its follower, ``q2 = f(q1)``: a holonomic constraint whose row turns with the cam.

With the multiplier lam, the effort at the follower's joint: ``G = (-f', 1)`` at the two joints and
``G' v = -f'' q1'^2``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, partial
from typing import Literal

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Complex, Flags, Indices, continued
from pinarm.errors import InputError, within
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import Extent, InputStruct, Length, check_unit
from pinarm.mechanics.couplings.cam_contact import CamContact, Follower, Touch
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.couplings.teeth import MemberPair, member_pair
from pinarm.mechanics.couplings.transmissions import outwards
from pinarm.mechanics.forces.force_element import Edge, Pieces
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.mechanics.joints import METRE, PARALLEL, RADIAN, Direction, Joint, frame_of, joint_of, unit_vector
from pinarm.mechanics.laws.kinds import Law
from pinarm.mechanics.laws.motion_law import JUMP, MotionLaw, Values
from pinarm.mechanics.laws.over_coordinate import Profile
from pinarm.records import AbstractRecord, replace

SAMPLES = 721
"""Places at which a profile is looked at to describe it: every half degree of a turn."""


class Cam(InputStruct, frozen=True, tag_field="kind", tag="cam"):
    """The second joint, of the follower, stands where the profile over the first one, of the cam, says: ``q2 = f(q1)``.

    The follower slides or turns. What it takes loads the shaft: the effort at the cam's joint is ``-f'(q1)`` times
    that at the follower's. With a roller or a flat face the contact force acts at the contact point along its normal:
    the reactions carry it, and ``coupling.NAME.normal``, ``.pressure_angle`` and ``.curvature_radius`` are known, with
    ``.eccentricity`` of a flat face. The geometry is that of the model: the cam is what moves a follower, whose roller
    or face is at the given link, by the profile; base circle and offset follow. The roller has no inertia of its own.

    A cam that is ``closed_by: force``, as of a spring, pushes only. Where it would have to pull, inverse problems and
    statics tell it, and forward motions let the follower lift off and land.

    Attributes:
        joints: The joint of the cam, and that of the follower, on one link.
        profile: The function f. Where laws speak of time it has the cam's coordinate: ``duration: 90 deg``. Its slope
            must not jump.
        period: After which the profile repeats, such as ``360 deg``: what it says from 0 to there holds for every
            turn. None where it does not repeat.
        closed_by: ``form``, as by a groove, holds the follower both ways; ``force`` only pushes it.
        roller: Link of the follower whose origin is the centre of its roller, or its edge.
        roller_radius: Radius of the roller [m]; 0 of a knife edge.
        face: Link of the follower whose origin lies on its flat face, in place of a roller.
        normal: Normal of the face, in the axes of that link, such as ``y`` or ``[0, 1, 1]``; the direction in which the
            origin moves where it is left out.
    """

    joints: tuple[str, str]
    profile: Law
    period: Extent | None = None
    closed_by: Literal["form", "force"] = "form"
    roller: str = ""
    roller_radius: Length = 0.0
    face: str = ""
    normal: Direction | None = None

    def check(self) -> None:
        """Refuse a profile that is not closed, and a follower with two shapes."""
        if self.roller and self.face:
            raise InputError("a follower has a roller or a flat face", expected="roller or face")
        for key, needed in (("roller_radius", self.roller), ("normal", self.face)):
            if getattr(self, key) and not needed:
                with within(key):
                    raise InputError(
                        f"{key} of no {'roller' if key == 'roller_radius' else 'face'}", expected="the link where it is"
                    )
        with within("period"):
            Profile.of(self.profile, self.period).check_repeated()

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> CamCoupling:
        first, second = (joint_of(joints, joint) for joint in self.joints)
        if first == second:
            raise InputError(f"the joint {first.name} cannot be coupled to itself", expected="two joints")
        with within("profile"):
            self.profile.check_units(second.unit, first.unit)
            _require_smooth(self.profile, first)
        with within("period"):
            check_unit(self.period or 0.0, first.unit)
        profile, contact = Profile.of(self.profile, self.period), None
        if self.roller or self.face:
            contact = self._contact(model, member_pair(model, joints, (first, second)))
        missing = "" if contact else "it has neither roller nor face"
        return CamCoupling(name, model.nv, first, second, profile, self.closed_by == "force", contact, missing)

    def _contact(self, model: pin.Model, pair: MemberPair) -> CamContact:
        cam, follower = pair.first, pair.second
        if cam.joint.unit != RADIAN:
            raise InputError(
                f"the cam's joint {cam.joint.name} slides: its contact is not known",
                expected="a cam that turns",
                hint="without roller and face",
            )
        place = self._place(model, pair)
        contact = CamContact.through(pair, place.translation)
        p = contact.direction(place.translation - contact.origin)
        if follower.joint.unit == METRE:
            if abs(follower.axis @ cam.axis) > PARALLEL:
                raise self._not_in_plane(follower.joint, "does not slide across the axis of the cam")
            way, sense = contact.direction(follower.axis), 0.0
        else:
            if np.linalg.norm(np.cross(follower.axis, cam.axis)) > PARALLEL:
                raise self._not_in_plane(follower.joint, "does not turn about an axis parallel to that of the cam")
            sense = float(np.sign(follower.axis @ cam.axis))
            way = 1j * sense * (p - contact.direction(follower.point - contact.origin))
        face = self._facing(p, way if self.normal is None else self._normal(contact, place)) if self.face else None
        return replace(contact, follower=Follower(p, way, sense, float(self.roller_radius), face))

    def _place(self, model: pin.Model, pair: MemberPair) -> pin.SE3:
        with within("roller" if self.roller else "face"):
            index = frame_of(model, self.roller or self.face)
            if model.frames[index].parentJoint != pair.second.body:
                raise InputError(
                    f"the link {self.roller or self.face} is not on the follower, which {pair.second.joint.name} moves",
                    expected="a link of the follower",
                )
        data = model.createData()
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        return data.oMi[pair.carrier].actInv(data.oMf[index])

    def _normal(self, plane: CamContact, place: pin.SE3) -> complex:
        assert self.normal is not None
        with within("normal"):
            normal = place.rotation @ unit_vector(self.normal)
            if abs(normal @ plane.axis) > PARALLEL:
                raise InputError(
                    "the normal of the face is not across the axis of the cam",
                    expected="a direction in the plane of the cam",
                )
        return plane.direction(normal)

    def _facing(self, p: complex, normal: complex) -> complex:
        distance = (np.conj(normal) * p).real / abs(normal)
        if distance == 0.0:
            with within("face"):
                raise InputError("the face goes through the axis of the cam", expected="a face beside it")
        return complex(normal / abs(normal) * np.sign(distance))

    def _not_in_plane(self, joint: Joint, what: str) -> InputError:
        return InputError(
            f"the follower's joint {joint.name} {what}: the contact is not known",
            expected="a follower that moves in the plane of the cam",
            hint="without roller and face",
        )


def _require_smooth(profile: MotionLaw, cam: Joint) -> None:
    profile.require_continuous(cam.unit)
    for w in profile.slope_jumps():
        raise InputError(
            f"the slope of the profile jumps at {w:.6g} {cam.unit}: the follower would be hit",
            expected="a profile whose slope is continuous, such as cycloidal or polynomial",
        )


class CamCoupling(AbstractRecord, JointRelation, frozen=True):
    """A follower's joint that stands where the profile over the cam's joint says.

    Attributes:
        contact: Where they touch; ``None`` where that is not known.
    """

    unshown = ("profile", "contact")

    name: str
    nv: int
    cam_joint: Joint
    follower_joint: Joint
    profile: Profile
    one_sided: bool
    contact: CamContact | None
    missing: str
    kind: str = "cam"
    size: int = 1

    @property
    def joints(self) -> Indices:
        return np.array(sorted((self.cam_joint.v, self.follower_joint.v)), dtype=np.intp)

    @property
    def known(self) -> bool:
        return self.contact is not None

    @property
    def second(self) -> int:
        return self.known_contact.pair.second.body

    def unit(self, row: int) -> Unit:
        return self.follower_joint.unit

    def values(self, q: Array, v: Array | None = None) -> Values:
        """Return f, f' and f'' at configurations, shape (n, nq), each of shape (n,).

        Where f'' jumps it is that of the side to which the cam moves.
        """
        return self.profile(q[:, self.cam_joint.q], 0.0 if v is None else np.sign(v[:, self.cam_joint.v]))

    def gaps_at(self, q: Array) -> Array:
        """Return ``q2 - f(q1)``."""
        return np.asarray(q[:, self.follower_joint.q] - self.values(q)[0])

    def rows_at(self, q: Array) -> Array:
        """Return ``(-f', 1)`` at the joints."""
        rows = np.zeros((len(q), self.nv), q.dtype)
        rows[:, self.cam_joint.v] = -continued(lambda angle: self.profile(angle)[1:], q[:, self.cam_joint.q])
        rows[:, self.follower_joint.v] = 1.0
        return rows

    def drifts_at(self, q: Array, v: Array) -> Array:
        """Return ``-f'' q1'^2``."""
        if (np.imag(q[:, self.cam_joint.q]) * np.real(v[:, self.cam_joint.v])).any():
            raise InputError(
                f"the linear analysis has no derivatives of the turning cam '{self.name}'", expected="a cam at rest"
            )
        return np.asarray(-self.values(np.real(q), np.real(v))[2] * v[:, self.cam_joint.v] ** 2)

    @property
    def known_contact(self) -> CamContact:
        assert self.contact is not None
        return self.contact

    def touch(self, q: Array, v: Array | None = None) -> Touch:
        return self.known_contact.touch(self.values(q, v))

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        if self.contact is None:
            return {}
        touch = self.touch(links.q)
        return self.opposite(links, touch, self.contact.force(touch, lam[..., 0]) * touch.normal)

    def opposite(self, links: LinkPlacements, touch: Touch, force: Complex) -> dict[int, Array]:
        """Return forces at the contact [N], in the plane, on the follower and back on the cam."""
        plane = self.known_contact
        point, pushes = plane.origin + plane.vectors(touch.point), plane.vectors(force)
        wrench = outwards(links, plane.pair.carrier, np.concatenate([pushes, crossed(point, pushes)], axis=-1))
        return {plane.pair.second.body: wrench, plane.pair.first.body: -wrench}

    def transmitted(self, links: LinkPlacements, lam: Array) -> tuple[Array, Array]:
        plane, touch = self.known_contact, self.touch(links.q)
        force = plane.vectors(plane.force(touch, lam[..., 0]) * touch.normal)
        turn, place = links.turns[:, plane.pair.carrier], links.places[:, plane.pair.carrier]
        point = place + np.matvec(turn, plane.origin + plane.vectors(touch.point))
        return point, np.concatenate([np.matvec(turn, force), np.zeros_like(force)], axis=1)

    def parts(self) -> dict[str, Unit]:
        if self.contact is None:
            return {}
        parts = {"normal": unit("N"), "pressure_angle": RADIAN, "curvature_radius": METRE}
        return {**parts, **({"eccentricity": METRE} if self.contact.follower.face is not None else {})}

    def part(self, name: str, q: Array, lam: Array) -> Array:
        if name == "normal":
            return self.push(q, lam)
        touch = self.touch(q)
        parts = {"pressure_angle": touch.pressure_angle, "curvature_radius": touch.radius}
        return {**parts, "eccentricity": touch.eccentricity}[name]

    def push(self, q: Array, lam: Array) -> Array:
        """Return with what the cam pushes its follower, negative where it pulls, shape (n,).

        The contact force [N] where the contact is known, otherwise the effort at the follower's joint.
        """
        return lam if self.contact is None else self.contact.force(self.touch(q), lam)

    def push_unit(self) -> Unit:
        """Return N, or the unit of the follower's effort where the contact is not known."""
        return unit("N") if self.contact or self.follower_joint.unit == METRE else unit("N*m")

    @cached_property
    def side(self) -> float:
        """Sense in which the cam pushes the follower's coordinate; 0 where it holds it both ways."""
        if not self.one_sided:
            return 0.0
        return 1.0 if self.contact is None else float(np.sign(self.contact.senses[1] * self.outline.lever[0]))

    @property
    def opens(self) -> str:
        return "the follower lifts off"

    def whereabouts(self, q: Array) -> str:
        place, joint = float(q[self.cam_joint.q]), self.cam_joint
        place -= 0.0 if self.profile.period == np.inf else self.profile.period * np.floor(place / self.profile.period)
        return f"{joint.name} = {place:.6g} m" if joint.unit == METRE else f"{joint.name} = {np.rad2deg(place):.6g} deg"

    @cached_property
    def outline(self) -> Touch:
        """Contact of cam and follower along the whole profile; ``contact`` must not be ``None``."""
        return self.known_contact.touch(self.profile(sample_range(self.profile)))

    @property
    def shape(self) -> Array:
        """The outline of the cam in its carrier where the cam's joint is at 0 [m], shape (n, 3); see ``outline``."""
        plane, (turning, _) = self.known_contact, self.known_contact.senses
        points = self.outline.point * np.exp(-1j * turning * sample_range(self.profile))
        return plane.origin + plane.vectors(points)

    def flawed(self, q: Array) -> Flags:
        if self.contact is None:
            return super().flawed(q)
        return self.contact.follower.undercut(self.touch(q).radius)

    @property
    def flaw(self) -> str:
        return f"is undercut: no cam has this profile with its {self.known_contact.follower.words}"

    @property
    def in_pieces(self) -> bool:
        return bool(len(self._pieces.bounds))

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(self.profile.marks, self.profile.period)

    def edges(self) -> list[Edge]:
        return [Edge(partial(self._beside, place)) for place in self.profile.starts]

    def _beside(self, place: float, t: Array, q: Array, v: Array) -> Array:
        """Return values that vanish where the cam is at a place, in every period, shape (n,)."""
        away, period = q[:, self.cam_joint.q] - place, self.profile.period
        return away if period == np.inf else np.sin(np.pi * away / period)

    def passages(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        law = laws.get(self.cam_joint.v)
        passed = self.profile.passed(self.profile.starts, law, start, end) if law else []
        return [t for t in passed if law and self._jumps(law, t)]

    def marked(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        law = laws.get(self.cam_joint.v)
        return [] if law is None else self.profile.passed(self.profile.marks, law, start, end)

    def _jumps(self, law: MotionLaw, t: float) -> bool:
        return self._jumps_at(law.on(t, t)(np.array([t]))[0])

    def has_kink(self, q: Array) -> bool:
        return self._jumps_at(q[:, self.cam_joint.q])

    def _jumps_at(self, place: Array) -> bool:
        before, after = (self.profile(place, side)[2] for side in (-1.0, 1.0))
        size = max(abs(before), *(piece.size()[2] for piece in self.profile.pieces))
        return bool(abs(after - before) > JUMP * size)

    def passed(self, q: Array, v: Array) -> bool:
        return self._pieces.passed(q[:, self.cam_joint.q])

    @property
    def description(self) -> str:
        if self.contact is None:
            return f"its forces on bodies are not known: {self.missing}"
        touch = self.outline
        steepest = np.rad2deg(np.abs(touch.pressure_angle).max())
        words = (
            f"{self.contact.follower.words}, cam of radius {1e3 * np.abs(touch.point).min():.6g} to "
            f"{1e3 * np.abs(touch.point).max():.6g} mm, pressure angle up to {steepest:.4g} deg"
        )
        return words + (", pushes only" if self.one_sided else "")


def sample_range(profile: Profile) -> Array:
    """Return places that show all of a profile, shape (n,): a period, its pieces, or, without ends, one turn."""
    ends = [end for piece in profile.pieces for end in (piece.start, piece.end) if np.isfinite(end)]
    low, high = (min(ends), max(ends)) if len(set(ends)) > 1 else (0.0, 2.0 * np.pi)
    return np.linspace(low, high, SAMPLES)
