"""Where an angle along which something acts leaps, the run is refused with the instant and the remedy."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.errors import DynamicsError, InputError

FLOATING = """<robot name="body"><link name="w"/><link name="b"><inertial><origin xyz="0.1 0.05 0.02"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="root" type="floating"><parent link="w"/><child link="b"/></joint></robot>"""
BALL = FLOATING.replace("floating", "spherical").replace('xyz="0.1 0.05 0.02"', 'xyz="0 0 0"').replace("root", "J")
LOOP = {"L": {"kind": "revolute", "between": ["w", "b"], "axis": [0.6, 0, 0.8]}}
SPEED = 14.0


def _spring(along: str) -> dict[str, Any]:
    return {"S": {"kind": "coordinate_spring", "coordinate": along, "stiffness": "1e-6 N*m/rad"}}


def _problem(velocity: dict[str, str], **parts: Any) -> dict[str, Any]:
    return {"kind": "forward", "time": {"end": "0.4 s", "samples": 41}, "initial": {"velocity": velocity}, **parts}


def _mechanism(tmp_path: Path, urdf: str, **parts: Any) -> pinarm.Mechanism:
    (tmp_path / "body.urdf").write_text(urdf)
    text = {"pinarm": 1, "robot": "body.urdf", "gravity": "none", **parts}
    document = tmp_path / "mechanism.yaml"
    document.write_text(str(text).replace("'", '"'))
    return pinarm.Mechanism.load(document)


def _run(mechanism: pinarm.Mechanism, problem: dict[str, Any], outputs: list[str], **given: Any) -> pinarm.Result:
    return pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": outputs}, **given)


def test_an_angle_that_nothing_counts_is_refused_where_it_leaps(tmp_path: Path) -> None:
    """A mechanism that has been built cannot count for the loads of a run: at pi / W it says so, and what to write."""
    problem = _problem({"L.angle": f"{SPEED} rad/s"}, loads=_spring("L.angle"))
    with pytest.raises(
        DynamicsError, match=r"'S' acts along an angle .* at t = 0\.2\d+ s: it is told from -180"
    ) as error:
        _run(_mechanism(tmp_path, FLOATING, loops=LOOP), problem, ["loop.L.angle"])
    assert "turns: [L.angle]" in error.value.hint
    assert error.value.data["t"] == pytest.approx(np.pi / SPEED, abs=0.02)
    kept = error.value.partial
    np.testing.assert_allclose(kept["loop.L.angle"].values, SPEED * kept["t"].values, rtol=0, atol=1e-6)
    assert len(kept["t"].values) == 23  # 0.22 s of 0.4 s
    counted = _run(_mechanism(tmp_path, FLOATING, loops=LOOP, turns=["L.angle"]), problem, ["loop.L.angle"])
    assert counted["loop.L.angle"].values[-1] == pytest.approx(SPEED * 0.4, abs=1e-5)


@pytest.mark.parametrize(("along", "spin", "why"), [
    ("J.yaw", {"y": 7.0}, "roll and yaw leap"),
    ("turned", {"z": 12.0, "x": 0.1}, "a rotation vector leaps"),
])  # fmt: skip
def test_angles_of_balls_are_refused_where_they_end(
    tmp_path: Path, along: str, spin: dict[str, float], why: str
) -> None:
    """At a pitch of 90 deg, and where a rotation vector is half a turn long, there is nothing to count."""
    turned = {"turned": {"kind": "rotation", "body": "b", "about": "z"}}
    mechanism = _mechanism(tmp_path, BALL, coordinates=turned, forces=_spring(along))
    velocity = {f"J.angular_velocity.{axis}": f"{w} rad/s" for axis, w in spin.items()}
    with pytest.raises(DynamicsError, match=why) as error:
        _run(mechanism, _problem(velocity), ["joint.J.quaternion.w"])
    ends = (np.pi / 2 if "roll" in why else np.pi) / max(spin.values())
    assert error.value.data["t"] == pytest.approx(ends, abs=0.02)


def test_an_inverse_run_is_refused_as_well(tmp_path: Path) -> None:
    """The rotor of a drive counts, a spring that was not known when the mechanism was built does not; rows are few."""
    mechanism = _mechanism(tmp_path, FLOATING, loops=LOOP, drives={"D": {"along": "L.angle"}})
    motion = {"D.rotor": {"law": "constant_speed", "speed": f"{SPEED} rad/s"}}
    problem = {"kind": "inverse", "time": {"end": "0.44 s", "samples": 2}, "motion": motion, "drives": ["D.rotor"]}
    assert _run(mechanism, problem, ["joint.D.rotor.position"])["joint.D.rotor.position"].values[-1] == 0.44 * SPEED
    with pytest.raises(DynamicsError, match="'S' acts along an angle") as error:
        _run(mechanism, {**problem, "loads": _spring("L.angle")}, ["joint.D.rotor.effort"])
    assert error.value.data["t"] == pytest.approx(np.pi / SPEED, abs=0.44 / 8)


def test_events_beyond_half_a_turn_ask_for_counted_turns(tmp_path: Path) -> None:
    """At 5 rad, after 5 / W; an angle that nothing counts never gets there."""
    problem = _problem({"L.angle": f"{SPEED} rad/s"}, events={"E": {"when": "L.angle", "reaches": "5 rad"}})
    with pytest.raises(InputError, match="told from -180 to 180 deg"):
        _run(_mechanism(tmp_path, FLOATING, loops=LOOP), problem, ["event.E.time"])
    counted = _run(_mechanism(tmp_path, FLOATING, loops=LOOP, turns=["L.angle"]), problem, ["event.E.time"])
    assert counted["event.E.time"].values[0] == pytest.approx(5.0 / SPEED, abs=1e-9)
