from contextlib import nullcontext

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.ball_joints import (
    balls_of,
    configuration,
    roll_pitch_yaw,
)
from pinarm.mechanics.joints import joints_of
from pinarm.mechanics.laws import Harmonic
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

ARM = ({"name": "swing", "at": "0.1 0.2 0.3", "axis": "1 2 3"}, {"name": "body", "kind": "floating", "at": "1 0 0"})


@pytest.fixture
def model(chain):
    """A floating body in a frame that turns and is tilted."""
    xml = chain(*ARM)
    return build_model(xml.replace('<origin xyz="1 0 0"/>', '<origin xyz="1 0 0" rpy="0.4 -0.5 0.6"/>')).model


BODY = '<inertial pos="0.3 0.1 -0.2" mass="2" fullinertia="0.3 0.4 0.5 0.01 0.02 0.03"/></body></worldbody></mujoco>'
BALL = f'<mujoco><worldbody><body name="b" euler="20 30 0"><joint name="J" type="ball"/>{BODY}'
SERIES = BALL.replace('<joint name="J" type="ball"/>', "".join(
    f'<joint name="{name}" axis="{axis}"/>' for name, axis in (("yaw", "0 0 1"), ("pitch", "0 1 0"), ("roll", "1 0 0"))
))  # fmt: skip
LAWS = {"roll": Harmonic(amplitude=1.1, pulsation=3.0), "pitch": Harmonic(mean=0.2, amplitude=0.9, pulsation=2.0),
        "yaw": Harmonic(amplitude=2.5, pulsation=1.0, phase=0.4)}  # fmt: skip


def test_laws_of_roll_pitch_and_yaw_are_those_of_three_hinges_in_series(tmp_path):
    found = []
    for text, names in ((BALL, {f"J.{angle}": law for angle, law in LAWS.items()}), (SERIES, LAWS)):
        (tmp_path / "m.xml").write_text(text)
        problem = Inverse(time=TimeGrid(end=2.0, samples=21), motion=names, drives=[*names])
        run = problem.solve(Mechanism.load(tmp_path / "m.xml"), Accuracy(), lambda *path: nullcontext()).rows
        asked = Quantities(run)
        rates = ("angular_velocity", "angular_acceleration")
        motion = [asked[f"body.b.{rate}.{x}"].values for rate in rates for x in "xyz"]
        turns = [asked[f"coordinate.{name}.{rate}"].values for name in names for rate in ("position", "velocity")]
        found.append((np.array(motion), np.array(turns), [asked[f"coordinate.{name}.effort"].values for name in names]))
    for one, other in zip(*found, strict=True):
        assert np.array(one) == pytest.approx(np.array(other), rel=1e-9, abs=1e-9)


def test_roll_pitch_and_yaw_are_those_of_urdf():
    angles = np.random.default_rng(0).uniform([-3, -1.5, -3], [3, 1.5, 3], size=(20, 3))
    turns = Rotation.from_euler("ZYX", angles[:, ::-1])
    assert roll_pitch_yaw(turns.as_quat()) == pytest.approx(angles, abs=1e-13)
    assert pin.rpy.rpyToMatrix(angles[3]) == pytest.approx(turns[3].as_matrix(), abs=1e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("off", [1e-6, 1e-12, 0.0])
def test_at_a_pitch_of_a_right_angle_roll_and_yaw_still_give_the_orientation(off, sign):
    quaternion = Rotation.from_euler("xyz", [0.4, sign * (np.pi / 2 - off), 1.1]).as_quat()
    angles = roll_pitch_yaw(quaternion)
    assert (Rotation.from_euler("xyz", angles) * Rotation.from_quat(quaternion).inv()).magnitude() < 1e-15
    assert sign * angles[1] == pytest.approx(np.pi / 2 - off, abs=1e-15)
    assert np.abs(angles).max() <= np.pi


def test_orientation_is_given_as_angles_or_as_rotation_vector(model):
    joints, balls = joints_of(model), balls_of(model)
    vector = np.array([0.3, -1.2, 2.0])
    turn = Rotation.from_rotvec(vector)
    yaw, pitch, roll = turn.as_euler("ZYX")
    by_vector = {f"body.rotation.{axis}": x for axis, x in zip("xyz", vector, strict=True)}
    by_angles = {"body.roll": roll, "body.pitch": pitch, "body.yaw": yaw}
    for values in (by_vector, by_angles):
        q = configuration(model, joints, balls, {"swing": 0.5, "body.y": 2.0, **values})
        assert q[:4].tolist() == [0.5, 0.0, 2.0, 0.0]
        assert Rotation.from_quat(q[4:8]).as_matrix() == pytest.approx(turn.as_matrix(), abs=1e-14)
    with pytest.raises(InputError, match="the orientation of 'body' is given twice"):
        configuration(model, joints, balls, {"body.rotation.x": 0.1, "body.yaw": 0.1})
    with pytest.raises(InputError, match=r"no joint 'body\.jaw'") as caught:
        configuration(model, joints, balls, {"body.jaw": 0.1})
    assert caught.value.hint == "body.yaw"


def test_a_floating_joint_slides_along_its_parents_axes_and_turns_where_it_is_drawn(model):
    data, frame = model.createData(), model.getFrameId("body_link")
    drawn = pin.SE3(pin.rpy.rpyToMatrix(np.array([0.4, -0.5, 0.6])), np.array([1.0, 0.0, 0.0]))
    joints, balls = joints_of(model), balls_of(model)
    q = configuration(model, joints, balls, {"body.x": 0.3, "body.y": -0.2, "body.yaw": 0.7})
    pin.framesForwardKinematics(model, data, q)
    seen = data.oMf[model.getFrameId("swing_link")].actInv(data.oMf[frame])
    assert seen.translation == pytest.approx([1.3, -0.2, 0.0], abs=1e-14)
    turned = drawn.rotation @ pin.rpy.rpyToMatrix(np.array([0.0, 0.0, 0.7]))
    assert seen.rotation == pytest.approx(turned, abs=1e-14)
