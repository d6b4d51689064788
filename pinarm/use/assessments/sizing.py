"""Sizing of motor and gear: candidates of a catalogue ranked for the cycle of a joint, with reasons of rejection.

A catalogue is a CSV file with a line a motor:


===========================  =====================================================================================
``name``                     of the motor
``stall_torque [N*m]``       continuous torque at standstill
``rated_torque [N*m]``       continuous torque at the rated speed
``rated_speed [rpm]``        up to which the peak torque is available as well
``peak_torque [N*m]``        for a short time
``max_speed [rpm]``          at which the rated torque is available for a short time, and beyond which none is
``rotor_inertia [kg*m^2]``   about the motor's axis
``temperature_rise``         of the winding in continuous duty at the stall torque [K]
``max_temperature``          of the winding [degC]
``time_constant [s]``        of the winding's temperature
``mass [kg]``
===========================  =====================================================================================

Units in brackets may be others of the same dimension; the two temperatures are plain numbers. Other columns are notes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, Location, choices, within
from pinarm.input.csv_tables import measured_columns, table
from pinarm.input.units import DIMENSIONLESS, Unit, decimal, is_whole, unit
from pinarm.input.yaml.schema import Efficiency, InputStruct, Pause, named_file, number
from pinarm.records import Record, replace
from pinarm.use.assessments.duty import Duty, Height, Known, duty_of
from pinarm.use.result.curve_figures import CurveFigure, made_a_motion
from pinarm.use.result.section import Curve, Graph, Section, SectionTable, numbered

if TYPE_CHECKING:
    from pinarm.mechanics.rotors import Drive
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

MOST = 10_000
"""Motors of a catalogue at most."""

SMALLEST, GREATEST = 1e-30, 1e30
"""Of what a catalogue says of a motor, and of ratios: products of their squares stay numbers."""

UNITS = {
    "stall_torque": "N*m", "rated_torque": "N*m", "rated_speed": "rpm", "peak_torque": "N*m", "max_speed": "rpm",
    "rotor_inertia": "kg*m^2", "temperature_rise": "", "max_temperature": "", "time_constant": "s", "mass": "kg",
}  # fmt: skip


class Motor(Record, frozen=True):
    """A motor; torques in N*m, speeds in rad/s, all else in SI; temperatures in K and degC."""

    name: str
    stall_torque: float
    rated_torque: float
    rated_speed: float
    peak_torque: float
    max_speed: float
    rotor_inertia: float
    temperature_rise: float
    max_temperature: float
    time_constant: float
    mass: float

    def continuous_torque(self, speed: float) -> float:
        """Return the torque [N*m] that it gives for ever at a mean speed [rad/s], straight from stall to rated."""
        slope = (self.stall_torque - self.rated_torque) / self.rated_speed
        return max(self.stall_torque - slope * speed, 0.0) if speed <= self.max_speed else 0.0

    def short_torque(self, speed: Array) -> Array:
        """Return the torque [N*m] that it gives for a short time at speeds [rad/s], shape (n,).

        The peak torque up to the rated speed, straight from there to the rated torque at the largest speed, 0 beyond.
        """
        share = np.clip((speed - self.rated_speed) / (self.max_speed - self.rated_speed), 0.0, 1.0)
        torque = self.peak_torque + share * (self.rated_torque - self.peak_torque)
        return np.where(speed <= self.max_speed, torque, 0.0)


def read_catalogue(path: Path) -> list[Motor]:
    """Return the motors of a catalogue."""
    heads, below = table(path, path.name)
    rows = list(below)
    if not 1 <= len(rows) <= MOST:
        raise InputError(f"the catalogue {path.name} has {len(rows)} motors", expected=f"1 to {MOST}")
    columns = measured_columns(path, UNITS, ["name", *UNITS])
    place = [head.strip() for head in heads].index("name")
    motors = dict[str, Motor]()
    for k, (line, row) in enumerate(rows):
        name, where = row[place].strip() if place < len(row) else "", Location(path.name, line)
        if name in motors:
            raise InputError(f"the catalogue has the motor '{name}' twice", expected="names of their own").at(where)
        for key in UNITS:
            size, free = columns[key][k], key == "rotor_inertia"
            if not (SMALLEST <= size <= GREATEST or (free and size == 0.0)):
                expected = f"a size from {SMALLEST:g} to {GREATEST:g}"
                raise InputError(f"{key} is {size:g}", expected=expected).at(where)
        motors[name] = motor = Motor(name, *(columns[key][k] for key in UNITS))
        for low, high in ORDERED:
            if not getattr(motor, low) <= getattr(motor, high) or motor.rated_speed == motor.max_speed:
                expected = f"{low} not above {high}, rated_speed below max_speed"
                raise InputError(f"{low} is beyond {high}", expected=expected).at(where)
    return list(motors.values())


ORDERED = (("rated_torque", "stall_torque"), ("rated_torque", "peak_torque"), ("rated_speed", "max_speed"))
"""Pairs of numbers of a motor of which the second is not below the first."""

Ratio = Annotated[float, msgspec.Meta(ge=SMALLEST, le=GREATEST)]
Safety: Any = number(least=1.0)
TORQUE, SPEED, INERTIA, ENERGY = unit("N*m"), unit("rad/s"), unit("kg*m^2"), unit("J")

COLUMNS = (
    "rank", "motor", "ratio", "verdict", "peak torque", "torque margin", "rms torque", "rms margin", "peak speed",
    "speed margin", "winding", "inertia ratio", "energy", "regenerated",
)  # fmt: skip
NUMBERS = {
    "fitting": DIMENSIONLESS, "ratio": DIMENSIONLESS, "reserve": DIMENSIONLESS, "peak_torque": TORQUE,
    "rms_torque": TORQUE, "peak_speed": SPEED, "energy": ENERGY, "regenerated": ENERGY, "inertia_ratio": DIMENSIONLESS,
}  # fmt: skip
"""Units by name: ``fitting`` counts the candidates that fit, the others are of the first in the ranking."""

UNITS_OF = (None, None, None, None, TORQUE, None, TORQUE, None, SPEED, None, None, None, ENERGY, ENERGY)


MARGINS = {"peak torque": "torque", "rms torque": "rms", "speed": "speed"}
"""Requirement of a motor -> name of its margin."""

RATIOS = 25
"""Ratios that are tried in a range of which nothing else is said."""


class Sizing(InputStruct, frozen=True):
    """A motor and a gear wanted for the drive of a joint.

    The run is one cycle of the joint; its effort and motion are asked of every motor of the catalogue at every ratio,
    with the rotor inertia of that motor in place of the drive's own. A motor fits where, with the safety factor, its
    short-time torque is above the torque at every instant, its continuous torque at the mean speed above the rms
    torque, its largest speed above the peak speed, and its winding below its largest temperature. Motors that fit are
    ranked by mass, then by how little of their reserve is used.

    Attributes:
        drive: A drive of the mechanism, whose joint follows the motion of the run.
        catalogue: A CSV file of motors, such as ``motors.csv``; docs/assessments.md describes its columns.
        ratios: Ratios of the gear to try; ``20:200`` for 25 of them between these two, ``20:200:10`` for 10, each the
            same factor above the one before.
        efficiency: Of the gear, such as ``0.8``; that of the drive where it is left out.
        rest: How long the joint rests between two cycles, held by a brake, the motor without torque.
        ambient: Temperature around the motor [degC], such as ``40 degC``.
        safety: Factor on torques and speeds.
    """

    drive: str
    catalogue: str
    ratios: Annotated[list[Ratio], msgspec.Meta(min_length=1, max_length=1000)] | str
    efficiency: Efficiency | None = None
    rest: Pause = 0.0
    ambient: str = "40 degC"
    safety: Safety = 1.0

    def check(self) -> None:
        with within("ambient"):
            _ = self.ambient_temperature
        with within("catalogue"):
            path = named_file(self.catalogue)
            msgspec.structs.force_setattr(self, "catalogue", str(path))
            read_catalogue(path)
        with within("ratios"):
            _ = self.ratios_tried

    @property
    def ratios_tried(self) -> list[float]:
        """Ratios of the gear to try."""
        if not isinstance(self.ratios, str):
            return self.ratios
        parts = self.ratios.split(":")
        counted = parts[2].strip() if len(parts) == 3 else str(RATIOS)
        try:
            low, high = map(decimal, parts[:2])
        except ValueError:
            low = high = np.nan
        if (
            len(parts) > 3
            or not SMALLEST <= low < high <= GREATEST
            or not is_whole(counted)
            or not 2 <= int(counted) <= 1000
        ):
            raise InputError(f"'{self.ratios}' is no range of ratios", expected="such as 20:200, or 20:200:10")
        return [float(f"{ratio:.6g}") for ratio in np.geomspace(low, high, int(counted))]

    @property
    def ambient_temperature(self) -> float:
        """Temperature around the motor [degC]."""
        number, _, measured = self.ambient.strip().partition(" ")
        try:
            value = float(number)
        except ValueError:
            value = np.nan
        if measured.strip() not in ("degC", "°C") or not -273.15 <= value <= 1000.0:
            raise InputError(f"'{self.ambient}' is no temperature of a room", expected="such as 40 degC")
        return value

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        return NUMBERS

    def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
        drives = quantities.trajectory.mechanism.drives
        if self.drive not in drives:
            expected, hint = choices(self.drive, drives)
            with within("drive"):
                raise InputError(f"there is no drive '{self.drive}'", expected=expected, hint=hint)
        if drives[self.drive].elasticity is not None:
            with within("drive"):
                raise InputError(
                    f"the drive '{self.drive}' is elastic: how its joint moves depends on the rotor",
                    expected="a drive that moves its joint as the rotor turns",
                    hint="size it without elasticity, then run the motor that fits with it",
                )
        _ = quantities[f"drive.{self.drive}.torque"]

    def evaluate(self, result: Result) -> Section:
        """Return all motors at all ratios, ranked: see ``Assessment``."""
        run = result.trajectory
        if result.outcome.motion is None or run.parameter != "t":
            raise InputError(
                "a motor is sized for a motion in time",
                expected="a problem of kind inverse or forward",
                hint=made_a_motion(run),
            )
        self.check_names(result.quantities, result.scenario)
        drive = run.mechanism.drives[self.drive]
        efficiency = drive.efficiency if self.efficiency is None else self.efficiency
        duty = duty_of(result.lookup, drive.coordinate, drive.armature, efficiency, float(self.rest))
        candidates = [
            self._candidate(duty, motor, ratio)
            for motor in read_catalogue(Path(self.catalogue))
            for ratio in self.ratios_tried
        ]
        ranked = sorted(candidates, key=lambda candidate: candidate.order)
        while not ranked[0].refined:
            ranked[0] = _refined(duty, ranked[0])
            ranked.sort(key=lambda candidate: candidate.order)
        return self._section(duty, ranked, drive)

    def _candidate(self, duty: Duty, motor: Motor, ratio: float) -> Candidate:
        inertia = motor.rotor_inertia
        rms, (mean, off) = duty.rms_torque(inertia, ratio), duty.mean_speed()
        continuous = [motor.continuous_torque(ratio * speed) for speed in (mean, mean - off, mean + off)]
        heat = (duty.torque(inertia, ratio) / motor.stall_torque) ** 2
        speed, winding = _times(duty.fastest, ratio), duty.warmest(heat, motor.time_constant)
        warmest, doubt = _times(winding, motor.temperature_rise)
        torque, used = ((float(of(duty.v, duty.a, duty.y).max()), 0.0) for of in _torque_and_use(motor, ratio))
        energy, regenerated = duty.energy(inertia, ratio)
        known = {
            "peak torque": torque,
            "torque margin": _torque_margin(duty, motor, ratio, used),
            "rms torque": rms,
            "rms margin": _over((continuous[0], float(np.ptp(continuous))), rms),
            "peak speed": speed,
            "speed margin": _over((motor.max_speed, 0.0), speed),
            "winding": (self.ambient_temperature + warmest, doubt),
            "inertia ratio": _over(duty.load_inertia, (inertia * ratio**2, 0.0)),
            "energy": (energy, 0.0),
            "regenerated": (regenerated, 0.0),
        }
        return Candidate(motor, ratio, self.safety, known)

    def _section(self, duty: Duty, ranked: Sequence[Candidate], drive: Drive) -> Section:
        rows = [candidate.row(number) for number, candidate in enumerate(ranked, start=1)]
        near = _near(ranked)
        title = f"Motors and ratios for {self.drive}: best ratio of each that fits, then of those that come near"
        tables = [SectionTable("motors", title, COLUMNS, UNITS_OF, [rows[k] for k in near]), _best_ratios(duty, ranked)]
        if others := [row for k, row in enumerate(rows) if k not in near]:
            tables.append(SectionTable("others", "Other ratios and motors", COLUMNS, UNITS_OF, others))
        best, fitting = ranked[0], sum(not candidate.reasons for candidate in ranked)
        known = {"fitting": (float(fitting), 0.0), "ratio": (best.ratio, 0.0), "reserve": best.reserve}
        known |= {name: best.known[name.replace("_", " ")] for name in NUMBERS if name not in known}
        tables.append(_first_table(best, known))
        remarks = [
            f"{fitting} of {len(ranked)} fit; motors with a gear of efficiency "
            f"{drive.efficiency if self.efficiency is None else self.efficiency:g} by direction of power",
        ]
        if len(ranked) > 1:
            remarks.append(f"torques and energies of the others are those of {len(duty.t)} instants")
        if not duty.a.any() and not duty.y.any():
            still = f"'{drive.coordinate}' carries no load and does not accelerate in this run"
            remarks.insert(0, f"nothing is sized: {still}")
        if not fitting:
            remarks.insert(0, f"no motor fits; closest is {best.motor.name} at {best.ratio:g}: {best.verdict}")
        numbers = numbered({name: CurveFigure(*x, NUMBERS[name]) for name, x in known.items()})
        title = f"Motor and gear of {self.drive}"
        return Section("sizing", title, tables, remarks=remarks, graphs=[_cloud(duty, best)], **numbers)


class Candidate(Record, frozen=True):
    """A motor at a ratio.

    Attributes:
        motor: The motor.
        ratio: The ratio.
        safety: Factor that margins have to reach.
        known: Its numbers with their errors, by name of their column. Margins are available over needed; torques are
            those at the motor, energies those of a cycle, and the winding's temperature is its highest in cycles that
            follow each other.
        refined: Whether torques and energies are those of the motion, not of instants.
    """

    motor: Motor
    ratio: float
    safety: float
    known: Mapping[str, Known]
    refined: bool = False

    @property
    def margins(self) -> dict[str, Known]:
        return {what: self.known[f"{name} margin"] for what, name in MARGINS.items()}

    @property
    def reserve(self) -> Known:
        """Smallest of the margins."""
        least = min(margin for margin, _ in self.margins.values())
        if not np.isfinite(least):
            return least, 0.0
        low, high = (min(margin + sign * error for margin, error in self.margins.values()) for sign in (-1.0, 1.0))
        return least, max(least - low, high - least)

    @property
    def reasons(self) -> list[str]:
        """Why it does not fit; empty where it does."""
        short = {what: margin for what, (margin, _) in self.margins.items() if margin < self.safety}
        said = [
            f"needs {100.0 / margin:.0f} % of its {what}" if margin else f"has no {what} left"
            for what, margin in short.items()
        ]
        warmest, _ = self.known["winding"]
        return said + [f"winding at {warmest:.0f} degC"] * (warmest > self.motor.max_temperature)

    @property
    def verdict(self) -> str:
        return "; ".join(self.reasons) or "fits"

    @property
    def order(self) -> tuple[bool, float, float]:
        """Key to rank by: those that fit by mass, the others by how far they are from it; then by reserve."""
        fails, (reserve, _) = bool(self.reasons), self.reserve
        return fails, -reserve if fails else self.motor.mass, -reserve

    def row(self, number: int) -> tuple[str | float, ...]:
        return (float(number), self.motor.name, self.ratio, self.verdict, *(value for value, _ in self.known.values()))


def _near(ranked: Sequence[Candidate]) -> list[int]:
    """Return the places of the best ratio of every motor: all motors that fit, then ``NEAR`` that come nearest."""
    first = dict[str, int]()
    for k, candidate in enumerate(ranked):
        first.setdefault(candidate.motor.name, k)
    fitting = sum(not ranked[k].reasons for k in first.values())
    return [*first.values()][: fitting + NEAR]


NEAR = 5
"""Motors that do not fit at any ratio and are still shown first."""


def _torque_and_use(motor: Motor, ratio: float) -> tuple[Height, Height]:
    """Return the size of the torque [N*m], and its quotient with what the motor has for a short time."""

    def torque(v: Array, a: Array, y: Array) -> Array:
        return np.abs(motor.rotor_inertia * ratio * a + y / ratio)

    def used(v: Array, a: Array, y: Array) -> Array:
        return torque(v, a, y) / motor.short_torque(np.minimum(ratio * np.abs(v), motor.max_speed))

    return torque, used


def _torque_margin(duty: Duty, motor: Motor, ratio: float, used: Known) -> Known:
    beyond = ratio * np.abs(duty.v) > motor.max_speed
    return (0.0, 0.0) if duty.torque(motor.rotor_inertia, ratio)[beyond].any() else _over((1.0, 0.0), used)


def _refined(duty: Duty, candidate: Candidate) -> Candidate:
    motor, ratio = candidate.motor, candidate.ratio
    terms, (torque, used) = duty.terms(motor.rotor_inertia, ratio), _torque_and_use(motor, ratio)

    def power(v: Array, a: Array, y: Array) -> Array:
        return (motor.rotor_inertia * ratio * a + y / ratio) * ratio * v

    delivered, taken = duty.parts(power, terms * ratio * duty.fastest[0])
    margin = _torque_margin(duty, motor, ratio, duty.largest(used, terms / motor.rated_torque))
    found = {"peak torque": duty.largest(torque, terms), "torque margin": margin}
    known = {**candidate.known, **found, "energy": delivered, "regenerated": taken}
    return replace(candidate, known=known, refined=True)


def _times(known: Known, factor: float) -> Known:
    value, error = known
    return factor * value, factor * error


def _over(known: Known, divisor: Known) -> Known:
    """Return a quotient and its error; infinite where the divisor is 0."""
    (above, off), (below, doubt) = known, divisor
    if not below or not np.isfinite(above):
        return np.inf, np.inf if doubt else 0.0
    value = above / below
    return value, (off + abs(value) * doubt) / (below - doubt) if below > doubt else np.inf


def _first_table(best: Candidate, known: Mapping[str, Known]) -> SectionTable:
    rows = [(name.replace("_", " "), str(NUMBERS[name]), *known[name]) for name in NUMBERS]
    rows.append(("winding", "degC", *best.known["winding"]))
    return SectionTable(
        "first", "Numbers of the first, and their errors", ("", "unit", "value", "error"), (None,) * 4, rows, row_unit=1
    )


def _best_ratios(duty: Duty, ranked: Sequence[Candidate]) -> SectionTable:
    motors = list({candidate.motor.name: candidate.motor for candidate in ranked}.values())
    best = [(motor, duty.best_ratio(motor.rotor_inertia)) for motor in motors]
    rows = [
        (motor.name, ratio, *(duty.rms_torque(motor.rotor_inertia, ratio) if 0.0 < ratio < np.inf else (0.0, 0.0)))
        for motor, ratio in best
    ]
    return SectionTable("best_ratios", "Ratio of the least rms torque", ("motor", "ratio", "rms torque", "error"),
                        (None, None, TORQUE, TORQUE), rows)  # fmt: skip


def _cloud(duty: Duty, best: Candidate) -> Graph:
    """Return torque over speed at all instants, and what the motor has for a short time and for ever."""
    motor, speeds = best.motor, np.linspace(0.0, best.motor.max_speed, 200)
    continuous = np.array([motor.continuous_torque(speed) for speed in speeds.tolist()])
    torque = np.abs(duty.torque(motor.rotor_inertia, best.ratio))

    def curve(speed: Array, values: Array, label: str, *, points: bool = False) -> Curve:
        across = Series("speed of the motor", SPEED, speed)
        return Curve(across, Series("torque of the motor", TORQUE, values), label, points)

    cloud = curve(best.ratio * np.abs(duty.v), torque, "torque at all instants", points=True)
    mean, rms = np.array([best.ratio * duty.mean_speed()[0]]), np.array([best.known["rms torque"][0]])
    point = curve(mean, rms, "rms torque", points=True)
    return Graph(
        "torque_speed",
        f"{motor.name}, ratio {best.ratio:g}",
        [curve(speeds, motor.short_torque(speeds), "peak"), curve(speeds, continuous, "continuous"), cloud, point],
    )
