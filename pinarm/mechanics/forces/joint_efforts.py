"""What drives a joint: efforts over time or over a coordinate, and motors at full power."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np

from pinarm.arrays import Array, continued
from pinarm.mechanics.forces.breakpoints import Pieces
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import MotionLaw, Values
from pinarm.mechanics.laws.over_coordinate import Profile
from pinarm.records import AbstractRecord, replace


class AppliedEffort(AbstractRecord, ForceElement, frozen=True):
    """A torque or force at a joint that follows a law of time; all of its power is supplied.

    Attributes:
        v: Index in v.
        law: The effort [N*m or N] over time.
        function: The smooth piece of the law on the present interval.
        constant: Its value there if it is constant.
    """

    v: int
    law: MotionLaw
    function: Callable[[Array], Values] | None = None
    constant: float | None = None

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        tau[..., self.v] += self._effort(t)

    def potential_energy(self, q: Array) -> Array:
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        return np.asarray(-self._effort(t) * v[..., self.v])

    @property
    def steady(self) -> bool:
        return self.constant is not None

    def laws(self) -> list[MotionLaw]:
        return [self.law]

    def on(self, start: float, end: float) -> AppliedEffort:
        constant = float(self.law.value) if isinstance(self.law, Constant) else None
        return replace(self, function=self.law.on(start, end), constant=constant)

    def _effort(self, t: Array | float) -> Array | float:
        if self.constant is not None:
            return self.constant
        if self.function is None:
            raise ValueError("a law is evaluated on an interval of time: take the element's on(start, end)")
        return self.function(np.asarray(t, float))[0]


class ProfiledEffort(AbstractRecord, ForceElement, frozen=True):
    """A torque or force at a joint that depends on the coordinate of a joint, such as of gas on a crank.

    All of its power is supplied, also where it could be called a spring. Forward problems step over the profile's
    breakpoints, where their accuracy is that of a kink, but over no whole piece, nor over the way from one point of a
    spline or table to the next.

    Attributes:
        v: Index in v of the joint that it acts on.
        q: Index in q of the joint that it depends on.
        along: Index in v of that joint.
        profile: The effort [N*m or N] over that joint's coordinate.
    """

    v: int
    q: int
    along: int
    profile: Profile

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        tau[..., self.v] += continued(lambda w: self.profile(w)[:2], q[..., self.q])

    def potential_energy(self, q: Array) -> Array:
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        return np.asarray(-self.profile(q[..., self.q])[0] * v[..., self.v])

    @property
    def in_pieces(self) -> bool:
        """Whether there are pieces: there are."""
        return True

    def passed(self, q: Array, v: Array) -> bool:
        return self._pieces.passed(q[..., self.q])

    def marked(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        """Return when the coordinate passes breakpoints and knots of the profile, where it follows a law."""
        law = laws.get(self.along)
        return [] if law is None else self.profile.marked(law, start, end)

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(self.profile.marks, self.profile.period)


class MotorCurve(AbstractRecord, ForceElement, frozen=True):
    """A motor at full power: its effort is a function of its velocity, linear between points, constant beyond them.

    Attributes:
        v: Index in v.
        speeds: Velocities of the points, ascending [rad/s or m/s], shape (k,).
        efforts: Efforts there [N*m or N], shape (k,).
    """

    v: int
    speeds: Array
    efforts: Array

    def add_load(self, t: Array | float, q: Array, v: Array, tau: Array) -> None:
        """Add the load to ``tau``."""
        tau[..., self.v] += continued(self._curve, v[..., self.v])

    def potential_energy(self, q: Array) -> Array:
        return np.zeros(q.shape[:-1])

    def dissipated_power(self, t: Array | float, q: Array, v: Array) -> Array:
        rate = v[..., self.v]
        return np.asarray(-np.interp(rate, self.speeds, self.efforts) * rate)

    @property
    def in_pieces(self) -> bool:
        """Whether there are pieces: there are."""
        return True

    def passed(self, q: Array, v: Array) -> bool:
        """Return whether the velocity passes the whole way between two points of the curve."""
        return self._pieces.passed(v[..., self.v])

    def _curve(self, rate: Array) -> tuple[Array, Array]:
        """Return the efforts and their slopes at velocities."""
        place = np.searchsorted(self.speeds, rate)
        slopes = np.concatenate([[0.0], np.diff(self.efforts) / np.diff(self.speeds), [0.0]])
        return np.interp(rate, self.speeds, self.efforts), slopes[place]

    @cached_property
    def _pieces(self) -> Pieces:
        return Pieces(self.speeds)
