"""The rows of constraints at many configurations against those of each configuration by itself."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from benchmarks.growth import written
from pinarm.engine.constraints.nullspace import MANY
from pinarm.engine.constraints.self_stresses import mobility_of
from pinarm.errors import InputError
from pinarm.use.mechanism import Mechanism

MODELS = Path(pinarm.__file__).parents[1] / "models"


@pytest.fixture
def closure():
    return Mechanism.load(MODELS / "andrews" / "mechanism.yaml").closure


def test_what_moves_both_links_alike_is_not_in_their_rows(tmp_path):
    """The tree is 16 joints deep, and a loop knows the last three: paths between frames leave the others out."""
    scissor = pinarm.Scenario.load(written(tmp_path, "scissor", 8)).mechanism.closure
    q = np.random.default_rng(0).uniform(-1.0, 1.0, scissor.model.nv)
    (wanted,) = scissor.constraint_rows.at(q[None]).matrices
    rows = scissor.rows(scissor.state(q))
    assert np.array_equal(rows != 0.0, wanted != 0.0)
    np.testing.assert_allclose(rows, wanted, atol=1e-13)


@pytest.mark.slow
def test_what_rigid_bodies_do_not_determine_is_told_of_many_joints_as_of_few(tmp_path):
    """Forces across the plane and moments in it, three of every loop; forces in the plane are determined."""
    run = pinarm.Scenario.load(written(tmp_path, "fourbars", 60)).run()
    own = run.trajectory.mechanism
    assert own.model.nv > MANY
    mobility = mobility_of(own, run.trajectory.q[1])
    assert mobility.degree == 180 and mobility.undetermined["top7"] == ["force z", "moment x", "moment y"]
    for given in ("force.x", "force.y", "moment.z"):
        assert np.isfinite(run[f"loop.top7.{given}"].values).all()
    for shared in ("force.z", "moment.x", "moment.y"):
        for owner in ("loop.top7", "joint.u7"):
            with pytest.raises(InputError, match=r"hyperstatic of degree 180.*top5 and 175 more carry together"):
                _ = run[f"{owner}.{shared}"]
