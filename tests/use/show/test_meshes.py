"""Meshes are read as other readers read them, and refused where they are damaged."""

import resource
from pathlib import Path

import coal
import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.input.roots import example_robot_data
from pinarm.use.show.bodies import read_mesh


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Volume of a closed surface by the divergence theorem."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


TETRAHEDRON = """<COLLADA><asset><unit meter="0.001"/></asset><library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="f">0 0 0 1 0 0 0 1 0 0 0 1</float_array><technique_common><accessor stride="3"/>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<polylist><input semantic="NORMAL" source="#n" offset="1"/><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>3 3 3 3</vcount><p>0 9 2 9 1 9  0 9 1 9 3 9  0 9 3 9 2 9  1 9 2 9 3 9</p></polylist></mesh></geometry>
</library_geometries><library_visual_scenes><visual_scene id="w"><node><translate>100 0 0</translate>
<node><rotate>0 0 1 90</rotate><scale>2 1 -3</scale><instance_geometry url="#g"/></node></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""

MESHES = {
    "panda_description/meshes/visual/link4.dae": True,  # several materials, a rotated node
    "ur_description/meshes/ur5/visual/wrist1.dae": False,  # several meshes
    "solo_description/meshes/stl/solo12/solo12_hip_fe_fl.stl": True,
}
"""Files, and whether coal can be asked for their volume: of some with several meshes it confuses the corners."""


@pytest.mark.parametrize("name", MESHES)
def test_meshes_are_read_as_assimp_reads_them(name: str) -> None:
    """Coal reads the same file by assimp: extent and volume agree to its single precision."""
    path = example_robot_data() / "robots" / name
    if not path.exists():
        pytest.skip("this version of example-robot-data has other meshes")
    meshes, other = read_mesh(path), coal.MeshLoader().load(str(path), np.ones(3))
    points = np.array(other.vertices())
    size = np.ptp(points, axis=0).max()
    assert np.min([mesh.low for mesh in meshes], axis=0) == pytest.approx(points.min(axis=0), abs=1e-6 * size)
    assert np.max([mesh.high for mesh in meshes], axis=0) == pytest.approx(points.max(axis=0), abs=1e-6 * size)
    total = sum(volume(mesh.vertices, mesh.triangles) for mesh in meshes)
    corners = [other.tri_indices(k) for k in range(other.num_tris)]
    wanted = volume(points, np.array([[c[0], c[1], c[2]] for c in corners]))
    assert total > 0.0
    assert total == pytest.approx(wanted, abs=1e-6 * size**3) or not MESHES[name]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.dae", "<COLLADA"), ("a.dae", "<COLLADA/>"), ("a.stl", "no mesh"), ("a.obj", ""), ("a.ply", "ply"),
        ("a.obj", "v 0 0 0\nf 1 2 3"), ("a.obj", "v 0 0 x\nf 1 1 1"), ("a.stl", "solid\nvertex 1 2 3"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1e300 0\nf 1 2 3"),
        ("a.obj", "v 0 0 0\nf 1 1 99999999999999999999"),
        ("a.dae", TETRAHEDRON.replace("3 3 3 3", "3 3 3 " + 20 * "9")),
        ("a.dae", TETRAHEDRON.replace("VERTEX", "CORNER")), ("a.dae", TETRAHEDRON.replace("1 0 0", "1e300 0 0")),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("error")
def test_a_damaged_mesh_is_refused(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError):
        read_mesh(tmp_path / name)


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
MESH = """<COLLADA><library_geometries><geometry id="g"><mesh><source id="p">
<float_array>0 0 0 1 0 0 0 1 0</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
PARTS</mesh></geometry>
</library_geometries><library_visual_scenes><visual_scene id="s"><node>NODES</node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
PART = '<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>'
POLYGON = '<polylist><input semantic="VERTEX" source="#v"/><vcount>COUNTS</vcount><p>0 1 2</p></polylist>'
INSTANCE = '<instance_geometry url="#g"/>'


def scene(parts: str = PART, nodes: str = INSTANCE) -> str:
    return MESH.replace("PARTS", parts).replace("NODES", nodes)


HOSTILE = {
    "newlines.stl": lambda: "solid\n" + "\n" * 20_000_000,
    "spaces.stl": lambda: "solid\n" + "vertex" + " " * 20_000_000 + "1",
    "elements.dae": lambda: "<COLLADA>" + "<a/>" * 2_000_000 + "</COLLADA>",
    "nested.dae": lambda: "<COLLADA>" + "<a>" * 300_000,
    "instances.dae": lambda: scene(nodes=INSTANCE * 20_000),
    "copies.dae": lambda: scene(PART * 900, INSTANCE * 900),
    "counts.dae": lambda: scene(POLYGON.replace("COUNTS", "999999999")),
    "negative.dae": lambda: scene(POLYGON.replace("COUNTS", "-3 6")),
}


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is looked up in /proc")
@pytest.mark.parametrize("name", [
    pytest.param(name, marks=pytest.mark.slow)
    if name in ("elements.dae", "copies.dae", "instances.dae") else name
    for name in HOSTILE
])  # fmt: skip
def test_a_file_meant_to_harm_is_refused_within_bounds(tmp_path: Path, name: str) -> None:
    """The process gets a gigabyte more than it has: about what the largest mesh that is allowed takes."""
    (tmp_path / name).write_text(HOSTILE[name]())
    limits = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + 2**30, limits[1]))
    try:
        with pytest.raises(InputError, match=r"cannot be read|no triangles"):
            read_mesh(tmp_path / name)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)


def test_what_the_attacks_are_made_of_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_text(scene(PART + POLYGON.replace("COUNTS", "3"), 2 * INSTANCE))
    (tmp_path / "a.obj").write_text(TRIANGLE + "\n\nf -3 -2 -1\n")
    assert [len(mesh.triangles) for mesh in read_mesh(tmp_path / "a.dae")] == [1, 1, 1, 1]
    assert [len(mesh.triangles) for mesh in read_mesh(tmp_path / "a.obj")] == [2]


def test_collada_nodes_are_nested_scaled_and_mirrored(tmp_path: Path) -> None:
    """Shifted by 100 mm along x, turned by 90 degrees about z, stretched by 2, 1 and -3: outside stays outside."""
    (tmp_path / "a.dae").write_text(TETRAHEDRON)
    [mesh] = read_mesh(tmp_path / "a.dae")
    wanted = {(100, 0, 0), (100, 2, 0), (99, 0, 0), (100, 0, -3)}
    assert {tuple(int(x) for x in np.round(1000 * vertex, 4)) for vertex in mesh.vertices} == wanted
    assert volume(mesh.vertices, mesh.triangles) == pytest.approx(1e-9, rel=1e-6)


def test_a_collada_scene_that_calls_itself_ends(tmp_path: Path) -> None:
    loop = '<node id="n"><instance_node url="#n"/><instance_node url="#n"/></node>'
    (tmp_path / "a.dae").write_text(
        f'<COLLADA><library_nodes>{loop}</library_nodes><library_visual_scenes><visual_scene id="s"><node>'
        '<instance_node url="#n"/></node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )
    with pytest.raises(InputError, match="too many"):
        read_mesh(tmp_path / "a.dae")


def test_entities_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_text('<!DOCTYPE COLLADA [<!ENTITY x "1">]>' + TETRAHEDRON)
    with pytest.raises(InputError, match="no DOCTYPE"):
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
