"""Masses of meshes in MJCF: against closed forms and MuJoCo's own model, and files that are not to be read."""

import struct

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine import model_source
from pinarm.errors import InputError, ModelError
from pinarm.use.mechanism import Mechanism

mujoco = pytest.importorskip("mujoco")

CORNERS = np.array([[x, y, z] for x in (0.0, 0.2) for y in (0.0, 0.3) for z in (0.0, 0.5)])
FACES = ((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
         (1, 5, 7), (1, 7, 3))  # fmt: skip
MODEL = """<mujoco><compiler meshdir="parts" {compiler}/><asset><mesh name="block" file="block.stl" scale="1 2 1"/>
<texture name="t" type="2d" file="none.png"/><material name="grey" texture="t"/></asset>
<worldbody><body name="arm" pos="0 0 1"><joint name="j" axis="0 1 0"/>
<geom type="mesh" mesh="block" material="grey" pos="0.1 0 0" euler="0 0 30" {geom}/><geom type="sphere" size="0.1"/>
<camera name="c" mode="targetbody" target="plain"/><body name="plain" pos="0 0 0.4"><joint name="k"/>
<geom type="box" size="0.1 0.1 0.2"/></body></body></worldbody></mujoco>"""


def stl():
    """Return the box of 0.2 x 0.3 x 0.5 m with a corner at the origin as binary STL."""
    rows = [struct.pack("<12fH", 0, 0, 0, *CORNERS[[a, b, c]].ravel(), 0) for a, b, c in FACES]
    return b" " * 80 + struct.pack("<I", len(rows)) + b"".join(rows)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log where it runs
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "block.stl").write_bytes(stl())
    (tmp_path / "plain.xml").write_text(MODEL.format(compiler="", geom=""))
    return tmp_path


def inertias(mechanism):
    """Return mass, first moments and moments about the joint of both bodies."""
    model = mechanism.model
    return [model.inertias[model.getJointId(name)].toDynamicParameters() for name in "jk"]


def test_the_mass_of_a_mesh_is_that_of_its_solid(folder):
    """A block of 0.2 x 0.6 x 0.5 m of water, turned by 30 deg about z, and a sphere of radius 0.1 m."""
    arm, _ = inertias(Mechanism.load(folder / "plain.xml"))
    block, ball = 1000 * 0.2 * 0.6 * 0.5, 1000 * 4 / 3 * np.pi * 0.1**3
    assert arm[0] == pytest.approx(block + ball, rel=1e-6)  # coordinates of the STL have 24 bits
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    centre = np.array([0.1 + c * 0.1 - s * 0.3, s * 0.1 + c * 0.3, 0.25])
    assert arm[1:4] == pytest.approx(block * centre, rel=1e-6)
    # I_zz about the joint: the block's own, its centre's distance, and the ball's
    izz = block * ((0.2**2 + 0.6**2) / 12 + centre[0] ** 2 + centre[1] ** 2) + ball * 0.4 * 0.1**2
    assert arm[9] == pytest.approx(izz, rel=1e-6)


@pytest.mark.parametrize(("compiler", "geom"), [
    ("", 'density="700"'), ("", 'mass="3"'), ('settotalmass="5"', ""),
])  # fmt: skip
def test_bodies_are_those_of_mujoco(folder, compiler, geom):
    text = MODEL.format(compiler=compiler, geom=geom)
    (folder / "m.xml").write_text(text)
    bare = text.replace('<texture name="t" type="2d" file="none.png"/><material name="grey" texture="t"/>', "")
    theirs = mujoco.MjModel.from_xml_string(bare.replace(' material="grey"', "").replace('meshdir="parts"', ""),
                                            {"block.stl": stl()})  # fmt: skip
    mechanism = Mechanism.load(folder / "m.xml")
    for name, body in (("j", "arm"), ("k", "plain")):
        ours, index = mechanism.model.inertias[mechanism.model.getJointId(name)], theirs.body(body).id
        assert ours.mass == pytest.approx(theirs.body_mass[index], rel=1e-12)
        assert ours.lever == pytest.approx(theirs.body_ipos[index], abs=1e-12)
        assert np.linalg.eigvalsh(ours.inertia) == pytest.approx(np.sort(theirs.body_inertia[index]), rel=1e-9)


MESH = '<geom type="mesh" mesh="block" pos="0.1 0 0" euler="0 0 30"/>'
INERTIAL = '<inertial pos="0.1 0 0" mass="3" diaginertia="1 1 1"/>'


@pytest.mark.parametrize(
    ("compiler", "file", "inside"),
    [
        ('alignfree="true"', "block.stl", f"<freejoint/>{MESH}"),
        ("", "block.stl", f'<freejoint align="true"/>{MESH}'),
        ('inertiafromgeom="true"', "block.stl", f"<joint/>{MESH}"),
        ('inertiafromgeom="true"', "block.stl", f'<joint/>{INERTIAL}{MESH}<body pos="0 1 0"><joint/>{MESH}</body>'),
        ("", "block.stl", f'<joint/><frame pos="0 0 1">{INERTIAL}</frame>{MESH}<body><joint/>{MESH}</body>'),
        ('strippath="true"', "elsewhere/block.stl", f"<joint/>{MESH}"),
    ],
)
def test_centres_of_mass_are_those_of_mujoco(folder, compiler, file, inside):
    text = f"""<mujoco><compiler {compiler}/><asset><mesh name="block" file="{file}"/></asset><worldbody>
    <body pos="1 2 3" euler="20 30 40">{inside}</body></worldbody></mujoco>"""
    (folder / "block.stl").write_bytes(stl())
    (folder / "m.xml").write_text(text)
    theirs = mujoco.MjModel.from_xml_path("m.xml")
    data = mujoco.MjData(theirs)
    mujoco.mj_forward(theirs, data)
    model = Mechanism.load(folder / "m.xml").model
    assert pin.computeTotalMass(model) == pytest.approx(theirs.body_mass[1:].sum(), rel=1e-12)
    centre = pin.centerOfMass(model, model.createData(), pin.neutral(model))
    assert centre == pytest.approx(data.subtree_com[0], abs=1e-12)


def test_a_mesh_outside_of_the_root_is_not_read(folder):
    outside = (folder / "plain.xml").read_text().replace('file="block.stl"', 'file="../../x.stl"')
    (folder / "m.xml").write_text(outside)
    (folder.parent / "x.stl").write_bytes(stl())
    with pytest.raises(InputError, match="leads out of the root"):
        Mechanism.load(folder / "m.xml")


def test_without_mujoco_the_message_says_what_to_install(folder, monkeypatch):
    monkeypatch.setattr(model_source, "find_spec", lambda name: None)
    with pytest.raises(ModelError, match="the mass of a mesh is not computed here") as caught:
        Mechanism.load(folder / "plain.xml")
    assert "pip install 'pinarm[mjcf]'" in str(caught.value)
