"""Assessments: what is concluded from a run, each asked for by a key of the scenario and told as a section.

Each is imported when a scenario first asks for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

from pinarm.input.yaml.schema import Deferred

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.quantities.names import Quantities
    from pinarm.input.units import Unit
    from pinarm.use.result.result import Result
    from pinarm.use.result.section import Section
    from pinarm.use.scenario.scenario import Scenario

ASSESSMENTS: Deferred = {
    "shaking": ("pinarm.use.assessments.shaking", "Shaking"),
    "sizing": ("pinarm.use.assessments.sizing.sizing", "Sizing"),
    "loads": ("pinarm.use.assessments.loads.loads", "Loads"),
    "path_error": ("pinarm.use.assessments.path_error", "PathError"),
    "limits": ("pinarm.use.assessments.limits", "Limits"),
    "response": ("pinarm.use.assessments.response", "Response"),
    "sensitivity": ("pinarm.use.assessments.sensitivity.sensitivity", "Sensitivity"),
}
"""Key of a scenario -> module and class. A new one is a class, an entry here, and the key in ``ScenarioFile``."""


FILES = {"sizing": "catalogue", "path_error": "wanted"}
"""Assessment -> the key of it that may name a file, which a result folder keeps."""


class Assessment(Protocol):
    """What a scenario asks to conclude from its run, as it stands in a file."""

    def requested(self, mechanism: Mechanism) -> list[str]:
        """Return the quantities and formulas that it needs, so that the joints in them are solved for."""
        ...

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]: ...

    def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
        """Check its names and units, with nothing solved.

        Args:
            quantities: Those of one row.
            scenario: What asks for it.

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
    from pinarm.use.assessments.limits import Limits
    from pinarm.use.assessments.loads.loads import Loads
    from pinarm.use.assessments.path_error import PathError
    from pinarm.use.assessments.response import Response
    from pinarm.use.assessments.sensitivity.sensitivity import Sensitivity
    from pinarm.use.assessments.shaking import Shaking
    from pinarm.use.assessments.sizing.sizing import Sizing

    _CLASSES: tuple[type[Assessment], ...] = (Shaking, Sizing, Loads, PathError, Limits, Response, Sensitivity)
