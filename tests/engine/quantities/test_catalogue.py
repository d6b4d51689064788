"""The list of what can be asked: whole, with units, and honest about what is refused."""

from pathlib import Path

import pytest
from quantities_page import PAGE, page

import pinarm
from pinarm.engine.kinematics.assembly import generic_near
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.families import FAMILIES
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.input.units import unit

pytestmark = pytest.mark.house

ROOT = Path(__file__).parents[3]
ARM = ROOT / "scenarios" / "gen411_arm_static.yaml"
MODELS = ["gen411_arm", "crank_rocker", "differential_screw"]


def test_what_it_lists_is_what_can_be_asked():
    scenario = pinarm.load(ARM)
    known, listed = scenario.quantities(), pinarm.quantities(ARM)
    names = {name for entry in listed for name in entry.names}
    assert names == set(known)
    units = {entry.name: entry.unit for entry in listed}
    assert units["C_B"] == units["joint.B.effort"] == "N*m"
    assert units["m_A"] == "kg"


@pytest.mark.parametrize("model", MODELS)
def test_every_quantity_has_a_meaning_and_a_unit_or_a_refusal(model: str):
    mechanism = pinarm.Mechanism.load(ROOT / "models" / model / "mechanism.yaml")
    listed = mechanism.quantities()
    assert len(listed) > 50
    assert all(entry.meaning for entry in listed)
    assert all(entry.unit or entry.refused for entry in listed)
    assert {entry.name.partition(".")[0] for entry in listed} >= FAMILIES.keys() - {
        "loop",
        "coupling",
        "drive",
        "force",
    }


def test_a_refusal_is_that_of_the_quantity_itself():
    panda = pinarm.Mechanism.load("panda")
    refused = {entry.name: entry.refused for entry in panda.quantities("finger_joint1.force")}
    assert "panda_finger_joint2 mimics panda_finger_joint1" in refused["joint.panda_finger_joint1.force"]
    moving = ROOT / "scenarios" / "manipulator_kinematics.yaml"
    efforts = [entry for entry in pinarm.quantities(moving) if entry.name.endswith(".effort")]
    for effort in efforts:
        with pytest.raises(InputError) as error:
            pinarm.load(moving).quantities()[effort.name]
        assert error.value.message == f"'{effort.name}': {effort.refused}"
        assert not effort.unit
    assert efforts


def test_the_page_is_that_of_the_program():
    assert PAGE.read_text(encoding="utf-8") == page(), "write it anew: python docs/quantities_page.py"


@pytest.mark.parametrize("model", ["crank_rocker", "differential_screw", "brick_floating"])
def test_vectors_can_be_asked_in_the_frames_that_are_said(model: str, tmp_path: Path):
    if model == "brick_floating":
        (tmp_path / "brick.urdf").write_text(BRICK)
        mechanism = pinarm.Mechanism.load(tmp_path / "brick.urdf", values={"base": "floating"})
    else:
        mechanism = pinarm.Mechanism.load(ROOT / "models" / model / "mechanism.yaml")
    row = Trajectory.schema_row(mechanism, generic_near(mechanism, mechanism.start), "t", unit("s"), mechanism.closure)
    known = Quantities(row)
    listed = {entry.meaning: entry for entry in mechanism.quantities() if entry.components}.values()
    assert all(bool(entry.components) == bool(entry.frame) for entry in mechanism.quantities())
    [link, *_] = [name.split(".")[1] for name in known.names() if name.startswith("point.")]
    for entry in listed:
        for way in (".along", ".about"):
            there = True
            try:
                known[f"{entry.name}{way}.{link}.z"]
            except InputError as error:  # also of a component that rigid bodies do not determine
                there = not error.message.startswith("there is no quantity")
            said = f"{way}.LINK" in entry.frame
            assert said == there or (way == ".about" and not entry.name.endswith((".moment", ".angular"))), (entry, way)


BRICK = """<robot name="brick"><link name="b"><inertial><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
