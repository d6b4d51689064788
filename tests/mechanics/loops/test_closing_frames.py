"""Frames that onshape-to-robot leaves where it opens a loop: the parallelogram of tests of URDF loops, cut at D."""

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError, PinarmError
from pinarm.use.mechanism import Mechanism

INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
FRAME = '<link name="{0}"><inertial><mass value="1e-9"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>\
</inertial></link><joint name="{0}_frame" type="fixed"><origin xyz="{2}" rpy="0 0 0"/><parent link="{1}"/>\
<child link="{0}"/><axis xyz="0 0 0"/></joint>'


def link(name, at):
    return f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="2"/>{INERTIA}</inertial></link>'


def joint(name, parent, child, xyz):
    return (
        f'<joint name="{name}" type="revolute"><origin xyz="{xyz}"/><parent link="{parent}"/><child link="{child}"/>'
        '<axis xyz="0 0 1"/><joint_properties friction="0.0"/></joint>'
    )


EXPORTED = (
    '<robot name="m"><link name="base"/>' + link("crank", "0 0.5 0") + link("coupler", "0.4 0 0")
    + link("rocker", "0 0.5 0") + joint("A", "base", "crank", "0 0 0") + joint("B", "crank", "coupler", "0 1 0")
    + joint("C", "base", "rocker", "0.8 0 0") + FRAME.format("closing_end_1", "coupler", "0.8 0 0")
    + FRAME.format("closing_end_2", "rocker", "0 1 0") + FRAME.format("closing_odd_1", "rocker", "0 2 0") + "</robot>"
)  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "m.urdf").write_text(EXPORTED)
    return tmp_path


def loaded(folder, **keys):
    return Mechanism.load(folder / "m.urdf", values=keys)


def test_pairs_that_no_joint_ties_are_proposed(folder):
    [note] = [note for note in loaded(folder).notes if "closing" in note]
    assert note.startswith("an exporter opened a loop at closing_end_1 and closing_end_2")
    assert "'closures: revolute'" in note
    assert "'closures: {end: revolute}'" in note
    said = note.split("as does '")[1].rstrip("'")
    (folder / "m.yaml").write_text(f"pinarm: 1\nrobot: m.urdf\n{said}\n")
    tied = Mechanism.load(folder / "m.yaml")
    assert [(one.name, one.kind) for one in tied.constraints] == [("end", "revolute")]
    assert not any("closing" in note for note in tied.notes)


@pytest.mark.parametrize("closures", ["revolute", {"end": "revolute"}])
def test_a_word_closes_them(folder, closures):
    mechanism = loaded(folder, closures=closures)
    assert [(one.name, one.kind) for one in mechanism.constraints] == [("end", "revolute")]
    over = {"A": {"from": "-40 deg", "to": "50 deg", "samples": 7}}
    run = pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": {"kind": "statics", "over": over},
                      "outputs": ["B", "C"]})  # fmt: skip
    assert run["C"].values == pytest.approx(np.deg2rad(np.linspace(-40, 50, 7)), abs=1e-12)
    assert run["B"].values == pytest.approx(-run["C"].values, abs=1e-12)


@pytest.mark.parametrize(("closures", "message"), [
    ({"and": "revolute"}, "closing_and_1 and closing_and_2"), ("hinge", "hinge"), ({"end": "rod"}, "rod"),
])  # fmt: skip
def test_mistakes_are_told(folder, closures, message):
    with pytest.raises(PinarmError, match=message):
        loaded(folder, closures=closures)


def test_a_model_without_such_frames_is_told(folder):
    (folder / "m.urdf").write_text(EXPORTED.replace("closing_", "open_"))
    with pytest.raises(InputError, match="no two frames that no loop joint ties") as caught:
        loaded(folder, closures="revolute")
    assert caught.value.location is not None
