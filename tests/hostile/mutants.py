"""Mutants of every kind of file: each ends in an answer or in words. A number decides all that is done to it."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import struct
import traceback
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from random import Random
from unittest.mock import patch

import pinarm
from pinarm.cli.main import main as command
from pinarm.errors import PinarmError
from pinarm.use.cases.case import Row
from pinarm.use.show.bodies import read_mesh
from pinarm.use.study.restore import restore
from pinarm.use.study.sweep.axes import read_cases
from pinarm.use.study.sweep.solving import Journal
from pinarm.use.workers.dispatch import ExecutorWorkers

LARGEST = 100_000
"""Characters of a mutant; files near the bounds of size have tests of their own."""

XACRO = """\
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="m" default="2"/>
  <xacro:property name="l" value="${2*0.5}"/>
  <xacro:macro name="rod" params="name mass *place">
    <link name="${name}"><inertial><xacro:insert_block name="place"/><mass value="${mass}"/>
      <inertia ixx="${mass*l**2/12}" iyy="${mass*l**2/12}" izz="${mass*l**2/12}" ixy="0" ixz="0" iyz="0"/></inertial>
      <visual><origin xyz="0 0 0" rpy="0 0.1 0"/><geometry><cylinder radius="0.1" length="1"/></geometry>
        <material name="red"><color rgba="1 0 0 1"/></material></visual></link>
  </xacro:macro>
  <link name="base"/>
  <xacro:rod name="upper" mass="$(arg m)"><origin xyz="0 0 ${-l/2}"/></xacro:rod>
  <xacro:if value="${l > 0.5}"><xacro:rod name="lower" mass="1"><origin xyz="0 0 0"/></xacro:rod></xacro:if>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <dynamics damping="0.1" friction="0"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 ${-l}" rpy="0 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="10" velocity="10"/></joint>
</robot>
"""
MJCF = """\
<mujoco model="chain">
  <compiler angle="degree" eulerseq="xyz"/><option gravity="0 0 -9.81"/>
  <default><joint damping="0.3"/><geom density="700"/>
    <default class="A"><joint axis="0 1 0"/><geom type="capsule" size="0.05 0.2"/></default></default>
  <worldbody>
    <body name="upper" pos="0.1 0.2 0.3" euler="10 20 30" childclass="A">
      <joint name="shoulder" pos="0.05 0 0.1" ref="25" range="-90 90"/><geom pos="0 0.1 0" euler="5 6 7"/>
      <body name="lower" pos="0 0 0.5" axisangle="1 2 3 50"><joint name="elbow" stiffness="2" springref="3"/>
        <inertial pos="0.1 0 0.02" mass="1.5" diaginertia="0.02 0.03 0.04"/></body>
    </body>
  </worldbody>
  <equality><joint joint1="elbow" joint2="shoulder" polycoef="0 1"/></equality>
</mujoco>
"""
SDF = """\
<sdf version="1.9">
<model name="arm">
  <joint name="stand" type="fixed"><parent>world</parent><child>base</child></joint>
  <link name="base"><inertial><mass>1</mass></inertial></link>
  <link name="upper"><pose>0 0 0.1 0 0.2 0</pose><inertial><pose>0.1 0 0 0 0 0</pose><mass>1</mass>
    <inertia><ixx>.01</ixx><iyy>.01</iyy><izz>.02</izz></inertia></inertial></link>
  <link name="lower"><pose relative_to="upper">0.3 0 0 0 0 0</pose><inertial><mass>1</mass></inertial></link>
  <joint name="shoulder" type="revolute"><parent>base</parent><child>upper</child><axis><xyz>0 1 0</xyz>
    <limit><lower>-3</lower><upper>3</upper></limit><dynamics><damping>0.1</damping></dynamics></axis></joint>
  <joint name="elbow" type="revolute"><parent>upper</parent><child>lower</child><axis><xyz>0 1 0</xyz></axis></joint>
</model>
</sdf>
"""
STL = """\
solid corner
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 1 0 0
vertex 0 1 0
endloop
endfacet
endsolid corner
"""
OBJ = """\
# a pyramid
v 0 0 0
v 1.5 0 0
v 1 1 0
v 0 1 0
v 5e-1 .5 1
vn 0 0 -1
f 4//1 3//1 2//1 1//1
f 1 2 5
f 2/1/1 3/2/1 -1/3/1
"""
COLLADA = """\
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><asset><unit name="m" meter="0.5"/></asset>
<library_effects><effect id="e"><profile_COMMON><technique><lambert><diffuse><color>0.2 0.4 0.6 1</color></diffuse>
</lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 0 1 0 0 0 1
</float_array><technique_common><accessor source="#pa" count="4" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2" material="s"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3</p></triangles>
<polylist count="2" material="s"><input semantic="NORMAL" source="#n" offset="1"/>
<input semantic="VERTEX" source="#v" offset="0"/><vcount>3 3</vcount><p>0 9 3 9 2 9 1 9 2 9 3 9</p></polylist>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node id="n"><matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix>
<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="s" target="#m"/>
</technique_common></bind_material></instance_geometry><node><translate>0 0 1</translate><rotate>0 0 1 90</rotate>
<scale>1 2 -1</scale><instance_geometry url="#g"/></node></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>
"""
MECHANISM = """\
pinarm: 1
robot: arm.urdf.xacro
arguments: {m: kg}
gravity: {direction: -z, magnitude: 9.81 m/s^2}
drives: {motor: {joint: elbow, ratio: 100, efficiency: 0.8}}
couplings: {gears: {kind: gear, joints: [shoulder, elbow], ratio: -2}}
forces:
  spring: {kind: joint_spring, joint: shoulder, stiffness: 3 N*m/rad, damping: 0.1 N*m*s/rad, rest: 10 deg}
payloads: {sack: {point: lower, mass: 1 kg}}
symbols: {alpha: joint.shoulder.position, M: joint.elbow.effort}
"""
SCENARIO = """\
pinarm: 1
title: An arm
mechanism: arm.yaml
arguments: {m: 3 kg}
problem:
  kind: inverse
  time: {end: 2 s, samples: 9}
  motion: {shoulder: {law: trapezoid, from: 0 rad, to: 60 deg, acceleration: 1 rad/s^2}}
  loads: {push: {kind: joint_effort, joint: elbow, effort: {law: table, file: law.csv}}}
symbols: {twice: 2*alpha}
outputs: [M, alpha, twice, sqrt(alpha**2 + 1)]
accuracy: {tolerance: 1e-6}
expect:
  - {quantity: alpha, at: {t: 1 s, side: left}, value: 0.5 rad, atol: 1 rad, source: s}
  - {quantity: M, at: max, published: 20.0 N*m, verdict: rounding, value: 20 N*m, source: s}
"""
FIND = (
    SCENARIO.partition("expect:")[0]
    + """\
find:
  for: {arguments.m: 1 kg}
  so_that: {joint.shoulder.effort @ max: 30 N*m}
sensitivity: {of: [joint.shoulder.effort @ max], to: {arguments.m: 5 %}}
"""
)
FORWARD = SCENARIO.replace("kind: inverse", "kind: forward").replace(
    "motion: {shoulder: {law: trapezoid, from: 0 rad, to: 60 deg, acceleration: 1 rad/s^2}}",
    "initial: {position: {shoulder: 30 deg}, velocity: {shoulder: 1 rad/s}}",
)
OTHERS = {
    "statics": "over: {shoulder: {from: 0 deg, to: 90 deg, samples: 5}}",
    "state": "hold: {shoulder: 30 deg}, velocity: {shoulder: 1 rad/s}, acceleration: {shoulder: 1 rad/s^2}",
    "equilibria": "starts: [{shoulder: 10 deg}, {shoulder: 170 deg}]",
    "linear": "about: {equilibrium: {shoulder: 10 deg}}, frequencies: {from: 0.1 Hz, to: 9 Hz, samples: 5}",
    "kinematics": "time: {end: 1 s, samples: 5}, "
    "motion: {shoulder: {law: harmonic, amplitude: 9 deg, pulsation: 3 rad/s}}",
}
"""The other kinds of problems."""
TABLE = 't [s],M [N*m],note\n0,0,"at rest"\n0.5,1.5,\n1.0,-2e-1,"5"" pipe"\n2.0,0,\n'
CASES = "arguments.m [kg],problem.time.end [s]\n1,2\n2.5,1\n3e0,2\n"
OPTIONS = """\
--set
problem.time.end=3 s
--set
arguments.m=0.2 kg
--over
arguments.m=0.1:0.5:2 kg
--over
problem.time.end=2 s
--result
M @ max
--result
t @ max(alpha)
--result
alpha @ t=1.5 s, side=left
"""
JUNK = (
    "", " ", "0", "1", "-1", "nan", "inf", "1e308", "-1e308", "1e-320", "1e999", "9" * 400, "1_0", "0x10", "1,5", "١",
    "１", "x", "null", "true", "[", "]", "{", "}", "(", ")", '"', "'", ":", ",", "\n", "\t", "\0", "\ufeff", "&", "<",
    ">", "<!--", "-->", "<![CDATA[", "]]>", "${", "}", "$(", "${1/0}", "${l}", "$(arg m)", "..", "../..", "/dev/zero",
    "/etc/passwd", "é\U0001f600", "\x1b[2J", "a" * 3000, " " * 3000, "m^2²", "1 h^99", "30 deg", "1e308 rad",
    "1e-300 s", "-1 s", "10000000", "base", "upper", "shoulder", "elbow", "floating", "fixed", "sqrt(-1)", "1/0",
    "alpha**alpha**99", "{law: harmonic}", "[1, 2]", "#", "- ", "!!python/object", "&a", "*a", "---",
)  # fmt: skip

NUMBERS = (
    b"0",
    b"-0.0",
    b"1",
    b"-1",
    b"2",
    b"3",
    b"0.5",
    b"1e-9",
    b"1e9",
    b"-1e9",
    b"1e-300",
    b"1e300",
    b"1e154",
    b"7e2",
)
"""What a number is replaced by; a unit that stands behind it stays."""

Attempt = Callable[[Path], object]


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        texts: Files that are right, of which one is changed.
        file: What it is called.
        attempt: What is done with the folder that it lies in.
    """

    texts: tuple[bytes, ...]
    file: str
    attempt: Attempt


def mutated(original: bytes, chance: Random) -> bytes:
    """Return a text with one to four changes."""
    data = original
    for _ in range(chance.choice((1, 1, 2, 4))):
        data = chance.choice(CHANGES)(data, chance)
    return data[:LARGEST]


def _word(data: bytes, chance: Random) -> bytes:
    """Replace a word or a number by another one of the text, or by junk."""
    words = list(re.finditer(rb"[\w.]+|[^\w\s]", data))
    if not words:
        return data
    place = chance.choice(words)
    new = chance.choice(words)[0] if chance.random() < 0.4 else chance.choice(JUNK).encode()
    return data[: place.start()] + new + data[place.end() :]


def _number(data: bytes, chance: Random) -> bytes:
    """Replace a number by another one, so that what is around it stays what it is."""
    numbers = list(re.finditer(rb"(?<![\w.])-?[0-9][0-9.]*", data))
    if not numbers:
        return data
    place = chance.choice(numbers)
    new = chance.choice((chance.choice(numbers)[0], *NUMBERS))
    return data[: place.start()] + new + data[place.end() :]


def _letter(data: bytes, chance: Random) -> bytes:
    k = chance.randrange(len(data) + 1)
    new = bytes([chance.randrange(256)]) if chance.random() < 0.5 else b""
    return data[:k] + new + data[k + 1 :]


def _piece(data: bytes, chance: Random) -> bytes:
    """Remove, repeat or move a piece."""
    a, b, c = (chance.randrange(len(data) + 1) for _ in range(3))
    a, b = min(a, b), min(max(a, b), min(a, b) + chance.choice((3, 30, 300)))
    piece, rest = data[a:b], data[:a] + data[b:]
    times = chance.choice((0, 1, 2, 2, 1000))
    return (data if times > 1 else rest)[:c] + piece * times + (data if times > 1 else rest)[c:]


def _line(data: bytes, chance: Random) -> bytes:
    lines = data.split(b"\n")
    k, other = chance.randrange(len(lines)), chance.randrange(len(lines))
    lines[k : k + 1] = chance.choice(([], [lines[k]] * 2, [lines[other]], [b"  " + lines[k]], [lines[k].lstrip()]))
    return b"\n".join(lines)


CHANGES = (_word, _word, _word, _number, _number, _number, _letter, _piece, _line)


def _solved(scenario: str) -> Attempt:
    def attempt(folder: Path) -> None:
        loaded = pinarm.load(folder / scenario, ["accuracy.max_steps=500"])
        loaded.validate()
        if getattr(getattr(loaded.problem, "time", None), "samples", 0) <= 1000:  # ten million are a wish, no mistake
            pinarm.check(loaded, result=loaded.run())

    return attempt


def _replayed(scenario: str) -> Attempt:
    def attempt(folder: Path) -> None:
        assert pinarm.load(folder / scenario).run().replay().html

    return attempt


def _drawn(name: str) -> Attempt:
    def attempt(folder: Path) -> None:
        read_mesh(folder / name)

    return attempt


def _journal(folder: Path) -> None:
    journal = Journal(folder / "journal.jsonl", "task", width=2)
    assert len([*journal.rows()]) < 100
    journal.close()


def _restored(folder: Path) -> None:
    restore(folder / "out").replay()


def _commanded(folder: Path) -> None:
    """Use the options in the file; the command itself catches errors of pinarm, and argparse exits.

    Its cases are solved by a thread: to start a process takes as long as fifty of them.
    """
    options = (folder / "options").read_text(errors="replace").replace("\0", "").splitlines()
    words = ["sweep", str(folder / "s.yaml"), "--no-plots", "-j", "1", "-o", str(folder / "swept"), *options]
    with (
        ThreadPoolExecutor(1) as pool,
        patch("pinarm.use.workers.dispatch.chosen_workers", lambda number, executor: ExecutorWorkers(pool, 1)),
        contextlib.redirect_stderr(io.StringIO()) as said,
        contextlib.suppress(SystemExit),
    ):
        command(words)
    assert "the program failed" not in said.getvalue()


def _cases(folder: Path) -> None:
    read_cases(folder / "cases.csv", lambda path: "")


def _binary(stl: str) -> bytes:
    """Return an STL file of one triangle in its binary form."""
    corners = [float(x) for vertex in re.findall("vertex (.*)", stl) for x in vertex.split()]
    return b" " * 80 + struct.pack("<I12fH", 1, 0.0, 0.0, 1.0, *corners, 0)


def other(kind: str) -> str:
    """Return the scenario of another kind of problem, with an answer key and a symbol."""
    return (
        f"pinarm: 1\nmechanism: arm.yaml\narguments: {{m: 3 kg}}\nproblem: {{kind: {kind}, {OTHERS[kind]}}}\n"
        "symbols: {twice: 2*alpha}\noutputs: [alpha, twice]\n"
        "expect: [{quantity: alpha, at: start, value: 1 rad, atol: 9 rad, source: s}]\n"
    )


def result_files(folder: Path) -> dict[str, bytes]:
    """Return the files of a result and the journal of a sweep, which ``prepare`` wrote."""
    files = {name: (folder / "out" / name).read_bytes() for name in ("summary.json", "scenario.yaml", "trajectory.npz")}
    return {**files, "journal.jsonl": (folder / "journal.jsonl").read_bytes()}


def prepare(folder: Path) -> None:
    """Write the files that are right into a folder."""
    (folder / ".pinarm-root").touch()
    for name, text in (("arm.urdf.xacro", XACRO), ("arm.yaml", MECHANISM), ("s.yaml", SCENARIO), ("law.csv", TABLE),
                       ("f.yaml", FORWARD), ("n.yaml", FIND), ("m.xml", MJCF), ("d.sdf", SDF)):  # fmt: skip
        (folder / name).write_text(text)
    plain = SCENARIO.partition("symbols")[0] + "outputs: [joint.elbow.effort]\n"
    free = plain.replace("motion: {", "motion: {elbow: {law: constant, value: 0.3 rad}, ")
    for name, model, text in (("m.yaml", "m.xml", plain), ("d.yaml", "d.sdf", free)):
        (folder / name).write_text(text.replace("mechanism: arm.yaml\narguments: {m: 3 kg}", f"mechanism: {model}"))
    pinarm.load(folder / "s.yaml").run().save(folder / "out", plots=False)
    (folder / "plain.urdf").write_text(pinarm.load(folder / "s.yaml").mechanism.xml)
    (folder / "plain.yaml").write_text(
        MECHANISM.replace("arm.urdf.xacro", "plain.urdf").replace("arguments: {m: kg}\n", "")
    )
    (folder / "p.yaml").write_text(SCENARIO.replace("arm.yaml\narguments: {m: 3 kg}", "plain.yaml"))
    journal = Journal(folder / "journal.jsonl", "task", width=2)
    for case in range(3):
        journal.add([(str(case), Row((1.5, float("nan")), "", (str(folder / "law.csv"),)))])
    journal.close()


def kinds(folder: Path) -> dict[str, Kind]:
    """Return the kinds of files by name; those of results are made in a folder by ``prepare``."""
    made = result_files(folder)
    return {
        "scenario": Kind((SCENARIO.encode(),), "s.yaml", _solved("s.yaml")),
        "others": Kind(tuple(other(kind).encode() for kind in OTHERS), "o.yaml", _solved("o.yaml")),
        "forward": Kind((FORWARD.encode(),), "f.yaml", _solved("f.yaml")),
        "mechanism": Kind((MECHANISM.encode(),), "arm.yaml", _solved("s.yaml")),
        "urdf": Kind(((folder / "plain.urdf").read_bytes(),), "plain.urdf", _replayed("p.yaml")),
        "xacro": Kind((XACRO.encode(),), "arm.urdf.xacro", _replayed("s.yaml")),
        "mjcf": Kind((MJCF.encode(),), "m.xml", _solved("m.yaml")),
        "sdf": Kind((SDF.encode(),), "d.sdf", _solved("d.yaml")),
        "stl": Kind((STL.encode(), _binary(STL)), "part.stl", _drawn("part.stl")),
        "obj": Kind((OBJ.encode(),), "part.obj", _drawn("part.obj")),
        "dae": Kind((COLLADA.encode(),), "part.dae", _drawn("part.dae")),
        "find": Kind((FIND.encode(),), "n.yaml", _solved("n.yaml")),
        "table": Kind((TABLE.encode(),), "law.csv", _solved("s.yaml")),
        "cases": Kind((CASES.encode(),), "cases.csv", _cases),
        "summary": Kind((made["summary.json"],), "out/summary.json", _restored),
        "resolved": Kind((made["scenario.yaml"],), "out/scenario.yaml", _restored),
        "arrays": Kind((made["trajectory.npz"],), "out/trajectory.npz", _restored),
        "journal": Kind((made["journal.jsonl"],), "journal.jsonl", _journal),
        "options": Kind((OPTIONS.encode(),), "options", _commanded),
    }


def mutant(name: str, kind: Kind, number: int) -> bytes:
    """Return a mutant by its number."""
    chance = Random(f"{name} {number}")
    return mutated(chance.choice(kind.texts), chance)


def tried(name: str, kind: Kind, number: int, folder: Path) -> str:
    """Try a mutant in a folder; return what it ended in: ``answered``, ``refused``, or a traceback."""
    file = folder / kind.file
    original = file.read_bytes() if file.exists() else None
    file.write_bytes(mutant(name, kind, number))
    try:
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            kind.attempt(folder)
        return "answered"
    except PinarmError as error:
        return "refused" if str(error).strip() else "an error without words"
    except MemoryError:
        return "out of memory"
    except Exception:
        return traceback.format_exc()
    finally:
        shutil.rmtree(folder / "swept", ignore_errors=True)
        if original is None:
            file.unlink()
        else:
            file.write_bytes(original)
