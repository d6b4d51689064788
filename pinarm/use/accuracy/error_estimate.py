"""The global error of a result: solved a second time, finer and with other last digits, and compared.

The tolerance of an integration bounds the error of one step. What the errors of all steps, and of rounding, have done
to an output at the end is seen where the problem is solved again in another way: with a finer setting, and for a
mechanism whose numbers differ in their last digits. The difference is the error of the coarser solution but for that of
the finer one; where a motion is chaotic, it grows in the difference as it does in the error. ``BOUND`` times the
difference bounds the error in 99 of 100 cases.

There is no bound where measures contradict each other: where the solutions take different courses, where both have the
same residual and rounding does not explain it, and where the error of a decision at a threshold exceeds its margin.
Then the errors are infinite, and ``Result.no_bound`` says why.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.arrays import Indices
from pinarm.engine.integration.methods import METHODS, MethodName
from pinarm.engine.integration.methods.explicit import PASSED_LOADS
from pinarm.engine.motion.outcome import Decision, open_notes
from pinarm.engine.motion.segmented.segments import UNSEEN
from pinarm.engine.motion.trajectory import EventRecord, Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import NumericsError, PinarmError
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.problems.accuracy import Accuracy, setting_keys
from pinarm.records import replace
from pinarm.use.result.measures import unexplained
from pinarm.use.result.number_accuracy import output_scales, rounded_to_zero
from pinarm.use.result.numbers import AnyNumber, CombinedNumber, RunNumber, SectionNumber, read_number
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.result.section import Section

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario


BOUND = 2.0
"""Factor by which differences of solutions are multiplied, so that 99 of 100 true errors are below.

Measured by ``benchmarks/error_bound.py`` (``docs/accuracy.md``): the 99 % quantile of error over difference is 1.1 for
all methods together, and 1.5 where only rounding is left.
"""

LEAST = 1e-15
"""Relative error that no comparison in double precision can tell from none."""


OF_NUMBERS = {"limits": "keep", "sensitivity": "of"}
"""Assessment of other numbers of the run -> its key that names them."""


UNCOMPARED = "no other solution gets to the end"
"""Why there is no bound where there is nothing to compare with."""


def estimate_errors(scenario: Scenario, result: Result, others: dict[str, Result | None] | None = None) -> Result:
    """Return a result with a bound of every output's error that holds in 99 of 100 cases, and what it rests on.

    Bounds are relative to the outputs' scales, and infinite where there is none; ``setting`` names both settings.

    Args:
        scenario: Its scenario, with its setting.
        result: The result.
        others: Setting in words -> solution with other last digits, ``None`` where it failed; those that it lacks are
            solved and added.
    """
    known, accuracy = {} if others is None else others, scenario.content.accuracy
    if result.kind == "linear":
        from pinarm.use.accuracy.small_motion import checked_by_motion

        result = checked_by_motion(result)
    if "evaluations" not in result.figures:
        other = _other(scenario, accuracy.setting_keys, accuracy.max_steps, known)
        return with_errors(result, other, "against other last digits")
    used, steps = format_setting(accuracy.setting_keys), step_limit(result, accuracy.max_steps)
    setting: Mapping[str, Any]
    for setting in comparison_settings(accuracy):
        if other := _other(scenario, setting, steps, known):
            break
    else:
        return with_errors(result, None, used)
    while not takes_other_steps(result, other) and setting["method"] == accuracy.method:
        finer = finer_setting(setting, other) or other_method(accuracy.method)
        if (solved := _other(scenario, finer, steps, known)) is None:
            break
        other, setting = solved, finer
    return with_errors(result, other, f"{used}, against {format_setting(setting)} and other last digits")


def _other(
    scenario: Scenario, setting: Mapping[str, Any], max_steps: int, known: dict[str, Result | None]
) -> Result | None:
    if (name := format_setting(setting)) not in known:
        try:
            known[name] = with_setting(scenario, setting, max_steps, seed=1).solve()
        except NumericsError:
            known[name] = None
    return known[name]


def with_errors(result: Result, other: Result | None, setting: str) -> Result:
    """Return a result with the bounds of its errors by another solution, finer or at rounding; infinite without one."""
    result = _with_margins(result, other)
    against = contradiction(result, other)
    errors = dict.fromkeys(result.content.outputs, np.inf)
    if other is not None and not against:
        errors = error_bounds(result, other)
        if np.isfinite([*errors.values()]).any():
            zeros, rounding = ", ".join(rounded_to_zero(result)), _rounding(result, other)
            setting += f"; 0 but for rounding: {zeros}" if zeros else ""
            adds = f"; rounding lets errors of steps add up to {rounding:.1e} of so small a motion"
            setting += adds if rounding else ""
        else:
            other = None
    why = against or "; ".join(open_notes(result.outcome.decisions))
    result = replace(result, errors=errors, setting=setting, no_bound=why)
    if not (result.content.numbers or result.numbered):
        return result
    bounds = number_bounds(result, None if against else other)
    return replace(result, number_errors=bounds, known={**result.known, **bounded_sections(result, bounds)})


def contradiction(result: Result, other: Result | None) -> str:
    """Return why another solution gives no bound of the errors of a result; empty where it does.

    A residual is an error that is known: it should be 0. The bound by the difference has to cover it. Loads, or the end
    of a contact, that both solutions may have missed do not show in their difference.
    """
    if other is None:
        return UNCOMPARED
    if course := different_course(result, other):
        return f"two solutions take different courses: {course}"
    if missed := [note for note in other.outcome.notes if PASSED_LOADS in note or UNSEEN in note]:
        return f"of two solutions the other may have missed something, too: {missed[0]}"
    left = {name: (size, other.figures.get(name, 0.0)) for name, size in unexplained(result.figures).items()}
    same = {name: sizes for name, sizes in left.items() if BOUND * abs(sizes[0] - sizes[1]) < sizes[0]}
    kept = ", ".join(f"'{name}' {first:.2g} and {second:.2g}" for name, (first, second) in same.items())
    return f"two solutions have the same residual, {kept}: neither is the motion of the mechanism" if kept else ""


def reason_for_no_bound(result: Result, other: Result | None) -> str:
    """Return why another solution does not bound all errors of a result: a contradiction, or decisions left open."""
    return contradiction(result, other) or "; ".join(open_notes(_with_margins(result, other).outcome.decisions))


def _with_margins(result: Result, other: Result | None) -> Result:
    """Return a result whose decisions have the errors of their margins by another solution.

    Decisions that this has in another interval between events, or not at all, keep their own estimates.
    """
    known = other.outcome.decisions if other else ()
    margins = {(each.what, _interval(other, each)): each.margin for each in known if other}
    decisions = []
    for decision in result.outcome.decisions:
        margin = margins.get((decision.what, _interval(result, decision)))
        error = decision.error if margin is None else BOUND * abs(decision.margin - margin)
        decisions.append(replace(decision, error=error))
    return replace(result, outcome=replace(result.outcome, decisions=tuple(decisions)))


def _interval(result: Result, decision: Decision) -> int:
    """Return the number of the interval between events, or other jumps, in which a decision is taken."""
    return int(np.searchsorted(result.trajectory.grid.cuts, decision.t))


def error_bounds(result: Result, other: Result) -> dict[str, float]:
    """Return the bound of every output's error, relative to its scale, by another solution that contradicts nothing.

    ``BOUND`` times the difference, and where rounding has decided the steps of either, so that it is no finer, their
    own error: as much of what the output varies by as they may be wrong by of the motion. What is 0 but for rounding is
    wrong by all of it. No bound is below a residual that rounding does not explain, such as energy that is lost, and
    none is finite where a decision that is open touches the output.
    """
    rounding, differences = _rounding(result, other), output_differences(result, other)
    zeros, least = rounded_to_zero(result), max(unexplained(result.figures).values(), default=0.0)
    bounds = dict[str, float]()
    for name, scale in output_scales(result).items():
        bound = BOUND * differences[name] + rounding * float(np.ptp(result[name].values)) / scale
        is_open = any(decision.is_open and decision.touches(name) for decision in result.outcome.decisions)
        bounds[name] = np.inf if is_open else max(bound, zeros.get(name, 0.0), least)
    return bounds


def _rounding(*results: Result) -> float:
    """Return the largest figure of ``SegmentedMotion.rounding``, 0 where steps are as accurate as tolerances say."""
    return max(result.figures.get("rounding", 0.0) for result in results)


def output_differences(result: Result, other: Result) -> dict[str, float]:
    """Return the largest difference of every output of two results, relative to its scale in the first.

    In rows, and between those of motions. An instant that differs, as of an event, is a difference of every output.
    Infinite where the results take different courses.
    """
    first, second = common_rows(result.trajectory, other.trajectory)
    if not len(first) or different_course(result, other):
        return dict.fromkeys(result.content.outputs, np.inf)
    differences, t = {}, result.trajectory.grid.t
    moved = float(np.abs(t[first] - other.trajectory.grid.t[second]).max() / (np.ptp(t) or 1.0))
    elsewhere = list(between_rows(result.lookup, other.lookup))
    for name, scale in output_scales(result).items():
        pairs = [(result[name].values[first], other[name].values[second])]
        pairs += [(outputs[name].values, others[name].values) for outputs, others in elsewhere]
        difference = float(np.max([np.abs(values - others).max() for values, others in pairs]))
        differences[name] = max(difference / scale, moved, LEAST) if np.isfinite(difference) else np.inf
    return differences


def number_bounds(result: Result, other: Result | None) -> dict[str, float]:
    """Return bounds [SI] of the errors of the numbers of a result, those of sections among them, by name.

    Numbers that the run does not come to have none.
    """
    asked = {number.label: number for number in _numbers(result)}
    if search := result.known.get("find"):  # whose objective is called as the number of the run that it is
        asked["find.objective"] = read_number(search.numbers["objective"].name)
    bounds = {label: _bound(result, other, number) for label, number in asked.items()}
    return {label: bound for label, bound in bounds.items() if not np.isnan(bound)}


def _bound(result: Result, other: Result | None, number: AnyNumber) -> float:
    """Return the bound of the error of a number [SI]; NaN of one that the run does not come to.

    A number differs in both solutions by the error of the coarser one, as outputs do. Where rounding alone is left, two
    values of one number may agree by chance: it is as wrong as its output, or the worst one, at least. The bound is
    infinite where the other solution has no such number, or a decision that is open touches it. Of a formula it follows
    from those of its numbers.
    """
    value, left = _value(result, number)
    if np.isnan(value):
        return np.nan
    undecided = [decision for decision in result.outcome.decisions if decision.is_open]
    if other is None or any(decision.touches(number.label) for decision in undecided):
        return np.inf
    if isinstance(number, CombinedNumber):
        return number.of([(_value(result, part)[0], _bound(result, other, part)) for part in number.parts])[1]
    size = abs(value)
    worst = max((error for error in result.errors.values() if np.isfinite(error)), default=0.0)
    if isinstance(number, RunNumber):
        length = float(np.ptp(result.trajectory.grid.cuts)) if number.figure == "integral" else 1.0
        size = max(size, length * float(np.nanmax(np.abs(result[number.quantity].values), initial=0.0)))
        worst = result.errors.get(number.quantity, worst)
    difference = abs(_value(other, number)[0] - value)
    return np.inf if np.isnan(difference) else max(BOUND * difference, worst * size) + left


def bounded_sections(result: Result, bounds: Mapping[str, float]) -> dict[str, Section]:
    """Return the sections of a result that have numbers with bounds, by key, with these."""
    sections = {}
    for key in [*result.known, *_own(result)]:
        own = {name: bounds[label] for name in _names(result, key) if (label := f"{key}.{name}") in bounds}
        if own:
            sections[key] = result.section(key).bounded(own)
    return sections


def _numbers(result: Result) -> Iterator[AnyNumber]:
    """Yield the numbers that a result tells, but for those of sections that take many runs."""
    content = result.content
    yield from map(read_number, content.numbers)
    for key, numbers in OF_NUMBERS.items():
        if key in content.assessments:
            yield from map(read_number, getattr(content.assessments[key], numbers))
    for key in _own(result):
        yield from (SectionNumber(key, name) for name in _names(result, key))


def _own(result: Result) -> list[str]:
    """Return the keys of the sections that follow from this run alone."""
    return [key for key in result.content.assessments if key not in OF_NUMBERS]


def _names(result: Result, key: str) -> list[str]:
    """Return the names of the numbers of a section; none where the run has no such section, and says so elsewhere."""
    try:
        return list(result.section(key).numbers)
    except PinarmError:
        return []


def _value(result: Result, number: AnyNumber) -> tuple[float, float]:
    try:
        return number.value(result)
    except PinarmError:
        return np.nan, 0.0


BETWEEN = 100
"""Instants all over a run at which two are compared beside their rows: rows at the turning points of an oscillation do
not show an error of its phase."""

GOLDEN = 0.5 * (5.0**0.5 - 1.0)


def common_rows(first: Trajectory, second: Trajectory) -> tuple[Indices, Indices]:
    """Return the rows of two runs that belong together; none where that cannot be told.

    Of runs with as many jumps, rows at a jump belong together by its number, however far apart it occurs in both; other
    rows by their instants.
    """
    if first.parameter != "t":
        rows = np.arange(len(first) if len(first) == len(second) else 0)
        return rows, rows
    known, others = (_labels(run.grid, jumps=len(first.grid.cuts) == len(second.grid.cuts)) for run in (first, second))
    pairs = np.array([(row, others[label]) for label, row in known.items() if label in others], int).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _labels(grid: Grid, *, jumps: bool) -> dict[tuple[int, float], int]:
    """Return the rows of a grid by their instants, or those at ends of intervals by the number of interval and end."""
    labels = {}
    for k, (start, end, rows) in enumerate(grid.intervals()):
        for row, t in enumerate(grid.t[rows].tolist(), rows.start):
            labels[(2 * k + int(t == end) + 1, 0.0) if jumps and t in (start, end) else (0, t)] = row
    return labels


def between_rows(first: Lookup, second: Lookup) -> Iterator[tuple[Quantities, Quantities]]:
    """Yield the quantities of two motions at the same instants, interval by interval; none where these are others.

    Over the whole run, however many intervals it has, the instants are multiples of the golden ratio: they are not
    those of a period.
    """
    if not first.motion or not second.motion or len(first.intervals) != len(second.intervals):
        return
    low, high = sorted((float(first.run.grid.cuts[0]), float(first.run.grid.cuts[-1])))
    places = low + (high - low) * np.sort(GOLDEN * np.arange(1, BETWEEN + 1) % 1.0)
    for number, bounds in enumerate(zip(first.intervals, second.intervals, strict=True)):
        start, end = max(min(own[:2]) for own in bounds), min(max(own[:2]) for own in bounds)
        t = places[(places >= start) & (places <= end)]
        if len(t):
            yield first.quantities_at(number, t), second.quantities_at(number, t)


def different_course(result: Result, other: Result) -> str:
    """Return the difference of the courses of two runs in words: rows, events or changes of contact; empty if none."""
    first, second = result.trajectory, other.trajectory
    if first.parameter != "t":
        return f"they have {len(first)} and {len(second)} rows" if len(first) != len(second) else ""
    ends = f"they end at t = {first.grid.t[-1]:.9g} s and {second.grid.t[-1]:.9g} s"
    if different_events := _different_events(result.events, other.events):
        return f"{different_events}; {ends}"
    if len(first.grid.cuts) != len(second.grid.cuts):
        counts = f"{len(first.grid.cuts) - 2} and {len(second.grid.cuts) - 2} times"
        return f"contacts, friction, controllers or loads change {counts}; {ends}"
    return ""


def _different_events(events_of_one: Sequence[EventRecord], events_of_other: Sequence[EventRecord]) -> str:
    """Return in which event two sequences differ; empty where they do not."""
    first, second = ([event.name for event in events] for events in (events_of_one, events_of_other))
    counts = Counter(first), Counter(second)
    for name in dict.fromkeys((*first, *second)):
        if counts[0][name] != counts[1][name]:
            return f"'{name}' takes place {counts[0][name]} and {counts[1][name]} times"
    for a, b in zip(events_of_one, events_of_other, strict=True):
        if a.name != b.name:
            return f"'{a.name}' takes place at t = {a.t:.9g} s, and '{b.name}' in its place at {b.t:.9g} s"
    return ""


FINER = 100.0
"""Quotient of the tolerances of a solution and of the finer one that it is compared with."""

LOOSEST, TIGHTEST = 1e-2, 1e-14
"""Tolerances that can be asked for."""

GROWN = 1.5
"""Steps of a finer solution over one more than those of another from which on they are other steps: a tolerance finer
by 100 takes 1.8 times as many of order 8. Where they are the same, as samples of a controller or the end of the run
limit them, so are their errors, and the difference shows none of them: less than half, where less than half of them are
divided. One step more of few is the first one's."""

PATIENCE = 10.0
"""Steps of a finer solution over those of the coarser one beyond which it is given up; order 5 needs 2.5 times."""


def comparison_settings(accuracy: Accuracy) -> list[dict[str, Any]]:
    """Return settings whose errors differ much from that of another, finer ones first.

    A coarser one serves where the given one is at the limit of rounding: the difference is then the coarser's error.
    """
    by, own = accuracy.setting
    if by == "step":
        return [setting_keys(accuracy.method, own / 2.0), setting_keys(accuracy.method, own * 2.0)]
    near = [own / FINER, own / 10.0, own * 10.0]
    return [setting_keys(accuracy.method, value) for value in near if TIGHTEST < 1.001 * value < LOOSEST]


def finer_setting(setting: Mapping[str, Any], taken: Result) -> dict[str, Any] | None:
    """Return a finer setting where one has taken the same steps as a coarser one; ``None`` where none is so fine.

    That is a tolerance finer by another ``FINER``, or half of the mean of the steps that were taken.
    """
    if "step" in setting:
        return {**setting, "step": f"{float(np.ptp(taken.trajectory.grid.t)) / taken.figures['steps'] / 2.0!r} s"}
    tolerance = max(setting["tolerance"] / FINER, TIGHTEST)
    return {**setting, "tolerance": tolerance} if tolerance < setting["tolerance"] else None


def other_method(method: MethodName) -> dict[str, Any]:
    """Return the tightest setting of another method: its errors are others, even in steps that are the same."""
    return setting_keys("dopri5" if method == "dop853" else "dop853", TIGHTEST)


def takes_other_steps(first: Result, second: Result) -> bool:
    """Tell whether of two solutions one takes more steps than the other; see ``GROWN``."""
    fewer, more = sorted(each.figures["steps"] for each in (first, second))
    return more >= GROWN * (fewer + 1.0)


def ladder(method: MethodName, span: float) -> list[dict[str, Any]]:
    """Return settings of a method, the coarsest first: tolerances by decades from 1e-2 on, or halves of the step.

    Args:
        method: The method.
        span: Time of the motion [s], a 64th of which is the longest step.
    """
    if METHODS[method].setting == "step":
        return [setting_keys(method, float(f"{span / 2.0**rung:.3g}")) for rung in range(6, 16)]
    return [setting_keys(method, float(f"1e-{rung}")) for rung in range(2, 14)]


def step_limit(result: Result, most: int) -> int:
    """Return the number of steps after which a comparison is given up.

    Close to singular positions a tighter tolerance can be below the noise, and would take steps without end.
    """
    steps = sum(result.figures[name] for name in ("steps", "rejected steps"))
    return min(most, int(PATIENCE * steps) + 1000)


def format_setting(setting: Mapping[str, Any]) -> str:
    """Return a setting in words."""
    words = {key: f"{value:.3g}" if isinstance(value, float) else str(value) for key, value in setting.items()}
    return ", ".join(value if key == "method" else f"{key} {value}" for key, value in words.items())


def with_setting(
    scenario: Scenario, setting: Mapping[str, Any], max_steps: int | None = None, *, seed: int | None = None
) -> Scenario:
    """Return a scenario with another setting of the integration and no target, and with other last digits."""
    given = scenario.content.accuracy
    accuracy = {**setting, "max_steps": max_steps or given.max_steps, "max_events": given.max_events}
    known = scenario if seed == scenario.seed else replace(scenario, seed=seed)
    return known.varied({"accuracy": accuracy})


def reference_settings() -> list[dict[str, Any]]:
    """Return tight settings for a reference, the tightest last."""
    return [setting_keys("dop853", tolerance) for tolerance in (1e-11, 1e-12, 1e-13, 1e-14)]


def settings_by_method(result: Result) -> dict[str, list[dict[str, Any]]]:
    """Return the settings that are worth trying on a motion, by method, the coarsest first."""
    span = float(np.ptp(result.trajectory.grid.t))
    return {method: ladder(method, span)[: entry.finest - 1] for method, entry in METHODS.items()}
