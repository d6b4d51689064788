"""Closed loops over ten seconds: how well they stay closed, what becomes of their energy, the error by tolerance."""

import numpy as np
import pytest
from catalogue import MODELS, bennett, four_bar, rssr
from motions import energy, free, freely, poses

from pinarm.engine.dynamics.equation import solve
from pinarm.engine.motion.systems import loop_motion
from pinarm.errors import DynamicsError
from pinarm.use.mechanism import Mechanism

TOLERANCE = 1e-9
LONG = {
    "four-bar": (four_bar(), ["B"], 6.0), "rsur by a ball joint": (rssr(), ["A"], 6.0),
    "rsur by a cross": (rssr(), ["B"], 6.0),
    "bennett": (bennett(), ["axis_3"], 4.0),
}  # fmt: skip


@pytest.fixture(scope="module")
def outcome(name, tmp_path_factory):
    """Return ten seconds of a linkage."""
    linkage, cut, speed = LONG[name]
    mechanism = linkage.build(tmp_path_factory.mktemp("linkage"), cut)
    first = "O" if "O" in mechanism.joints else "axis_1"
    return freely(mechanism, 10.0, 401, velocity={first: speed}, tolerance=TOLERANCE)


@pytest.fixture(scope="module")
def run(outcome):
    return outcome.rows


SLOW = pytest.param("rsur by a cross", marks=pytest.mark.slow)  # by the general route


@pytest.mark.parametrize("name", [*(name for name in LONG if name != "rsur by a cross"), SLOW], scope="module")
class TestTenSeconds:
    def test_loops_stay_closed(self, name, run):
        closure = run.mechanism.closure
        for q, v in zip(run.q, run.v, strict=True):
            state = closure.state(q)
            assert np.abs(closure.gap(state)).max() < 1e-10
            assert np.abs(closure.rows(state) @ v).max() < 1e-10

    def test_energy_is_kept_at_the_tolerance(self, name, outcome, run):
        """By the motion of the bodies; some hundred steps add their errors."""
        linkage = LONG[name][0]
        total = np.array([energy(linkage, pose) for pose in poses(linkage, run)])
        kinetic = np.array([energy(linkage, pose, weight=0.0) for pose in poses(linkage, run)])
        assert np.ptp(kinetic) > 0.1 * kinetic.max()
        assert np.abs(total - total[0]).max() < 300 * TOLERANCE * kinetic.max()
        assert outcome.measures()["energy"] < 300 * TOLERANCE


class TestTolerance:
    """The error follows the tolerance: a step is brought back onto the loop without loss of order."""

    tolerances = (1e-5, 1e-8, 1e-11)

    @pytest.mark.parametrize("name", ["four-bar", "rsur by a ball joint", SLOW])
    def test_the_error_shrinks_with_it(self, name, tmp_path):
        linkage, cut, speed = LONG[name]
        mechanism = linkage.build(tmp_path, cut)
        exact = free(mechanism, 1.0, 5, velocity={"O": speed}, tolerance=1e-14)
        errors = []
        for tolerance in self.tolerances:
            run = free(mechanism, 1.0, 5, velocity={"O": speed}, tolerance=tolerance)
            errors.append(np.abs(run.q - exact.q).max())
        assert np.polyfit(np.log(self.tolerances), np.log(errors), 1)[0] > 0.85
        assert (np.array(errors) < 1000 * np.array(self.tolerances)).all()


class TestTornAccelerations:
    """A solver that were worse than it should be would tell a smooth, closed and wrong motion."""

    def run(self, name, tmp_path):
        """From rest: the projection of velocities uses the same equations."""
        linkage, cut, _ = LONG[name]
        return free(linkage.build(tmp_path, cut), 0.2, tolerance=1e-6)

    def test_they_are_refused(self, tmp_path, monkeypatch, without):
        monkeypatch.setattr(loop_motion, "solve", lambda *given: solve(*given) * (1.0 + 1e-4))
        with pytest.raises(DynamicsError, match=r"at t = \S+ s the accelerations tear the loops"):
            without(lambda: self.run("rsur by a cross", tmp_path))


class TestVelocitiesAgainstTheLoop:
    """The uprights of a parallelogram turn alike."""

    def run(self, **velocity):
        mechanism = Mechanism.load(MODELS / "four_bar" / "mechanism.yaml")
        position = {"upright_0": 0.3, "coupler_0": -0.3, "upright_1": 0.3}
        return freely(mechanism, 0.1, position=position, velocity=velocity)

    def test_the_closest_are_taken_and_told(self):
        run = self.run(upright_0=1.0, upright_1=3.0)
        assert run.rows.v[0] == pytest.approx([2.0, -2.0, 2.0], abs=1e-12)
        (note,) = run.notes
        assert (
            "upright_0 has 2 rad/s at the start where 1 was given, upright_1 has 2 rad/s at the start where 3" in note
        )
