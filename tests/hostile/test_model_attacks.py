"""URDF and MJCF from strangers: each ends in a ``PinarmError``, opens nothing outside, tells nothing."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pinarm.errors import PinarmError
from pinarm.input import xml_text
from pinarm.input.xml_text import MAX_BYTES, MAX_DEPTH, MAX_ELEMENTS, MAX_TEXT
from pinarm.mechanics.loading import pinocchio_model
from pinarm.use.mechanism import Mechanism

SECRET = "canary-in-a-coal-mine"

BODY = '<body name="b"><joint name="j"/><geom size="1"/></body>'
MODEL = f'<mujoco model="m">{{}}<worldbody>{BODY}{{}}</worldbody></mujoco>'


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A folder with a root of its own, and a secret outside of it."""
    (tmp_path / "secret.xml").write_text(f"<mujoco><worldbody><body name='{SECRET}'/></worldbody></mujoco>")
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / ".pinarm-root").touch()
    return inner


def refused(path: Path, text: str) -> str:
    path.write_text(text)
    with pytest.raises(PinarmError) as caught:
        Mechanism.load(path)
    assert SECRET not in str(caught.value)
    return str(caught.value)


INCLUDES = {
    "absolute": "{outside}/secret.xml", "upwards": "../secret.xml", "link": "link.xml",
    "link to a folder": "folder/secret.xml", "file": "file://{outside}/secret.xml", "http": "http://127.0.0.1:9/x.xml",
    "device": "/dev/zero", "process": "/proc/self/environ", "folder itself": ".", "nothing": "", "pipe": "pipe.xml",
    "null": "a%00b", "long": "x" * 5000,
}  # fmt: skip


@pytest.mark.parametrize("attack", INCLUDES)
def test_an_include_leads_nowhere_else(root, attack):
    (root / "link.xml").symlink_to(root.parent / "secret.xml")
    (root / "folder").symlink_to(root.parent)
    os.mkfifo(root / "pipe.xml")
    file = INCLUDES[attack].replace("{outside}", str(root.parent))
    refused(root / "m.xml", MODEL.format(f'<include file="{file}"/>', ""))


def test_an_include_under_the_root_is_read(root):
    (root / "parts").mkdir()
    (root / "parts" / "arm.xml").write_text('<mujoco><body name="c"><joint name="k"/><geom size="1"/></body></mujoco>')
    (root / "m.xml").write_text(MODEL.format("", '<include file="parts/arm.xml"/>'))
    assert list(Mechanism.load(root / "m.xml").joints) == ["j", "k"]


@pytest.mark.parametrize("chain", [["m"], ["a", "m"], ["a", "b", "a"], ["a", "a"]])
def test_a_file_is_included_once(root, chain):
    for one, following in zip(chain, [*chain[1:], ""], strict=True):
        inside = f'<include file="{following}.xml"/>' if following else ""
        if one != "m" and not (root / f"{one}.xml").exists():
            (root / f"{one}.xml").write_text(f"<mujoco>{inside}</mujoco>")
    twice = '<include file="a.xml"/>' if chain == ["a", "a"] else ""
    assert "is included twice" in refused(root / "m.xml", MODEL.format(f'<include file="{chain[0]}.xml"/>{twice}', ""))


def test_what_is_included_counts_against_the_bounds(root, monkeypatch):
    (root / "big.xml").write_text(f"<mujoco><!--{'x' * MAX_BYTES}--></mujoco>")
    assert "too large" in refused(root / "m.xml", MODEL.format('<include file="big.xml"/>', ""))
    monkeypatch.setattr(xml_text, "MAX_ELEMENTS", 2000)
    many = "<site/>" * 1010
    for name in ("one", "two"):
        (root / f"{name}.xml").write_text(f"<mujoco>{many}</mujoco>")
    text = MODEL.format("", '<include file="one.xml"/><include file="two.xml"/>')
    assert "too many elements" in refused(root / "m.xml", text)


BOMB = '<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>'
OUTSIDE = '<!DOCTYPE m [<!ENTITY x SYSTEM "file:///etc/passwd">]>'


@pytest.mark.parametrize("doctype", [BOMB, OUTSIDE, "<!DOCTYPE m SYSTEM 'http://127.0.0.1:9/x.dtd'>"])
@pytest.mark.parametrize("ending", [".xml", ".mjcf", ".urdf"])
def test_entities_are_refused(root, doctype, ending):
    assert "DOCTYPE" in refused(root / f"m{ending}", doctype + MODEL.format("", ""))


HUGE = {
    "depth": "<body>" * (MAX_DEPTH + 5) + "</body>" * (MAX_DEPTH + 5),
    "elements": "<site/>" * (MAX_ELEMENTS + 5),
    "text": f'<body name="{"x" * (MAX_TEXT + 5)}"/>',
    "freedom": "".join(f'<body name="q{k}"><joint/><geom size="1"/></body>' for k in range(300)),
    "fixed bodies": "<body/>" * (MAX_ELEMENTS // 2),
    "sites": "".join(f'<site name="s{k}"/>' for k in range(8000)),
    "joints of one body": f'<body name="q">{"<joint/>" * 300}<geom size="1"/></body>',
    "numbers": '<body name="q"><joint axis="' + "1 " * 4000 + '"/></body>',
    "overflow": '<body name="q"><joint axis="1e999 0 0"/></body>',
    "infinite pose": '<body name="q" pos="inf 0 0"/>',
    "nested defaults": "",
}


@pytest.mark.parametrize("attack", HUGE)
def test_size_is_bounded(root, attack, monkeypatch):
    monkeypatch.setattr(pinocchio_model, "MOST", 250)  # as many degrees of freedom as it allows take too long here
    classes = "<default>" * 101 + "</default>" * 101 if attack == "nested defaults" else ""
    refused(root / "m.xml", MODEL.format(classes, HUGE[attack]))


def test_the_deepest_tree_that_is_read_needs_no_deep_stack(root):
    depth = MAX_DEPTH - 5
    inner = "".join(f'<body name="d{k}"><joint name="e{k}"/><geom size="1"/>' for k in range(depth)) + "</body>" * depth
    (root / "m.xml").write_text(MODEL.format("", inner))
    assert Mechanism.load(root / "m.xml").model.nv == depth + 1


MESHES = [
    "/etc/passwd",
    "../secret.xml",
    "file:///etc/passwd",
    "package://x/../../etc/passwd",
    "http://127.0.0.1:9/m.stl",
    "/dev/zero",
]


@pytest.mark.parametrize("mesh", MESHES)
def test_meshes_of_a_model_are_left_alone(root, mesh, monkeypatch):
    """A mesh has no part in dynamics: wherever it lies, it is not even looked for."""

    def watched(path, *arguments, **options):
        assert str(path).startswith(str(root)), path
        return plain(path, *arguments, **options)

    plain = open
    monkeypatch.setattr("builtins.open", watched)
    asset = f'<asset><mesh name="m" file="{mesh}"/><texture file="{mesh}"/><hfield file="{mesh}"/></asset>'
    seen = '<body name="v"><joint name="w"/><inertial pos="0 0 0" mass="1"/><geom type="mesh" mesh="m"/></body>'
    (root / "m.xml").write_text(MODEL.format(asset, seen))
    assert Mechanism.load(root / "m.xml").model.nv == 2
    urdf = (f'<robot name="r"><link name="a"/><link name="b"><visual><geometry><mesh filename="{mesh}"/></geometry>'
            '</visual><collision><geometry><mesh filename="x"/></geometry></collision></link>'
            '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>')  # fmt: skip
    (root / "m.urdf").write_text(urdf)
    assert Mechanism.load(root / "m.urdf").model.nv == 1


@pytest.mark.parametrize("text", ["", "<mujoco", "<mujoco/>", "\x00", "<worldbody/>"])
def test_what_is_no_model_is_refused(root, text):
    refused(root / "m.xml", text)


@pytest.mark.parametrize("key", ["stiffness", "damping", "armature", "frictionloss", "ref", "springref", "range"])
def test_no_number_of_a_joint_is_taken_on_trust(root, key):
    for value in ("nan", "inf", "x", "1_0", "0x10", "", "1e999", "-1 nan"):
        body = f'<body name="q"><joint name="k" {key}="{value}"/><geom size="1"/></body>'
        refused(root / "m.xml", MODEL.format("", body))
