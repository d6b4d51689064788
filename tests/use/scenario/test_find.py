"""Numbers of a scenario that bring something about, against closed forms."""

import math
import re
import shutil
from pathlib import Path

import pytest

import pinarm
from pinarm.errors import InputError, PinarmError
from pinarm.use.facade import Scenario

ROOT = Path(pinarm.__file__).parents[1]
ARM = """
pinarm: 1
mechanism: {models}/gen411_arm/mechanism.yaml
arguments: {arguments}
problem: {{kind: statics, hold: {{O: 0 deg, phi: {phi}}}}}
find:
  for: {{{unknown}}}
  so_that: {{{wanted}}}
outputs: [C_B]
"""


def found(folder: Path, unknown: str, wanted: str, phi: str = "0 deg", arguments: str = "{}"):
    (folder / ".pinarm-root").touch()
    if not (folder / "models").exists():
        shutil.copytree(ROOT / "models" / "gen411_arm", folder / "models" / "gen411_arm")
    file = folder / "arm.yaml"
    file.write_text(ARM.format(models="models", unknown=unknown, wanted=wanted, phi=phi, arguments=arguments))
    return Scenario.load(file).run()


def test_the_load_for_a_torque_is_found_in_the_unit_it_was_asked_in(tmp_path):
    """C_B = g l2 (m_A + m_BA / 2) at phi = 0."""
    result = found(tmp_path, "arguments.m_A: 100 g", "C_B: 2 N*m")
    assert result.figures["arguments.m_A [g]"] == pytest.approx(1e3 * (2.0 / (9.81 * 0.25) - 0.5), rel=1e-12)
    assert result["C_B"].values == pytest.approx(2.0, rel=1e-13)
    assert "find" not in result.data  # what is saved solves the problem itself
    assert result.data["arguments"]["m_A"].endswith(" g")


def test_an_angle_is_found_though_the_torque_bends_with_it(tmp_path):
    result = found(tmp_path, "problem.hold.phi: 20 deg", "C_B: 1 N*m")
    angle = math.degrees(math.acos(1.0 / (9.81 * 0.25 * 0.6)))
    assert result.figures["problem.hold.phi [deg]"] == pytest.approx(angle, rel=1e-11)


def test_what_cannot_be_met_is_met_as_nearly_as_can_be_and_the_rest_is_told(tmp_path):
    """One mass for two torques, 2 and 3 N*m: it gives the middle."""
    result = found(tmp_path, "arguments.m_A: 100 g", "C_B: 2 N*m, C_B + 0: 3 N*m")
    left = [value for name, value in result.figures.items() if name.startswith("left of")]
    assert left == pytest.approx([0.5, 0.5], rel=1e-9)
    [note] = [note for note in result.notes() if note.startswith("so_that is not met")]
    assert note.startswith("so_that is not met: the closest values that were found miss C_B by 0.5 N*m, ")


def test_what_is_met_needs_no_remark(tmp_path):
    """From the solution, too, where all that is left is rounding."""
    for start in ("100 g", f"{1e3 * (2.0 / (9.81 * 0.25) - 0.5)!r} g"):
        result = found(tmp_path, f"arguments.m_A: {start}", "C_B: 2 N*m")
        assert not [note for note in result.notes() if "so_that" in note]


@pytest.mark.parametrize(
    ("unknown", "wanted", "message"),
    [
        ("arguments.l0: 0.5 m", "C_B: 2 N*m", "does not determine arguments.l0"),
        (
            "arguments.m_A: 100 g, arguments.m_BA: 1 kg",
            "C_B: 2 N*m",
            "not determine arguments.m_A, arguments.m_BA",
        ),
        ("arguments.m_Z: 100 g", "C_B: 2 N*m", "no argument 'm_Z'"),
        ("arguments.m_A: 100 g", "C_B: 2 kg", "'kg' is not a unit"),
        ("arguments.m_A: 100 g", "C_Q: 2 N*m", "no quantity 'C_Q'"),
    ],
)
def test_what_is_refused(tmp_path, unknown, wanted, message):
    with pytest.raises(PinarmError) as caught:
        found(tmp_path, unknown, wanted)
    assert isinstance(caught.value, InputError)
    assert message in str(caught.value)


@pytest.mark.slow
def test_runs_that_have_not_as_many_rows_are_refused_with_what_to_ask_instead() -> None:
    """An arm ends its motion at another instant with every initial speed."""
    swing = Path(__file__).parents[3] / "scenarios" / "gen411_arm_swing.yaml"
    changes = {
        "accuracy.tolerance": 1e-5,
        "problem.events": {"low": {"when": "O", "reaches": "-0.8 rad", "then": "stop"}},
        "find": {"for": {"problem.initial.velocity.B": "3 rad/s"}, "so_that": {"A_y": "0.3 m"}},
    }
    with pytest.raises(InputError, match="not as many rows") as caught:
        pinarm.run(swing, changes)
    assert "@ end" in caught.value.hint


HOIST = (
    '<robot name="hoist"><link name="base"/><joint name="z" type="prismatic"><parent link="base"/><child link="load"/>'
    '<axis xyz="0 0 1"/><limit lower="-5" upper="5" effort="1e6" velocity="100"/></joint>'
    '<link name="load"><inertial><mass value="60"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
)
EFFICIENCY, NUMBER, AT_MOTOR = "changes.drives.d.efficiency", "drive.d.torque @ start", 60.0 * 9.81 / 80.0
"""A load held behind a gear of 80 takes ``AT_MOTOR / efficiency``."""


def hoist(folder: Path, own: str, more: str = "") -> Path:
    (folder / "hoist.urdf").write_text(HOIST)
    (folder / "hoist.yaml").write_text(
        f"pinarm: 1\nmechanism: hoist.urdf\nchanges: {{drives: {{d: {{joint: z, ratio: 80, efficiency: {own}}}}}}}\n"
        f"problem: {{kind: statics, hold: {{z: 0 m}}}}\noutputs: [drive.d.torque]\n{more}"
    )
    return folder / "hoist.yaml"


@pytest.mark.parametrize("text", ["0.4", "40 %"])
def test_a_number_without_unit_is_read_alike_wherever_it_is_varied(tmp_path: Path, text: str) -> None:
    exact = AT_MOTOR / 0.4
    assert pinarm.run(hoist(tmp_path, text)).number(NUMBER)[0] == pytest.approx(exact)
    assert pinarm.run(hoist(tmp_path, "0.7"), {EFFICIENCY: text}).number(NUMBER)[0] == pytest.approx(exact)
    assert pinarm.run(hoist(tmp_path, "0.7"), [f"{EFFICIENCY}={text}"]).number(NUMBER)[0] == pytest.approx(exact)
    swept = pinarm.sweep(hoist(tmp_path, "0.7"), {EFFICIENCY: text}, results=[NUMBER], workers=1)
    assert swept[NUMBER].values == pytest.approx([exact])
    sought = f"find: {{for: {{{EFFICIENCY}: {text}}}, so_that: {{{NUMBER}: 14 N*m}}}}\n"
    found = pinarm.run(hoist(tmp_path, "0.7", sought)).figures
    (value,) = [number for name, number in found.items() if name.startswith(EFFICIENCY)]
    assert value / (100.0 if "%" in text else 1.0) == pytest.approx(AT_MOTOR / 14.0, rel=1e-6)


@pytest.mark.parametrize(
    ("path", "near"),
    [
        ("mechanism.arguments.m_A", "arguments.m_A"), ("problem.hold.phii", "problem.hold.phi"),
        ("m_A", "such as arguments.m_A"),
    ],
)  # fmt: skip
def test_a_path_that_leads_nowhere_is_refused_by_validation_and_run_alike(tmp_path, path, near):
    file = tmp_path / "arm.yaml"
    shutil.copytree(ROOT / "models" / "gen411_arm", tmp_path / "gen411_arm")
    given = {"unknown": f"{path}: 10 deg", "wanted": "C_B: 1 N*m", "phi": "0 deg", "arguments": "{m_A: 1 kg}"}
    file.write_text(ARM.format(models=".", **given))
    said = []
    for refused in (pinarm.validate, pinarm.run):
        with pytest.raises(PinarmError) as caught:
            refused(file)
        said.append(str(caught.value))
    assert said[0] == said[1]
    assert re.search(rf"arm\.yaml:7:\d+: {path}: ", said[0])
    assert near in said[0]
