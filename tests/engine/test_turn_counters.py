"""What acts along an angle of a loop in space, or of a ball joint, finds its turns counted."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pinarm
from pinarm.arrays import Array

TURNING = """<robot name="body"><link name="w"/><link name="b"><inertial><origin xyz="0.1 0.05 0.02"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="root" type="floating"><parent link="w"/><child link="b"/></joint></robot>"""
AXIS, CENTRE = np.array([0.6, 0.0, 0.8]), np.array([0.1, 0.05, 0.02])
INERTIA = float(AXIS @ np.diag([0.01, 0.02, 0.03]) @ AXIS + CENTRE @ CENTRE - (AXIS @ CENTRE) ** 2)
LOOP = {"L": {"kind": "revolute", "between": ["w", "b"], "axis": AXIS.tolist()}}
SPRING = {"S": {"kind": "coordinate_spring", "coordinate": "L.angle", "stiffness": "0.01 N*m/rad"}}
SPEED, STIFFNESS = 14.0, 0.01
TIGHT = {"accuracy": {"tolerance": 1e-11}}


def _run(tmp_path: Path, problem: dict[str, Any], outputs: list[str], **parts: Any) -> pinarm.Result:
    (tmp_path / "body.urdf").write_text(TURNING)
    mechanism = {"pinarm": 1, "robot": str(tmp_path / "body.urdf"), "loops": LOOP, "gravity": "none", **parts}
    problem = {"kind": "forward", "time": {"end": "2 s", "samples": 41}, **problem}
    with pinarm.file_root(tmp_path):
        return pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": outputs, **TIGHT})


SPUN = {"initial": {"velocity": {"L.angle": f"{SPEED} rad/s"}}}


@pytest.mark.parametrize(("own", "given"), [({"forces": SPRING}, {}), ({}, {"loads": SPRING})])
def test_a_spring_along_the_angle_of_a_loop_winds_up(
    tmp_path: Path, own: dict[str, Any], given: dict[str, Any]
) -> None:
    """``w = W/s sin(s t)`` with ``s^2 = k / J``, which goes beyond two turns; the spring's moment is the loop's."""
    result = _run(tmp_path, {**SPUN, **given}, ["loop.L.angle", "loop.L.moment.axial", "force.S.effort"], **own)
    s, t = np.sqrt(STIFFNESS / INERTIA), np.linspace(0.0, 2.0, 41)
    wound = SPEED / s * np.sin(s * t)
    assert wound.max() > 4.0 * np.pi
    np.testing.assert_allclose(result["loop.L.angle"].values, wound, rtol=0, atol=1e-8)
    np.testing.assert_allclose(result["force.S.effort"].values, -STIFFNESS * wound, rtol=0, atol=1e-10)
    np.testing.assert_allclose(result["loop.L.moment.axial"].values, -STIFFNESS * wound, rtol=0, atol=1e-8)
    result.save(tmp_path / "saved")
    restored = pinarm.restore(tmp_path / "saved")
    np.testing.assert_array_equal(restored["loop.L.angle"].values, result["loop.L.angle"].values)


LINKAGE = """<robot name="rssr"><link name="w"/><link name="crank">{mass}</link><link name="cross"/>
<link name="coupler">{mass}</link><link name="follower">{mass}</link>
<link name="tip"/><link name="end"/><link name="D"/>
<joint name="a" type="continuous"><parent link="w"/><child link="crank"/><axis xyz="0 0 1"/></joint>
<joint name="z" type="continuous"><parent link="crank"/><child link="cross"/><origin xyz="0.10 0 0"/>
<axis xyz="0 0 1"/></joint>
<joint name="y" type="continuous"><parent link="cross"/><child link="coupler"/><axis xyz="0 1 0"/></joint>
<joint name="at_tip" type="fixed"><parent link="coupler"/><child link="tip"/><origin xyz="0.13 0 0"/></joint>
<joint name="at_D" type="fixed"><parent link="w"/><child link="D"/><origin xyz="0.03 0.01 0.02" rpy="0 0.3 0"/></joint>
<joint name="at_end" type="fixed"><parent link="follower"/><child link="end"/><origin xyz="{end} 0 0"/></joint>
{last}</robot>"""
MASS = """<inertial><origin xyz="{x} 0 0"/><mass value="0.5"/>
<inertia ixx="0.0005" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>"""
CUTS = {
    "at the ball": (
        '<joint name="d" type="continuous"><parent link="D"/><child link="follower"/><axis xyz="0 0 1"/></joint>', 0.12,
        {"C": {"kind": "spherical", "between": ["tip", "end"]}}, "d",
    ),
    "at the hinge": (
        '<joint name="C" type="spherical"><parent link="tip"/><child link="follower"/></joint>', -0.12,
        {"L": {"kind": "revolute", "between": ["D", "end"], "axis": "z"}}, "L.angle",
    ),
}  # fmt: skip


def _linkage(tmp_path: Path, cut: str, problem: dict[str, Any]) -> tuple[Array, Array]:
    """Return the angle of the hinge, and the effort of the drive at the crank or its angle."""
    last, end, loops, angle = CUTS[cut]
    text = LINKAGE.format(mass=MASS.format(x=0.0), end=end, last=last)
    follower = MASS.format(x=end / 2)
    text = text.replace('<link name="follower">' + MASS.format(x=0.0), '<link name="follower">' + follower)
    (tmp_path / "linkage.urdf").write_text(text)
    spring = {"kind": "coordinate_spring", "coordinate": angle, "stiffness": "0.02 N*m/rad", "rest": "30 deg"}
    mechanism = {"pinarm": 1, "robot": str(tmp_path / "linkage.urdf"), "gravity": "none", "loops": loops}
    shown = f"coordinate.{angle}.position", f"joint.a.{'effort' if problem['kind'] != 'forward' else 'position'}"
    with pinarm.file_root(tmp_path):
        result = pinarm.run({
            "pinarm": 1, "mechanism": {**mechanism, "forces": {"S": spring}}, "problem": problem,
            "outputs": list(shown), **(TIGHT if problem["kind"] == "forward" else {}),
        })  # fmt: skip
    return result[shown[0]].values, result[shown[1]].values


TIME = {"end": "1.5 s", "samples": 61}


@pytest.mark.parametrize("problem", [
    {"kind": "inverse", "time": TIME, "motion": {"a": {"law": "constant_speed", "speed": "14 rad/s"}}, "drives": ["a"]},
    {"kind": "statics", "over": {"a": {"from": "0 deg", "to": "900 deg", "samples": 61}}, "drives": ["a"]},
    {"kind": "forward", "time": TIME, "initial": {"position": {"a": "0 deg"}, "velocity": {"a": "20 rad/s"}}},
])  # fmt: skip
def test_it_does_not_matter_where_a_loop_is_cut(tmp_path: Path, problem: dict[str, Any]) -> None:
    """An RSSR linkage with a spring at a hinge that turns around, which closes the loop or is a joint of the tree."""
    near = {"start": {"z": "103.6 deg", "y": "-9.1 deg"}}  # on one branch
    ball, hinge = (_linkage(tmp_path, cut, {**problem, **near}) for cut in CUTS)
    assert np.ptp(ball[0]) > 4.0 * np.pi
    np.testing.assert_allclose(hinge[0], ball[0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(hinge[1], ball[1], rtol=0, atol=1e-7)


BALL = """<robot name="brick"><link name="w"/><link name="b"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="J" type="spherical"><parent link="w"/><child link="b"/></joint></robot>"""
MOMENTS = np.array([0.01, 0.02, 0.03])


def _angles_of_brick(k: int, spin: Array, t: Array) -> Array:
    """Return roll, pitch and yaw as Euler's equations and the rates of the angles give them, with a spring along one.

    With its row r of rates, ``I w' + w x I w = -0.02 angle r``.
    """

    def rate(_: float, state: Array) -> Array:
        roll, pitch, _yaw = state[:3]
        w, (s, c) = state[3:], (np.sin(roll), np.cos(roll))
        rows = np.array([[1.0, s * np.tan(pitch), c * np.tan(pitch)], [0.0, c, -s],
                         [0.0, s / np.cos(pitch), c / np.cos(pitch)]])  # fmt: skip
        return np.concatenate([rows @ w, (-0.02 * state[k] * rows[k] - np.cross(w, MOMENTS * w)) / MOMENTS])

    found = solve_ivp(rate, (0.0, t[-1]), [0, 0, 0, *spin], "DOP853", t, rtol=1e-12, atol=1e-12)
    return np.asarray(found.y[:3])


@pytest.mark.parametrize(("angle", "spin"), [("yaw", (0.1, 0.3, 12.0)),
                                             ("roll", (8.0, 0.2, 0.1)), ("pitch", (0.2, 1.0, 0.1))])  # fmt: skip
def test_a_spring_along_an_angle_of_a_spinning_brick(
    tmp_path: Path, angle: str, spin: tuple[float, float, float]
) -> None:
    """Roll and yaw are counted over several turns, as angles of gimbals are."""
    (tmp_path / "brick.urdf").write_text(BALL)
    spring = {"kind": "coordinate_spring", "coordinate": f"J.{angle}", "stiffness": "0.02 N*m/rad"}
    velocity = {f"J.angular_velocity.{axis}": f"{w} rad/s" for axis, w in zip("xyz", spin, strict=True)}
    mechanism = {"pinarm": 1, "robot": str(tmp_path / "brick.urdf"), "gravity": "none", "forces": {"S": spring}}
    problem = {"kind": "forward", "time": {"end": "3 s", "samples": 61}, "initial": {"velocity": velocity}}
    name = f"coordinate.J.{angle}.position"
    with pinarm.file_root(tmp_path):
        result = pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": [name], **TIGHT})
    k = ("roll", "pitch", "yaw").index(angle)
    wanted = _angles_of_brick(k, np.array(spin), np.linspace(0.0, 3.0, 61))[k]
    assert np.abs(wanted).max() > np.pi or angle == "pitch"
    np.testing.assert_allclose(result[name].values, wanted, rtol=0, atol=1e-7)


SLEEVE = {"L": {"kind": "cylindrical", "between": ["w", "b"], "axis": "z"}}


@pytest.mark.parametrize("acting", [
    {"forces": SPRING}, {"turns": ["L.angle"]},
    *({"drives": {"D": {"along": f"L.{along}", "ratio": 10, "rotor_inertia": "1e-4 kg*m^2", **more}}}
      for along, more in (("angle", {"efficiency": 0.8}), ("position", {"elasticity": {"stiffness": "10 N/m"}}))),
])  # fmt: skip
def test_what_acts_along_a_loop_joint_does_not_move_the_start(tmp_path: Path, acting: dict[str, Any]) -> None:
    """The loop is closed at the start, which it keeps; counters and rotors follow from where they begin, at 0."""
    start = {"root.yaw": "100 deg", "root.z": "0.4 m"}
    outputs = ["joint.root.yaw", "loop.L.angle", "loop.L.position"]
    result = _run(tmp_path, {"time": {"end": "1 us", "samples": 2}}, outputs, loops=SLEEVE, start=start, **acting)
    found = [result[name].values[0] for name in outputs]
    np.testing.assert_allclose(found, [np.radians(100.0), np.radians(100.0), 0.4], rtol=1e-12)
