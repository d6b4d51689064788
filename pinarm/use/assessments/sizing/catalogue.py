"""Motors of a catalogue: a CSV file with a line a motor.

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

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, Location, choices
from pinarm.input.csv_tables import read_columns, split_heading, table
from pinarm.input.units import unit

MOST = 10_000
"""Motors of a catalogue at most."""

SMALLEST, GREATEST = 1e-30, 1e30
"""Of what a catalogue says of a motor, and of ratios: products of their squares stay numbers."""

UNITS = {
    "stall_torque": "N*m", "rated_torque": "N*m", "rated_speed": "rpm", "peak_torque": "N*m", "max_speed": "rpm",
    "rotor_inertia": "kg*m^2", "temperature_rise": "", "max_temperature": "", "time_constant": "s", "mass": "kg",
}  # fmt: skip


@dataclass(frozen=True)
class Motor:
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
    place, factors = _headings(heads, path.name)
    names = [row[place].strip() if place < len(row) else "" for _, row in rows]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"the catalogue {path.name} has the motor '{twice}' twice", expected="names of their own")
    state = path.stat()
    columns = read_columns(str(path), frozenset(UNITS), (state.st_mtime_ns, state.st_size))
    numbers = [columns[heading] for heading, _ in factors.values()]
    lines = zip(rows, names, *numbers, strict=True)
    return [_motor(name, dict(zip(factors, row, strict=True)), factors, Location(path.name, line))
            for (line, _), name, *row in lines]  # fmt: skip


def _headings(headings: list[str], file: str) -> tuple[int, dict[str, tuple[str, float]]]:
    """Return the place of the names, and the heading and the factor of the unit of each number, by name."""
    keys = [(split_heading(heading) or (heading.strip(), None))[0] for heading in headings]
    known = dict(zip(keys, map(str.strip, headings), strict=True))
    for name in ("name", *UNITS):
        if name not in known:
            expected, hint = choices(name, known)
            needed = ", ".join(["name", *(f"{key} [{of}]" if of else key for key, of in UNITS.items())])
            raise InputError(
                f"the catalogue has no column '{name}', but {expected}", expected=f"the columns {needed}", hint=hint
            ).at(Location(file, 1))
    return keys.index("name"), {name: (known[name], _factor(name, known[name], file)) for name in UNITS}


def _factor(name: str, heading: str, file: str) -> float:
    if not UNITS[name]:
        return 1.0
    _, written = split_heading(heading) or (name, None)
    if written is not None and unit(written).dimension == unit(UNITS[name]).dimension:
        return unit(written).factor
    error = InputError(f"the heading '{heading}' has no unit of this quantity", expected=f"{name} [{UNITS[name]}]")
    raise error.at(Location(file, 1, 1, heading))


def _motor(name: str, numbers: dict[str, float], factors: dict[str, tuple[str, float]], line: Location) -> Motor:
    for key, number in numbers.items():
        free = key == "rotor_inertia" and number == 0.0
        if not free and not SMALLEST <= number <= GREATEST:
            raise InputError(f"{key} is {number:g}", expected=f"a size from {SMALLEST:g} to {GREATEST:g}").at(line)
    motor = Motor(name, *(numbers[field.name] * factors[field.name][1] for field in fields(Motor)[1:]))
    for low, high in (("rated_torque", "stall_torque"), ("rated_torque", "peak_torque"), ("rated_speed", "max_speed")):
        if not getattr(motor, low) <= getattr(motor, high) or motor.rated_speed == motor.max_speed:
            expected = f"{low} not above {high}, rated_speed below max_speed"
            raise InputError(f"{low} is beyond {high}", expected=expected).at(line)
    return motor
