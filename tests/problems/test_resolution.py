"""``resolve`` in files: a Panda whose hand follows a path, and mistakes in what is said of it."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import InputError, PinarmError
from pinarm.input.roots import robot

ROOT = Path(pinarm.__file__).parents[1]
SCENARIO = ROOT / "scenarios" / "panda_drawing.yaml"
JOINTS = [f"panda_joint{k}" for k in range(1, 8)]
SHORT = {"problem.time.samples": 21}
KINEMATIC = {**SHORT, "problem.kind": "kinematics", "outputs": ["panda_joint1"]}


def run(**changes):
    return pinarm.run(SCENARIO, {**KINEMATIC, **{f"problem.{key}": value for key, value in changes.items()}})


@pytest.fixture(scope="module")
def drawing():
    return pinarm.run(SCENARIO, SHORT)


def test_the_pose_of_the_hand_by_forward_kinematics_of_another_reader(drawing):
    """Pinocchio's own URDF reader: the circle, and the hand straight down."""
    model = pin.buildModelFromUrdf(str(robot("panda")))
    data, frame, run = model.createData(), model.getFrameId("panda_hand_tcp"), drawing.trajectory
    assert list(model.names)[1:8] == JOINTS
    for t, q in zip(run.grid.t, run.q, strict=True):
        pin.framesForwardKinematics(model, data, q)
        turn = np.pi / 2 * t
        assert data.oMf[frame].translation == pytest.approx(
            [0.5 + 0.1 * np.cos(turn), 0.1 * np.sin(turn), 0.2], abs=1e-14
        )
        assert data.oMf[frame].rotation == pytest.approx(np.diag([1.0, -1.0, -1.0]), abs=1e-14)


def test_the_efforts_are_those_of_the_recursive_newton_euler_algorithm(drawing):
    rows = drawing.trajectory
    model = pin.buildModelFromUrdf(str(robot("panda")))
    data = model.createData()
    expected = np.array([pin.rnea(model, data, *state) for state in zip(rows.q, rows.v, rows.a, strict=True)])
    expected += model.damping * rows.v
    assert rows.tau[:, :7] == pytest.approx(expected[:, :7], abs=1e-10)


def test_the_stamp_tells_how_well_the_path_is_held(drawing):
    assert 0.0 < drawing.figures["path"] < 1e-14
    assert {"path", "path rate", "path acceleration"} <= set(drawing.figures)


LIMIT = {"panda_joint3": ["0.1 rad", "0.5 rad"]}


def test_a_limit_on_the_way_is_told_in_kinematics():
    result = run(**{"resolve.within": LIMIT})
    told = [note for note in result.notes() if "limit" in note]
    assert len(told) == 2
    assert "panda_joint3 reaches its limit 0.1 rad, and velocities jump: that of" in told[0]
    assert "panda_joint3 comes off its limit 0.1 rad" in told[1]
    assert result["panda_joint3"].values.min() == pytest.approx(0.1, abs=1e-12)


@pytest.mark.slow
def test_a_limit_on_the_way_is_refused_in_inverse_dynamics():
    with pytest.raises(InputError, match="it would take infinite efforts") as caught:
        pinarm.run(SCENARIO, {**SHORT, "problem.resolve.within": LIMIT})
    assert "there are 2" in str(caught.value)
    assert caught.value.location is not None


def test_weights_move_the_motion_towards_the_heavier_joints():
    heavier = {"resolve.weights": dict.fromkeys(JOINTS, 1) | {JOINTS[2]: 9}}
    plain, heavy = (run(**{"time.end": "1 s"}, **changes) for changes in ({}, heavier))
    off = [np.abs(result["panda_joint3"].values - np.deg2rad(20)).max() for result in (plain, heavy)]
    assert off[1] < 0.2 * off[0]


@pytest.mark.parametrize(
    ("changes", "texts"),
    [
        ({"resolve.nearest_to": {"panda_joint9": "0 rad"}}, ["no joint 'panda_joint9'", "panda_joint1"]),
        ({"resolve.nearest_to": {"panda_finger_joint1": "0 m"}}, ["'panda_finger_joint1' follows a law of its own"]),
        ({"resolve.nearest_to": {"panda_joint4": "0 deg"}}, ["0 rad is outside of the limits of panda_joint4"]),
        ({"resolve.weights": {"panda_joint1": 2}}, ["no weight is given for panda_joint2"]),
        ({"resolve": None}, ["8 coordinates have to follow a law and 7 do"]),
    ],
)  # fmt: skip
def test_mistakes_are_located(changes, texts):
    with pytest.raises(PinarmError) as caught:
        scenario = pinarm.load(SCENARIO, {**KINEMATIC, **{f"problem.{key}": value for key, value in changes.items()}})
        scenario.validate()
    assert all(text in str(caught.value) for text in texts), str(caught.value)


def test_turning_and_sliding_joints_need_weights_with_units(mechanism, chain):
    slide = mechanism(chain({"name": "turn"}, {"name": "slide", "kind": "prismatic", "axis": "1 0 0", "at": "0.5 0 0"}),
                      coordinates={"x": {"kind": "point", "point": "slide_link", "along": "x"}})  # fmt: skip
    problem = {"kind": "kinematics", "time": {"end": "1 s", "samples": 3},
               "motion": {"x": {"law": "harmonic", "mean": "0.6 m", "amplitude": "0.1 m", "pulsation": "1 rad/s"}},
               "resolve": {"nearest_to": {"turn": "0.3 rad", "slide": "0.1 m"}}}  # fmt: skip
    given = {"pinarm": 1, "mechanism": slide, "outputs": ["turn"]}
    with pytest.raises(InputError, match="no common sum of squares") as caught:
        pinarm.run({**given, "problem": problem})
    assert "turn: 1 1/rad, slide: 1 1/m" in str(caught.value)
    problem["resolve"]["weights"] = {"turn": "1 1/rad", "slide": "10 1/m"}
    rows = pinarm.run({**given, "problem": problem}).trajectory
    # x = (0.5 + s) cos(turn): stationary where W^2 (q - q0) is along the gradient of x
    turn, s = rows.q[:, 0], rows.q[:, 1]
    along = np.stack([-(0.5 + s) * np.sin(turn), np.cos(turn)])
    pull = np.stack([turn - 0.3, 100.0 * (s - 0.1)])
    assert along[0] * pull[1] - along[1] * pull[0] == pytest.approx(0.0, abs=1e-12)
