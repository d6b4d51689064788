"""What the race found, as a page in Markdown."""

from __future__ import annotations

import json
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from textwrap import fill
from typing import Any

from benchmarks.race.engines import ENGINES
from benchmarks.race.other_load import QUIET
from benchmarks.race.problems import SAMPLES, Inverse, Problem, problems
from benchmarks.race.race import FULL, GOALS, QUICK
from benchmarks.race.references import reference
from benchmarks.race.shares import REST
from benchmarks.race.worker import FAR

PACKAGES = {"pinarm": "pinarm", "pinocchio": "pin", "mujoco": "mujoco", "drake": "drake", "exudyn": "exudyn"}
Results = dict[str, Any]

MISSING = f"""\
“never”: no setting reached it of those that take up to {FULL.longest:g} s, or {QUICK.longest:g} s with `--quick`.
“not yet”: time was up before the finest was tried. “—”: the engine cannot do it. Four-bars of equal rods pass singular
positions again and again; Bricard's linkage is overconstrained; the beam has eight segments, with stiff springs and
dampers between them; the satellite is a body that flies and tumbles, with two arms of two rods."""


def load(folder: Path) -> dict[str, Results]:
    """Return the results of a folder by problem, in the order of the problems."""
    files = {name: folder / f"{name}.json" for name in problems()}
    return {name: json.loads(file.read_text()) for name, file in files.items() if file.exists()}


def page(results: dict[str, Results], command: str, pictures: list[str]) -> str:
    """Return the whole page."""
    known = problems()
    motions = [name for name in results if not isinstance(known[name], Inverse)]
    inverses = [name for name in results if isinstance(known[name], Inverse)]
    parts = [_head(results, command), _motions(results, motions)]
    parts += [f"![{Path(picture).stem.replace('_', ' ')}]({picture})" for picture in pictures]
    parts += [_inverses(results, inverses), _wrong(results, motions), _losses(results), _shares(results, motions)]
    parts.append(_best(results, motions))
    return "\n\n".join(part for part in parts if part) + "\n"


def _head(results: dict[str, Results], command: str) -> str:
    versions = [f"{ENGINES[engine]} {_version(package)}" for engine, package in PACKAGES.items()]
    versions += [f"{name} {_version(name.lower())}" for name in ("NumPy", "SciPy")]
    day = max(result["when"] for result in results.values())
    where = f"Python {platform.python_version()}, {_processor()}, {os.cpu_count()} cores, {day}"
    others, repeated = max(each["others"] for each in results.values()), sum(r["repeated"] for r in results.values())
    machine = (f"{', '.join(versions)}; {where}. Other programs used {others:.1f} cores at most while the engines ran "
               f"in turn; turns with more than {QUIET} were repeated, {repeated} of them. Absolute times are those of "
               "that machine and day.")  # fmt: skip
    return f"""# The race

Time to an answer of a given accuracy: pinarm and other engines, from the same numbers, problem by problem in turn:

    {command}

{fill(machine, 120)}

The error of a run is the largest difference to one reference, over {SAMPLES} instants and all joint angles [rad]; of a
batch, over the last angles of all its motions. References are computed twice, on routes that share no code, and known
to the error that stands below. Every engine tries its settings, tolerances or steps from coarse to fine, in every
method that suits the problem. Of those below an error the fastest is run again in turn with the others', each time
twice in a row, and the median of the second times is given. Models are built beforehand. pinarm is timed through
`Scenario.run`, its measures of accuracy included, `pinarm.batch` without those of each motion, or `Mechanism.inverse`.
The first of a line is bold."""


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "(not installed)"


def _processor() -> str:
    with open("/proc/cpuinfo", errors="replace") as file:
        names = [line.partition(":")[2].strip() for line in file if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _seconds(result: Results, engine: str, goal: float) -> float | None:
    found = result["engines"][engine]["goals"].get(f"{goal:g}")
    return found["seconds"] if found else None


def _motions(results: dict[str, Results], names: list[str]) -> str:
    """Return time to each error, by problem and engine, and the ratio of pinarm's to the best other."""
    lines = ["## Time to an error [ms]", "",
             "| problem | error | " + " | ".join(ENGINES.values()) + " | pinarm / best other |",
             "| --- | --- |" + " ---: |" * (len(ENGINES) + 1)]  # fmt: skip
    for name in names:
        for k, goal in enumerate(GOALS):
            title = problems()[name].title if not k else ""
            times = {engine: _seconds(results[name], engine, goal) for engine in ENGINES}
            cells = [_cell(results[name], engine, seconds, times) for engine, seconds in times.items()]
            lines.append(f"| {title} | {goal:.0e} | " + " | ".join([*cells, _ratio(times)]) + " |")
    return "\n".join([*lines, "", MISSING])


def _cell(result: Results, engine: str, seconds: float | None, times: dict[str, float | None]) -> str:
    if seconds is None:
        own = result["engines"][engine]
        return "—" if own["unable"] else "not yet" if own["cut"] else "never"
    text = _milliseconds(seconds)
    return f"**{text}**" if seconds == min(t for t in times.values() if t is not None) else text


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.2g}" if seconds < 0.1 else f"{1e3 * seconds:.0f}"


def _ratio(times: dict[str, float | None]) -> str:
    others = [seconds for engine, seconds in times.items() if seconds is not None and engine != "pinarm"]
    if times["pinarm"] is None:
        return "never" if others else ""
    return f"{times['pinarm'] / min(others):.2f}" if others else "alone"


def _inverses(results: dict[str, Results], names: list[str]) -> str:
    """Return the time per sample of inverse dynamics, of the fastest setting."""
    if not names:
        return ""
    names_of_all = " | ".join(ENGINES.values())
    lines = ["## Inverse dynamics [µs a sample]", "", f"| problem | {names_of_all} | pinarm / best other |",
             "| --- |" + " ---: |" * (len(ENGINES) + 1)]  # fmt: skip
    for name in names:
        problem = problems()[name]
        assert isinstance(problem, Inverse)
        times = {engine: _seconds(results[name], engine, GOALS[-1]) for engine in ENGINES}
        least = min(t for t in times.values() if t is not None)
        cells = ["—" if t is None else f"{'**' * (t == least)}{1e6 * t / problem.samples:.2f}{'**' * (t == least)}"
                 for t in times.values()]  # fmt: skip
        lines.append(f"| {problem.title} | " + " | ".join([*cells, _ratio(times)]) + " |")
    return "\n".join(lines)


def _shares(results: dict[str, Results], names: list[str]) -> str:
    """Return where pinarm's time goes."""
    heading = {"steps": "steps", "rows": "rows of the table", "energy": "energy within steps",
               "residuals": "residuals of the rows", REST: "rest"}  # fmt: skip
    lines = ["## Where pinarm's time goes [ms]", "",
             "Energy and residuals are the measures of accuracy, which no other engine computes; they and the rows are "
             "Pinocchio's\nand NumPy's calls on all rows at once. Behind them: how many accelerations the steps take, "
             "and what one costs with all\nof the steps [µs].", "",
             f"| problem | error | {' | '.join(heading.values())} | pinarm | best other | accelerations | µs each |",
             "| --- | --- |" + " ---: |" * (len(heading) + 4)]  # fmt: skip
    for name in names:
        title = problems()[name].title
        for goal in GOALS:
            if told := results[name].get("shares", {}).get(f"{goal:g}"):
                times = {engine: _seconds(results[name], engine, goal) for engine in ENGINES}
                own, others = times.pop("pinarm"), [t for t in times.values() if t]
                assert own is not None
                cells = [_milliseconds(own * told[part]) for part in heading]
                cells += [_milliseconds(own), _milliseconds(min(others)) if others else "alone"]
                cells += [f"{told['evaluations']:.0f}", f"{1e6 * _of_an_evaluation(results[name], goal):.1f}"]
                lines.append(f"| {title} | {goal:.0e} | {' | '.join(cells)} |")
                title = ""
    return "\n".join([*lines, "", _per_loop(results)])


def _of_an_evaluation(result: Results, goal: float) -> float:
    """Return what an evaluation costs on the way to a goal that was reached [s]."""
    told, seconds = result["shares"][f"{goal:g}"], _seconds(result, "pinarm", goal)
    return seconds * told["steps"] / told["evaluations"] if seconds else 0.0


def _per_loop(results: dict[str, Results]) -> str:
    """Return how the cost of an evaluation grows with the number of loops."""
    middle = GOALS[1]
    costs = {n: _of_an_evaluation(results[name], middle) / n for n in (1, 2, 40, 100)
             if results.get(name := f"four_bar_{n}", {}).get("shares", {}).get(f"{middle:g}")}  # fmt: skip
    told = ", ".join(f"{1e6 * cost:.1f} µs with {n}" for n, cost in costs.items())
    return f"A loop of the four-bars costs, an evaluation: {told}." if told else ""


def _wrong(results: dict[str, Results], names: list[str]) -> str:
    """Return how many runs ended far off without a word."""
    lines = ["## Runs that ended wrong without saying so", "",
             f"Of all the runs that ended without an error: those that are off by more than {FAR} rad, coarse settings "
             "included;\nof the four-bars, in brackets, those on another branch (uprights no longer parallel).", "",
             "| problem | " + " | ".join(ENGINES.values()) + " |", "| --- |" + " ---: |" * len(ENGINES)]  # fmt: skip
    for name in names:
        cells = []
        for engine in ENGINES:
            runs = [run for run in results[name]["engines"][engine]["runs"] if "error" in run]
            far, other = (sum(bool(x) for x in found) for found in
                          ([run["error"] > FAR for run in runs], [run["branch"] for run in runs]))  # fmt: skip
            branch = f" ({other})" if name.startswith("four_bar") else ""
            cells.append(f"{far}{branch} of {len(runs)}" if runs else "—")
        lines.append(f"| {problems()[name].title} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _losses(results: dict[str, Results]) -> str:
    """Return where pinarm is not the first."""
    lines = []
    for name, result in results.items():
        goals = GOALS[-1:] if isinstance(problems()[name], Inverse) else GOALS
        for goal in goals:
            times = {engine: _seconds(result, engine, goal) for engine in ENGINES}
            known = {engine: t for engine, t in times.items() if t is not None}
            if not known or (first := min(known, key=lambda engine: known[engine])) == "pinarm":
                continue
            own = times["pinarm"]
            behind = "does not reach it" if own is None else f"takes {own / known[first]:.2f} times as long"
            if own and (told := result.get("shares", {}).get(f"{goal:g}")):
                bare = own * (1.0 - told["energy"] - told["residuals"])
                behind += f", {bare / known[first]:.2f} without its measures of accuracy"
            at = "" if isinstance(problems()[name], Inverse) else f", {goal:.0e}"
            lines.append(f"- {problems()[name].title}{at}: {ENGINES[first]} is first, pinarm {behind}.")
    return "\n".join(["## Where pinarm loses", "", *(lines or ["Nowhere in this run."])])


def _best(results: dict[str, Results], names: list[str]) -> str:
    """Return the best errors, what was chosen, and why an engine stands aside."""
    lines = [
        "## Best error, and the settings behind the times",
        "",
        "| problem | " + " | ".join(ENGINES.values()) + " | reference known to |",
        "| --- |" + " --- |" * (len(ENGINES) + 1),
    ]
    for name in names:
        cells = [_chosen(results[name]["engines"][engine]) for engine in ENGINES]
        lines.append(f"| {problems()[name].title} | " + " | ".join([*cells, f"{_known(problems()[name]):.0e}"]) + " |")
    return "\n".join(lines)


def _known(problem: Problem) -> float:
    return reference(problem)[1]


def _chosen(engine: Results) -> str:
    if engine["unable"]:
        return engine["unable"]
    errors = [run["error"] for run in engine["runs"] if "error" in run]
    if not errors:
        return f"all runs failed: {engine['runs'][-1]['failed']}"
    runs = {run["index"]: run for run in engine["runs"]}
    picked = [runs[goal["run"]] for goal in engine["goals"].values()]
    said = "; ".join(dict.fromkeys(f"{run['method']} {run['value']:.1e}" for run in picked))
    return f"{min(errors):.0e} ({said})" if said else f"{min(errors):.0e}"
