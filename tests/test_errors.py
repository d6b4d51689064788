"""What errors say: place, excerpt with the mistake underlined, what was expected, what to try."""

import numpy as np
import pytest

import pinarm
from pinarm.errors import SHOWN, InputError, Location, UnitError, choices, printable, within
from pinarm.input.units import unit


def test_the_mistake_is_underlined() -> None:
    location = Location("arm.yaml", 7, 10, "  ratio: ten", width=3)
    assert str(location) == "arm.yaml:7:10"
    line, marks = location.excerpt().splitlines()
    assert line == "    7 |   ratio: ten"
    assert [line[k] for k, mark in enumerate(marks) if mark == "^"] == list("ten")


@pytest.mark.parametrize("column", [1, 200, 480])
def test_of_a_long_line_the_part_around_the_mistake_is_shown(column: int) -> None:
    text = "".join(chr(ord("a") + k % 26) for k in range(500))
    line, marks = Location("a", 1, column, text).excerpt().splitlines()
    assert len(line) <= SHOWN + 8
    assert line[marks.index("^")] == text[column - 1]


def test_a_message_has_its_four_parts_in_order() -> None:
    error = InputError("found", expected="wanted", hint="tried").at(Location("a", 2, 1, "xyz"))
    assert str(error).splitlines() == ["a:2:1: found", "    2 | xyz", "      | ^", "  expected: wanted", "  try: tried"]
    assert error.at(Location("b", 3)).location == Location("a", 2, 1, "xyz")  # the first place is the more exact one


def test_keys_on_the_way_to_a_mistake_are_collected_from_outside_inwards() -> None:
    with pytest.raises(InputError) as caught, within("forces", "oil"), within("curve", 3):
        raise InputError("wrong")
    assert caught.value.path == ("forces", "oil", "curve", 3)


def test_a_misspelt_name_comes_with_the_nearest_and_a_list() -> None:
    assert choices("stifness", ["damping", "stiffness"]) == ("one of damping, stiffness", "stiffness")
    assert choices("x", []) == ("nothing: there is none", "")
    listed, close = choices("zzz", [f"a{k:02d}" for k in range(20)])
    assert listed.endswith("a11, ... (20 in all)")
    assert close == ""


def test_what_steers_a_terminal_is_replaced() -> None:
    assert printable("a\x1b[31m\nb\r") == "a\N{REPLACEMENT CHARACTER}[31m\nb\N{REPLACEMENT CHARACTER}"


def test_a_notebook_shows_the_users_line_that_numpy_called_from():
    length, force = (pinarm.Series(name, unit(text), np.ones(2)) for name, text in (("l", "m"), ("F", "N")))
    with pytest.raises(UnitError) as caught:
        length + force
    assert caught.value._render_traceback_()[-1].endswith(": length + force")
