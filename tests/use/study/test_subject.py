"""Scenarios and mechanisms that are given as such, as data, and as files: the same answers, and mistakes in words."""

from pathlib import Path

import pytest

import pinarm
from pinarm.errors import InputError

ROOT = Path(pinarm.__file__).parents[1]
ROD = {
    "pinarm": 1,
    "planar": {
        "points": {"O": [0, 0], "A": ["250 mm", 0]},
        "ground": ["O"],
        "links": {"rod": {"points": ["O", "A"], "mass": "1 kg"}},
    },
}
HELD = {"pinarm": 1, "mechanism": ROD, "problem": {"kind": "statics", "hold": {"O": "0 deg"}}, "outputs": ["O"]}


@pytest.mark.parametrize("about", [pinarm.quantities, pinarm.explain])
def test_scenarios_and_mechanisms_in_every_form(about):
    arm = ROOT / "models" / "gen411_arm" / "mechanism.yaml"
    static = ROOT / "scenarios" / "gen411_arm_static.yaml"
    assert str(about(pinarm.Mechanism.load(arm))) == str(about(arm)) == str(about(str(arm)))
    assert str(about(pinarm.load(static))) == str(about(static))
    assert str(about(pinarm.load(static), {"arguments.m_A": "0.2 kg"})) == str(about(static, ["arguments.m_A=0.2 kg"]))
    assert "joint.O.effort" in {entry.name for entry in pinarm.quantities(HELD)}
    assert pinarm.explain(ROD).mobility.mobility == pinarm.explain(HELD).mobility.mobility == 1


@pytest.mark.parametrize("about", [pinarm.quantities, pinarm.explain])
def test_what_is_neither_is_told(about):
    with pytest.raises(InputError, match="a value of the type int is no scenario"):
        about(3)
    with pytest.raises(InputError, match="the mechanism is given as such, which other values do not change"):
        about(pinarm.Mechanism.load("panda"), {"gravity": "none"})


ARM = ROOT / "models" / "gen411_arm" / "mechanism.yaml"
SWING = ROOT / "scenarios" / "gen411_arm_swing.yaml"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pinarm.Mechanism.load(ARM).configurations([1.0]), "no map of positions"),
        (lambda: pinarm.Mechanism.load(ARM).jacobian(3, [0.0, 0.0]), "int is no name"),
        (lambda: pinarm.run(SWING, 3), "other values are given as '3'"),
        (lambda: pinarm.batch(SWING, 3), "3 is no map of position"),
        (lambda: pinarm.check(None), "NoneType is no scenario"),
        (lambda: pinarm.Mechanism.load({"robot": "panda"}), "dict is no path"),
        (lambda: pinarm.replay(3), "int is no path"),
        (lambda: pinarm.batch(SWING, {"O": [0.1]}).numbers(3), "int is no name"),
    ],
)
def test_what_has_another_type_is_told(call, message):
    with pytest.raises(InputError, match=message):
        call()
