"""The coupling of a cam and its follower, ``q2 = f(q1)``: a holonomic constraint whose row turns with the cam.

With the multiplier lam, the effort at the follower's joint: ``G = (-f', 1)`` at the two joints and
``G' v = -f'' q1'^2``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, partial

import numpy as np

from pinarm.arrays import Array, Complex, Flags, Indices, continued
from pinarm.errors import InputError
from pinarm.input.units import Unit, unit
from pinarm.mechanics.couplings.cams.cam_contact import FollowerMotion, FollowerPoint, FollowerSurface, Touch
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.couplings.members import MemberPair
from pinarm.mechanics.couplings.transmissions import outwards
from pinarm.mechanics.forces.force_element import Edge, Pieces
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.mechanics.joints import METRE, RADIAN, Joint
from pinarm.mechanics.laws.motion_law import JUMP, MotionLaw, Values
from pinarm.mechanics.laws.over_coordinate import Profile
from pinarm.records import AbstractRecord, Record

SAMPLES = 721
"""Places at which a profile is looked at to describe it: every half degree of a turn."""


class CamPlane(Record, frozen=True):
    """The plane of a cam and its follower, in their carrier.

    Attributes:
        pair: The cam and the follower.
        origin: Where the axis of the cam meets the plane [m], shape (3,).
        axes: Unit vectors of the plane and of the axis of the cam, right-handed, shape (3, 3).
    """

    pair: MemberPair
    origin: Array
    axes: Array

    @classmethod
    def of(cls, pair: MemberPair, place: Array) -> CamPlane:
        """Return the plane across the cam's axis through a point of the carrier, shape (3,)."""
        a = pair.first.axis
        origin = pair.first.point + a * (a @ (place - pair.first.point))
        across = np.cross(a, np.eye(3)[np.abs(a).argmin()])
        across /= np.linalg.norm(across)
        return cls(pair, origin, np.array([across, np.cross(a, across), a]))

    @property
    def axis(self) -> Array:
        """Unit vector of the cam's axis, shape (3,)."""
        return np.asarray(self.axes[2])

    def coordinates(self, point: Array) -> complex:
        return self.direction(point - self.origin)

    def direction(self, vector: Array) -> complex:
        """Return the part of a vector, shape (3,), in the plane."""
        return complex(self.axes[0] @ vector, self.axes[1] @ vector)

    def vectors(self, z: Complex) -> Array:
        """Return vectors of the plane in the carrier's axes, shape (n, 3)."""
        return np.asarray(np.multiply.outer(z.real, self.axes[0]) + np.multiply.outer(z.imag, self.axes[1]))


class CamContact(Record, frozen=True):
    """The geometry of a cam's follower.

    Attributes:
        plane: In which they touch.
        point: Of the follower: centre of the roller, or a point of the face.
        surface: The roller or the face.
    """

    plane: CamPlane
    point: FollowerPoint
    surface: FollowerSurface

    @property
    def senses(self) -> tuple[float, float]:
        """Angle or way of each member in the carrier per way of its joint, 1 or -1."""
        first, second = self.plane.pair.first, self.plane.pair.second
        return first.rates[first.joint], second.rates[second.joint]

    def touch(self, values: Values) -> Touch:
        """Return how they touch where the profile has the values f, f' and f'', each of shape (n,)."""
        turning, moving = self.senses
        f, df, ddf = values
        motion = FollowerMotion.of(self.point, moving * f, moving * turning * df, moving * ddf)
        return self.surface.touch(motion)

    def force(self, touch: Touch, lam: Array) -> Array:
        """Return the contact force [N] with efforts lam at the follower's joint, shape (n,); negative if it pulls."""
        with np.errstate(divide="ignore", invalid="ignore"):  # at a pressure angle of 90 degrees no force has an effort
            return np.where(lam == 0.0, 0.0, self.senses[1] * lam / touch.lever)


class CamCoupling(AbstractRecord, JointRelation, frozen=True):
    """A follower's joint that stands where the profile over the cam's joint says.

    Attributes:
        name: Its name.
        nv: Number of velocities of the model.
        cam_joint: Joint of the cam.
        follower_joint: Joint of the follower.
        profile: f.
        one_sided: Whether the cam pushes only.
        contact: Where they touch; ``None`` where that is not known.
        missing: What would have to be given for the forces on bodies to be known, in words.
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
        return self.known_contact.plane.pair.second.body

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
        """Return ``-f'' q1'^2``.

        Raises:
            InputError: A complex step moves a turning cam: that takes a third derivative of f.
        """
        if (np.imag(q[:, self.cam_joint.q]) * np.real(v[:, self.cam_joint.v])).any():
            raise InputError(
                f"the linear analysis has no derivatives of the turning cam '{self.name}'", expected="a cam at rest"
            )
        return np.asarray(-self.values(np.real(q), np.real(v))[2] * v[:, self.cam_joint.v] ** 2)

    @property
    def known_contact(self) -> CamContact:
        """The contact, which must be known."""
        assert self.contact is not None
        return self.contact

    def touch(self, q: Array, v: Array | None = None) -> Touch:
        """Return how they touch at configurations, shape (n, nq); see ``values``."""
        return self.known_contact.touch(self.values(q, v))

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return the opposite contact forces on cam and follower; nothing where the contact is not known."""
        if self.contact is None:
            return {}
        touch = self.touch(links.q)
        return self.opposite(links, touch, self.contact.force(touch, lam[:, 0]) * touch.normal)

    def opposite(self, links: LinkPlacements, touch: Touch, force: Complex) -> dict[int, Array]:
        """Return forces at the contact [N], in the plane, on the follower and back on the cam."""
        plane = self.known_contact.plane
        point, pushes = plane.origin + plane.vectors(touch.point), plane.vectors(force)
        wrench = outwards(links, plane.pair.carrier, np.concatenate([pushes, crossed(point, pushes)], axis=1))
        return {plane.pair.second.body: wrench, plane.pair.first.body: -wrench}

    def transmitted(self, links: LinkPlacements, lam: Array) -> tuple[Array, Array]:
        """Return the contact point, and the force on the follower there; see ``JointRelation``."""
        plane, touch = self.known_contact.plane, self.touch(links.q)
        force = plane.vectors(self.known_contact.force(touch, lam[:, 0]) * touch.normal)
        turn, place = links.turns[:, plane.pair.carrier], links.places[:, plane.pair.carrier]
        point = place + np.matvec(turn, plane.origin + plane.vectors(touch.point))
        return point, np.concatenate([np.matvec(turn, force), np.zeros_like(force)], axis=1)

    def parts(self) -> dict[str, Unit]:
        if self.contact is None:
            return {}
        parts = {"normal": unit("N"), "pressure_angle": RADIAN, "curvature_radius": METRE}
        return {**parts, **({"eccentricity": METRE} if self.contact.surface.flat else {})}

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
        """How they touch all along the profile; the contact must be known."""
        return self.known_contact.touch(self.profile(sample_range(self.profile)))

    @property
    def shape(self) -> Array:
        """The outline of the cam in its carrier where the cam's joint is at 0 [m], shape (n, 3); see ``outline``."""
        plane, (turning, _) = self.known_contact.plane, self.known_contact.senses
        points = self.outline.point * np.exp(-1j * turning * sample_range(self.profile))
        return plane.origin + plane.vectors(points)

    def flawed(self, q: Array) -> Flags:
        if self.contact is None:
            return super().flawed(q)
        return self.contact.surface.undercut(self.touch(q).radius)

    @property
    def flaw(self) -> str:
        return f"is undercut: no cam has this profile with its {self.known_contact.surface.words}"

    @property
    def in_pieces(self) -> bool:
        return bool(len(self._pieces.bounds))

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(self.profile.marks, self.profile.period)

    def edges(self) -> list[Edge]:
        return [Edge(partial(self._beside, place)) for place in self.profile.starts]

    def _beside(self, place: float, t: Array, q: Array, v: Array) -> Array:
        """Return what vanishes where the cam is at a place, in every period."""
        away, period = q[:, self.cam_joint.q] - place, self.profile.period
        return away if period == np.inf else np.sin(np.pi * away / period)

    def passages(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        """Return when the cam passes places at which f'' jumps, where it follows a law."""
        law = laws.get(self.cam_joint.v)
        return [] if law is None else [t for t in self.profile.passages(law, start, end) if self._jumps(law, t)]

    def marked(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        """Return when the cam passes breakpoints and knots of its profile, where it follows a law."""
        law = laws.get(self.cam_joint.v)
        return [] if law is None else self.profile.marked(law, start, end)

    def _jumps(self, law: MotionLaw, t: float) -> bool:
        """Return whether f'' jumps where the cam is at an instant."""
        place = law.on(t, t)(np.array([t]))[0]
        before, after = (self.profile(place, side)[2] for side in (-1.0, 1.0))
        size = max(piece.size()[2] for piece in self.profile.pieces)
        return bool(abs(after - before) > JUMP * size)

    def passed(self, q: Array, v: Array) -> bool:
        """Return whether the cam passes a whole piece of the profile, or the way from one knot to the next."""
        return self._pieces.passed(q[:, self.cam_joint.q])

    @property
    def description(self) -> str:
        if self.contact is None:
            return f"its forces on bodies are not known: {self.missing}"
        touch = self.outline
        steepest = np.rad2deg(np.abs(touch.pressure_angle).max())
        words = (f"{self.contact.surface.words}, cam of radius {1e3 * np.abs(touch.point).min():.6g} to "
                 f"{1e3 * np.abs(touch.point).max():.6g} mm, pressure angle up to {steepest:.4g} deg")  # fmt: skip
        return words + (", pushes only" if self.one_sided else "")


def sample_range(profile: Profile) -> Array:
    """Return places that show all of a profile, shape (n,): a period, its pieces, or, without ends, one turn."""
    ends = [end for piece in profile.pieces for end in (piece.start, piece.end) if np.isfinite(end)]
    low, high = (min(ends), max(ends)) if len(set(ends)) > 1 else (0.0, 2.0 * np.pi)
    return np.linspace(low, high, SAMPLES)
