"""What is drawn: meshes read right, bodies without shapes shown all the same, and the view on them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.input.roots import example_robot_data
from pinarm.use.show.replay.meshes import Mesh, read_mesh, thinned

VISUAL = '<visual>{origin}<geometry>{shape}</geometry><material name="m"><color rgba="{rgba}"/></material></visual>'


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Volume of a closed surface by the divergence theorem."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


MESHES = {
    "panda_description/meshes/visual/link4.dae": True,  # several materials, a rotated node
    "ur_description/meshes/ur3/visual/forearm.dae": True,
    "ur_description/meshes/ur5/visual/wrist1.dae": False,  # several meshes
    "romeo_description/meshes/V1/visual/HeadRoll.dae": True,
    "solo_description/meshes/stl/solo12/solo12_hip_fe_fl.stl": True,
    "z1_description/meshes/visual/z1_Link02.dae": True,
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


TETRAHEDRON = """<COLLADA><asset><unit meter="0.001"/></asset><library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="f">0 0 0 1 0 0 0 1 0 0 0 1</float_array><technique_common><accessor stride="3"/>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<polylist><input semantic="NORMAL" source="#n" offset="1"/><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>3 3 3 3</vcount><p>0 9 2 9 1 9  0 9 1 9 3 9  0 9 3 9 2 9  1 9 2 9 3 9</p></polylist></mesh></geometry>
</library_geometries><library_visual_scenes><visual_scene id="w"><node><translate>100 0 0</translate>
<node><rotate>0 0 1 90</rotate><scale>2 1 -3</scale><instance_geometry url="#g"/></node></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


def test_collada_nodes_are_nested_scaled_and_mirrored(tmp_path: Path) -> None:
    """Shifted by 100 mm along x, turned by 90 degrees about z, stretched by 2, 1 and -3: outside stays outside."""
    (tmp_path / "a.dae").write_text(TETRAHEDRON)
    [mesh] = read_mesh(tmp_path / "a.dae")
    wanted = {(100, 0, 0), (100, 2, 0), (99, 0, 0), (100, 0, -3)}
    assert {tuple(int(x) for x in np.round(1000 * vertex, 4)) for vertex in mesh.vertices} == wanted
    assert volume(mesh.vertices, mesh.triangles) == pytest.approx(1e-9, rel=1e-6)


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


def test_collada_has_its_colours() -> None:
    found = read_mesh(example_robot_data() / "robots/panda_description/meshes/visual/link0.dae")
    assert len({mesh.colour for mesh in found}) > 2


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.dae", "<COLLADA"), ("a.dae", "<!DOCTYPE a [<!ENTITY b 'c'>]><COLLADA/>"), ("a.dae", "<COLLADA/>"),
        ("a.stl", "no mesh"), ("a.obj", ""), ("a.ply", "ply"),
        ("a.obj", "v 0 0 0\nf 1 2 3"), ("a.obj", "v 0 0 x\nf 1 1 1"), ("a.stl", "solid\nvertex 1 2 3"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 inf 0\nf 1 2 3"),
    ],
)  # fmt: skip
def test_a_damaged_mesh_is_refused(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError):
        read_mesh(tmp_path / name)


def test_a_collada_scene_that_calls_itself_ends(tmp_path: Path) -> None:
    loop = '<node id="n"><instance_node url="#n"/><instance_node url="#n"/></node>'
    (tmp_path / "a.dae").write_text(
        f'<COLLADA><library_nodes>{loop}</library_nodes><library_visual_scenes><visual_scene id="s"><node>'
        '<instance_node url="#n"/></node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )
    with pytest.raises(InputError, match="too many"):
        read_mesh(tmp_path / "a.dae")


def test_thinning_keeps_the_form() -> None:
    """A sphere of 79,600 triangles, held to 5,000, keeps volume and extent to a few parts in a hundred."""
    n = 200
    theta, phi = np.meshgrid(np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, n, endpoint=False), indexing="ij")
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    k = np.arange(n)
    faces = [np.stack([i * n + k, (i + 1) * n + k, i * n + (k + 1) % n], axis=1) for i in range(n - 1)]
    faces += [np.stack([(i + 1) * n + k, (i + 1) * n + (k + 1) % n, i * n + (k + 1) % n], axis=1) for i in range(n - 1)]
    [mesh] = thinned([Mesh(points, np.concatenate(faces))], 2.0, most=5000)
    assert 1000 < len(mesh.triangles) <= 5000
    assert volume(mesh.vertices, mesh.triangles) == pytest.approx(4 / 3 * np.pi, rel=0.05)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx(2.0, rel=0.05)


@pytest.fixture
def picture(tmp_path: Path, read: Callable[..., Any]) -> Callable[..., Any]:
    """Return the scene of a URDF text whose joints rest, and the notes on it."""

    def draw(xml: str, **content: Any) -> tuple[dict[str, Any], tuple[str, ...]]:
        (tmp_path / ".pinarm-root").touch()
        (tmp_path / "m.urdf").write_text(xml)
        forces = content.get("forces", "{}")
        (tmp_path / "m.yaml").write_text(f"pinarm: 1\nrobot: m.urdf\nforces: {forces}\n")
        hold = pinarm.Mechanism.load(tmp_path / "m.yaml").joints
        held = ", ".join(f"{name}: {content.get('at', 0)} {joint.unit}" for name, joint in hold.items())
        (tmp_path / "s.yaml").write_text(
            f"pinarm: 1\nmechanism: m.yaml\nproblem: {{kind: statics, hold: {{{held}}}}}\noutputs: [g]\n"
        )
        page = pinarm.load(tmp_path / "s.yaml").run().replay(arrows=content.get("arrows", ()))
        return read(page.html).scene, page.notes

    return draw


def test_shapes_of_urdf(picture: Callable[..., Any], chain: Callable[..., str]) -> None:
    shapes = "".join(
        VISUAL.format(origin='<origin xyz="0.1 0 0.2" rpy="0 0.3 0"/>', shape=shape, rgba="0.1 0.2 0.3 0.4")
        for shape in ('<box size="1 2 3"/>', '<cylinder radius="0.5" length="2"/>', '<sphere radius="0.7"/>',
                      '<capsule radius="0.1" length="0.4"/>')
    )  # fmt: skip
    scene, notes = picture(
        chain({"name": "a", "axis": "0 1 0"}).replace('<link name="a_link">', f'<link name="a_link">{shapes}')
    )
    assert notes == ()
    kinds = {shape["kind"]: shape for shape in scene["shapes"] if shape["node"] == 1}
    assert [kinds[kind]["size"] for kind in ("box", "cylinder", "sphere", "capsule")] == [
        [1, 2, 3],
        [0.5, 2],
        [0.7],
        [0.1, 0.4],
    ]
    half = 0.15
    for shape in kinds.values():
        assert shape["place"] == pytest.approx([0.1, 0, 0.2, 0, np.sin(half), 0, np.cos(half)], abs=1e-12)
        assert shape["colour"] == [0.1, 0.2, 0.3, 0.4]


def test_a_visual_of_a_fixed_link_moves_with_its_body(picture: Callable[..., Any], chain: Callable[..., str]) -> None:
    visual = VISUAL.format(origin='<origin xyz="0 0 0.1"/>', shape='<sphere radius="0.1"/>', rgba="1 1 1 1")
    xml = chain({"name": "a"}, {"name": "tip", "kind": "fixed", "at": "0.5 0 0"})
    scene, _ = picture(xml.replace('<link name="tip_link">', f'<link name="tip_link">{visual}'))
    [sphere] = [shape for shape in scene["shapes"] if shape["kind"] == "sphere"]
    assert sphere["node"] == 1
    assert sphere["place"] == pytest.approx([0.5, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    "file", ["../../../etc/passwd", "/etc/passwd", "package://other/a.stl", "http://a/b.stl", "no.stl"]
)
def test_a_mesh_elsewhere_is_not_read_and_the_body_is_a_stick(
    picture: Callable[..., Any], chain: Callable[..., str], file: str
) -> None:
    visual = VISUAL.format(origin="", shape=f'<mesh filename="{file}"/>', rgba="1 1 1 1")
    xml = chain({"name": "a", "com": "0 0 -1"}).replace('<link name="a_link">', f'<link name="a_link">{visual}')
    scene, [note] = picture(xml)
    assert note.startswith("link a_link is not drawn as its file says")
    assert {shape["kind"] for shape in scene["shapes"] if shape["node"] == 1} == {"cylinder", "sphere"}


def test_a_stick_figure_reaches_from_joint_to_joint(picture: Callable[..., Any], chain: Callable[..., str]) -> None:
    """Rods of the lengths of the links, along them; a pin along each axis, here y; the end at the centre of mass."""
    scene, _ = picture(
        chain({"name": "a", "axis": "0 1 0"}, {"name": "b", "axis": "0 1 0", "at": "0.3 0 0.4", "com": "0 0 2"})
    )
    rods = {s["node"]: s for s in scene["shapes"] if s["kind"] == "cylinder" and s["size"][1] > 0.4}
    assert [rods[k]["size"][1] for k in (1, 2)] == pytest.approx([0.5, 2.0])
    assert rods[1]["place"][:3] == pytest.approx([0.15, 0.0, 0.2])
    along = pin.Quaternion(np.array(rods[1]["place"][3:])).toRotationMatrix()[:, 2]
    assert along == pytest.approx([0.6, 0.0, 0.8])
    pins = [s for s in scene["shapes"] if s["kind"] == "cylinder" and s["size"][1] < 0.4]
    for one in pins:
        assert abs(pin.Quaternion(np.array(one["place"][3:])).toRotationMatrix()[1, 2]) == pytest.approx(1.0)
    assert sorted(one["node"] for one in pins) == [1, 2]


def test_a_body_in_one_place_is_the_box_of_its_inertia(picture: Callable[..., Any], chain: Callable[..., str]) -> None:
    """A homogeneous box of 12 kg and edges 1, 2, 3 m has the moments 13, 10 and 5 kg m^2."""
    scene, _ = picture(chain({"name": "a", "mass": 12.0, "inertia": (13.0, 10.0, 5.0)}))
    [box] = [shape for shape in scene["shapes"] if shape["kind"] == "box"]
    assert sorted(box["size"]) == pytest.approx([1.0, 2.0, 3.0])


def test_springs_and_cylinders_join_their_points(picture: Callable[..., Any], chain: Callable[..., str]) -> None:
    xml = chain({"name": "a", "axis": "0 1 0"}, {"name": "b", "axis": "0 1 0", "at": "0 0 3", "com": "0 0 1"})
    scene, _ = picture(xml, forces="{s: {kind: point_spring, between: [base, b_link], stiffness: 1 N/m}, "
                                   "c: {kind: point_spring, between: [base, b_link], force: -5 N}}")  # fmt: skip
    assert [(pair["kind"], pair["a"]["node"], pair["b"]["node"]) for pair in scene["pairs"]] == [
        ("spring", 0, 2), ("cylinder", 0, 2),
    ]  # fmt: skip
    assert scene["pairs"][0]["longest"] == pytest.approx(3.0)


def test_a_bushing_is_drawn_between_its_frames_with_force_and_moment_on_both(
    picture: Callable[..., Any], chain: Callable[..., str]
) -> None:
    xml = chain({"name": "a", "axis": "0 1 0"}, {"name": "b", "axis": "0 1 0", "at": "0 0 3", "com": "0 0 1"})
    rates = "{translation: [9 N/m, 9 N/m, 7 N/m], rotation: [0, 3 N*m/rad, 0]}"
    forces = f"{{p: {{kind: bushing, between: [a_link, b_link], stiffness: {rates}}}}}"
    scene, _ = picture(xml, arrows=["forces"], at=0.5, forces=forces)
    [pair] = scene["pairs"]
    assert (pair["kind"], pair["a"]["node"], pair["b"]["node"]) == ("bushing", 1, 2)
    found = [(arrow["node"], arrow["moment"]) for arrow in scene["arrows"] if "vectors" in arrow]
    assert sorted(found) == [(1, False), (1, True), (2, False), (2, True)]


def test_loop_joints_are_marked_at_both_links(solved: Callable[..., Any], read: Callable[..., Any]) -> None:
    result = solved("crank_rocker_turning")
    scene = read(result.replay().html).scene
    [pair] = [pair for pair in scene["pairs"] if pair["kind"] == "loop"]
    assert pair["longest"] < 1e-9  # the loop is closed
    assert {"loop": True, "text": "loop joint"} in scene["legend"]


@pytest.mark.parametrize(
    ("name", "eye", "up"),
    [
        ("gen411_arm_vertical", [0, 0, 1], [0, 1, 0]),  # planar, seen along the axes, x to the right
        ("exoskeleton_leg_knee", [1, 0, 0], [0, 0, 1]),  # planar in y-z, y to the right
        ("handling_arm_c1", [0, 0, 1], [0, 0, 1]),  # horizontal: from above
        ("panda_quintic", None, [0, 0, 1]),
        ("gyroscope_free", None, [0, 0, 1]),
        ("unbalanced_rotor_free", None, None),  # one axis, but a long shaft: not from its end
    ],
)
def test_the_view(solved: Callable[..., Any], read: Callable[..., Any], name: str, eye: Any, up: Any) -> None:
    view = read(solved(name).replay().html).scene["view"]
    assert np.linalg.norm(view["eye"]) == pytest.approx(1.0)
    if eye is None:
        assert np.abs(view["eye"]).max() < 0.85
    else:
        assert 0.9 < np.dot(view["eye"], eye) < 0.99  # with a slight tilt, so that depth is seen
    if up is not None:
        assert view["up"] == pytest.approx(up)


def test_the_box_holds_the_whole_motion(solved: Callable[..., Any], read: Callable[..., Any]) -> None:
    """The tip of the arm at every row, and the ground it stands on."""
    result = solved("gen411_arm_static")
    view = read(result.replay().html).scene["view"]
    for axis, k in (("x", 0), ("y", 1)):
        tip = result[f"point.A.position.{axis}"].values
        assert view["low"][k] <= tip.min()
        assert view["high"][k] >= tip.max()
    assert view["low"][1] == pytest.approx(-0.02)  # the underside of its base
