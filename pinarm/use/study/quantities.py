"""What can be asked of a scenario or of a model, by name."""

from __future__ import annotations

from pathlib import Path

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.catalogue import QuantityCatalogue, catalogue
from pinarm.input.yaml.document import Document
from pinarm.input.yaml.values import Values
from pinarm.use.scenario.file_kind import refuse_ambiguous
from pinarm.use.scenario.scenario import Scenario


def quantities(path: str | Path, values: Values | None = None, *, like: str = "") -> QuantityCatalogue:
    """Return what can be asked by name of a scenario, or of a mechanism in motion: names, units, meanings.

    Args:
        path: A scenario, a mechanism file, a model file, or the name of a robot.
        values: Other values than those of the file; see ``pinarm.load`` and ``Mechanism.load``.
        like: Part of the name or of the meaning, in any case; all where it is empty.

    Raises:
        PinarmError: The file has a mistake, or the loops cannot be closed.
    """
    file = Path(path)
    refuse_ambiguous(file)
    if file.suffix in (".yaml", ".yml") and "problem" in (Document.read(file).data or {}):
        scenario = Scenario.load(file, values)
        return catalogue(scenario.quantities(), scenario.content.title or scenario.name, like)
    return Mechanism.load(path, values=values).quantities(like)
