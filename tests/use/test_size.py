"""Large tables: memory and the bytes of the files."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
JOINTS = [f"panda_joint{k}" for k in range(1, 8)]
MOTION = "\n".join(f"    {name}: {{law: polynomial, from: 0.1 rad, to: -0.4 rad, duration: 2 s}}" for name in JOINTS)
SCENARIO = f"""\
pinarm: 1
mechanism: panda
problem:
  kind: inverse
  time: {{end: 2 s, samples: 1000000}}
  motion:
{MOTION}
    panda_finger_joint1: {{law: constant, value: 20 mm}}
outputs: [{", ".join(f"joint.{name}.effort" for name in JOINTS)}]
"""


@pytest.mark.slow
def test_a_million_samples_of_seven_torques_need_less_than_one_and_a_half_gibibytes(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(SCENARIO)
    command = [sys.executable, "-m", "pinarm", "run", "s.yaml", "--no-plots", "-o", "out"]
    child = subprocess.Popen(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)})
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    assert child.returncode == 0
    assert used.ru_maxrss * (1 if sys.platform == "darwin" else 1024) < 1.5 * 2**30
    with open(tmp_path / "out" / "trajectory.csv", "rb") as table:
        assert sum(1 for _ in table) == 1_000_001
