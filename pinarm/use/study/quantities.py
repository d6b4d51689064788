"""What can be asked of a scenario or of a model, by name."""

from __future__ import annotations

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.catalogue import QuantityCatalogue, catalogue
from pinarm.input.yaml.values import Values
from pinarm.use.study.subject import Subject, subject


def quantities(path: Subject, values: Values | None = None, *, like: str = "") -> QuantityCatalogue:
    """Return what can be asked by name of a scenario, or of a mechanism in motion: names, units, meanings.

    Args:
        path: A scenario or a mechanism, or the file or the data of either; a model file, or the name of a robot.
        values: Other values than those of the file; see ``pinarm.load`` and ``Mechanism.load``.
        like: Part of the name or of the meaning, in any case; all where it is empty.

    Raises:
        PinarmError: The file has a mistake, or the loops cannot be closed.
    """
    meant = subject(path, values)
    if isinstance(meant, Mechanism):
        return meant.quantities(like)
    return catalogue(meant.quantities(), meant.content.title or meant.name, like)
