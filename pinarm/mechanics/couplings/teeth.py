"""Teeth: the pitch point of two members, and the directions in which their flanks push.

Both members roll on each other on the pitch line, the axis of their relative rotation. With e the direction in which
the first one moves at the pitch point, N the normal of the pitch surfaces from the first to the second, l the pitch
line, the force on the second is, for the tangential force F_t,

    F_t e + |F_t| tan(alpha) / cos(beta) N - F_t tan(beta) l

with the normal pressure angle alpha and the helix angle beta of the first member. (Niemann, Winter, Maschinenelemente
II, section 22.1; Shigley's Mechanical Engineering Design, chapter 13, gears: force analysis.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.mechanics.couplings.transmissions import NEWTON, FixedContact, Part, PitchSurfaces, at_origin
from pinarm.mechanics.geometry.frame_pairs import Path
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.joints import METRE, PARALLEL, RADIAN, Joint, frame_of
from pinarm.records import Record

IN_LINE = 1e-6
"""Distance of axes that are the same or meet [m], relative to 1 m or to their places: more than typed digits leave."""


class Member(Record, frozen=True):
    """A body that turns about, or slides along, one axis that is fixed in the carrier.

    Attributes:
        body: Index of the joint that moves it; 0 for the ground.
        axis: Unit vector of the axis in the carrier, the positive sense of the joint, shape (3,).
        point: A point of the axis in the carrier: the origin of the joint [m], shape (3,).
        rates: Joint -> its part in the angle or way of the body in the carrier, 1 or -1.
    """

    body: int
    joint: Joint
    axis: Array
    point: Array
    rates: Mapping[Joint, float]


class MemberPair(Record, frozen=True):
    """Two members on one carrier. Their angles or ways there are s1 and s2.

    Attributes:
        state: The mechanism at the neutral configuration.
        carrier: Index of the joint that moves the carrier; 0 for the ground.
    """

    state: Kinematics
    carrier: int
    first: Member
    second: Member

    @property
    def bodies(self) -> tuple[int, int, int]:
        """Indices of the joints that move carrier, first and second member."""
        return self.carrier, self.first.body, self.second.body

    @property
    def sense(self) -> float:
        """Way of the second member in the carrier per way of its joint, 1 or -1: a multiplier lam acts on s2 by it."""
        return self.second.rates[self.second.joint]

    def inner_ratio(self, ratio: float) -> float:
        """Return ``ds2 / ds1`` from the ratio of the two joints, ``dq2 / dq1`` with the other joints at rest."""
        return ratio * self.sense / self.first.rates[self.first.joint]

    def weights(self, inner_ratio: float) -> dict[Joint, float]:
        """Return the weights of ``s2 - inner_ratio s1``, that of the second joint being 1."""
        rates = dict.fromkeys([self.second.joint, self.first.joint], 0.0)
        for share, member in ((self.sense, self.second), (-self.sense * inner_ratio, self.first)):
            for joint, rate in member.rates.items():
                rates[joint] = rates.get(joint, 0.0) + share * rate
        return rates


def member_pair(
    model: pin.Model, joints: Mapping[str, Joint], pair: tuple[Joint, Joint], carrier: Joint | None = None
) -> MemberPair:
    """Return the members that two joints move, on the carrier that a third joint moves.

    Without a carrier it is the body that both joints are at: the parent of both, or the link between them where one
    carries the other. The member of the latter joint is then what that joint stands on, such as a fixed ring.
    """
    first, second = pair
    own, *bodies = (carrier.index, first.index, second.index) if carrier else _bodies(model, first, second)
    state, by_index = Kinematics.at(model, pin.neutral(model)), {joint.index: joint for joint in joints.values()}
    members = (_member(state, by_index, own, body, joint) for body, joint in zip(bodies, pair, strict=True))
    return MemberPair(state, own, *members)


def _bodies(model: pin.Model, first: Joint, second: Joint) -> tuple[int, int, int]:
    below = [int(model.parents[joint.index]) for joint in (first, second)]
    if below[0] == below[1]:
        return below[0], first.index, second.index
    if below[1] == first.index:
        return first.index, below[0], second.index
    if below[0] == second.index:
        return second.index, first.index, below[1]
    raise InputError(
        f"no link carries the axes of both {first.name} and {second.name}",
        expected="joints of one parent link, or one joint on the link that the other moves",
        hint="carrier: the joint that moves the link with both axes",
    )


def _line(state: Kinematics, carrier: int, joint: Joint) -> tuple[Array, Array]:
    """Return the axis of a joint and the origin of its frame [m] in the frame of a carrier, shape (3,) each."""
    own, column = state.data.oMi[carrier], state.data.J.reshape(6, -1)[:, joint.v]
    axis = own.rotation.T @ (column[:3] if joint.unit == METRE else column[3:])
    return np.asarray(axis), np.asarray(own.actInv(state.data.oMi[joint.index].translation))


def _member(state: Kinematics, joints: Mapping[int, Joint], carrier: int, body: int, joint: Joint) -> Member:
    """Return a member; every joint between it and the carrier must move about the axis of the joint named."""
    (axis, point), rates = _line(state, carrier, joint), dict[Joint, float]()
    for index, way in Path.of_joints(state.model, carrier, body).senses:
        step = joints.get(index)
        other, origin = (axis, point) if step is None else _line(state, carrier, step)
        apart = origin - point
        slack = IN_LINE * max(1.0, float(np.linalg.norm(apart)))
        off = 0.0 if joint.unit == METRE else float(np.linalg.norm(np.cross(axis, apart)))
        if step is None or step.unit != joint.unit or np.linalg.norm(np.cross(axis, other)) > PARALLEL or off > slack:
            between = state.model.names[index]
            raise InputError(
                f"the member at {joint.name} does not move about one axis in its carrier: {between} lies between",
                expected="joints about, or along, the same axis only",
                hint="another carrier",
            )
        rates[step] = way * float(np.sign(axis @ other))
    if joint not in rates:
        raise InputError(f"{joint.name} does not move a member in the carrier", expected="another carrier")
    return Member(body, joint, axis, point, rates)


class Teeth(NamedTuple):
    """Geometry of teeth, as given in files.

    Attributes:
        pressure_angle: alpha, in the section normal to the teeth [rad].
        helix_angle: beta on the pitch cylinder of the first member, positive for a right-handed helix [rad].
        plane: Link whose origin is in the middle of the teeth's width; empty for the plane of the joints' origins.
    """

    pressure_angle: float
    helix_angle: float
    plane: str


def check_teeth(pressure_angle: float | None, helix_angle: float, plane: str) -> None:
    """Refuse what says more of teeth whose pressure angle is not given."""
    if pressure_angle is None and (helix_angle or plane):
        raise InputError("the teeth have no pressure_angle", expected="pressure_angle, such as 20 deg")


def _contact(
    pair: MemberPair, teeth: Teeth, words: str, at: Array, way: Array, normal: Array, line: Array, lever: float,
    radii: tuple[float, float], curvatures: tuple[float, float], names: Sequence[str] = ("radial", "axial"),
) -> FixedContact:  # fmt: skip
    """Return the contact of two members that roll on each other.

    Args:
        at: The pitch point [m], shape (3,).
        way: e, in which the first member moves there where its angle grows, shape (3,).
        normal: N, from the first member to the second, shape (3,).
        line: l, along the pitch line, shape (3,).
        lever: Way of the second member along e there per angle or way of its own [m or 1].
        radii: From the axes of the members to the point [m]; infinite of a rack.
        curvatures: See ``PitchSurfaces``.
        names: Names of the parts of the force along N and l.
    """
    alpha, beta = teeth.pressure_angle, teeth.helix_angle
    tangential, separating = pair.sense / lever, float(np.tan(alpha) / np.cos(beta) / abs(lever))
    parts = (Part(NEWTON, separating, keeps=True), Part(NEWTON, float(-tangential * np.tan(beta))))
    single = {"tangential": Part(NEWTON, abs(tangential)), **dict(zip(names, parts, strict=False))}
    angles = f"pressure angle {np.rad2deg(alpha):.6g} deg, helix angle {np.rad2deg(beta):.6g} deg"
    rates: dict[Joint, float] = {}  # of the angular velocity of the first member against the second, along l
    for share, member in ((1.0, pair.first), (-1.0, pair.second)):
        for joint, rate in member.rates.items() if _turns(member) else ():
            rates[joint] = rates.get(joint, 0.0) + share * rate * float(line @ member.axis)
    return FixedContact(
        *pair.bodies, f"{words}, {angles}", point=at, single=single,
        wrench=at_origin(at, tangential * (way - np.tan(beta) * line)),
        folds=((0.0, at_origin(at, separating * normal)),),
        surfaces=PitchSurfaces(line, rates, radii, curvatures, alpha, beta),
    )  # fmt: skip


def wheels_in_mesh(pair: MemberPair, inner_ratio: float, teeth: Teeth) -> FixedContact:
    """Return the contact of two wheels, about parallel axes or about axes that meet."""
    a, b = pair.first.axis, pair.second.axis
    if np.linalg.norm(np.cross(a, b)) <= PARALLEL:
        return _cylindrical(pair, inner_ratio, teeth)
    return _bevel(pair, inner_ratio, teeth)


def _cylindrical(pair: MemberPair, inner_ratio: float, teeth: Teeth) -> FixedContact:
    """Return the contact of wheels about parallel axes: ``a x (P - A) = i b x (P - B)`` in the plane of the teeth."""
    first, second, a = pair.first, pair.second, pair.first.axis
    ratio = inner_ratio * float(np.sign(a @ second.axis))
    apart = _across(a, second.point - first.point)
    distance = float(np.linalg.norm(apart))
    if min(distance, abs(1.0 - ratio)) <= IN_LINE:
        raise InputError(
            f"{first.joint.name} and {second.joint.name} have one axis, or turn alike: such wheels do not mesh",
            expected="parallel axes at a distance, and a ratio other than 1",
            hint="planets: 3, for evenly spaced planets between wheels on one axis; kind: belt",
        )
    height = plane_of(pair, teeth.plane)
    axial = first.point + a * (height - a @ first.point)
    at = axial - apart * ratio / (1.0 - ratio)
    kind = "external" if ratio < 0.0 else "internal"
    return _rolling(pair, teeth, f"{kind} teeth, pitch radii {{0:.6g}} mm and {{1:.6g}} mm", at, a)


def _bevel(pair: MemberPair, inner_ratio: float, teeth: Teeth) -> FixedContact:
    """Return the contact of straight bevel wheels; the pitch line runs through the meeting point of the axes."""
    first, second = pair.first, pair.second
    a, b, names = first.axis, second.axis, f"{first.joint.name} and {second.joint.name}"
    across, apart = np.cross(a, b), second.point - first.point
    if abs(across @ apart) > IN_LINE * np.linalg.norm(across) * max(1.0, float(np.linalg.norm(apart))):
        raise InputError(
            f"the axes of {names} are skew: the forces of their teeth are not known",
            expected="parallel axes, or axes that meet",
            hint="leave pressure_angle out",
        )
    if teeth.helix_angle:
        raise InputError(f"the axes of {names} meet: bevel wheels are straight here", expected="no helix_angle")
    apex = first.point + a * float(np.cross(apart, b) @ across / (across @ across))
    line = (a - inner_ratio * b) / np.linalg.norm(a - inner_ratio * b)
    place = _link_in_carrier(pair, teeth.plane, "the axes meet: the place along the teeth is not known")
    at = apex + line * float(line @ (place - apex))
    if np.linalg.norm(at - place) > IN_LINE * max(1.0, float(np.linalg.norm(place))) or np.allclose(at, apex):
        raise InputError(
            f"{teeth.plane} is {np.linalg.norm(at - place):.3g} m off the pitch line of {names}",
            expected=f"a link on the line from {apex.round(6)} along {line.round(6)}, in the carrier's frame",
        )
    cones = [np.arccos(np.clip(abs(line @ axis), 0.0, 1.0)) for axis in (a, b)]
    words = f"bevel teeth, pitch cone angles {np.rad2deg(cones[0]):.6g} deg and {np.rad2deg(cones[1]):.6g} deg"
    return _rolling(pair, teeth, words, at, line, ("separating",))


def _rolling(
    pair: MemberPair, teeth: Teeth, words: str, at: Array, line: Array, names: Sequence[str] = ("radial", "axial")
) -> FixedContact:
    """Return the contact of two wheels at a pitch point; their radii [mm] are inserted into the words.

    The normal leads to the wheel that curves away from it: ``N . r1 / r1^2 > N . r2 / r2^2`` with the radii r1 and r2
    from the axes to the point, for outer teeth, inner teeth and cones alike.
    """
    members = (pair.first, pair.second)
    radii = [_across(wheel.axis, at - wheel.point) for wheel in members]
    sizes = [float(np.linalg.norm(radius)) for radius in radii]
    if min(sizes) <= IN_LINE * max(sizes):
        member = members[int(np.argmin(sizes))]
        raise InputError(
            f"the teeth would have a radius of {min(sizes):.3g} m about {member.joint.name}, "
            f"and of {max(sizes):.3g} m about the other axis",
            expected="a ratio that wheels can have",
            hint="leave pressure_angle out",
        )
    way = np.cross(pair.first.axis, radii[0])
    way /= np.linalg.norm(way)
    normal = np.cross(way, line)
    curved = [float(normal @ r) / float(r @ r) for r in radii]
    outwards = 1.0 if curved[0] > curved[1] else -1.0
    lever = float(np.cross(pair.second.axis, radii[1]) @ way)
    curvatures = outwards * curved[0], -outwards * curved[1]
    words = words.format(*(1e3 * size for size in sizes))
    return _contact(
        pair, teeth, words, at, way, outwards * normal, line, lever, (sizes[0], sizes[1]), curvatures, names
    )


def pinion_on_rack(pair: MemberPair, radius: float, teeth: Teeth) -> FixedContact:
    """Return the contact of a pinion and a rack: ``radius`` is the way of the rack per angle, with its sign."""
    pinion, a, slide = pair.first, pair.first.axis, pair.second.axis
    if abs(a @ slide) > PARALLEL:
        raise InputError(
            f"{pair.second.joint.name} does not slide across the axis of {pinion.joint.name}",
            expected="a rack that slides across the axis of its pinion",
            hint="kind: screw",
        )
    height = plane_of(pair, teeth.plane)
    lever = radius * np.cross(slide, a)
    at = pinion.point + a * (height - a @ pinion.point) + lever
    return _contact(
        pair, teeth, f"rack, pitch radius {1e3 * abs(radius):.6g} mm", at, np.sign(radius) * slide,
        lever / np.linalg.norm(lever), a, float(np.sign(radius)), (abs(radius), np.inf), (1.0 / abs(radius), 0.0),
    )  # fmt: skip


def plane_of(pair: MemberPair, link: str) -> float:
    """Return where the middle of the teeth is along the first axis [m]."""
    first, second, a = pair.first, pair.second, pair.first.axis
    if link:
        return float(a @ _link_in_carrier(pair, link, ""))
    shift = abs(float(a @ (second.point - first.point)))
    if second.joint.unit == first.joint.unit and shift > IN_LINE:
        raise InputError(
            f"the origins of {first.joint.name} and {second.joint.name} are {shift:g} m apart along the axes: "
            "the plane of the forces is not known",
            expected="plane: a link whose origin lies in the middle of the teeth",
        )
    return float(a @ first.point)


def _link_in_carrier(pair: MemberPair, link: str, otherwise: str) -> Array:
    """Return the origin of a link of the carrier or of a member in the carrier's frame, where q is neutral."""
    with within("plane"):
        if not link:
            raise InputError(otherwise, expected="plane: a link of the carrier in the middle of the teeth")
        model, data = pair.state.model, pair.state.data
        index = frame_of(model, link)
        bodies = {pair.carrier, *(joint.body for joint in (pair.first, pair.second) if _turns(joint))}
        if model.frames[index].parentJoint not in bodies:
            raise InputError(
                f"the link {link} belongs neither to a wheel nor to what carries the wheels",
                expected="a link fixed to one of them",
            )
    return np.asarray(data.oMi[pair.carrier].actInv(data.oMf[index].translation))


def _turns(member: Member) -> bool:
    return member.joint.unit == RADIAN


def _across(axis: Array, vector: Array) -> Array:
    return np.asarray(vector - axis * (axis @ vector))
