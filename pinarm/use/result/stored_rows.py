"""A result as arrays, and the result of such arrays.

They are read from a folder, or come from another process. Solved motions hold functions, which neither can hold: states
at other instants are solved anew when they are asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.labelled_array import labelled_arrays, plain_arrays
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome, RelayedMotion, SolvedMotion
from pinarm.engine.motion.standstill import lossy
from pinarm.engine.motion.trajectory import EventRecord, Trajectory
from pinarm.errors import InputError
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

if TYPE_CHECKING:
    import pinocchio as pin

    from pinarm.errors import Place
    from pinarm.problems import Problem
    from pinarm.problems.accuracy import Accuracy
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

SAME = 1e-5
"""Difference of a motion that is solved again to its rows, relative to the largest: other processors round otherwise,
and errors grow along a motion."""

ROUNDING = 1e-12
"""Difference that is none where all is 0 [SI]."""

FOREIGN = "the states of this result are not those of its model"

AGAIN = "run the scenario again: python -m pinarm run SCENARIO -o DIR"


def arrays_of(result: Result) -> dict[str, Any]:
    """Return the arrays from which ``result_of`` makes the result of the same scenario again."""
    run, events = result.trajectory, result.events
    guides = [constraint.name for constraint in run.closure.constraints[len(run.mechanism.constraints) :]]
    arrays = {
        "q": run.q, "v": run.v, "a": run.a, "t": run.grid.t, "cuts": np.array(run.grid.cuts),
        "rows": np.array(run.grid.rows), "guides": np.array(guides, str), **_of_efforts(run),
        **({} if run.directions is None else {"directions": run.directions}),
        **{f"other.{k}.{name}": array
           for k, other in enumerate(run.others) for name, array in _of_efforts(other).items()},
    }  # fmt: skip
    if events:
        arrays["event.names"] = np.array([event.name for event in events], str)
        arrays |= {f"event.{name}": np.array([getattr(event, name) for event in events]) for name in ("t", "q", "v")}
        arrays["event.before"] = np.array([event.v if event.before is None else event.before for event in events])
        arrays["event.impact"] = np.array([event.before is not None for event in events], float)
    return {**arrays, **plain_arrays(result.arrays)}


def _of_efforts(run: Trajectory) -> dict[str, Array]:
    """Return the arrays of efforts, which rigid bodies with friction may leave undetermined."""
    further = np.array([series.values for series in run.columns.values()])
    endless = {} if run.endless is None else {"endless": run.endless.astype(float)}
    return {"tau": run.tau, "lam": run.lam, "further": further, **endless}


def result_of(
    scenario: Scenario,
    mechanism: Mechanism,
    arrays: Mapping[str, Array],
    outcome: Mapping[str, Any],
    measured: Mapping[str, Any],
) -> Result:
    """Return the result that has been made arrays.

    Args:
        scenario: Its scenario.
        mechanism: Its mechanism.
        arrays: See ``arrays_of``.
        outcome: Fields of its outcome beside these.
        measured: Its own fields that do not follow from the rows.

    Raises:
        InputError: The arrays are not those of this mechanism.
    """
    problem = scenario.problem
    rows = _trajectory(problem, mechanism, arrays)
    if problem.kind == "forward" or (problem.kind == "inverse" and rows.dynamics.leaps_with_joints):
        rows = replace(rows, dynamics=rows.dynamics.at_rows(rows.grid, rows.q, rows.v))
    anew = SolvedAnew(problem, scenario.content.accuracy, scenario.place, mechanism, rows)
    known = {"events": _events(arrays, mechanism.model), "arrays": labelled_arrays(arrays), **outcome}
    return replace(scenario.result(Outcome(rows, None if rows.isolated else anew, **known)), **measured)


def _trajectory(problem: Problem, mechanism: Mechanism, arrays: Mapping[str, Array]) -> Trajectory:
    n, (nq, nv) = len(arrays["t"]), (mechanism.model.nq, mechanism.model.nv)
    guides = [str(name) for name in arrays["guides"].reshape(-1)]
    closure = mechanism.closure.with_guides(guides, [mechanism.coordinate(name) for name in guides])
    first, efforts = problem.schema_row(mechanism), {"tau": (n, nv), "lam": (n, closure.size)}
    efforts |= {"further": (len(first.columns), n)} if first.columns else {}
    directed = "directions" in arrays or (lossy(mechanism) and not first.separate)
    others = sorted({name.rpartition(".")[0] + "." for name in arrays if name.startswith("other.")})
    states = {"q": (n, nq), "v": (n, nv), "a": (n, nv), "t": (n,)}
    _require(arrays, states | ({"directions": (n, nv)} if directed else {}))
    for prefix in ("", *others):
        endless = {"endless": (n,)} if f"{prefix}endless" in arrays else {}
        _require(arrays, {f"{prefix}{name}": shape for name, shape in {**efforts, **endless}.items()})
    grid = Grid(arrays["t"], tuple(arrays["cuts"].tolist()), tuple(int(row) for row in arrays["rows"]))
    covered = len(grid.rows) == len(grid.cuts) >= 2 and grid.rows[0] == 0 and grid.rows[-1] == n > 0
    if not covered or (np.diff(grid.rows) < 0).any():
        raise InputError(FOREIGN, hint=AGAIN)
    own = replace(
        first, grid=grid, q=arrays["q"], v=arrays["v"], a=arrays["a"], closure=closure,
        directions=arrays.get("directions"),
    )  # fmt: skip
    run, *other_runs = (_with_efforts(own, arrays, prefix) for prefix in ("", *others))
    return replace(run, others=tuple(other_runs))


def _require(arrays: Mapping[str, Array], shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Raise where arrays lack, or have other shapes."""
    if any(name not in arrays or arrays[name].shape != shape for name, shape in shapes.items()):
        raise InputError(FOREIGN, hint=AGAIN)


def _with_efforts(run: Trajectory, arrays: Mapping[str, Array], prefix: str) -> Trajectory:
    further = zip(run.columns.items(), arrays[f"{prefix}further"], strict=False)
    columns = {name: replace(series, values=row) for (name, series), row in further}
    endless = arrays.get(f"{prefix}endless")
    tau, lam = (arrays[f"{prefix}{name}"] for name in ("tau", "lam"))
    return replace(run, tau=tau, lam=lam, columns=columns, endless=None if endless is None else endless.astype(bool))


def _events(arrays: Mapping[str, Array], model: pin.Model) -> tuple[EventRecord, ...]:
    """Return the events and impacts, in order of time."""
    if "event.names" not in arrays:
        return ()
    names, n = arrays["event.names"].reshape(-1).tolist(), arrays["event.names"].size
    shapes = {"t": (n,), "q": (n, model.nq), "v": (n, model.nv), "before": (n, model.nv), "impact": (n,)}
    _require(arrays, {f"event.{name}": shape for name, shape in shapes.items()})
    t, q, v, before, impact = (arrays[f"event.{name}"] for name in shapes)
    return tuple(
        EventRecord(str(name), float(t[k]), q[k], v[k], before[k] if impact[k] else None)
        for k, name in enumerate(names)
    )


class SolvedAnew(RelayedMotion, Record, frozen=True):
    """The motion of a result that was read: solved when other instants than the saved ones are asked for.

    Attributes:
        problem: The question.
        accuracy: How accurate its answer is wanted.
        place: Gives errors their place in it.
        mechanism: The mechanism, as it was saved.
        rows: The states that are known of it.
    """

    problem: Problem
    accuracy: Accuracy
    place: Place
    mechanism: Mechanism
    rows: Trajectory

    @cached_property
    def _motion(self) -> SolvedMotion:
        outcome = self.problem.solve(self.mechanism, self.accuracy, self.place)
        assert outcome.motion is not None
        self._require_same(outcome.rows)
        return outcome.motion

    def _require_same(self, anew: Trajectory) -> None:
        """Refuse a motion that does not lead through the rows."""
        for name in ("q", "v", "tau"):
            known, solved = getattr(self.rows, name), getattr(anew, name)
            allowed = ROUNDING + SAME * np.abs(known).max(initial=0.0)
            if known.shape != solved.shape or np.abs(solved - known).max(initial=0.0) > allowed:
                raise InputError(
                    "between the rows of this result its motion has to be solved again, and that leads elsewhere: a "
                    "function in Python drives it, its files or pinarm are others now, or errors grow along it",
                    expected="quantities at the rows",
                    hint=AGAIN,
                )

    def at(self, grid: Grid) -> Trajectory:
        """Return the states at other values of the parameter.

        Raises:
            PinarmError: The problem cannot be solved any more.
        """
        return self._motion.at(grid)

    def positions(self, t: Array) -> Array:
        return self._motion.positions(t)

    @property
    def relayed(self) -> SolvedMotion:
        return self._motion
