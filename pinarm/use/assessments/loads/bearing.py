"""Rolling bearings and plain bearings under the loads of a run.

Of a rolling bearing, with n the rate at which it turns and P the equivalent load of an instant (ISO 281:2007, 6 and 7):

    P = X F_r + Y |F_a|,   P_m = (∫ P^p |n| dt / ∫ |n| dt)^(1/p),   L10 = (C / P_m)^p million turns.

p = 3 gives the cubic mean load. Turns are counted in both directions, and the life in time is that of L10 turns at the
mean rate. Of a plain bearing, with F_r the radial load, d the diameter and l the length:

    pressure = F_r / (d l),   speed = ((n d/2)² + s'²)^(1/2),   and their product, at each instant.

n [rad/s] is its turning, s' [m/s] its sliding along the axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.family import NEWTON
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, within
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.input.yaml.schema import Coefficient, InputStruct, LoadRating, Span
from pinarm.use.assessments.loads.joint import LoadedJoint, LoadNumber, peak, rounding
from pinarm.use.result.curve_figures import integrals
from pinarm.use.result.row_lookup import Lookup

SECOND, SPIN, SPEED = unit("s"), unit("rad/s"), unit("m/s")
PASCAL, INTENSITY = unit("Pa"), unit("Pa*m/s")
MILLION, HOUR, RPM = 1e6, 3600.0, 2.0 * np.pi / 60.0

Worst = Mapping[str, LoadNumber]
"""Peaks by name."""
Found = tuple[dict[str, LoadNumber], list[str]]
"""Numbers by name, and what is to be said of them."""


class RollingBearing(InputStruct, frozen=True):
    """A rolling bearing, by the data of its catalogue (ISO 281).

    Attributes:
        C: Basic dynamic load rating.
        p: Exponent of the life: 3 for balls, 10/3 for rollers.
        X: Radial factor.
        Y: Axial factor.
        e: Up to this size of F_a / F_r, P = F_r; X and Y hold everywhere where it is left out.
    """

    C: LoadRating
    p: Annotated[float, msgspec.Meta(ge=1.0, le=10.0)] | Literal["10/3"] = 3.0
    X: Coefficient = 1.0
    Y: Coefficient = 0.0
    e: Coefficient | None = None

    def check(self) -> None:
        if not self.X and not self.Y:
            raise InputError("X and Y are both 0: no load is left", expected="the factors of the bearing's catalogue")

    key: ClassVar[str] = "bearing"
    units: ClassVar[Mapping[str, Unit]] = {
        "load.peak": NEWTON,
        "rate.peak": SPIN,
        "load.mean": NEWTON,
        "rate.mean": SPIN,
        "life.turns": DIMENSIONLESS,
        "life.time": SECOND,
    }

    @property
    def exponent(self) -> float:
        return 10.0 / 3.0 if self.p == "10/3" else float(self.p)

    @property
    def carried(self) -> list[str]:
        """The components that P is made of; others need not be determined."""
        factors = {"force.radial": self.X, "force.axial": self.Y}
        return [name for name, factor in factors.items() if factor or self.e is not None]

    def equivalent(self, rows: Quantities, joint: LoadedJoint) -> Array:
        """Return P [N], shape (n,)."""
        nothing = np.zeros(len(rows.trajectory))
        radial, axial = (
            np.abs(rows.determined(f"{joint.prefix}.{name}").values) if name in self.carried else nothing
            for name in ("force.radial", "force.axial")
        )
        combined = self.X * radial + self.Y * axial
        return combined if self.e is None else np.where(axial <= self.e * radial, radial, combined)

    def worst(self, run: Lookup, joint: LoadedJoint) -> Worst:
        """Return the largest P [N] and rate [rad/s]."""
        parts = {name: run.quantities.determined(f"{joint.prefix}.{name}") for name in self.carried}
        least = max(rounding(run, name, part) for name, part in parts.items())
        load = peak(run, NEWTON, lambda rows: self.equivalent(rows, joint), least)
        loaded = load.value > least * max(self.X, self.Y)
        fastest = peak(run, SPIN, lambda rows: np.abs(joint.rates(rows)[0]))
        if not loaded or not fastest.value:
            lacking = "does not turn" if loaded else "carries no load"
            raise InputError(
                f"the bearing {lacking} in this run: it has no rating life", expected="a motion under load"
            )
        return {"load.peak": load, "rate.peak": fastest}

    def integrands(self, rows: Quantities, joint: LoadedJoint, worst: Worst) -> Array:
        """Return ``P^p |n|`` and ``|n|``, relative to their largest sizes, shape (n, 2)."""
        rate = np.abs(joint.rates(rows)[0]) / worst["rate.peak"].value
        load = self.equivalent(rows, joint) / worst["load.peak"].value
        return np.stack([load**self.exponent * rate, rate], axis=1)

    def evaluated(self, worst: Worst, means: Array, errors: Array) -> Found:
        """Return mean load, mean rate and rating life, from the means of the integrands and their errors."""
        (loaded, turned), (of_load, of_rate) = means.tolist(), (errors / means).tolist()
        mean = worst["load.peak"].value * (loaded / turned) ** (1.0 / self.exponent)
        rate, relative = worst["rate.peak"].value * turned, of_load + of_rate
        turns = MILLION * (self.C / mean) ** self.exponent
        life = 2.0 * np.pi * turns / rate
        numbers = {
            "load.mean": LoadNumber(mean, NEWTON, error=mean * relative / self.exponent),
            "rate.mean": LoadNumber(rate, SPIN, error=rate * of_rate),
            "life.turns": LoadNumber.pure(turns, turns * relative),
            "life.time": LoadNumber(life, SECOND, error=life * (relative + of_rate)),
        }
        return {**worst, **numbers}, [
            f"rating life L10 {turns / MILLION:.4g} million turns, {life / HOUR:.4g} h at {rate / RPM:.4g} rpm "
            f"(mean equivalent load {mean:.4g} N, turns counted in both directions)"
        ]


class PlainBearing(InputStruct, frozen=True):
    """A plain bearing: a bush on a pin.

    Attributes:
        diameter: Of the pin.
        length: Of the bush that carries.
    """

    diameter: Span
    length: Span

    key: ClassVar[str] = "bushing"
    units: ClassVar[Mapping[str, Unit]] = {
        "pressure.peak": PASCAL,
        "speed.peak": SPEED,
        "pv.peak": INTENSITY,
        "pv.mean": INTENSITY,
        "speed.mean": SPEED,
    }

    def pressure(self, rows: Quantities, joint: LoadedJoint) -> Array:
        """Return the mean pressure on the projected area [Pa], shape (n,)."""
        return np.asarray(rows.determined(f"{joint.prefix}.force.radial").values / (self.diameter * self.length))

    def speed(self, rows: Quantities, joint: LoadedJoint) -> Array:
        """Return the speed of the surfaces against each other [m/s], shape (n,)."""
        turning, sliding = joint.rates(rows)
        return np.asarray(np.hypot(0.5 * self.diameter * turning, sliding))

    def worst(self, run: Lookup, joint: LoadedJoint) -> Worst:
        """Return the largest pressure and speed, and the largest product of both."""
        return {
            "pressure.peak": peak(run, PASCAL, lambda rows: self.pressure(rows, joint)),
            "speed.peak": peak(run, SPEED, lambda rows: self.speed(rows, joint)),
            "pv.peak": peak(run, INTENSITY, lambda rows: self.pressure(rows, joint) * self.speed(rows, joint)),
        }

    def integrands(self, rows: Quantities, joint: LoadedJoint, worst: Worst) -> Array:
        """Return pressure times speed and speed, relative to their largest sizes, shape (n, 2)."""
        pressure, speed = self.pressure(rows, joint), self.speed(rows, joint)
        most, fastest = (worst[name].value or 1.0 for name in ("pv.peak", "speed.peak"))
        return np.stack([pressure * speed / most, speed / fastest], axis=1)

    def evaluated(self, worst: Worst, means: Array, errors: Array) -> Found:
        """Return the means over the time of pressure times speed, and of the speed; see ``RollingBearing``."""
        scaled = zip(("pv", "speed"), (INTENSITY, SPEED), means.tolist(), errors.tolist(), strict=True)
        numbers = dict(worst)
        for name, measured, mean, error in scaled:
            size = worst[f"{name}.peak"].value
            numbers[f"{name}.mean"] = LoadNumber(size * mean, measured, error=size * error)
        return numbers, []


def lives(run: Lookup, asked: Sequence[tuple[LoadedJoint, RollingBearing | PlainBearing]]) -> Found:
    """Return the numbers of all bearings, and what is to be said of them."""
    numbers, remarks = dict[str, LoadNumber](), list[str]()
    if not asked:
        return numbers, remarks
    if run.motion is None or run.run.parameter != "t":
        raise InputError(
            "lives and speeds of bearings are those of a motion over time", hint="kind: inverse or forward"
        )
    length = float(run.run.grid.cuts[-1] - run.run.grid.cuts[0])
    for joint, bearing in asked:
        with within("joints", joint.name, bearing.key):
            most = bearing.worst(run, joint)
        # each by panels of its own: its numbers are the same whichever others are asked
        total, error = integrals(run, partial(bearing.integrands, joint=joint, worst=most))
        results, said = bearing.evaluated(most, total / length, error / length)
        numbers |= {f"{joint.name}.{name}": number for name, number in results.items()}
        remarks += [f"{joint.name}: {text}" for text in said]
        remarks += _left_out(run, joint, bearing)
    return numbers, remarks


def _left_out(run: Lookup, joint: LoadedJoint, bearing: RollingBearing | PlainBearing) -> list[str]:
    if isinstance(bearing, RollingBearing) and (bearing.Y or bearing.e is not None):
        return []
    try:
        axial, radial = (
            float(np.abs(run.quantities.determined(f"{joint.prefix}.force.{part}").values).max())
            for part in ("axial", "radial")
        )
    except InputError:
        return [f"{joint.name}: the axial load is not determined, and in no number of its {bearing.key}"]
    said = f"{joint.name}: the axial load of up to {axial:.4g} N is in no number of its {bearing.key}"
    return [said] if axial > UNSEEN * radial else []


UNSEEN = 1e-3
"""Axial load, relative to the radial one, that needs no word."""
