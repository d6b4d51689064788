"""The view faces the plane of a mechanism, and the box holds its whole motion."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest


@pytest.mark.parametrize(
    ("name", "eye", "up"),
    [
        ("gen411_arm_vertical", [0, 0, 1], [0, 1, 0]),  # planar, seen along the axes, x to the right
        ("exoskeleton_leg_knee", [1, 0, 0], [0, 0, 1]),  # planar in y-z, y to the right
        ("handling_arm_c1", [0, 0, 1], [0, 0, 1]),  # horizontal: from above
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
