"""The setting that reaches a target, and what is said where none does."""

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.use.accuracy.error_estimate import BOUND, output_differences, with_setting

from .test_error_estimate import ROOT


@pytest.mark.slow
def test_a_target_that_no_setting_reaches_is_missed_with_the_best_that_was(chaos, tmp_path, capsys):
    status = main(["run", str(chaos.document.path), "--set", "accuracy={target: 1e-4}", "-o", str(tmp_path / "out"),
                   "--no-plots", "--json"])  # fmt: skip
    assert status == 1
    assert (tmp_path / "out" / "trajectory.csv").is_file()
    assert '"target reached": false' in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("target", [1e-4, 1e-8])
def test_the_setting_for_a_target_reaches_it_and_the_next_coarser_one_does_not(target):
    path = ROOT / "scenarios" / "crank_rocker_free.yaml"
    result = pinarm.load(path, [f"accuracy={{target: {target}}}"]).run()
    scenario = pinarm.load(path)
    exact = with_setting(scenario, {"tolerance": 1e-13}).solve()
    assert max(output_differences(result, exact).values()) <= target
    assert not result.missed
    used = float(result.setting.split("tolerance ")[1].split(",")[0])
    coarser = with_setting(scenario, {"tolerance": 10 * used}).solve()
    assert 1.5 * BOUND * max(output_differences(coarser, exact).values()) > target


OSCILLATOR = """
pinarm: 1
mechanism: slide.xml
problem:
  kind: forward
  time: {end: 5 s, samples: 51}
  initial: {position: {x: 1 m}}
  loads: {spring: {kind: joint_spring, joint: x, stiffness: 100 N/m}}
outputs: [joint.x.position]
accuracy: {target: 1e-6}
"""
SLIDE = """
<mujoco><option gravity="0 0 0"/><worldbody><body name="frame" pos="0 0 1"><body name="body">
  <joint name="x" type="slide"/><inertial pos="0 0.3 0" mass="1" diaginertia="1 1 1"/>
</body></body></worldbody></mujoco>
"""


@pytest.fixture
def oscillator(tmp_path):
    """An oscillator of 1 kg and 10 rad/s on a mechanism of the size of 1 m."""
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "slide.xml").write_text(SLIDE)
    (tmp_path / "oscillator.yaml").write_text(OSCILLATOR)
    return tmp_path / "oscillator.yaml"


@pytest.mark.parametrize("amplitude", [1e-12, 1.0, 1e6])
def test_a_target_is_one_of_the_output_itself_whatever_its_size(oscillator, amplitude):
    """The error of an oscillation of 1e-12 m is not judged by the size of its frame."""
    values = {"problem.initial.position.x": f"{amplitude!r} m", "accuracy": {"target": 1e-6, "method": "dop853"}}
    result = pinarm.run(oscillator, values)
    found = result["joint.x.position"].values / amplitude
    true = np.abs(found - np.cos(10.0 * result.trajectory.grid.t)).max()
    assert not result.missed
    assert 0.01 * result.error < true <= result.error <= 1e-6


def test_shorter_steps_are_tried_where_the_first_diverges():
    """A slide of 2 kg in a damper of 2 kN s/m: v = v0 exp(-1000 t), of which a step of 8 ms makes 100 v0."""
    given = {
        "pinarm": 1, "mechanism": str(ROOT / "docs" / "kind_examples" / "laws" / "slide.yaml"),
        "problem": {"kind": "forward", "time": {"end": "0.5 s", "samples": 3},
                    "initial": {"velocity": {"x": "1 m/s"}},
                    "loads": {"damper": {"kind": "joint_spring", "joint": "x", "damping": "2000 N*s/m"}}},
        "outputs": ["x"], "accuracy": {"method": "rk4", "target": 1e-2},
    }  # fmt: skip
    result = pinarm.run(given)
    assert not result.missed
    assert result["x"].values == pytest.approx(1e-3 * -np.expm1(-1000.0 * result.trajectory.grid.t), abs=1e-5)
