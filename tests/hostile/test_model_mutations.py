"""Junk in a model, a message out: whatever is done to valid XML, only errors of pinarm come out."""

from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from random import Random
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from pinarm.errors import InputError, PinarmError
from pinarm.use.mechanism import Mechanism

URDF = """\
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -1" rpy="0.1 0 0"/><mass value="2"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="1 1 1"/></geometry></visual></link>
  <link name="lower"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="slide"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tip"/>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <dynamics damping="0.1" friction="0"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -1" rpy="0 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="10" velocity="10"/><mimic joint="shoulder"/></joint>
  <joint name="rail" type="prismatic"><parent link="lower"/><child link="slide"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="10"/></joint>
  <joint name="end" type="fixed"><parent link="slide"/><child link="tip"/><origin xyz="0 0 -1"/></joint>
</robot>
"""
XACRO = """\
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="m" default="2"/>
  <xacro:property name="l" value="${2*0.5}"/>
  <xacro:macro name="rod" params="name mass *place">
    <link name="${name}"><inertial><xacro:insert_block name="place"/><mass value="${mass}"/>
      <inertia ixx="${mass*l**2/12}" iyy="${mass*l**2/12}" izz="${mass*l**2/12}" ixy="0" ixz="0" iyz="0"/>
    </inertial></link>
  </xacro:macro>
  <link name="base"/>
  <xacro:rod name="upper" mass="$(arg m)"><origin xyz="0 0 ${-l/2}"/></xacro:rod>
  <xacro:if value="${l > 0.5}"><xacro:rod name="lower" mass="1"><origin xyz="0 0 0"/></xacro:rod></xacro:if>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0 0 ${-l}"/>
    <axis xyz="0 1 0"/></joint>
</robot>
"""
MODELS = {"arm.urdf": URDF, "arm.urdf.xacro": XACRO}
JUNK = [
    "", " ", "0", "1", "-1", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e999", "0 0 0", "1 0 0", "1 2",
    "1 2 3 4", "nan 0 0", "inf 0 0", "1e308 1e308 1e308", "x", "base", "upper", "shoulder", "elbow", "fixed",
    "floating",
    "planar", "spherical", "revolute", "continuous", "prismatic", "true", "é\U0001f600", "$\\foo{", "[/]", "<", "&",
    "\x1b[2J", "a" * 3000, "../../etc/passwd", "file:///dev/zero", "package://x/y", "${1/0}", "${l}", "$(arg m)",
    "${m}",
    "9" * 400, "1_000", "0x10", "1,5", "١",
]  # fmt: skip
NAMES = ["link", "joint", "inertial", "mass", "inertia", "origin", "axis", "limit", "mimic", "parent", "child", "robot",
         "dynamics", "xacro:if", "xacro:include", "x", "transmission", "mujoco"]  # fmt: skip
KEYS = ["name", "type", "value", "xyz", "rpy", "link", "joint", "lower", "upper", "ixx", "multiplier", "filename"]


def mutate(root: ElementTree.Element, chance: Random) -> None:
    """Change one place of a tree."""
    parents = {child: parent for parent in root.iter() for child in parent}
    one, other = (chance.choice(list(parents)) for _ in range(2)) if parents else (root, root)
    what = chance.choice(
        ["value", "value", "value", "value", "drop", "rename key", "remove", "copy", "rename", "text", "add"]
    )
    keys = list(one.attrib)
    if what == "value" and keys:
        one.set(chance.choice(keys), chance.choice(JUNK))
    elif what == "drop" and keys:
        del one.attrib[chance.choice(keys)]
    elif what == "rename key" and keys:
        one.set(chance.choice(KEYS), one.attrib.pop(chance.choice(keys)))
    elif what == "remove" and one in parents:
        parents[one].remove(one)
    elif what == "copy":
        chance.choice([root, other]).append(deepcopy(one))
    elif what == "rename":
        one.tag = chance.choice(NAMES)
    elif what == "text":
        one.text = chance.choice(JUNK)
    elif what == "add":
        ElementTree.SubElement(one, chance.choice(NAMES), {chance.choice(KEYS): chance.choice(JUNK)})


def spoiled(text: str, chance: Random) -> bytes:
    """Return the text with parts of its tree changed, and sometimes its bytes."""
    ElementTree.register_namespace("xacro", "http://www.ros.org/wiki/xacro")
    root = ElementTree.fromstring(text)
    for _ in range(chance.choice([1, 1, 2, 3])):
        mutate(root, chance)
    raw = bytearray(ElementTree.tostring(root, encoding="utf-8"))
    what = chance.choice(["whole", "whole", "whole", "whole", "cut", "flip", "swap"])
    place = chance.randrange(len(raw))
    if what == "cut":
        del raw[place:]
    elif what == "flip":
        raw[place] ^= 1 << chance.randrange(8)
    elif what == "swap":
        raw[place : place + 20] = raw[place : place + 20][::-1]
    return bytes(raw)


def use(path: Path) -> None:
    """Load a model and ask it for what there is."""
    mechanism = Mechanism.load(path)
    q = mechanism.configurations({name: [0.0, 0.3] for name in mechanism.joints})
    with np.errstate(all="ignore"):
        asked = mechanism.at(q, np.full((2, mechanism.model.nv), 0.2))
        for name in asked.names():
            with suppress(InputError):  # reactions that a mimic leaves open are refused in words
                _ = asked[name]


@pytest.mark.parametrize("name", MODELS)
@settings(
    max_examples=25, deadline=None, derandomize=True, database=None,
    phases=[Phase.explicit, Phase.generate],  # shrinking would take longer than the test
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)  # fmt: skip
@given(seed=st.integers(0, 2**32))
def test_only_errors_of_pinarm_come_out(tmp_path: Path, name: str, seed: int) -> None:
    path = tmp_path / name
    path.write_bytes(spoiled(MODELS[name], Random(seed)))
    try:
        use(path)
    except PinarmError as error:
        assert str(error)


@pytest.mark.parametrize("name", MODELS)
def test_what_is_mutated_is_valid(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(MODELS[name])
    use(tmp_path / name)


def test_some_mutants_live_and_some_do_not(tmp_path: Path) -> None:
    """Otherwise the test above would look at one kind of answer only."""

    def lives(seed: int, kind: Callable[[str, Random], bytes] = spoiled) -> bool:
        (tmp_path / "arm.urdf").write_bytes(kind(URDF, Random(seed)))
        try:
            use(tmp_path / "arm.urdf")
        except PinarmError:
            return False
        return True

    found = [lives(seed) for seed in range(40)]
    assert 5 < sum(found) < 35
