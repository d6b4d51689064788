"""Jacobians, mass matrices and placements: closed forms, rates of quantities, Pinocchio."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.mechanism import Mechanism

MODELS = Path(pinarm.__file__).parents[1] / "models"


@pytest.fixture
def arm():
    return Mechanism.load(MODELS / "gen411_arm" / "mechanism.yaml")


@pytest.fixture
def random():
    return np.random.default_rng(5)


def test_jacobians_of_two_rods_by_closed_form(arm, random):
    q = random.normal(size=(4, 5, 2))
    theta, phi = q[..., 0], q.sum(axis=-1)
    x, y = -0.25 * np.sin(phi), 0.25 * np.cos(phi)
    expected = np.stack(
        [np.stack([x - 0.25 * np.sin(theta), x], axis=-1), np.stack([y + 0.25 * np.cos(theta), y], axis=-1)], axis=-2
    )
    assert arm.jacobian("point.A", q)[..., :2, :] == pytest.approx(expected, abs=1e-14)
    assert arm.jacobian("point.A", q)[..., 2, :] == pytest.approx(0.0, abs=1e-14)
    assert arm.jacobian("body.A", q)[..., 2, :] == pytest.approx(np.ones((4, 5, 2)), abs=1e-14)
    assert arm.jacobian("phi", q) == pytest.approx(np.ones((4, 5, 2)), abs=0.0)
    assert arm.jacobian("coordinate.A_height", q) == pytest.approx(expected[..., 1, :], abs=1e-14)


@pytest.mark.parametrize("name", ["ur5", "anymal", "gyroscope"])
def test_rates_of_quantities_are_jacobians_times_velocities(name, random):
    """Two routes: Pinocchio's forward kinematics with velocities, and its Jacobians."""
    path = MODELS / name / "mechanism.yaml"
    mechanism = Mechanism.load(path if path.exists() else name)
    q = pin.randomConfiguration(mechanism.model, -np.ones(mechanism.model.nq), np.ones(mechanism.model.nq))
    v = random.normal(size=mechanism.model.nv)
    link = [frame.name for frame in mechanism.model.frames if frame.type == pin.FrameType.BODY][-1]
    states = mechanism.at(q, v)
    for of, quantity in ((f"point.{link}", "velocity"), (f"body.{link}", "angular_velocity")):
        for along in ("", f".along.{link}"):
            expected = [states[f"{of}.{quantity}{along}.{axis}"].values for axis in "xyz"]
            assert mechanism.jacobian(f"{of}{along}", q) @ v == pytest.approx(np.array(expected), abs=1e-13)
    for ball in mechanism.balls:
        expected = [states[f"joint.{ball}.angular_velocity.{axis}"].values for axis in "xyz"]
        assert mechanism.jacobian(f"joint.{ball}", q) @ v == pytest.approx(np.array(expected), abs=0.0)


def test_the_mass_matrix_gives_efforts_and_energy(arm, random):
    """Columns are efforts for unit accelerations less those for none; vMv/2 is the kinetic energy."""
    q, v = random.normal(size=(2, 6, 2))
    mass, still = arm.mass_matrix(q), np.zeros((6, 2))
    for k, unit_acceleration in enumerate(np.eye(2)):
        column = arm.inverse(q, still, still + unit_acceleration) - arm.inverse(q, still, still)
        assert mass[:, :, k] == pytest.approx(column, abs=1e-13)
    energy = np.einsum("ni,nij,nj->n", v, mass, v) / 2
    assert arm.at(q, v)["energy.kinetic"].values == pytest.approx(energy, rel=1e-13)
    assert arm.mass_matrix(q[0]).shape == (2, 2)


def test_placements_have_any_leading_axes(arm, random):
    q = random.normal(size=(2, 3, 2))
    placed = arm.frame("A", q)
    assert placed.shape == (2, 3, 4, 4)
    assert placed[..., 0, 3] == pytest.approx(0.25 * np.cos(q[..., 0]) + 0.25 * np.cos(q.sum(axis=-1)), abs=1e-14)
    joint = arm.frame("joint.B", q[0, 0])
    angle = q[0, 0].sum()
    assert joint[:2, 0] == pytest.approx([np.cos(angle), np.sin(angle)], abs=1e-14)
    assert arm.frame("A", np.zeros((0, 2))).shape == (0, 4, 4)
    assert arm.jacobian("A", np.zeros((0, 2))).shape == (0, 6, 2)


def test_pinocchios_data_are_filled(arm, random):
    q, v, a = random.normal(size=(3, 2))
    data = arm.pin_data(q, v, a)
    assert data.tau == pytest.approx(arm.inverse(q, v, a), abs=1e-13)
    assert data.M @ a + data.nle == pytest.approx(data.tau, abs=1e-13)
    frame = arm.model.getFrameId("A")
    acceleration = pin.getFrameClassicalAcceleration(arm.model, data, frame, pin.LOCAL_WORLD_ALIGNED).linear
    assert acceleration[0] == pytest.approx(float(arm.at(q, v, a)["point.A.acceleration.x"].values), abs=1e-13)
    assert data.oMf[frame].homogeneous == pytest.approx(arm.frame("A", q), abs=0.0)
    assert arm.pin_data(q).v[1].vector == pytest.approx(0.0, abs=0.0)


@pytest.mark.parametrize(("call", "message"), [
    (lambda arm: arm.jacobian("point.C", np.zeros(2)), "no link 'C'"),
    (lambda arm: arm.jacobian("point.A", np.zeros(3)), r"shape \(3,\)"),
    (lambda arm: arm.jacobian("phi.along.A", np.zeros(2)), "a coordinate has no axes"),
    (lambda arm: arm.jacobian("B", np.zeros(2)), "'B' is a link and a coordinate"),
    (lambda arm: arm.pin_data(np.zeros((3, 2))), r"q has the shape \(3, 2\)"),
])  # fmt: skip
def test_mistakes_are_told(arm, call, message):
    with pytest.raises(InputError, match=message):
        call(arm)
