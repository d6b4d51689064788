"""pinarm: a rigid-multibody simulator for mechanisms, on Pinocchio, whose numbers carry their accuracy."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.trajectory import Series, Trajectory
    from pinarm.errors import PinarmError
    from pinarm.input.roots import rooted
    from pinarm.use.batch.motions import Batch, batch
    from pinarm.use.check import check
    from pinarm.use.explain import explain
    from pinarm.use.replay.page import replay
    from pinarm.use.result import Result
    from pinarm.use.run import run, validate
    from pinarm.use.scenario import Scenario, load
    from pinarm.use.schema import schema
    from pinarm.use.sweep.study import Sweep, sweep
    from pinarm.use.tradeoff.study import Tradeoff, tradeoff

__version__ = "0.1.0"

if "pinocchio" not in sys.modules and "OMP_WAIT_POLICY" not in os.environ:
    # threads of OpenMP that wait busily cost others their cores, and calls milliseconds; to wake them up costs 75 us:
    # GNU's wait busily for 0.4 ms, from one call of a batch to the next
    os.environ["OMP_WAIT_POLICY"] = "passive"
    os.environ.setdefault("GOMP_SPINCOUNT", "20000")

_HOMES = {
    "Mechanism": "pinarm.engine.mechanism",
    "Series": "pinarm.engine.trajectory",
    "Trajectory": "pinarm.engine.trajectory",
    "PinarmError": "pinarm.errors",
    "Batch": "pinarm.use.batch.motions",
    "batch": "pinarm.use.batch.motions",
    "check": "pinarm.use.check",
    "explain": "pinarm.use.explain",
    "Result": "pinarm.use.result",
    "Scenario": "pinarm.use.scenario",
    "Sweep": "pinarm.use.sweep.study",
    "Tradeoff": "pinarm.use.tradeoff.study",
    "load": "pinarm.use.scenario",
    "replay": "pinarm.use.replay.page",
    "rooted": "pinarm.input.roots",
    "run": "pinarm.use.run",
    "schema": "pinarm.use.schema",
    "sweep": "pinarm.use.sweep.study",
    "tradeoff": "pinarm.use.tradeoff.study",
    "validate": "pinarm.use.run",
}

__all__ = [
    "Batch", "Mechanism", "PinarmError", "Result", "Scenario", "Series", "Sweep", "Tradeoff", "Trajectory", "batch",
    "check", "explain", "load", "replay", "rooted", "run", "schema", "sweep", "tradeoff", "validate",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that importing the package costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pinarm' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)
