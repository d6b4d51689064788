"""Models changed in their last digits: by no more than that, everywhere, and the same for the same seed."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.mechanics.joints import joints_of
from pinarm.mechanics.perturbation import PERTURBATION, coarse_angles, perturbed


@pytest.fixture
def model():
    built = pin.buildSampleModelManipulator()
    built.gravity.linear = np.array([0.0, 0.0, -9.81])
    built.armature = np.full(built.nv, 0.3)
    return built


def numbers(model):
    """Masses, levers, moments of inertia, places of joints, armatures, gravity."""
    bodies = [model.inertias[k] for k in range(1, model.njoints)]
    return np.concatenate([
        *([body.mass, *body.lever, *body.inertia.ravel()] for body in bodies),
        *(model.jointPlacements[k].translation for k in range(1, model.njoints)),
        model.armature, model.gravity.linear,
    ])  # fmt: skip


def test_every_number_changes_in_its_last_digits_and_zeros_do_not(model):
    before, after = numbers(model), numbers(perturbed(model, 1))
    zero = before == 0.0
    assert zero.any()
    assert not after[zero].any()
    relative = np.abs(after[~zero] / before[~zero] - 1.0)
    assert relative.max() <= PERTURBATION + np.finfo(float).eps  # the quotient rounds too
    assert (relative > 0.0).mean() > 0.7  # some changes round to nothing
    assert (relative[-7:-1] > 0.0).any()  # armatures
    assert relative[-1] > 0.0  # gravity


def test_the_model_itself_stays(model):
    before = numbers(model)
    perturbed(model, 1)
    assert numbers(model).tolist() == before.tolist()


def test_a_seed_says_which_change(model):
    once, again, other = (numbers(perturbed(model, seed)) for seed in (1, 1, 2))
    assert once.tolist() == again.tolist()
    assert once.tolist() != other.tolist()


def test_angles_that_have_lost_their_ninth_digit_are_told():
    """Doubles near 1e8 are 1.5e-8 apart, near 1e6 1.2e-10."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "fan")
    (note,) = coarse_angles(joints_of(model), np.array([[0.0], [-1e8]]))
    assert "joint fan" in note
    assert "1e-08 rad" in note
    assert coarse_angles(joints_of(model), np.array([[1e6]])) == []
