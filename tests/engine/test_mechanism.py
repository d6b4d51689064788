from pathlib import Path

import numpy as np
import pytest

from pinarm.errors import InputError, ModelError, PinarmError
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[2] / "models"
ARM = MODELS / "gen411_arm" / "mechanism.yaml"


@pytest.mark.parametrize("value", ["2000 g", np.int64(2), np.array(2.0)])
def test_arguments_change_the_model(value):
    heavy, light = Mechanism.load(ARM, {"m_A": value}), Mechanism.load(ARM)
    assert heavy.arguments["m_A"] == pytest.approx(2.0, rel=1e-15)
    assert light.arguments["m_A"] == 0.1
    masses = [sum(body.mass for body in mechanism.model.inertias) for mechanism in (heavy, light)]
    assert masses[0] - masses[1] == pytest.approx(1.9, rel=1e-14)
    lever = heavy.inverse(*np.zeros((3, 2))) - light.inverse(*np.zeros((3, 2)))
    assert lever == pytest.approx([1.9 * 9.81 * 0.5, 1.9 * 9.81 * 0.25], rel=1e-13)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"m_C": 1.0}, "no argument 'm_C'"),
        ({"m_A": "2 m"}, "'m' is not a unit of this quantity"),
        ({"m_A": float("nan")}, "m_A: 'nan' is not a finite number"),
        ({"m_A": "-2 kg"}, "mass is negative"),
        ({"m_A": np.array([2.0])}, "m_A: this is not a quantity"),
    ],
)
def test_impossible_arguments_are_refused(arguments, message):
    with pytest.raises(PinarmError, match=message):
        Mechanism.load(ARM, arguments)


def test_a_unit_of_an_argument_that_the_model_lacks_is_refused_at_its_place(tmp_path):
    model = ARM.parent / "gen411_arm.urdf.xacro"
    (tmp_path / "arm.urdf.xacro").write_text(model.read_text())
    (tmp_path / "arm.yaml").write_text("pinarm: 1\nrobot: arm.urdf.xacro\narguments: {m_A: kg, m_AA: kg}\n")
    with pytest.raises(InputError, match=r"arm\.yaml:3:22: the model has no argument 'm_AA'") as caught:
        Mechanism.load(tmp_path / "arm.yaml")
    assert caught.value.hint == "m_A"


@pytest.mark.parametrize(("written", "right"), [("g", "kg"), ("rpm", "rad/s")])
def test_arguments_are_in_units_of_si(tmp_path, written, right):
    """A default of the model in millimetres would be 1000 times what the same text in a scenario gives."""
    (tmp_path / "arm.urdf.xacro").write_text((ARM.parent / "gen411_arm.urdf.xacro").read_text())
    (tmp_path / "arm.yaml").write_text(f"pinarm: 1\nrobot: arm.urdf.xacro\narguments: {{m_A: {written}}}\n")
    with pytest.raises(InputError, match=rf"arm\.yaml:3:18: .* and {written} is no unit of it") as caught:
        Mechanism.load(tmp_path / "arm.yaml")
    assert caught.value.expected == right


def test_a_mechanism_file_gives_arguments_values_that_a_scenario_may_replace(tmp_path):
    model = (ARM.parent / "gen411_arm.urdf.xacro").read_text()
    word = '<xacro:arg name="tip" default="x"/><link name="$(arg tip)end"/><joint name="f" type="fixed">'
    word += '<parent link="BA"/><child link="$(arg tip)end"/></joint></robot>'
    (tmp_path / "arm.urdf.xacro").write_text(model.replace("</robot>", word))
    text = "pinarm: 1\nrobot: arm.urdf.xacro\narguments: {m_A: 300 g, tip: right_, m_BA: kg}\n"
    (tmp_path / "arm.yaml").write_text(text)
    arm, other = (
        Mechanism.load(tmp_path / "arm.yaml"),
        Mechanism.load(tmp_path / "arm.yaml", {"m_A": "0.1 kg", "tip": "u"}),
    )
    assert (arm.arguments["m_A"], other.arguments["m_A"]) == (pytest.approx(0.3, rel=1e-15), 0.1)
    assert arm.model.existFrame("right_end") and other.model.existFrame("uend")
    assert arm.argument_units["m_A"] == arm.argument_units["m_BA"]
    (tmp_path / "arm.yaml").write_text(text.replace("m_A", "m_AA"))
    with pytest.raises(InputError, match=r"arm\.yaml:3:13: the model has no argument 'm_AA'"):
        Mechanism.load(tmp_path / "arm.yaml")


def test_an_unknown_robot_is_refused():
    with pytest.raises(ModelError, match="no robot 'pandaa'") as caught:
        Mechanism.load("pandaa")
    assert caught.value.hint == "panda"
