"""The stick figure where the geometry has it; names that cover neither each other nor, where there is room, lines."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.use.facade import Result
from pinarm.use.show.bodies import placed
from pinarm.use.show.picture import COLOURS
from pinarm.use.show.scene import scene

ROOT = Path(pinarm.__file__).parents[1]
EXACT = 1e-12  # metres; sums of a few rounded numbers of size one


def solved(name: str) -> Result:
    return pinarm.run(ROOT / "scenarios" / f"{name}.yaml")


def ends(figure: Any, colour: str) -> set[tuple[float, float]]:
    """Ends of the lines of one colour, rounded to a picometre."""
    [axis] = figure.axes
    lines = [np.transpose(line.get_data()) for line in axis.lines if line.get_color() == colour]
    return {tuple(np.round(point, 12) + 0.0) for line in lines for point in line}


def test_the_arm_stands_where_its_publication_draws_it() -> None:
    """Moved vertically: theta from 0 to 60 degrees, phi = arccos(1 - cos theta)."""
    figure = solved("gen411_arm_vertical").sketch()
    for theta, colour in ((0.0, COLOURS[0]), (np.pi / 3, COLOURS[1])):
        phi = np.arccos(1 - np.cos(theta))
        elbow = np.array([0.25 * np.cos(theta), 0.5 + 0.25 * np.sin(theta)])
        hand = elbow + 0.25 * np.array([np.cos(phi), np.sin(phi)])
        wanted = {tuple(np.round(point, 12) + 0.0) for point in ([0.0, 0.5], elbow, hand)}
        assert ends(figure, colour) == wanted
    [axis] = figure.axes
    assert (axis.get_xlabel(), axis.get_ylabel(), axis.get_aspect()) == ("x [m]", "y [m]", 1.0)
    told = [text.get_text() for text in figure.legends[0].get_texts()]
    assert told == ["start: t = 0 s", "end: t = 0.04189 s"]


def test_a_loop_is_closed_in_the_picture() -> None:
    """Parallelogram ABFE: B and F hang on l = 2 m, 0.6 m apart."""
    result = solved("manipulator_raised")
    found = ends(result.sketch(), COLOURS[1])
    alpha = result["alpha"].values[-1]
    arm = 2.0 * np.array([np.cos(alpha), np.sin(alpha)])
    for corner in (np.zeros(2), np.array([0.0, 0.6]), arm, arm + np.array([0.0, 0.6])):
        assert min(np.hypot(*(point - corner)) for point in found) < EXACT


def test_a_spatial_mechanism_is_drawn_from_the_direction_of_its_replay() -> None:
    """Bricard's six links at the start: edges of a cube, projected here on the plane normal to that direction."""
    result = solved("bricard_falling")
    mechanism, q = result.trajectory.mechanism, result.trajectory.q
    framing = scene(mechanism, {}, q).framing
    right = np.cross(framing.up, framing.eye)
    right /= np.linalg.norm(right)
    drawn = ends(result.sketch(), COLOURS[0])
    for joint in placed(mechanism.model, q[:1])[0, 1:, :3, 3]:
        wanted = np.array([joint @ right, joint @ np.cross(framing.eye, right)])
        assert min(np.hypot(*(point - wanted)) for point in drawn) < EXACT


def texts_apart(figure: Any) -> list[str]:
    """Texts of a drawing; none of them may meet another, or leave the page, as matplotlib measures them."""
    figure.canvas.draw()
    [axis] = figure.axes
    boxes = [text.get_window_extent() for text in axis.texts]
    for k, one in enumerate(boxes):
        for other in boxes[:k]:
            assert (
                not one.overlaps(other)
                or min(min(one.x1, other.x1) - max(one.x0, other.x0), min(one.y1, other.y1) - max(one.y0, other.y0))
                < 2.0
            )  # pixels: widths of letters are estimated where they are placed
        assert one.x0 >= 0.0
        assert one.x1 <= figure.bbox.width
    return [text.get_text() for text in axis.texts]


def test_names_do_not_meet_and_stay_on_the_page() -> None:
    told = texts_apart(pinarm.explain(ROOT / "models" / "andrews" / "mechanism.yaml").sketch())
    assert len(told) > 5


def strands(figure: Any) -> list[np.ndarray]:
    """Lines of the first position, shape (n, 2)."""
    [axis] = figure.axes
    return [np.transpose(line.get_data()) for line in axis.lines if line.get_color() == COLOURS[0]]


@pytest.mark.parametrize(
    ("element", "corners"),
    [
        ("kind: point_spring, between: [A, B], stiffness: 5 N/m", (16,)),
        ("kind: point_spring, between: [A, B], force: -350 N, stiffness: 300 N/m", (5, 2)),  # a gas strut pushes
        ("kind: cable, through: [A, B], stiffness: 8 N/m, free_length: 0.2 m", (2,)),
    ],
)
def test_what_joins_two_points_ends_at_them(tmp_path: Path, element: str, corners: tuple[int, ...]) -> None:
    """Between A, which does not move, and B of a lever; what is drawn beside the line lies on both sides alike."""
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "m.yaml").write_text(
        "pinarm: 1\nplanar:\n  points: {C: [0, 0], A: [0.5 m, -0.4 m], B: [0.3 m, 0], E: [1 m, 0]}\n"
        "  ground: [C, A]\n  links: {lever: {points: [C, B, E], mass: 1 kg, centre: E, inertia: 1 kg*m^2}}\n"
        f"forces: {{strut: {{{element}}}}}\n"
    )
    one, two = np.array([0.5, -0.4]), np.array([0.3, 0.0])
    along = (two - one) / np.linalg.norm(two - one)
    across = np.array([-along[1], along[0]])
    lines = strands(pinarm.explain(tmp_path / "m.yaml").sketch())
    near = [line for line in lines if len(line) > 1 and np.abs((line - one) @ across).max() < 0.05]
    assert tuple(len(line) for line in near) == corners
    ways = [(line - one) @ along for line in near]
    assert min(way.min() for way in ways) == pytest.approx(0.0, abs=EXACT)
    assert max(way.max() for way in ways) == pytest.approx(np.linalg.norm(two - one), abs=EXACT)
    assert near[-1][-1] == pytest.approx(two, abs=EXACT)
    beside = (np.concatenate(near) - one) @ across
    assert beside.max() == pytest.approx(-beside.min(), abs=EXACT)


def test_a_roller_touches_the_outline_of_its_cam() -> None:
    """Wherever the cam stands, the nearest point of its outline is as far from the roller's centre as its radius."""
    result = solved("bottle_capper_turning")
    cam = next(one for one in result.trajectory.mechanism.constraints if one.kind == "cam")
    points = np.stack([(cam.contact.shape - cam.contact.origin) @ axis for axis in np.eye(3)[:2]])
    outline = points[0] + 1j * points[1]
    for share in (0.0, 0.1, 0.23, 0.5, 0.61, 0.9):
        row = int(share * (len(result) - 1))
        turned = outline * np.exp(1j * result["O"].values[row])
        centre = 1j * (0.06 + result["lift"].values[row])
        between = np.abs(np.diff(turned)).max()
        assert np.abs(turned - centre).min() == pytest.approx(0.015, abs=between**2 / 0.015)
    figure = result.sketch()
    [drawn] = [line for line in strands(figure) if len(line) == len(outline)]
    assert drawn == pytest.approx(points.T, abs=1e-12)


"""Points per unit: the side of a drawing of one unit."""
