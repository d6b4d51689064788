"""Mechanisms, scenarios and results go to other processes, and are the same there."""

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm

ROOT = Path(__file__).parents[3]
WAYS: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)), "deepcopy": copy.deepcopy,
}  # fmt: skip

SCENARIOS = [
    "andrews_squeezing", "gen411_arm_equilibria", "hoist_with_losses", "magic_arms_kinematics",
    "manipulator_counterweight",
]  # fmt: skip
"""A loop with a two-point spring, a motor with losses, several kinds of problem, and a search."""


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


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_result_is_the_same_in_another_process(name: str, way: str, solved: Callable[[str], pinarm.Result]) -> None:
    result = solved(name)
    assert_same(result, WAYS[way](WAYS[way](result)))


@pytest.fixture(scope="module")
def solved() -> Callable[[str], pinarm.Result]:
    known: dict[str, pinarm.Result] = {}
    return lambda name: known.setdefault(name, known.get(name) or pinarm.run(ROOT / "scenarios" / f"{name}.yaml"))


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
