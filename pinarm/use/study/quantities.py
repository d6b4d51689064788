"""Names that can be asked of a scenario or of a mechanism, which a path, data or an object stands for; their keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.mechanism_loading import load_mechanism, mechanism_of_data
from pinarm.engine.quantities.catalogue import QuantityCatalogue, catalogue, catalogue_of
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.input.yaml.document import Document, Values, joined
from pinarm.problems.forward import Forward
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.facade import Scenario, load
from pinarm.use.scenario.file_kind import is_mechanism, refuse_folder
from pinarm.use.scenario.scenario import mechanism_data

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
            raise InputError(
                "the mechanism is given as such, which other values do not change",
                expected="its file, or the changes where it is made",
            )
        return given if isinstance(given, Mechanism) else mechanism_of_data(given)
    if not isinstance(given, str | PathLike):
        return load(given, values)
    file = Path(given)
    refuse_folder(file)
    if file.suffix in (".yaml", ".yml"):
        data = Document.read(file).data
        if isinstance(data, Mapping) and "problem" in data:
            return Scenario.load(file, values)
    return load_mechanism(given, values=values)


def quantities(path: Subject, values: Values | None = None, *, like: str = "") -> QuantityCatalogue:
    """Return the quantities of a scenario, or of a mechanism in motion: names, units, meanings.

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
    """Raise where a symbol of a mechanism file stands for what no free motion of the mechanism has."""
    motion = Forward(time=TimeGrid(end=1.0, samples=2))
    Quantities(motion.schema_row(mechanism)).check_symbols(mechanism.symbols, mechanism.locate)


def dotted_keys(file: str | Path, prefix: str = "") -> list[str]:
    """Return the paths of keys one step further than a prefix: ``problem.time.end=``, or ``problem.time.`` of a map.

    Args:
        file: A scenario, whose mechanism file has the keys below ``changes`` and ``arguments``, or a mechanism file.
        prefix: Beginning of the path.

    Raises:
        InputError: The file cannot be read.
    """
    data = _children(Document.read(Path(file)).data)
    if not is_mechanism(data):
        mechanism = mechanism_data(data, Path(file).parent)
        data |= {"changes": mechanism, "arguments": mechanism.get("arguments")}
    while True:
        paths = [*_further(prefix, data)]
        if len(paths) != 1 or not paths[0].endswith(".") or paths[0] == prefix:
            return paths
        prefix = paths[0]  # the shell would put a blank behind it


def _further(prefix: str, data: Mapping[Any, Any], at: tuple[Any, ...] = ()) -> Iterator[str]:
    for name, inner in data.items():
        below, path = _children(inner), joined((*at, name))
        if prefix.startswith(f"{path}."):
            yield from _further(prefix, below, (*at, name))
        elif path.startswith(prefix):
            yield f"{path}{'.' if below else '='}"


def _children(data: Any) -> dict[Any, Any]:
    return dict(data if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else {})
