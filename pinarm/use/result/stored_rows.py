"""The rows of a result as arrays, and the states of a result from such arrays.

They are read from a folder, or come from another process. Solved motions hold functions, which neither can hold: states
at other instants are solved anew when they are asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import RelayedMotion, SolvedMotion
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

SAME = 1e-5
"""Difference of a motion that is solved again to its rows, relative to the largest: other processors round otherwise,
and errors grow along a motion."""

ROUNDING = 1e-12
"""Difference that is none where all is 0 [SI]."""

EFFORTS, NOTHING = ("tau", "lam", "further"), np.zeros(0)

AGAIN = "run the scenario again: python -m pinarm run SCENARIO -o DIR"


def states(run: Trajectory) -> dict[str, Any]:
    """Return the arrays from which ``trajectory_of`` makes the states of a run again, for the same scenario."""
    guides = [constraint.name for constraint in run.closure.constraints[len(run.mechanism.constraints) :]]
    return {
        "q": run.q, "v": run.v, "a": run.a, "t": run.grid.t, "cuts": np.array(run.grid.cuts),
        "rows": np.array(run.grid.rows), "guides": np.array(guides, str), **_of_efforts(run),
        **({} if run.directions is None else {"directions": run.directions}),
        **{f"other.{k}.{name}": array
           for k, other in enumerate(run.others) for name, array in _of_efforts(other).items()},
    }  # fmt: skip


def event_arrays(events: Sequence[EventRecord]) -> dict[str, Any]:
    """Return the arrays from which ``events_of`` makes events and impacts again; none where there are none."""
    if not events:
        return {}
    return {
        "event.names": np.array([event.name for event in events], str),
        "event.t": np.array([event.t for event in events]),
        "event.q": np.array([event.q for event in events]),
        "event.v": np.array([event.v for event in events]),
        "event.before": np.array([event.v if event.before is None else event.before for event in events]),
        "event.impact": np.array([event.before is not None for event in events], float),
    }


def events_of(arrays: Mapping[str, Array], model: pin.Model) -> tuple[EventRecord, ...]:
    """Return the events and impacts of a result, in order of time; see ``event_arrays``.

    Raises:
        InputError: The arrays are not those of this model.
    """
    if "event.names" not in arrays:
        return ()
    names, n = arrays["event.names"].reshape(-1).tolist(), arrays["event.names"].size
    wanted = {"t": (n,), "q": (n, model.nq), "v": (n, model.nv), "before": (n, model.nv), "impact": (n,)}
    if any(arrays.get(f"event.{name}", NOTHING).shape != shape for name, shape in wanted.items()):
        raise InputError("the events of this result are not those of its model", hint=AGAIN)
    t, q, v, before, impact = (arrays[f"event.{name}"] for name in wanted)
    return tuple(
        EventRecord(str(name), float(t[k]), q[k], v[k], before[k] if impact[k] else None)
        for k, name in enumerate(names)
    )


def _of_efforts(run: Trajectory) -> dict[str, Array]:
    """Return the arrays of efforts, which rigid bodies with friction may leave undetermined."""
    further = np.array([series.values for series in run.columns.values()])
    endless = {} if run.endless is None else {"endless": run.endless.astype(float)}
    return {"tau": run.tau, "lam": run.lam, "further": further, **endless}


def _with_efforts(run: Trajectory, arrays: Mapping[str, Array], prefix: str = "") -> Trajectory:
    further = zip(run.columns.items(), arrays[f"{prefix}further"], strict=False)
    columns = {name: replace(series, values=row) for (name, series), row in further}
    endless = arrays.get(f"{prefix}endless", NOTHING).astype(bool)
    if len(endless) not in (0, len(run)):
        raise InputError("the frictions of this result are not those of its model", hint=AGAIN)
    tau, lam = (arrays[f"{prefix}{name}"] for name in ("tau", "lam"))
    return replace(run, tau=tau, lam=lam, columns=columns, endless=endless if len(endless) else None)


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


def trajectory_of(problem: Problem, mechanism: Mechanism, arrays: Mapping[str, Array]) -> Trajectory:
    """Return the states of a result; see ``states``.

    Raises:
        InputError: The arrays are not those of this mechanism.
    """
    n = len(arrays["t"])
    guides = [str(name) for name in arrays["guides"].reshape(-1)]
    closure = mechanism.closure.with_guides(guides, [mechanism.coordinate(name) for name in guides])
    first, (nq, nv) = problem.schema_row(mechanism), (mechanism.model.nq, mechanism.model.nv)
    wanted = {"q": (n, nq), "v": (n, nv), "a": (n, nv), "tau": (n, nv), "lam": (n, closure.size), "t": (n,)}
    wanted |= {"further": (len(first.columns), n)} if first.columns else {}
    if "directions" in arrays or (lossy(mechanism) and not first.separate):
        wanted["directions"] = (n, nv)
    grid = Grid(arrays["t"], tuple(arrays["cuts"].tolist()), tuple(int(row) for row in arrays["rows"]))
    shapes = {name: arrays[name].shape for name in wanted if name in arrays}
    if n == 0 or shapes != wanted or not _fits(grid):
        raise InputError("the states of this result are not those of its model", hint=AGAIN)
    own = replace(
        first, grid=grid, q=arrays["q"], v=arrays["v"], a=arrays["a"], closure=closure,
        directions=arrays.get("directions"),
    )  # fmt: skip
    prefixes = sorted({name.rpartition(".")[0] + "." for name in arrays if name.startswith("other.")})
    if any(
        arrays.get(f"{prefix}{name}", NOTHING).shape != arrays[name].shape for prefix in prefixes for name in EFFORTS
    ):
        raise InputError("the frictions of this result are not those of its model", hint=AGAIN)
    return replace(_with_efforts(own, arrays), others=tuple(_with_efforts(own, arrays, start) for start in prefixes))


def _fits(grid: Grid) -> bool:
    rows = np.array(grid.rows)
    covers = len(rows) == len(grid.cuts) >= 2 and rows[0] == 0 and rows[-1] == len(grid.t)
    return bool(covers and (np.diff(rows) >= 0).all())
