"""Names of the parts of a tree: links, frames and joints of the file, and those that are made for its joints."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinarm.errors import ModelError
from pinarm.mechanics.loading.model_tree import from_z
from pinarm.mechanics.loading.pinocchio_model import build_model

MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
SDF_MASS = "<inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>"


def urdf(*joints, extra=""):
    """Return a robot of links with mass: joints as name, type, parent and child."""
    links = {link: MASS for _, _, parent, child in joints for link in (parent, child)} | {joints[0][2]: ""}
    told = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/></joint>'
        for name, kind, parent, child in joints
    )
    bodies = "".join(f'<link name="{name}">{inside}</link>' for name, inside in links.items())
    return f'<robot name="r">{bodies}{told}{extra}</robot>'


def sdf(*joints):
    """Return a model of links with mass, likewise."""
    links = dict.fromkeys(link for _, _, *ends in joints for link in ends if link != "world")
    told = "".join(
        f'<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>'
        "<axis><xyz>0 0 1</xyz></axis><axis2><xyz>1 0 0</xyz></axis2></joint>"
        for name, kind, parent, child in joints
    )
    bodies = "".join(f'<link name="{name}">{SDF_MASS}</link>' for name in links)
    return f'<sdf version="1.9"><model name="m">{bodies}{told}</model></sdf>'


def mjcf(*bodies):
    return f"<mujoco><worldbody>{''.join(bodies)}</worldbody></mujoco>"


def body(name, *joints, inside=""):
    return f'<body name="{name}">{"".join(joints)}<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{inside}</body>'


LOOP = '<loop name="L" type="spherical"><predecessor link="a"/><successor link="c"/></loop>'

CLASHES = {
    "a link and a frame of the loop joint g": (
        sdf(("j", "revolute", "world", "a"), ("k", "revolute", "a", "g_2"), ("g", "revolute", "world", "g_2")),
        "g_2", "g",
    ),

    "a link and a slide of the floating joint f": (
        urdf(("f", "floating", "a", "b"), ("k", "continuous", "b", "f/x")), "f/x", "f",
    ),

    "a fixed joint and that of a frame of the loop L": (
        urdf(("j", "continuous", "a", "b"), ("k", "continuous", "b", "c"), ("L_1_fixed", "fixed", "b", "d"),
             extra=LOOP),
        "L_1_fixed", "L",
    ),
    "a body and what is between the joints j and k": (
        mjcf(body("b", '<joint name="j"/>', '<joint name="k" axis="1 0 0"/>', inside=body("b/j", '<joint name="z"/>'))),
        "b/j", "j",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CLASHES)
def test_a_name_that_a_part_of_a_joint_has_is_refused(case):
    """Otherwise the mass of a link counts twice, or it hangs where that part is."""
    text, name, joint = CLASHES[case]
    with pytest.raises(ModelError, match=rf"have the name '{name}': .*a part of '{joint}'") as caught:
        build_model(text)
    assert caught.value.hint == "rename one of them"


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("off", [1.0, 1e-6, 1e-12])
def test_the_least_turn_from_z_is_a_turn_beside_its_opposite_too(off, side):
    """With 1e-6, a printed digit, the matrix was off by 8e-4, with 1e-7 by 9 %; held to SciPy's rotation vectors."""
    across = np.array([0.6, 0.8])
    angle = np.arctan2(off, side)
    expected = Rotation.from_rotvec(angle * np.array([-across[1], across[0], 0.0])).as_matrix()
    assert from_z(expected[:, 2]) == pytest.approx(expected, abs=1e-15 + 4e-16 / off)
