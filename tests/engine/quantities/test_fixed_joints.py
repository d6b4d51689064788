"""Wrenches through fixed joints, against the same joint as a hinge that a law holds at 0."""

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError

INERTIA = '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.002" ixz="-0.001" iyz="0.003"/>'
LINK = (
    '<link name="{0}"><inertial><origin xyz="{2}" rpy="0.1 0.2 0.3"/><mass value="{1}"/>'
    + INERTIA
    + "</inertial></link>"
)
JOINT = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><origin xyz="{4}" rpy="{5}"/>'
MOVES = '<axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="1000" velocity="100"/></joint>'
FIXED = ["foot", "flange", "sensor"]


def robot(kind):
    """A base on the ground, two moving links, and a flange with a tool and a wrist beyond it; three fixed joints."""
    links = [("base", 9, "0 0 0.1"), ("upper", 3, "0.2 0 0"), ("adapter", 0.5, "0.05 0.02 0"),
             ("hand", 2, "0.1 0 0.05"), ("tool", 1.5, "0 0.1 0.2"), ("wrist", 0.8, "0.1 0.05 0")]  # fmt: skip
    joints = [("foot", kind, "world", "base", "0 0 0.3", "0 0 0"),
              ("A", "revolute", "base", "upper", "0 0 0.2", "0.3 0 0"),
              ("flange", kind, "upper", "adapter", "0.4 0 0", "0.2 0.5 0"),
              ("sensor", kind, "adapter", "hand", "0.1 0 0.05", "0 0.3 0.4"),
              ("grip", "fixed", "hand", "tool", "0.2 0 0", "0 0 0.5"),
              ("B", "revolute", "hand", "wrist", "0.1 0.1 0", "0 0.4 0")]  # fmt: skip
    parts = [LINK.format(*link) for link in links] + [JOINT.format(*joint) + MOVES for joint in joints]
    return f'<robot name="r"><link name="world"/>{"".join(parts)}</robot>'


def solved(mechanism, kind, outputs, **keys):
    description = {"points": {"nose": {"link": "tool", "at": ["0 m", "0.2 m", "0.1 m"]}}}
    arm = mechanism(robot(kind), payloads={"bit": {"point": "nose", "mass": "0.7 kg"}}, **description)
    motion = {
        name: {"law": "harmonic", "amplitude": f"{size} rad", "pulsation": f"{rate} rad/s", "phase": "0.4 rad"}
        for name, size, rate in (("A", 0.7, 3.0), ("B", 0.9, 5.0))
    }
    if kind == "revolute":
        motion |= {name: {"law": "constant", "value": "0 rad"} for name in FIXED}
    problem = {"kind": "inverse", "time": {"end": "1 s", "samples": 11}, "motion": motion, **keys}
    return pinarm.run({"pinarm": 1, "mechanism": arm, "problem": problem, "outputs": outputs})


PUSH = {"kind": "wrench", "point": "nose", "force": ["5 N", "-3 N", "8 N"], "moment": ["1 N*m", "0 N*m", "2 N*m"]}


@pytest.mark.parametrize("loads", [{}, {"push": PUSH}, {"push": {**PUSH, "point": "upper"}}])
def test_a_fixed_joint_carries_what_a_hinge_does_that_a_law_holds(mechanism, loads):
    outputs = [f"joint.{name}.{part}.{axis}" for name in FIXED for part in ("force", "moment") for axis in "xyz"]
    fixed, held = (solved(mechanism, kind, outputs, loads=loads) for kind in ("fixed", "revolute"))
    for name in outputs:
        assert fixed[name].values == pytest.approx(held[name].values, abs=1e-10), name
    assert np.abs(fixed["joint.sensor.moment.y"].values).max() > 1.0


def test_a_load_on_both_sides_is_refused(mechanism):
    """A strut from the link before the flange to the tool: part of what the flange carries, inside one body."""
    strut = {"kind": "point_spring", "between": ["upper", "nose"], "stiffness": "100 N/m"}
    with pytest.raises(InputError, match="'flange' is not known: the force 'strut' acts on links on both sides"):
        solved(mechanism, "fixed", ["joint.flange.force.x"], loads={"strut": strut})
    assert solved(mechanism, "fixed", ["joint.foot.force.x"], loads={"strut": strut}).number("joint.foot.force.z @ max")
