"""Tables with a line per case, or per motion, and why some of them have no numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinarm.engine.series import Series
from pinarm.input.numbers import DECIMAL
from pinarm.use.store.files import cell

_NUMBER = re.compile(DECIMAL)
BLOCK = 10_000
"""Lines whose texts are made at once."""
TEXTS, SHORTEST = 25_000_000, 20
"""Characters that an array of texts may have in all, each as long as the longest; and what is left of each at least."""
QUANTILES = {"5 %": 0.05, "median": 0.5, "95 %": 0.95}


def csv(of: str, columns: Sequence[Series], errors: Mapping[int, str]) -> str:
    """Return a table as CSV; see ``csv_lines``."""
    return "".join(csv_lines(of, columns, errors))


def csv_lines(of: str, columns: Sequence[Series], errors: Mapping[int, str]) -> Iterator[str]:
    """Yield a table as CSV: the number of each line, its columns, and why it failed.

    Numbers have the digits that it takes to read them back; those that are none are empty.

    Args:
        of: What the lines are, for the heading of their numbers.
        columns: At least one, all of one length.
        errors: Line -> why it failed.
    """
    yield ",".join([of, *(cell(series.label) for series in columns), "error"]) + "\n"
    for start in range(0, len(columns[0].values), BLOCK):
        texts = [_texts(series.values[start : start + BLOCK]) for series in columns]
        for number, row in enumerate(zip(*texts, strict=True), start):
            yield ",".join([str(number), *row, cell(errors.get(number, ""))]) + "\n"


def _texts(values: NDArray[Any]) -> list[str]:
    """Return the cells of a column."""
    if values.dtype.kind != "f":
        return [cell(value) if isinstance(value, str) else repr(value) for value in values.tolist()]
    texts = [*map(repr, values.tolist())]
    for row in np.flatnonzero(np.isnan(values)).tolist():
        texts[row] = ""
    return texts


def arrays(columns: Sequence[Series], errors: Mapping[int, str]) -> dict[str, Any]:
    """Return the same as arrays by name, with the units of all; of many lines what failed is cut to ``TEXTS``."""
    n = len(columns[0].values)
    width = max(SHORTEST, TEXTS // max(n, 1))
    shown = {number: _shortened(error, width) for number, error in errors.items()}
    texts = np.zeros(n, f"U{max((len(text) for text in shown.values()), default=1) or 1}")
    for number, text in shown.items():
        texts[number] = text
    units = np.array([[series.name, str(series.unit or "?")] for series in columns])
    return {**{series.name: series.values for series in columns}, "error": texts, "units": units}


def _shortened(text: str, width: int) -> str:
    return text if len(text) <= width else f"{text[: width - 3]}..."


def statistics(series: Series) -> dict[str, Any]:
    """Return statistics of a column over the lines that have numbers.

    The standard deviation is that of a sample, which one number has not.
    """
    solved = np.flatnonzero(np.isfinite(series.values))
    values = series.values[solved]
    found: dict[str, Any] = {"unit": str(series.unit or "?"), "cases": len(values)}
    if not len(values):
        return found
    low, high = int(values.argmin()), int(values.argmax())
    found |= {"min": values[low], "at_min": int(solved[low]), "max": values[high], "at_max": int(solved[high])}
    exponent = int(np.frexp(np.abs(values).max())[1])  # squares of sizes up to 1 are finite
    scaled = np.ldexp(values, -exponent)
    measures = {"mean": scaled.mean(), **({"deviation": scaled.std(ddof=1)} if len(values) > 1 else {})}
    measures |= {name: np.quantile(scaled, share) for name, share in QUANTILES.items()}
    found |= {name: np.ldexp(x, exponent) for name, x in measures.items()}
    return {name: float(value) if isinstance(value, np.floating) else value for name, value in found.items()}


def statistics_rows(each: str, entries: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    """Return a table of the statistics of columns: a heading, and a row for each.

    Args:
        each: What a line of the columns is, such as ``case``, for the headings.
        entries: Column -> its ``statistics``.
    """
    rows = [["", "unit", "min", f"in {each}", "mean", "deviation", "max", f"in {each}"]]
    for name, entry in entries.items():
        numbers = [entry.get(key) for key in ("min", "at_min", "mean", "deviation", "max", "at_max")]
        rows.append([name[:48], entry["unit"], *("-" if number is None else f"{number:.7g}" for number in numbers)])
    return rows


def failures(errors: Mapping[int, str]) -> list[dict[str, Any]]:
    """Return why lines failed: each reason once, as its first line has it, the most frequent first.

    Reasons that differ in their numbers only count as one.
    """
    reasons: dict[str, list[int]] = {}
    for number, error in errors.items():
        reasons.setdefault(_NUMBER.sub("#", error), []).append(number)
    ordered = sorted(reasons.values(), key=lambda lines: (-len(lines), lines[0]))
    return [{"reason": errors[lines[0]], "cases": len(lines), "first": lines[:10]} for lines in ordered]
