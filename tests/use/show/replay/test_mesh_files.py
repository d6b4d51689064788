"""Mesh files: STL and OBJ in all their forms; COLLADA with nodes in nodes, units, colours, and scenes without end."""

from pathlib import Path

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.input.roots import example_robot_data
from pinarm.use.show.replay.mesh_files import read_mesh

from .test_meshes import TETRAHEDRON, volume


def test_collada_nodes_are_nested_scaled_and_mirrored(tmp_path: Path) -> None:
    """Shifted by 100 mm along x, turned by 90 degrees about z, stretched by 2, 1 and -3: outside stays outside."""
    (tmp_path / "a.dae").write_text(TETRAHEDRON)
    [mesh] = read_mesh(tmp_path / "a.dae")
    wanted = {(100, 0, 0), (100, 2, 0), (99, 0, 0), (100, 0, -3)}
    assert {tuple(int(x) for x in np.round(1000 * vertex, 4)) for vertex in mesh.vertices} == wanted
    assert volume(mesh.vertices, mesh.triangles) == pytest.approx(1e-9, rel=1e-6)


def test_collada_has_its_colours() -> None:
    found = read_mesh(example_robot_data() / "robots/panda_description/meshes/visual/link0.dae")
    assert len({mesh.colour for mesh in found}) > 2


def test_a_collada_scene_that_calls_itself_ends(tmp_path: Path) -> None:
    loop = '<node id="n"><instance_node url="#n"/><instance_node url="#n"/></node>'
    (tmp_path / "a.dae").write_text(
        f'<COLLADA><library_nodes>{loop}</library_nodes><library_visual_scenes><visual_scene id="s"><node>'
        '<instance_node url="#n"/></node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )
    with pytest.raises(InputError, match="too many"):
        read_mesh(tmp_path / "a.dae")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1"])
def test_entities_are_refused_in_every_encoding(tmp_path: Path, encoding: str) -> None:
    head, entity = f'<?xml version="1.0" encoding="{encoding}"?>', '<!DOCTYPE COLLADA [<!ENTITY x "1">]>'
    start = TETRAHEDRON.index("<COLLADA")
    (tmp_path / "a.dae").write_bytes((head + TETRAHEDRON[start:]).encode(encoding))
    assert len(read_mesh(tmp_path / "a.dae")) == 1
    (tmp_path / "a.dae").write_bytes((head + entity + TETRAHEDRON[start:]).encode(encoding))
    with pytest.raises(InputError, match="it declares entities"):
        read_mesh(tmp_path / "a.dae")


CUBE = """o cube
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
g bottom and top\nf 1 4 3 2\nf 5/1 6/2/3 7//1 8
g sides\nf 1 2 6 5\nf -7 -6 -2 -3\nf 3 4 8 7\nf 4 1 5 8
"""


def test_obj_with_polygons_groups_and_relative_corners(tmp_path: Path) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    [mesh] = read_mesh(tmp_path / "cube.obj")
    assert (len(mesh.vertices), len(mesh.triangles)) == (8, 12)
    assert volume(mesh.vertices, mesh.triangles) == pytest.approx(1.0, rel=1e-15)


def test_stl_as_text(tmp_path: Path) -> None:
    facet = "facet normal 0 0 0\nouter loop\n{}\nendloop\nendfacet\n"
    corners = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    text = "".join(facet.format("\n".join(f"  vertex {corners[k]}" for k in face)) for face in faces)
    (tmp_path / "a.STL").write_text(f"solid a\n{text}endsolid a\n")
    [mesh] = read_mesh(tmp_path / "a.STL")
    assert len(mesh.vertices) == 4
    assert volume(mesh.vertices, mesh.triangles) == pytest.approx(1 / 6, rel=1e-15)
