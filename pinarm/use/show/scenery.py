"""What a drawing shows beside the mechanism: what it stands on, a floor with shadows, and the axes of the world."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinarm.arrays import Array
from pinarm.use.show.chart import Line, Note, Window
from pinarm.use.show.replay.framing import Framing
from pinarm.use.show.scene import GROUND, Scene, stroke

FLOOR, SHADE = "#e9ecef", "#e1e4e8"
AXES = (("x", "#d6453d"), ("y", "#3a9d4a"), ("z", "#3569c9"))
"""Names and colours of the world's axes, as in the replay."""

TRIAD = 26.0
"""Length of the axes in the corner [points]."""

LETTER = 6.0
"""Half the size of their letters, with what is around them [points]."""


def mounts(scene: Scene) -> Iterator[Line]:
    """Yield what the mechanism stands on; in space also how high that is."""
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
    up, one, two = _floor_axes(seen)
    level = float((seen.outline @ up).min())
    cell = _round(seen.size / 10.0)
    spans = [np.arange(np.floor((seen.outline @ axis).min() / cell), np.ceil((seen.outline @ axis).max() / cell) + 1)
             * cell for axis in (one, two)]  # fmt: skip
    for axis, other, own, across in ((one, two, *spans), (two, one, *reversed(spans))):
        for at in own:
            ends = level * up + at * axis + np.outer(across[[0, -1]], other)
            yield stroke(scene.view.flat(ends), FLOOR, 0.6)


def shadow(scene: Scene, place: Array) -> Iterator[Line]:
    """Yield what the sticks of a position throw on the floor."""
    for stick in scene.figure.lines:
        points = stick.points @ place[stick.node, :3, :3].T + place[stick.node, :3, 3]
        yield stroke(scene.view.flat(_on_floor(scene, points)), SHADE, 1.6 * stick.weight)


def _on_floor(scene: Scene, points: Array) -> Array:
    """Return points of the world below others, at the height of the lowest point, shape (n, 3)."""
    up = scene.framing.up
    return np.asarray(points - np.outer(points @ up - float((scene.framing.outline @ up).min()), up))


def _floor_axes(seen: Framing) -> tuple[Array, Array, Array]:
    """Return what is up, and two horizontal directions, along axes of the world where these are horizontal."""
    one = np.eye(3)[int(np.abs(seen.up).argmin())]
    one = one - (one @ seen.up) * seen.up
    one /= np.linalg.norm(one)
    return seen.up, one, np.cross(seen.up, one)


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
