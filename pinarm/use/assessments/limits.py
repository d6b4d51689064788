"""Limits that numbers of a run must keep to, with the margins that are left.

The relative margin is that of the bound, ``(b - x) / |b|`` for ``x < b``. A number that is nearer to its bound than its
own error is neither within the limit nor beyond it. One that is NaN, as what a run does not come to, is beyond its
limit; its margin is not known, and so the least of all is not either. Of ``X @ largest`` the size is compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, within
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.input.yaml.schema import InputStruct, check_unit
from pinarm.use.result.curve_figures import CurveFigure
from pinarm.use.result.numbers import Condition, measured, read_conditions, slug
from pinarm.use.result.section import Cell, Section, SectionTable, numbered

if TYPE_CHECKING:
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
        rows, remarks = list[Sequence[Cell]](), list[str]()
        numbers, margins = dict[str, CurveFigure](), list[tuple[float, float]]()
        for condition in self.conditions:
            (value, left), label = measured(condition.compared, result), condition.number.label
            bound = result.number_errors.get(label)
            x, known = float(value.values[0]), left if bound is None else bound
            margin, size, text = condition.margin(x), abs(float(condition.bound)), condition.measured(x)
            relative = margin / size if size else float(np.sign(margin) * np.inf) if margin else 0.0
            margins.append((relative, known / size if size else 0.0))
            verdict = OPEN if abs(margin) < known else KEPT if margin >= 0.0 else BEYOND
            if verdict == BEYOND:
                remarks.append(f"beyond its limit: {condition} is {text}")
            elif verdict == OPEN:
                remarks.append(f"neither kept nor beyond: {condition} is {text}, with {error_words(known)}")
            numbers[f"{slug(condition.number)}.margin"] = CurveFigure(margin, known, value.unit)
            limit = f"{condition.relation} {condition.bound_text}"
            rows.append((label, text, limit, 100.0 * relative, _error_cell(condition, bound), verdict))
        nearest = int(np.argmin([relative for relative, _ in margins]))  # NaN where any is
        numbers["least_margin"] = CurveFigure(*margins[nearest], DIMENSIONLESS)
        beyond = sum(row[-1] == BEYOND for row in rows)
        numbers["beyond"] = CurveFigure(float(beyond), 0.0, DIMENSIONLESS)
        columns = ("", "value", "limit", "margin [%]", "error", "")
        table = SectionTable("limits", "Numbers and their limits", columns, (None,) * len(columns), rows)
        remarks.sort(key=lambda remark: remark.startswith("neither"))
        return Section("limits", "Limits", [table], remarks=remarks, **numbered(numbers))


def _error_cell(condition: Condition, bound: float | None) -> str:
    """Return the bound of the error of a number in the unit of its limit; ``None`` where it is not estimated."""
    unit = condition.bound.unit
    if bound is None:
        return "not estimated"
    return f"{bound / unit.factor if unit else bound:.1e}" if np.isfinite(bound) else "no bound"


def error_words(error: float) -> str:
    """Return the error of a number in SI in words."""
    return f"an error of {error:.1e} in SI" if np.isfinite(error) else "an error that has no bound"


def _unit(condition: Condition, quantities: Quantities) -> Unit | None:
    number = condition.number
    return number.described(quantities, {}).unit if number.of_curves else None
