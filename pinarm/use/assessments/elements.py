"""Machine elements under the loads of a run: rolling bearings, plain bearings, rigid rotors.

Of a rolling bearing, with n the rate at which it turns and P the equivalent load of an instant (ISO 281:2007, 6 and 7):

    P = X F_r + Y |F_a|,   P_m = (∫ P^p |n| dt / ∫ |n| dt)^(1/p),   L10 = (C / P_m)^p million turns.

p = 3 gives the cubic mean load. Turns are counted in both directions, and the life in time is that of L10 turns at the
mean rate. Of a plain bearing, with F_r the radial load, d the diameter and l the length:

    pressure = F_r / (d l),   speed = ((n d/2)² + s'²)^(1/2),   and their product, at each instant.

n [rad/s] is its turning, s' [m/s] its sliding along the axis. Of a rotor (ISO 21940-11:2016), with u the axis, x the
place of a particle from the origin of its joint, and x' its part at right angles to u:

    U = ∫ x' dm = m e,    D = ∫ x' (x . u) dm

The residual unbalance U has the balance quality ``e omega``. In two planes at z_1 and z_2 along the axis the rotor is
unbalanced like the two masses with ``U_1 + U_2 = U`` and ``z_1 U_1 + z_2 U_2 = D``. Each plane is permitted a share of
``m e omega``: that of the static load that it would carry of the centre of mass (section 7).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, ClassVar, Literal

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.family import NEWTON
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.quantities.reactions import loop_axis, tree_axis
from pinarm.engine.series import Series
from pinarm.errors import InputError, choices, within
from pinarm.input.units import DIMENSIONLESS, Unit, unit
from pinarm.input.yaml.schema import Coefficient, InputStruct, Lead, LoadRating, ServiceSpeed, Span
from pinarm.mechanics.joints import METRE, RADIAN, moved_links
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, replace
from pinarm.use.result.curve_figures import CurveFigure, integrals
from pinarm.use.result.row_lookup import PLATEAU, Lookup


class LoadNumber(CurveFigure, frozen=True):
    """A number, where it stands in the run, and what its quadrature, or the search for its peak, leaves of it.

    Attributes:
        at: The instant, or another parameter of the run; ``None`` for numbers of the whole run.
        direction: Unit vector of the load at its peak, in axes that ``axes`` names; empty where it has none.
        axes: The link.
    """

    at: float | None = None
    direction: str = ""
    axes: str = ""


NOTHING = 1e-9
"""Of the largest force or moment of any joint: below that a component is rounding, and has no worst instant."""

CONSTANT = 1e-9
"""Relative change below which a curve is constant but for rounding, and its peak is at the start."""


def worst_row(run: Lookup, size: Callable[[Quantities], Array], least: float = 0.0) -> tuple[Quantities, float, float]:
    """Return the row of a run at which a size is largest, the first one where it is constant; the size, and its error.

    Args:
        run: The run.
        size: Quantities of n rows -> values that are not negative, shape (n,).
        least: Up to which size it is rounding.
    """
    start = run.at("start", run.run.parameter)
    first = float(size(start)[0])
    worst, error = run.highest(size, "the load", least if float(size(run.quantities).max()) <= least else 0.0)
    largest = float(size(worst)[0])
    if largest <= max(least, (1.0 + CONSTANT) * first):
        return start, first, error + max(largest - first, 0.0)
    return worst, largest, error


def peak(run: Lookup, measured: Unit, size: Callable[[Quantities], Array], least: float = 0.0) -> LoadNumber:
    """Return the largest of a size, see ``worst_row``, and where it is."""
    row, largest, error = worst_row(run, size, least)
    return LoadNumber(largest, error, measured, at=float(row.trajectory.grid.t[0]))


def rounding(run: Lookup, name: str, series: Series) -> float:
    """Return up to which size a component is rounding [N or N*m]: of the largest of any joint, and of its own terms."""
    part = slice(0, 3) if name.startswith("force") else slice(3, 6)
    largest = float(np.linalg.norm(run.quantities.reactions.joints[..., part], axis=-1).max())
    return max(NOTHING * largest, PLATEAU * float(np.max(series.terms)))


UNALIGNED = ("point_on_line", "point_on_plane")
"""Kinds of loop joints whose axis is held in the first link alone."""


class LoadedJoint(Record, frozen=True):
    """A joint whose loads are asked.

    Attributes:
        name: As the file has it.
        prefix: Of the names of its quantities, such as ``loop.B``.
        body: The link on which the loads act, in whose axes they are told.
        rings: Links in whose axes the joint's axis stays, as in those of a bearing's rings: name, empty for the world,
            and the axis there, shape (3,). Empty where the joint has no axis.
        turning: The coordinate that turns about it [rad]; empty where there is none.
        sliding: The coordinate that slides along it [m]; empty where there is none.
        open: Whether motions are left in it that no coordinate tells.
    """

    name: str
    prefix: str
    body: str
    rings: tuple[tuple[str, Array], ...] = ()
    turning: str = ""
    sliding: str = ""
    open: bool = False

    @property
    def axis(self) -> bool:
        return bool(self.rings)

    @classmethod
    def of(cls, mechanism: Mechanism, name: str, coordinate: str | None = None) -> LoadedJoint:
        """Return a joint by its name, with or without ``joint.`` or ``loop.`` before it.

        Args:
            mechanism: The mechanism.
            name: Its name.
            coordinate: What turns in it, where it has no such coordinate of its own.
        """
        known = dict(_known(mechanism, name))
        meant = [full for full in known if name in (full, full.partition(".")[2])]
        if len(meant) != 1:
            expected, hint = choices(name, [full.partition(".")[2] for full in known])
            message = f"'{name}' is a joint of the tree and a loop joint" if meant else f"there is no joint '{name}'"
            raise InputError(message, expected=" or ".join(meant) or expected, hint="" if meant else hint)
        joint = known[meant[0]]
        if coordinate is None:
            return joint
        with within("coordinate"):
            angle = mechanism.coordinates.get(coordinate)
            if angle is None or angle.unit != RADIAN:
                expected, hint = choices(coordinate, [k for k, x in mechanism.coordinates.items() if x.unit == RADIAN])
                raise InputError(f"there is no coordinate '{coordinate}' that turns", expected=expected, hint=hint)
        return replace(joint, turning=coordinate, open=False)

    def check(self, *, bearing: bool, bushing: bool) -> None:
        """Check that it has what is asked of it: an axis, and a coordinate that turns about it."""
        for key in [key for key, asked in (("bearing", bearing), ("bushing", bushing)) if asked]:
            with within(key):
                if not self.axis or (not self.turning and (self.open or key == "bearing")):
                    raise InputError(
                        f"no coordinate turns about an axis of the joint '{self.name}'",
                        expected="a joint that turns, or coordinate: the name of the coordinate that turns in it",
                    )

    def rates(self, rows: Quantities) -> tuple[Array, Array]:
        """Return the rates of turning [rad/s] and sliding [m/s], each of shape (n,); 0 without a coordinate."""
        turning, sliding = (
            rows[f"coordinate.{name}.velocity"].values if name else np.zeros(len(rows.trajectory))
            for name in (self.turning, self.sliding)
        )
        return turning, sliding


def _known(mechanism: Mechanism, name: str) -> Iterator[tuple[str, LoadedJoint]]:
    """Yield all joints with their full names, ``joint.J`` or ``loop.L``; ``name`` is as the file has it."""
    model = mechanism.model
    for joint in mechanism.joints.values():
        moved = ("", joint.name) if joint.unit == METRE else (joint.name, "")
        link, rings = moved_links(model, joint.index)[0], _rings(model, joint.index)
        yield f"joint.{joint.name}", LoadedJoint(name, f"joint.{joint.name}", link, rings, *moved)
    for ball in mechanism.balls.values():
        link = moved_links(model, ball.index)[0]
        yield f"joint.{ball.name}", LoadedJoint(name, f"joint.{ball.name}", link)
    for loop in mechanism.constraints:
        if isinstance(loop, LoopJoint):
            own = [f"{loop.name}.{part}" for part in ("angle", "position")]
            turning, sliding = (name_of_part if name_of_part in mechanism.coordinates else "" for name_of_part in own)
            links, axis = [model.frames[frame].name for frame in (loop.second, loop.first)], loop_axis(loop)
            held = links[1:] if loop.kind in UNALIGNED else links
            rings = () if axis is None else tuple((link, axis) for link in held)
            freely = "point_on" in loop.kind
            yield f"loop.{loop.name}", LoadedJoint(name, f"loop.{loop.name}", links[0], rings, turning, sliding, freely)


def _rings(model: pin.Model, joint: int) -> tuple[tuple[str, Array], ...]:
    """Return child and parent of a joint of the tree, each with the joint's axis in its axes."""
    if (axis := tree_axis(model, joint)) is None:
        return ()
    child, parent = moved_links(model, joint)[0], int(model.parents[joint])
    carrier, outwards = moved_links(model, parent)[0] if parent else "", model.jointPlacements[joint].rotation @ axis
    inner, outer = (
        model.frames[model.getBodyId(link)].placement.rotation if link else np.eye(3) for link in (child, carrier)
    )
    return (child, inner.T @ axis), (carrier, outer.T @ outwards)


SECOND, SPIN, SPEED = unit("s"), unit("rad/s"), unit("m/s")
PASCAL, INTENSITY = unit("Pa"), unit("Pa*m/s")
UNBALANCE = unit("kg*m")
MILLION, HOUR, RPM, MILLIMETRE = 1e6, 3600.0, 2.0 * np.pi / 60.0, 1e-3

UNSEEN = 1e-3
"""Axial load, relative to the radial one, that needs no word."""

GRADES = (0.4, 1.0, 2.5, 6.3, 16.0, 40.0, 100.0, 250.0, 630.0, 1600.0, 4000.0)
"""Of balance quality: largest e omega of each [mm/s] (table 1)."""

LEAST_SHARE = 0.3
"""Of the permitted unbalance that a plane has, however far from the centre of mass it is."""

ROUNDING = 1e-9
"""By which a quality may be above its grade: the digits of a rotor that was balanced to it."""

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
        "load.peak": NEWTON, "rate.peak": SPIN, "load.mean": NEWTON, "rate.mean": SPIN, "life.turns": DIMENSIONLESS,
        "life.time": SECOND,
    }  # fmt: skip

    def carried(self, rows: Quantities, joint: LoadedJoint) -> dict[str, Array]:
        """Return the components of which P is made, shape (n,) each; others need not be determined."""
        factors = {"force.radial": self.X, "force.axial": self.Y}
        names = [name for name, factor in factors.items() if factor or self.e is not None]
        return {name: np.abs(rows.determined(f"{joint.prefix}.{name}").values) for name in names}

    def equivalent(self, rows: Quantities, joint: LoadedJoint) -> Array:
        """Return P [N], shape (n,)."""
        parts, nothing = self.carried(rows, joint), np.zeros(len(rows.trajectory))
        radial, axial = parts.get("force.radial", nothing), parts.get("force.axial", nothing)
        combined = self.X * radial + self.Y * axial
        return combined if self.e is None else np.where(axial <= self.e * radial, radial, combined)

    def numbers(self, run: Lookup, joint: LoadedJoint) -> Found:
        """Return peaks and means of load and rate, and the rating life."""
        exponent = 10.0 / 3.0 if self.p == "10/3" else float(self.p)
        names = [f"{joint.prefix}.{name}" for name in self.carried(run.quantities, joint)]
        least = max(rounding(run, name.removeprefix(f"{joint.prefix}."), run.quantities[name]) for name in names)
        load = peak(run, NEWTON, lambda rows: self.equivalent(rows, joint), least)
        fastest = peak(run, SPIN, lambda rows: np.abs(joint.rates(rows)[0]))
        loaded = load.value > least * max(self.X, self.Y)
        if not loaded or not fastest.value:
            lacking = "does not turn" if loaded else "carries no load"
            raise InputError(
                f"the bearing {lacking} in this run: it has no rating life", expected="a motion under load"
            )

        def integrands(rows: Quantities) -> Array:
            turning = np.abs(joint.rates(rows)[0]) / fastest.value
            return np.stack([(self.equivalent(rows, joint) / load.value) ** exponent * turning, turning], axis=1)

        (carried, turned), errors = _means(run, integrands)
        of_load, of_rate = errors[0] / carried, errors[1] / turned
        mean, rate = load.value * (carried / turned) ** (1.0 / exponent), fastest.value * turned
        relative, turns = of_load + of_rate, MILLION * (self.C / mean) ** exponent
        life = 2.0 * np.pi * turns / rate
        remark = (
            f"rating life L10 {turns / MILLION:.4g} million turns, {life / HOUR:.4g} h at {rate / RPM:.4g} rpm "
            f"(mean equivalent load {mean:.4g} N, turns counted in both directions)"
        )
        return {
            "load.peak": load,
            "rate.peak": fastest,
            "load.mean": LoadNumber(mean, mean * relative / exponent, NEWTON),
            "rate.mean": LoadNumber(rate, rate * of_rate, SPIN),
            "life.turns": LoadNumber(turns, turns * relative, DIMENSIONLESS),
            "life.time": LoadNumber(life, life * (relative + of_rate), SECOND),
        }, [remark]


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
        "pressure.peak": PASCAL, "speed.peak": SPEED, "pv.peak": INTENSITY, "pv.mean": INTENSITY, "speed.mean": SPEED,
    }  # fmt: skip

    def numbers(self, run: Lookup, joint: LoadedJoint) -> Found:
        """Return peaks of pressure, speed and their product, and the means of the last two."""

        def pressure(rows: Quantities) -> Array:
            return np.asarray(rows.determined(f"{joint.prefix}.force.radial").values / (self.diameter * self.length))

        def speed(rows: Quantities) -> Array:
            turning, sliding = joint.rates(rows)
            return np.asarray(np.hypot(0.5 * self.diameter * turning, sliding))

        def product(rows: Quantities) -> Array:
            return pressure(rows) * speed(rows)

        of_curves = {"pressure": pressure, "speed": speed, "pv": product}
        numbers = {f"{name}.peak": peak(run, self.units[f"{name}.peak"], of) for name, of in of_curves.items()}
        sizes = [numbers["pv.peak"].value or 1.0, numbers["speed.peak"].value or 1.0]
        means, errors = _means(run, lambda rows: np.stack([product(rows), speed(rows)], axis=1) / sizes)
        for name, size, mean, error in zip(("pv", "speed"), sizes, means, errors, strict=True):
            numbers[f"{name}.mean"] = LoadNumber(size * mean, size * error, self.units[f"{name}.mean"])
        return numbers, []


def _means(run: Lookup, integrands: Callable[[Quantities], Array]) -> tuple[list[float], list[float]]:
    """Return means over the time of functions of rows, relative to their largest sizes, shape (n, k); their errors."""
    length = float(run.run.grid.cuts[-1] - run.run.grid.cuts[0])
    total, error = integrals(run, integrands)
    return (total / length).tolist(), (error / length).tolist()


def bearing_numbers(run: Lookup, joint: LoadedJoint, bearing: RollingBearing | PlainBearing) -> Found:
    """Return the numbers of a bearing, and what is to be said of them: its life, loads that are in none of them."""
    with within("joints", joint.name, bearing.key):
        if run.motion is None or run.run.parameter != "t":
            raise InputError(
                "lives and speeds of bearings are those of a motion over time", hint="kind: inverse or forward"
            )
        numbers, remarks = bearing.numbers(run, joint)
    if not (isinstance(bearing, RollingBearing) and (bearing.Y or bearing.e is not None)):
        known, axial, radial = True, 0.0, 0.0
        try:
            parts = (run.quantities.determined(f"{joint.prefix}.force.{part}").values for part in ("axial", "radial"))
            axial, radial = (float(np.abs(part).max()) for part in parts)
        except InputError:
            known = False
        if not known:
            remarks.append(f"the axial load is not determined, and in no number of its {bearing.key}")
        elif axial > UNSEEN * radial:
            remarks.append(f"the axial load of up to {axial:.4g} N is in no number of its {bearing.key}")
    named = {f"{joint.name}.{name}": number for name, number in numbers.items()}
    return named, [f"{joint.name}: {text}" for text in remarks]


class Rotor(InputStruct, frozen=True):
    """A rigid rotor: the body that a revolute joint moves.

    Attributes:
        speed: At which it works, such as ``3000 rpm``; the largest of the run where it is left out.
        planes: Places of two tolerance planes along the joint's axis, from its origin, on both sides of the centre of
            mass, such as ``[-50 mm, 50 mm]``; only the static unbalance is graded where they are left out.
    """

    speed: ServiceSpeed | None = None
    planes: tuple[Lead, Lead] | None = None

    def check(self) -> None:
        if self.planes and self.planes[0] == self.planes[1]:
            raise InputError("both planes are at the same place", expected="two planes")

    @property
    def units(self) -> Mapping[str, Unit]:
        inner = {f"unbalance.{k}": UNBALANCE for k in (1, 2)} if self.planes else {}
        return {"unbalance": UNBALANCE, "eccentricity": METRE, "quality": SPEED, **inner}

    @staticmethod
    def check_joint(mechanism: Mechanism, name: str) -> None:
        """Check that a joint moves a rigid rotor."""
        joint = mechanism.joints.get(name)
        if joint is None or joint.unit != RADIAN:
            expected, hint = choices(name, [k for k, moved in mechanism.joints.items() if moved.unit == RADIAN])
            raise InputError(f"there is no revolute joint '{name}'", expected=expected, hint=hint)
        beyond = [mechanism.model.names[k] for k in mechanism.model.subtrees[joint.index] if k != joint.index]
        if beyond:
            raise InputError(
                f"{', '.join(beyond)} move beyond '{name}': it is no rigid rotor",
                expected="a joint that moves a single body",
            )
        if not mechanism.model.inertias[joint.index].mass > 0.0:
            raise InputError(f"'{name}' moves no mass", expected="a joint that moves a body with mass")

    def balance(self, run: Lookup, name: str) -> Found:
        """Return unbalance and balance quality of the rotor of a joint, and its grade in words."""
        with within("rotors", name):
            omega, spread = (float(self.speed), 0.0) if self.speed else _fastest(run, f"joint.{name}.velocity")
            if not omega:
                raise InputError(f"'{name}' does not turn in this run", expected="speed: that at which it works")
            mass, centre, static, couple = _unbalance(run.run.mechanism, name)
            unbalance = float(np.linalg.norm(static))
            eccentricity, inner = unbalance / mass, dict[str, LoadNumber]()
            if self.planes:
                (first, second), share = self.planes, _share(centre, *self.planes)
                other = (couple - first * static) / (second - first)  # U_2
                for k, (part, of) in enumerate(((static - other, share), (other, 1.0 - share)), start=1):
                    inner[f"{name}.unbalance.{k}"] = LoadNumber(float(np.linalg.norm(part)), 0.0, UNBALANCE)
                    eccentricity = max(eccentricity, float(np.linalg.norm(part)) / (mass * of))
        quality, planes = eccentricity * omega, "in both planes" if self.planes else "static unbalance only"
        size = quality / MILLIMETRE
        remark = f"{name}: e omega = {size:.4g} mm/s at {omega / RPM:.5g} rpm, {planes}: {grade(quality)}"
        return {
            f"{name}.unbalance": LoadNumber(unbalance, 0.0, UNBALANCE),
            f"{name}.eccentricity": LoadNumber(unbalance / mass, 0.0, METRE),
            **inner,
            f"{name}.quality": LoadNumber(quality, eccentricity * spread, SPEED),
        }, [remark]


def grade(quality: float) -> str:
    """Return the finest grade that a balance quality e omega [m/s] meets, in words."""
    met = next((limit for limit in GRADES if quality <= limit * MILLIMETRE * (1.0 + ROUNDING)), None)
    return f"G {met:g} of ISO 21940-11" if met else f"beyond G {GRADES[-1]:g}, the coarsest grade of ISO 21940-11"


def _unbalance(mechanism: Mechanism, name: str) -> tuple[float, float, Array, Array]:
    """Return mass [kg], place of its centre along the axis [m], U [kg*m] and D [kg*m²], each of shape (3,)."""
    index = mechanism.joints[name].index
    inertia, axis = mechanism.model.inertias[index], tree_axis(mechanism.model, index)
    assert axis is not None
    across, about = np.eye(3) - np.outer(axis, axis), inertia.matrix()[3:, 3:]
    second = 0.5 * np.trace(about) * np.eye(3) - about  # ∫ x x^T dm
    centre = inertia.lever
    return float(inertia.mass), float(centre @ axis), inertia.mass * (across @ centre), across @ second @ axis


def _fastest(run: Lookup, rate: str) -> tuple[float, float]:
    value, error = run.value("largest", rate, rate)
    return abs(value), error


def _share(centre: float, first: float, second: float) -> float:
    """Return the share of the permitted unbalance of the first of two planes at places [m].

    By the lever rule, ``L_2 / L`` with L_k the distance of the centre of mass to plane k, but no less than 0.3 and no
    more than 0.7: ISO 21940-11:2016, section 7, on rotors whose centre of mass is between the planes.
    """
    share = (second - centre) / (second - first)
    if not 0.0 < share < 1.0:
        with within("planes"):
            raise InputError(
                f"the centre of mass at {centre:.4g} m is not between the planes", expected="a plane on each side of it"
            )
    return min(max(share, LEAST_SHARE), 1.0 - LEAST_SHARE)
