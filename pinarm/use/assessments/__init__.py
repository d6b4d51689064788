"""Assessments: what is concluded from a run, each asked for by a key of the scenario and told as a section.

Each is imported when a scenario first asks for it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from pinarm.errors import InputError, Location, choices
from pinarm.input.yaml.schema import Deferred

ASSESSMENTS: Deferred = {
    "shaking": ("pinarm.use.assessments.shaking", "Shaking"),
    "sizing": ("pinarm.use.assessments.sizing", "Sizing"),
    "loads": ("pinarm.use.assessments.loads", "Loads"),
    "path_error": ("pinarm.use.assessments.path_error", "PathError"),
    "limits": ("pinarm.use.assessments.limits", "Limits"),
    "response": ("pinarm.use.assessments.response", "Response"),
    "sensitivity": ("pinarm.use.assessments.sensitivity", "Sensitivity"),
}
"""Key of a scenario -> module and class. A new one is a class, an entry here, and the key in ``ScenarioFile``."""


FILES = {"sizing": "catalogue", "path_error": "wanted"}
"""Assessment -> the key of it that may name a file, which a result folder keeps."""


def measured_columns(path: Path, units: Mapping[str, str], needed: Collection[str] = ()) -> dict[str, list[float]]:
    """Return the columns of a CSV file that are known, in SI, by name.

    Args:
        path: The file, which may be read.
        units: Names of known columns -> a unit of their quantity; empty for numbers without one.
        needed: Names that the table must have.

    Raises:
        InputError: None is there, one that is needed is missing, or a heading has no unit of its quantity.
    """
    from pinarm.input.csv_tables import read_columns, read_headings, split_heading
    from pinarm.input.units import unit

    heads = {(split_heading(head) or (head, ""))[0]: head for head in read_headings(str(path))}
    for name in needed if units.keys() & heads.keys() else [*needed, *units][:1]:
        if name not in heads:
            expected, hint = choices(name, heads)
            columns = ", ".join(
                f"{key} [{of}]" if of else key for key, of in {**dict.fromkeys(needed, ""), **units}.items()
            )
            message = f"the table {path.name} has no column '{name}', but {expected}"
            raise InputError(message, expected=f"the columns {columns}", hint=hint).at(Location(path.name, 1))
    state, factors = path.stat(), dict[str, float]()
    for name in units.keys() & heads.keys():
        written = (split_heading(heads[name]) or ("", None))[1]
        if units[name] and (written is None or unit(written).dimension != unit(units[name]).dimension):
            error = InputError(
                f"the heading '{heads[name]}' has no unit of this quantity", expected=f"{name} [{units[name]}]"
            )
            raise error.at(Location(path.name, 1, 1, heads[name]))
        factors[name] = unit(written).factor if written and units[name] else 1.0
    columns_by_heading = read_columns(str(path), frozenset(units), (state.st_mtime_ns, state.st_size))
    return {name: [factor * x for x in columns_by_heading[heads[name]]] for name, factor in factors.items()}
