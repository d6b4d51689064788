"""Motions of any size have errors relative to their size: an oscillator, and a pendulum that all but hangs at rest."""

from contextlib import nullcontext

import numpy as np
import pytest

import pinarm
from pinarm.engine.integration.methods import METHODS
from pinarm.engine.motion.segmented import hybrid_motion
from pinarm.mechanics.forces.joint_forces import JointSpring
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


@pytest.mark.parametrize("method", ADAPTIVE)
@pytest.mark.parametrize("amplitude", [1e-4, 1e-10])
def test_an_oscillation_about_a_place_far_from_0_is_right_to_the_rounding_of_its_coordinate(
    mechanism, chain, method, amplitude
):
    slide = mechanism(chain({"name": "x", "kind": "prismatic"}), gravity="none")
    spring = {"spring": JointSpring(joint="x", stiffness=100.0, rest=1.4)}
    initial = {"position": {"x": 1.4}, "velocity": {"x": 10.0 * amplitude}}
    problem = Forward(time=TimeGrid(end=3.0, samples=31), initial=initial, loads=spring)
    outcome = problem.solve(slide, Accuracy(method=method, tolerance=1e-9), lambda *path: nullcontext())
    rows = outcome.rows
    error = np.abs(rows.v[:, 0] / (10.0 * amplitude) - np.cos(10.0 * rows.grid.t)).max()
    assert error < max(1e-7, outcome.figures.get("rounding", 0.0))
    assert outcome.figures.get("rounding", 0.0) < max(1e-5, 1e-12 / amplitude)


def test_a_small_motion_whose_steps_do_not_see_it_says_that_they_err_as_much_as_it_moves(mechanism, chain, monkeypatch):
    monkeypatch.setattr(hybrid_motion, "MOST", 2)
    slide = mechanism(chain({"name": "x", "kind": "prismatic"}), gravity="none")
    spring = {"spring": JointSpring(joint="x", stiffness=100.0, rest=1.4)}
    initial = {"position": {"x": 1.4}, "velocity": {"x": 1e-9}}
    problem = Forward(time=TimeGrid(end=3.0, samples=31), initial=initial, loads=spring)
    outcome = problem.solve(slide, Accuracy(tolerance=1e-9), lambda *path: nullcontext())
    error = np.abs(outcome.rows.v[:, 0] / 1e-9 - np.cos(10.0 * outcome.rows.grid.t)).max()
    assert 1.0 < error < outcome.figures["rounding"]


@pytest.mark.parametrize("amplitude", [1e-3, 1e-12])
def test_where_weights_act_a_swing_is_as_accurate_at_any_amplitude(mechanism, chain, amplitude):
    """A point of 1 kg on 1 m swings as A cos(w t) with w^2 = g/l, but for A^2/16 per turn: no weights cancel."""
    point = {"name": "arm", "axis": "0 1 0", "com": "0 0 -1", "inertia": (0.0, 0.0, 0.0)}
    pendulum = mechanism(chain(point))
    initial = {"position": {"arm": amplitude}}
    outcome = Forward(time=TimeGrid(end=6.0, samples=31), initial=initial).solve(
        pendulum, Accuracy(), lambda *path: nullcontext()
    )
    pulsation = (1.0 - amplitude**2 / 16.0) * pendulum.gravity**0.5
    error = np.abs(outcome.rows.q[:, 0] / amplitude - np.cos(pulsation * outcome.rows.grid.t)).max()
    assert error < 1e-7  # a hundred times the tolerance
    assert outcome.figures["steps"] < 200
    assert "rounding" not in outcome.figures


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


def test_a_batch_follows_motions_that_are_small_beside_their_coordinates_as_a_run_does(mechanism, chain, tmp_path):
    mechanism(chain({"name": "x", "kind": "prismatic"}), gravity="none")
    (tmp_path / "small.yaml").write_text("""
pinarm: 1
mechanism: mechanism.yaml
problem:
  kind: forward
  time: {end: 3 s, samples: 31}
  initial: {position: {x: 1.4 m}, velocity: {x: 1e-7 m/s}}
  loads: {spring: {kind: joint_spring, joint: x, stiffness: 100 N/m, rest: 1.4 m}}
outputs: [joint.x.velocity]
""")
    speeds = np.array([1e-7, 1e-5, 1.0])
    batch = pinarm.batch(tmp_path / "small.yaml", velocity={"x": speeds})
    exact = np.cos(10.0 * np.linspace(0.0, 3.0, 31))
    assert np.abs(batch["joint.x.velocity"].values / speeds[:, None] - exact).max() < 1e-6
    over = {"problem.initial.velocity.x": "1e-7:2e-6:20 m/s"}
    swept = pinarm.sweep(tmp_path / "small.yaml", over, results=["joint.x.velocity @ end"], workers=1)
    (ends,) = (series.values for series in swept.columns if series.name == "joint.x.velocity @ end")
    assert ends / np.linspace(1e-7, 2e-6, 20) == pytest.approx(np.full(20, exact[-1]), abs=1e-6)
