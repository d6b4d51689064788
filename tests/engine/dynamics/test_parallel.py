"""Calls on many states, on one core and on all."""

import os
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.dynamics import parallel
from pinarm.engine.dynamics.parallel import Parallel


class TestThreads:
    """Calls on many states use all cores; the numbers are those of one."""

    @pytest.mark.parametrize("call", ["rnea", "aba"])
    def test_they_change_no_digit(self, call, monkeypatch):
        model = pin.buildSampleModelManipulator()
        states = np.random.default_rng(0).normal(size=(3, 500, model.nv))
        monkeypatch.setattr(parallel, "threads", lambda: 2)
        monkeypatch.setattr(parallel, "cores", lambda: 2)
        alone = getattr(Parallel(model), call)(*states)
        monkeypatch.setattr(parallel, "MANY", 1)
        assert np.array_equal(getattr(Parallel(model), call)(*states), alone)

    @staticmethod
    def chosen(pace, seconds, calls):
        """Return with how many threads of two some calls were made that take so long with each."""
        found = []
        for _ in range(calls):
            found.append(pace.choice(2))
            pace.note(found[-1], seconds[found[-1]])
        return found

    def test_the_faster_number_of_them_is_taken_and_the_other_tried_again(self):
        """Another program takes the second core for a while: the less the slower way is worth, the rarer it is."""
        pace = parallel.ThreadTiming()
        assert self.chosen(pace, {1: 2.0, 2: 1.0}, 300)[:3] == [2, 1, 2]
        assert self.chosen(pace, {1: 2.0, 2: 1.0}, 640).count(1) == 640 / (2.0 * parallel.RARELY)
        busy = self.chosen(pace, {1: 2.0, 2: 20.0}, 640)
        assert busy[3:30] == [1] * 27
        assert busy.count(2) <= 10
        assert self.chosen(pace, {1: 2.0, 2: 1.0}, 900)[-300:].count(2) >= 290

    def test_one_call_that_is_held_up_changes_nothing(self):
        pace = parallel.ThreadTiming()
        self.chosen(pace, {1: 2.0, 2: 1.0}, 10)
        pace.note(2, 100.0)
        assert pace.choice(2) == 2

    def test_small_calls_have_one(self, monkeypatch):
        monkeypatch.setattr(parallel, "threads", lambda: 2)
        model = pin.buildSampleModelManipulator()
        small = Parallel(model)
        for _ in range(3):
            small.aba(*np.zeros((3, parallel.FEW // model.nv, model.nv)))
        assert [set(pace.spent) for pace in small._paces.values()] == [{1}]

    @pytest.mark.parametrize(("said", "found"), [("1", 1), ("", 3), ("2,1", 2), ("9", 3), ("0", 1), ("many", 3)])
    def test_the_environment_may_allow_fewer(self, monkeypatch, said, found):
        monkeypatch.setattr(parallel, "cores", lambda: 3)
        monkeypatch.setenv("OMP_NUM_THREADS", said)
        assert parallel.threads() == found


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_forked_process_takes_one_thread():
    """OpenMP counts on threads that a fork does not have, and would wait for them for ever."""
    script = (
        "import multiprocessing, numpy, pinocchio\n"
        "from pinarm.engine.dynamics import parallel\n"
        "parallel.cores, parallel.MANY = (lambda: 2), 1\n"
        "model = pinocchio.buildSampleModelManipulator()\n"
        "states = numpy.random.default_rng(0).normal(size=(3, 500, model.nv))\n"
        "own = parallel.Parallel(model)\n"
        "first, known = own.rnea(*states), parallel.threads()\n"
        "def child(out):\n"
        "    out.put((parallel.threads(), numpy.array_equal(own.rnea(*states), first)))\n"
        "context = multiprocessing.get_context('fork')\n"
        "out = context.Queue()\n"
        "process = context.Process(target=child, args=(out,), daemon=True)\n"
        "process.start()\n"
        "print(known, *out.get(timeout=20))\n"
    )
    environment = {**os.environ, "OMP_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["2", "1", "True"], done.stderr
