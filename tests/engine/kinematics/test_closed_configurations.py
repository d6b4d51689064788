"""Closed configurations at which mechanisms are judged: closed, and of no special kind."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.kinematics.assembly import beside, generic, generic_near
from pinarm.errors import InputError
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).resolve().parents[3] / "models"
FILES = sorted(MODELS.glob("*/mechanism.yaml"))


def rank(mechanism: Mechanism, q: np.ndarray) -> int:
    """Rank of G by the ratio of singular values, rows of length 1."""
    closure = mechanism.closure
    rows = closure.rows(closure.state(q))
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return int(np.linalg.matrix_rank(rows[length[:, 0] > 1e-9] / length[length > 1e-9][:, None], tol=1e-7))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.parent.name)
def test_every_mechanism_file_of_ours_closes_and_is_regular_beside(file: Path) -> None:
    mechanism = Mechanism.load(file)
    closure, q = mechanism.closure, generic_near(mechanism, {})
    assert np.abs(closure.gap(closure.state(q))).max(initial=0.0) < 1e-12
    assert len({rank(mechanism, one) for one in beside(mechanism, q)}) == 1


def test_a_linkage_folded_flat_is_judged_beside_that_position() -> None:
    """Flat, the four-bar of equal rods has two motions; everywhere else it has one."""
    mechanism = Mechanism.load(MODELS / "four_bar" / "mechanism.yaml")
    flat = mechanism.configurations({"upright_0": np.pi / 2, "coupler_0": -np.pi / 2, "upright_1": np.pi / 2})
    assert rank(mechanism, flat) == 1
    assert rank(mechanism, generic(mechanism, beside(mechanism, flat))) == 2


class TestStartOfTheMechanismFile:
    SCENARIO = """\
pinarm: 1
mechanism: crank_rocker/mechanism.yaml
problem:
  kind: kinematics
  time: {end: 0.1 s, samples: 3}
  motion: {theta2: {law: constant_speed, speed: 100 rpm}}
START
outputs: [theta4]
"""

    def first(self, folder: Path, start: str) -> float:
        file = folder / "scenario.yaml"
        file.write_text(self.SCENARIO.replace("START", start))
        return float(pinarm.run(file)["theta4"].values[0])

    def test_a_scenario_begins_there_and_its_own_start_replaces_it_joint_by_joint(self, tmp_path) -> None:
        shutil.copytree(MODELS / "crank_rocker", tmp_path / "crank_rocker")
        opened = self.first(tmp_path, "")
        assert opened == self.first(tmp_path, "  start: {A: 40 deg, theta4: 80 deg}")
        assert self.first(tmp_path, "  start: {A: -90 deg, theta4: -80 deg}") == pytest.approx(-opened, abs=1e-9)

    def test_a_joint_that_a_gear_ties_to_another_begins_there(self) -> None:
        """The wheel at C, which is not given, is turned twice as far the other way."""
        planar = {
            "points": {"O": ["0 m", "0 m"], "A": ["0.1 m", "0 m"], "C": ["0.3 m", "0 m"], "B": ["0.4 m", "0 m"]},
            "links": {"one": {"points": ["O", "A"], "mass": "1 kg"}, "two": {"points": ["C", "B"], "mass": "1 kg"}},
            "ground": ["O", "C"],
        }
        pair = {"pair": {"kind": "gear", "joints": ["O", "C"], "ratio": -2}}
        mechanism = {"pinarm": 1, "planar": planar, "gravity": "none", "couplings": pair, "start": {"O": "90 deg"}}
        problem = {"kind": "forward", "time": {"end": "1 s", "samples": 2}}
        found = pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": ["O", "C"]})
        assert found["O"].to("deg").values == pytest.approx(90.0)
        assert found["C"].to("deg").values == pytest.approx(-180.0)

    @pytest.mark.parametrize(("start", "says"), [
        ({"theta4": "80 mm"}, "80 mm"), ({"theta5": "80 deg"}, "theta5"),
    ])  # fmt: skip
    def test_its_joints_and_units_are_checked(self, start: dict[str, str], says: str) -> None:
        with pytest.raises(InputError, match=says):
            Mechanism.load(MODELS / "crank_rocker" / "mechanism.yaml", values={"start": start})
