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

import math
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, Location, choices
from pinarm.input.csv_tables import table
from pinarm.input.numbers import decimal, is_decimal
from pinarm.input.units import unit

MAX_BYTES, MOST = 5_000_000, 10_000
"""Size of a catalogue at most, and number of its motors."""

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
    """Return the motors of a catalogue.

    Raises:
        InputError: The file cannot be read, a column is missing, or a cell is not a positive number; located.
    """
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"the catalogue {path.name} is too large", expected=f"at most {MAX_BYTES} bytes")
    heads, below = table(path, path.name)
    rows = list(below)
    if not 1 <= len(rows) <= MOST:
        raise InputError(f"the catalogue {path.name} has {len(rows)} motors", expected=f"1 to {MOST}")
    columns = _columns(heads, path.name)
    motors = [_motor(row, columns, Location(path.name, line)) for line, row in rows]
    names = [motor.name for motor in motors]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"the catalogue {path.name} has the motor '{twice}' twice", expected="names of their own")
    return motors


def _columns(headings: list[str], file: str) -> dict[str, tuple[int, float]]:
    """Return where each value stands, and the factor of its unit."""
    columns: dict[str, tuple[int, float]] = {}
    for place, heading in enumerate(headings):
        name, _, rest = heading.strip().partition("[")
        name, written = name.strip(), rest.rstrip("] ").strip()
        if UNITS.get(name):
            measured = unit(written) if written else None
            if measured is None or measured.dimension != unit(UNITS[name]).dimension:
                raise InputError(
                    f"the heading '{heading}' has no unit of this quantity", expected=f"{name} [{UNITS[name]}]"
                ).at(Location(file, 1, 1, heading))
            columns[name] = place, measured.factor
        elif name in ("name", *UNITS):
            columns[name] = place, 1.0
    for name in ("name", *UNITS):
        if name not in columns:
            expected, hint = choices(name, [heading.partition("[")[0].strip() for heading in headings])
            needed = ", ".join(["name", *(f"{key} [{of}]" if of else key for key, of in UNITS.items())])
            raise InputError(
                f"the catalogue has no column '{name}', but {expected}", expected=f"the columns {needed}", hint=hint
            ).at(Location(file, 1))
    return columns


def _motor(row: list[str], columns: dict[str, tuple[int, float]], line: Location) -> Motor:
    values: dict[str, float] = {}
    for field in fields(Motor)[1:]:
        place, factor = columns[field.name]
        text = row[place].strip() if place < len(row) else ""
        number = decimal(text) if is_decimal(text) else math.nan
        if not 0.0 <= number < math.inf or (number == 0.0 and field.name != "rotor_inertia"):
            raise InputError(f"{field.name} is '{text}'", expected="a positive number with a decimal point").at(line)
        if number and not SMALLEST <= number <= GREATEST:
            raise InputError(f"{field.name} is {number:g}", expected=f"a size from {SMALLEST:g} to {GREATEST:g}").at(
                line
            )
        values[field.name] = number * factor
    motor = Motor(row[columns["name"][0]].strip(), **values)
    for low, high in (("rated_torque", "stall_torque"), ("rated_torque", "peak_torque"), ("rated_speed", "max_speed")):
        if not getattr(motor, low) <= getattr(motor, high) or motor.rated_speed == motor.max_speed:
            raise InputError(
                f"{low} is beyond {high}", expected=f"{low} not above {high}, rated_speed below max_speed"
            ).at(line)
    return motor
