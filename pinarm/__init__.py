"""pinarm: a rigid-multibody simulator for mechanisms, on Pinocchio, whose numbers carry their accuracy."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.trajectory import Series, Trajectory
    from pinarm.errors import PinarmError
    from pinarm.input.roots import rooted
    from pinarm.use.check import check
    from pinarm.use.explain import explain
    from pinarm.use.result import Result
    from pinarm.use.scenario import Scenario, load

__version__ = "0.1.0"

_HOMES = {
    "Mechanism": "pinarm.engine.mechanism",
    "Series": "pinarm.engine.trajectory",
    "Trajectory": "pinarm.engine.trajectory",
    "PinarmError": "pinarm.errors",
    "check": "pinarm.use.check",
    "explain": "pinarm.use.explain",
    "Result": "pinarm.use.result",
    "Scenario": "pinarm.use.scenario",
    "load": "pinarm.use.scenario",
    "rooted": "pinarm.input.roots",
}

__all__ = [
    "Mechanism",
    "PinarmError",
    "Result",
    "Scenario",
    "Series",
    "Trajectory",
    "check",
    "explain",
    "load",
    "rooted",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that importing the package costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pinarm' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)
