"""The table of methods: what it says of each holds, and files, schema and README follow it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Flat, Interval
from pinarm.engine.integration.methods import METHODS, REMOVED
from pinarm.errors import InputError
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


SWING = ROOT / "scenarios" / "crank_rocker_free.yaml"
REMOVED_NOTE = "accuracy.method: {} was removed; dop853 integrates the motion, tolerance {:g}"


class TestRemovedMethods:
    """Files that name them are read; another method integrates the motion, and a note says which, at which setting."""

    @pytest.fixture(params=["conserving", "collocation"])
    def removed(self, request):
        return request.param

    @pytest.fixture
    def swing(self, removed):
        """Return a scenario that names a removed method."""
        return pinarm.load(SWING).varied({"accuracy": {"method": removed, "tolerance": 1e-8}})

    def test_another_method_integrates_the_motion_and_a_note_says_so(self, removed, swing):
        old, new = swing.run(), pinarm.run(SWING, {"accuracy": {"method": "dop853", "tolerance": 1e-8}})
        assert np.array_equal(old.trajectory.q, new.trajectory.q)
        assert set(old.notes()) - set(new.notes()) == {REMOVED_NOTE.format(removed, 1e-8)}

    def test_with_a_target_the_note_tells_the_setting_that_reaches_it(self, removed):
        result = pinarm.run(SWING, {"accuracy": {"method": removed, "target": 1e-4}})
        assert not result.missed
        (note,) = [note for note in result.notes() if removed in note]
        assert note.partition("was removed; ")[2] in {
            f"dop853 integrates the motion, tolerance {10.0**-rung:g}"
            for rung in range(2, 9)
            if f"dop853, tolerance {10.0**-rung:.3g}" in result.setting
        }

    def test_where_nothing_is_integrated_there_is_no_note(self, removed):
        result = pinarm.run(ROOT / "scenarios" / "gen411_arm_static.yaml", {"accuracy.method": removed})
        assert not any(removed in note for note in result.notes())

    def test_messages_do_not_suggest_it(self, removed):
        with pytest.raises(InputError) as caught:
            pinarm.load(SWING).varied({"accuracy.method": f"{removed}s"}).run()
        assert (caught.value.expected, caught.value.hint) == (f"one of {', '.join(sorted(METHODS))}", "")

    def test_a_step_is_refused_as_the_new_method_refuses_it(self, removed):
        with pytest.raises(InputError, match="the method dop853 chooses its steps"):
            Accuracy(method=removed, step="1 ms")


def test_files_name_every_method_and_no_other():
    for name, entry in METHODS.items():
        assert Accuracy(method=name, **{entry.setting: 1e-3}).integrator().order >= 1
    with pytest.raises(InputError, match="dop854"):
        Accuracy(method="dop854")


def test_the_schema_lists_and_describes_every_method():
    method = schema()["$defs"]["Accuracy"]["properties"]["method"]
    assert set(method["enum"]) == set(METHODS) | set(REMOVED)
    assert all(f"{name}: {entry.summary}" in method["description"] for name, entry in METHODS.items())


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
