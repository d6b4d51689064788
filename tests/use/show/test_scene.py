"""Names of parts, points and joints, one for all in one place; the view, and the box of the whole motion."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.use.result.presentation import Presentation
from pinarm.use.show.scene import names_of, scene

ROOT = Path(__file__).parents[3]


def found(result: Any, how: Presentation | None = None) -> dict[str, tuple[str, np.ndarray]]:
    """Names of a run: text -> kind, and the place at the start."""
    mechanism = result.trajectory.mechanism
    shown = scene(mechanism, {}, result.trajectory.q)
    names = names_of(mechanism, shown, how or Presentation())
    return {name.text: (name.kind, name.at.path(shown.places)[0]) for name in names}


def test_a_slider_crank_has_the_names_of_its_file(solved: Callable[..., Any]) -> None:
    """Crank of 45 mm along x, rod of 145 mm: O, A and B on a line."""
    known = found(solved("slider_crank_gas"))
    kinds = {text: kind for text, (kind, _) in known.items()}
    assert kinds == {"crank": "part", "rod": "part", "piston": "part", r"O, $\theta$": "point", "$G_{3}$": "point",
                     "$B_{3}$, B, x": "point", "A": "point"}  # fmt: skip
    for text, x in ((r"O, $\theta$", 0.0), ("A", 0.045), ("$B_{3}$, B, x", 0.19), ("$G_{3}$", 0.09), ("crank", 0.0225)):
        assert known[text][1] == pytest.approx([x, 0.0, 0.0], abs=1e-12)


def test_points_that_meet_for_an_instant_keep_their_own_names(solved: Callable[..., Any]) -> None:
    """Of the points of Andrews' mechanism only the four at P stay together."""
    known = found(solved("andrews_squeezing"))
    together = [text for text in known if text.startswith("P, $P_{3}$, $P_{4}$, $P_{6}$")]
    assert len(together) == 1
    assert together[0].endswith(", ...")  # with the loop joints there are more than a picture should say
    assert sum(text.partition(",")[0] in ("C", "D") for text in known) == 2


def test_a_point_of_a_drawing_has_its_name_once(tmp_path: Path) -> None:
    """A pin is one point of the drawing, though each of its two links has a mark of it; the ground is hatched."""
    folder = ROOT / "docs/kind_examples/problems"
    shutil.copy(folder / "kinematics.yaml", tmp_path)
    drawing = re.sub(r"\bA\b", "A2", (folder / "four_bar.yaml").read_text())
    (tmp_path / "four_bar.yaml").write_text(drawing)
    known = found(pinarm.run(tmp_path / "kinematics.yaml"))
    assert {text for text, (kind, _) in known.items() if kind != "part"} == {"O", "$A_{2}$", "B", "C"}


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
