"""What a question is about that a scenario as well as a mechanism answers: what there is, and what can be asked."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.mechanism_loading import load_mechanism, mechanism_of_data
from pinarm.errors import InputError
from pinarm.input.yaml.document import Document
from pinarm.input.yaml.values import Values
from pinarm.use.scenario.file_kind import is_mechanism, refuse_ambiguous
from pinarm.use.scenario.scenario import Scenario, load

Subject: TypeAlias = str | Path | Mechanism | Scenario | Mapping[str, Any]
"""A scenario or a mechanism, the data or the file of either, a model file, or the name of a robot."""


def subject(given: Subject, values: Values | None = None) -> Scenario | Mechanism:
    """Return the scenario or the mechanism that is meant.

    Args:
        given: It, its data, or its file; a model file, or the name of a robot.
        values: Other values than those of the file; see ``pinarm.load`` and ``Mechanism.load``.

    Raises:
        PinarmError: It has a mistake, or is neither; or it is a mechanism that was made already, with other values.
    """
    if isinstance(given, Mechanism) or (isinstance(given, Mapping) and is_mechanism(given)):
        if values:
            raise InputError("the mechanism is given as such, which other values do not change",
                             expected="its file, or the changes where it is made")  # fmt: skip
        return given if isinstance(given, Mechanism) else mechanism_of_data(given)
    if not isinstance(given, str | PathLike):
        return load(given, values)
    file = Path(given)
    refuse_ambiguous(file)
    if file.suffix in (".yaml", ".yml"):
        data = Document.read(file).data
        if isinstance(data, Mapping) and "problem" in data:
            return Scenario.load(file, values)
    return load_mechanism(given, values=values)
