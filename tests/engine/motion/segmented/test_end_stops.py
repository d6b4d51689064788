"""Impacts at end stops, rest on them and the way off them, against closed forms of a weight that slides up and down."""

from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.mechanics.forces.joint_definitions import JointEffort
from pinarm.mechanics.laws import Constant, ConstantSpeed
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.events import EndStop
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.time_grid import TimeGrid

MASS, G = 2.0, 9.81
WEIGHT = {"name": "weight", "kind": "prismatic", "axis": "0 0 1", "mass": MASS, "inertia": (0.1, 0.1, 0.1)}


@pytest.fixture
def fall(mechanism, chain):
    """A function that lets the weight move above a floor; its height at the samples, and when it met the floor."""
    model = mechanism(chain(WEIGHT), gravity={"direction": "-z", "magnitude": f"{G} m/s^2"})

    def run(end, *, floor=0.0, height=0.0, speed=0.0, restitution=0.0, push=None):
        problem = Forward(
            time=TimeGrid(end=end, samples=61),
            initial=InitialState(position={"weight": height}, velocity={"weight": speed}),
            loads={"push": JointEffort(joint="weight", effort=push)} if push else {},
            end_stops={"weight": EndStop(lower=floor, restitution=restitution)},
        )
        found = problem.solve(model, Accuracy(tolerance=1e-12), lambda *path: nullcontext())
        return found.rows.grid.t, found.rows.q[:, 0], np.array([one.t for one in found.events])

    return run


@pytest.mark.parametrize("floor", [0.0, -0.3, 1e3])
@pytest.mark.parametrize("factor", [1.0 + 1e-9, 1.001, 3.0])
def test_what_is_pushed_off_from_rest_leaves_and_does_not_meet_the_stop_again(fall, floor, factor):
    t, height, met = fall(1.0, floor=floor, height=floor, push=Constant(value=factor * MASS * G))
    assert len(met) == 0
    assert height - floor == pytest.approx(0.5 * (factor - 1.0) * G * t**2, abs=1e-12 * (1.0 + abs(floor)), rel=1e-9)


def test_what_rests_leaves_when_the_push_has_grown_to_its_weight(fall):
    growth, lifted = 40.0, MASS * G / 40.0
    t, height, met = fall(1.0, push=ConstantSpeed(start=0.0, speed=growth))
    assert len(met) == 0
    # a stop is given up where its push is 0, found to rounding of the push
    expected = growth * np.maximum(t - lifted, 0.0) ** 3 / (6.0 * MASS)
    assert height == pytest.approx(expected, abs=1e-11)


def test_impacts_follow_each_other_as_those_of_a_bouncing_ball_do(fall):
    drop, restitution = 1.2, 0.6
    first, speed = (2.0 * drop / G) ** 0.5, (2.0 * G * drop) ** 0.5
    pauses = 2.0 * speed / G * restitution ** np.arange(1, 29)  # until it rebounds with less than 1e-6 m/s
    expected = first + np.concatenate([[0.0], np.cumsum(pauses)])
    t, height, met = fall(3.0, height=drop, restitution=restitution)
    assert met[:20] == pytest.approx(expected[:20], abs=1e-10)
    assert len(met) == pytest.approx(np.log(1e-6 / speed) / np.log(restitution), abs=1.0)
    assert height[t > expected[-1] + 1e-5] == pytest.approx(0.0, abs=1e-13)


def test_what_is_thrown_up_from_the_stop_comes_back_once(fall):
    speed = 3.0
    t, height, met = fall(1.0, speed=speed)
    back = 2.0 * speed / G
    assert met == pytest.approx([back], abs=1e-12)
    assert height == pytest.approx(np.where(t < back, speed * t - 0.5 * G * t**2, 0.0), abs=1e-12)


@pytest.mark.parametrize(("restitution", "lost"), [(0.0, 1.0), (0.5, 1.0), (1.0, 0.0)])
def test_the_energy_that_impacts_take_is_told(mechanism, chain, restitution, lost):
    """All of m g h of what comes to rest on the stop, nothing of what bounces for ever."""
    model = mechanism(chain(WEIGHT), gravity={"direction": "-z", "magnitude": f"{G} m/s^2"})
    problem = Forward(time=TimeGrid(end=3.0, samples=61), initial=InitialState(position={"weight": 0.5}),
                      end_stops={"weight": EndStop(lower=0.0, restitution=restitution)})  # fmt: skip
    found = problem.solve(model, Accuracy(tolerance=1e-12), lambda *path: nullcontext())
    (note,) = (note for note in found.notes if note.startswith("end stop 'weight lower'"))
    assert f"the first at t = {(2 * 0.5 / G) ** 0.5:.6g} s" in note
    taken = float(note.partition(" J;")[0].rpartition(" ")[2])
    assert taken == pytest.approx(lost * MASS * G * 0.5, rel=1e-3, abs=1e-9)  # three digits are told


def test_a_motion_without_impacts_tells_none(mechanism, chain):
    model = mechanism(chain(WEIGHT), gravity={"direction": "-z", "magnitude": f"{G} m/s^2"})
    problem = Forward(time=TimeGrid(end=0.1, samples=3), initial=InitialState(position={"weight": 0.5}),
                      end_stops={"weight": EndStop(lower=0.0)})  # fmt: skip
    assert not problem.solve(model, Accuracy(), lambda *path: nullcontext()).notes
