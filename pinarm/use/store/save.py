"""A result as a folder of files. The same input gives the same bytes.

Only ``timing.json``, and so its digest in ``manifest.json``, differs from run to run.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.engine.labelled_array import PARTS, LabelledArray, plain_table
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.model_source import Source
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.roots import contained_file, root_of
from pinarm.mechanics.loading.pinocchio_model import file_suffix
from pinarm.use.assessments import FILES
from pinarm.use.output import whole_folder
from pinarm.use.result.stored_rows import arrays_of
from pinarm.use.store.files import csv_lines, json_text, write, write_arrays, yaml_text

if TYPE_CHECKING:
    from pinarm.use.result.presentation import CsvForm
    from pinarm.use.result.result import Result
    from pinarm.use.show.picture_files import PictureFormat


def save(
    result: Result,
    folder: Path,
    *,
    plots: PictureFormat | bool = True,
    dpi: int = 200,
    timing: dict[str, float] | None = None,
) -> Path:
    """Write a result.

    The folder gets ``scenario.yaml`` (as resolved: it can be run again), ``mechanism.yaml`` and the model (the
    mechanism with its arguments filled in), ``summary.json``, ``trajectory.csv``, ``trajectory.npz``, and with
    ``plots`` pictures of the outputs, as SVG where no other format is said, PNG with ``dpi`` pixels per inch;
    ``manifest.json`` has the digests of all. The tables that laws name are copied: the folder is all that ``restore``
    needs. An earlier result is replaced; of anything else see ``whole_folder``.

    Raises:
        InputError: The folder cannot be written, or holds files that are not an earlier result's; or a force is a
            function in Python.
    """
    scenario, source = folder / "scenario.yaml", result.scenario.document.path
    if functions := result.scenario.function_forces:
        raise InputError(
            f"the force '{functions[0].name}' is a function in Python, which no file holds",
            expected="a result whose forces have laws",
            hint="result.to_dataframe()",
        )
    if source is not None and scenario.exists() and scenario.resolve() == source.resolve():
        raise InputError(f"the result would overwrite its own input {scenario}", hint="another folder: -o DIR")
    with whole_folder(folder, "result", source=result.source or source) as draft:
        mechanism, laws = result.trajectory.mechanism, LawTables()
        model = f"model{file_suffix(mechanism.xml)}"
        write(draft / "summary.json", json_text(result.summary()) + "\n")
        write(draft / "scenario.yaml", _resolved(result, folder, laws))
        write(draft / "mechanism.yaml", mechanism_text(mechanism.source, model, laws))
        write(draft / model, _model(mechanism, folder))
        for name, file in (*_tables(result).values(), *laws.kept):
            write(draft / name, [file.read_bytes()])
        _write_rows(result, draft)
        _write_sections(result, draft)
        if timing:
            write(draft / "timing.json", json_text(timing) + "\n")
        if plots:
            from pinarm.use.show.picture_files import pictures, write_pictures

            write_pictures(pictures(result), draft / "plots", plots, dpi)
    return folder


def _write_rows(result: Result, draft: Path) -> None:
    columns, form = result.table_columns(), result.presentation.csv
    if result.kind == RECORDED:
        write(draft / MOTION, recorded_csv(result))
    write(draft / "trajectory.csv", csv([result.presentation.written(series) for series in columns], form))
    write_arrays(draft / "trajectory.npz", arrays(result, columns))
    if result.arrays:
        write_arrays(draft / "tables.npz", table_arrays(result.arrays))
    for name, table in result.arrays.items():
        file = draft / f"{re.sub('[^A-Za-z0-9_.-]+', '_', name)}.csv"
        write(file, array_csv(table, form))


def _write_sections(result: Result, draft: Path) -> None:
    if result.sections:
        from pinarm.use.store.files import SECTIONS, sections_text

        write(draft / SECTIONS, sections_text(result.sections))
    for section in result.written_sections.values():
        for table in section.tables:
            lines = csv_lines(table.headings(), [table.rows], result.presentation.csv)
            write(draft / f"{section.key}_{table.name}.csv", lines)


def table_arrays(tables: Mapping[str, LabelledArray]) -> dict[str, Any]:
    """Return tables by their names: numbers [SI] as ``A``, names and units as ``A.rows``, ``A.column_units``."""
    parts = ["", *(f".{part}" for part in PARTS[1:])]
    return {
        f"{name}{part}": array
        for name, table in tables.items()
        for part, array in zip(parts, plain_table(table), strict=True)
    }


def array_csv(table: LabelledArray, form: CsvForm) -> Iterator[bytes]:
    """Yield a table [SI] as CSV: names with units in the first row and column; of complex numbers both parts."""
    (rows, columns), values = table.headings(), table.values
    if np.iscomplexobj(values):
        columns = [f"{part} {name}" for name in columns for part in ("Re", "Im")]
        values = np.ascontiguousarray(values, complex).view(float)
    named = [[name, *line] for name, line in zip(rows, (values + 0.0).tolist(), strict=True)]
    return csv_lines(["", *columns], [named], form)


RECORDED, MOTION = "recorded", "recorded.csv"
"""Kind of problem whose rows are given, and the file of a result that holds them."""

CHUNK = 50_000
"""Rows of a table that are written at once: memory for more would be as much again as the table's."""


def csv(columns: Sequence[Series], form: CsvForm = "commas") -> Iterator[bytes]:
    """Yield columns as CSV, names and units in the headings; see ``csv_lines``."""
    starts = range(0, len(columns[0].values), CHUNK)
    blocks = (np.column_stack([series.values[begin : begin + CHUNK] for series in columns]) for begin in starts)
    return csv_lines([series.label for series in columns], blocks, form)


def arrays(result: Result, columns: list[Series]) -> dict[str, Any]:
    """Return the outputs by name, their units, and what is behind them as ``state.q`` and so on.

    Raises:
        InputError: An output has the name of one of these.
    """
    units = np.array([[series.name, str(series.unit or "?")] for series in columns])
    stored = {**arrays_of(result), "units": units}
    behind = {f"state.{name}": array for name, array in stored.items()}
    if taken := [series.name for series in columns if series.name in behind]:
        raise InputError(
            f"the output '{taken[0]}' has the name of an array of every result's trajectory.npz",
            expected="another name, by a symbol",
            hint=f"joint.{taken[0]}.position, of a joint",
        )
    return {**behind, **{series.name: np.asarray(series.values) for series in columns}}


def recorded_csv(result: Result) -> Iterator[bytes]:
    """Return a recorded motion as the table that gives the same rows again; derivatives of a spline are not in it."""
    from pinarm.engine.motion.recorded_motion import RecordedRows
    from pinarm.problems.recorded import named_columns

    run, splined = result.trajectory, result.data["problem"].get("derivatives") == "spline"
    v, a = (None if splined or np.isnan(x).any() else x for x in (run.v, run.a))
    tau = run.tau if run.driven is None and not run.no_efforts else None
    known = RecordedRows(run.grid.t, run.q, v, a, tau)
    columns = named_columns(run.mechanism, known)
    return csv_lines([*columns], [np.array([text.split() for text in columns.values()], float).T])


def _resolved(result: Result, folder: Path, laws: LawTables) -> str:
    """Return the scenario with every argument of the model and every default written out."""
    own = {key: value for key, value in result.data.items() if key != "changes"}  # in which paths are the mechanism's
    written = {**result.data, **laws.beside(own, result.folder)}
    if result.kind == RECORDED:
        problem = {key: value for key, value in written["problem"].items() if key != "columns"}
        written["problem"] = {**problem, "file": MOTION}
    for key, (name, _) in _tables(result).items():
        written[key] = {**written[key], FILES[key]: name}
    units = result.trajectory.mechanism.argument_units
    arguments = {
        name: f"{value!r} {units[name]}" if name in units else value
        for name, value in result.trajectory.mechanism.arguments.items()
    }
    if result.scenario.given is None:
        words = {name: value.word for name, value in result.content.arguments.items() if value.word is not None}
        written["arguments"] = {**words, **arguments}
    else:  # the model that is written has them filled in; formulas go on to know their values
        written["symbols"] = {**{name: str(value) for name, value in arguments.items()}, **result.content.symbols}
    accuracy = result.content.accuracy
    decided = accuracy.setting_keys if accuracy.target is None else result.data["accuracy"]
    written["accuracy"] = {**decided, "max_steps": accuracy.max_steps, "max_events": accuracy.max_events}
    source = Path(str(written["mechanism"]))
    if source.suffix and result.scenario.given is None:
        written["mechanism"] = os.path.relpath(result.folder / source, folder)
    written.pop("variants", None)  # which paths lead to from here, and are no part of the result
    return yaml_text(written)


def mechanism_text(source: Source, model: str, laws: LawTables) -> str:
    """Return the mechanism file for the model beside it, which has no arguments any more."""
    beside = laws.beside(source.data, source.folder)
    data = {key: value for key, value in beside.items() if key not in ("arguments", "packages")}
    base = {"base": source.base} if source.base else {}
    return yaml_text({**data, "robot": model, **base, "defects": source.defects})


class LawTables:
    """Tables that laws name, which come along with the files that name them.

    Attributes:
        kept: Their names beside these files, and where they are.
    """

    def __init__(self) -> None:
        self.kept: list[tuple[str, Path]] = []

    def beside(self, data: Any, folder: Path) -> Any:
        """Return data of a file in a folder with its tables beside it."""
        if isinstance(data, list):
            return [self.beside(value, folder) for value in data]
        if not isinstance(data, dict):
            return data
        copies = {key: self.beside(value, folder) for key, value in data.items()}
        if data.get("law") == "table" and isinstance(data.get("file"), str):
            copies["file"] = self._name((folder / data["file"]).resolve(), root_of(folder))
        return copies

    def _name(self, file: Path, root: Path) -> str:
        """Return the name of a file beside the others; numbers keep equal names of several folders apart.

        One that has been removed meanwhile, or lies outside of the root, which no law has read, stays where it is.
        """
        try:
            contained_file(file, root)
        except InputError:
            return str(file)
        known = {source: name for name, source in self.kept}
        if file not in known:
            known[file] = f"law_{len(known) + 1}_{re.sub('^law_[0-9]+_', '', file.name)}"
            self.kept.append((known[file], file))
        return known[file]


_MESH = r"""(<mesh\b[^<>]*?\bfilename\s*=\s*)(["'])(?:(?!\w+://|/)([^<]*?)|package://([^<]*?))\2"""
"""A search ends at the next element: over a comment of many beginnings it would take quadratic time."""


def _model(mechanism: Mechanism, folder: Path) -> str:
    home, packages = mechanism.source.robot.parent, mechanism.source.packages

    def named(match: re.Match[str]) -> str:
        package, _, inner = (match[4] or "").partition("/")
        if match[4] and package not in packages:
            return match[0]
        file = packages[package] / inner if match[4] else home / match[3]
        return f"{match[1]}{match[2]}{os.path.relpath(file, folder)}{match[2]}"

    return re.sub(_MESH, named, mechanism.xml)


def _tables(result: Result) -> dict[str, tuple[str, Path]]:
    named = {key: result.data[key].get(of) for key, of in FILES.items() if key in result.content.assessments}
    root = root_of(result.folder)
    return {
        key: (f"{key}_{FILES[key]}.csv", contained_file((result.folder / name).absolute(), root))
        for key, name in named.items()
        if isinstance(name, str)
    }
