"""Time integration of ``q' = velocity(q, v)``, ``v' = acceleration(t, q, v)``; nothing here knows of mechanisms.

A method is a frozen dataclass in a module of its own; ``METHODS`` has an entry for each that scenarios may choose.
Methods are imported when they are first used: most problems integrate nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pinarm.engine.integration.integrator import (
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
    from pinarm.engine.integration.batch_driver import advance
    from pinarm.engine.integration.batch_solution import Ensemble
    from pinarm.engine.integration.driver import integrate
    from pinarm.engine.integration.events import Watch
    from pinarm.engine.integration.methods import METHODS
    from pinarm.engine.integration.methods.collocation import Collocation
    from pinarm.engine.integration.methods.conserving import Conserving
    from pinarm.engine.integration.methods.explicit import Adaptive, FixedStep
    from pinarm.engine.integration.methods.stiff import Radau

__all__ = [
    "METHODS", "SAME", "SETTING", "Acceleration", "Accelerations", "Adaptive", "Collocation", "Conserving", "Energy",
    "Ensemble", "FixedStep", "Flat", "Manifold", "Method", "MethodName", "Passes", "Radau", "Settle", "Solution",
    "Stretch", "Watch", "advance", "integrate",
]  # fmt: skip

_HOMES = {
    "METHODS": "methods", "Adaptive": "methods.explicit", "Collocation": "methods.collocation",
    "Conserving": "methods.conserving", "Ensemble": "batch_solution", "FixedStep": "methods.explicit",
    "Radau": "methods.stiff", "Watch": "events", "advance": "batch_driver", "integrate": "driver",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a method when it is first asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
