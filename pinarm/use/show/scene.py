"""Scene of a moving mechanism, for drawings and replays: bodies, stick figure, solids, connections, view, names."""

from __future__ import annotations

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
from pinarm.use.show.labels import name_label, plain
from pinarm.use.show.shapes import Shape, Visuals
from pinarm.use.show.stick_figure import Stick, StickFigure, reaches, slots, stick_figure

PARALLEL = 1e-6
"""Sine of the angle up to which two axes are parallel."""

DIRECTIONS, GOLDEN = 80, np.pi * (1.0 + np.sqrt(5.0))
"""Number of points that describe the extent, and the turn from one of their directions to the next."""

ABOVE = 0.99
"""Cosine of the angle to the vertical above which a view is one from above."""

FLAT = 0.7
"""Depth of a planar mechanism, relative to its extent in the plane, up to which it is seen along its axes."""


class Framing(ValueRecord, frozen=True):
    """The box of the whole motion and the view on it, in world axes.

    Attributes:
        up: Against gravity; z where there is none. Shape (3,).
        eye: Direction from the mechanism to the eye, shape (3,).
        normal: The direction from which a planar mechanism is seen flat, shape (3,); none for others.
        low: Lower corner [m], shape (3,).
        high: Upper corner [m], shape (3,).
        outline: Its points that reach farthest in all directions [m], shape (k, 3).
    """

    up: Array
    eye: Array
    normal: Array | None
    low: Array
    high: Array
    outline: Array

    @property
    def size(self) -> float:
        return float(np.linalg.norm(self.high - self.low)) or 1.0

    @property
    def axes(self) -> Array:
        """Right and up in a drawing: along the axes of a planar mechanism, else as the replay looks, shape (2, 3)."""
        towards = self.eye if self.normal is None else self.normal
        up = _upwards(towards, self.up)
        return np.array([np.cross(up, towards), up])


def framing(
    model: pin.Model, nodes: Sequence[Node], shapes: Sequence[Shape], places: Array, paths: Sequence[Array]
) -> Framing:
    """Return the view of a motion.

    Args:
        model: Pinocchio's model, with its gravity.
        nodes: Its bodies.
        shapes: Its solids.
        places: Placements of the bodies at rows of the motion, shape (rows, njoints, 4, 4).
        paths: Further points to be seen: positions in the world, each of shape (rows, 3).
    """
    still = [shape.extent() for shape in shapes if shape.node == 0]
    everything = np.concatenate([*still, _moving(nodes, shapes, places, paths)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    up, normal = upwards(model), _normal(nodes, places)
    if normal is not None:
        across = np.linalg.norm((high - low) * np.sqrt(np.maximum(1.0 - normal**2, 0.0)))
        normal = None if abs(normal) @ (high - low) > FLAT * across else _facing(normal, up)
    eye = _slanted(up) if normal is None else _tilted(normal, up)
    return Framing(up, eye / np.linalg.norm(eye), normal, low, high, _outline(everything))


def upwards(model: pin.Model) -> Array:
    """Return the direction against gravity; z where there is none."""
    gravity = np.asarray(model.gravity.linear)
    return -gravity / np.linalg.norm(gravity) if gravity.any() else np.array([0.0, 0.0, 1.0])


def _moving(nodes: Sequence[Node], shapes: Sequence[Shape], places: Array, paths: Sequence[Array]) -> Array:
    """Return the corners of the moving solids at every row, in the world, shape (k, 3)."""
    carrying = [node for node in range(1, len(nodes)) if nodes[node].carries]
    points = [places[:, carrying, :3, 3].reshape(-1, 3), *paths]
    for node in carrying:
        corners = [shape.extent() for shape in shapes if shape.node == node]
        if corners:
            outer = np.concatenate(corners) @ places[:, node, :3, :3].swapaxes(1, 2) + places[:, node, None, :3, 3]
            points.append(outer.reshape(-1, 3))
    return np.asarray(np.concatenate(points))


def _outline(points: Array) -> Array:
    """Return the points that reach farthest along directions spread evenly over the sphere."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * k / DIRECTIONS, GOLDEN * k
    radius = np.sqrt(1.0 - z * z)
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
    return np.asarray(points[sorted({int((points @ direction).argmax()) for direction in directions})])


def _normal(nodes: Sequence[Node], places: Array) -> Array | None:
    """Return the normal of the plane in which all bodies move; ``None`` where there is none.

    It is the axis of all revolute joints, or the normal of all slides, which are at right angles to it.
    """
    if any(node.kind == "pose" for node in nodes):
        return None
    turning, sliding = (
        np.array([places[0, k, :3, :3] @ node.axis for k, node in enumerate(nodes) if node.kind == kind]).reshape(-1, 3)
        for kind in ("turn", "slide")
    )
    axis: Array = turning[0] if len(turning) else np.cross(sliding[:1], sliding).sum(axis=0)
    if (length := np.linalg.norm(axis)) < PARALLEL:
        return None
    skew = [*np.linalg.norm(np.cross(axis, turning), axis=1), *np.abs(sliding @ axis)]
    return axis / length if max(skew) < PARALLEL * length else None


def _facing(axis: Array, up: Array) -> Array:
    """Return the direction to the eye along an axis: the side from which the third axis points right, or from above."""
    if abs(axis @ up) > ABOVE:
        return up
    right = np.cross(up, axis)
    return np.asarray(np.sign(right[np.abs(right).argmax()]) * axis)


def _tilted(normal: Array, up: Array) -> Array:
    """Return a direction to the eye from which depth is seen."""
    if abs(normal @ up) > ABOVE:
        return np.asarray(up - 0.4 * _upwards(normal, up))
    return np.asarray(normal + 0.22 * np.cross(up, normal) + 0.2 * up)


def _upwards(eye: Array, up: Array) -> Array:
    """Return the upward direction of the picture, shape (3,); seen from above, x points to the right."""
    if abs(eye @ up) > ABOVE:
        return np.asarray(np.eye(3)[1] if abs(up[1]) < 0.5 else -np.eye(3)[2])
    flat = up - (up @ eye) * eye
    return np.asarray(flat / np.linalg.norm(flat))


def _slanted(up: Array) -> Array:
    """Return the direction of a three-quarter view: from the front and the right."""
    front = np.eye(3)[0] if abs(up[0]) < 0.5 else np.eye(3)[1]
    front = front - (front @ up) * up
    front /= np.linalg.norm(front)
    return np.asarray(0.78 * front - 0.56 * np.cross(up, front) + 0.38 * up)


TOGETHER = 1e-6
"""Distance of two points, relative to the extent, up to which they are in one place."""

MOST = 4
"""Names that are shown at one place."""

Kind = Literal["part", "point", "joint"]


class Name(ValueRecord, frozen=True):
    """A name at a point of a body.

    Attributes:
        text: The name; of names at one place their label, see ``labels``.
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
    shapes = [*drawn.shapes, *figure.solids(upwards(model), drawn.bare)]
    points = [*(end for pair in joined for end in pair.ends), *further]
    seen = framing(model, nodes, shapes, places, [point.path(places) for point in points])
    return Scene(nodes, places, figure, shapes, seen, slots(mechanism, seen.normal, seen.size, places))


def names_of(mechanism: Mechanism, shown: Scene, how: Presentation) -> list[Name]:
    """Return the names of links, points and joints, one for all that stay in one place, points and joints first.

    A link with a mass or a shape is a part, any other a point. A part's name is in the middle of its longest stick,
    away from its joints; the ground has no such name.
    """
    names = list(_all_names(mechanism, shown.nodes))
    groups: list[tuple[Array, list[Name]]] = []
    for name in sorted(names, key=lambda name: ("part", "point", "joint").index(name.kind)):
        path = name.at.path(shown.places)
        near = (group for there, group in groups if np.abs(there - path).max() < TOGETHER * shown.framing.size)
        group = next((group for group in near if (group[0].kind == "part") == (name.kind == "part")), None)
        if group is None:
            groups.append((path, [name]))
        elif name.text not in [known.text for known in group]:
            group.append(name)
    return sorted((_as_one(group, how) for _, group in groups), key=lambda name: name.kind == "part")


def _all_names(mechanism: Mechanism, nodes: Sequence[Node]) -> Iterator[Name]:
    from pinarm.mechanics.planar_drawing import GROUND

    model, reached = mechanism.model, reaches(mechanism.model, nodes)
    frames = {frame.name: k for k, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY}
    for link in ElementTree.fromstring(mechanism.xml).findall("link"):
        name = str(link.get("name"))
        at = point_of(model, frames.pop(name))
        if link.find("inertial") is None and link.find("visual") is None:
            if at.node or name != GROUND:  # the ground of a drawing is seen by its mounts
                yield Name(name, "point", at)
        elif at.node:
            yield Name(name, "part", _middle(model, reached[at.node], at))
    for name, frame in frames.items():  # points of the mechanism file, and the frame of the world
        at = point_of(model, frame)
        if at.node or at.place.any():
            yield Name(name, "point", at)
    for index in range(1, model.njoints):
        if nodes[index].carries:
            yield Name(model.names[index], "joint", BodyPoint(index, np.zeros(3)))
    for joint in mechanism.constraints:
        if isinstance(joint, LoopJoint):
            yield Name(joint.name, "joint", point_of(model, joint.second))


def _middle(model: pin.Model, reached: Array, origin: BodyPoint) -> BodyPoint:
    """Return the middle of the longest stick of a link, from its origin to the points that its body reaches."""
    ends = reached - origin.place
    if not len(ends):
        return BodyPoint(origin.node, np.asarray(model.inertias[origin.node].lever))
    return BodyPoint(origin.node, origin.place + 0.5 * ends[int(np.linalg.norm(ends, axis=1).argmax())])


def _as_one(group: Sequence[Name], how: Presentation) -> Name:
    """Return names at one place as one label, without ``O_crank`` beside O, the same point on a link."""
    texts = [name.text for name in group]
    apart = [text for text in texts if not any(text.startswith(f"{other}_") for other in texts)]
    labels = [plain(text) if group[0].kind == "part" else name_label(text, how) for text in apart[:MOST]]
    return replace(group[0], text=", ".join(labels) + (", ..." if len(apart) > MOST else ""))
