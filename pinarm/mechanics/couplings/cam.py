"""A cam and its follower, ``q2 = f(q1)``: a holonomic constraint whose row turns with the cam, and their contact.

With the multiplier lam, the effort at the follower's joint: ``G = (-f', 1)`` at the two joints and
``G' v = -f'' q1'^2``.

The contact is in the plane across the cam's axis, in which vectors are complex numbers, with the axis at 0 and the
axes of the carrier. The cam has turned by alpha, the follower stands at ``y(alpha)``, and a prime is ``d/d alpha``. A
point P of the follower moves against the cam with ``u = P' - i P`` per angle. The contact normal n points from the cam
to the follower.

- Roller with its centre at P: n is normal to u, ``n = i u / |u|``. The pitch curve, the path of P on the cam, has the
  radius of curvature ``-|u|^3 / Im(conj(u) (u' - i u))``, and the cam that of the pitch curve less the roller's radius.
- Flat face through P with the normal n: the contact is at ``P + xi i n``, where ``xi = -Re(conj(n) u) / (1 - s y')``
  makes the relative velocity tangential; s is 1 or -1 where the follower turns as the cam or against it, 0 where it
  slides. The cam has the radius of curvature ``ds / dpsi`` of the arc length s and the angle psi of the normal on it.

A force F along n at a point of the follower that moves by V per way y has the effort ``F Re(conj(n) V)`` along y; the
pressure angle is that from V to n.
Source: Norton, Cam Design and Manufacturing Handbook, chapter 7 (pressure angle, radius of curvature, undercutting).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, partial
from typing import ClassVar, Literal

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Complex, Flags, Indices, continued
from pinarm.errors import InputError, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import Extent, InputStruct, Length, check_unit
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.couplings.teeth import MemberPair, member_pair
from pinarm.mechanics.couplings.transmissions import NEWTON, Transmission
from pinarm.mechanics.forces.force_element import Edge, Pieces
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.mechanics.joints import METRE, PARALLEL, RADIAN, Direction, Joint, frame_of, joint_of, unit_vector
from pinarm.mechanics.laws.kinds import Law
from pinarm.mechanics.laws.motion_law import JUMP, MotionLaw, Values
from pinarm.mechanics.laws.over_coordinate import Profile
from pinarm.records import Record, ValueRecord

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
        lift, contact = Lift(Profile.of(self.profile, self.period), first), None
        if self.roller or self.face:
            contact = self._contact(member_pair(model, joints, (first, second)), lift)
        return CamCoupling(
            name, "cam", contact, "" if contact else "it has neither roller nor face",
            nv=model.nv, lift=lift, follower_joint=second, one_sided=self.closed_by == "force",
        )  # fmt: skip

    def _contact(self, pair: MemberPair, lift: Lift) -> CamContact:
        cam, follower, a = pair.first, pair.second, pair.first.axis
        if cam.joint.unit != RADIAN:
            raise InputError(
                f"the cam's joint {cam.joint.name} slides: its contact is not known",
                expected="a cam that turns",
                hint="without roller and face",
            )
        place = self._place(pair)
        origin = cam.point + a * (a @ (place.translation - cam.point))
        across = np.cross(a, np.eye(3)[np.abs(a).argmin()])
        across /= np.linalg.norm(across)
        axes = np.array([across, np.cross(a, across), a])

        def direction(vector: Array) -> complex:
            return complex(*(axes[:2] @ vector))

        p = direction(place.translation - origin)
        if follower.joint.unit == METRE:
            out, way, sense = float(abs(follower.axis @ a)), direction(follower.axis), 0.0
        else:
            out = float(np.linalg.norm(np.cross(follower.axis, a)))
            sense = float(np.sign(follower.axis @ a))
            way = 1j * sense * (p - direction(follower.point - origin))
        face, normal = None, np.zeros(3)
        if self.normal is not None:
            normal = place.rotation @ unit_vector(self.normal)
        if max(out, float(abs(normal @ a))) > PARALLEL:
            raise InputError(
                f"the follower's joint {follower.joint.name}, or the normal of its face, leaves the plane of the cam",
                expected="a follower that slides across the cam's axis, or turns about one parallel to it",
                hint="without roller and face",
            )
        if self.face:
            face = self._facing(p, direction(normal) or way)
        shape = Follower(p, way, sense, float(self.roller_radius), face)
        senses = cam.rates[cam.joint], follower.rates[follower.joint]
        return CamContact(*pair.bodies, shape.words, lift=lift, origin=origin, axes=axes, senses=senses, follower=shape)

    def _place(self, pair: MemberPair) -> pin.SE3:
        with within("roller" if self.roller else "face"):
            index, model = frame_of(pair.state.model, self.roller or self.face), pair.state.model
            if model.frames[index].parentJoint != pair.second.body:
                raise InputError(
                    f"the link {self.roller or self.face} is not on the follower, which {pair.second.joint.name} moves",
                    expected="a link of the follower",
                )
        data = pair.state.data
        return data.oMi[pair.carrier].actInv(data.oMf[index])

    def _facing(self, p: complex, normal: complex) -> complex:
        distance = (np.conj(normal) * p).real / abs(normal)
        if distance == 0.0:
            with within("face"):
                raise InputError("the face goes through the axis of the cam", expected="a face beside it")
        return complex(normal / abs(normal) * np.sign(distance))


def _require_smooth(profile: MotionLaw, cam: Joint) -> None:
    profile.require_continuous(cam.unit)
    for w in profile.jumps(1):
        raise InputError(
            f"the slope of the profile jumps at {w:.6g} {cam.unit}: the follower would be hit",
            expected="a profile whose slope is continuous, such as cycloidal or polynomial",
        )


class Lift(Record, frozen=True):
    """The place y of a follower's joint over the coordinate of a cam's joint."""

    profile: Profile
    joint: Joint

    def __call__(self, q: Array, v: Array | None = None) -> Values:
        """Return f, f' and f'' at configurations, shape (n, nq), each of shape (n,).

        Where f'' jumps it is that of the side to which the cam moves.
        """
        return self.profile(q[:, self.joint.q], 0.0 if v is None else np.sign(v[:, self.joint.v]))

    @cached_property
    def range(self) -> Array:
        """Places that show all of the profile, shape (n,): a period, its pieces, or, without ends, one turn."""
        ends = [end for piece in self.profile.pieces for end in (piece.start, piece.end) if np.isfinite(end)]
        low, high = (min(ends), max(ends)) if len(set(ends)) > 1 else (0.0, 2.0 * np.pi)
        return np.linspace(low, high, SAMPLES)


class CamCoupling(JointRelation, frozen=True, kw_only=True):
    """A follower's joint that stands where the profile over the cam's joint says."""

    unshown = ("lift", "transmission")
    opens: ClassVar[str] = "the follower lifts off"  # type: ignore[misc]

    nv: int
    lift: Lift
    follower_joint: Joint
    one_sided: bool

    @property
    def contact(self) -> CamContact | None:
        """Where cam and follower touch; ``None`` where that is not known."""
        assert self.transmission is None or isinstance(self.transmission, CamContact)
        return self.transmission

    @property
    def cam_joint(self) -> Joint:
        return self.lift.joint

    @property
    def profile(self) -> Profile:
        return self.lift.profile

    @property
    def joints(self) -> Indices:
        return np.array(sorted((self.cam_joint.v, self.follower_joint.v)), dtype=np.intp)

    def unit(self, row: int) -> Unit:
        return self.follower_joint.unit

    def at(self, q: Array) -> Array:
        """Return ``q2 - f(q1)``."""
        return np.asarray(q[:, self.follower_joint.q] - self.lift(q)[0])

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
        return np.asarray(-self.lift(np.real(q), np.real(v))[2] * v[:, self.cam_joint.v] ** 2)

    def push(self, q: Array, lam: Array) -> Array:
        """Return with what the cam pushes its follower, negative where it pulls, shape (n,).

        The contact force [N] where the contact is known, otherwise the effort at the follower's joint.
        """
        return self.contact.part("normal", q, lam) if self.contact else lam

    def push_unit(self) -> Unit:
        """Return N, or the unit of the follower's effort where the contact is not known."""
        return NEWTON if self.transmission else super().push_unit()

    @cached_property
    def side(self) -> float:
        """Sense in which the cam pushes the follower's coordinate; 0 where it holds it both ways."""
        if not self.one_sided or (contact := self.contact) is None:
            return float(self.one_sided)
        return float(np.sign(contact.senses[1] * contact.outline.lever[0]))

    def flawed(self, q: Array) -> Flags:
        """Return at which configurations, shape (n, nq), no cam has the profile with its follower, shape (n,)."""
        if (contact := self.contact) is None:
            return np.zeros(len(q), dtype=bool)
        return contact.follower.undercut(contact.touch(q).radius)

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(self.profile.marks, self.profile.period)

    def edges(self) -> list[Edge]:
        """Return where pieces of the profile meet: steps of integrations end there."""
        return [Edge(partial(self._beside, place)) for place in self.profile.starts]

    def _beside(self, place: float, t: Array, q: Array, v: Array) -> Array:
        """Return values that vanish where the cam is at a place, in every period, shape (n,)."""
        away, period = q[:, self.cam_joint.q] - place, self.profile.period
        return away if period == np.inf else np.sin(np.pi * away / period)

    def passages(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        """Return when f'' jumps where joints follow laws, by their index in v, between instants [s]."""
        law = laws.get(self.cam_joint.v)
        passed = self.profile.passed(self.profile.starts, law, start, end) if law else []
        return [t for t in passed if law and self._jumps_at(law.on(t, t)(np.array([t]))[0])]

    def marked(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        law = laws.get(self.cam_joint.v)
        return [] if law is None else self.profile.passed(self.profile.marks, law, start, end)

    def has_kink(self, q: Array) -> bool:
        """Return whether the row has another slope to either side of a configuration, shape (1, nq)."""
        return self._jumps_at(q[:, self.cam_joint.q])

    def _jumps_at(self, place: Array) -> bool:
        before, after = (self.profile(place, side)[2] for side in (-1.0, 1.0))
        size = max(abs(before), *(piece.size()[2] for piece in self.profile.pieces))
        return bool(abs(after - before) > JUMP * size)

    def passed(self, q: Array) -> bool:
        """Return whether a step may have gone past a piece of the profile without having seen it; see ``Pieces``."""
        return self._pieces.passed(q[:, self.cam_joint.q])

    @property
    def description(self) -> str:
        if (contact := self.contact) is None:
            return super().description
        radii, steepest = np.abs(contact.outline.point), np.rad2deg(np.abs(contact.outline.pressure_angle).max())
        words = (
            f"{contact.words}, cam of radius {1e3 * radii.min():.6g} to {1e3 * radii.max():.6g} mm, "
            f"pressure angle up to {steepest:.4g} deg"
        )
        return words + (", pushes only" if self.one_sided else "")


class Touch(Record, frozen=True):
    """Contact of a cam and its follower, at n positions.

    Attributes:
        point: Contact point [m], shape (n,).
        normal: n, shape (n,).
        velocity: V, of the follower's material point there per way y, shape (n,).
        guided: Velocity per way y from which the pressure angle is meant: of the roller's centre, or V, shape (n,).
        radius: Radius of curvature of the cam there [m], negative where it is hollow, shape (n,).
        eccentricity: Of the contact on a flat face, from the face's point, along ``-i n`` [m]; 0 of a roller, (n,).
        slip: Velocity of the follower's material point against the cam along the tangent, per angle [m/rad], (n,).
        slip_rate: Derivative of the slip by alpha, shape (n,).
        tangent: The tangent along which the slip is meant, shape (n,).
    """

    point: Complex
    normal: Complex
    velocity: Complex
    guided: Complex
    radius: Array
    eccentricity: Array
    slip: Array
    slip_rate: Array
    tangent: Complex

    @property
    def lever(self) -> Array:
        """Effort along y of a unit contact force, ``Re(conj(n) V)``, shape (n,)."""
        return along(self.normal, self.velocity)

    @property
    def pressure_angle(self) -> Array:
        """Angle from the follower's velocity, reversed where that points to the cam, to n [rad], shape (n,)."""
        facing = self.guided * np.where(self.lever < 0.0, -1.0, 1.0)
        return np.angle(self.normal * np.conj(facing))


class Follower(ValueRecord, frozen=True):
    """A follower with a roller about its point P, a knife edge there, or a flat face through it.

    Attributes:
        start: P at y = 0 [m].
        sense: 1 where the follower turns as the cam for growing y, -1 where against it, 0 where it slides.
        radius: Of the roller, whose rotation has no inertia [m]; 0 of a knife edge.
        face: Normal of the flat face at y = 0, of length 1; ``None`` of a roller.
    """

    start: complex
    way: complex
    sense: float = 0.0
    radius: float = 0.0
    face: complex | None = None

    @property
    def words(self) -> str:
        if self.face is not None:
            return "flat face"
        return f"roller of radius {1e3 * self.radius:.6g} mm" if self.radius else "knife edge"

    def undercut(self, radius: Array) -> Flags:
        """Return where no cam has this radius of curvature, shape (n,).

        A flat face bridges what is hollow; the pitch curve of a roller must not bend more than the roller does.
        """
        if self.face is not None:
            return np.asarray(radius <= 0.0)
        return np.asarray((radius < 0.0) & (radius > -self.radius))

    def touch(self, y: Array, dy: Array, ddy: Array) -> Touch:
        """Return the contact for ``y(alpha)`` and its derivatives, each of shape (n,)."""
        s, turned = self.sense, np.exp(1j * self.sense * np.asarray(y, complex))
        tangent = self.way * turned
        p = np.asarray(self.start + self.way * ((turned - 1.0) / (1j * s) if s else y), complex)
        dp, ddp = tangent * dy, tangent * ddy + 1j * s * tangent * dy**2
        touch = self._rolled if self.face is None else self._faced
        return touch(p, tangent, dp - 1j * p, ddp - 1j * dp, turned, s * dy, s * ddy)

    def _rolled(
        self, p: Complex, tangent: Complex, u: Complex, du: Complex, turned: Complex, turn: Array, dturn: Array
    ) -> Touch:
        """Return the contact of a roller, by u and u', and the follower's angle per angle of the cam, and its rate."""
        size = np.abs(u)
        with np.errstate(divide="ignore", invalid="ignore"):  # a cusp of the pitch curve, which may be straight, too
            heading = u / size
            radius = -(size**3) / along(1j * u, du - 1j * u) - self.radius
        normal = 1j * heading
        velocity = tangent - 1j * self.sense * self.radius * normal
        slip, slip_rate = size - (1.0 - turn) * self.radius, along(heading, du) + dturn * self.radius
        point = p - self.radius * normal
        return Touch(point, normal, velocity, tangent, radius, np.zeros(size.shape), slip, slip_rate, heading)

    def _faced(
        self, p: Complex, tangent: Complex, u: Complex, du: Complex, turned: Complex, turn: Array, dturn: Array
    ) -> Touch:
        """Return the contact of a flat face; see ``_rolled``."""
        assert self.face is not None
        n, rest = self.face * turned, 1.0 - turn
        gap, slip = along(n, u), -along(1j * n, u)
        xi = -gap / rest
        dxi = -(along(n, du) - turn * slip) / rest - gap * dturn / rest**2
        point = p + xi * 1j * n
        moved = u + 1j * p - xi * turn * n + dxi * 1j * n - 1j * point  # of the contact, on the cam
        velocity, slip_rate = tangent - self.sense * xi * n, turn * gap - along(1j * n, du)
        return Touch(point, n, velocity, velocity, -along(1j * n, moved) / rest, -xi, slip, slip_rate, -1j * n)


class CamContact(Transmission, frozen=True, kw_only=True):
    """A cam and its follower in their plane, in the axes of their carrier.

    Attributes:
        origin: Where the axis of the cam meets the plane [m], shape (3,).
        axes: Unit vectors of the plane and of the axis of the cam, right-handed, shape (3, 3).
        senses: Angle or way of each member in the carrier per way of its joint, 1 or -1.
    """

    lift: Lift
    origin: Array
    axes: Array
    senses: tuple[float, float]
    follower: Follower

    def vectors(self, z: Complex) -> Array:
        """Return vectors of the plane in the carrier's axes, shape (n, 3)."""
        return np.asarray(np.multiply.outer(z.real, self.axes[0]) + np.multiply.outer(z.imag, self.axes[1]))

    def touch(self, q: Array, v: Array | None = None) -> Touch:
        return self._touch(*self.lift(q, v))

    def _touch(self, f: Array, df: Array, ddf: Array) -> Touch:
        turning, moving = self.senses
        return self.follower.touch(moving * f, moving * turning * df, moving * ddf)

    @cached_property
    def outline(self) -> Touch:
        """Contact along the whole profile."""
        return self._touch(*self.lift.profile(self.lift.range))

    @property
    def shape(self) -> Array:
        """The outline of the cam in its carrier where the cam's joint is at 0 [m], shape (n, 3); see ``outline``."""
        return self.origin + self.vectors(self.outline.point * np.exp(-1j * self.senses[0] * self.lift.range))

    def place(self, q: Array) -> Array:
        return self.origin + self.vectors(self.touch(q).point)

    def in_carrier(self, q: Array, lam: Array) -> dict[int, Array]:
        touch = self.touch(q)
        return self.opposite(touch, self._force(touch, lam) * touch.normal)

    def opposite(self, touch: Touch, force: Complex) -> dict[int, Array]:
        """Return wrenches of forces at the contact [N], in the plane, on the follower and back on the cam."""
        point, pushes = self.origin + self.vectors(touch.point), self.vectors(force)
        wrench = np.concatenate([pushes, crossed(point, pushes)], axis=-1)
        return {self.second: wrench, self.first: -wrench}

    def _force(self, touch: Touch, lam: Array) -> Array:
        """Return the contact force [N] with efforts lam at the follower's joint, shape (n,); negative if it pulls."""
        with np.errstate(divide="ignore", invalid="ignore"):  # at a pressure angle of 90 degrees no force has an effort
            return np.where(lam == 0.0, 0.0, self.senses[1] * lam / touch.lever)

    def parts(self) -> dict[str, Unit]:
        parts = {"normal": NEWTON, "pressure_angle": RADIAN, "curvature_radius": METRE}
        return parts if self.follower.face is None else {**parts, "eccentricity": METRE}

    def part(self, name: str, q: Array, lam: Array) -> Array:
        touch = self.touch(q)
        if name == "normal":
            return self._force(touch, lam)
        parts = {"pressure_angle": touch.pressure_angle, "curvature_radius": touch.radius}
        return {**parts, "eccentricity": touch.eccentricity}[name]


def along(direction: Complex, vector: Complex) -> Array:
    """Return ``Re(conj(direction) vector)``, the scalar product of vectors in the plane."""
    return np.asarray((np.conj(direction) * vector).real)
