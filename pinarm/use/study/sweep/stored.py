"""A folder of a sweep read back: the same table, of which nothing is solved again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.input.yaml.document import Document
from pinarm.use.result.presentation import Presentation
from pinarm.use.study.sweep.axes import Cases
from pinarm.use.study.sweep.sweep import Sweep, axes_of


def stored_sweep(folder: Path) -> Sweep:
    """Return the sweep that a folder holds.

    Raises:
        InputError: It is none, or its files do not belong together.
    """
    file, definition = folder / "sweep.yaml", Document.read(folder / "sweep.yaml").data
    try:
        base, units = definition["base"], definition.get("units", {})
        source = folder / definition["cases"] if definition.get("cases") else None
        drawn = definition.get("samples"), definition["seed"], definition["sampling"]
        cases = Cases.of(axes_of(lambda path: units.get(path, ""), definition["over"], source, *drawn))
        with np.load(folder / "cases.npz", allow_pickle=False) as arrays:
            given = {column.path for column in cases.columns()}
            columns = [
                Series(name, None if text == "?" else unit(text), arrays[name])
                for name, text in arrays["units"].tolist()
                if name not in given
            ]
            errors = {case: text for case, text in enumerate(arrays["error"].tolist()) if text}
        if {len(cases)} != {len(series.values) for series in columns}:
            raise InputError(f"{folder / 'cases.npz'} has not the cases of {file}")
        shown = Presentation.of(base.get("units", {}), base.get("labels", {}))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{folder} does not hold a sweep ({error!r})", hint="run the sweep again") from None
    name = Path(str(definition.get("scenario", folder.name))).stem
    return Sweep(name=name, title=str(base.get("title", "")), definition=definition, cases=cases, columns=columns,
                 errors=errors, presentation=shown, notes=_notes(folder))  # fmt: skip


def _notes(folder: Path) -> list[Any]:
    from msgspec import json

    return list(json.decode((folder / "summary.json").read_bytes()).get("notes", ()))
