"""COLLADA files: nodes in nodes, units, colours, and scenes without end."""

from pathlib import Path

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.input.roots import example_robot_data
from pinarm.use.show.replay.meshes import read_mesh

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
