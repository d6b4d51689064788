"""The table of methods: what it says of each holds, and files, schema and README follow it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Flat, Interval
from pinarm.engine.integration.methods import METHODS
from pinarm.errors import InputError, MethodError
from pinarm.problems.accuracy import Accuracy
from pinarm.use.scenario.json_schema import schema
from pinarm.use.study.accuracy.tolerance_search import CHEAPEST_STEP, TRIED

ROOT = Path(pinarm.__file__).parents[1]


def oscillator(**more):
    return Interval(0.0, 1.0, lambda t, q, v: -q, **more)


def solved(name, value, **more):
    return integrate([oscillator(**more)], Flat(1, 1), np.ones(1), np.zeros(1), METHODS[name].make(value))


@pytest.mark.parametrize("name", METHODS)
def test_the_setting_of_the_entry_is_what_the_method_takes(name):
    entry = METHODS[name]
    assert getattr(entry.make(1e-3), entry.setting) == 1e-3


@pytest.mark.parametrize("name", METHODS)
def test_a_method_refuses_exactly_the_motions_that_its_entry_excludes(name):
    known = {"energy": lambda q, v: (0.5 * v @ v, 0.5 * q @ q), "batch": lambda t, q, v: -q}
    assert len(solved(name, 1e-3, **known).steps) >= 1
    missing = {"constant energy": "energy", "open chains": "batch"}
    for requirement, key in missing.items():
        rest = {k: value for k, value in known.items() if k != key}
        if METHODS[name].requires == requirement:
            with pytest.raises(MethodError):
                solved(name, 1e-3, **rest)
        else:
            solved(name, 1e-3, **rest)


def test_files_name_every_method_and_no_other():
    for name, entry in METHODS.items():
        assert Accuracy(method=name, **{entry.setting: 1e-3}).integrator().order >= 1
    with pytest.raises(InputError, match="dop854"):
        Accuracy(method="dop854")


def test_the_schema_lists_and_describes_every_method():
    method = schema()["$defs"]["Accuracy"]["properties"]["method"]
    assert set(method["enum"]) == set(METHODS)
    assert all(f"{name}: {entry.summary}" in method["description"] for name, entry in METHODS.items())


def test_the_readme_names_every_method():
    line = next(
        line for line in (ROOT / "docs" / "kinds.md").read_text().splitlines() if line.startswith("| integrators |")
    )
    assert [name for name in METHODS if f"`{name}`" not in line] == []


@pytest.mark.parametrize("name", TRIED)
def test_the_search_for_a_tolerance_knows_the_cheapest_step(name):
    """It gives up on a method by the steps that the others' evaluations would pay for."""
    count = (solution := solved(name, 1e-6)).count
    assert count.evaluations / (len(solution.steps) + count.rejected) >= 2.0 * CHEAPEST_STEP


def test_a_run_imports_no_method_but_its_own():
    scenario = ROOT / "scenarios" / "brick_thrown.yaml"
    code = (
        f"import sys, pinarm; pinarm.load({str(scenario)!r}).run()\n"
        "print(sorted(m.rpartition('.')[2] for m in sys.modules if m.startswith('pinarm.engine.integration.methods.')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.stdout.splitlines()[-1] == "['explicit']", done.stderr
