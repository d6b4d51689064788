"""Large tables: memory and the bytes of the files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

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
def test_a_million_samples_of_seven_torques_need_less_than_three_gibibytes(
    tmp_path: Path, spend: Callable[..., Any]
) -> None:
    (tmp_path / "s.yaml").write_text(SCENARIO)
    spent = spend(tmp_path, "run", "s.yaml", "--no-plots", "-o", "out")
    assert spent.status == 0, spent.text
    assert spent.peak < 3.0 * 2**30
    with open(tmp_path / "out" / "trajectory.csv", "rb") as table:
        assert sum(1 for _ in table) == 1_000_001
