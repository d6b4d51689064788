"""Scenarios with the compiled kernel and without it, and with one that errs."""

import numpy as np
import pytest

import pinarm
from pinarm.engine.integration.runge_kutta import DOP853
from pinarm.engine.kernel import tree as kernel_tree
from pinarm.engine.kernel.library import LEFT_OUT
from pinarm.engine.kernel.tree import links_of

pytestmark = pytest.mark.usefixtures("compiled")

SWING = "scenarios/gen411_arm_swing.yaml"
FREE = ["gen411_arm_swing", "gyroscope_precession"]
"""Scenarios whose trees move freely."""


@pytest.mark.parametrize("name", FREE)
def test_a_run_is_the_same_with_the_library_and_without(name, calls, without):
    """To rounding, as far as the motion amplifies it: less than the tolerances of these runs, 1e-10 and 1e-12.

    A step more or less is taken where the errors of the steps are rounding, as in a steady precession.
    """
    path = f"scenarios/{name}.yaml"
    found = pinarm.run(path)
    assert calls
    taken = len(calls)
    expected = without(lambda: pinarm.run(path))
    assert len(calls) == taken, "the library has taken steps without being there"
    assert found.figures["evaluations"] == pytest.approx(expected.figures["evaluations"], abs=DOP853.stages)
    for one, other in zip((found.trajectory.q, found.trajectory.v), (expected.trajectory.q, expected.trajectory.v),
                          strict=True):  # fmt: skip
        assert np.abs(one - other).max() <= 1e-8 * np.abs(other).max()
    assert found.notes() == expected.notes()


@pytest.fixture
def heavier(monkeypatch):
    """The library knows the last link of every tree with a billionth of its mass more."""

    def wrong(model):
        known = links_of(model)
        known.links["mass"][-1] *= 1.0 + 1e-9
        return known

    monkeypatch.setattr(kernel_tree, "links_of", wrong)


@pytest.mark.usefixtures("heavier")
class TestWrongKernel:
    def test_is_not_used_and_the_run_says_so(self, calls, without):
        found = pinarm.run(SWING)
        assert not calls
        (note,) = [one for one in found.notes() if "kernel" in one]
        assert note.startswith("the compiled kernel is not used: its accelerations differ from Pinocchio's by ")
        assert np.array_equal(found.trajectory.q, without(lambda: pinarm.run(SWING)).trajectory.q)


def test_explain_says_where_it_is_missing(monkeypatch):
    from pinarm.use.study import explain

    assert "compiled kernel" not in str(pinarm.explain(SWING))
    monkeypatch.setattr(explain, "absence", lambda: LEFT_OUT)
    last = str(pinarm.explain(SWING)).splitlines()[-1]
    assert last == (f"compiled kernel: {LEFT_OUT}; steps of motions are computed in Python")
