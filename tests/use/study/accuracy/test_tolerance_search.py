"""The setting that reaches a target, and what is said where none does."""

from dataclasses import replace

import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.use.study.accuracy import tolerance_search as target_search
from pinarm.use.study.accuracy.error_estimate import output_differences
from pinarm.use.study.accuracy.integration_settings import with_setting
from pinarm.use.study.accuracy.tolerance_search import _ordered

from .test_error_estimate import ROOT


@pytest.mark.slow
def test_a_target_that_no_setting_reaches_is_missed_with_the_best_that_was(chaos, tmp_path, capsys):
    status = main(["run", str(chaos.document.path), "--set", "accuracy={target: 1e-4}", "-o", str(tmp_path / "out"),
                   "--no-plots", "--json"])  # fmt: skip
    assert status == 1
    assert (tmp_path / "out" / "trajectory.csv").is_file()
    assert '"target reached": false' in capsys.readouterr().out


def test_a_setting_that_misses_its_target_after_all_gives_way_to_the_next(chaos, monkeypatch):
    """It is chosen by solutions of other last digits: that of the mechanism as it is may err a little more."""
    tried, found = [], target_search._Search.result

    def first_one_worse(search, wanted, number):
        tried.append(found(search, wanted, number))
        return replace(tried[-1], errors={"joint.O.position": 1.1e-6}) if len(tried) == 1 else tried[-1]

    monkeypatch.setattr(target_search._Search, "result", first_one_worse)
    result = chaos.varied({"problem.time.end": "1 s", "accuracy": {"target": 1e-6, "method": "dop853"}}).run()
    assert result is tried[1]
    assert not result.missed
    assert result.figures["evaluations"] > tried[0].figures["evaluations"]


@pytest.mark.slow
@pytest.mark.parametrize("target", [1e-4, 1e-8])
def test_the_setting_for_a_target_reaches_it_and_the_next_coarser_one_does_not(target):
    path = ROOT / "scenarios" / "crank_rocker_free.yaml"
    result = pinarm.load(path, [f"accuracy={{target: {target}}}"]).run()
    scenario = pinarm.load(path)
    exact = with_setting(scenario, {"tolerance": 1e-13}).solve()
    assert max(output_differences(result, exact).values()) <= 1.5 * target
    assert not result.missed
    used = float(result.setting.split("tolerance ")[1].split(",")[0])
    coarser = with_setting(scenario, {"tolerance": 10 * used}).solve()
    assert max(output_differences(coarser, exact).values()) > target / 1.5


@pytest.mark.parametrize(("damping", "first"), [("1e5 N*m*s/rad", "stiff"), ("1 N*m*s/rad", "dop853")])
def test_a_stiff_motion_is_tried_by_the_method_for_it_first(damping, first):
    """What that one costs limits the steps that the others may take: 1e5 N*m*s/rad decay within 1e-7 s."""
    damper = f"problem.loads={{oil: {{kind: joint_spring, joint: B, damping: {damping}}}}}"
    swing = pinarm.load(ROOT / "scenarios" / "gen411_arm_swing.yaml", [damper, "problem.time.end=0.5 s"])
    assert _ordered(swing, 0.5, 1e-6)[0] == first
