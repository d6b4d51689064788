"""Evaluated states: what they hold is Pinocchio's, and no state overwrites another."""

from pathlib import Path
from threading import Thread

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm import Mechanism
from pinarm.mechanics.geometry.kinematics import Kinematics

MODELS = Path(pinarm.__file__).parents[1] / "models"


@pytest.fixture
def model():
    return Mechanism.load(MODELS / "andrews" / "mechanism.yaml").model


def random_states(model, n):
    return np.random.default_rng(0).normal(size=(n, 2, model.nv))


def test_threads_do_not_share_states(model):
    """Many threads evaluate states of one mechanism at once; a shared buffer would mix their placements."""
    configurations, wrong = random_states(model, 40)[:, 0], []
    right = []
    for q in configurations:
        pin.forwardKinematics(model, data := model.createData(), q)
        right.append(data.oMi[model.njoints - 1].translation.copy())

    def evaluate():
        for _ in range(10):
            for q, place in zip(configurations, right, strict=True):
                state = Kinematics.at(model, q)
                if not np.array_equal(state.data.oMi[model.njoints - 1].translation, place):
                    wrong.append(q)

    threads = [Thread(target=evaluate) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
