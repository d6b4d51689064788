"""A result folder read back: the same result, whose numbers are those saved. Nothing is solved again.

Only files in the folder are read, and the tables that its laws of motion name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from pinarm.arrays import Array
from pinarm.engine.mechanism_loading import read_mechanism
from pinarm.errors import InputError, require_path
from pinarm.problems.simplification import Removal
from pinarm.records import replace
from pinarm.use.facade import Result, Scenario
from pinarm.use.mechanism import Mechanism, with_methods
from pinarm.use.output import complete_folder, read_manifest
from pinarm.use.result.measures import MEASURES
from pinarm.use.result.stored_rows import AGAIN, result_of
from pinarm.use.store.files import SECTIONS, read_sections
from pinarm.use.study.recorded import result as recorded_result

if TYPE_CHECKING:
    from pinarm.use.show.replay.page import Replay

NEEDED = ("scenario.yaml", "mechanism.yaml", "trajectory.npz", "summary.json", "manifest.json")
"""Files without which a folder is no result."""

STATE = ("q", "v", "a", "tau", "lam", "t", "cuts", "rows")
STORED = "state."
"""Beginning of the names of arrays behind the outputs."""


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
    measured = {key: summary[key] for key in ("figures", "errors", "number_errors", "setting", "no_bound", "removals")}
    measured |= {"name": str(summary["scenario"]), "known": known, "source": source}
    return cast("Result", result_of(scenario, scenario.mechanism, arrays, {}, measured))


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
    """Return the arrays behind the outputs, see ``arrays_of``: numbers that are finite, and texts."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name.removeprefix(STORED): stored[name] for name in stored.files if name.startswith(STORED)}
        states = {name: array.astype(float) for name, array in arrays.items() if _is_state(name, array)}
        unknown = {name for name in ("v", "a") if np.isnan(states[name]).all()}  # of recorded motions
        if not all(np.isfinite(states[name]).all() for name in {*STATE, *states} - unknown):
            raise InputError(f"the states in {path} are not finite")
        return {**arrays, **states}
    except InputError:
        raise
    except Exception as error:  # whatever a damaged archive raises
        raise InputError(f"{path} does not hold the states of a run ({error})", hint=AGAIN) from None


def _is_state(name: str, array: Array) -> bool:
    """Tell whether an array holds states, which are finite; in tables, and in columns of events, values may lack."""
    if array.dtype.kind not in "Uifc":
        raise ValueError(f"{name} holds neither numbers nor texts")
    return array.dtype.kind != "U" and not name.startswith("array.") and name.rpartition(".")[2] != "further"


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
