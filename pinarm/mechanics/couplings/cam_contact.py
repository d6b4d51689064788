"""Contact of a cam and its follower: contact point, normal, pressure angle, curvature and slip.

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
from pinarm.mechanics.couplings.teeth import MemberPair
from pinarm.mechanics.laws.motion_law import Values
from pinarm.records import Record, ValueRecord


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


class CamContact(Record, frozen=True):
    """A cam and its follower in their plane, in the axes of their carrier.

    Attributes:
        origin: Where the axis of the cam meets the plane [m], shape (3,).
        axes: Unit vectors of the plane and of the axis of the cam, right-handed, shape (3, 3).
    """

    pair: MemberPair
    origin: Array
    axes: Array
    follower: Follower = Follower(0j, 0j)

    @classmethod
    def through(cls, pair: MemberPair, place: Array) -> CamContact:
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

    def direction(self, vector: Array) -> complex:
        """Return the part of a vector, shape (3,), in the plane."""
        return complex(self.axes[0] @ vector, self.axes[1] @ vector)

    def vectors(self, z: Complex) -> Array:
        """Return vectors of the plane in the carrier's axes, shape (n, 3)."""
        return np.asarray(np.multiply.outer(z.real, self.axes[0]) + np.multiply.outer(z.imag, self.axes[1]))

    @property
    def senses(self) -> tuple[float, float]:
        """Angle or way of each member in the carrier per way of its joint, 1 or -1."""
        first, second = self.pair.first, self.pair.second
        return first.rates[first.joint], second.rates[second.joint]

    def touch(self, values: Values) -> Touch:
        """Return the contact where the profile has the values f, f' and f'', each of shape (n,)."""
        (turning, moving), (f, df, ddf) = self.senses, values
        return self.follower.touch(moving * f, moving * turning * df, moving * ddf)

    def force(self, touch: Touch, lam: Array) -> Array:
        """Return the contact force [N] with efforts lam at the follower's joint, shape (n,); negative if it pulls."""
        with np.errstate(divide="ignore", invalid="ignore"):  # at a pressure angle of 90 degrees no force has an effort
            return np.where(lam == 0.0, 0.0, self.senses[1] * lam / touch.lever)


def along(direction: Complex, vector: Complex) -> Array:
    """Return ``Re(conj(direction) vector)``, the scalar product of vectors in the plane."""
    return np.asarray((np.conj(direction) * vector).real)
