"""Crossings that are looked for while integrating: found where they are, each once, none missed."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import pinarm
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Interval, Manifold, Watch
from pinarm.engine.integration.methods import METHODS
from pinarm.engine.integration.methods.explicit import Adaptive, FixedStep

LINE = Manifold(1, 1)
TIGHT = Adaptive(1e-11)
LOOSE = {"tolerance": 1e-9, "step": 4e-3}


def oscillator(end, watches, method=TIGHT):
    """The unit oscillator from (0, 1): q = sin t."""
    interval = Interval(0.0, end, lambda t, q, v: -q)
    return integrate([interval], LINE, np.zeros(1), np.ones(1), method, watches=watches)


def position(level, direction=0, stops=False):
    return Watch(lambda t, q, v: q[:, 0] - level, direction, stops)


@pytest.mark.parametrize("name", [name for name, entry in METHODS.items() if entry.make(1e-9).order >= 4])
def test_they_are_where_the_closed_form_crosses_with_every_method(name):
    found = oscillator(20.0, [position(0.3)], METHODS[name].make(LOOSE[METHODS[name].setting])).crossings
    rising, falling = np.arcsin(0.3), np.pi - np.arcsin(0.3)
    exact = sorted(t for k in range(4) for t in (rising + 2 * np.pi * k, falling + 2 * np.pi * k) if t < 20.0)
    assert [one.t for one in found] == pytest.approx(exact, abs=3e-7)  # dense output between steps of 1e-9
    assert np.array([one.q[0] for one in found]) == pytest.approx(0.3, abs=1e-13)  # digits of t near 20 s: 4e-15 s


@pytest.mark.parametrize(("direction", "slopes"), [(1, {1.0}), (-1, {-1.0}), (0, {1.0, -1.0})])
def test_direction_is_that_of_the_crossing(direction, slopes):
    found = oscillator(20.0, [position(0.3, direction)]).crossings
    assert {float(np.sign(one.v[0])) for one in found} == slopes


def test_a_watch_that_stops_ends_the_solution_there():
    solution = oscillator(20.0, [position(0.3, -1, stops=True), position(-2.0)])
    assert solution.end == pytest.approx(np.pi - np.arcsin(0.3), abs=1e-10)
    assert solution.states(np.array([solution.end]))[0][0, 0] == pytest.approx(0.3, abs=1e-14)
    assert np.array_equal(solution.last, np.concatenate([solution.crossings[-1].q, solution.crossings[-1].v]))


def test_two_crossings_within_one_long_step_are_both_found():
    """A free flight is one step of any length; its top is passed through 1e-6 below, in a millionth of the step."""
    flight = Interval(0.0, 10.0, lambda t, q, v: np.array([-2.0]))
    height = 25.0 - 1e-6  # of q = 10 t - t^2, whose top is at t = 5
    solution = integrate([flight], LINE, np.zeros(1), np.array([10.0]), Adaptive(1e-6), watches=[position(height)])
    assert solution.steps.h.max() > 1.0
    assert [one.t for one in solution.crossings] == pytest.approx([5.0 - 1e-3, 5.0 + 1e-3], abs=1e-9)


def test_a_crossing_at_the_end_of_a_step_is_found_once():
    intervals = [Interval(low, low + 0.5, lambda t, q, v: 0.0 * q) for low in (0.0, 0.5)]
    start = (np.array([-0.5]), np.ones(1))
    for level in (0.0, 1e-17, -1e-17):
        found = integrate(intervals, LINE, *start, Adaptive(1e-9), watches=[position(level)]).crossings
        assert [one.t for one in found] == pytest.approx([0.5], abs=1e-14)


def test_what_leaves_a_value_slowly_does_not_cross_it_later():
    """``x = level + t^3``: for a while the digits of the level hide the motion, and its sign."""
    cubic, found = [Interval(0.0, 1.0, lambda t, q, v: np.array([6.0 * t]))], []
    for level in np.random.default_rng(5).uniform(-1.0, 1.0, 40):
        state, watch = (np.array([level]), np.zeros(1)), position(level)
        found += [one.t for one in integrate(cubic, LINE, *state, Adaptive(1e-9), watches=[watch]).crossings]
    assert [t for t in found if t > 1e-5] == []  # 1e-5^3 is the rounding of the level


@pytest.mark.parametrize("level", [0.3, np.sin(1.0)])
@pytest.mark.parametrize("off", [-2.0, 0.0, 2.0])
def test_what_is_crossed_at_the_instant_of_a_stop_is_recorded_whichever_comes_first(level, off):
    """Two watches of one position that differ by two digits of it, either way round: one of them stops."""
    near = level + off * np.spacing(level)
    for order in ((0, 1), (1, 0)):
        watches = [[position(near), position(level, stops=True)][k] for k in order]
        solution = oscillator(2.0, watches)
        *others, last = solution.crossings
        assert watches[last.watch].stops and len(others) == 1
        assert others[0].t <= last.t == solution.steps.until[-1]
        assert last.t == pytest.approx(np.arcsin(level), abs=1e-9)


def resting(left, end):
    """One step in which nothing moves, under a load; the solution, and how many states each look took."""
    looks = []

    def value(t, q, v):
        looks.append(len(t))
        return left(t)

    interval = Interval(0.0, end, lambda t, q, v: np.zeros_like(q))
    watches = [Watch(value, -1, stops=True, loaded=True)]
    return integrate([interval], LINE, np.zeros(1), np.zeros(1), FixedStep(end), watches=watches), looks


def test_a_release_that_is_far_in_a_long_step_under_a_fast_load_is_found():
    """A load of 3000 rad/s with a slow rise passes its bound after 5 s, in the 2400th of its periods."""

    def left(t):
        return 5.0 - 4.9 * np.sin(3000.0 * t) - 0.02 * t

    solution, looks = resting(left, 6.0)
    tops = (2.0 * np.pi * np.arange(3000) + 0.5 * np.pi) / 3000.0 + 0.02 / (4.9 * 3000.0**2)
    first = tops[left(tops) < 0.0][0]
    assert solution.end == pytest.approx(brentq(left, first - 3e-4, first, xtol=1e-15), rel=1e-14)
    assert not solution.unresolved
    assert len(looks) < sum(looks) / 1000


@pytest.mark.parametrize(("position", "velocity"), [(0.0, 1.0), (-1.0, 0.0), (0.3, -0.5)])
def test_a_motion_that_begins_at_a_value_reaches_it_when_it_comes_back(position: float, velocity: float) -> None:
    """``x = p cos t + v sin t`` is p again at ``2 atan2(v, p)``; from rest it is p after a turn, beyond the end."""
    spring = {"kind": "joint_spring", "joint": "x", "stiffness": "0.05 N*m/rad"}
    problem = {
        "kind": "forward", "time": {"end": "6 s", "samples": 3}, "loads": {"spring": spring},
        "initial": {"position": {"x": f"{position} rad"}, "velocity": {"x": f"{velocity} rad/s"}},
        "events": {"back": {"when": "x", "reaches": f"{position} rad"}},
    }  # fmt: skip
    model = str(Path(__file__).parents[3] / "models" / "servo" / "mechanism.yaml")
    scenario = {"pinarm": 1, "mechanism": model, "arguments": {"J": "0.05 kg*m^2"}, "problem": problem,
                "outputs": ["x"]}  # fmt: skip
    back = 2.0 * np.arctan2(velocity, position) % (2.0 * np.pi)
    expected = [back] if 0.0 < back < 6.0 else []
    assert [event.t for event in pinarm.run(scenario).events] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("direction", [-1, 0, 1])
@pytest.mark.parametrize("turns", [False, True])
def test_what_ends_or_turns_back_at_a_value_comes_to_it_once(direction: int, turns: bool) -> None:
    """``x = x0 + v t + a t^2 / 2`` to its end, or past its turn, at the value of this: once, from its side."""
    for x0, v, end in np.random.default_rng(4).uniform((-1.0, 0.1, 0.1), (1.0, 3.0, 3.0), (12, 3)).tolist():
        for way in (-1.0, 1.0):
            turn, a = (0.6 * end, -way * v / (0.6 * end)) if turns else (end, way)
            level = x0 + way * v * turn + 0.5 * a * turn**2
            there = Watch(lambda t, q, v, at=level: q[:, 0] - at, direction, stops=False, level=abs(level))
            thrown = [Interval(0.0, end, lambda t, q, v, a=a: np.array([a]))]
            start = np.array([x0]), np.array([way * v])
            found = integrate(thrown, LINE, *start, Adaptive(1e-9), watches=[there]).crossings
            assert [one.t for one in found] == pytest.approx([turn] if direction in (0, way) else [], rel=1e-7)


def test_a_run_that_ends_at_a_value_reaches_it() -> None:
    model = str(Path(__file__).parents[3] / "models" / "servo" / "mechanism.yaml")
    for end, speed in [(0.3, 1.0), (0.7, -1.0), *np.random.default_rng(6).uniform(0.1, 2.0, (1, 2)).tolist()]:
        problem = {
            "kind": "forward", "time": {"end": f"{end!r} s", "samples": 3},
            "initial": {"velocity": {"x": f"{speed!r} rad/s"}},
            "events": {"there": {"when": "x", "reaches": f"{speed * end!r} rad"}},
        }  # fmt: skip
        scenario = {"pinarm": 1, "mechanism": model, "arguments": {"J": "0.05 kg*m^2"}, "problem": problem,
                    "outputs": ["x"]}  # fmt: skip
        assert [event.t for event in pinarm.run(scenario).events] == pytest.approx([end], rel=1e-12)
        slower = pinarm.run(scenario, {"problem.initial.velocity.x": f"{0.9 * speed!r} rad/s"})
        assert not slower.events
