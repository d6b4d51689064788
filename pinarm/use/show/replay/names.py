"""Names in a picture: links, points on them, joints of the tree, and joints that close loops."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Literal
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import ValueRecord, replace
from pinarm.use.result.presentation import Presentation
from pinarm.use.show.labels import name_label, plain
from pinarm.use.show.replay.overlays import BodyPoint, point_of
from pinarm.use.show.replay.tracks import Node
from pinarm.use.show.stick_figure import reaches

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


def names_of(mechanism: Mechanism, nodes: Sequence[Node], how: Presentation) -> list[Name]:
    """Return the names of links, points and joints; of long series the first and the last, see ``ends_of_series``.

    A link with a mass or a shape is a part, any other a point. A part's name is in the middle of its longest
    stick, away from its joints; the ground has no such name.

    Args:
        mechanism: The mechanism.
        nodes: Its bodies.
        how: Labels of the scenario.
    """
    return ends_of_series(list(_all_names(mechanism, nodes, how)))


def _all_names(mechanism: Mechanism, nodes: Sequence[Node], how: Presentation) -> Iterator[Name]:
    from pinarm.mechanics.planar.drawing import GROUND

    model, reached = mechanism.model, reaches(mechanism.model, nodes)
    frames = {frame.name: k for k, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY}
    for link in ElementTree.fromstring(mechanism.xml).findall("link"):
        name = str(link.get("name"))
        at = point_of(model, frames[name])
        if link.find("inertial") is None and link.find("visual") is None:
            if at.node or name != GROUND:  # the ground of a drawing is seen by its mounts
                yield Name(plain(name), "point", at)
        elif at.node:
            yield Name(plain(name), "part", _middle(model, reached[at.node], at))
        del frames[name]
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


def ends_of_series(names: Sequence[Name]) -> list[Name]:
    """Return names without those in between of long series: of more than ``SERIES`` the first and the last remain.

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


def gathered(names: Sequence[Name], places: Array, size: float) -> list[Name]:
    """Return names that stand in one place during the whole motion as one, points before joints.

    Args:
        names: The names.
        places: Placements of the bodies at rows of the motion, shape (rows, njoints, 4, 4).
        size: Extent of the picture [m].
    """
    groups: list[tuple[Array, list[Name]]] = []
    for name in sorted(names, key=lambda name: ("part", "point", "joint").index(name.kind)):
        path = name.at.path(places)
        near = (group for there, group in groups if np.abs(there - path).max() < TOGETHER * size)
        group = next((group for group in near if (group[0].kind == "part") == (name.kind == "part")), None)
        if group is None:
            groups.append((path, [name]))
        elif name.text not in [known.text for known in group]:
            group.append(name)
    return [_as_one(group) for _, group in groups]


def _as_one(group: Sequence[Name]) -> Name:
    """Return names at one place as one, without ``O_crank`` beside O, which is that point of a drawing on a link."""
    texts = [name.text for name in group]
    own = [text for text in texts if not any(text.startswith(f"{other}_") for other in texts)]
    return replace(group[0], text=", ".join(own[:MOST]) + (", ..." if len(own) > MOST else ""))
