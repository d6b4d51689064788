"""Many configurations at once are those one by one, also where some of them are singular."""

import catalogue
import numpy as np
import pytest
from motions import driven, free

from pinarm.engine.constraints import closure
from pinarm.engine.constraints.constraint_rows import BLOCK
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.constraints.nullspace import split_rows
from pinarm.engine.kinematics.continuation import Ahead
from pinarm.engine.motion.systems import loop_system
from pinarm.errors import InputError
from pinarm.mechanics.laws import Harmonic
from pinarm.use.mechanism import Mechanism

LINKAGES = {
    "four_bar": (catalogue.four_bar, ["B"], ["O"]), "five_bar": (catalogue.five_bar, ["M"], ["O", "C"]),
    "slider_crank": (catalogue.slider_crank, ["B"], ["O"]), "rssr": (catalogue.rssr, ["B"], ["O"]),
    "parallelogram": (catalogue.parallelogram, ["b", "d"], ["foot_0"]),
    "bennett": (catalogue.bennett, ["axis_4"], ["axis_1"]),
    "manipulator": (catalogue.manipulator, ["D", "F"], ["alpha"]),
}  # fmt: skip
"""Redundant or not, in the plane and in space, with one freedom and with two: loop joints, and drives."""


@pytest.mark.parametrize("name", LINKAGES)
def test_a_motion_and_its_efforts_are_those_found_row_by_row(name, tmp_path, monkeypatch):
    linkage, cut, drives = LINKAGES[name]
    mechanism = linkage().build(tmp_path, cut)
    motion = {drive: Harmonic(amplitude=0.3, pulsation=5.0 + k) for k, drive in enumerate(drives)}
    together = driven(mechanism, motion, samples=40, drives=drives)
    monkeypatch.setattr(Ahead, "of", lambda *_: None)
    monkeypatch.setattr(closure, "SEVERAL", 1_000_000)
    alone = driven(mechanism, motion, samples=40, drives=drives)
    for one, other in ((together.q, alone.q), (together.v, alone.v), (together.a, alone.a), (together.tau, alone.tau)):
        assert one == pytest.approx(other, rel=1e-11, abs=1e-11 * np.abs(other).max())
    assert np.asarray(together.lam) == pytest.approx(np.asarray(alone.lam), rel=1e-9, abs=1e-9)


@pytest.fixture
def four_bar():
    """Equal rods that stand upright at 0 and lie in one line at a quarter turn, where two motions meet."""
    return Mechanism.load(catalogue.MODELS / "four_bar" / "mechanism.yaml")


def leaning(mechanism, angle, level=1.0):
    """Rows in which all uprights move alike: coordinates at ``angle``, or their rates."""
    rows = np.zeros((len(angle), mechanism.model.nv))
    for name, share in {"upright_0": 1.0, "coupler_0": -1.0, "upright_1": 1.0}.items():
        rows[:, mechanism.joints[name].v] = share * angle * level
    return rows


class TestFreeMotions:
    def test_they_are_those_of_every_single_position(self, four_bar):
        angle = np.random.default_rng(0).uniform(-3.0, 3.0, 2 * BLOCK + 5)
        angle[[0, 7, 500, BLOCK, 2 * BLOCK + 4]] = np.pi / 2 * np.array([1.0, -1.0, 1.0, 1.0 + 1e-7, 1.0 - 1e-10])
        q, seen = leaning(four_bar, angle), np.zeros(len(angle), dtype=int)
        for places, motions in four_bar.closure.free_motions(q):
            seen[places] += 1
            for k in range(0, len(places), 37):
                state = four_bar.closure.state(q[places[k]])
                right = split_rows(four_bar.closure.rows(state)).free
                assert len(motions) == right.shape[1]
                assert motions[:, k].T @ motions[:, k] == pytest.approx(right @ right.T, abs=1e-8)  # 1e-15 / 1e-7
        assert (seen == 1).all()

    def test_two_where_the_rods_lie_in_one_line(self, four_bar):
        q = leaning(four_bar, np.pi / 2 * np.array([0.3, 1.0, 0.6]))
        found = [(int(k), len(motions)) for places, motions in four_bar.closure.free_motions(q) for k in places]
        assert dict(found) == {0: 1, 1: 2, 2: 1}


class TestStates:
    N = 2 * BLOCK + 5

    def test_efforts_are_those_of_the_one_rod_that_all_uprights_are(self, four_bar):
        """``((N + 1)/3 + N) theta'' - ((N + 1)/2 + N) g sin theta`` for N = 1, in any order of the rows."""
        angle, speed, gain = np.random.default_rng(1).uniform(-1.4, 1.4, (3, self.N))
        q, v, a = (leaning(four_bar, x) for x in (angle, speed, gain))
        effort = four_bar.at(q, v, a, drives=["upright_0"])["joint.upright_0.effort"].values
        assert effort == pytest.approx(5.0 / 3.0 * gain - 2.0 * 9.81 * np.sin(angle), abs=1e-12)

    def test_the_one_at_a_dead_point_is_told(self, four_bar):
        angle = np.full(self.N, 0.4)
        angle[BLOCK + 3] = np.pi / 2
        with pytest.raises(InputError, match="the drives upright_0 leave a load") as raised:
            four_bar.at(leaning(four_bar, angle), drives=["upright_0"])
        assert "2 drives" in raised.value.expected

    @pytest.mark.parametrize(("what", "column"), [("positions", 0), ("velocities", 1), ("accelerations", 2)])
    def test_the_one_that_tears_a_loop_is_told(self, four_bar, what, column):
        states = [leaning(four_bar, np.linspace(-1.0, 1.0, self.N), level) for level in (1.0, 2.0, 3.0)]
        states[0][:, :] = leaning(four_bar, np.linspace(-1.0, 1.0, self.N))
        states[column][BLOCK + 3, 0] += 1e-6
        with pytest.raises(InputError, match=f"row {BLOCK + 3}: the {what} tear 'top_1'"):
            four_bar.at(*states)


@pytest.mark.parametrize("name", LINKAGES)
def test_the_rows_of_a_free_motion_are_those_computed_one_by_one(name, tmp_path, monkeypatch):
    linkage, cut, (drive, *_) = LINKAGES[name]
    mechanism = linkage().build(tmp_path, cut)
    motion = {drive: Harmonic(amplitude=0.3, pulsation=5.0)} if name == "five_bar" else {}
    together = free(mechanism, 0.2, 120, tolerance=1e-5, motion=motion)
    monkeypatch.setattr(loop_system, "BLOCK", 1)
    alone = free(mechanism, 0.2, 120, tolerance=1e-5, motion=motion)
    for one, other in ((together.q, alone.q), (together.v, alone.v), (together.a, alone.a), (together.tau, alone.tau)):
        assert one == pytest.approx(other, rel=1e-8, abs=1e-8 * np.abs(other).max())  # of the squares of gaps of 1e-5
    assert np.asarray(together.lam) == pytest.approx(np.asarray(alone.lam), rel=1e-7, abs=1e-7)


def test_rows_of_several_runs_stand_one_after_the_other():
    first, second = np.arange(6.0).reshape(3, 2), -np.arange(4.0).reshape(2, 2)
    both = Multipliers.joined(
        [Multipliers.known(first, 1), Multipliers.known(first[:0], 1), Multipliers.known(second, 1)]
    )
    assert np.asarray(both).tolist() == [*first.tolist(), *second.tolist()]
