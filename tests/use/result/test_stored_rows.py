"""Mechanisms, scenarios and results go to other processes, and are the same there."""

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pinarm

ROOT = Path(__file__).parents[3]
SCENARIOS = ["gen411_arm_equilibria", "manipulator_counterweight"]
"""Equilibria, and a search over loops."""


def assert_same(one: pinarm.Result, other: pinarm.Result) -> None:
    assert repr(one.summary()) == repr(other.summary())
    assert repr(one.events) == repr(other.events)
    for left, right in zip(one.columns(), other.columns(), strict=True):
        assert np.array_equal(left.values, right.values), left.name
    for name in ("q", "v", "a", "tau", "lam"):
        assert np.array_equal(np.asarray(getattr(one.trajectory, name)), np.asarray(getattr(other.trajectory, name)))
    frictions = [[contact.name for contact in each.trajectory.mechanism.frictions] for each in (one, other)]
    assert frictions[0] == frictions[1]
    for name in ("driven", "drives", "parameter", "separate", "sampled", "no_efforts", "unknown"):
        assert np.array_equal(getattr(one.trajectory, name), getattr(other.trajectory, name)), name


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_result_is_the_same_in_another_process(name: str) -> None:
    result = pinarm.run(ROOT / "scenarios" / f"{name}.yaml")
    assert_same(result, pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(result)))))


@pytest.mark.parametrize("kind", ["statics", "inverse", "forward"])
def test_a_scenario_is_solved_alike_in_another_process(
    scenario: Callable[..., pinarm.Scenario], folder: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is read from a relative path, and the other process has another working directory."""
    scenario(kind)
    monkeypatch.chdir(folder)
    given = pinarm.load(f"{kind}.yaml", {"gravity": "none"})
    result = given.run()  # so that whatever is kept from solving is there
    sent = pickle.dumps((given, result))
    monkeypatch.chdir("/")
    again, known = pickle.loads(sent)
    assert_same(result, again.run())
    assert_same(result, known)
    assert known.save(folder / "out", plots=False).exists()
    assert again.run().missed == result.missed
