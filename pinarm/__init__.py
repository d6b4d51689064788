"""pinarm: a rigid-multibody simulator for mechanisms, on Pinocchio, whose numbers carry their accuracy."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.engine.series import Series
    from pinarm.errors import PinarmError
    from pinarm.input.roots import file_root
    from pinarm.language import writing
    from pinarm.use.facade import Result, Scenario, load
    from pinarm.use.mechanism import Mechanism
    from pinarm.use.report.report import report
    from pinarm.use.scenario.json_schema import schema
    from pinarm.use.start.new import examples, new
    from pinarm.use.study.answers.check import check
    from pinarm.use.study.answers.selftest import SelfTest, selftest
    from pinarm.use.study.explain import equations, explain, isolate
    from pinarm.use.study.lab import Sheet, lab
    from pinarm.use.study.quantities import quantities
    from pinarm.use.study.recorded import result
    from pinarm.use.study.restore import replay, restore
    from pinarm.use.study.run import run, validate
    from pinarm.use.study.sweep.batches import Batch, batch
    from pinarm.use.study.sweep.sweep import sweep
    from pinarm.use.study.sweep.table import Sweep
    from pinarm.use.study.tradeoff import Tradeoff, tradeoff

__version__ = "0.1.0"

_HOMES = {
    "Mechanism": "pinarm.use.mechanism",
    "Series": "pinarm.engine.series",
    "Trajectory": "pinarm.engine.motion.trajectory",
    "PinarmError": "pinarm.errors",
    "Batch": "pinarm.use.study.sweep.batches",
    "batch": "pinarm.use.study.sweep.batches",
    "check": "pinarm.use.study.answers.check",
    "equations": "pinarm.use.study.explain",
    "examples": "pinarm.use.start.new",
    "explain": "pinarm.use.study.explain",
    "Result": "pinarm.use.facade",
    "Scenario": "pinarm.use.facade",
    "Sweep": "pinarm.use.study.sweep.table",
    "Tradeoff": "pinarm.use.study.tradeoff",
    "Sheet": "pinarm.use.study.lab",
    "lab": "pinarm.use.study.lab",
    "isolate": "pinarm.use.study.explain",
    "load": "pinarm.use.facade",
    "new": "pinarm.use.start.new",
    "replay": "pinarm.use.study.restore",
    "quantities": "pinarm.use.study.quantities",
    "report": "pinarm.use.report.report",
    "restore": "pinarm.use.study.restore",
    "result": "pinarm.use.study.recorded",
    "file_root": "pinarm.input.roots",
    "run": "pinarm.use.study.run",
    "schema": "pinarm.use.scenario.json_schema",
    "SelfTest": "pinarm.use.study.answers.selftest",
    "selftest": "pinarm.use.study.answers.selftest",
    "sweep": "pinarm.use.study.sweep.sweep",
    "tradeoff": "pinarm.use.study.tradeoff",
    "validate": "pinarm.use.study.run",
    "writing": "pinarm.language",
}

__all__ = [
    "Batch", "Mechanism", "PinarmError", "Result", "Scenario", "SelfTest", "Series", "Sheet", "Sweep", "Tradeoff",
    "Trajectory", "batch", "check", "equations", "examples", "explain", "file_root", "isolate", "lab", "load", "new",
    "quantities", "replay", "report", "restore", "result", "run", "schema", "selftest", "sweep", "tradeoff", "validate",
    "writing",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that importing the package costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pinarm' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """Return the public names."""
    return [*__all__, "__version__"]
