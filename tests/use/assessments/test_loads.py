"""Loads of joints as they are asked, told and saved."""

import pytest

import pinarm
from pinarm.errors import InputError

ROTOR = "scenarios/rotor_vertical.yaml"


@pytest.mark.parametrize(("loads", "said"), [
    ({}, "nothing is asked"),
    ({"joints": {"C": {}}}, "there is no joint 'C'"),
    ({"joints": {"B": {"bearing": {"C": "20 kN"}}}}, "no coordinate turns"),
    ({"joints": {"B": {"coordinate": "chi", "bearing": {"C": "20 kN"}}}}, "no coordinate 'chi' that turns"),
    ({"joints": {"phi": {"bearing": {"C": "20 mm"}}}}, "20 mm"),
])  # fmt: skip
def test_mistakes_are_told_before_anything_is_solved(loads, said) -> None:
    with pytest.raises(InputError, match=said):
        pinarm.validate(ROTOR, {"loads": loads})


def test_a_joint_that_slides_has_no_rolling_bearing() -> None:
    loads = {"joints": {"x": {"bearing": {"C": "20 kN"}}}}
    with pytest.raises(InputError, match="no coordinate turns about an axis of the joint 'x'"):
        pinarm.validate("scenarios/slider_crank_gas.yaml", {"loads": loads})


def test_a_name_of_two_joints_is_asked_back() -> None:
    second = {"loops": {"A": {"kind": "revolute", "between": ["B3", "B4"], "axis": "z"}}}
    values = {"changes": second, "outputs": ["theta2"], "loads": {"joints": {"A": {}}}}
    with pytest.raises(InputError, match="'A' is a joint of the tree and a loop joint"):
        pinarm.validate("scenarios/crank_rocker_turning.yaml", values)


def test_without_forces_there_are_no_loads() -> None:
    with pytest.raises(InputError, match="kind: inverse"):
        _ = pinarm.run("scenarios/manipulator_kinematics.yaml", {"loads": {"joints": {"D": {}}}}).sections
