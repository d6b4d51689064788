"""One number of a run, as ``QUANTITY @ PLACE`` or ``QUANTITY @ FIGURE`` asks for it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pinarm.engine.quantities.names import EXTREMES, OPEN, Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.numbers import is_whole
from pinarm.records import ValueRecord, replace
from pinarm.use.result.curve_figures import FIGURES, figure, figure_unit, is_figure, stands_alone
from pinarm.use.result.row_lookup import located

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.result.row_lookup import Lookup

EXAMPLES = "C_B @ max, t @ max(C_B), C_B @ t=1.5 s, C_B @ rms, C_B @ p95, or loads.B.life.time of a section"

MAX_LENGTH = 2000
"""Characters of a text that is read at all."""

_PLACE = re.compile(r"(start|end|max|min|largest)(?:\((.*)\))?")


class RunNumber(ValueRecord, frozen=True):
    """What is asked of a run: a quantity at a place, or a figure of its curve.

    Attributes:
        quantity: A quantity, a symbol or a formula.
        at: A place, as in ``Expectation.at``, or a figure, as in ``curve_figures``.
        of: The quantity whose extreme is meant, where ``at`` is one.
    """

    quantity: str
    at: str | dict[str, str | int | float]
    of: str

    @classmethod
    def read(cls, text: str) -> RunNumber:
        """Read ``QUANTITY @ PLACE`` or ``QUANTITY @ FIGURE``.

        A place is ``start``, ``end``, ``max``, ``min`` or ``largest`` (in size), ``max(OTHER)`` for where another
        quantity is largest, or ``t=1.5 s, side=left`` and the like; a figure is ``mean``, ``rms``, ``integral``,
        ``peak`` or a percentage such as ``p95``.

        Raises:
            InputError: It cannot be read.
        """
        quantity, _, place = (part.strip() for part in text.partition("@"))
        problem = InputError(f"'{text[:200]}' is no number of a run", expected=EXAMPLES)
        if not quantity or not place or len(text) > MAX_LENGTH:
            raise problem
        if is_figure(place):
            return cls(quantity, place, quantity)
        if named := _PLACE.fullmatch(place):
            if named[2] is not None and (named[1] in ("start", "end") or not named[2].strip()):
                raise problem
            return cls(quantity, named[1], (named[2] or quantity).strip())
        pairs = [tuple(part.strip() for part in each.split("=")) for each in place.split(",")]
        if not all(len(pair) == 2 and all(pair) for pair in pairs):
            raise InputError(problem.message, expected=f"{EXAMPLES}; figures are {', '.join(FIGURES)}, p0 to p100")
        keys: dict[str, str | int | float] = {pair[0]: pair[1] for pair in pairs}
        if is_whole(occurrence := str(keys.get("occurrence", ""))):
            keys["occurrence"] = int(occurrence)
        return cls(quantity, keys, quantity)

    @property
    def label(self) -> str:
        """Its name; of a quantity at the start that is named without a place, as events are, its own."""
        if self.at == "start" and self.quantity.partition(".")[0] == "event":
            return self.quantity
        if isinstance(self.at, dict):
            return f"{self.quantity} @ {', '.join(f'{key}={value}' for key, value in self.at.items())}"
        return f"{self.quantity} @ {self.at}" + (f"({self.of})" if self.of != self.quantity else "")

    @property
    def figure(self) -> str:
        """The figure of the curve; a place where it is asked at one."""
        return self.at if isinstance(self.at, str) else ""

    @property
    def amount(self) -> RunNumber:
        """What a bound compares and a search makes least: of ``@ largest``, which has a sign, its size."""
        return replace(self, at="peak") if self.at == "largest" and self.of == self.quantity else self

    def described(self, quantities: Quantities, sections: Mapping[str, object]) -> Series:
        """Return its name and unit as a series without values.

        Args:
            quantities: Those of the scenario; nothing has to be solved.
            sections: What its sections are of, by key, which a number of a curve does not need.

        Raises:
            InputError: There is no such quantity or place, or the rows are no motion and have no figures.
        """
        series, _ = quantities[self.quantity], quantities[self.of]
        if isinstance(self.at, dict):
            located(self.at, quantities)
        if quantities.trajectory.sampled and is_figure(self.figure) and self.figure != "peak":
            raise stands_alone(quantities.trajectory, self.quantity, self.figure)
        unit = figure_unit(quantities, self.quantity, self.at) if isinstance(self.at, str) else series.unit
        return Series(self.label, unit, np.zeros(0))

    def value(self, result: Result) -> tuple[float, float]:
        """Return the number [SI] and its error: of a quadrature, or of the search for a place; else 0.

        Raises:
            InputError: The place does not exist in this run, or the run has no such figure.
        """
        found = self.told(result.lookup)
        if result.trajectory.others and any(
            result.quantities.open_rows(name).any() for name in (self.quantity, self.of)
        ):
            self._require_determined(result, found[0])
        return found

    def told(self, run: Lookup) -> tuple[float, float]:
        """Return the number of a run in which friction leaves nothing open; see ``value``."""
        if isinstance(self.at, str) and is_figure(self.at):
            given = figure(run, self.quantity, self.at)
            return given.value, given.error
        if self.at in ("max", "min", "largest"):
            if self.of != self.quantity:
                return run.at_extreme(self.at, self.of, self.quantity)
            row, error = run.extreme(self.at, self.of)
            return float(row[self.quantity].values[0]), error
        if isinstance(self.at, dict):
            return run.at_instant(self.at, self.quantity)
        return float(run.at(self.at, self.of)[self.quantity].values[0]), 0.0

    def _require_determined(self, result: Result, told: float) -> None:
        """Raise where the number would be another one with other frictions that hold the same motion.

        Raises:
            InputError: Says between which values it lies.
        """
        place = isinstance(self.at, str)
        ends = [
            replace(self, quantity=f"{self.quantity}.{extreme}", of=f"{self.of}.{extreme}" if place else self.of)
            for extreme in EXTREMES
        ]
        bounds = [series.values for series in result.quantities.bounds(self.quantity)]
        endless = place and np.isinf(bounds).any()
        values = np.ravel(bounds if endless else [each.told(result.lookup)[0] for each in ends])
        low, high, finite = values.min(), values.max(), values[np.isfinite(values)]
        if high - low > OPEN * max(np.abs(finite).max(initial=0.0), abs(told)):
            unit = result[self.quantity].unit
            raise InputError(
                f"'{self.label}' is not determined: several frictions or stops hold one motion, and it lies between "
                f"{low:.6g} and {high:.6g} {unit or ''}",
                expected="a number that does not depend on which of them holds how much",
                hint=f"'{ends[0].label}' or '{ends[1].label}'",
            )
