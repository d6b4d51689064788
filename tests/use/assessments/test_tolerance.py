"""Tolerances as files write them."""

import pytest

from pinarm.errors import InputError, PinarmError
from pinarm.use.assessments.derivatives import Tolerance


@pytest.mark.parametrize(
    ("text", "value", "size"),
    [("250 ± 0.1 mm", 0.25, 1e-4), ("250+/-0.1 mm", 0.25, 1e-4), ("0.1 mm", 7.0, 1e-4),
     ("25 cm ± 0.1 mm", 0.25, 1e-4), ("-250 ± 1 mm", -0.25, 1e-3), ("5 %", -2.0, 0.1), ("250 mm ± 4 %", 0.25, 0.01),
     ("0.2 1", 3.0, 0.2), ("1e-3 ± 1e-4 kg", 1e-3, 1e-4), ("0.05", 0.15, 0.05)],
)  # fmt: skip
def test_its_size_is_in_si(text: str, value: float, size: float) -> None:
    read = Tolerance.read(text, bare=False)
    assert read.size(value) == pytest.approx(size, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [("250 ± mm", "not a quantity"), ("1 ± 2 ± 3 mm", "no tolerance"), ("0 mm", "of 0 is none"), ("-1 mm", "is none"),
     ("250 kg ± 1 mm", "different units"), ("1 furlong", "unknown unit"), (True, "no tolerance")],
)  # fmt: skip
def test_what_is_none_is_refused(text: object, message: str) -> None:
    with pytest.raises(PinarmError, match=message):
        Tolerance.read(text, bare=False)


def test_the_value_has_to_be_that_of_the_file() -> None:
    with pytest.raises(InputError, match="about 250 mm, and the value is 200 mm"):
        Tolerance.read("250 ± 0.1 mm").size(0.2)


def test_a_part_of_nothing_is_no_tolerance() -> None:
    with pytest.raises(InputError, match="part of 0"):
        Tolerance.read("5 %").size(0.0)
