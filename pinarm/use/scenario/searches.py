"""A scenario solved for values that bring about what its key ``find`` asks."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.checks.balance import LOST
from pinarm.errors import Interrupted, PinarmError
from pinarm.records import replace
from pinarm.use.progress import tell
from pinarm.use.result.measures import RESIDUALS
from pinarm.use.result.result import Result
from pinarm.use.result.run_number import RunNumber
from pinarm.use.result.section_number import AnyNumber
from pinarm.use.scenario.find import Find
from pinarm.use.scenario.landscape import Landscape, Trial
from pinarm.use.scenario.optimum import Optimum, optimum
from pinarm.use.scenario.optimum_section import optimum_section
from pinarm.use.scenario.roots import find_root

if TYPE_CHECKING:
    from pinarm.use.scenario.scenario import Scenario

EXACT = 1e-6
"""Residual of a run's equations, relative to their terms, above which it cannot be an optimum: they are met to rounding
in a regular position."""

VANISHED = 1e-10
"""Size of a quantity, relative to its figure at the start, below which the figure is one of rounding."""

SQUARED = ("rms", "peak")
"""Figures that are never negative and whose squares are smooth where they vanish."""


def solve_found(scenario: Scenario, search: Find) -> Result:
    """Find the unknown values and solve the problem with them.

    Raises:
        InputError: A name or a path is wrong, or what is wanted does not depend on the unknowns.
        IntegrationError: Nothing has been found.
        PinarmError: See ``Scenario.run``.
    """
    data = {key: value for key, value in scenario.document.data.items() if key != "find"}
    bare = scenario.restated(data)
    with scenario.document.locating("find"):
        search.check_names(bare.quantities(), bare.content.assessments)
        if search.wanted is not None:
            root = find_root(search, lambda values: _residuals(bare.varied(values), search))
            values, left = root.values, root.left()
        else:
            best = _best(bare, search)
            values, left = best.best.end, {}
    result = bare.varied(search.text(values)).run() if search.objective else bare.varied(search.text(values)).solve()
    result = replace(result, figures={**result.figures, **search.figures(values), **left})
    if search.objective is None:
        return result
    objective = search.objective.described(result.quantities, bare.content.assessments)
    return replace(result, known={"find": optimum_section(search, best, objective)})


def _residuals(scenario: Scenario, search: Find) -> dict[str, Array]:
    """Return the wanted quantities less their targets, at all rows, and wanted numbers of the run less theirs."""
    result, left = scenario.result(scenario.solved_outcome()), {}
    for name, target in (search.wanted or {}).items():
        number = search.number(name, scenario.content.assessments)
        values = np.array([number.value(result)[0]]) if number else result.quantities.determined(name).values
        left[name] = values - float(target)
    return left


def _best(bare: Scenario, search: Find) -> Optimum:
    """Return the values for which a number of the run is least or largest.

    Raises:
        InputError: A path leads nowhere, or a value between the bounds is none that may stand there.
    """
    objective, conditions = search.objective, search.conditions
    assert objective is not None
    for corner in (search.start, *_bounds(search)):
        bare.varied(search.text(corner))  # what cannot be read fails here, and not as a run that is refused
    sign = 1.0 if search.minimise is not None else -1.0

    runs = count(1)

    def run(values: Array) -> Trial:
        tell(f"find: run {next(runs)}")
        try:
            result = bare.varied(search.text(values)).run()
            said = _said(objective, result, floor)
            margins = tuple(condition.margin(condition.number.value(result)[0]) for condition in conditions)
        except Interrupted:
            raise
        except PinarmError as error:
            return Trial(refusal=error.message)
        finite = np.isfinite([said, *margins]).all()
        return Trial(sign * said, margins, refusal(result) if finite else "a number of the run is not finite")

    floor = 0.0
    first = run(search.start)
    floor = VANISHED * abs(first.objective) if not first.refusal else 0.0
    sizes = [abs(float(condition.bound)) for condition in conditions]
    if not first.refusal:
        sizes = [max(size, 1e-3 * abs(size - margin)) for size, margin in zip(sizes, first.margins, strict=True)]
    return optimum(
        Landscape(
            *_bounds(search), search.start, run, [condition.relation == "=" for condition in conditions],
            [size or 1.0 for size in sizes], squared=sign > 0.0 and objective.figure in SQUARED,
        ),
        search.starts, search.seed, everywhere=search.search == "global",
    )  # fmt: skip


def _said(number: AnyNumber, result: Result, floor: float) -> float:
    """Return a number of a run; where a figure of magnitudes has vanished, a bound of it: the largest of the rows.

    Rounding has no integral to any number of digits.
    """
    if isinstance(number, RunNumber) and number.figure in SQUARED:
        rows = np.abs(result[number.quantity].values)
        if rows.max() <= floor:
            return float(rows.max())
    return number.value(result)[0]


def _bounds(search: Find) -> tuple[Array, Array]:
    unknowns = search.unknown.values()
    return np.array([one.low for one in unknowns]), np.array([one.high for one in unknowns])


def refusal(result: Result) -> str:
    """Return why the accuracy of a run does not allow it to be an optimum; empty where it does."""
    if result.missed:
        return "its accuracy.target is not reached"
    if result.figures.get("energy", 0.0) >= LOST:
        return f"{result.figures['energy']:.2g} of the energy exchanged is not accounted for"
    for name in RESIDUALS:
        if name != "energy" and result.figures.get(name, 0.0) > EXACT:
            return f"its residual '{name}' is {result.figures[name]:.1e}"
    return ""
