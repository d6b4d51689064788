"""What can be asked of a scenario or of a model, by name."""

from __future__ import annotations

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.catalogue import QuantityCatalogue, catalogue, catalogue_of
from pinarm.engine.quantities.names import Quantities
from pinarm.input.yaml.values import Values
from pinarm.problems.forward import Forward
from pinarm.problems.time_grid import TimeGrid
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
        return catalogue_of(meant, like)
    return catalogue(meant.quantities(), meant.content.title or meant.name, like)


def check_symbols(mechanism: Mechanism) -> None:
    """Raise where a symbol of a mechanism file stands for what no free motion of the mechanism has.

    Raises:
        InputError: Says which, and where it stands.
    """
    motion = Forward(time=TimeGrid(end=1.0, samples=2))
    Quantities(motion.schema_row(mechanism)).check_symbols(mechanism.symbols, mechanism.locate)
