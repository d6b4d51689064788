"""Time integration of ``q' = velocity(q, v)``, ``v' = acceleration(t, q, v)``; nothing here knows of mechanisms.

A method is a frozen dataclass in a module of its own; ``METHODS`` has an entry for each that scenarios may choose.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from pinarm.engine.integrators.conserving import Conserving
from pinarm.engine.integrators.contract import Acceleration, Energy, Flat, Manifold, Method, Settle, Solution, Stretch
from pinarm.engine.integrators.events import Watch
from pinarm.engine.integrators.explicit import Adaptive, FixedStep
from pinarm.engine.integrators.march import integrate
from pinarm.engine.integrators.stiff import Radau
from pinarm.engine.tableaus import DOPRI5

__all__ = [
    "METHODS", "Acceleration", "Adaptive", "Conserving", "Energy", "FixedStep", "Flat", "Manifold", "Method",
    "MethodName", "Radau", "Settle", "Solution", "Stretch", "Watch", "integrate",
]  # fmt: skip

MethodName = Literal["dop853", "dopri5", "rk4", "stiff", "conserving"]


class Choice(NamedTuple):
    """A method as scenarios choose it: by its tolerance, or by the length of its steps."""

    by: Literal["tolerance", "step"]
    make: Callable[[float], Method]


METHODS: dict[MethodName, Choice] = {
    "dop853": Choice("tolerance", Adaptive),
    "dopri5": Choice("tolerance", lambda tolerance: Adaptive(tolerance, DOPRI5)),
    "rk4": Choice("step", FixedStep),
    "stiff": Choice("tolerance", Radau),
    "conserving": Choice("tolerance", Conserving),
}
