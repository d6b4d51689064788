"""Events of a forward motion: values that coordinates reach, and end stops of joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.constraint_rows import ConstraintRows
from pinarm.engine.integration.integrator import Watch
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.segmented.end_stops import Bound
from pinarm.errors import InputError, Key, Place
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, Restitution, check_unit
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.joints import RADIAN, joint_of
from pinarm.records import replace

REACHED = 1e-6
"""Distance of a value to half a turn that is rounding of its digits [rad]."""

DIRECTIONS = {"rising": 1, "falling": -1, "any": 0}


class Event(InputStruct, frozen=True):
    """A coordinate that takes a value.

    Attributes:
        when: The coordinate, or a joint.
        reaches: The value; a motion that begins there reaches it when it comes back.
        direction: Whether it has to rise to the value, fall to it, or either.
        then: ``stop`` ends the run there, ``record`` lists time and state among what was found.
    """

    when: str
    reaches: AnyQuantity
    direction: Literal["rising", "falling", "any"] = "any"
    then: Literal["stop", "record"] = "record"


class EndStop(InputStruct, frozen=True):
    """Limits of a joint's coordinate, met with an impact.

    Attributes:
        lower: Smallest value, such as ``-60 deg``; none where it is left out.
        upper: Largest value, such as ``60 deg``; none where it is left out.
        restitution: Velocity after an impact relative to that before: 0 does not rebound, 1 loses no energy.
    """

    lower: AnyQuantity | None = None
    upper: AnyQuantity | None = None
    restitution: Restitution = 0.0

    def check(self) -> None:
        if self.lower is None and self.upper is None:
            raise InputError("the end stop has no limit", expected="lower, upper, or both")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            raise InputError(
                f"the upper limit {self.upper:g} is not above the lower one {self.lower:g}",
                expected="an upper limit above the lower one",
            )


def watches_of(mechanism: Mechanism, events: Mapping[str, Event], begins: float, place: Place) -> dict[str, Watch]:
    """Return the events as what the integration watches, by name, of a motion that begins at an instant [s]."""
    watches = {}
    for name, event in events.items():
        with place("events", name, "when"):
            coordinate = mechanism.coordinate(event.when)
        with place("events", name, "reaches"):
            check_unit(event.reaches, coordinate.unit)
            if coordinate.wraps and abs(float(event.reaches)) > np.pi + REACHED:
                raise InputError(
                    f"'{event.when}' is told from -180 to 180 deg",
                    expected="a value between these",
                    hint=f"in the mechanism file: turns: [{event.when}], which counts them",
                )
        watch = _watched(mechanism.closure, coordinate, event, begins)
        watches[name] = replace(watch, what=f"event '{name}' takes place", unit=str(coordinate.unit))
    return watches


def _watched(closure: Closure, coordinate: Coordinate, event: Event, begins: float) -> Watch:
    """Return the watch of an event of a coordinate.

    The watch of an angle, which may be limited to -180 to 180 deg, uses the sine of the difference to the value: it
    does not jump there. The zero of the sine half a turn from the value does not count.
    """
    rows, value = ConstraintRows.of(closure.model, [coordinate]), float(event.reaches)

    def distance(t: Array, q: Array, v: Array) -> Array:
        return rows.at(q).gaps[:, 0] - value

    direction, stops = DIRECTIONS[event.direction], event.then == "stop"
    if isinstance(coordinate, LinearCoordinate) or coordinate.unit != RADIAN:
        return Watch(distance, direction, stops, begins=begins, level=abs(value))
    half = abs(abs(value) - np.pi) < REACHED

    def counts(*states: Array) -> Flags:
        apart = np.abs(distance(*states))
        return np.asarray(np.minimum(apart, np.abs(apart - 2.0 * np.pi) if half else apart) < 0.5 * np.pi)

    return Watch(
        lambda *states: np.sin(distance(*states)), direction, stops, counts=counts, begins=begins, level=abs(value)
    )


def bounds_of(mechanism: Mechanism, stops: Mapping[str, EndStop], place: Place) -> tuple[Bound, ...]:
    """Return the end stops, one for each side."""
    bounds, closure = [], mechanism.closure
    sizes = closure.scale.tolist() if closure.size else [1.0] * mechanism.model.nv
    for name, stop in stops.items():
        with place("end_stops", Key(name)):
            joint = joint_of(mechanism.joints, name)
            coordinate = mechanism.coordinate(name)
        for side, sign in (("lower", 1.0), ("upper", -1.0)):
            limit = getattr(stop, side)
            if limit is None or not isinstance(coordinate, LinearCoordinate):
                continue
            with place("end_stops", name, side):
                check_unit(limit, joint.unit)
            bounds.append(
                Bound(f"{name} {side}", coordinate, joint.v, float(limit), sign, stop.restitution, size=sizes[joint.v])
            )
    return tuple(bounds)
