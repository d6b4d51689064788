"""Where a cam touches its follower: contact point, normal, pressure angle, curvature and slip.

All in the plane across the cam's axis, in which vectors are complex numbers, with the axis at 0 and the axes of the
carrier. The cam has turned by alpha, the follower stands at ``y(alpha)``, and a prime is ``d/d alpha``. A point P of
the follower moves against the cam with ``u = P' - i P`` per angle. The contact normal n points from the cam to the
follower.

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

import numpy as np

from pinarm.arrays import Array, Complex, Flags
from pinarm.records import Record, ValueRecord


class SlidingPoint(Record, frozen=True):
    """A point of a follower that slides.

    Attributes:
        start: Where it is at y = 0 [m].
        way: Direction in which it slides, of length 1.
        sense: 0: the follower does not turn.
    """

    start: complex
    way: complex
    sense: float = 0.0

    def at(self, y: Array) -> tuple[Complex, Complex, Complex]:
        way = np.full(y.shape, self.way, dtype=np.complex128)
        return self.start + way * y, way, np.zeros_like(way)


class TurningPoint(Record, frozen=True):
    """A point of a follower that turns about an axis parallel to that of the cam.

    Attributes:
        start: Where it is at y = 0 [m].
        pivot: Place of the axis [m].
        sense: 1 where the follower turns as the cam for growing y, -1 where against it.
    """

    start: complex
    pivot: complex
    sense: float

    def at(self, y: Array) -> tuple[Complex, Complex, Complex]:
        arm: Complex = (self.start - self.pivot) * np.exp(1j * self.sense * y)
        return self.pivot + arm, 1j * self.sense * arm, -arm


FollowerPoint = SlidingPoint | TurningPoint


class FollowerMotion(Record, frozen=True):
    """The follower's point against the turning cam, at n positions.

    Attributes:
        p: P [m], shape (n,).
        tangent: Derivative of P by y, shape (n,).
        u: ``P' - i P`` [m/rad], shape (n,).
        du: ``u'``, shape (n,).
        turn: ``s y'``, angle of the follower per angle of the cam, shape (n,).
        dturn: ``s y''``, shape (n,).
        angle: ``s y``, by which the follower has turned [rad], shape (n,).
        sense: s.
    """

    p: Complex
    tangent: Complex
    u: Complex
    du: Complex
    turn: Array
    dturn: Array
    angle: Array
    sense: float

    @classmethod
    def of(cls, point: FollowerPoint, y: Array, dy: Array, ddy: Array) -> FollowerMotion:
        """Return the motion of a point for ``y(alpha)`` and its derivatives, each of shape (n,)."""
        p, tangent, bend = point.at(y)
        dp, ddp = tangent * dy, tangent * ddy + bend * dy**2
        s = point.sense
        return cls(p, tangent, dp - 1j * p, ddp - 1j * dp, s * dy, s * ddy, s * y, s)


class Touch(Record, frozen=True):
    """How a cam and its follower touch, at n positions.

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


class Roller(ValueRecord, frozen=True):
    """A roller about the follower's point, or a knife edge; its rotation has no inertia.

    Attributes:
        radius: [m]; 0 of a knife edge.
    """

    radius: float
    flat: bool = False

    def touch(self, motion: FollowerMotion) -> Touch:
        size = np.abs(motion.u)
        with np.errstate(divide="ignore", invalid="ignore"):  # a cusp of the pitch curve has no tangent
            tangent = motion.u / size
        normal = 1j * tangent
        with np.errstate(divide="ignore", invalid="ignore"):  # straight where the curvature is 0
            radius = -(size**3) / along(1j * motion.u, motion.du - 1j * motion.u) - self.radius
        point = motion.p - self.radius * normal
        velocity = motion.tangent - 1j * motion.sense * self.radius * normal
        slip = size - (1.0 - motion.turn) * self.radius
        slip_rate = along(tangent, motion.du) + motion.dturn * self.radius
        return Touch(point, normal, velocity, motion.tangent, radius, np.zeros(size.shape), slip, slip_rate, tangent)

    @property
    def words(self) -> str:
        return f"roller of radius {1e3 * self.radius:.6g} mm" if self.radius else "knife edge"

    def undercut(self, radius: Array) -> Flags:
        """Return where the pitch curve bends to the side of the cam more than the roller does."""
        return np.asarray((radius < 0.0) & (radius > -self.radius))


class Face(ValueRecord, frozen=True):
    """A flat face through the follower's point.

    Attributes:
        normal: n at y = 0, of length 1.
    """

    normal: complex
    flat: bool = True

    def touch(self, motion: FollowerMotion) -> Touch:
        n, turn, rest = self.normal * np.exp(1j * motion.angle), motion.turn, 1.0 - motion.turn
        gap, slip = along(n, motion.u), -along(1j * n, motion.u)
        gap_rate = turn * -slip + along(n, motion.du)
        xi = -gap / rest
        dxi = -gap_rate / rest - gap * motion.dturn / rest**2
        point = motion.p + xi * 1j * n
        moved = motion.u + 1j * motion.p - xi * turn * n + dxi * 1j * n - 1j * point  # of the contact, on the cam
        velocity = motion.tangent - motion.sense * xi * n
        slip_rate = turn * gap - along(1j * n, motion.du)
        return Touch(point, n, velocity, velocity, -along(1j * n, moved) / rest, -xi, slip, slip_rate, -1j * n)

    @property
    def words(self) -> str:
        return "flat face"

    def undercut(self, radius: Array) -> Flags:
        """Return where the cam would be hollow: the face bridges that."""
        return np.asarray(radius <= 0.0)


FollowerSurface = Roller | Face
"""The part of a follower that a cam touches; on a flat one the contact wanders."""


def along(direction: Complex, vector: Complex) -> Array:
    """Return ``Re(conj(direction) vector)``, the scalar product of vectors in the plane."""
    return np.asarray((np.conj(direction) * vector).real)
