"""The question in words."""

from collections.abc import Callable
from typing import Any

import pytest

from pinarm.use.report.question import question


def test_laws_gravity_and_symbols_are_told(scenario: Callable[..., Any]) -> None:
    table = [list(row) for row in question(scenario("inverse").run()).rows]
    assert ["Time", "", "end = 2 s, samples = 9"] in table
    assert ["Moves by a law", "pivot", "trapezoid: from 0 rad, to 1 rad, acceleration 1 rad/s^2"] in table
    assert ["Gravity", "", "(0, 0, -10) m/s²"] in table
    assert ["Asked for", "M", "joint.pivot.effort"] in table
    assert ["", "alpha", "joint.pivot.position"] in table


@pytest.mark.parametrize("kind", ["statics", "forward", "state", "equilibria"])
def test_every_kind_names_its_coordinate(scenario: Callable[..., Any], kind: str) -> None:
    rows = question(scenario(kind).run()).rows
    assert any("pivot" in f"{name} {value}" for label, name, value in rows if label != "Asked for")
