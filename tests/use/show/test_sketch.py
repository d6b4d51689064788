"""The stick figure: points where the geometry has them, in the plane of the mechanism."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.use.result.result import Result
from pinarm.use.show.chart import COLOURS
from pinarm.use.show.replay.framing import Camera, framing
from pinarm.use.show.replay.sticks import sticks
from pinarm.use.show.replay.tracks import nodes_of, placed

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


def test_the_path_of_its_end_is_drawn() -> None:
    """It rises along x = l, as the law says."""
    [axis] = solved("gen411_arm_vertical").sketch().axes
    [path] = [np.array(line.get_data()) for line in axis.lines if line.get_linestyle() == ":"]
    assert path[0] == pytest.approx(np.full(path.shape[1], 0.25), abs=1e-9)  # solved to that
    assert path[1, [0, -1]] == pytest.approx([0.75, 0.5 + 0.5 * np.sin(np.pi / 3)], abs=1e-9)


@pytest.mark.parametrize(
    ("name", "labels"),
    [
        ("exoskeleton_leg_knee", ("y [m]", "z [m]")),
        ("handling_arm_c1", ("x [m]", "y [m]")),  # from above
        ("gyroscope_precession", ("", "")),  # not planar
    ],
)
def test_planar_mechanisms_are_seen_flat(name: str, labels: tuple[str, str]) -> None:
    [axis] = solved(name).sketch().axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == labels
    assert axis.axison == bool(labels[0])
    assert {text.get_text() for text in axis.texts} >= {"x", "y", "z"} or bool(labels[0])  # the axes of the world


def test_a_loop_is_closed_in_the_picture() -> None:
    """Parallelogram ABFE: B and F hang on l = 2 m, 0.6 m apart."""
    result = solved("manipulator_raised")
    found = ends(result.sketch(), COLOURS[1])
    alpha = result["alpha"].values[-1]
    arm = 2.0 * np.array([np.cos(alpha), np.sin(alpha)])
    for corner in (np.zeros(2), np.array([0.0, 0.6]), arm, arm + np.array([0.0, 0.6])):
        assert min(np.hypot(*(point - corner)) for point in found) < EXACT


def test_equilibria_are_drawn_alike(scenario: Callable[..., Any]) -> None:
    figure = scenario("equilibria").run().sketch()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["row 1", "row 2"]
    hanging, standing = (ends(figure, COLOURS[k]) for k in (0, 1))
    assert hanging == {(0.0, 0.0), (0.0, -1.0)}
    assert standing == {(0.0, 0.0), (0.0, 1.0)}
    four = solved("gen411_arm_equilibria").sketch()
    assert [text.get_text() for text in four.legends[0].get_texts()] == [f"row {k}" for k in (1, 2, 3, 4)]


def test_a_body_in_one_place_is_the_box_of_its_inertia() -> None:
    """A brick: twelve edges at the start."""
    [axis] = solved("brick_thrown").sketch().axes
    assert len([line for line in axis.lines if line.get_color() == COLOURS[0] and len(line.get_xdata()) == 2]) == 12


def names(figure: Any) -> dict[str, list[tuple[float, float]]]:
    """Texts in a drawing, and the points that they stand at."""
    [axis] = figure.axes
    found: dict[str, list[tuple[float, float]]] = {}
    for text in axis.texts:
        found.setdefault(text.get_text(), []).append(tuple(np.round(text.xy, 9) + 0.0))
    return found


def test_names_stand_at_their_points_at_start_and_end() -> None:
    """The two-rod arm turns by theta from 0 to 60 degrees: its elbow B goes along a circle about O."""
    found = names(solved("gen411_arm_vertical").sketch())
    assert found["O"] == [(0.0, 0.5)]  # which does not move, and is named once
    elbows = [(0.25 * np.cos(theta), 0.5 + 0.25 * np.sin(theta)) for theta in (0.0, np.pi / 3)]
    assert np.array(found["B"]) == pytest.approx(np.array(elbows), abs=1e-8)


def test_a_full_turn_is_drawn_once() -> None:
    """Two turns of a crank end where they began: both instants stand at one position."""
    figure = solved("slider_crank_gas").sketch()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["start: t = 0 s, end: t = 0.04 s"]


def test_a_spatial_mechanism_is_drawn_by_the_camera_of_its_replay() -> None:
    """Bricard's six links at the start: edges of a cube, projected here by the rule for a pinhole, eye and target."""
    result = solved("bricard_falling")
    model, q = result.trajectory.mechanism.model, result.trajectory.q
    nodes = nodes_of(model, q)
    seen = framing(model, nodes, sticks(model, nodes, range(len(nodes))), placed(model, q), [])
    camera = seen.view()
    assert isinstance(camera, Camera)
    found = ends(result.sketch(), COLOURS[0])
    distance = np.linalg.norm(camera.eye - camera.centre)
    right, up = camera.axes
    for joint in placed(model, q[:1])[0, 1:, :3, 3]:
        ray = joint - camera.eye
        wanted = distance * np.array([ray @ right, ray @ up]) / (ray @ (camera.centre - camera.eye) / distance)
        assert min(np.hypot(*(point - wanted)) for point in found) < EXACT


def test_wheels_are_circles_of_their_pitch_radii() -> None:
    """Planetary gear: the planet's centre runs at the sum of the radii of sun and planet."""
    figure = solved("planetary_gear_reducer").sketch()
    [axis] = figure.axes
    circles = [np.array(line.get_data()) for line in axis.lines if len(line.get_xdata()) > 50
               and line.get_color() == COLOURS[0]]  # fmt: skip
    radii = sorted(np.ptp(circle[0]) / 2 for circle in circles)
    planet, sun, ring = radii
    assert ring == pytest.approx(sun + 2 * planet, rel=1e-9)  # the condition of assembly on one axis
    [centre] = [circle.mean(axis=1) for circle in circles if abs(np.ptp(circle[0]) / 2 - planet) < 1e-9]
    assert np.hypot(*centre) == pytest.approx(sun + planet, rel=0.02)  # the first point of the rim is there twice
