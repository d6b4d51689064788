"""Time integration of ``q' = velocity(q, v)``, ``v' = acceleration(t, q, v)``; nothing here knows of mechanisms.

A method is a frozen dataclass in a module of its own; ``METHODS`` has an entry for each that scenarios may choose.
Methods are imported when they are first used: most problems integrate nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pinarm.engine.integrators.contract import (
    SAME,
    SETTING,
    Acceleration,
    Accelerations,
    Energy,
    Flat,
    Manifold,
    Method,
    MethodName,
    Passes,
    Settle,
    Solution,
    Stretch,
)  # fmt: skip

if TYPE_CHECKING:
    from pinarm.engine.integrators.collocation import Collocation
    from pinarm.engine.integrators.conserving import Conserving
    from pinarm.engine.integrators.ensemble import Ensemble
    from pinarm.engine.integrators.events import Watch
    from pinarm.engine.integrators.explicit import Adaptive, FixedStep
    from pinarm.engine.integrators.lockstep import advance
    from pinarm.engine.integrators.march import integrate
    from pinarm.engine.integrators.methods import METHODS
    from pinarm.engine.integrators.stiff import Radau

__all__ = [
    "METHODS", "SAME", "SETTING", "Acceleration", "Accelerations", "Adaptive", "Collocation", "Conserving", "Energy",
    "Ensemble", "FixedStep", "Flat", "Manifold", "Method", "MethodName", "Passes", "Radau", "Settle", "Solution",
    "Stretch", "Watch", "advance", "integrate",
]  # fmt: skip

_HOMES = {
    "METHODS": "methods", "Adaptive": "explicit", "Collocation": "collocation", "Conserving": "conserving",
    "Ensemble": "ensemble", "FixedStep": "explicit", "Radau": "stiff", "Watch": "events", "advance": "lockstep",
    "integrate": "march",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a method when it is first asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
