"""A result as a folder of files. The same input gives the same bytes; only ``timing.json`` differs from run to run."""

from __future__ import annotations

import os
from io import StringIO
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from pinarm.engine.trajectory import Series
from pinarm.errors import InputError
from pinarm.mechanics.model import ending
from pinarm.use.files import cell, json_text, write, write_arrays, yaml_text
from pinarm.use.result import Result


def save(result: Result, folder: Path, *, plots: bool = True, timing: dict[str, float] | None = None) -> Path:
    """Write a result.

    The folder gets ``scenario.yaml`` (as resolved: it can be run again), the model, ``summary.json``,
    ``trajectory.csv``, ``trajectory.npz``, and with ``plots`` a picture per output.

    Raises:
        InputError: The folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _clear(result, folder)
        xml = result.trajectory.mechanism.xml
        write(folder / "scenario.yaml", _resolved(result, folder))
        write(folder / f"model{ending(xml)}", xml)
        write(folder / "summary.json", json_text(result.summary()) + "\n")
        columns = result.columns()
        write(folder / "trajectory.csv", csv(columns))
        write_arrays(folder / "trajectory.npz", _arrays(result, columns))
        if timing:
            write(folder / "timing.json", json_text(timing) + "\n")
    except OSError as error:
        raise InputError(f"the result cannot be written to {folder}: {error.strerror}") from None
    if plots:
        from pinarm.use.plot import save_plots

        save_plots(result, folder)
    return folder


def _clear(result: Result, folder: Path) -> None:
    """Remove what an earlier run left in the folder, and nothing else.

    Raises:
        InputError: The folder holds a scenario or a model that is not a result's, such as the input itself.
    """
    scenario = folder / "scenario.yaml"
    if any((folder / name).exists() for name in OWN) and not (folder / "summary.json").exists():
        raise InputError(f"{folder} holds files of the same names that are no result", hint="another folder: -o DIR")
    if scenario.exists() and scenario.resolve() == (result.folder / f"{result.name}.yaml").resolve():
        raise InputError(f"the result would overwrite its own input {scenario}", hint="another folder: -o DIR")
    for name in (*OWN, "summary.json", "timing.json"):
        (folder / name).unlink(missing_ok=True)
    for plot in (folder / "plots").glob("*.png"):
        plot.unlink()
    if (folder / "partial").is_dir():
        import shutil

        shutil.rmtree(folder / "partial")


OWN = ("scenario.yaml", "model.urdf", "model.xml", "trajectory.csv", "trajectory.npz")
"""Files of a result, beside the summary that marks the folder as one."""


def csv(columns: list[Series]) -> str:
    """Return columns as CSV with names and units in the first line and every digit of the numbers.

    See ``cell`` for names that look like formulas.
    """
    text = StringIO()
    text.write(",".join(cell(series.label) for series in columns) + "\n")
    np.savetxt(text, np.column_stack([series.values for series in columns]), fmt="%.17g", delimiter=",")
    return text.getvalue()


def _arrays(result: Result, columns: list[Series]) -> dict[str, Any]:
    """Return the outputs by name, their units, and the state behind them as ``state.q`` and so on."""
    run = result.trajectory
    units = np.array([[series.name, str(series.unit or "?")] for series in columns])
    state = {"state.q": run.q, "state.v": run.v, "state.a": run.a, "state.tau": run.tau, "state.units": units}
    return {**state, **{series.name: np.asarray(series.values) for series in columns}}


def _resolved(result: Result, folder: Path) -> str:
    """Return the scenario with every argument of the model and every default written out."""
    own = {key: value for key, value in result.data.items() if key != "changes"}  # in which paths are the mechanism's
    written = {**result.data, **_moved(own, result.folder, folder)}
    units = result.trajectory.mechanism.argument_units
    written["arguments"] = {
        name: f"{value!r} {units[name]}" if name in units else value
        for name, value in result.trajectory.mechanism.arguments.items()
    }
    written["accuracy"] = msgspec.to_builtins(result.content.accuracy)
    source = Path(str(written["mechanism"]))
    if source.suffix:
        written["mechanism"] = os.path.relpath(result.folder / source, folder)
    return yaml_text(written)


def _moved(data: Any, source: Path, target: Path) -> Any:
    """Return scenario data with the files of its tables named from another folder."""
    if isinstance(data, list):
        return [_moved(value, source, target) for value in data]
    if not isinstance(data, dict):
        return data
    moved = {key: _moved(value, source, target) for key, value in data.items()}
    if data.get("law") == "table":
        moved["file"] = os.path.relpath(source / data["file"], target)
    return moved
