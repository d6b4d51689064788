"""Work of many runs says where it stands, to whoever shows it."""

from pathlib import Path

import pinarm
from pinarm.use.progress import shown_by

ARM = Path(__file__).parents[2] / "scenarios" / "gen411_arm_static.yaml"
COARSE = {"problem.over.phi.samples": 3}


def test_searches_and_sensitivities_count_their_runs():
    lines: list[str] = []
    asked = {"sensitivity": {"of": ["C_B @ max"], "to": {"l2": "1 %"}}, **COARSE}
    with shown_by(lines.append):
        assert pinarm.run(ARM, asked).sections["sensitivity"]
        wanted = {"find": {"for": {"arguments.m_A": ["0 kg", "1 kg"]}, "minimise": "C_B @ max"}, **COARSE}
        pinarm.run(ARM, wanted)
    runs = {word: [line for line in lines if line.startswith(word)] for word in ("sensitivity", "find")}
    assert runs["sensitivity"][:2] == ["sensitivity: run 1", "sensitivity: run 2"]
    assert runs["find"][:2] == ["find: run 1", "find: run 2"]
    assert lines[-1] == ""
