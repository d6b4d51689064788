"""Numbers in text: what is read, and what is none."""

import pytest

from pinarm.input.numbers import decimal, is_decimal, leading_number


@pytest.mark.parametrize("text", ["１２", "1_0", "", ".", "1,5", "0x10", "1e", "1\u0660"])
def test_what_is_no_decimal_number(text: str) -> None:
    assert not is_decimal(text)
    with pytest.raises(ValueError, match=r"number|convert"):
        decimal(text)


@pytest.mark.parametrize(
    ("text", "parts"),
    [("2kg", ("2", "kg")), ("1e3", ("1e3", "")), ("1e m", ("1", "e m")), ("1.2.3", ("1.2", ".3")), ("kg", None),
     ("", None), ("..1", None), ("١ kg", None), ("1٢", ("1", "٢"))],
)  # fmt: skip
def test_the_number_that_a_text_begins_with(text: str, parts: tuple[str, str] | None) -> None:
    assert leading_number(text) == parts
