"""Comparing a run with its answer key, and telling agreements, roundings, misprints and errors of models apart.

A misprint is confirmed only when the computed number equals the independent value and differs from the published one
beyond its printed digits; where ``because`` says how it came about, that must lead to what is printed. An error of the
model is confirmed likewise, by the formula of that model. A rounding is confirmed when the printed number is one unit
off in its last digit, or when it comes out of the rounded figures that its authors used; a reading off a plot when it
is within 2 %. Anything else that differs is a miss.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, printable, within
from pinarm.input.units import Unit, half_last_digit, read_quantity
from pinarm.input.yaml.document import Values
from pinarm.input.yaml.schema import in_si
from pinarm.records import replace
from pinarm.use.facade import Given
from pinarm.use.result.curve_figures import is_figure
from pinarm.use.result.expectation import ERRATA, Expectation
from pinarm.use.result.measures import ZERO, natural_sizes
from pinarm.use.result.numbers import RunNumber, measured, names_number, read_number
from pinarm.use.result.result import Result
from pinarm.use.result.row_lookup import NotReached
from pinarm.use.show.text import aligned
from pinarm.use.study.run import run, scenarios

FORMULA = 1e-10
"""Relative tolerance of formulas where the entry gives none."""

FLOOR = 1e-13
"""Addition to the tolerance of a formula, relative to its largest value over the rows: sums of large terms cancel.
Where that value is 0 but for rounding, rounding of the natural size is added; see ``natural_sizes``."""

READING = 0.02
"""Reading error of a printed plot, relative to the number read."""

ONE_UNIT = 1.0 + 1e-9
"""One unit of the last printed digit is two half units; the rest is rounding of the comparison itself."""

UNITS = 4.0 * float(np.finfo(float).eps)
"""Rounding of a few operations, relative to a number: half a unit of its last of 17 digits is less than that."""


@dataclass(frozen=True)
class Finding:
    """Result of one expectation.

    Attributes:
        scenario: Name of the scenario; its path where several of one name are checked.
        expectation: The entry of the answer key.
        unit: Unit of the numbers; ``None`` where unknown.
        computed: The computed number; of many rows, the one that is farthest off, or the first where rounding is all.
        independent: The independent value, ``None`` where none is given.
        published: The published number, ``None`` where none is given.
        error: Largest difference to the independent value over its largest size; the difference in SI where that is 0.
        allowed: Largest such difference that agrees, in the same measure: ``error <= allowed`` is the test.
        verdict: ``agrees``, ``rounding``, ``reading``, ``misprint``, ``model_error`` or ``MISS``.
        reason: Why it is a miss.
        shown_in: Unit that people are shown the numbers in, unless one is published; ``None`` for ``unit``.
        where: Where on the run the numbers are, such as ``t = 0.3 s``; empty where they are of no place.
    """

    scenario: str
    expectation: Expectation
    unit: Unit | None
    computed: float
    independent: float | None
    published: float | None
    error: float | None
    verdict: str
    reason: str = ""
    shown_in: Unit | None = None
    where: str = ""
    allowed: float | None = None

    @property
    def ok(self) -> bool:
        """Whether the answer key is met."""
        return self.verdict != "MISS"


class Findings(tuple[Finding, ...]):
    """Findings on the expectations, in their order."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"<Findings: {len(self)} expectations, {sum(not finding.ok for finding in self)} missed>"

    def _repr_html_(self) -> str:
        from pinarm.use.show.text import lines

        return lines(verdicts(self))


def check(scenario: Given, values: Values | None = None, *, result: Result | None = None) -> Findings:
    """Solve scenarios and compare them with their answer keys.

    Args:
        scenario: The scenario, its file, or a folder of them.
        values: Other values for each of them, such as ``{"problem.time.end": "3 s"}``; see ``pinarm.load``.
        result: What came out of a scenario that is solved already.

    Raises:
        InputError: An expectation asks for something that does not exist; the message says where.
        PinarmError: A scenario cannot be solved.
    """
    findings = []
    for case in scenarios(scenario, values):
        solved = result or run(case)
        for index, expectation in enumerate(case.content.expect):
            with case.document.locating("expect", index):
                findings.append(finding_of(solved, expectation))
    return Findings(findings)


def finding_of(result: Result, expectation: Expectation) -> Finding:
    """Compare a result with one expectation.

    A place that the run does not come to is a miss, and so is what is not as accurate as the scenario wants it.
    """
    try:
        finding = compare(result, expectation)
    except NotReached as error:
        return _missed(result, expectation, error.message)
    return replace(finding, verdict="MISS", reason=result.shortfall) if finding.ok and result.shortfall else finding


def compare(result: Result, expectation: Expectation) -> Finding:
    """Compare a result with one expectation, by ``|computed - independent| <= allowed`` in all rows.

    What is allowed is one number for all rows: of a formula relative to its largest size over these.
    """
    quantities, series, slack = computed_rows(result, expectation)
    rounding = ZERO * natural_sizes(result.trajectory)(series.unit)
    wanted, tolerance = wanted_rows(quantities, expectation, series.unit, rounding)
    scale = 0.0 if wanted is None else float(np.abs(wanted).max())
    if not np.isfinite(scale):
        return _missed(result, expectation, "the independent value is not finite")
    allowed = tolerance + min(slack, max(tolerance, FORMULA * scale))
    difference = np.abs(series.values - (series.values if wanted is None else wanted))
    worst = int(np.nan_to_num(np.where(difference <= FLOOR * scale, 0.0, difference), nan=np.inf).argmax())
    printed = _published(quantities, expectation, series.values, series.unit)
    verdict, reason = _verdict(expectation, wanted is not None, printed)
    if wanted is not None and not (difference <= allowed).all():
        verdict, reason = "MISS", _apart(float(difference.max()), allowed, scale, series.unit)
    if verdict == "MISS" and slack > tolerance:
        reason = f"{reason}, and it is known to {slack:.1e} {series.unit or ''} only"
    if not np.isfinite(series.values).all():
        verdict, reason = "MISS", "the computed number is not finite"
    return Finding(
        result.name,
        expectation,
        series.unit,
        float(series.values[worst]),
        None if wanted is None else float(np.broadcast_to(wanted, series.values.shape)[worst]),
        printed.value,
        None if wanted is None else float(difference.max() / (scale or 1.0)),
        verdict,
        reason,
        result.presentation.unit(series),
        _where(result, quantities, expectation, worst),
        allowed / (scale or 1.0),
    )


def _missed(result: Result, expectation: Expectation, reason: str) -> Finding:
    return Finding(result.name, expectation, None, np.nan, None, None, None, "MISS", reason)


def _apart(difference: float, allowed: float, scale: float, measured: Unit | None) -> str:
    """Return a difference and the allowed one in words, both as parts of a scale, or where it is 0 [SI]."""
    if scale:
        return f"difference {100.0 * difference / scale:.3g} % (allowed {100.0 * allowed / scale:.3g} %)"
    return f"difference {difference:.3g} {measured or ''} (allowed {allowed:.3g} {measured or ''})".replace(" )", ")")


def _where(result: Result, quantities: Quantities, expectation: Expectation, row: int) -> str:
    """Return the place of a row, such as ``t = 0.3 s``; empty for figures of the whole run, and numbers of sections."""
    at = expectation.at
    if (isinstance(at, str) and is_figure(at)) or names_number(expectation.quantity, result.numbered):
        return ""
    along = result.presentation.shown(quantities.parameter)
    unit = "" if str(along.unit or "1") == "1" else f" {along.unit}"
    return f"{along.name} = {along.values[row]:.9g}{unit}"


def computed_rows(result: Result, expectation: Expectation) -> tuple[Quantities, Series, float]:
    """Return the rows that an expectation is about, what was computed there, and the error of its quadrature."""
    at, quantity = expectation.at, expectation.quantity
    expectation.check_place(result.quantities)
    with within("quantity"):
        if names_number(quantity, result.numbered):
            series, error = measured(read_number(quantity), result)
            return result.lookup.at("start", result.trajectory.parameter), series, error
        if at == "all":
            return result.quantities, result.quantities.determined(quantity), 0.0
        number = RunNumber(quantity, at, quantity)
        described = number.described(result.quantities, {})
    with within("at"):
        value, error = number.value(result)
        place = "start" if is_figure(number.figure) else at
        return result.lookup.at(place, quantity), replace(described, name=quantity, values=np.array([value])), error


def wanted_rows(
    quantities: Quantities, expectation: Expectation, measured: Unit | None, rounding: float
) -> tuple[Array | None, float]:
    """Return the independent value at every row, and how far from it the computed one may be in any row.

    ``rounding`` [SI] is what may be left of a number that is 0.
    """
    if expectation.value is None and expectation.formula is None:
        return None, 0.0
    with within("atol"):
        absolute = in_si(expectation.atol, measured) if expectation.atol is not None else 0.0
        if absolute < 0.0:
            raise InputError(f"the tolerance {expectation.atol} is negative")
    if expectation.formula is not None:
        with within("formula"):
            formula = quantities.determined(expectation.formula)
            if formula.unit is not None and measured is not None and formula.unit.dimension != measured.dimension:
                message = f"the formula '{expectation.formula}' is in {formula.unit}, the quantity in {measured}"
                raise InputError(message, expected="the same dimension")
        wanted = formula.values
        relative = FORMULA if expectation.rtol is None and expectation.atol is None else expectation.rtol or 0.0
        largest = float(np.abs(wanted).max())
        floor = FLOOR * largest if largest > rounding else rounding
        return wanted, absolute + floor + relative * largest
    with within("value"):
        wanted = np.full(1, in_si(expectation.value, measured))
        if expectation.rtol is None and expectation.atol is None:
            absolute = _half_unit(str(expectation.value), float(wanted[0]))
            if not wanted.any() and "." not in str(expectation.value):
                raise InputError(
                    f"'{expectation.value}' does not say how near to it the number must be",
                    expected="atol beside it, or decimals, half a unit of the last of which counts",
                    hint=f"atol: 1e-9 {measured or ''}".rstrip(),
                )
    return wanted, absolute + (expectation.rtol or 0.0) * float(np.abs(wanted).max())


def _half_unit(text: str, value: float) -> float:
    """Return half a unit of the last digit of a printed number, no less than rounding of its value, both in SI."""
    return max(half_last_digit(text) * ONE_UNIT, UNITS * abs(value))


@dataclass(frozen=True)
class _Published:
    """Published number, compared with the computed number.

    Attributes:
        value: Of many rows, the published number that is farthest off; ``None`` where nothing is published.
        off: Whether the computed number differs from it.
        explained: Whether rounding, reading or the entry's reason explains the difference.
        apart: The difference, and the difference that its digits allow, in words.
    """

    value: float | None = None
    off: bool = False
    explained: bool = False
    apart: str = ""


def _published(quantities: Quantities, expectation: Expectation, values: Array, measured: Unit | None) -> _Published:
    if expectation.published_formula is not None:
        with within("published_formula"):
            formula = np.broadcast_to(quantities.figure(expectation.published_formula), values.shape)
        half = FORMULA * float(np.abs(formula).max())
    elif expectation.published is not None:
        with within("published"):
            formula = np.full(values.shape, in_si(expectation.published, measured))
            half = _half_unit(expectation.published, float(formula[0]))
    else:
        return _Published()
    difference, scale = np.abs(values - formula), float(np.abs(formula).max())
    worst = int(difference.argmax())
    if not np.isfinite(scale):
        return _Published(float(formula[worst]), True)
    explained = expectation.published is not None and difference[worst] <= (
        READING * scale if expectation.verdict == "reading" else 2.0 * half
    )
    if expectation.because is not None:
        with within("because"):
            explained = np.abs(quantities.figure(expectation.because) - formula).max() <= half
    apart = _apart(float(difference[worst]), half, scale, measured)
    return _Published(float(formula[worst]), not difference[worst] <= half, bool(explained), apart)


def _verdict(expectation: Expectation, independent: bool, printed: _Published) -> tuple[str, str]:
    """Return the verdict on a number that meets its independent value, if any, and for a miss its reason."""
    claim = expectation.verdict
    if not printed.off:
        return ("agrees", "") if claim == "agrees" else ("MISS", f"claimed as {claim}, but the published figure agrees")
    if not independent:
        return "MISS", f"no independent value decides who is right; to the published figure {printed.apart}"
    if claim == "agrees":
        return "MISS", f"beyond the digits of the published figure: {printed.apart}"
    if not printed.explained and (claim in ("rounding", "reading") or expectation.because is not None):
        return "MISS", f"claimed as {claim.replace('_', ' ')}, but that does not lead to the printed digits"
    return claim, ""


HEADING = ("verdict", "scenario", "quantity", "at", "computed", "independent", "published", "difference")
LOOKS = {
    "agrees": "= agrees",
    "rounding": "~ rounding",
    "reading": "~ reading",
    "misprint": "! misprint",
    "model_error": "! model error",
    "MISS": "X MISS",
}
"""Verdicts, as they are written."""

CELL = 36
"""Largest number of letters of a cell."""


def verdicts(findings: Sequence[Finding]) -> str:
    """Return the table of findings, why some are a miss, and how many there are of each, as text."""
    table = aligned([HEADING, *rows(findings)]) if findings else []
    return "\n".join([*table, *remarks(findings)])


def rows(findings: Sequence[Finding]) -> list[list[str]]:
    """Return a row for every finding, with the cells that ``HEADING`` names; a scenario is named once."""
    lines, previous = [], ""
    for finding in findings:
        entry, unit = finding.expectation, finding.shown_in or finding.unit
        independent = _shown(finding.independent, unit, entry) if entry.value is not None else entry.formula or ""
        cells = (
            LOOKS[finding.verdict],
            finding.scenario if finding.scenario != previous else "",
            entry.quantity,
            _place(entry.at),
            _shown(finding.computed, unit, entry),
            independent,
            entry.published or entry.published_formula or "",
            "" if finding.error is None else f"{finding.error:.1e}",
        )
        lines.append([_clip(printable(cell)) for cell in cells])
        previous = finding.scenario
    return lines


def remarks(findings: Sequence[Finding]) -> list[str]:
    """Return why findings are a miss, and how many there are of each verdict."""
    lines = [printable(miss_text(finding)) for finding in findings if not finding.ok]
    return [*lines, "; ".join(said for verdict in LOOKS if (said := _counted(findings, verdict))) or "nothing to check"]


def miss_text(finding: Finding) -> str:
    """Return a miss in words: place, computed, expected and published numbers, and the reason."""
    entry, unit = finding.expectation, finding.shown_in or finding.unit
    where = f" at {finding.where}" if finding.where else ""
    numbers = [f"computed {_shown(finding.computed, unit, entry)}"] if isfinite(finding.computed) else []
    if finding.independent is not None:
        numbers.append(f"expected {_shown(finding.independent, unit, entry)}")
    if finding.published is not None:
        numbers.append(f"published {_shown(finding.published, unit, entry)}")
    return f"MISS {finding.scenario}: {entry.quantity}{where}: {', '.join([*numbers, finding.reason])}"


def errata(findings: Iterable[Finding], verdict: str) -> int:
    """Return the number of misprints, or of model errors; entries with one ``erratum`` count once."""
    alike = [finding.expectation.erratum for finding in findings if finding.verdict == verdict]
    return alike.count("") + len({name for name in alike if name})


def _counted(findings: Sequence[Finding], verdict: str) -> str:
    """Return the numbers of findings and of errata of a verdict, in words; empty for none."""
    count, words = sum(finding.verdict == verdict for finding in findings), verdict.replace("_", " ")
    different = errata(findings, verdict) if verdict in ERRATA else count
    if different < count:
        return f"{different} {words} in {count} entries"
    return f"{count} {words}" if count else ""


def plain(finding: Finding) -> dict[str, Any]:
    """Return a finding as plain data."""
    entry = finding.expectation
    of_finding = ("scenario", "computed", "independent", "where", "allowed", "verdict", "reason")
    of_entry = ("quantity", "at", "published", "erratum", "source", "note")
    data = {key: getattr(finding, key) for key in of_finding} | {key: getattr(entry, key) for key in of_entry}
    return {**data, "unit": str(finding.unit or "?"), "difference": finding.error}


def _place(at: object) -> str:
    if isinstance(at, dict):
        return " ".join(str(value) if key == "side" else f"{key}={value}" for key, value in at.items())
    return "all rows" if at == "all" else str(at)


def _clip(text: str) -> str:
    return text if len(text) <= CELL else f"{text[: CELL - 3]}..."


def _shown(value: float | None, measured: Unit | None, entry: Expectation) -> str:
    """Return a number in the unit of the published one, else in SI."""
    if value is None:
        return ""
    printed = read_quantity(entry.published)[1] if entry.published else None
    measured = printed or measured
    factor = measured.factor if measured else 1.0
    return f"{value / factor:.9g}" if str(measured or "1") == "1" else f"{value / factor:.9g} {measured}"
