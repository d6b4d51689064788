"""Thresholds: what a motion decides is right, or its decision is open; against closed forms."""

import numpy as np
import pytest
from scipy.special import ellipk

import pinarm
from pinarm.errors import IntegrationError

G = 9.81
SLIDE = """<robot name="r"><link name="base"/><link name="s"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="prismatic"><parent link="base"/><child link="s"/><axis xyz="1 0 0"/>
<limit lower="-1e9" upper="1e9" effort="0" velocity="0"/></joint></robot>"""
PENDULUM = """<robot name="r"><link name="base"/><link name="s"><inertial><origin xyz="0 0 -0.7"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="continuous"><parent link="base"/><child link="s"/><axis xyz="0 1 0"/></joint></robot>"""
ACCURACIES = [
    {"method": "dop853", "tolerance": 1e-9}, {"method": "dopri5", "tolerance": 1e-5},
    {"method": "stiff", "tolerance": 1e-7}, {"method": "rk4", "step": "0.01 s"},
]  # fmt: skip


@pytest.fixture
def solved(tmp_path):
    """Return the result of a mass on a slide without gravity, or a pendulum, from rest at a coordinate."""

    def solve(end, start, accuracy, model=SLIDE, friction=None, **problem):
        (tmp_path / "model.urdf").write_text(model)
        mechanism = {"pinarm": 1, "robot": "model.urdf"} | ({"friction": {"x": friction}} if friction else {})
        (tmp_path / "mechanism.yaml").write_text(pinarm_text(mechanism))
        unit = "m" if model is SLIDE else "rad"
        given = {
            "pinarm": 1, "mechanism": str(tmp_path / "mechanism.yaml"), "outputs": ["x"], "accuracy": accuracy,
            "problem": {"kind": "forward", "time": {"end": f"{float(end)!r} s", "samples": 21},
                        "initial": {"position": {"x": f"{float(start)!r} {unit}"}}, **problem},
        }  # fmt: skip
        with pinarm.file_root(tmp_path):
            return pinarm.run(given | ({"gravity": "none"} if model is SLIDE else {}))

    return solve


def pinarm_text(content):
    """Return a file of nested mappings: JSON is YAML."""
    import json

    return json.dumps(content)


def spring(stiffness=100.0):
    return {"s": {"kind": "joint_spring", "joint": "x", "stiffness": f"{stiffness!r} N/m"}}


@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize(("then", "start"), [("stop", -2.9), ("record", 0.4)])
def test_a_pendulum_comes_back_to_its_start_once_a_period_and_that_is_told_as_open(solved, accuracy, then, start):
    """T = 4 K(sin^2(a/2)) / w. Errors of the amplitude decide on which side it turns, so the decision is open."""
    period = 4.0 * ellipk(np.sin(0.5 * start) ** 2) / np.sqrt(2.0 * G * 0.7 / (0.1 + 2.0 * 0.49))
    event = {"back": {"when": "x", "reaches": f"{start!r} rad", "then": then}}
    found = solved(3.3 * period, start, accuracy, PENDULUM, events=event)
    exact = period * np.arange(1, 2 if then == "stop" else 4)
    coarse = accuracy.get("tolerance", 1e-8)  # of rk4 h^4
    assert [one.t for one in found.events] == pytest.approx(exact, abs=300.0 * coarse, rel=0.0)
    [decision] = found.outcome.decisions
    assert decision.is_open
    assert "not decided: whether event 'back' takes place" in "\n".join(found.notes())


@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("beyond", [1e-2, 1e-10, -1e-6, -1e-2])
def test_whether_an_end_stop_is_grazed_is_right_or_open(solved, accuracy, beyond):
    """An oscillation of amplitude 1 and a stop at -(1 + beyond), that takes no energy: two impacts, or none."""
    stop = {"x": {"lower": f"{-1.0 - beyond!r} m", "restitution": 1}}
    found = solved(1.0, 1.0, accuracy, loads=spring(), end_stops=stop)
    assert any(one.is_open for one in found.outcome.decisions) or len(found.events) == (2 if beyond < 0.0 else 0)
    if abs(beyond) > 1e-3:
        assert not any(one.is_open for one in found.outcome.decisions)


@pytest.mark.parametrize("accuracy", ACCURACIES)
@pytest.mark.parametrize("beyond", [1e-2, 1e-10, -1e-6, -1e-2])
def test_whether_friction_holds_at_the_end_of_a_swing_is_right_or_open(solved, accuracy, beyond):
    """A swing of a block loses 2 F / k. After 3 of them the spring pulls with 16 N times (1 + beyond)."""
    start = 0.16 * (1.0 + beyond) + 3 * 2.0 / 100.0
    friction = {"constant": "1 N", "static_constant": "16 N"}
    found = solved(2.0, start, accuracy, friction=friction, loads=spring())
    sticks = abs(found["x"].values[-1]) == pytest.approx(0.16 * (1.0 + beyond), rel=1e-3)
    assert any(one.is_open for one in found.outcome.decisions) or sticks == (beyond < 0.0)
    if abs(beyond) > 1e-3:
        assert not any(one.is_open for one in found.outcome.decisions)


def test_a_run_of_very_many_impacts_ends_with_what_it_has_and_says_what_to_change(solved):
    stop = {"x": {"upper": "1 m", "lower": "-1 m", "restitution": 1}}
    velocity = {"position": {"x": "0 m"}, "velocity": {"x": "10 m/s"}}
    accuracy = {"method": "dop853", "max_events": 30}
    with pytest.raises(IntegrationError, match=r"(?s)more than 30 impacts.*accuracy\.max_events") as caught:
        solved(1000.0, 0.0, accuracy, end_stops=stop, initial=velocity)
    kept = caught.value.partial
    assert kept.trajectory.grid.t[-1] == pytest.approx(5.9, abs=1e-9)  # the first after 0.1 s, then one every 0.2 s
    assert len(solved(6.0, 0.0, accuracy, end_stops=stop, initial=velocity).events) == 30
