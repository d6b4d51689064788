"""The question in words, and the mechanism in tables, against what their files say."""

from collections.abc import Callable
from typing import Any

import pytest

from pinarm.use.report.chapter import mobility_words, question
from pinarm.use.show.structure import mechanism_tables


def test_masses_axes_and_limits_are_those_of_the_file(mechanism: Callable[..., Any], chain: Callable[..., str]) -> None:
    xml = chain(
        {"name": "turn", "axis": "0 -1 0", "mass": 2.0, "com": "0 0 -1", "inertia": (0.1, 0.2, 0.25)},
        {"name": "slide", "kind": "prismatic", "axis": "1 0 0", "mass": 0.5},
        {"name": "skew", "kind": "revolute", "axis": "0 0.6 0.8"},
    )
    tables = {table.title: table for table in mechanism_tables(mechanism(xml, drives={"motor": {"joint": "turn"}}))}
    assert list(tables) == ["Bodies", "Joints", "Forces and drives"]
    assert list(tables["Bodies"].rows[0]) == ["turn_link", "", "2", "0", "0", "-1", "0.1", "0.2", "0.25"]
    assert "3.5 kg" in tables["Bodies"].remark
    assert [list(row) for row in tables["Joints"].rows] == [
        ["turn", "revolute", "frame", "turn_link", "0 -1 0", "unlimited"],
        ["slide", "prismatic", "turn_link", "slide_link", "1 0 0", "-1000 to 1000 m"],
        ["skew", "revolute", "slide_link", "skew_link", "0 0.6 0.8", "-57295.8 to 57295.8°"],
    ]
    assert [list(row) for row in tables["Forces and drives"].rows] == [["drive", "motor", "at turn"]]


@pytest.mark.parametrize("kind", ["inverse", "equilibria"])
def test_mobility_of_an_open_chain(scenario: Callable[..., Any], kind: str) -> None:
    assert mobility_words(scenario(kind).run()) == "Mobility 1: 1 joint coordinates, no loop."


def test_laws_gravity_and_symbols_are_told(scenario: Callable[..., Any]) -> None:
    table = [list(row) for row in question(scenario("inverse").run()).rows]
    assert ["Time", "", "end = 2 s, samples = 9"] in table
    assert ["Moves by a law", "pivot", "trapezoid: from 0 rad, to 1 rad, acceleration 1 rad/s^2"] in table
    assert ["Gravity", "", "(0, 0, -10) m/s²"] in table
    assert ["Asked for", "M", "joint.pivot.effort"] in table
    assert ["", "alpha", "joint.pivot.position"] in table
