"""STL and OBJ files, in all the forms that they may have."""

from pathlib import Path

import pytest

from pinarm.use.show.replay.meshes import read_mesh

from .test_meshes import volume

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
