"""Motions from many initial states: against the energy theorem, and which of them are left to each case alone."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.kernel.library import absence
from pinarm.records import replace
from pinarm.use.cases.case import WORTH, RowValues, Value
from pinarm.use.cases.case_table import CaseTable
from pinarm.use.cases.motions import ForwardCases
from pinarm.use.cases.stack import Stack
from tests.use.cases.conftest import Chunk
from tests.use.cases.test_stack import compared, task_of

pytestmark = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")

SWING = """\
pinarm: 1
title: A pendulum, pushed
mechanism: pendulum.yaml
arguments: {l: 1 m, m: 2 kg}
problem:
  kind: forward
  time: {end: 2 s, samples: 40}
  initial: {velocity: {pivot: 1 rad/s}}
outputs: [alpha]
accuracy: {tolerance: 1e-12}
"""


@pytest.fixture
def swing(path: Path) -> Path:
    file = path.with_name("swing.yaml")
    file.write_text(SWING)
    return file


def test_pendulums_swing_as_high_as_the_energy_theorem_says(swing: Path, chunk: Chunk) -> None:
    """``m g l (1 - cos alpha) = (I + m l²) omega² / 2`` with m = 2 kg, I = 0.5 kg*m² and g = 10 m/s²."""
    speeds, lengths = np.array([0.5, 1.5, 3.0, 1.0]), np.array([1.0, 0.8, 0.9, 1.1])
    cases: list[dict[str, Value]] = [
        {"problem.initial.velocity.pivot": f"{speed!r} rad/s", "arguments.l": f"{length!r} m"}
        for speed, length in zip(speeds.tolist(), lengths.tolist(), strict=True)
    ]
    numbers = chunk(pinarm.load(swing), cases, ["alpha @ max"])
    highest = np.arccos(1.0 - (0.5 + 2.0 * lengths**2) * speeds**2 / (2.0 * 2.0 * 10.0 * lengths))
    np.testing.assert_allclose(numbers[:, 0], highest, atol=1e-10)  # errors of steps, some 60 of 1e-12
    assert (numbers[:, 1 + WORTH.index("energy")] < 1e-10).all()


@pytest.mark.parametrize(("values", "together"), [
    (["problem.loads={drag: {kind: joint_spring, joint: pivot, stiffness: 3 N*m/rad, damping: 0.4 N*m*s/rad}}"], 5),
    (["problem.loads={drag: {kind: joint_spring, joint: pivot, damping: 40 N*m*s/rad}}", "accuracy.tolerance=1e-6"], 6),
    (["problem.initial.velocity.pivot=0 rad/s"], 5),
], ids=["damped", "steps divided", "at rest"])  # fmt: skip
def test_they_are_those_of_each_alone(swing: Path, values: list[str], together: int) -> None:
    """By a spring and a damper, in steps that are divided since they are stiff, and with errors relative to little.

    At rest the energy that nothing accounts for is unknown; where rounding may matter, cases are left to each alone.
    """
    cases: list[dict[str, Value]] = [
        {"problem.initial.velocity.pivot": f"{speed!r} rad/s"} for speed in (1.0, 0.25, -0.7, 0.01, 0.0, 1e-6)
    ]
    task = task_of(swing, ["alpha", "alpha @ max"], values)
    rows = replace(task, wanted=(*task.wanted, RowValues("joint.pivot.velocity")))
    assert compared(rows, cases) == together


def test_a_case_that_cannot_be_followed_falls_back_alone(swing: Path) -> None:
    cases: list[dict[str, Value]] = [
        {"problem.initial.velocity.pivot": f"{speed} rad/s"} for speed in ("1.0", "1e200", "2.0")
    ]
    stack, _ = Stack.begin(task_of(swing), cases[0])
    assert stack is not None
    assert stack.rows(CaseTable.of(cases))[0].tolist() == [0, 2]


@pytest.mark.parametrize(
    ("value", "taken"),
    [("problem.time.end=2 s", True),
     ("problem.end_stops={pivot: {upper: 75 deg}}", False),
     ("problem.events={top: {when: pivot, reaches: 0.1 rad}}", False),
     ("problem.loads={push: {kind: joint_effort, joint: pivot, "
      "effort: {law: steps, points: [[0 s, 0 N*m], [1 s, 1 N*m]]}}}", False)],
)  # fmt: skip
def test_only_smooth_free_motions_are_integrated_so(swing: Path, value: str, taken: bool) -> None:
    assert (ForwardCases.of(pinarm.run(swing, [value]), {}) is not None) == taken
