"""A result folder read back: the same result, whose numbers are those saved. Nothing is solved again.

Only files in the folder are read, and the tables that its laws of motion name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from pinarm.arrays import Array
from pinarm.engine.labelled_array import labelled_arrays
from pinarm.engine.mechanism_loading import read_mechanism
from pinarm.engine.motion.outcome import Outcome
from pinarm.errors import InputError, require_path
from pinarm.problems.simplification import Removal
from pinarm.records import replace
from pinarm.use.facade import Result, Scenario
from pinarm.use.mechanism import Mechanism, with_methods
from pinarm.use.output import complete_folder, read_manifest
from pinarm.use.result.measures import MEASURES
from pinarm.use.result.stored_rows import AGAIN, SolvedAnew, events_of, trajectory_of
from pinarm.use.store.section_files import SECTIONS, read_sections
from pinarm.use.study.recorded import result as recorded_result

if TYPE_CHECKING:
    from pinarm.use.show.replay.page import Replay

FURTHER = re.compile(
    r"state\.(directions|other\.[0-9]{1,4}\.(?:tau|lam|further|endless)|event\.(?:names|t|q|v|before|impact)|"
    r"array\.(?:names|[0-9]{1,4}\.(?:values|rows|columns|row_units|column_units)))"
)
"""Arrays that only some results have: directions of drives with losses, other frictions that hold the motion, events,
tables."""

TEXTS = re.compile(r"guides|event\.names|array\.(?:names|[0-9]+\.(?:rows|columns|row_units|column_units))")
"""Arrays of names and units."""

NEEDED = ("scenario.yaml", "mechanism.yaml", "trajectory.npz", "summary.json", "manifest.json")
"""Files without which a folder is no result."""

STATE = ("q", "v", "a", "tau", "lam", "t", "cuts", "rows")


def restore(folder: str | Path) -> Result:
    """Return the result that a folder holds.

    Args:
        folder: As ``Result.save`` or ``python -m pinarm run`` wrote it.

    Raises:
        InputError: The folder is no result, or its files do not belong together.
    """
    require_path(folder, "a folder that 'pinarm run' wrote")
    folder = Path(folder).resolve() if Path(folder).is_symlink() else Path(folder)
    for name in NEEDED:
        if not (folder / name).is_file():
            problem = f"{folder} is no result: it has no {name}" if folder.is_dir() else f"there is no folder {folder}"
            raise InputError(problem, expected="a folder that 'pinarm run' wrote", hint=AGAIN)
        if (folder / name).is_symlink():  # what is read may be shown, in messages too
            raise InputError(
                f"{folder / name} is a symbolic link: what it leads to is no part of the result", hint=AGAIN
            )
    with complete_folder(folder):
        summary, arrays = _summary(folder / "summary.json"), _arrays(folder / "trajectory.npz")
        scenario, known = Scenario.load(folder / "scenario.yaml"), read_sections(folder / SECTIONS)
        mechanism = replace(_mechanism(folder, scenario), notes=tuple(summary["notes"]))
        manifest = read_manifest(folder)
    source = folder / manifest.source if manifest and manifest.source else None
    scenario = scenario.with_mechanism(mechanism)
    question, mechanism = scenario.problem, scenario.mechanism
    rows = trajectory_of(question, mechanism, arrays)
    if question.kind == "forward" or (question.kind == "inverse" and rows.dynamics.leaps_with_joints):
        rows = replace(rows, dynamics=rows.dynamics.at_rows(rows.grid, rows.q, rows.v))
    anew = SolvedAnew(question, scenario.content.accuracy, scenario.place, mechanism, rows)
    motion = None if rows.isolated else anew
    outcome = Outcome(rows, motion, events=events_of(arrays, mechanism.model), arrays=labelled_arrays(arrays))
    measured = {key: summary[key] for key in ("figures", "errors", "number_errors", "setting", "no_bound", "removals")}
    return replace(scenario.result(outcome), name=str(summary["scenario"]), known=known, source=source, **measured)


def replay(
    result: Result | Mechanism | str | Path,
    q: ArrayLike | None = None,
    t: ArrayLike | None = None,
    *,
    traces: Sequence[str] = (),
    arrows: Sequence[str] = (),
    plots: Sequence[str] | None = None,
    named: bool = False,
) -> Replay:
    """Return the moving picture of a result, or of configurations: ``replay(mechanism, q, t)``.

    Args:
        result: The result, or the folder that it was written to; or a mechanism, whose configurations are given.
        q: Configurations of the mechanism in pinarm's convention, shape (n, nq); see ``Mechanism.from_pinocchio``.
        t: Instants [s], shape (n,).
        traces: Links whose origins leave a path; ``com`` for the centre of mass.
        arrows: Of ``forces``, ``torques``, ``reactions``, or ``all``.
        plots: Quantities beside the picture; the outputs of the scenario where it is ``None``.
        named: Whether names of parts, points and joints are shown from the start; the key N shows and hides them.

    Raises:
        InputError: A name is unknown, the run does not have what is asked, or the folder is no result.
    """
    from pinarm.use.show.replay.page import replay_page

    if isinstance(result, Mechanism):
        if q is None or t is None:
            raise InputError("a mechanism by itself does not move", expected="replay(mechanism, q, t)")
        given = recorded_result(result, t, q)
    elif q is not None or t is not None:
        raise InputError("a result has its own configurations and instants", expected="replay(mechanism, q, t)")
    else:
        given = result if isinstance(result, Result) else restore(result)
    return replay_page(given, traces=traces, arrows=arrows, plots=plots, named=named)


def _summary(path: Path) -> dict[str, Any]:
    try:
        stored = msgspec.json.decode(path.read_bytes())
        accuracy = stored["accuracy"]
        figures = {name: accuracy[name] for name in accuracy if name in MEASURES} | stored["cost"] | stored["findings"]
        errors, of_numbers = (
            {name: float("inf") if x is None else x for name, x in accuracy.get(f"error of {what}", {}).items()}
            for what in ("outputs", "numbers")
        )
        told = *figures.values(), *errors.values(), *of_numbers.values()
        if not all(isinstance(value, int | float) for value in told):
            raise ValueError("figures that are no numbers")
        doubts = ": least multipliers; ", ": not determined in "  # which the outputs bring along themselves
        notes = [str(note) for note in stored["notes"] if not any(doubt in str(note) for doubt in doubts)]
        removals = tuple(Removal(**removal) for removal in stored["not solved for"])
        return {"scenario": stored["scenario"], "notes": notes, "removals": removals, "figures": figures,
                "errors": errors, "number_errors": of_numbers, "setting": str(accuracy.get("setting", "")),
                "no_bound": str(accuracy.get("no bound", ""))}  # fmt: skip
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}", hint=AGAIN) from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"{path} is no summary of a run ({error})", hint=AGAIN) from None


def _arrays(path: Path) -> dict[str, Array]:
    """Return the arrays behind the outputs: states, other quantities, and names of guided coordinates."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            further = [match[1] for name in stored.files if (match := FURTHER.fullmatch(name))]
            arrays = {name: stored[f"state.{name}"] for name in (*STATE, "further", "guides", *further)}
        texts = {name for name in arrays if TEXTS.fullmatch(name)}
        tables = {name for name in arrays if name.startswith("array.")} - texts
        arrays = {
            name: array if name in tables else array.astype(str if name in texts else float)
            for name, array in arrays.items()
        }
    except Exception as error:  # whatever a damaged archive raises
        raise InputError(f"{path} does not hold the states of a run ({error})", hint=AGAIN) from None
    unknown = {name for name in ("v", "a") if np.isnan(arrays[name]).all()}  # of recorded motions
    told = {name for name in further if name.rpartition(".")[2] == "further"}  # NaN of an event that takes no place
    numbers = {*STATE, *further} - unknown - texts - tables - told
    if not all(np.isfinite(arrays[name]).all() for name in numbers):
        raise InputError(f"the states in {path} are not finite")
    return arrays


def _mechanism(folder: Path, scenario: Scenario) -> Mechanism:
    """Return the mechanism, whose arguments the text of the model no longer has."""
    content = scenario.content
    mechanism = read_mechanism(
        folder / "mechanism.yaml", gravity=content.gravity, payloads=content.payloads, acted=scenario.acted
    )
    given = {name: value for name, value in content.arguments.items() if value.word is None}
    units = {name: value.unit for name, value in given.items() if value.unit is not None}
    arguments: Mapping[str, float] = {name: float(value) for name, value in given.items()}
    return with_methods(replace(mechanism, arguments=arguments, argument_units=units))
