"""The base of everything that is read from files: validated, immutable, and strict about units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, PlainValidator, ValidationInfo, WithJsonSchema

from pinarm.errors import UnitError
from pinarm.input.units import Unit, read_quantity, unit

FROM_FILE = {"units": "required"}
"""Validation context of documents: a bare number other than 0 is refused where a unit belongs."""


class Model(BaseModel):
    """An immutable piece of input; keys it does not know are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True, populate_by_name=True, strict=False)


class Measured(float):
    """A float in SI that remembers the unit it was written in; ``None`` where it was a bare number."""

    unit: Unit | None = None

    @classmethod
    def read(cls, value: Any, info: ValidationInfo) -> Measured:
        """Read ``"30 deg"``, or a number: SI from Python, in a file only zero."""
        if isinstance(value, Measured):
            return value
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise ValueError("a number with a unit, such as '30 deg', is expected")
        number, read = read_quantity(value) if isinstance(value, str) else (float(value), None)
        if number - number != 0.0:
            raise ValueError("a finite number is expected")
        if read is None and number != 0.0 and info.context is FROM_FILE:
            raise ValueError(f"'{value}' has no unit: write for instance '{value} {_example(info)}'")
        measured = cls(number)
        measured.unit = read
        return measured

    def check(self, expected: Unit) -> None:
        """Raise where the unit that was written has another dimension than the expected one.

        Raises:
            UnitError: The dimensions differ.
        """
        if self.unit is not None and self.unit.dimension != expected.dimension:
            raise UnitError(f"'{self.unit}' is not a unit of this quantity", expected=f"a unit such as {expected}")


def _example(info: ValidationInfo) -> str:
    return {"time": "s", "begin": "s", "end": "s", "start": "s"}.get(str(info.field_name), "N*m, deg, m/s, ...")


@dataclass(frozen=True)
class Derivative:
    """Marks a field of a motion law as the ``order``-th time derivative of the quantity that the law is about."""

    order: int


def quantity(text: str) -> Any:
    """Return the annotation of a float whose unit must have the dimension of ``text``."""
    expected = unit(text)

    def read(value: Any, info: ValidationInfo) -> Measured:
        try:
            measured = Measured.read(value, info)
        except ValueError as error:
            raise ValueError(str(error).replace("N*m, deg, m/s, ...", text)) from None
        measured.check(expected)
        return measured

    return Annotated[float, PlainValidator(read), _json(f"in {text}")]


def _json(description: str) -> WithJsonSchema:
    return WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}], "description": description})


AnyQuantity = Annotated[float, PlainValidator(Measured.read), _json("a number with its unit")]
Level = Annotated[AnyQuantity, Derivative(0)]
Rate = Annotated[AnyQuantity, Derivative(1)]
SecondRate = Annotated[AnyQuantity, Derivative(2)]
Time = quantity("s")
Torque = quantity("N*m")
