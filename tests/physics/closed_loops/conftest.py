"""The shipped models and scenarios of closed loops, for tests against the references beside this file."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import pytest

import pinarm
from pinarm.engine.mechanism_loading import read_mechanism
from pinarm.engine.quantities.names import Quantities
from pinarm.problems import problem_class
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.time_grid import TimeGrid

MODELS = Path(pinarm.__file__).parents[1] / "models"


@pytest.fixture
def solve(outcome):
    """Return a function that solves a problem of a shipped model: its quantities."""
    return lambda *given, **content: Quantities(outcome(*given, **content).rows)


@pytest.fixture
def outcome():
    """Return a function that solves a problem of a shipped model."""

    def solve(model, kind, *, arguments=None, gravity=None, end=1.0, samples=101, tolerance=1e-12, **content):
        mechanism = model
        if isinstance(model, str):
            mechanism = read_mechanism(MODELS / model / "mechanism.yaml", arguments or {}, gravity=gravity)
        if kind in ("inverse", "forward", "kinematics"):
            content["time"] = TimeGrid(end=end, samples=samples)
        problem = problem_class(kind)(**content)
        return problem.solve(mechanism, Accuracy(tolerance=tolerance), lambda *path: nullcontext())

    return solve
