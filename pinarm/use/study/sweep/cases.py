"""One case of a sweep: the scenario with other values, solved, and a few numbers of its result."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import DynamicsError, InputError, Location, PinarmError
from pinarm.input.roots import file_root, noting_files
from pinarm.input.units import Unit
from pinarm.input.yaml.document import Document
from pinarm.input.yaml.values import varied
from pinarm.use.result import row_lookup
from pinarm.use.result.measures import MEASURES
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario
from pinarm.use.study.run import run
from pinarm.use.study.sweep.axes import Value

WORTH = (*MEASURES, "global error")
"""What tells the accuracy of a case; the last where the scenario has a target for it."""

_PLACE = re.compile(r"\s*(start|end|max|min|largest)\s*(?:\((.*)\))?\s*")
_KEY = re.compile(r"\s*([^=,]+?)\s*=\s*([^=,]+?)\s*")


@dataclass(frozen=True)
class Wanted:
    """A number, or two, that a sweep takes from the result of each case.

    Attributes:
        quantity: A quantity, a symbol or a formula.
        at: The place on the run, as in ``Expectation.at``; ``None`` for the least and the greatest value of the rows.
        of: The quantity whose extreme is meant, where ``at`` is one.
        unit: Of the numbers in every case; ``None`` where it is not known.
    """

    quantity: str
    at: str | dict[str, str | int | float] | None = None
    of: str = ""
    unit: Unit | None = None

    @classmethod
    def read(cls, text: str) -> Wanted:
        """Read ``QUANTITY`` or ``QUANTITY @ PLACE``.

        A place is ``start``, ``end``, ``max``, ``min`` or ``largest`` (in size), ``max(OTHER)`` for where another
        quantity is largest, or ``t=1.5 s, side=left`` and the like.

        Raises:
            InputError: The place cannot be read.
        """
        quantity, at, place = (part.strip() for part in text.partition("@"))
        problem = InputError(
            f"'{text}' is no result of a case", expected="C_B, C_B @ max, t @ max(C_B), or C_B @ t=1.5 s"
        )
        if not quantity or (at and not place):
            raise problem.at(Location(f"--result {text}"))
        if not at:
            return cls(quantity)
        if named := _PLACE.fullmatch(place):
            if named[2] is not None and (named[1] in ("start", "end") or not named[2].strip()):
                raise problem.at(Location(f"--result {text}"))
            return cls(quantity, named[1], (named[2] or quantity).strip())
        pairs = [_KEY.fullmatch(part) for part in place.split(",")]
        if not all(pairs):
            raise problem.at(Location(f"--result {text}"))
        keys: dict[str, str | int | float] = {pair[1]: pair[2] for pair in pairs if pair}
        if str(keys.get("occurrence", "")).isdigit():
            keys["occurrence"] = int(keys["occurrence"])
        return cls(quantity, keys, quantity)

    def labels(self) -> tuple[str, ...]:
        """Return the names of the numbers."""
        if self.at is None:
            return f"min {self.quantity}", f"max {self.quantity}"
        if isinstance(self.at, dict):
            return (f"{self.quantity} @ {', '.join(f'{key}={value}' for key, value in self.at.items())}",)
        return (f"{self.quantity} @ {self.at}" + (f"({self.of})" if self.of not in ("", self.quantity) else ""),)

    def measured(self, quantities: Quantities) -> tuple[Wanted, list[Series]]:
        """Return the same with its unit, and the columns of its numbers, still empty.

        Args:
            quantities: Those of the scenario, with nothing solved.

        Raises:
            InputError: There is no such quantity.
        """
        try:
            series = quantities[self.quantity]
            if self.of:
                quantities[self.of]
        except InputError as error:
            raise error.at(Location(f"--result {self.quantity if self.at is None else self.labels()[0]}")) from None
        columns = [replace(series, name=label, values=np.zeros(0)) for label in self.labels()]
        return replace(self, unit=series.unit), columns

    def numbers(self, result: Result) -> list[float]:
        """Return the numbers [SI].

        Raises:
            InputError: The place does not exist in this run, or the quantity is of another kind in this case.
            DynamicsError: A number is not finite.
        """
        quantities = result.quantities
        if self.at is not None:
            quantities = row_lookup.at(result, self.at, self.of)
        series = quantities[self.quantity]
        if self.unit and series.unit and series.unit.dimension != self.unit.dimension:
            raise InputError(f"{self.quantity} is in {series.unit} in this case", expected=f"{self.unit}, as in others")
        found = [series.values.min(), series.values.max()] if self.at is None else [series.values[0]]
        if not np.isfinite(found).all():
            raise DynamicsError(f"{self.labels()[0]} is not finite")
        return [float(number) + 0.0 for number in found]  # -0 becomes 0


@dataclass(frozen=True)
class Row:
    """What came out of one case.

    Attributes:
        numbers: Results, then the measures of accuracy in the order of ``WORTH``; nothing where the case failed.
        error: Why it failed; empty where it did not.
        files: The files that it refers to.
        final: Whether solving it again would give the same; not so where the program itself failed.
    """

    numbers: tuple[float, ...]
    error: str = ""
    files: tuple[str, ...] = ()
    final: bool = True


@dataclass(frozen=True)
class Task:
    """What is the same in all cases of a sweep.

    Attributes:
        document: The scenario.
        folder: Folder that paths in it are relative to.
        wanted: What to take from each result.
        root: Folder that files may refer to; each file's own where it is ``None``.
    """

    document: Document
    folder: Path
    wanted: tuple[Wanted, ...]
    root: Path | None = None


def solve_case(task: Task, values: Mapping[str, Value]) -> Row:
    """Solve one case: a function of plain data, for any process on any machine that sees the files.

    Args:
        task: The scenario and what is wanted of it.
        values: Path -> value that replaces that of the scenario.

    Returns:
        The row; that of a case that fails says why.
    """
    with file_root(task.root), noting_files() as files:
        try:
            result = run(Scenario.of(varied(task.document, values), task.folder))
            numbers = [number for entry in task.wanted for number in entry.numbers(result)]
            if result.missed:
                target = result.content.accuracy.target
                return Row(
                    (), f"the global error is {result.error:.1e}, not below its target {target:g}", _names(files)
                )
            figures = {**result.figures, WORTH[-1]: np.nan if result.error is None else result.error}
            return Row((*numbers, *(figures.get(name, np.nan) for name in WORTH)), "", _names(files))
        except PinarmError as error:
            return Row((), _one_line(error), _names(files))
        except Exception as error:  # a fault of the program costs one case, and is told as what it is
            return Row((), f"the program failed: {type(error).__name__}: {error}", _names(files), final=False)


def _names(files: Iterable[Path]) -> tuple[str, ...]:
    return tuple(sorted(map(str, files)))


def _one_line(error: PinarmError) -> str:
    place = f"{error.location}: " if error.location and error.location.line else ""
    return " ".join(f"{place}{error.message}".split())
