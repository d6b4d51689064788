"""Paths of keys that a line may go on with."""

from pathlib import Path

import pytest

import pinarm
from pinarm.use.study.quantities import dotted_keys

ROOT = Path(pinarm.__file__).parents[1]


@pytest.mark.parametrize(("prefix", "offered"), [
    ("prob", ["problem.kind=", "problem.time.", "problem.motion.", "problem.drives.", "problem.start."]),
    ("problem.time.", ["problem.time.end=", "problem.time.samples="]),
    ("arguments.m", ["arguments.m2=", "arguments.m3=", "arguments.m4="]),
    ("changes.loops.B.", ["changes.loops.B.kind=", "changes.loops.B.between.", "changes.loops.B.axis="]),
    ("expect.1.quan", ["expect.1.quantity="]), ("nothing", []), ("problem.time.end.", []),
])  # fmt: skip
def test_keys_of_a_scenario_its_problem_and_its_mechanism_are_offered(prefix: str, offered: list[str]) -> None:
    assert dotted_keys(ROOT / "scenarios/crank_rocker_turning.yaml", prefix) == offered


def test_keys_of_a_mechanism_file_are_offered() -> None:
    file = ROOT / "models/crank_rocker/mechanism.yaml"
    assert "loops." in dotted_keys(file)
