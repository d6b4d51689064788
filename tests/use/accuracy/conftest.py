"""A motion whose error grows without bound."""

from pathlib import Path

import pytest

import pinarm

ROOT = Path(pinarm.__file__).parents[1]
DOUBLE_PENDULUM = """
pinarm: 1
mechanism: {model}
problem:
  kind: forward
  time: {{end: 35 s, samples: 71}}
  initial: {{position: {{O: 120 deg, B: 10 deg}}}}
outputs: [joint.O.position, joint.B.velocity]
accuracy: {{tolerance: 1e-11}}
"""


@pytest.fixture
def chaos(tmp_path):
    (tmp_path / ".pinarm-root").touch()
    for file in (ROOT / "models" / "gen411_arm").iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "chaos.yaml").write_text(DOUBLE_PENDULUM.format(model="mechanism.yaml"))
    return pinarm.load(tmp_path / "chaos.yaml")
