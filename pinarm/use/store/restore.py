"""A result folder read back: the same result, whose numbers are those saved. Nothing is solved again.

Only files in the folder are read, and the tables that its laws of motion name.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.equation import Dynamics
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.common import bind_loads
from pinarm.problems.simplify.simplified import Removal
from pinarm.use.result.result import MEASURES, Result
from pinarm.use.scenario.scenario import Scenario

NEEDED = ("scenario.yaml", "mechanism.yaml", "trajectory.npz", "summary.json")
"""Files without which a folder is no result."""

AGAIN = "run the scenario again: python -m pinarm run SCENARIO -o DIR"
STATE = ("q", "v", "a", "tau", "lam", "t", "cuts", "rows")


def restore(folder: str | Path) -> Result:
    """Return the result that a folder holds.

    Args:
        folder: As ``Result.save`` or ``python -m pinarm run`` wrote it.

    Raises:
        InputError: The folder is no result, or its files do not belong together.
    """
    folder = Path(folder)
    for name in NEEDED:
        if not (folder / name).is_file():
            problem = f"{folder} is no result: it has no {name}" if folder.is_dir() else f"there is no folder {folder}"
            raise InputError(problem, expected="a folder that 'pinarm run' wrote", hint=AGAIN)
    summary, arrays = _summary(folder / "summary.json"), _arrays(folder / "trajectory.npz")
    scenario = Scenario.load(folder / "scenario.yaml")
    content = scenario.content
    mechanism = replace(_mechanism(folder, scenario), notes=tuple(summary["notes"]))
    run = _trajectory(scenario, mechanism, arrays)
    figures = summary["figures"]
    quantities = Quantities(replace(run, figures=figures), scenario.symbols, content.undetermined)
    name, kind = str(summary["scenario"]), scenario.problem.kind
    data, told = scenario.document.data, {key: summary[key] for key in ("errors", "setting", "removals")}
    return Result(name, kind, content, data, quantities, figures, folder, **told)


def _summary(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        accuracy = found["accuracy"]
        figures = {name: accuracy[name] for name in accuracy if name in MEASURES} | found["cost"] | found["findings"]
        errors = {name: float("inf") if x is None else x for name, x in accuracy.get("error of outputs", {}).items()}
        if not all(isinstance(value, int | float) for value in (*figures.values(), *errors.values())):
            raise ValueError("figures that are no numbers")
        doubts = ": least multipliers; "  # which the outputs bring along themselves
        notes = [str(note) for note in found["notes"] if doubts not in str(note)]
        removals = tuple(Removal(**one) for one in found["not solved for"])
        return {"scenario": found["scenario"], "notes": notes, "removals": removals, "figures": figures,
                "errors": errors, "setting": str(accuracy.get("setting", ""))}  # fmt: skip
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is no summary of a run ({error})", hint=AGAIN) from None


def _arrays(path: Path) -> dict[str, Array]:
    """Return what is behind the outputs: states, other quantities, and names of guided coordinates.

    Raises:
        InputError: They are missing, or the states are no finite numbers.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            found = {name: np.asarray(arrays[f"state.{name}"], float) for name in (*STATE, "further")}
            found["guides"] = arrays["state.guides"].astype(str)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} does not hold the states of a run ({error})", hint=AGAIN) from None
    if not all(np.isfinite(found[name]).all() for name in STATE):
        raise InputError(f"the states in {path} are not finite")
    return found


def _mechanism(folder: Path, scenario: Scenario) -> Mechanism:
    """Return the mechanism, whose arguments the text of the model no longer has."""
    mechanism = Mechanism.load(folder / "mechanism.yaml", gravity=scenario.content.gravity,
                               payloads=scenario.content.payloads)  # fmt: skip
    given = scenario.content.arguments
    units = {name: value.unit for name, value in given.items() if value.unit is not None}
    arguments: Mapping[str, float] = {name: float(value) for name, value in given.items()}
    return replace(mechanism, arguments=arguments, argument_units=units)


def _trajectory(scenario: Scenario, mechanism: Mechanism, arrays: Mapping[str, Array]) -> Trajectory:
    """Return the motion; asked for other instants, it is solved anew.

    Raises:
        InputError: The arrays are not those of this mechanism.
    """
    problem, place, n = scenario.problem, scenario.document.locating, len(arrays["t"])
    guides = [str(name) for name in arrays["guides"].reshape(-1)]
    closure = mechanism.closure.with_guides(guides, [mechanism.coordinate(name) for name in guides])
    still, (nq, nv) = problem.still(mechanism), (mechanism.model.nq, mechanism.model.nv)
    wanted = {"q": (n, nq), "v": (n, nv), "a": (n, nv), "tau": (n, nv), "lam": (n, closure.size), "t": (n,)}
    wanted |= {"further": (len(still.further), n)} if still.further else {}
    grid = Grid(arrays["t"], tuple(arrays["cuts"].tolist()), tuple(int(row) for row in arrays["rows"]))
    if n == 0 or any(arrays[name].shape != shape for name, shape in wanted.items()) or not _fits(grid):
        raise InputError("the states of this result are not those of its model", hint=AGAIN)
    further = {name: replace(series, values=row)
               for (name, series), row in zip(still.further.items(), arrays["further"], strict=False)}  # fmt: skip
    loads = bind_loads(mechanism, getattr(problem, "loads", {}), lambda *at: place("problem", *at))
    again = lambda other: problem.solve(mechanism, scenario.content.accuracy, place).again(other)  # noqa: E731
    lam = Multipliers.known(arrays["lam"], mechanism.closure.size)
    return replace(
        still, grid=grid, q=arrays["q"], v=arrays["v"], a=arrays["a"], tau=arrays["tau"], lam=lam,
        closure=closure, dynamics=Dynamics.of(mechanism.model, loads), again=again, further=further,
    )  # fmt: skip


def _fits(grid: Grid) -> bool:
    """Tell whether the intervals of a grid cover its rows, in order."""
    rows = np.array(grid.rows)
    covers = len(rows) == len(grid.cuts) >= 2 and rows[0] == 0 and rows[-1] == len(grid.t)
    return bool(covers and (np.diff(rows) >= 0).all())
