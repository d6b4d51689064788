"""Numbers with units: required in files, SI from Python, the dimension checked."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from pinarm.errors import InputError, UnitError
from pinarm.input.yaml.schema import AnyQuantity, InputStruct, Level, Time, convert, quantity, reading_from
from pinarm.mechanics.couplings.kinds import Gear
from pinarm.mechanics.description import Gravity
from pinarm.mechanics.forces.along_coordinate import JointSpring
from pinarm.mechanics.laws import Polynomial
from pinarm.mechanics.rotors import Drive


class Piece(InputStruct, rename={"angle": "from"}):
    """Something to fill in."""

    length: quantity("m") = 0.0  # type: ignore[valid-type]
    torque: AnyQuantity = 0.0
    time: Time = 0.0
    angle: Level = 0.0


def built(model: type[InputStruct], data: Any) -> Any:
    """Build a model as from a file, and let its own error out."""
    with reading_from(Path()):
        try:
            return msgspec.convert(data, model, dec_hook=convert)
        except msgspec.ValidationError as error:
            raise error.__cause__ or InputError(str(error)) from None


def from_file(**data: Any) -> Piece:
    return built(Piece, data)


def test_a_quantity_is_read_in_si_and_remembers_its_unit() -> None:
    piece = from_file(length="250 mm", torque="3 kN*m")
    assert piece.length == 0.25
    assert piece.torque == 3000.0
    assert str(piece.torque.unit) == "kN*m"


@pytest.mark.parametrize("value", [0.25, "1e-3"])
@pytest.mark.parametrize("field", ["length", "torque"])
def test_a_file_must_give_the_unit(field: str, value: float | str) -> None:
    with pytest.raises(InputError, match="has no unit"):
        from_file(**{field: value})


def hint(read: Callable[..., Any], **data: Any) -> str:
    """Return what the refusal of a bare number suggests."""
    with pytest.raises(InputError, match="has no unit") as caught:
        read(**data)
    assert isinstance(caught.value, UnitError)
    return caught.value.hint


def test_the_hint_shows_a_unit_that_would_be_right() -> None:
    assert hint(from_file, length=2) == "2 m"
    assert hint(from_file, time=2) == "2 s"


@pytest.mark.parametrize("value", ["1 kg", "1 m^2"])
def test_a_wrong_dimension_is_refused(value: str) -> None:
    with pytest.raises(InputError, match="not a unit of this quantity"):
        from_file(length=value)


@pytest.mark.parametrize("value", [math.nan, math.inf, "1e999 m", "nan", pytest.param(10**399, id="400 digits")])
def test_only_finite_numbers(value: float | str) -> None:
    with pytest.raises(InputError):
        Piece(length=value)
    with pytest.raises(InputError):
        Piece(torque=value)


@pytest.mark.parametrize("value", [True, None, [1]])
def test_only_numbers_and_text(value: Any) -> None:
    with pytest.raises(InputError):
        from_file(length=value)


@pytest.mark.parametrize(
    ("model", "data"),
    [
        (Gravity, {"magnitude": "-9.81 m/s^2"}),
        (JointSpring, {"kind": "joint_spring", "joint": "j", "stiffness": "-1 N/m"}),
        (Polynomial, {"from": "0 m", "to": "1 m", "duration": "0 s"}),
    ],
)
def test_bounds_of_a_quantity_hold(model: type[InputStruct], data: dict[str, Any]) -> None:
    mended = {key: value.lstrip("-").replace("0 s", "1 s") if key != "from" else value for key, value in data.items()}
    built(model, mended)
    with pytest.raises(InputError, match="out of bounds"):
        built(model, data)


@pytest.mark.parametrize(
    ("text", "number"), [("17/43", 17 / 43), (" -1 / 30 ", -1 / 30), (0.5, 0.5), (2, 2.0), ("1.5/2", 0.75)]
)
def test_a_ratio_may_be_a_fraction(text: object, number: float) -> None:
    assert Gear(joints=("a", "b"), ratio=text).ratio == number
    assert Drive(joint="a", ratio=text).ratio == number


@pytest.mark.parametrize(
    ("text", "says"),
    [("17:43", "no ratio"), ("17/0", "divides by 0"), ("0.5 mm", "no ratio"), ("1/2/3", "no ratio"), ([1], "quantity")],
)
def test_what_is_no_ratio(text: object, says: str) -> None:
    with pytest.raises(InputError, match=says):
        Drive(joint="a", ratio=text)
