"""Small files that ask for much: work and memory are bounded before they are spent, and the message names the key."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.engine import mesh_inertias
from pinarm.errors import InputError, ModelError
from pinarm.problems import time_grid
from pinarm.use.workers.runners import check_number

PENDULUM = """<robot name="r"><link name="base"/><link name="s"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial></link><joint name="x" type="continuous"><parent link="base"/>
<child link="s"/><axis xyz="0 1 0"/></joint></robot>"""
FORWARD = "problem: {kind: forward, time: {end: 1 s, samples: 11}}"
STATICS = "problem: {kind: statics, over: {x: {from: 0 deg, to: 90 deg, samples: 11}}}"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "r.urdf").write_text(PENDULUM)
    return tmp_path


def scenario(folder: Path, problem: str, outputs: str = "[x]", more: str = "") -> Path:
    file = folder / "s.yaml"
    file.write_text(f"pinarm: 1\nmechanism: r.urdf\n{problem}\noutputs: {outputs}\n{more}")
    return file


# ------------------------------------------------------------------------------------------ rows of a run


@pytest.mark.parametrize(("problem", "key"), [(FORWARD, "problem.time.samples"), (STATICS, "problem.over.x.samples")])
def test_rows_beyond_the_memory_are_refused_by_their_key(folder: Path, problem: str, key: str) -> None:
    file = scenario(folder, problem.replace("samples: 11", "samples: 10000000"))
    with pytest.raises(InputError, match="10000000 rows of 6 numbers") as caught:
        pinarm.load(file).run()
    assert str(caught.value).startswith(f"{file}:3:")
    assert key in caught.value.hint
    assert "at most 2 GB: 5128205 rows" in caught.value.expected


def test_recorded_rows_are_bounded_too(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time_grid, "MEMORY", 10_000)
    (folder / "t.csv").write_text("t [s],x [rad]\n" + "".join(f"{k},0\n" for k in range(100)))
    with pytest.raises(InputError, match="100 rows of 5 numbers") as caught:
        pinarm.load(scenario(folder, "problem: {kind: recorded, file: t.csv}")).validate()
    assert "a smaller file" in caught.value.hint


# ------------------------------------------------------------------------------------------ MuJoCo's compiler

MESH = '<mujoco><asset><mesh name="k" {mesh}/></asset><worldbody><body name="a"><joint name="j"/>{body}</body>{world}'
GEOM = '<geom type="mesh" mesh="k"/>'


@pytest.mark.parametrize(
    ("body", "world"),
    [
        (GEOM, '<replicate count="100000000" offset="1 0 0"><geom size="0.1"/></replicate>'),
        (GEOM + '<composite type="cable" count="1000000 1 1"><geom size="0.1"/></composite>', ""),
    ],
)
def test_copies_are_refused_before_the_compiler_makes_them(
    folder: Path, body: str, world: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_inertias.subprocess, "run", lambda *_, **__: pytest.fail("the compiler was asked"))
    (folder / "k.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    text = MESH.format(mesh='file="k.obj"', body=body, world=world) + "</worldbody></mujoco>"
    (folder / "m.xml").write_text(text)
    with pytest.raises(ModelError, match="is not read") as caught:
        pinarm.Mechanism.load(folder / "m.xml")
    assert caught.value.expected == "the bodies that it stands for"


def test_the_compiler_gets_a_minute_and_4_gb(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh that it generates itself takes a minute for two million faces."""
    pytest.importorskip("mujoco")
    given: list[str] = []

    def ended(words: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        given.append(words[-1])
        return subprocess.CompletedProcess(words, 1)

    monkeypatch.setattr(mesh_inertias.subprocess, "run", ended)
    builtin = MESH.format(mesh='builtin="supersphere" params="1000 1 1"', body=GEOM, world="")
    (folder / "m.xml").write_text(builtin + "</worldbody></mujoco>")
    with pytest.raises(ModelError, match="ended without an answer") as caught:
        pinarm.Mechanism.load(folder / "m.xml")
    assert caught.value.expected == "meshes that it can read within 60 s and 4 GB"
    assert "(resource.RLIMIT_CPU, 60)" in given[0]


# ------------------------------------------------------------------------------------------ levels, keys, numbers


def test_paths_of_keys_are_no_deeper_than_files(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = ".".join(["a"] * 500 + ["x"])
    file = scenario(folder, FORWARD, more=f'variants: {{v: {{"{path}": 1}}}}\n')
    with pytest.raises(InputError, match="has 501 steps") as caught:
        pinarm.load(file).validate()
    assert len(str(caught.value)) < 1000
    assert caught.value.location is not None
    assert caught.value.location.line == 5
    assert main(["validate", str(file)]) == 2
    with pytest.raises(InputError, match="has 501 steps"):
        pinarm.load(file, {path: 1})
    assert "Traceback" not in capsys.readouterr().err


def test_data_from_python_are_no_deeper_than_files() -> None:
    deep: dict[str, Any] = {}
    for _ in range(3000):
        deep = {"a": deep}
    circle: list[Any] = []
    circle.append(circle)
    for data in (deep, {"pinarm": circle}):
        with pytest.raises(InputError, match="nested too deeply"):
            pinarm.load(data)


def test_no_list_of_a_thousand_million_workers_is_made() -> None:
    with pytest.raises(InputError, match="1000000000 workers are too many"):
        check_number(1_000_000_000)


# ------------------------------------------------------------------------------------------ weights of every size

SCREW = """<sdf version="1.9"><model name="s"><link name="base"><inertial><mass>1</mass></inertial></link>
<link name="nut"><inertial><mass>2</mass><inertia><ixx>.02</ixx><iyy>.02</iyy><izz>.03</izz></inertia></inertial></link>
<joint name="fix" type="fixed"><parent>world</parent><child>base</child></joint><joint name="turn" type="screw">
<parent>base</parent><child>nut</child><axis><xyz>0 0 1</xyz></axis><{tag}>{pitch}</{tag}></joint></model></sdf>"""


@pytest.mark.parametrize(("tag", "pitch"), [
    ("thread_pitch", -1e-12), ("screw_thread_pitch", 1e12), ("screw_thread_pitch", 1e-12),
])  # fmt: skip
def test_a_nut_falls_on_a_thread_of_any_lead(folder: Path, tag: str, pitch: float) -> None:
    """``(m + I (2 pi / lead)²) a = -m g`` along the axis, and ``2 pi / lead`` times as much about it."""
    (folder / "s.sdf").write_text(SCREW.format(tag=tag, pitch=pitch))
    ratio = 2.0 * np.pi / pitch if tag == "screw_thread_pitch" else -pitch  # turns [rad] of a metre
    problem = {"kind": "forward", "time": {"end": "0.1 s", "samples": 3}}
    outputs = ["joint.turn.acceleration", "joint.turn.slide.acceleration"]
    data = {"pinarm": 1, "mechanism": pinarm.Mechanism.load(folder / "s.sdf"), "problem": problem, "outputs": outputs}
    found = pinarm.run(data)
    along = -2.0 * 9.81 / (2.0 + 0.03 * ratio**2)
    for name, value in zip(outputs, (ratio * along, along), strict=True):
        assert found[name].values == pytest.approx(np.full(3, value), rel=1e-9)


# ------------------------------------------------------------------------------------------ manners


def test_examples_are_not_written_through_a_link(tmp_path: Path) -> None:
    elsewhere, target = tmp_path / "elsewhere", tmp_path / "examples"
    elsewhere.mkdir()
    target.mkdir()
    (target / "models").symlink_to(elsewhere)
    (target / ".pinarm-root").symlink_to(elsewhere / "made")
    with pytest.raises(InputError, match="by a symbolic link"):
        pinarm.examples(target)
    assert [*elsewhere.iterdir()] == []


def test_a_link_in_a_circle_is_named_as_such(tmp_path: Path) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    for call in (lambda: pinarm.examples(loop), lambda: pinarm.new("arm", loop)):
        with pytest.raises(InputError, match="loop is no folder, or a symbolic link that leads to none"):
            call()
