"""The table of methods: what it says of each holds, and files, schema and README follow it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pinarm

ROOT = Path(pinarm.__file__).parents[1]


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


def test_a_run_imports_no_method_but_its_own():
    scenario = ROOT / "scenarios" / "brick_thrown.yaml"
    code = (
        f"import sys, pinarm; pinarm.load({str(scenario)!r}).run()\n"
        "print(sorted(m.rpartition('.')[2] for m in sys.modules if m.startswith('pinarm.engine.integration.methods.')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.stdout.splitlines()[-1] == "['explicit']", done.stderr
