"""Scene of a drawing: stick figure, view and names, supports, floor with shadows, and the axes of the world."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.records import ValueRecord
from pinarm.use.result.presentation import Presentation
from pinarm.use.show.chart import Line, Marker, Note, Style, Window
from pinarm.use.show.replay.framing import Framing, View, framing
from pinarm.use.show.replay.names import Name, gathered, names_of
from pinarm.use.show.replay.overlays import BodyPoint, Connection, pairs
from pinarm.use.show.replay.sticks import sticks
from pinarm.use.show.replay.tracks import nodes_of, placed
from pinarm.use.show.stick_figure import Stick, StickFigure, slots, stick_figure

PATH, GROUND = "#8b949e", "#59595f"
"""Colours of paths, and of the ground."""


LINKS, THINNEST = 10.0, 0.35
"""Typical links along the extent above which lines and marks are drawn smaller, and their least relative size."""

FLOOR, SHADE = "#e9ecef", "#e1e4e8"
AXES = (("x", "#d6453d"), ("y", "#3a9d4a"), ("z", "#3569c9"))
"""Names and colours of the world's axes, as in the replay."""

TRIAD = 26.0
"""Length of the axes in the corner [points]."""

LETTER = 6.0
"""Half the size of their letters, with a margin [points]."""


class Scene(ValueRecord, frozen=True):
    """Contents of a drawing.

    Attributes:
        figure: Its sticks.
        guides: Rails and slots.
        pairs: Its springs, cylinders, bushings, rods, cables and loop joints.
        shortest: Least length of each of these [m].
        names: Names of its parts, points and joints.
        framing: Box of the motion, and direction of the view.
        view: Projection into the picture.
    """

    figure: StickFigure
    guides: Sequence[Stick]
    pairs: Sequence[Connection]
    shortest: Sequence[float]
    names: Sequence[Name]
    framing: Framing
    view: View

    @property
    def thickness(self) -> float:
        """Factor of the widths of lines and marks: less than 1 where the links are many and short."""
        lengths = sorted(float(np.linalg.norm(stick.points[-1])) for stick in self.figure.rods)
        typical = lengths[len(lengths) // 2] if lengths else self.framing.size
        return float(np.clip(LINKS * typical / self.framing.size, THINNEST, 1.0))

    def flat(self, place: Array, at: BodyPoint) -> Array:
        return self.view.flat(at.path(place[None]))[:, 0]


def scene_of(mechanism: Mechanism, forces: Mapping[str, ForceElement], q: Array, how: Presentation) -> Scene:
    """Return the scene of a motion through configurations, shape (rows, nq)."""
    model = mechanism.model
    nodes, places, joined = nodes_of(model, q), placed(model, q), pairs(mechanism, forces)
    figure, ends = stick_figure(mechanism, nodes, joined), [end for pair in joined for end in pair.ends]
    shapes = sticks(model, nodes, figure, range(len(nodes)))
    seen = framing(model, nodes, shapes, places, [end.path(places) for end in ends])
    names = gathered(names_of(mechanism, nodes, how), places, seen.size)
    shortest = [float(pair.lengths(places).min()) for pair in joined]
    guides = [*figure.rails, *slots(mechanism, seen, places)]
    return Scene(figure, guides, joined, shortest, names, seen, seen.view())


def stroke(points: Array, colour: str, width: float, style: Style = "-") -> Line:
    """Return a line through points of the picture, shape (2, n)."""
    return Line(points[0], points[1], colour, width, style)


def mark(point: Array, colour: str, size: float, marker: Marker = "o") -> Line:
    """Return a white mark at a point of the picture, shape (2,)."""
    return Line(point[:1], point[1:], colour, 1.5, "", marker, size, "#ffffff")


def mounts(scene: Scene) -> Iterator[Line]:
    """Yield the supports of the mechanism; in space also their heights above the floor."""
    places = np.array(scene.figure.mounts).reshape(-1, 3)
    if not len(places):
        return
    points = scene.view.flat(places)
    if scene.framing.normal is None:
        for mount, foot in zip(places, _on_floor(scene, places), strict=True):
            yield stroke(scene.view.flat(np.array([mount, foot])), GROUND, 0.5)
    yield Line(points[0], points[1], GROUND, style="", marker="mount", size=14.0 * scene.thickness)


def floor(scene: Scene) -> Iterator[Line]:
    """Yield a grid below the lowest point, in perspective."""
    seen = scene.framing
    up, across, along = _floor_axes(seen)
    level = float((seen.outline @ up).min())
    cell = _round(seen.size / 10.0)
    spans = [np.arange(np.floor((seen.outline @ axis).min() / cell), np.ceil((seen.outline @ axis).max() / cell) + 1)
             * cell for axis in (across, along)]  # fmt: skip
    for axis, other, own, width in ((across, along, *spans), (along, across, *reversed(spans))):
        for at in own:
            ends = level * up + at * axis + np.outer(width[[0, -1]], other)
            yield stroke(scene.view.flat(ends), FLOOR, 0.6)


def shadow(scene: Scene, place: Array) -> Iterator[Line]:
    """Yield the shadows of a position on the floor."""
    for stick in scene.figure.lines:
        points = stick.points @ place[stick.node, :3, :3].T + place[stick.node, :3, 3]
        yield stroke(scene.view.flat(_on_floor(scene, points)), SHADE, 1.6 * stick.weight)


def _on_floor(scene: Scene, points: Array) -> Array:
    """Return points of the world below others, at the height of the lowest point, shape (n, 3)."""
    up = scene.framing.up
    return np.asarray(points - np.outer(points @ up - float((scene.framing.outline @ up).min()), up))


def _floor_axes(seen: Framing) -> tuple[Array, Array, Array]:
    """Return the upward and two horizontal directions, along axes of the world where these are horizontal."""
    level = np.eye(3)[int(np.abs(seen.up).argmin())]
    level = level - (level @ seen.up) * seen.up
    level /= np.linalg.norm(level)
    return seen.up, level, np.cross(seen.up, level)


def _round(x: float) -> float:
    """Return the number 1, 2 or 5 times a power of ten next above another."""
    power = 10.0 ** np.floor(np.log10(x))
    return float(next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= 0.999 * x))


def triad(scene: Scene, window: Window, per: float) -> tuple[list[Line], list[Note], list[Array]]:
    """Return the world's axes, in the lower left corner, their names, and the box of both (left, bottom, right, top).

    Args:
        scene: What is drawn.
        window: Ends of the axes of the drawing.
        per: Scale of the drawing [points per unit of the axes].
    """
    length, low = TRIAD / per, np.array([window[0][0], window[1][0]])
    reach = 1.35 * length * np.array([scene.view.axes @ axis for axis in np.eye(3)])
    edge = LETTER / per
    corner = low + edge - np.minimum(reach.min(axis=0), 0.0)
    drawn, letters = [], []
    for (name, colour), end in zip(AXES, reach, strict=True):
        drawn.append(stroke(np.array([corner, corner + end / 1.35]).T, colour, 1.8))
        letters.append(Note(float(corner[0] + end[0]), float(corner[1] + end[1]), name, colour=colour, size=9.0))
    high = corner + np.maximum(reach.max(axis=0), 0.0) + edge
    return drawn, letters, [np.concatenate([low, high])]
