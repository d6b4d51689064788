"""Closed states from values of coordinates, points and frames: closed forms, runs of scenarios, forward kinematics."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.engine.mechanism_loading import mechanism_of_data
from pinarm.errors import AssemblyError, InputError
from pinarm.use.mechanism import Mechanism, with_methods

ROOT = Path(pinarm.__file__).parents[1]
CRANK, ROD, BASE = 0.2, 0.3, 0.25
LEFT, RIGHT = np.radians(120.0), np.radians(60.0)
UR5 = np.array([0.3, -1.2, 1.4, -1.0, -1.2, 0.4])


def tip(left, right):
    """Return the tip of a five-bar, shape (..., 2), from the absolute angles of its cranks; complex steps too."""
    elbows = [np.stack([x + CRANK * np.cos(a), CRANK * np.sin(a)], -1) for x, a in ((0.0, left), (BASE, right))]
    across = elbows[1] - elbows[0]
    height = np.sqrt(ROD**2 / (across**2).sum(-1, keepdims=True) - 0.25)
    return 0.5 * (elbows[0] + elbows[1]) + height * np.stack([-across[..., 1], across[..., 0]], -1)


@pytest.fixture(scope="module")
def five_bar():
    places = {"A": (0.0, 0.0), "E": (BASE, 0.0), "P": tip(LEFT, RIGHT)}
    places |= {"B": (CRANK * np.cos(LEFT), CRANK * np.sin(LEFT)),
               "D": (BASE + CRANK * np.cos(RIGHT), CRANK * np.sin(RIGHT))}  # fmt: skip
    links = {"left": "AB", "right": "ED", "forearm": "BP", "other": "DP"}
    planar = {"points": {name: [f"{x!r} m" for x in map(float, at)] for name, at in places.items()},
              "ground": ["A", "E"], "links": {name: {"points": [*ends]} for name, ends in links.items()}}  # fmt: skip
    return with_methods(mechanism_of_data({"pinarm": 1, "planar": planar}))


@pytest.fixture(scope="module")
def motors():
    return np.random.default_rng(3).uniform(-0.3, 0.3, (2, 50, 20))


def test_motors_move_a_five_bar_as_its_closed_form(five_bar, motors):
    """Its elbows and tip, at 1000 states; rates of the tip are complex steps of the closed form."""
    rates, changes = (2.0, -1.0), (0.5, 3.0)
    q, v, a = five_bar.close(
        dict(zip("AE", motors, strict=True)), dict(zip("AE", rates, strict=True)), dict(zip("AE", changes, strict=True))
    )
    assert q.shape == v.shape == a.shape == (50, 20, 4)
    states = five_bar.at(q, v, a)

    def moving(t):
        return tip(*(start + x + t * r + 0.5 * t * t * c
                     for start, x, r, c in zip((LEFT, RIGHT), motors, rates, changes, strict=True)))  # fmt: skip

    step = 1e-4
    slopes = [moving(t + 1e-30j).imag / 1e-30 for t in (-step, 0.0, step)]
    expected = {"position": moving(0.0), "velocity": slopes[1], "acceleration": (slopes[2] - slopes[0]) / (2.0 * step)}
    for what, values in expected.items():
        found = np.stack([states[f"point.P.{what}.{axis}"].values for axis in "xy"], -1)
        assert found == pytest.approx(values, abs=1e-5 if what == "acceleration" else 1e-12), what


def test_the_tip_moves_the_motors_of_a_five_bar(five_bar, motors):
    """Inverse kinematics, alone as in arrays; the tip and its rates lead back to motors and theirs."""
    x, y = np.moveaxis(tip(LEFT + motors[0], RIGHT + motors[1]), -1, 0)
    whole = five_bar.close({"point.P.position.x": x, "point.P.position.y": y})
    assert whole[..., [0, 2]] == pytest.approx(np.moveaxis(motors, 0, -1), abs=1e-12)
    alone = five_bar.close({"point.P.position.x": x[4, 7], "point.P.position.y": y[4, 7]})
    assert np.array_equal(alone, whole[4, 7])
    moved = five_bar.close({"A": motors[0], "E": motors[1]}, {"A": 1.0}, {"E": 1.0})
    states = five_bar.at(*moved)
    back = five_bar.close(*(
        {f"point.P.position.{axis}": states[f"point.P.{what}.{axis}"] for axis in "xy"}
        for what in ("position", "velocity", "acceleration")
    ))  # fmt: skip
    for first, second in zip(moved, back, strict=True):
        assert second == pytest.approx(first, abs=1e-9)


def test_a_start_chooses_the_branch(five_bar):
    """The elbow of the left arm on the other side of its line to the tip: the mirrored motor angle."""
    q = five_bar.close({"point.P.position.x": 0.1, "point.P.position.y": 0.35})
    line = np.arctan2(0.35, 0.1)
    other = five_bar.close({"point.P.position.x": 0.1, "point.P.position.y": 0.35},
                           start={"A": 2.0 * (line - LEFT) - q[0], "B": 2.2, "E": q[2], "D": q[3]})  # fmt: skip
    assert LEFT + other[0] - line == pytest.approx(line - LEFT - q[0], abs=1e-12)
    assert five_bar.close({}, start=other) == pytest.approx(other, abs=1e-14)


ANKLE = """<robot name="ankle">
  <link name="shank"/><link name="cross"/><link name="foot"/><link name="left"/><link name="right"/>
  <joint name="pitch" type="continuous"><parent link="shank"/><child link="cross"/><axis xyz="0 1 0"/></joint>
  <joint name="roll" type="continuous"><parent link="cross"/><child link="foot"/><axis xyz="1 0 0"/></joint>
  <joint name="motor_left" type="continuous"><parent link="shank"/><child link="left"/>
    <origin xyz="0 0.05 0.3"/><axis xyz="0 1 0"/></joint>
  <joint name="motor_right" type="continuous"><parent link="shank"/><child link="right"/>
    <origin xyz="0 -0.05 0.3"/><axis xyz="0 1 0"/></joint>
</robot>"""


def test_two_rods_move_an_ankle_as_their_closed_form(tmp_path):
    """Pitch and roll, or the placement of the foot, to motors: each rod gives one equation ``a cos + b sin = c``."""
    (tmp_path / "ankle.urdf").write_text(ANKLE)
    arm, side, height, rod = 0.06, 0.05, 0.3, 0.3
    points = {f"tip_{name}": {"link": name, "at": [f"{-arm} m", 0, 0]} for name in ("left", "right")}
    points |= {f"lug_{name}": {"link": "foot", "at": [f"{-arm} m", f"{y} m", 0]}
               for name, y in (("left", side), ("right", -side))}  # fmt: skip
    loops = {name: {"kind": "rod", "between": [f"tip_{name}", f"lug_{name}"], "length": f"{rod} m"}
             for name in ("left", "right")}  # fmt: skip
    ankle = Mechanism.load(tmp_path / "ankle.urdf", values={"points": points, "loops": loops})
    pitch, roll = np.random.default_rng(4).uniform(-0.4, 0.4, (2, 300))
    q = ankle.close({"pitch": pitch, "roll": roll})
    for name, y in (("left", side), ("right", -side)):
        sine, cosine = np.sin(roll), np.cos(roll)
        lug = np.array([-arm * np.cos(pitch) + y * sine * np.sin(pitch), y * cosine,
                        arm * np.sin(pitch) + y * sine * np.cos(pitch)])  # fmt: skip
        x, dy, z = lug[0], lug[1] - y, lug[2] - height
        c = (x * x + dy * dy + z * z + arm**2 - rod**2) / (2.0 * arm)  # -x cos + z sin = c
        angle = np.arctan2(z, -x) + np.arccos(c / np.hypot(x, z))
        assert q[:, ankle.joints[f"motor_{name}"].q] == pytest.approx(angle, abs=1e-12)
    turns = ankle.frame("foot", q)
    assert ankle.close({"foot": turns}) == pytest.approx(q, abs=1e-12)


@pytest.fixture(scope="module")
def arm():
    return Mechanism.load("ur5")


class TestArm:
    def test_placements_lead_back_to_the_joints(self, arm):
        """Forward kinematics and Jacobians are Pinocchio's; J' v is a difference of these."""
        random = np.random.default_rng(1)
        q, (v, a) = UR5 + random.uniform(-0.4, 0.4, (40, 6)), random.normal(size=(2, 40, 6))
        turn, step = arm.jacobian("tool0", q), 1e-6
        bend = (arm.jacobian("tool0", q + step * v) - arm.jacobian("tool0", q - step * v)) / (2.0 * step)
        twist, change = np.matvec(turn, v), np.matvec(turn, a) + np.matvec(bend, v)
        found = arm.close({"tool0": arm.frame("tool0", q)}, {"tool0": twist}, {"tool0": change}, start=UR5)
        assert found[0] == pytest.approx(q, abs=1e-12)
        assert found[1] == pytest.approx(v, abs=1e-11)
        assert found[2] == pytest.approx(a, abs=1e-7)
        assert arm.close({"tool0": pin.SE3(arm.frame("tool0", q[3]))}, start=UR5) == pytest.approx(q[3], abs=1e-12)

    @pytest.mark.parametrize("angle", [2.4, 3.0, np.pi, 3.5])
    def test_a_tool_turns_by_half_a_turn(self, arm, angle):
        """About the axis of the last joint, the short way round; the twist there, too."""
        wanted = pin.SE3(arm.frame("tool0", UR5)) * pin.SE3(pin.exp3(np.array([0.0, 0.0, angle])), np.zeros(3))
        q, v = arm.close({"tool0": wanted}, {"tool0": [0.1, 0.0, 0.2, 0.3, -0.1, 0.0]}, start=UR5)
        short = angle if angle <= np.pi else angle - 2.0 * np.pi
        assert q - UR5 == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, short], abs=1e-9)
        assert arm.jacobian("tool0", q) @ v == pytest.approx([0.1, 0.0, 0.2, 0.3, -0.1, 0.0], abs=1e-12)

    @pytest.mark.parametrize(("positions", "velocities", "said"), [
        ({"tool0": [1.0, 2.0, 3.0]}, None, r"shape \(3,\)\s+expected: \(\.\.\., 4, 4\), or pin\.SE3"),
        ({"tool0": 2.0 * np.eye(4)}, None, "tool0 are no placements"),
        ({"tool": np.eye(4)}, None, "no link 'tool'"),
        ({"elbow_joint": np.nan}, None, "positions of elbow_joint are not all finite"),
        ({"elbow_joint": [1.0, 2.0], "wrist_1_joint": [1.0, 2.0, 3.0]}, None, "expected: one shape"),
        ({"elbow_joint": 1.0}, {"wrist_1_joint": 1.0}, "'wrist_1_joint' has a rate and no position"),
        ({"elbow_joint": 1.0}, {"elbow_joint": 1.0}, "leave 5 degrees of freedom open"),
        ({"point.tool0": [[0.4, 0.1, 0.3], [0.0, 0.0, 5.0]]}, None, "row 1: the values are out of reach"),
    ])  # fmt: skip
    def test_mistakes_are_told(self, arm, positions, velocities, said):
        with pytest.raises((InputError, AssemblyError), match=said):
            arm.close(positions, velocities, start=UR5)

    def test_rates_that_do_not_go_together_are_refused(self, arm):
        placed = {"tool0": arm.frame("tool0", UR5), "elbow_joint": UR5[2]}
        _, v = arm.close(placed, {"tool0": arm.jacobian("tool0", UR5) @ np.ones(6), "elbow_joint": 1.0}, start=UR5)
        assert v == pytest.approx(np.ones(6), abs=1e-12)
        with pytest.raises(InputError, match="velocities do not go together"):
            arm.close(placed, {"elbow_joint": 1.0}, start=UR5)


def test_what_is_not_reached_is_nan_if_wanted():
    """Two equal rods from (0, 0.5) reach the whole disc, straight but for ways through its middle."""
    rods = Mechanism.load(ROOT / "models" / "gen411_arm" / "mechanism.yaml")
    x, y = np.random.default_rng(2).uniform((-0.6, 0.05), 0.6, (200, 2)).T
    wanted = {"point.A.position.x": x, "point.A.position.y": 0.5 + y}
    q, v = rods.close(wanted, {"point.A.position.x": 1.0}, start={"O": 0.3, "B": 1.0}, unreached="nan")
    reached = np.hypot(x, y) < 0.5
    assert np.array_equal(np.isfinite(q).all(axis=1), reached)
    assert np.array_equal(np.isnan(v).all(axis=1), ~reached)
    with pytest.raises(AssemblyError, match=r"row \d+: the values are out of reach"):
        rods.close(wanted, start={"O": 0.3, "B": 1.0})


@pytest.mark.parametrize(("name", "coordinates"), [
    ("rssr_turning", ["theta", "spin"]), ("screw_jack_lifting", ["turn"]),
    ("exoskeleton_leg_knee", ["hip_height", "hip_depth", "trunk_angle"]),
])  # fmt: skip
def test_states_are_those_of_a_run_that_goes_from_row_to_row(name, coordinates):
    run = pinarm.load(ROOT / "scenarios" / f"{name}.yaml").run()
    rows, mechanism = run.trajectory, with_methods(run.trajectory.mechanism)
    given = [{one: run[f"coordinate.{one}.{what}" if one not in mechanism.joints else f"joint.{one}.{what}"]
              for one in coordinates} for what in ("position", "velocity", "acceleration")]  # fmt: skip
    for found, known in zip(mechanism.close(*given, start=rows.q[0]), (rows.q, rows.v, rows.a), strict=True):
        assert found == pytest.approx(known, abs=1e-10 * (1.0 + np.abs(known).max()))


def test_a_base_that_floats_is_placed_with_a_foot():
    """Ball joints are solved state by state."""
    robot = Mechanism.load("anymal")
    bent = {f"{leg}_KFE": -1.2 for leg in ("LF", "RF", "LH", "RH")}
    q = pin.integrate(robot.model, robot.configurations(bent), 0.3 * np.sin(np.arange(robot.model.nv)))
    wanted = {"base": robot.frame("base", q)}
    wanted |= {f"point.{foot}": robot.frame(foot, q)[:3, 3] for foot in ("LF_FOOT", "RH_FOOT")}
    found = robot.close(wanted, start=bent)
    for foot in ("LF_FOOT", "RH_FOOT"):
        assert robot.frame(foot, found)[:3, 3] == pytest.approx(wanted[f"point.{foot}"], abs=1e-13)
    assert robot.frame("base", found) == pytest.approx(wanted["base"], abs=1e-13)
