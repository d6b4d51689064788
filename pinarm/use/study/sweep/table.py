"""Sweep: the table with a line per case, its statistics, files and texts. The same cases give the same bytes."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pinarm.engine.labelled_array import dataframe
from pinarm.engine.series import Series
from pinarm.errors import InputError, choices, require_name
from pinarm.input.units import DECIMAL, unit
from pinarm.input.yaml.document import Document
from pinarm.use.cases.case import OPEN, WORTH
from pinarm.use.output import whole_folder
from pinarm.use.result.measures import CLOSURES, RESIDUALS, singularity_words
from pinarm.use.result.numbers import read_number
from pinarm.use.result.presentation import CsvForm, Presentation
from pinarm.use.show.text import aligned, counted
from pinarm.use.store.files import csv_lines, json_text, write, write_arrays, yaml_text
from pinarm.use.study.sweep.axes import Cases, axes_of
from pinarm.use.study.sweep.solving import JOURNAL

if TYPE_CHECKING:
    from pandas import DataFrame

    from pinarm.use.show.picture import Picture

NAMED, SHOWN = 12, 10
"""Most columns that the ``repr`` names, and reasons of failures that are printed."""

BLOCK = 10_000
"""Lines of CSV whose texts are made at once."""

TEXTS, SHORTEST = 25_000_000, 20
"""Most characters of an array of texts, each as long as the longest; and least length to which a text is cut."""

QUANTILES = {"5 %": 0.05, "median": 0.5, "95 %": 0.95}
SCALED = ("min", "mean", "deviation", "max")
"""Statistics that have the unit of their column."""

WORST = (*RESIDUALS, *CLOSURES, "condition", "global error", "regularity", "relative regularity")
"""Measures of accuracy whose worst value is told: of regularities the least, of others the largest."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Sweep:
    """Results of a sweep: columns with one number, or word, per case.

    Attributes:
        definition: The call as plain data.
        cases: The values of every case.
        columns: Results and measures of accuracy in SI; NaN where a case has none.
        errors: Case -> why it failed.
        presentation: Units and labels of tables for people.
        notes: What to know of the results.
    """

    name: str
    title: str
    definition: Mapping[str, Any]
    cases: Cases
    columns: Sequence[Series]
    errors: Mapping[int, str]
    presentation: Presentation
    notes: Sequence[str] = ()

    def __len__(self) -> int:
        return len(self.cases)

    @property
    def given(self) -> list[Series]:
        """The columns that were varied, in the units they were given in."""
        return self.cases.table()

    @cached_property
    def table(self) -> dict[str, Series]:
        """All columns by name."""
        return {series.name: series for series in (*self.given, *self.columns)}

    def __repr__(self) -> str:
        """Return its name, how many cases it has, and the first of its columns."""
        failed = f", {len(self.errors)} failed" if self.errors else ""
        return f"<Sweep of '{self.name}': {len(self)} cases{failed}; {', '.join(list(self.table)[:NAMED])}>"

    def __getitem__(self, name: str) -> Series:
        """Return a column by name; that of a number as it may be asked for: ``C_B @ max(C_B)`` is ``C_B @ max``.

        Raises:
            InputError: There is none of that name; the message lists those there are.
        """
        require_name(name)
        name = read_number(name).label if "@" in name and name not in self.table else name
        if name not in self.table:
            expected, hint = choices(name, self.table)
            raise InputError(f"the table has no column '{name}'", expected=expected, hint=hint)
        return self.table[name]

    def results(self) -> list[Series]:
        """Return the columns that were asked for, without the measures of accuracy."""
        return [series for series in self.columns if series.name not in WORTH]

    def written(self) -> list[Series]:
        """Return the columns as tables for people have them: in the units that the scenario chooses."""
        return [*self.given, *map(self.presentation.written, self.columns)]

    def to_dataframe(self) -> DataFrame:
        """Return a pandas table, units in the headings, and why cases failed."""
        columns: dict[str, Any] = {series.label: series.values for series in self.written()}
        return dataframe({**columns, "error": [self.errors.get(case, "") for case in range(len(self))]})

    def csv(self) -> str:
        """Return the table as CSV: number of the case, columns, why it failed; numbers that a case lacks are empty."""
        return b"".join(cases_csv(self.written(), self.errors)).decode()

    def summary(self) -> dict[str, Any]:
        """Return statistics of every result, the worst measures of accuracy, and failures."""
        measured = [series for series in self.columns if series.name in WORST]
        doubts = [f"{series.name}: {series.doubt}" for series in self.columns if series.doubt]
        return {
            "scenario": self.name,
            "title": self.title,
            "cases": len(self),
            "failed": len(self.errors),
            "results": {series.name: statistics(series) for series in self.results()},
            "accuracy": {x.name: float((np.nanmin if "regular" in x.name else np.nanmax)(x.values)) for x in measured},
            "failures": failures(self.errors),
            "notes": [*doubts, *self.notes, *self._open_cases()],
        }

    def _open_cases(self) -> list[str]:
        """Return a note of the cases whose results hang on decisions that are not certain, if any."""
        cases = [k for x in self.columns if x.name == OPEN for k in np.flatnonzero(x.values > 0.0).tolist()]
        said = f"results hang on decisions that are not certain, such as whether an event takes place: column '{OPEN}'"
        return [f"{said}, and notes of single runs ({_counted(len(cases), cases)})"] if cases else []

    def plot(self, name: str | None = None) -> Picture:
        """Return a plot of a column over what was varied: curves, a map, or how often which value came out.

        Args:
            name: The column; the first result where it is left out. ``mode.1.damping`` draws all branches of modes,
                ``root_locus`` their eigenvalues.
        """
        from pinarm.use.study.sweep.plots import pictured, plot

        if name is None:
            return plot(self, self.columns[0])
        pictures = {series.name: series for series in pictured(self)}
        return plot(self, pictures[name] if name in pictures else self[name])

    def save(
        self,
        folder: str | Path,
        *,
        plots: Literal["svg", "png", "pdf"] | bool = True,
        dpi: int = 200,
        parquet: bool = False,
    ) -> Path:
        """Write ``sweep.yaml``, ``cases.csv``, ``cases.npz``, ``summary.json`` and plots; return the folder.

        Args:
            folder: The folder; an earlier sweep in it is replaced.
            plots: Format of the pictures, ``svg`` (the default), ``png`` or ``pdf``; ``False`` for none.
            dpi: Pixels per inch of PNG.
            parquet: Whether the table is written as Parquet too, by pyarrow.

        Raises:
            InputError: The folder cannot be written, or holds files that are not an earlier sweep's, or pyarrow is not
                installed.
        """
        folder, scenario = Path(folder), self.definition.get("scenario")
        with whole_folder(folder, "sweep", source=Path(scenario) if scenario else None, beside=(JOURNAL,)) as draft:
            self.write_tables(draft, folder)
            if parquet:
                self._write_parquet(draft / "cases.parquet")
            if plots:
                from pinarm.use.show.picture_files import write_pictures
                from pinarm.use.study.sweep.plots import pictures

                write_pictures(pictures(self), draft / "plots", plots, dpi)
        return folder

    def write_tables(self, draft: Path, folder: Path) -> None:
        """Write the definition, the table and the summary to a draft of a folder, from which files are named."""
        definition = {key: value for key, value in self.definition.items() if value is not None}
        files = {key: os.path.relpath(definition[key], folder) for key in ("scenario", "cases") if definition.get(key)}
        write(draft / "sweep.yaml", yaml_text({**definition, **files}))
        write(draft / "cases.csv", cases_csv(self.written(), self.errors, self.presentation.csv))
        write_arrays(draft / "cases.npz", arrays(list(self.table.values()), self.errors))
        write(draft / "summary.json", json_text(self.summary()) + "\n")

    def _write_parquet(self, file: Path) -> None:
        """Write number of the case, the columns of the CSV file in SI, and why the case failed."""
        require_parquet()
        import pyarrow
        import pyarrow.parquet

        columns: dict[str, Any] = {series.label: series.values for series in self.table.values()}
        errors = [self.errors.get(case, "") for case in range(len(self))]
        pyarrow.parquet.write_table(pyarrow.table({"case": range(len(self)), **columns, "error": errors}), file)

    def _repr_html_(self) -> str:
        """Return the report, for notebooks."""
        page: str = import_module("pinarm").report(self)._repr_html_()  # by its public name: reports stand above
        return page


def require_parquet() -> None:
    """Raise where Parquet cannot be written."""
    if find_spec("pyarrow") is None:
        raise InputError("Parquet is written by pyarrow, which is not installed", hint="pip install 'pinarm[parquet]'")


def stored_sweep(folder: Path) -> Sweep:
    """Return the sweep that a folder holds; nothing is solved again."""
    definition = Document.read(folder / "sweep.yaml").data
    try:
        base, units = definition["base"], definition.get("units", {})
        source = folder / definition["cases"] if definition.get("cases") else None
        drawn = definition.get("samples"), definition["seed"], definition["sampling"]
        cases = Cases.of(axes_of(lambda path: units.get(path, ""), definition["over"], source, *drawn))
        columns, errors = _stored_columns(folder / "cases.npz", cases)
        presentation = Presentation.of(
            base.get("units", {}), base.get("labels", {}), base.get("lang"), base.get("csv", "commas")
        )
        notes = json.loads((folder / "summary.json").read_bytes()).get("notes", ())
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{folder} does not hold a sweep ({error!r})", hint="run the sweep again") from None
    return Sweep(
        name=Path(str(definition.get("scenario", folder.name))).stem,
        title=str(base.get("title", "")),
        definition=definition,
        cases=cases,
        columns=columns,
        errors=errors,
        presentation=presentation,
        notes=notes,
    )


def _stored_columns(file: Path, cases: Cases) -> tuple[list[Series], dict[int, str]]:
    with np.load(file, allow_pickle=False) as stored:
        varied = {column.path for column in cases.columns()}
        results = [(name, text) for name, text in stored["units"].tolist() if name not in varied]
        columns = [Series(name, None if text == "?" else unit(text), stored[name]) for name, text in results]
        errors = {case: text for case, text in enumerate(stored["error"].tolist()) if text}
    if {len(cases)} != {len(series.values) for series in columns}:
        raise InputError(f"{file} has not the cases of sweep.yaml beside it")
    return columns, errors


def cases_csv(columns: Sequence[Series], errors: Mapping[int, str], form: CsvForm = "commas") -> Iterator[bytes]:
    """Yield a table as CSV: the number of each case, its columns, and why it failed; see ``csv_lines``.

    Numbers that are none are empty.
    """

    def block(start: int) -> Iterator[Sequence[str | float]]:
        values = [series.values[start : start + BLOCK].tolist() for series in columns]
        for number, row in enumerate(zip(*values, strict=True), start):
            yield number, *("" if isinstance(x, float) and isnan(x) else x for x in row), errors.get(number, "")

    starts = range(0, len(columns[0].values), BLOCK)
    return csv_lines(["case", *(series.label for series in columns), "error"], map(block, starts), form)


def arrays(columns: Sequence[Series], errors: Mapping[int, str]) -> dict[str, Any]:
    """Return a table as arrays by name, with all units; for many cases the reasons are cut to ``TEXTS``."""
    n = len(columns[0].values)
    width = max(SHORTEST, TEXTS // max(n, 1))
    texts = np.array([errors.get(case, "")[:width] for case in range(n)], str)
    units = np.array([[series.name, str(series.unit or "?")] for series in columns])
    return {**{series.name: series.values for series in columns}, "error": texts, "units": units}


def statistics(series: Series) -> dict[str, Any]:
    """Return statistics of a column over the cases that have numbers.

    The standard deviation is that of a sample, which one number has not.
    """
    solved = np.flatnonzero(np.isfinite(series.values))
    values = series.values[solved]
    numbers: dict[str, Any] = {"unit": str(series.unit or "?"), "cases": len(values)}
    if not len(values):
        return numbers
    low, high = int(values.argmin()), int(values.argmax())
    numbers |= {"min": values[low], "at_min": int(solved[low]), "max": values[high], "at_max": int(solved[high])}
    with np.errstate(over="ignore"):
        numbers |= {"mean": values.mean(), **({"deviation": values.std(ddof=1)} if len(values) > 1 else {})}
    numbers |= {name: np.quantile(values, share) for name, share in QUANTILES.items()}
    return {name: float(value) if isinstance(value, np.floating) else value for name, value in numbers.items()}


def failures(errors: Mapping[int, str]) -> list[dict[str, Any]]:
    """Return why cases failed: each reason once, as its first case has it, the most frequent first.

    Reasons that differ in their numbers only count as one.
    """
    reasons: dict[str, list[int]] = {}
    for number, error in errors.items():
        reasons.setdefault(re.sub(DECIMAL, "#", error), []).append(number)
    ordered = sorted(reasons.values(), key=lambda cases: (-len(cases), cases[0]))
    return [{"reason": errors[cases[0]], "cases": len(cases), "first": cases[:10]} for cases in ordered]


def report(sweep: Sweep) -> str:
    """Return the statistics of a sweep and why cases failed, as text."""
    return "\n".join([sweep.title or sweep.name, *aligned(ranges(sweep)), *remarks(sweep)])


def ranges(sweep: Sweep) -> list[list[str]]:
    """Return a heading and the statistics of every result, in the units and by the labels of the scenario."""
    rows, how = [["", "unit", "min", "in case", "mean", "deviation", "max", "in case"]], sweep.presentation
    for series in sweep.results():
        (scale, shown), entry = how.scale(series), statistics(series)
        numbers = [
            "-" if (x := entry.get(key)) is None else f"{x * scale if key in SCALED else x:.7g}"
            for key in ("min", "at_min", "mean", "deviation", "max", "at_max")
        ]
        rows.append([how.label(series.name)[:48], str(shown or "?"), *numbers])
    return rows


def remarks(sweep: Sweep) -> list[str]:
    """Return remarks on the sweep, a line each: accuracy, notes, and reasons why cases failed."""
    summary = sweep.summary()
    accuracy, reasons, lines = summary["accuracy"], summary["failures"], []
    for head, names in (
        ("accuracy: largest relative residuals", RESIDUALS),
        ("loops [m or rad, s]: largest", CLOSURES),
    ):
        measured = [f"{name} {accuracy[name]:.1e}" for name in names if name in accuracy]
        lines += [f"{head}: {', '.join(measured)}"] if measured else []
    if "global error" in accuracy:
        lines.append(f"error: at most {accuracy['global error']:.1e} of the largest value")
    if words := singularity_words(accuracy):
        lines.append(f"regularity: {words} in the worst case; 0 at a singular position")
    lines += [f"note: {note}" for note in counted(summary["notes"])]
    lines.append(f"cases: {len(sweep)}" + (f", {len(sweep.errors)} failed" if sweep.errors else ""))
    for name, entry in summary["results"].items():
        if lacking := len(sweep) - len(sweep.errors) - entry["cases"]:
            lines.append(f"missing: {name} is not finite in {lacking} cases; its statistics are over {entry['cases']}")
    lines += [f"failed: {x['reason']} ({_counted(x['cases'], x['first'])})" for x in reasons[:SHOWN]]
    return [*lines, *([f"failed: {len(reasons) - SHOWN} more reasons"] if len(reasons) > SHOWN else [])]


def _counted(count: int, cases: Sequence[int]) -> str:
    return f"{count}: {', '.join(map(str, cases[:3]))}{', ...' if count > 3 else ''}"
