"""Inertias of MJCF bodies with meshes, by MuJoCo's compiler: ``pip install 'pinarm[mjcf]'``.

The mesh files are read here, below the root and within a size, and given to the compiler as bytes, in a process of its
own with bounds on memory and time: a mesh comes from strangers, and the compiler is not made for these. What it returns
is written into the model as ``<inertial>``, so that a saved result needs no mesh.
"""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from pinarm.errors import ModelError
from pinarm.input.roots import contained_file

MOST_BYTES = 50_000_000
"""Largest size of all mesh files of a model together."""

MEMORY, SECONDS = 4_000_000_000, 60
"""Bounds of the compiler: address space [bytes], and processor time [s]; ``MOST_BYTES`` of triangles stay within them.

A mesh that it generates itself has no bytes, and any number of triangles.
"""

KEPT = {"default", "asset", "mesh", "worldbody", "body", "frame", "geom", "inertial"}
"""Elements that inertias depend on."""

CONVENTIONS = {
    "angle", "eulerseq", "coordinate", "inertiafromgeom", "inertiagrouprange", "balanceinertia", "exactmeshinertia",
    "convexhull",
}  # fmt: skip
"""Attributes of the compiler that they depend on; those that change all masses are applied where the model is read."""

COMPILER = """
import base64, json, sys
try:
    import resource
except ImportError:  # a system without bounds
    pass
else:
    for bound, most in ((resource.RLIMIT_AS, %d), (resource.RLIMIT_CPU, %d)):
        resource.setrlimit(bound, (most, most))
import mujoco
given = json.load(sys.stdin)
files = {name: base64.b64decode(content) for name, content in given["files"].items()}
try:
    model = mujoco.MjModel.from_xml_string(given["xml"], files)
except Exception as error:
    json.dump({"error": " ".join(str(error).split())[:500]}, sys.stdout)
else:
    bodies = ((model.body(k).name, k) for k in range(1, model.nbody))
    json.dump({"bodies": {name: [model.body_mass[k], *model.body_ipos[k], *model.body_iquat[k], *model.body_inertia[k]]
                          for name, k in bodies}}, sys.stdout)
"""
"""Program of the compiler's process: with its bounds in place of ``%d``."""


def with_mesh_inertias(xml: str, path: Path, root: Path) -> str:
    """Return the text of an MJCF model in which bodies with geoms have an ``<inertial>`` of what the compiler finds.

    Those that have one keep it, unless ``inertiafromgeom`` is true.
    """
    model = ElementTree.fromstring(xml)
    said = {key: value for section in model.findall("compiler") for key, value in section.attrib.items()}
    bare = _kept(model)
    files = _mesh_files(bare, said, path, root)
    for k, body in enumerate(bare.iter("body")):
        body.set("name", f"body_{k}")
    conventions = {key: value for key, value in said.items() if key in CONVENTIONS}
    bare.insert(0, Element("compiler", {**conventions, "fusestatic": "false"}))
    compiled = _compiled(ElementTree.tostring(bare, encoding="unicode"), files)
    for section in model.findall("compiler"):
        section.attrib.pop("inertiafromgeom", None)
    for k, body in enumerate(model.iter("body")):
        mass, *numbers = compiled.get(f"body_{k}", [0.0])
        given = [*_own(body, "inertial")]
        if mass and any(True for _ in _own(body, "geom")) and (not given or said.get("inertiafromgeom") == "true"):
            for holder, inertial in given:
                holder.remove(inertial)
            pos, quat, moments = (" ".join(map(repr, part)) for part in (numbers[:3], numbers[3:7], numbers[7:]))
            computed = {"pos": pos, "quat": quat, "mass": repr(mass), "diaginertia": moments}
            body.insert(0, Element("inertial", computed))
    return ElementTree.tostring(model, encoding="unicode")


def _own(holder: Element, tag: str) -> Iterator[tuple[Element, Element]]:
    for child in holder:
        if child.tag == tag:
            yield holder, child
        elif child.tag == "frame":
            yield from _own(child, tag)


def _kept(element: Element) -> Element:
    """Return a copy with what inertias depend on."""
    copy = Element(element.tag, {key: value for key, value in element.attrib.items() if key != "material"})
    copy.text, copy.tail = element.text, element.tail  # lines in messages of the compiler
    copy.extend(_kept(child) for child in element if child.tag in KEPT and child.get("type") != "hfield")
    return copy


def _mesh_files(model: Element, compiler: Mapping[str, str], path: Path, root: Path) -> dict[str, bytes]:
    """Return the content of mesh files by new names, which take the place of theirs in a model."""
    folder, files = compiler.get("meshdir", compiler.get("assetdir", "")), dict[str, bytes]()
    for mesh in model.iterfind("asset/mesh"):
        if file := mesh.get("file"):
            file = Path(file).name if compiler.get("strippath") == "true" else file
            mesh.set("name", mesh.get("name") or Path(file).stem)
            content = contained_file(path.parent.absolute() / folder / file, root)
            name = f"mesh_{len(files)}{content.suffix}"
            files[name] = _content(content, MOST_BYTES - sum(map(len, files.values())))
            mesh.set("file", name)
    return files


def _content(file: Path, most: int) -> bytes:
    with open(file, "rb") as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise ModelError("the mesh files of this model are too large", expected=f"at most {MOST_BYTES} bytes together")
    return content


def _compiled(xml: str, files: dict[str, bytes]) -> dict[str, list[float]]:
    given = json.dumps({"xml": xml, "files": {name: base64.b64encode(x).decode() for name, x in files.items()}})
    program = COMPILER % (MEMORY, SECONDS)
    with TemporaryDirectory() as folder:  # the compiler writes a log where it runs
        done = subprocess.run(
            [sys.executable, "-I", "-c", program], input=given, cwd=folder, capture_output=True, text=True, check=False
        )
    if done.returncode:
        raise ModelError(
            "the masses of meshes cannot be computed: MuJoCo's compiler ended without an answer",
            expected=f"meshes that it can read within {SECONDS} s and {MEMORY / 1e9:g} GB",
            hint="an <inertial> of each body",
        )
    answer: dict[str, Any] = json.loads(done.stdout)
    if "error" in answer:
        raise ModelError(f"MuJoCo's compiler refuses the model: {answer['error']}", hint="an <inertial> of each body")
    bodies: dict[str, list[float]] = answer["bodies"]
    return bodies
