from contextlib import nullcontext

import numpy as np
import pytest

import pinarm
from pinarm.engine.checks.residuals import excesses
from pinarm.mechanics.laws import Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid

LIMIT = '<limit lower="-1000" upper="1000" effort="1000" velocity="1000"/>'
ARM = {"name": "arm", "kind": "revolute", "inertia": (0.5, 0.5, 0.5)}


@pytest.fixture
def swung(mechanism, chain):
    """Return a function that swings an arm as 0.9 sin 2t, of inertia 0.5 kg m^2, within given limits."""

    def run(limit, kind=Inverse):
        arm = mechanism(chain(ARM).replace(LIMIT, f"<limit {limit}/>"), gravity="none")
        law = Harmonic(amplitude=0.9, pulsation=2.0)
        problem = kind(time=TimeGrid(end=3.0, samples=301), motion={"arm": law})
        return problem.solve(arm, Accuracy(), lambda *path: nullcontext()).rows

    return run


def test_what_goes_beyond_a_limit_is_told_with_its_first_row(swung):
    run = swung('lower="-0.5" upper="0.6" velocity="1.5" effort="1.2"')
    t = run.grid.t
    position, velocity = 0.9 * np.sin(2 * t), 1.8 * np.cos(2 * t)
    effort = -0.5 * 4 * position
    expected = [
        ("position", -0.5, position.min(), position < -0.5), ("position", 0.6, position.max(), position > 0.6),
        ("velocity", 1.5, velocity[0], np.abs(velocity) > 1.5),
        ("effort", 1.2, np.abs(effort).max(), np.abs(effort) > 1.2),
    ]  # fmt: skip
    for excess, (of, limit, value, beyond) in zip(excesses(run), expected, strict=True):
        assert (excess.joint, excess.of, excess.limit, excess.rows) == ("arm", of, limit, beyond.sum())
        assert abs(excess.value) == pytest.approx(abs(value), rel=1e-12)
        assert excess.at == t[beyond][0]
    assert [str(excess.unit) for excess in excesses(run)] == ["rad", "rad", "rad/s", "N*m"]


BELTED = """pinarm: 1
planar:
  points: {A: [0, 0], B: [0.4 m, 0]}
  ground: [A, B]
  links: {one: {points: [A], mass: 1 kg, inertia: 1e-3 kg*m^2}, two: {points: [B], mass: 1 kg, inertia: 1e-3 kg*m^2}}
couplings: {belt: {kind: belt, joints: [A, B], radii: [50 mm, 100 mm], pretension: 300 N}}
gravity: none
"""
LOADED = """pinarm: 1
mechanism: belt.yaml
problem:
  kind: inverse
  time: {end: 4 s, samples: 5}
  motion: {A: {law: constant, value: 0 rad}}
  drives: [A]
  loads: {load: {kind: joint_effort, joint: B, effort: {law: constant_speed, speed: 25 N*m/s}}}
outputs: [coupling.belt.tight, coupling.belt.slack]
"""


def test_a_belt_that_carries_more_than_its_pretension_is_told(tmp_path):
    """25 N*m/s on a radius of 0.1 m: 600 N, twice the pretension, are passed after 2.4 s, at 3 s and 4 s."""
    (tmp_path / "belt.yaml").write_text(BELTED)
    (tmp_path / "scenario.yaml").write_text(LOADED)
    result = pinarm.run(tmp_path / "scenario.yaml")
    [excess] = result.excesses()
    assert (excess.joint, excess.limit, excess.at, excess.rows) == ("belt", 600.0, 3.0, 2)
    assert excess.words(result.trajectory) == (
        "belt belt: a strand is slack, as the tensions differ by 1000 N, more than twice the pretension of 300 N, "
        "first at t = 3 s (2 of 5 rows); the other strand carries all of it"
    )
    assert result["coupling.belt.tight"].values[3:] == pytest.approx([750.0, 1000.0], rel=1e-13)


def test_a_motion_that_ends_at_its_limits_is_within_them(swung):
    assert excesses(swung('lower="-0.9" upper="0.9" velocity="1.8" effort="1.8"')) == []


def test_a_prescribed_joint_of_a_free_motion_has_one(mechanism, chain):
    xml = chain({**ARM, "com": "0.3 0 0", "axis": "0 1 0"}, {**ARM, "name": "tip"})
    arm = mechanism(xml.replace(LIMIT, '<limit effort="1" velocity="0"/>', 1))
    held = Forward(time=TimeGrid(end=1.0, samples=11), motion={"arm": Harmonic(amplitude=0.0, pulsation=1.0)})
    run = held.solve(arm, Accuracy(), lambda *path: nullcontext()).rows
    assert [(excess.joint, excess.of) for excess in excesses(run)] == [("arm", "effort")]
    assert excesses(run)[0].value == pytest.approx(-9.81 * 0.3, rel=1e-6)
