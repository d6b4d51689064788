"""Scene of a moving mechanism, for drawings and replays: bodies, stick figure, solids, connections, view, names."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, ValueRecord, replace
from pinarm.use.result.presentation import Presentation
from pinarm.use.show.bodies import BodyPoint, Node, connections, nodes_of, placed, point_of
from pinarm.use.show.framing import Framing, framing
from pinarm.use.show.labels import name_label, plain
from pinarm.use.show.shapes import Shape, Visuals
from pinarm.use.show.stick_figure import Stick, StickFigure, reaches, slots, stick_figure

TOGETHER = 1e-6
"""Distance of two points, relative to the extent, up to which they are in one place."""

MOST = 4
"""Names that are shown at one place."""

SERIES = 12
"""Names that differ in their numbers only, such as ``link_1`` and ``link_2``, up to which all of them are shown."""

_NUMBER = re.compile(r"\d+")

Kind = Literal["part", "point", "joint"]


class Name(ValueRecord, frozen=True):
    """A name at a point of a body.

    Attributes:
        text: A label, see ``labels``.
        kind: Whether it names a body, a point on a body, or a joint.
        at: Its place.
    """

    text: str
    kind: Kind
    at: BodyPoint


class Scene(Record, frozen=True):
    """A mechanism in motion, as it is drawn.

    Attributes:
        nodes: Its bodies.
        places: Their placements at some rows of the motion, shape (samples, njoints, 4, 4).
        figure: Its stick figure.
        shapes: Its solids: visuals of the model's file, and those of the stick figure for bodies without any.
        framing: Box of the motion, and direction of the view.
        slots: Outlines of the slots of a mechanism that is seen flat.
    """

    nodes: Sequence[Node]
    places: Array
    figure: StickFigure
    shapes: Sequence[Shape]
    framing: Framing
    slots: Sequence[Stick]


def scene(
    mechanism: Mechanism,
    forces: Mapping[str, ForceElement],
    q: Array,
    visuals: Visuals | None = None,
    further: Sequence[BodyPoint] = (),
) -> Scene:
    """Return the scene of a motion.

    Args:
        mechanism: The mechanism.
        forces: Its force elements, of which springs and cables are drawn.
        q: Configurations, shape (rows, nq).
        visuals: Of its model; none for a stick figure of all bodies.
        further: Points to be in sight.
    """
    model = mechanism.model
    drawn = visuals or Visuals((), frozenset(range(model.njoints)))
    nodes, places, joined = nodes_of(model, q), placed(model, q), connections(mechanism, forces)
    figure = stick_figure(mechanism, nodes, joined)
    shapes = [*drawn.shapes, *figure.solids(np.asarray(model.gravity.linear), drawn.bare)]
    points = [*(end for pair in joined for end in pair.ends), *further]
    seen = framing(model, nodes, shapes, places, [point.path(places) for point in points])
    return Scene(nodes, places, figure, shapes, seen, slots(mechanism, seen.normal, seen.size, places))


def names_of(mechanism: Mechanism, shown: Scene, how: Presentation) -> list[Name]:
    """Return the names of links, points and joints, one for all that stay in one place, points and joints first.

    A link with a mass or a shape is a part, any other a point. A part's name is in the middle of its longest stick,
    away from its joints; the ground has no such name. Of long series the first and the last remain.
    """
    names = _ends_of_series(list(_all_names(mechanism, shown.nodes, how)))
    groups: list[tuple[Array, list[Name]]] = []
    for name in sorted(names, key=lambda name: ("part", "point", "joint").index(name.kind)):
        path = name.at.path(shown.places)
        near = (group for there, group in groups if np.abs(there - path).max() < TOGETHER * shown.framing.size)
        group = next((group for group in near if (group[0].kind == "part") == (name.kind == "part")), None)
        if group is None:
            groups.append((path, [name]))
        elif name.text not in [known.text for known in group]:
            group.append(name)
    return sorted((_as_one(group) for _, group in groups), key=lambda name: name.kind == "part")


def _all_names(mechanism: Mechanism, nodes: Sequence[Node], how: Presentation) -> Iterator[Name]:
    from pinarm.mechanics.planar.drawing import GROUND

    model, reached = mechanism.model, reaches(mechanism.model, nodes)
    frames = {frame.name: k for k, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY}
    for link in ElementTree.fromstring(mechanism.xml).findall("link"):
        name = str(link.get("name"))
        at = point_of(model, frames.pop(name))
        if link.find("inertial") is None and link.find("visual") is None:
            if at.node or name != GROUND:  # the ground of a drawing is seen by its mounts
                yield Name(plain(name), "point", at)
        elif at.node:
            yield Name(plain(name), "part", _middle(model, reached[at.node], at))
    for name, frame in frames.items():  # points of the mechanism file, and the frame of the world
        at = point_of(model, frame)
        if at.node or at.place.any():
            yield Name(plain(name), "point", at)
    for index in range(1, model.njoints):
        if nodes[index].carries:
            yield Name(name_label(model.names[index], how), "joint", BodyPoint(index, np.zeros(3)))
    for joint in mechanism.constraints:
        if isinstance(joint, LoopJoint):
            yield Name(plain(joint.name), "joint", point_of(model, joint.second))


def _ends_of_series(names: Sequence[Name]) -> list[Name]:
    """Return names without those in between of series of more than ``SERIES``.

    A series has one kind, and names that differ in their numbers only; their order is that of the numbers.
    """
    series: dict[tuple[Kind, str], list[Name]] = defaultdict(list)
    for name in names:
        series[name.kind, _NUMBER.sub("#", name.text)].append(name)
    between = set[int]()
    for members in series.values():
        if len(members) > SERIES:
            members.sort(key=lambda name: [int(number) for number in _NUMBER.findall(name.text)])
            between |= {id(name) for name in members[1:-1]}
    return [name for name in names if id(name) not in between]


def _middle(model: pin.Model, reached: Array, origin: BodyPoint) -> BodyPoint:
    """Return the middle of the longest stick of a link, from its origin to the points that its body reaches."""
    ends = reached - origin.place
    if not len(ends):
        return BodyPoint(origin.node, np.asarray(model.inertias[origin.node].lever))
    return BodyPoint(origin.node, origin.place + 0.5 * ends[int(np.linalg.norm(ends, axis=1).argmax())])


def _as_one(group: Sequence[Name]) -> Name:
    """Return names at one place as one, without ``O_crank`` beside O, which is that point of a drawing on a link."""
    texts = [name.text for name in group]
    apart = [text for text in texts if not any(text.startswith(f"{other}_") for other in texts)]
    return replace(group[0], text=", ".join(apart[:MOST]) + (", ..." if len(apart) > MOST else ""))
