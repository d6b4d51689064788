"""The methods that scenarios may choose, by name; a new one is a module beside these and an entry here."""

from __future__ import annotations

from collections.abc import Callable

from pinarm.engine.integration.integrator import Method, MethodName
from pinarm.engine.integration.methods.collocation import Collocation
from pinarm.engine.integration.methods.conserving import Conserving
from pinarm.engine.integration.methods.explicit import Adaptive, FixedStep
from pinarm.engine.integration.methods.stiff import Radau
from pinarm.engine.integration.methods.tableaus import DOPRI5

METHODS: dict[MethodName, Callable[[float], Method]] = {
    "dop853": Adaptive,
    "dopri5": lambda tolerance: Adaptive(tolerance, DOPRI5),
    "rk4": FixedStep,
    "stiff": Radau.of,
    "conserving": Conserving,
    "collocation": Collocation,
}
"""Name -> what makes the method of its tolerance, or of the length of its steps."""
