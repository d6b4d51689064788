"""COLLADA files: nodes in nodes, units, colours, and scenes without end."""

from pathlib import Path

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.input.roots import example_robot_data
from pinarm.use.show.replay.meshes import read_mesh

from .test_meshes import volume

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
