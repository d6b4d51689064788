"""What files say of forces at joints: units against the joint, and what no spring, friction or motor can be."""

import pytest

from pinarm.errors import UnitError
from pinarm.input.units import unit
from pinarm.input.yaml.schema import Measured
from pinarm.mechanics.forces.along_coordinate import JointSpring, RegularisedFriction
from pinarm.mechanics.forces.points import PointSpring


def measured(value, text):
    number = Measured(value)
    number.unit = unit(text)
    return number


UNITS = {
    "turn": {"stiffness": "N*m/rad", "damping": "N*m*s/rad", "rest": "deg"},
    "slide": {"stiffness": "N/mm", "damping": "N*s/m", "rest": "mm"},
}


@pytest.mark.parametrize("field", ["stiffness", "damping", "rest"])
@pytest.mark.parametrize(("joint", "other"), [("turn", "slide"), ("slide", "turn")])
def test_springs_check_their_units_against_the_joint(model, joints, joint, other, field):
    JointSpring(joint=joint, **{field: measured(1.0, UNITS[joint][field])}).bind(model, joints)
    with pytest.raises(UnitError, match="not a unit of this quantity"):
        JointSpring(joint=joint, **{field: measured(1.0, UNITS[other][field])}).bind(model, joints)


@pytest.mark.parametrize(("kind", "given"), [
    (JointSpring, {"joint": "turn", "stiffness": -1.0}), (JointSpring, {"joint": "turn", "damping": -1.0}),
    (PointSpring, {"between": ("a", "b"), "stiffness": -1.0}), (PointSpring, {"between": ("a", "b"), "damping": -1.0}),
    (RegularisedFriction, {"joint": "turn", "friction": -1.0}),
    (RegularisedFriction, {"joint": "turn", "friction": 1.0, "creep": 0.0}),
])  # fmt: skip
def test_what_would_give_energy_away_is_refused(kind, given):
    with pytest.raises(ValueError, match="out of bounds"):
        kind(**given)
