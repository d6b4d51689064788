"""The race itself: every engine tries its settings, then the best of each run in turn."""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.race.engines import ENGINES, prepare
from benchmarks.race.engines.pinarm import evaluations
from benchmarks.race.other_load import quietly
from benchmarks.race.problems import Motion, Problem
from benchmarks.race.shares import shares
from benchmarks.race.worker import SHORT, Worker

GOALS = (1e-3, 1e-6, 1e-9)
"""Errors to reach."""

PREPARED = 120.0
"""Patience with an engine that builds its models [s]."""


PATIENCE = 10.0
"""Patience with a run, beside a multiple of the longest wanted [s]."""


LIMIT = 3.0
"""Time for one engine and problem over its budget, models and runs that hang included."""


@dataclass(frozen=True)
class Effort:
    """How much time is spent.

    Attributes:
        budget: For trying all settings of one engine on one problem [s].
        least: For each of its methods, however many there are [s].
        longest: A run that takes longer ends its method [s].
        every: Every how many settings of a method are tried.
        rounds: How often the best settings are run in turn.
    """

    budget: float
    least: float
    longest: float
    every: int
    rounds: int


FULL = Effort(45.0, 6.0, 15.0, 1, 9)
QUICK = Effort(2.0, 0.0, 0.5, 2, 3)


def run(chosen: Iterable[Problem], effort: Effort, folder: Path) -> None:
    """Run the problems that have no result in a folder yet, and write one file for each."""
    folder.mkdir(parents=True, exist_ok=True)
    workers = [Worker(engine) for engine in ENGINES]
    begin = time.monotonic()
    try:
        for problem in chosen:
            file = folder / f"{problem.name}.json"
            if not file.exists():
                _say(f"[{time.monotonic() - begin:5.0f} s] {problem.title}")
                told = {"problem": problem.name, "when": time.strftime("%Y-%m-%d")}
                file.write_text(json.dumps({**told, **_problem(problem, workers, effort)}))
    finally:
        for worker in workers:
            worker.close()


def _problem(problem: Problem, workers: list[Worker], effort: Effort) -> dict[str, Any]:
    engines: dict[str, Any] = {worker.engine: _engine(problem, worker, effort) for worker in workers}
    picked = {(worker, goal): pick(engines[worker.engine]["runs"], goal) for worker in workers for goal in GOALS}
    wanted = sorted({(worker.engine, index) for (worker, _), index in picked.items() if index is not None})
    times, others, repeated = _in_turn(workers, wanted, engines, effort)
    for (worker, goal), index in picked.items():
        if index is not None:
            engines[worker.engine]["goals"][f"{goal:g}"] = {
                "run": index, "seconds": statistics.median(times[worker.engine, index])
            }  # fmt: skip
    shown = _shares(problem, engines["pinarm"]["goals"])
    return {"engines": engines, "shares": shown, "others": others, "repeated": repeated}


def _shares(problem: Problem, goals: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Return where pinarm's time goes on the way to each goal that it reaches."""
    if not isinstance(problem, Motion):
        return {}
    settings = prepare("pinarm", problem)
    chosen = {goal: settings[found["run"]] for goal, found in goals.items()}
    return {
        goal: {**shares(setting.make()), "evaluations": evaluations(problem, setting)}
        for goal, setting in chosen.items()
    }


def pick(runs: list[dict[str, Any]], goal: float) -> int | None:
    """Return the index of the fastest run below an error."""
    good = [run for run in runs if run.get("error", goal) < goal]
    return min(good, key=lambda run: run["seconds"])["index"] if good else None


def _engine(problem: Problem, worker: Worker, effort: Effort) -> dict[str, Any]:
    """Return what an engine's settings gave: its runs, or why there are none."""
    begin, runs = time.monotonic(), []
    if isinstance(settings := prepared(worker, problem), str):
        return {"unable": settings, "runs": [], "goals": {}, "cut": False}
    methods = defaultdict(list)
    for index, (method, value) in enumerate(settings):
        methods[method].append((index, value))
    cut = False
    for method, values in methods.items():
        if time.monotonic() - begin > LIMIT * effort.budget:
            cut = True
            break
        budget = max(effort.budget / len(methods), effort.least)
        more, hurried = _method(problem, worker, effort, method, values, budget)
        runs, cut = runs + more, cut or hurried
    failures = [run["failed"] for run in runs if "failed" in run]
    spent = time.monotonic() - begin
    _say(f"  {ENGINES[worker.engine]:18s} {len(runs):3d} runs in {spent:4.0f} s, {len(failures)} failed; best error "
         f"{min((run['error'] for run in runs if 'error' in run), default=float('nan')):.1e}")  # fmt: skip
    return {"unable": "" if runs else "no run", "runs": runs, "goals": {}, "cut": cut}


def _method(
    problem: Problem, worker: Worker, effort: Effort, method: str, values: list[tuple[int, float]], budget: float
) -> tuple[list[dict[str, Any]], bool]:
    """Return the runs of one method from the coarsest, and whether time was up before the finest.

    They end as well where one takes too long, or where the process has died twice.
    """
    runs, spent, deaths = [], 0.0, 0
    for index, value in values[:: effort.every]:
        run: dict[str, Any] = {"index": index, "method": method, "value": value}
        try:
            worker.ask(("make", index), PREPARED)
            run |= worker.ask(("try", index), PATIENCE + 2.0 * effort.longest)
        except (EOFError, TimeoutError) as error:
            runs.append(run | {"failed": str(error)})
            deaths += 1 if isinstance(error, EOFError) else 2
            if isinstance(prepared(worker, problem), str) or deaths > 1:
                break
            continue
        runs.append(run)
        seconds = run.get("seconds", 0.0)
        spent += seconds * (3.0 if seconds < SHORT else 1.0)
        if seconds > effort.longest:
            break
        if spent > budget:
            return runs, True
    return runs, False


def prepared(worker: Worker, problem: Problem) -> Any:
    """Return method and value of an engine's settings, or why it has none."""
    try:
        return worker.ask(("prepare", problem), PREPARED)
    except (EOFError, TimeoutError) as error:
        return str(error)


def _in_turn(
    workers: list[Worker], wanted: list[tuple[str, int]], engines: dict[str, Any], effort: Effort
) -> tuple[dict[tuple[str, int], list[float]], float, int]:
    """Return the times of the picked settings, which all engines run in turn; slow ones less often.

    Also how many cores other programs used in a turn at most, and how many turns were repeated as these used more.
    """
    by_name = {worker.engine: worker for worker in workers}
    first = {
        (name, run["index"]): run["seconds"] for name in engines for run in engines[name]["runs"] if "seconds" in run
    }
    times: dict[tuple[str, int], list[float]] = {key: [] for key in wanted}
    dead, others, repeated = set[str](), 0.0, 0

    def asked(order: str, some: list[tuple[str, int]], patience: float) -> dict[tuple[str, int], Any]:
        """Return the answers of all engines that live: one that has died knows its settings no more."""
        found = {}
        for name, index in some:
            if name not in dead:
                try:
                    found[name, index] = by_name[name].ask((order, index), patience)
                except (EOFError, TimeoutError):
                    dead.add(name)
        return found

    asked("make", wanted, PREPARED)
    for turn in range(effort.rounds):
        some = [key for key in wanted if not (turn and first[key] * turn > effort.longest / 2)]
        found, used, more = quietly(partial(asked, "time", some, PATIENCE + 4.0 * effort.longest))
        others, repeated = max(others, used), repeated + more
        for key, seconds in found.items():
            times[key].append(seconds)
    return {key: found or [first[key]] for key, found in times.items()}, others, repeated


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
