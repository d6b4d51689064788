"""Extensions of URDF that close loops: the same parallelogram in each of them, whose angles are known.

Crank and rocker, 1 m long, stand on y in the drawing, 0.8 m apart; the coupler lies along x. Wherever the crank is, the
rocker has the same angle, and the coupler turns back by it. Static efforts follow from weights and their heights.
"""

import numpy as np
import pytest

import pinarm
from pinarm.errors import ModelError
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.use.mechanism import Mechanism

INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'


def link(name, at="0 0.5 0", mass=2.0):
    return f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/>{INERTIA}</inertial></link>'


def joint(name, parent, child, xyz="0 0 0", kind="continuous", axis="0 0 1", attributes=""):
    return (
        f'<joint name="{name}" type="{kind}" {attributes}><origin xyz="{xyz}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/></joint>'
    )


OPEN = (
    '<link name="ground"/>' + link("crank") + link("rocker") + link("coupler", "0.4 0 0", 3.0)
    + joint("A", "ground", "crank", attributes='independent="true"') + joint("B", "crank", "coupler", "0 1 0")
    + joint("C", "ground", "rocker", "0.8 0 0")
)  # fmt: skip
PLUS = (
    '<loop name="D" type="revolute"><predecessor link="coupler"><origin xyz="0.8 0 0"/></predecessor>'
    '<successor link="rocker"><origin xyz="0 1 0"/></successor><axis xyz="0 0 1"/></loop>'
)
CLOSED = {
    "URDF+": PLUS,
    "URDF+ as an exporter misspells it": PLUS.replace("link=", "name=").replace("successor", "sucessor"),
    "Isaac Sim": '<loop_joint name="D" type="continuous"><link1 link="coupler" xyz="0.8 0 0" rpy="0 0 0"/>'
    '<link2 link="rocker" xyz="0 1 0" rpy="0 0 0"/><axis xyz="0 0 1"/></loop_joint>',
    "Isaac Sim's example, with two link1": '<loop_joint name="D" type="spherical">'
    '<link1 link="coupler" xyz="0.8 0 0" rpy="0 0 0"/><link1 link="rocker" xyz="0 1 0" rpy="0 0 0"/></loop_joint>',
    "Gazebo": '<gazebo><joint name="D" type="revolute"><parent>rocker</parent><child>coupler</child>'
    "<pose>0.8 0 0 0 0 0</pose><axis><xyz>0 0 1</xyz><dynamics><damping>0.1</damping></dynamics></axis></joint>"
    '<plugin name="p" filename="f"/></gazebo><gazebo reference="crank"><mu1>0.2</mu1></gazebo>',
}


def solved(tmp_path, text):
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "m.urdf").write_text(f'<robot name="m">{text}</robot>')
    (tmp_path / "m.yaml").write_text("pinarm: 1\nrobot: m.urdf\ngravity: {direction: -y}\n")
    over = {"A": {"from": "-40 deg", "to": "50 deg", "samples": 7}}
    data = {"pinarm": 1, "mechanism": Mechanism.load(tmp_path / "m.yaml")}
    return pinarm.run({**data, "problem": {"kind": "statics", "over": over, "drives": ["A"]},
                       "outputs": ["joint.A.effort", "B", "C"]})  # fmt: skip


@pytest.mark.parametrize("name", CLOSED)
def test_a_parallelogram_of_each_extension(tmp_path, name):
    run = solved(tmp_path, OPEN + CLOSED[name])
    angle = np.deg2rad(np.linspace(-40, 50, 7))
    assert run["C"].values == pytest.approx(angle, abs=1e-12)
    assert run["B"].values == pytest.approx(-angle, abs=1e-12)
    weight = 2 * 2.0 * 0.5 + 3.0  # heights of crank and rocker grow half as fast as that of the coupler
    assert run["joint.A.effort"].values == pytest.approx(-weight * 9.81 * np.sin(angle), abs=1e-10)
    assert any("closing loops of the tree of joints: D" in note for note in run.notes())


def test_a_coupling_holds_sums_of_joints_from_where_the_ways_part(tmp_path):
    """Its reference parser: +ratio for the joints to the predecessor, -1 for those to the successor."""
    tail = link("tail") + joint("T", "coupler", "tail", "0.8 0 0")
    coupling = '<coupling name="K"><predecessor link="rocker"/><successor link="tail"/><ratio value="2"/></coupling>'
    text = f'<robot name="m">{OPEN}{tail}{coupling}</robot>'
    robot = build_model(text)
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "m.urdf").write_text(text)
    assert robot.tree.couplings["K"].weights == {"T": 1.0, "B": 1.0, "A": 1.0, "C": -2.0}
    [row] = [one for one in Mechanism.load(tmp_path / "m.urdf").constraints if one.name == "K"]
    q = dict(zip(robot.model.names[1:], (0.1, 0.2, 0.3, 0.35), strict=True))
    weights = dict(zip(robot.model.names[1:], row.coordinate.weights, strict=True))
    assert sum(weights[name] * q[name] for name in q) == pytest.approx(q["A"] + q["B"] + q["T"] - 2 * q["C"])


@pytest.mark.parametrize(("text", "message"), [
    (PLUS.replace('name="D"', 'name="A"'), "two joints have the name 'A'"),
    (PLUS.replace('"rocker"', '"roker"'), "its link 'roker' does not exist"),
    (PLUS + '<link name="D_1"/>' + joint("f", "rocker", "D_1", kind="fixed"),
     "have the name 'D_1': what joint 'f' carries, and a part of 'D'"),
    (CLOSED["Gazebo"].replace("revolute", "weld"), "a joint of type 'weld' is not read"),
    ('<coupling name="K"><predecessor link="crank"/><successor link="rocker"/><ratio value="0"/></coupling>',
     "it couples no two joints"),
])  # fmt: skip
def test_mistakes_are_told(text, message):
    with pytest.raises(ModelError, match=message):
        build_model(f'<robot name="m">{OPEN}{text}</robot>')


def test_a_link_with_two_parents_is_told_how_loops_are_said():
    with pytest.raises(ModelError, match="carried by two joints") as caught:
        build_model(f'<robot name="m">{OPEN}{joint("D", "rocker", "coupler")}</robot>')
    assert "<loop>" in str(caught.value)
