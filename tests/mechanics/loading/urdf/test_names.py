"""Names in URDF files: a misprint is told with its line and what it may mean, an extension is listed as not read."""

from collections.abc import Callable

import pytest

from pinarm.errors import ModelError
from pinarm.use.mechanism import Mechanism

ARM = """\
<robot name="r">
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0 0 -1"/><mass value="2"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j" type="revolute"><parent link="base"/><child link="arm"/>
    <origin xyz="1 0 0"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="0" velocity="0"/>
    <dynamics damping="0.1"/></joint>
</robot>
"""

MISPRINTS = [
    ('<origin xyz="1', '<orign xyz="1', 6, "<joint> 'j' contains no <orign>", "origin"),
    ('origin xyz="1', 'origin xzy="1', 6, "<origin> in <joint> 'j' has no attribute 'xzy'", "xyz"),
    ("damping", "dampng", 9, "<dynamics> in <joint> 'j' has no attribute 'dampng'", "damping"),
    ("<link name='b", "<lnik name='b", 2, "<robot> 'r' contains no <lnik>", "link"),
]


@pytest.mark.parametrize(("right", "wrong", "line", "says", "hint"), MISPRINTS)
def test_a_misprint_is_told(
    mechanism: Callable[..., Mechanism], right: str, wrong: str, line: int, says: str, hint: str
) -> None:
    text = ARM.replace('<link name="base"/>', "<link name='base'/>")
    assert right in text
    with pytest.raises(ModelError) as caught:
        mechanism(text.replace(right, wrong).replace("</masss", "</mass"))
    assert says in caught.value.message
    assert caught.value.hint == hint
    assert caught.value.location is not None
    assert caught.value.location.line == line


@pytest.mark.parametrize(
    ("element", "owner"),
    [('<axis xyz="0 1 0"/>', "joint 'j'"), ('<mass value="2"/>', "<inertial> in <link> 'arm'")],
)  # fmt: skip
def test_what_stands_twice_is_refused(mechanism: Callable[..., Mechanism], element: str, owner: str) -> None:
    with pytest.raises(ModelError, match=rf"{owner}: it has 2 <{element[1:5].strip()}"):
        mechanism(ARM.replace(element, 2 * element))


def test_extensions_of_others_are_listed_as_not_read(mechanism: Callable[..., Mechanism]) -> None:
    others = (
        '<transmission name="t"><type>x</type></transmission><gazebo/><gazebo reference="arm"/>'
        '<ros2_control name="c" type="system"/><drake_acceleration/><d:joint xmlns:d="http://drake"/>'
    )
    notes = mechanism(ARM.replace("</robot>", others + "</robot>")).notes
    listed = "not read: <d:joint>, <drake_acceleration>, <gazebo> (2), <ros2_control>, <transmission>"
    assert [note for note in notes if note.startswith("not read")] == [listed]


def test_names_with_a_prefix_are_of_others_declared_or_not(mechanism: Callable[..., Mechanism], tmp_path) -> None:
    """As urdfdom takes them; a saved result is read again."""
    text = ARM.replace("</robot>", "<drake:linear_bushing_rpy/></robot>").replace("<link name", '<link d:x="1" name')
    bushed = mechanism(text.replace("<inertial>", '<inertial xmlns="x">'))
    assert "not read: <drake:linear_bushing_rpy>" in bushed.notes
    assert bushed.model.inertias[1].mass == 2.0


def test_what_is_in_known_elements_and_has_no_meaning_is_listed(mechanism: Callable[..., Mechanism]) -> None:
    """Stray names at every level, moments below the diagonal, axes of joints that have none."""
    text = ARM.replace("<mass ", "<density/><mass unit='kg' ").replace('iyz="0"', 'iyz="0" iyx="0" izx="0.0" izy="0"')
    free = (
        '<link name="f"/><joint name="w" type="fixed"><parent link="arm"/><child link="f"/><axis xyz="0 0 0"/></joint>'
    )
    notes = mechanism(text.replace("</robot>", free + "</robot>")).notes
    assert "not read: <density>, unit of <mass>" in notes
    with pytest.raises(ModelError, match="link 'arm': iyx is not ixy"):
        mechanism(text.replace('iyx="0"', 'iyx="1"'))
