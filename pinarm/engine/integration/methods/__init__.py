"""The methods of integration that scenarios may choose, by name.

A new method is a module beside these with a class, which joins ``Method``, and its ``Stepper``, and an entry in
``METHODS``. The names in files, their JSON Schema, the tests of order and of events, the search for a tolerance and
the trade-off follow the table. A module is imported when a method of it is made: a run loads the one that it uses.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Literal

from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Method

    MethodName = str

Setting = Literal["tolerance", "step"]
"""The key of ``accuracy`` that decides the error of a method."""


class Entry(ValueRecord, frozen=True):
    """A method that scenarios may choose.

    Attributes:
        module: Module in this package that defines it.
        factory: Class or function in the module that returns the method, of the tolerance or of the longest step [s].
        setting: Which of the two it takes.
        summary: Its order and its use, for the JSON Schema.
        finest: Finest setting that a trade-off tries: the tolerance ``10^-finest``, or the span by ``16 2^finest``.
    """

    module: str
    factory: str
    setting: Setting
    summary: str
    finest: int

    def make(self, value: float) -> Method:
        """Return the method of a tolerance, or of a longest step [s]; see ``setting``."""
        method: Method = getattr(import_module(f"{__name__}.{self.module}"), self.factory)(value)
        return method


METHODS: dict[MethodName, Entry] = {
    "dop853": Entry(
        "explicit", "Adaptive", "tolerance", "Dormand-Prince 8(5,3), order 8, adaptive: for smooth motions", finest=12
    ),
    "dopri5": Entry(
        "explicit", "dopri5", "tolerance", "Dormand-Prince 5(4), order 5, adaptive: for rough motions", finest=10
    ),
    "rk4": Entry("explicit", "FixedStep", "step", "Runge-Kutta 4, order 4, steps of one length", finest=7),
    "stiff": Entry(
        "stiff",
        "radau_of",
        "tolerance",
        "Radau IIA, order 5, 9 or 13, adaptive, implicit: for stiff springs with dampers",
        finest=7,
    ),
}
"""Name -> method. The search for a tolerance tries them in this order, the other way round where a motion is stiff."""

REMOVED: dict[MethodName, MethodName] = {"conserving": "dop853", "collocation": "dop853"}
"""Methods of earlier versions -> the method that integrates the motions of files that name them."""

if not TYPE_CHECKING:
    MethodName = Literal[tuple(METHODS | REMOVED)]
    """Names of the methods, as files may give them; type checkers see a ``str``."""


def described() -> str:
    """Return the names of the methods with their summaries, for the JSON Schema."""
    return "; ".join(f"{name}: {entry.summary}" for name, entry in METHODS.items())
