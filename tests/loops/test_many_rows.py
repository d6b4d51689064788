"""Many configurations at once, also where some of them are singular."""

import catalogue
import numpy as np
import pytest

from pinarm.engine.constraints.constraint_rows import BLOCK
from pinarm.errors import InputError
from pinarm.use.mechanism import Mechanism


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


class TestStates:
    N = BLOCK + 5

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

    @pytest.mark.parametrize(("what", "column"), [("positions", 0), ("accelerations", 2)])
    def test_the_one_that_tears_a_loop_is_told(self, four_bar, what, column):
        states = [leaning(four_bar, np.linspace(-1.0, 1.0, self.N), level) for level in (1.0, 2.0, 3.0)]
        states[0][:, :] = leaning(four_bar, np.linspace(-1.0, 1.0, self.N))
        states[column][BLOCK + 3, 0] += 1e-6
        with pytest.raises(InputError, match=f"row {BLOCK + 3}: the {what} tear 'top_1'"):
            four_bar.at(*states)
