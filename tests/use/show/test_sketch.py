"""The stick figure: points where the geometry has them, in the plane of the mechanism."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.use.result.result import Result
from pinarm.use.show.plot import COLOURS

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
