"""A cam and its follower."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import pinocchio as pin

from pinarm.errors import InputError, within
from pinarm.input.yaml.schema import Extent, InputStruct, Length, check_unit
from pinarm.mechanics.couplings.cams.cam_contact import Face, FollowerSurface, Roller, SlidingPoint, TurningPoint
from pinarm.mechanics.couplings.cams.cam_coupling import CamContact, CamCoupling, CamPlane
from pinarm.mechanics.couplings.members import MemberPair, member_pair
from pinarm.mechanics.geometry.joint_axes import PARALLEL
from pinarm.mechanics.joints import METRE, RADIAN, Direction, Joint, frame_of, joint_of, unit_vector
from pinarm.mechanics.laws.composed import Law
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.mechanics.laws.over_coordinate import Profile


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
                    raise InputError(f"{key} of no {'roller' if key == 'roller_radius' else 'face'}",
                                     expected="the link where it is")  # fmt: skip
        with within("period"):
            Profile.of(self.profile, self.period).check_repeated()

    def bind(self, joints: Mapping[str, Joint], model: pin.Model, name: str) -> CamCoupling:
        """Return the coupling of one model.

        Raises:
            InputError: A joint or link is unknown, the slope jumps, or the follower does not move in a plane across the
                cam's axis.
            UnitError: The profile's values or its abscissa have another dimension than their joint.
        """
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
        """Return the contact in the plane across the cam's axis that goes through the link named."""
        cam, follower = pair.first, pair.second
        if cam.joint.unit != RADIAN:
            raise InputError(f"the cam's joint {cam.joint.name} slides: its contact is not known",
                             expected="a cam that turns", hint="without roller and face")  # fmt: skip
        place = self._place(model, pair)
        start = place.translation
        plane = CamPlane.of(pair, start)
        p = plane.coordinates(start)
        if follower.joint.unit == METRE:
            if abs(follower.axis @ cam.axis) > PARALLEL:
                raise self._not_in_plane(follower.joint, "does not slide across the axis of the cam")
            point: SlidingPoint | TurningPoint = SlidingPoint(p, plane.direction(follower.axis))
        else:
            if np.linalg.norm(np.cross(follower.axis, cam.axis)) > PARALLEL:
                raise self._not_in_plane(follower.joint, "does not turn about an axis parallel to that of the cam")
            sense = float(np.sign(follower.axis @ cam.axis))
            point = TurningPoint(p, plane.coordinates(follower.point), sense)
        surface: FollowerSurface = Roller(float(self.roller_radius))
        if self.face:
            way = point.at(np.zeros(1))[1][0]
            surface = Face(self._facing(p, way if self.normal is None else self._normal(plane, place)))
        return CamContact(plane, point, surface)

    def _place(self, model: pin.Model, pair: MemberPair) -> pin.SE3:
        """Return the frame of the roller or the face in the carrier, where all coordinates are 0."""
        with within("roller" if self.roller else "face"):
            index = frame_of(model, self.roller or self.face)
            if model.frames[index].parentJoint != pair.second.body:
                raise InputError(f"the link {self.roller or self.face} is not on the follower, which "
                                 f"{pair.second.joint.name} moves", expected="a link of the follower")  # fmt: skip
        data = model.createData()
        pin.framesForwardKinematics(model, data, pin.neutral(model))
        return data.oMi[pair.carrier].actInv(data.oMf[index])

    def _normal(self, plane: CamPlane, place: pin.SE3) -> complex:
        """Return the normal of the face that the file gives."""
        assert self.normal is not None
        with within("normal"):
            normal = place.rotation @ unit_vector(self.normal)
            if abs(normal @ plane.axis) > PARALLEL:
                raise InputError("the normal of the face is not across the axis of the cam",
                                 expected="a direction in the plane of the cam")  # fmt: skip
        return plane.direction(normal)

    def _facing(self, p: complex, normal: complex) -> complex:
        """Return the normal, of length 1, in the sense away from the axis of the cam."""
        distance = (np.conj(normal) * p).real / abs(normal)
        if distance == 0.0:
            with within("face"):
                raise InputError("the face goes through the axis of the cam", expected="a face beside it")
        return complex(normal / abs(normal) * np.sign(distance))

    def _not_in_plane(self, joint: Joint, what: str) -> InputError:
        return InputError(f"the follower's joint {joint.name} {what}: the contact is not known",
                          expected="a follower that moves in the plane of the cam",
                          hint="without roller and face")  # fmt: skip


def _require_smooth(profile: MotionLaw, cam: Joint) -> None:
    """Raise where the value or the slope of a profile jumps.

    Raises:
        InputError: Names the first place.
    """
    profile.require_continuous(cam.unit)
    for w in profile.slope_jumps():
        raise InputError(f"the slope of the profile jumps at {w:.6g} {cam.unit}: the follower would be hit",
                         expected="a profile whose slope is continuous, such as cycloidal or polynomial")  # fmt: skip
