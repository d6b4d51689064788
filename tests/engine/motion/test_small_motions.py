"""Motions of any size have errors relative to their size: an oscillator, and a pendulum that all but hangs at rest."""

from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.engine.integration.methods import METHODS
from pinarm.engine.motion.segmented import hybrid_motion
from pinarm.mechanics.forces.along_coordinate import JointSpring
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward
from pinarm.problems.time_grid import TimeGrid

AMPLITUDES = (1e-12, 1e-6, 1e-3, 1.0, 1e6)
ADAPTIVE = [name for name, entry in METHODS.items() if entry.setting == "tolerance"]


@pytest.fixture
def errors(mechanism, chain):
    """Return a function that gives the largest errors of ``x = A cos(10 t)`` over A, and the notes, by amplitude."""
    slide = mechanism(chain({"name": "x", "kind": "prismatic"}), gravity="none")
    spring = {"spring": JointSpring(joint="x", stiffness=100.0)}

    def measured(**accuracy):
        found = {}
        for amplitude in AMPLITUDES:
            initial = {"position": {"x": amplitude}}
            problem = Forward(time=TimeGrid(end=3.0, samples=31), initial=initial, loads=spring)
            outcome = problem.solve(slide, Accuracy(**accuracy), lambda *path: nullcontext())
            rows = outcome.rows
            found[amplitude] = np.abs(rows.q[:, 0] / amplitude - np.cos(10.0 * rows.grid.t)).max(), outcome.notes
        return found

    return measured


@pytest.mark.parametrize("method", ADAPTIVE)
def test_an_oscillator_has_the_same_relative_error_at_any_amplitude(errors, method):
    """Below 1 it is relative to a size that is known to a factor 10; beyond 1, to |y| alone, which passes 0."""
    found = {amplitude: error for amplitude, (error, _) in errors(method=method, tolerance=1e-9).items()}
    small = [found[amplitude] for amplitude in (1e-12, 1e-6, 1e-3)]
    assert max(small) < 1e-7
    assert max(small) < 10.0 * min(small)
    assert max(small) / 30.0 < min(found[1.0], found[1e6]) <= max(found[1.0], found[1e6]) < max(small)


def test_a_small_motion_whose_steps_do_not_see_it_says_that_they_err_as_much_as_it_moves(mechanism, chain, monkeypatch):
    monkeypatch.setattr(hybrid_motion, "MOST", 2)
    slide = mechanism(chain({"name": "x", "kind": "prismatic"}), gravity="none")
    spring = {"spring": JointSpring(joint="x", stiffness=100.0, rest=1.4)}
    initial = {"position": {"x": 1.4}, "velocity": {"x": 1e-9}}
    problem = Forward(time=TimeGrid(end=3.0, samples=31), initial=initial, loads=spring)
    outcome = problem.solve(slide, Accuracy(tolerance=1e-9), lambda *path: nullcontext())
    error = np.abs(outcome.rows.v[:, 0] / 1e-9 - np.cos(10.0 * outcome.rows.grid.t)).max()
    assert 1.0 < error < outcome.figures["rounding"]


def test_a_motion_as_small_as_the_rounding_of_a_weight_tells_its_error_or_is_unknown(mechanism, chain):
    """A spring carries the weight but for 1e-16 of it; it swings about the place where it does so exactly."""
    amplitude = 1e-12
    slide = mechanism(chain({"name": "x", "kind": "prismatic", "axis": "0 0 1", "mass": 0.7}))
    stretch = 0.7 * slide.gravity / 130.0
    spring = {"spring": JointSpring(joint="x", stiffness=130.0, rest=stretch)}
    initial = {"position": {"x": amplitude}}
    outcome = Forward(time=TimeGrid(end=3.0, samples=31), initial=initial, loads=spring).solve(
        slide, Accuracy(), lambda *path: nullcontext()
    )
    error = np.abs(outcome.rows.q[:, 0] / amplitude - np.cos((130.0 / 0.7) ** 0.5 * outcome.rows.grid.t)).max()
    told = outcome.figures["rounding"]
    assert error < told or told > 1.0  # larger than the motion: unknown
