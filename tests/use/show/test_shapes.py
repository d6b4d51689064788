"""What a model's file draws is drawn as it says, or told."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

VISUAL = '<visual>{origin}<geometry>{shape}</geometry><material name="m"><color rgba="{rgba}"/></material></visual>'


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


@pytest.mark.parametrize("file", ["../../../etc/passwd", "/etc/passwd", "http://a/b.stl", "no.stl"])
def test_a_mesh_elsewhere_is_not_read_and_the_body_is_a_stick(
    picture: Callable[..., Any], chain: Callable[..., str], file: str
) -> None:
    visual = VISUAL.format(origin="", shape=f'<mesh filename="{file}"/>', rgba="1 1 1 1")
    xml = chain({"name": "a", "com": "0 0 -1"}).replace('<link name="a_link">', f'<link name="a_link">{visual}')
    scene, [note] = picture(xml)
    assert note.startswith("link a_link is not drawn as its file says")
    assert {shape["kind"] for shape in scene["shapes"] if shape["node"] == 1} == {"cylinder", "sphere"}
