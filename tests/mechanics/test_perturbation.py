"""Models changed in their last digits: by no more than that, everywhere, and the same for the same seed."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.input.yaml.document import Document
from pinarm.mechanics.perturbation import PERTURBATION, perturbed, perturbed_numbers
from pinarm.problems.forward import Forward


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


def test_quantities_of_a_file_change_in_their_last_digits_by_a_half_of_the_most_at_least():
    """All but times and places along laws, where rows and jumps stand, numbers without a unit, and zeros."""
    effort = {"law": "steps", "points": [["0 s", "0 N*m"], ["0.1 s", "3 N*m"]]}
    along = {"law": "spline", "points": [["0 rad", "0 N*m"], ["1.7 rad", "3 N*m"]]}
    data = {
        "time": {"end": "2 s"},
        "initial": {"position": {"a": "90 deg", "b": "0 deg"}},
        "loads": {
            "spring": {"kind": "joint_spring", "joint": "a", "stiffness": "7 N*m/rad"},
            "push": {"kind": "joint_effort", "joint": "a", "effort": effort},
            "cam": {"kind": "joint_effort", "joint": "a", "over": "b", "effort": along},
        },
        "end_stops": {"b": {"upper": "1 rad", "restitution": 0.3}},
    }
    given = Document.of_data({"kind": "forward", **data}, "problem").validate(Forward)
    for seed in range(5):
        found = perturbed_numbers(given, np.random.default_rng(seed))
        for before, after in (
            (given.initial.position["a"], found.initial.position["a"]),
            (given.loads["spring"].stiffness, found.loads["spring"].stiffness),
            (given.loads["push"].effort.points[1][1], found.loads["push"].effort.points[1][1]),
        ):
            change = abs(after / before - 1.0)
            assert PERTURBATION / 2.0 - np.finfo(float).eps <= change <= PERTURBATION + np.finfo(float).eps
            assert after.unit == before.unit
        assert found.time.end == 2.0
        assert found.initial.position["b"] == 0.0
        assert [t for t, _ in found.loads["push"].effort.points] == [0.0, 0.1]
        assert [place for place, _ in found.loads["cam"].effort.points] == [0.0, 1.7]
        assert found.end_stops["b"].restitution == 0.3
