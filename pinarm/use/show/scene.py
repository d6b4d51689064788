"""What a drawing shows of a mechanism, and how points of it come into the picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.records import ValueRecord
from pinarm.use.result.presentation import Presentation
from pinarm.use.show.chart import Line, Marker, Style
from pinarm.use.show.replay.framing import Framing, View, framing
from pinarm.use.show.replay.names import Name, gathered, names_of
from pinarm.use.show.replay.overlays import BodyPoint, Connection, pairs
from pinarm.use.show.replay.sticks import sticks
from pinarm.use.show.replay.tracks import nodes_of, placed
from pinarm.use.show.stick_figure import Stick, StickFigure, slots, stick_figure

PATH, GROUND = "#8b949e", "#59595f"
"""Colours of paths, and of what does not move."""


LINKS, THINNEST = 10.0, 0.35
"""Typical links along the extent from which on lines and marks are drawn smaller, and how much smaller at most."""


class Scene(ValueRecord, frozen=True):
    """What a sketch shows of a mechanism.

    Attributes:
        figure: Its sticks.
        guides: Rails and slots.
        pairs: Springs, cylinders, bushings, rods, cables and loop joints.
        shortest: Least length of each of these [m].
        names: What its parts, points and joints are called.
        framing: The box of the motion, and from where it is seen.
        view: How it comes into the picture.
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
        """By what the widths of lines and marks are multiplied: less than 1 where the links are many and short."""
        lengths = sorted(float(np.linalg.norm(stick.points[-1])) for stick in self.figure.rods)
        typical = lengths[len(lengths) // 2] if lengths else self.framing.size
        return float(np.clip(LINKS * typical / self.framing.size, THINNEST, 1.0))

    def flat(self, place: Array, at: BodyPoint) -> Array:
        """Return where a point of a body is in the picture, shape (2,)."""
        return self.view.flat(at.path(place[None]))[:, 0]


def scene_of(mechanism: Mechanism, forces: Mapping[str, ForceElement], q: Array, how: Presentation) -> Scene:
    """Return what is drawn of a motion through configurations, shape (rows, nq)."""
    model = mechanism.model
    nodes, places, joined = nodes_of(model, q), placed(model, q), pairs(mechanism, forces)
    figure, ends = stick_figure(mechanism, nodes, joined), [end for pair in joined for end in pair.ends]
    shapes = sticks(model, nodes, figure, range(len(nodes)))
    seen = framing(model, nodes, shapes, places, [end.path(places) for end in ends])
    names = gathered(names_of(mechanism, nodes, how), places, seen.size)
    shortest = [float(pair.lengths(places).min()) for pair in joined]
    guides = [*figure.rails, *slots(mechanism, seen, places)]
    return Scene(figure, guides, joined, shortest, names, seen, seen.view())


def stroke(points: Array, colour: str, width: float, style: Style = "-", opacity: float = 1.0) -> Line:
    """Return a line through points of the picture, shape (2, n)."""
    return Line(points[0], points[1], colour, width, style, opacity=opacity)


def mark(point: Array, colour: str, size: float, marker: Marker = "o") -> Line:
    """Return a white mark at a point of the picture, shape (2,)."""
    return Line(point[:1], point[1:], colour, 1.5, "", marker, size, "#ffffff")
