"""Laws of loads: over time, over a coordinate, in one direction of motion, for a limited time.

Loads may jump where positions must not. A motion is integrated from jump to jump: in between the load is continued
smoothly, and its jumps are located as events.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import Literal

import numpy as np
import pinocchio as pin
from msgspec import field

from pinarm.arrays import Array, Flags, continued
from pinarm.errors import InputError, Key, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import Extent, InputStruct, Time, check_unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, MeasuredCoordinate, coordinate_of
from pinarm.mechanics.forces.force_element import Edge, Pieces, edge_along
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import MotionLaw, Piece, Values, polynomial
from pinarm.mechanics.laws.over_coordinate import Driven, Profile, reversals
from pinarm.records import Record, replace

SENSES = {"increasing": 1.0, "decreasing": -1.0}
"""Directions of motion, and the signs of their rates."""


BEYOND = 1e-9
"""Part of the range of points by which a coordinate may leave it: rounding of typed angles."""


class Gate(Record, frozen=True):
    """A direction of motion in which a load acts.

    Attributes:
        is_open: Whether it acts until the next edge; ``None`` where the rate tells.
    """

    along: MeasuredCoordinate
    sense: float
    is_open: bool | None = None

    def acts(self, q: Array, v: Array) -> Flags:
        """Return whether the load acts in states, shape (...); at rest it does not."""
        rate = self.sense * np.real(self.along.moving(q, v)[1])
        return np.asarray(rate > 0.0) if self.is_open is None else np.full(rate.shape, self.is_open)

    @property
    def edge(self) -> Edge:
        """Where the load begins or ceases to act."""
        side = -self.sense if self.is_open is False else self.sense
        return edge_along(self.along, lambda w, rate: side * rate, direction=0 if self.is_open is None else -1)


class LoadLaw(Record, frozen=True):
    """Size of a load: a law over time, times f(w) of a coordinate w, 0 but in one direction of motion.

    Attributes:
        over_time: The law over time.
        profile: f; ``None`` for 1.
        along: The coordinate w.
        gates: Directions of motion in which the load acts.
        function: The law over time on the present interval.
        stretch: Values of w between the jumps of f that hold until the next edge; ``None`` where w tells.
        history: The law in a motion from instants on [s].
    """

    over_time: MotionLaw
    profile: Profile | None = None
    along: MeasuredCoordinate | None = None
    gates: tuple[Gate, ...] = ()
    function: Callable[[Array], Values] | None = None
    stretch: tuple[float, float] | None = None
    history: list[tuple[float, LoadLaw]] = field(default_factory=list)

    @property
    def over_time_alone(self) -> bool:
        return not (self.profile or self.gates)

    def __call__(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the size at instants in states, of the shape of t or (...)."""
        if self.function is None:
            raise ValueError("a law is evaluated on an interval of time: take the element's on(start, end)")
        value = np.asarray(self.function(np.asarray(t, float))[0])
        return value if self.over_time_alone else value * self._factor(q, v)

    def _factor(self, q: Array, v: Array) -> Array:
        """Return f in states, 0 where the load does not act, shape (...)."""
        factor = np.ones(q.shape[:-1])
        if self.profile and self.along:
            w, rate, _ = self.along.moving(q, v)
            side = np.sign(np.real(rate)) if self.stretch is None else 0.0
            factor = continued(lambda x: self._values(x, side), w)
        for gate in self.gates:
            factor = np.where(gate.acts(q, v), factor, 0.0)
        return factor

    def _values(self, w: Array, side: Array | float) -> tuple[Array, Array]:
        assert self.profile
        return self.profile(w, side, self.stretch or (-math.inf, math.inf))[:2]

    @property
    def leaps(self) -> bool:
        """Whether the load may jump at edges: a motion takes it from one to the next as it is after the first."""
        return bool(self.gates or (self.profile and self.profile.leaps))

    @property
    def of_joints(self) -> bool:
        """Whether all that it depends on are coordinates of single joints."""
        along = [*([self.along] if self.along else []), *(gate.along for gate in self.gates)]
        return all(getattr(measured.coordinate, "joint", None) is not None for measured in along)

    def entered(self, q: Array, v: Array) -> LoadLaw:
        """Return the law from a state, shapes (nq,) and (nv,), to the next edge, and smooth beyond it."""
        gates = tuple(replace(gate, is_open=bool(gate.acts(q, v))) for gate in self.gates)
        if not (self.profile and self.along):
            return replace(self, gates=gates)
        w, rate, _ = self.along.moving(q, v)
        return replace(self, gates=gates, stretch=self.profile.stretch(float(w), float(np.sign(rate))))

    def on(self, start: float, end: float) -> LoadLaw:
        """Return the law as it is on an interval without jumps: in a motion that is over, as it was there."""
        place = bisect_right(self.history, 0.5 * (start + end), key=lambda change: change[0])
        here = self.history[max(place - 1, 0)][1] if self.history else self
        return replace(here, function=self.over_time.on(start, end))

    def edges(self) -> list[Edge]:
        edges = [gate.edge for gate in self.gates]
        if not (self.profile and self.along and self.profile.leaps):
            return edges
        if self.stretch is None:
            return [*edges, edge_along(self.along, lambda w, rate: self._margins(w))]
        below, above = self.stretch
        ends = [(1.0, below), (-1.0, above)]
        for side, place in ends:
            if math.isfinite(place):
                edges.append(edge_along(self.along, partial(_way_to, side, place), direction=-1))
        return edges

    def _margins(self, w: Array) -> Array:
        """Return the distances of values of w, shape (n,), from the next jump of f."""
        assert self.profile
        return np.array([np.abs(np.subtract(self.profile.stretch(x), x)).min() for x in w.tolist()])

    def passed(self, q: Array) -> bool:
        return bool(self.along and self._pieces.passed(self.along.values(q)))

    @cached_property
    def _pieces(self) -> Pieces:
        assert self.profile
        return Pieces(self.profile.marks, self.profile.period)

    def passages(self, laws: Mapping[int, MotionLaw], start: float, end: float, *, knots: bool = False) -> list[float]:
        """Return when joints that follow laws, by their index in v, pass jumps of f, or knots, and turn back [s]."""
        turning = [law for gate in self.gates if (law := _law_of(gate.along, laws))]
        turns = [t for law in turning for t in reversals(law, start, end)]
        law = _law_of(self.along, laws)
        if not (self.profile and law):
            return turns
        return [*self.profile.passed(self.profile.marks if knots else self.profile.leaps, law, start, end), *turns]

    def beyond(self, t: Array, q: Array) -> str:
        """Return a note on instants, shape (n,), or configurations beyond the points of a law; empty without any."""
        said = _outside(self.over_time, t, "s", 0.0)
        if self.profile and self.along and self.profile.period == math.inf:
            measured = str(self.along.coordinate.unit)
            said = _outside(self.profile.law, self.along.values(q), measured, BEYOND) or said
        return said


def _outside(law: MotionLaw, x: Array, measured: str, part: float) -> str:
    """Return a note where values x, shape (n,), are beyond the points of a law by a part of their range."""
    first, last = law.ends
    slack = part * (last - first) if part else 0.0
    if law.may_jump or not len(x) or (x.min() >= first - slack and x.max() <= last + slack):
        return ""
    return (
        f"its points go from {first:.6g} to {last:.6g} {measured}, "
        f"and it is used from {x.min():.6g} to {x.max():.6g} {measured}"
    )


def _way_to(side: float, place: float, w: Array, rate: Array) -> Array:
    return side * (w - place)


def _law_of(along: MeasuredCoordinate | None, laws: Mapping[int, MotionLaw]) -> MotionLaw | None:
    """Return the law that the joint follows whose coordinate is measured; ``None`` of other coordinates."""
    coordinate = along.coordinate if along else None
    joint = coordinate.joint if isinstance(coordinate, LinearCoordinate) else None
    return None if joint is None else laws.get(joint)


class LoadKeys(InputStruct, frozen=True, kw_only=True, rename={"while_": "while", "start": "from", "end": "until"}):
    """The keys that loads with a law share.

    Attributes:
        over: Joint or other coordinate that takes the place of time in the law, such as ``crank``; over time where it
            is left out.
        period: After which a law over a coordinate repeats, such as ``720 deg``: what it says from 0 to there holds
            for every turn.
        while_: Coordinate -> ``increasing`` or ``decreasing``, ``while`` in files: the load acts only while it moves
            that way, such as ``{x: decreasing}``.
        start: Instant from which on the load acts, ``from`` in files, such as ``0.5 s``.
        end: Instant until which it acts, ``until`` in files, such as ``1.5 s``.
    """

    over: str | None = None
    period: Extent | None = None
    while_: dict[str, Literal["increasing", "decreasing"]] = {}
    start: Time | None = None
    end: Time | None = None

    def check(self) -> None:
        if self.period is not None and self.over is None:
            with within("period"):
                raise InputError("a law over time has no period", expected="over: the joint whose turns are meant")
        if self.start is not None and self.end is not None and not self.start < self.end:
            with within("until"):
                raise InputError(f"{self.end:g} s is not after {self.start:g} s", expected="an instant after from")

    def load_law(self, key: str, measured: Unit, model: pin.Model, coordinates: Mapping[str, Coordinate]) -> LoadLaw:
        """Return the law of a load that a key holds, of a given unit."""
        law: MotionLaw = getattr(self, key)
        gates = tuple(
            Gate(_measured(model, coordinates, name, "while", Key(name)), SENSES[way])
            for name, way in self.while_.items()
        )
        if self.over is None:
            with within(key):
                law.check_units(measured)
            return LoadLaw(self._limited(law), gates=gates)
        along = _measured(model, coordinates, self.over, "over")
        with within(key):
            law.check_units(measured, along.coordinate.unit)
        with within("period"):
            check_unit(self.period or 0.0, along.coordinate.unit)
            profile = Profile.of(law, self.period)
            profile.check_repeated(load=True)
        return LoadLaw(self._limited(Constant(value=1.0)), profile, along, gates)

    def _limited(self, law: MotionLaw) -> MotionLaw:
        """Return a law over time that is 0 before ``from`` and after ``until``."""
        if self.start is None and self.end is None:
            return law
        low, high = -math.inf if self.start is None else self.start, math.inf if self.end is None else self.end
        inside = [piece.between(low, high) for piece in law.smooth_pieces if piece.end > low and piece.start < high]
        nothing = polynomial(0.0, 0.0)
        before = [Piece(-math.inf, low, nothing)] if low > -math.inf else []
        after = [Piece(high, math.inf, nothing)] if high < math.inf else []
        return Driven(parts=(*before, *inside, *after))


def _measured(model: pin.Model, coordinates: Mapping[str, Coordinate], name: str, *path: str) -> MeasuredCoordinate:
    with within(*path):
        return MeasuredCoordinate(model, coordinate_of(model, coordinates, name))
