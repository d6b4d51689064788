"""Limits that numbers of a run must keep to, with the margins that are left.

The relative margin is that of the bound, ``(b - x) / |b|`` for ``x < b``. A number that is nearer to its bound than its
own error is neither within the limit nor beyond it. One that is NaN, as what a run does not come to, is beyond its
limit; its margin is not known, and so the least of all is not either. Of ``X @ largest`` the size is compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np

from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, within
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.input.yaml.schema import InputStruct, check_unit
from pinarm.use.result.number_accuracy import global_error
from pinarm.use.result.numbers import Condition, measured, read_conditions, slug
from pinarm.use.result.section import Cell, Section, SectionTable

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

KEPT, BEYOND, OPEN = "kept", "beyond", "within its error"


class Limits(InputStruct, frozen=True):
    """Limits of numbers of the run.

    Attributes:
        keep: Number of the run -> its bound, such as ``{C_B @ rms: < 30 N*m, loads.B.life.time: '> 20000 h'}``; of
            ``C_B @ largest`` the amount is compared.
    """

    keep: Annotated[dict[str, str], msgspec.Meta(min_length=1, max_length=100)]

    def check(self) -> None:
        names = [slug(condition.number) for condition in self.conditions]
        for text, condition in zip(self.keep, self.conditions, strict=True):
            with within("keep", text):
                if condition.relation == "=":
                    raise InputError("'=' is no limit", expected="'<' or '>', or the value under expect")
                if names.count(slug(condition.number)) > 1:
                    raise InputError(f"'{text}' has the name of another number, '{slug(condition.number)}'")

    @property
    def conditions(self) -> list[Condition]:
        with within("keep"):
            return read_conditions(self.keep)

    def requested(self, mechanism: Mechanism) -> list[str]:
        return list(self.keep)

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        margins = {f"{slug(condition.number)}.margin": _unit(condition, quantities) for condition in self.conditions}
        return {**margins, "least_margin": DIMENSIONLESS, "beyond": DIMENSIONLESS}

    def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
        others = {key: asked for key, asked in scenario.numbered.items() if asked is not self}
        for condition in self.conditions:
            with within("keep", condition.number.label):
                unit = condition.number.described(quantities, others).unit
                check_unit(condition.bound, unit or DIMENSIONLESS)

    def evaluate(self, result: Result) -> Section:
        """Return every number beside its bound: see ``Assessment``."""
        self.check_names(result.quantities, result.scenario)
        compared = [_compared(condition, result) for condition in self.conditions]
        beyond = sum(number.verdict == BEYOND for number in compared)
        relative = [number.relative for number in compared]
        nearest = compared[int(np.argmin(relative))]  # NaN where any is
        numbers = {
            number.name: Series(
                f"margin of {number.condition.number.label}", number.value.unit, np.array([number.margin])
            )
            for number in compared
        }
        numbers["least_margin"] = Series("least margin", DIMENSIONLESS, np.array([nearest.relative]))
        numbers["beyond"] = Series("limits not kept", DIMENSIONLESS, np.array([float(beyond)]))
        remarks = [
            f"beyond its limit: {number.condition} is {number.text}" for number in compared if number.verdict == BEYOND
        ]
        remarks += [
            f"neither kept nor beyond: {number.condition} is {number.text}, with {error_words(number.known)}"
            for number in compared
            if number.verdict == OPEN
        ]
        columns = ("", "value", "limit", "margin [%]", "error", "")
        table = SectionTable(
            "limits", "Numbers and their limits", columns, (None,) * len(columns), [number.row() for number in compared]
        )
        size = abs(float(nearest.condition.bound))
        errors = {number.name: number.known for number in compared}
        errors["least_margin"] = nearest.known / size if size else 0.0
        return Section("limits", "Limits", [table], numbers, remarks, errors=errors)


@dataclass(frozen=True)
class _Compared:
    """A number beside its bound.

    Attributes:
        condition: What it must keep to.
        value: The number, with its unit.
        bound: Bound of its error [SI]; ``None`` where it is not estimated.
        known: What is known of its error [SI]: the bound, or where there is none what its quadrature leaves.
    """

    condition: Condition
    value: Series
    bound: float | None
    known: float

    @property
    def name(self) -> str:
        return f"{slug(self.condition.number)}.margin"

    @property
    def margin(self) -> float:
        return self.condition.margin(float(self.value.values[0]))

    @property
    def relative(self) -> float:
        """The margin as a part of the bound; of a bound of 0, with the sign of the margin and no size."""
        bound = abs(float(self.condition.bound))
        return self.margin / bound if bound else float(np.sign(self.margin) * np.inf) if self.margin else 0.0

    @property
    def verdict(self) -> str:
        if abs(self.margin) < self.known:
            return OPEN
        return KEPT if self.margin >= 0.0 else BEYOND

    @property
    def text(self) -> str:
        value, unit = self._as_bound(float(self.value.values[0])), self.condition.bound.unit
        return f"{value:.6g} {unit}" if unit else f"{value:.6g}"

    def _as_bound(self, value: float) -> float:
        """Return a value in SI in the unit of its bound."""
        unit = self.condition.bound.unit
        return value / unit.factor if unit else value

    def row(self) -> tuple[Cell, ...]:
        bound = f"{self.condition.relation} {self.condition.bound_text}"
        error: Cell = (
            "not estimated"
            if self.bound is None
            else (f"{self._as_bound(self.bound):.1e}" if np.isfinite(self.bound) else "no bound")
        )
        return self.condition.number.label, self.text, bound, 100.0 * self.relative, error, self.verdict


def error_words(error: float) -> str:
    """Return the error of a number in SI in words."""
    return f"an error of {error:.1e} in SI" if np.isfinite(error) else "an error that has no bound"


def _compared(condition: Condition, result: Result) -> _Compared:
    (value, left), bound = measured(condition.compared, result), global_error(result, condition.number)
    return _Compared(condition, value, bound, left if bound is None else bound)


def _unit(condition: Condition, quantities: Quantities) -> Unit | None:
    number = condition.number
    return number.described(quantities, {}).unit if number.of_curves else None
