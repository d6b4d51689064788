"""Assessments: what is concluded from a run, each asked for by a key of the scenario and told as a section.

Each is imported when a scenario first asks for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from pinarm.input.yaml.deferred import Deferred

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.quantities.names import Quantities
    from pinarm.use.result.result import Result
    from pinarm.use.result.section import Section

ASSESSMENTS: Deferred = {
    "shaking": ("pinarm.use.assessments.shaking", "Shaking"),
    "sizing": ("pinarm.use.assessments.sizing.sizing", "Sizing"),
    "loads": ("pinarm.use.assessments.loads.loads", "Loads"),
}
"""Key of a scenario -> module and class. A new one is a class, an entry here, and the key in ``ScenarioFile``."""


class Assessment(Protocol):
    """What a scenario asks to conclude from its run, as it stands in a file."""

    def requested(self, mechanism: Mechanism) -> list[str]:
        """Return the quantities and formulas that it needs, so that the joints in them are solved for."""
        ...

    def check_names(self, quantities: Quantities) -> None:
        """Check its names and units against the quantities of one row, with nothing solved.

        Raises:
            InputError: A name does not exist, or a value has another dimension.
        """
        ...

    def evaluate(self, result: Result) -> Section:
        """Return what it finds in a result.

        Raises:
            InputError: The run does not have what it needs.
        """
        ...


if TYPE_CHECKING:  # mypy compares the classes with the protocol, which are imported by name
    from pinarm.use.assessments.loads.loads import Loads
    from pinarm.use.assessments.shaking import Shaking
    from pinarm.use.assessments.sizing.sizing import Sizing

    _CLASSES: tuple[type[Assessment], ...] = (Shaking, Sizing, Loads)
