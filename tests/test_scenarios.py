"""Every scenario that is shipped runs, meets its answer key, and tells the same of a row among few rows or many."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.motion.outcome import on_interval
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import PinarmError

FOLDER = Path(pinarm.__file__).parents[1] / "scenarios"
FILES = sorted(FOLDER.glob("*.yaml"))


LONG = re.compile(
    "forty|machine_on_mounts_shaking|rotor_balanced|four_bar_shaking|slider_crank_bearings|panda_drawing|mass_on_belt"
    "|olive_vibrator_shaking|hoist_with_losses"
)
MANY_QUANTITIES = re.compile("manipulator_(?!motion)|exoskeleton_leg_guided|andrews|bricard|two_four_bars")


def cases(slow: Callable[[Path], object]) -> pytest.MarkDecorator:
    """Return the mark of a test of all results, some of them slow."""
    marked = [pytest.param(file, id=file.stem, marks=pytest.mark.slow if slow(file) else ()) for file in FILES]
    return pytest.mark.parametrize("result", marked, indirect=True)


def of_a_kind(file: Path) -> tuple[str, str]:
    """Return the mechanism of a scenario and the kind of its problem."""
    scene = pinarm.load(file)
    return str(scene.content.mechanism), scene.content.problem["kind"]


FIRST = {key: file for file in reversed(FILES) for key in [of_a_kind(file)]}.values()
"""A scenario of each mechanism and kind of problem: others have the same quantities."""


@pytest.fixture(scope="module")
def result(request) -> pinarm.Result:
    """Return what comes out of a scenario, solved once for all that is asked of it."""
    return pinarm.load(request.param).run()


@cases(lambda file: LONG.match(file.stem))
def test_it_runs_and_meets_its_answer_key(result: pinarm.Result) -> None:
    findings = pinarm.check(FOLDER / f"{result.name}.yaml", result=result)
    assert findings
    assert [f"{f.expectation.quantity} at {f.expectation.at}: {f.reason}" for f in findings if not f.ok] == []


SOME = 20
"""Of the quantities of a scenario that are neither its symbols nor of its drives; other scenarios bring others."""


def asked(quantities: Quantities, seed: int) -> list[str]:
    """Return symbols, quantities of drives, and some of all the others."""
    run, names = quantities.trajectory, quantities.names()
    kept = {*quantities.symbols, *run.mechanism.symbols, *(one for one in names if one.startswith("drive."))}
    return [*sorted(kept), *np.random.default_rng(seed).choice(names, min(SOME, len(names)), replace=False).tolist()]


def told(quantities: Quantities, name: str) -> np.ndarray | str:
    """Return the values of a quantity, or why there are none."""
    try:
        return quantities[name].values
    except PinarmError as error:
        return error.message


def parts(result: pinarm.Result, seed: int) -> Iterator[tuple[np.ndarray, Trajectory]]:
    """Yield rows, and the same states among fewer: ends of intervals, one, some, and solved once more by themselves."""
    run, motion, random = result.trajectory, result.outcome.motion, np.random.default_rng(seed)
    intervals = [(number, rows) for number, (*_, rows) in enumerate(run.grid.intervals()) if rows.start < rows.stop]
    ends = sorted({row for _, rows in intervals for row in (rows.start, rows.stop - 1)})
    for row in [*random.permutation(ends)[:3], *random.integers(0, len(run), 1)]:
        yield np.array([row]), run.some(np.array([row]))
    rows = np.sort(random.integers(0, len(run), 5))
    yield rows, run.some(rows)
    for number, rows in intervals[:2] if motion else []:
        row = np.array([rows.stop - 1])
        yield row, on_interval(motion, run.grid.cuts, number, run.grid.t[row])


@cases(lambda file: LONG.match(file.stem) or MANY_QUANTITIES.match(file.stem) or file not in FIRST)
def test_no_figure_depends_on_how_many_rows_are_looked_at(result: pinarm.Result) -> None:
    """Rounding: 1e-10 of the largest value with the same unit, or of 1, for forces that are zero in all rows."""
    seed, sizes = len(result.name), {}
    names = asked(result.quantities, seed)
    whole = {name: told(result.quantities, name) for name in names}
    for name in names:
        if not isinstance(whole[name], str):
            unit = str(result.quantities[name].unit)
            sizes[unit] = max(sizes.get(unit, 1.0), np.nanmax(np.abs(whole[name]), initial=0.0))
    for rows, part in parts(result, seed):
        alone = result.quantities.of(part)
        for name in names:
            values = told(alone, name)
            if isinstance(whole[name], str) or isinstance(values, str):
                assert values == whole[name], (name, rows)
                continue
            floor = 1e-10 * sizes[str(result.quantities[name].unit)]
            assert values == pytest.approx(whole[name][rows], rel=1e-10, abs=floor, nan_ok=True), (name, rows)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_what_runs_is_accepted_without_solving(file: Path) -> None:
    """``test_it_runs_and_meets_its_answer_key`` solves it; ``validate`` and ``sweep`` judge it near its start."""
    assert pinarm.validate(file)


MODELS = [
    pytest.param(file, marks=pytest.mark.slow if "forty" in file.parent.name else ())
    for file in sorted((FOLDER.parent / "models").glob("*/mechanism.yaml"))
]


@pytest.mark.parametrize("file", MODELS, ids=lambda file: file.parent.name)
def test_its_mechanism_is_explained_where_it_is_closed(file: Path) -> None:
    found = pinarm.explain(file)
    assert found.mobility.mobility > 0
    assert found.mobility.regularity > 1e-3


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_something_independent_decides(file: Path) -> None:
    """A published figure alone proves little: there must be a value or formula from elsewhere."""
    expect = pinarm.load(file).content.expect
    assert any(entry.value is not None or entry.formula is not None for entry in expect)
    assert all(entry.source.strip() for entry in expect)


COMPUTABLE = {
    "two-rod arm": ("(2.9)", "(2.23)", "(4.6)", "(4.14)", "(4.22)", "(4.28)"),
    "exoskeleton": ("(3)", "0.829 for 0.826", "1.8 for 51.8"),
    "Magic Arms": ("line of V_z2", "brace", "question 4"),
}
"""Misprints that evaluate to something, by publication and equation, or line."""


def test_computable_misprints_have_an_entry_each() -> None:
    """That they are confirmed is part of the answer keys."""
    entries = [entry for file in FILES for entry in pinarm.load(file).content.expect if entry.erratum]
    named = {entry.erratum for entry in entries if entry.verdict == "misprint"}
    for publication, places in COMPUTABLE.items():
        for place in places:
            assert len([one for one in named if one.startswith(publication) and place in one]) == 1, place
    assert {entry.erratum for entry in entries if entry.verdict == "model_error"} == {"two-rod arm, all mass at l2/2"}
