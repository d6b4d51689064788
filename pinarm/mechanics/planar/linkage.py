"""From a drawing to a tree of links and the joints that close loops.

Slides are part of the tree wherever they form no circle by themselves, so that their ways are coordinates; pins follow
breadth first from the ground. What is left closes loops.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.mechanics.planar.drawing import GROUND, PlanarDrawing
from pinarm.records import Record, replace


class DrawnJoint(Record, frozen=True):
    """A pin or a slide between two bodies.

    Attributes:
        name: Its name.
        first: The body that carries in the tree, or comes first in the file.
        second: The other body.
        point: Name of the point where it is in the drawing.
        direction: Direction of a slide in the drawing, that of its coordinate, shape (2,); ``None`` for a pin.
    """

    name: str
    first: str
    second: str
    point: str
    direction: Array | None = None

    def reversed(self) -> DrawnJoint:
        """Return it with the bodies exchanged, its coordinate being the same way or angle of a slide."""
        turned = None if self.direction is None else -self.direction
        return replace(self, first=self.second, second=self.first, direction=turned)


class Linkage(Record, frozen=True):
    """The connections of a drawing.

    Attributes:
        tree: Those that carry links, from the ground outwards; the second body of each hangs on the first.
        closing: Those that close loops.
    """

    tree: Sequence[DrawnJoint]
    closing: Sequence[DrawnJoint]

    @classmethod
    def of(cls, drawing: PlanarDrawing) -> Linkage:
        """Find the tree.

        Raises:
            InputError: Two bodies are joined twice, or a link hangs on nothing.
        """
        _check_single(drawing)
        slides, pins = [*_slides(drawing)], [*_pins(drawing)]
        tree = _tree(slides, pins)
        carried = {connection.name for connection in tree}
        for name in drawing.links.keys() - {connection.second for connection in tree}:
            with within("links", name):
                raise InputError(
                    f"the link '{name}' hangs on nothing: no pins and slides lead from it to the ground",
                    expected="a point that another link or the ground carries too, or a slide",
                    hint="of a link that only slots hold: a block without mass on a slide, pinned to the link",
                )
        return cls(tree, [one for one in [*slides, *pins] if one.name not in carried])


def direction(drawing: PlanarDrawing, along: tuple[str, str]) -> Array:
    """Return the unit vector from the first of two points to the second, shape (2,)."""
    first, second = (np.array(drawing.points[point], float) for point in along)
    way = second - first
    return np.asarray(way / np.hypot(*way))


def _slides(drawing: PlanarDrawing) -> Iterator[DrawnJoint]:
    for name, slider in drawing.sliders.items():
        point = drawing.links[slider.link].points[0]
        yield DrawnJoint(name, slider.on, slider.link, point, direction(drawing, slider.along))


def _pins(drawing: PlanarDrawing) -> Iterator[DrawnJoint]:
    """Yield the pins; where more than two bodies meet, the first carries all others."""
    for point in drawing.points:
        first, *others = drawing.carriers(point) or [GROUND]
        for other in others:
            yield DrawnJoint(point if len(others) == 1 else f"{point}_{other}", first, other, point)


def _check_single(drawing: PlanarDrawing) -> None:
    """Refuse two pins, two slides, or a pin and a slide, of the same two bodies: they would be one rigid body.

    Raises:
        InputError: There are two.
    """
    seen: dict[frozenset[str], str] = {}
    joined = [(name, (slider.on, slider.link)) for name, slider in drawing.sliders.items()]
    joined += [(point, pair) for point in drawing.points for pair in combinations(drawing.carriers(point), 2)]
    for name, (first, second) in joined:
        if (before := seen.setdefault(frozenset((first, second)), name)) != name:
            with within("links", second if second != GROUND else first):
                raise InputError(
                    f"{first} and {second} are joined twice, by {before} and {name}: they are one body",
                    expected="one pin or slide between two bodies", hint="one link in place of both",
                )  # fmt: skip


def _tree(slides: Sequence[DrawnJoint], pins: Sequence[DrawnJoint]) -> list[DrawnJoint]:
    """Return the connections that reach further links, from the ground on."""
    reached = {GROUND}
    sliding = _sliding(slides, GROUND, reached)
    tree, waiting = [*sliding], [(GROUND, sliding)]
    for body, slid in waiting:  # which grows while it is gone through: breadth first
        for pin in _outwards(pins, body, reached):
            sliding = _sliding(slides, pin.second, reached)
            tree += [pin, *sliding]
            waiting.append((pin.second, sliding))
        waiting += [(slide.second, []) for slide in slid]
    return tree


def _sliding(slides: Sequence[DrawnJoint], body: str, reached: set[str]) -> list[DrawnJoint]:
    """Return the slides that lead from a body to further ones, one after another."""
    bodies, found = [body], []
    for each in bodies:
        for one in _outwards(slides, each, reached):
            found.append(one)
            bodies.append(one.second)
    return found


def _outwards(connections: Sequence[DrawnJoint], body: str, reached: set[str]) -> Iterator[DrawnJoint]:
    """Yield the connections of a body with bodies that are not reached yet, and count these as reached."""
    for connection in connections:
        one = connection if connection.first == body else connection.reversed()
        if one.first == body and one.second not in reached:
            reached.add(one.second)
            yield one
