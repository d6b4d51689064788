"""Scene of a moving mechanism, for drawings and replays: stick figure, solids, connections, view, names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Complex, distinct
from pinarm.engine.mechanism import Mechanism
from pinarm.input.xml_text import tree_of
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, ValueRecord, replace
from pinarm.use.result.presentation import Presentation
from pinarm.use.show.bodies import (
    GROUND,
    LOOPS,
    BodyPoint,
    Colour,
    Connection,
    Mesh,
    Node,
    Shape,
    Visuals,
    colour_of,
    connections,
    nodes_of,
    placed,
    point_of,
)
from pinarm.use.show.labels import name_label, plain

RIM: Complex = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 73))
"""Points of a circle of radius 1."""

BOX, THINNEST = 0.18, 0.014
"""Largest and least edge of the box of an inertia, relative to the size of the figure."""

LINKS = 4.0
"""Typical links along the size of a figure; with more links, its thicknesses follow the link length."""

BEYOND = 0.06
"""Length of a rail beyond the ways of its slide, relative to the size of the figure."""

THIN, RAIL = 0.45, 0.4
"""Widths of the lines of discs and boxes, and of rails, relative to rods."""

SLOT = 0.017
"""Half width of slots, relative to the extent of the mechanism."""

EVEN = 1e-9
"""Difference of two moments of inertia, relative to them, that is rounding."""

ROD, PIN, POINT = 0.014, 0.026, 0.02
"""Radii of solid rods, joints and end points, relative to the size of the figure."""

FOOT = 0.085, 0.03
"""Width and height of the block below a joint on the ground, relative to the size of the figure."""

THICK = 0.12
"""Thickness of a disc, relative to its extent."""

DARK: Colour = (0.27, 0.29, 0.33, 1.0)
"""Colour of solid joints."""


class Stick(ValueRecord, frozen=True):
    """A polyline that is fixed to a body.

    Attributes:
        node: The body.
        points: Its corners in the body [m], shape (k, 3).
        weight: Its width, relative to rods.
        style: How it is dashed, as in matplotlib.
    """

    node: int
    points: Array
    weight: float = 1.0
    style: str = "-"


class StickFigure(Record, frozen=True):
    """Bodies as lines and as solids, each in its own frame, and the marks of joints.

    Attributes:
        size: Length that thicknesses are relative to [m]: that of the links, or of four typical ones.
        lines: Rods from the joint of a body to the points that it reaches; outlines of discs and boxes of the others.
        solids: The same bodies as solids, and joints, where the model's file draws none.
        pins: Bodies on joints that turn.
        slides: Bodies on joints that slide, and the lines, on their parents, along which they do in the whole motion.
        mounts: Points of the world that pins, springs and loop joints are fixed to [m], shape (3,).
        tips: Ends of rods at which there is neither a joint nor the end of a spring or a loop joint.
        joined: Springs, cables and loop joints.
    """

    size: float
    lines: Sequence[Stick]
    solids: Sequence[Shape]
    pins: Sequence[int]
    slides: Mapping[int, Stick]
    mounts: Sequence[Array]
    tips: Sequence[BodyPoint]
    joined: Sequence[Connection]


def stick_figure(
    mechanism: Mechanism, nodes: Sequence[Node], joined: Sequence[Connection], bare: frozenset[int]
) -> StickFigure:
    """Return the figure of a mechanism.

    Args:
        mechanism: The mechanism.
        nodes: Its bodies.
        joined: Its springs and loop joints.
        bare: Bodies without shapes of their own, which get solids; with 0 among them, joints on the ground get feet.
    """
    model, reached = mechanism.model, reaches(mechanism.model, nodes)
    carrying = [k for k in range(1, len(nodes)) if nodes[k].carries]
    lengths = sorted(float(np.linalg.norm(end)) for k in carrying for end in reached[k])
    size = min(sum(lengths), LINKS * lengths[len(lengths) // 2]) if lengths else _largest_box(model) / BOX
    carried = {(node.parent, tuple(node.placement.translation)) for node in nodes}
    ends = {(end.node, tuple(end.place)) for pair in joined for end in pair.ends}
    lines, solids, tips = list[Stick](), list[Shape](), list[BodyPoint]()
    for k in carrying:
        for end in reached[k]:
            lines.append(Stick(k, np.array([np.zeros(3), end])))
            solids.append(_cylinder(k, np.zeros(3), end, ROD * size, colour_of(k)))
            if (k, tuple(end)) not in carried:
                solids.append(Shape(k, pin.SE3(np.eye(3), end), "sphere", (POINT * size,), colour_of(k)))
                tips += [] if (k, tuple(end)) in ends else [BodyPoint(k, end)]
    compact = {k for k in carrying if not len(reached[k])}
    for k, outlines, solid in _compact(mechanism, nodes, compact, size):
        compact.add(k)
        lines += [Stick(k, line, THIN) for line in outlines]
        solids.append(solid)
    solids = [solid for solid in solids if solid.node in bare]
    joints = [k for k in carrying if not nodes[k].parent or nodes[nodes[k].parent].carries]
    pins = [k for k in joints if nodes[k].kind == "turn"]
    slides = {k: _rail(nodes[k], BEYOND * size) for k in joints if nodes[k].kind == "slide"}
    for k in joints:
        if bare & {k, nodes[k].parent or k}:
            solids += _joint_solids(k, nodes[k], slides.get(k), size)
    fixed = {k: np.asarray(nodes[k].placement.translation) for k in pins if not nodes[k].parent}
    standing = {tuple(place.tolist()) for k, place in fixed.items() if k not in compact and 0 in bare}
    solids += [_foot(upwards(model), np.array(place), size) for place in sorted(standing)]
    mounts = [end.place for pair in joined if pair.kind != "slot" for end in pair.ends if not end.node]
    return StickFigure(size, lines, solids, pins, slides, [*fixed.values(), *mounts], tips, joined)


def _joint_solids(k: int, node: Node, rail: Stick | None, size: float) -> Iterator[Shape]:
    """Yield the sign of a joint: a pin along a revolute axis, a block on a rail for a slide, a ball for others."""
    radius = PIN * size
    if node.kind == "turn":
        yield Shape(k, _along(np.zeros(3), node.axis), "cylinder", (radius, 3.2 * radius), DARK)
    elif rail is not None:
        yield Shape(k, _along(np.zeros(3), node.axis), "box", (2.4 * radius, 2.4 * radius, 4.0 * radius), DARK)
        yield _cylinder(node.parent, rail.points[0], rail.points[1], 0.5 * ROD * size, GROUND)
    elif node.placement.translation.any():
        yield Shape(k, pin.SE3.Identity(), "sphere", (radius,), DARK)


def _foot(up: Array, at: Array, size: float) -> Shape:
    width, height = (edge * size for edge in FOOT)
    return Shape(0, _along(at - (PIN * size + height / 2.0) * up, up), "box", (width, width, height), GROUND)


def _compact(
    mechanism: Mechanism, nodes: Sequence[Node], nowhere: Iterable[int], size: float
) -> Iterator[tuple[int, list[Array], Shape]]:
    """Yield cams and rollers, and wheels and boxes of the bodies that reach nowhere: body, outlines, solid."""
    wheels, cams = dict(_wheels(mechanism)), list(_cams(mechanism, nodes))
    yield from (_disc(*cam) for cam in cams)
    for k in sorted({*nowhere} - {body for body, *_ in cams}):
        inertia, axis = mechanism.model.inertias[k], nodes[k].axis
        radius = wheels.get(k) or min(_disc_radius(inertia, axis), BOX * size)
        if nodes[k].kind == "turn" and radius:
            across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
            across /= np.linalg.norm(across)
            rim = radius * (np.outer(RIM.real, across) + np.outer(RIM.imag, np.cross(axis, across)))
            yield _disc(k, np.zeros(3), rim, axis)
        elif inertia.mass > 0.0:
            box = _box(inertia, k, size)
            edges = [[a, a | bit] for a in range(8) for bit in (1, 2, 4) if not a & bit]
            yield k, [box.extent()[edge] for edge in edges], box


def _disc(k: int, middle: Array, outline: Array, axis: Array) -> tuple[int, list[Array], Shape]:
    """Return the outline and a spoke of a disc, and the disc as a plate, its two faces as fans about the axis.

    Args:
        k: The body.
        middle: Point of the axis in the plane of the outline, in the body [m], shape (3,).
        outline: Points of the outline in the body [m], shape (n, 3).
        axis: Unit vector of the axis in the body, shape (3,).
    """
    n, half = len(outline), 0.5 * THICK * float(np.ptp(outline, axis=0).max()) * axis
    a, above, below = np.arange(n), np.full(n, 2 * n), np.full(n, 2 * n + 1)
    b = (a + 1) % n
    corners = [(above, a, b), (below, b + n, a + n), (a, a + n, b + n), (a, b + n, b)]
    triangles = np.concatenate([np.stack(triangle, axis=1) for triangle in corners])
    mesh = Mesh(np.concatenate([outline + half, outline - half, [middle + half, middle - half]]), triangles)
    plate = Shape(k, pin.SE3.Identity(), "mesh", (1.0, 1.0, 1.0), colour_of(k), mesh)
    return k, [outline, np.array([middle, outline[0]])], plate


def reaches(model: pin.Model, nodes: Sequence[Node]) -> list[Array]:
    """Return the points that every body reaches to, other than its origin [m], shape (k, 3) each.

    These are the joints and links that it carries; of a body that carries none, its centre of mass.
    """
    points: list[list[Array]] = [[] for _ in nodes]
    for node in nodes[1:]:
        points[node.parent].append(np.asarray(node.placement.translation))
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            points[frame.parentJoint].append(np.asarray(frame.placement.translation))
    for index, inertia in enumerate(model.inertias):
        if index and not any(point.any() for point in points[index]):
            points[index] = [np.asarray(inertia.lever)]
    corners = [sorted({tuple(point.tolist()) for point in places if point.any()}) for places in points]
    return [np.array(places).reshape(-1, 3) for places in corners]


def _largest_box(model: pin.Model) -> float:
    return max([float(_cuboid(inertia)[0].max()) for inertia in model.inertias if inertia.mass > 0.0] or [BOX])


def _cams(mechanism: Mechanism, nodes: Sequence[Node]) -> Iterator[tuple[int, Array, Array, Array]]:
    """Yield the cams whose contact is known, and their rollers, where the joints of both are on one carrier."""
    from pinarm.mechanics.couplings.cam import CamCoupling

    def placed_on(body: int, middle: Array, outline: Array) -> tuple[int, Array, Array, Array]:
        joint = nodes[body].placement  # they are given in the carrier, where the joint is at 0
        inside, turned = ((points - joint.translation) @ joint.rotation for points in (middle, outline))
        return body, inside, turned, np.asarray(axis @ joint.rotation)

    for cam in mechanism.constraints:
        if not (isinstance(cam, CamCoupling) and cam.contact):
            continue
        plane, follower, axis = cam.contact, cam.contact.follower, cam.contact.axes[2]
        if any(nodes[body].parent != plane.carrier for body in (plane.first, plane.second)):
            continue
        yield placed_on(plane.first, plane.origin, plane.shape)
        if follower.face is None:
            middle = plane.origin + plane.vectors(np.full(1, follower.start))[0]
            yield placed_on(plane.second, middle, middle + plane.vectors(follower.radius * RIM))


def _wheels(mechanism: Mechanism) -> Iterator[tuple[int, float]]:
    from pinarm.mechanics.couplings.transmissions import FixedContact

    for coupling in mechanism.constraints:
        contact = coupling.transmission if isinstance(coupling, Coupling) else None
        if isinstance(contact, FixedContact) and contact.surfaces:
            yield from zip((contact.first, contact.second), contact.surfaces.radii, strict=True)


def _disc_radius(inertia: pin.Inertia, axis: Array) -> float:
    """Return the radius of the homogeneous disc of an inertia about an axis, ``I = m r^2 / 2``; 0 where it is none."""
    about, along = inertia.inertia, np.outer(axis, axis)
    polar = float(axis @ about @ axis)
    disc = polar * along + 0.5 * (np.trace(about) - polar) * (np.eye(3) - along)
    if not (inertia.mass > 0.0 < polar and np.abs(about - disc).max() <= EVEN * np.abs(about).max()):
        return 0.0
    return float(np.sqrt(2.0 * polar / inertia.mass))


def _box(inertia: pin.Inertia, node: int, size: float) -> Shape:
    edges, axes = _cuboid(inertia)
    edges *= min(1.0, BOX * size / max(float(edges.max()), 1e-300))
    x, y, z = np.maximum(edges, THINNEST * size).tolist()
    return Shape(node, pin.SE3(axes, inertia.lever), "box", (x, y, z), colour_of(node))


def _cuboid(inertia: pin.Inertia) -> tuple[Array, Array]:
    """Return edges [m] and axes of the homogeneous box of an inertia: ``a^2 = 6 (I_b + I_c - I_a) / m``."""
    moments, axes = np.linalg.eigh(inertia.inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments) / inertia.mass, 0.0)), axes


def _rail(node: Node, beyond: float) -> Stick:
    ways = np.array([node.values.min() - beyond, node.values.max() + beyond])
    points = np.outer(ways, node.axis) @ node.placement.rotation.T + node.placement.translation
    return Stick(node.parent, np.asarray(points), RAIL, "-.")


def slots(mechanism: Mechanism, normal: Array | None, size: float, places: Array) -> list[Stick]:
    """Return the slots of a mechanism that is seen flat: outlines around the way of the pin, and a little beyond.

    Args:
        mechanism: The mechanism.
        normal: The direction from which it is seen flat, shape (3,).
        size: Its extent [m].
        places: Placements of its bodies, shape (rows, njoints, 4, 4).
    """
    from pinarm.mechanics.geometry.pairs import LowerPair

    model, half = mechanism.model, SLOT * size
    loops = [joint for joint in mechanism.constraints if isinstance(joint, LoopJoint)]
    outlines = []
    for joint in loops if normal is not None else ():
        if LOOPS.get(joint.kind) != "slot":
            continue
        assert isinstance(joint.pair, LowerPair)
        slot, pin_point = (point_of(model, frame) for frame in (joint.first, joint.second))
        turn, origin = places[:, slot.node, :3, :3], slot.path(places)
        across, beside = turn[0].T @ normal, model.frames[joint.first].placement.rotation @ joint.pair.axis
        if abs(beside @ across) < PARALLEL:
            along = np.cross(beside, across)
            ways = np.vecmat(pin_point.path(places) - origin, turn) @ along
            ends = np.where(RIM.real >= 0.0, ways.max() + 2.0 * half, ways.min() - 2.0 * half)
            corners = np.outer(ends + half * RIM.real, along) + half * np.outer(RIM.imag, beside)
            outlines.append(Stick(slot.node, slot.place + corners, RAIL))
    return outlines


def _cylinder(node: int, start: Array, end: Array, radius: float, colour: Colour) -> Shape:
    length = float(np.linalg.norm(end - start))
    return Shape(node, _along((start + end) / 2.0, end - start), "cylinder", (radius, length), colour)


def _along(centre: Array, direction: Array) -> pin.SE3:
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.asarray(direction, float))
    return pin.SE3(turn.toRotationMatrix(), centre)


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
    carrying = [node for node in range(1, len(nodes)) if nodes[node].carries]
    points = [places[:, carrying, :3, 3], *paths]
    for shape in shapes:
        place = places[:, shape.node] if shape.node else places[:1, 0]
        points.append(shape.extent() @ place[:, :3, :3].swapaxes(1, 2) + place[:, None, :3, 3])
    everything = np.concatenate([part.reshape(-1, 3) for part in points])
    low, high = everything.min(axis=0), everything.max(axis=0)
    up, normal = upwards(model), _normal(nodes, places)
    if normal is not None:
        across = np.linalg.norm((high - low) * np.sqrt(np.maximum(1.0 - normal**2, 0.0)))
        normal = None if abs(normal) @ (high - low) > FLAT * across else _facing(normal, up)
    front = _upwards(up, np.eye(3)[0 if abs(up[0]) < 0.5 else 1])
    eye = 0.78 * front - 0.56 * np.cross(up, front) + 0.38 * up  # from the front, the right and above
    if normal is not None:  # tilted, so that depth is seen
        above = abs(normal @ up) > ABOVE
        eye = up - 0.4 * _upwards(normal, up) if above else normal + 0.22 * np.cross(up, normal) + 0.2 * up
    return Framing(up, eye / np.linalg.norm(eye), normal, low, high, _outline(everything))


def upwards(model: pin.Model) -> Array:
    """Return the direction against gravity; z where there is none."""
    gravity = np.asarray(model.gravity.linear)
    return -gravity / np.linalg.norm(gravity) if gravity.any() else np.array([0.0, 0.0, 1.0])


def _outline(points: Array) -> Array:
    """Return the points that reach farthest along directions spread evenly over the sphere."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * k / DIRECTIONS, GOLDEN * k
    radius = np.sqrt(1.0 - z * z)
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), z])
    return np.asarray(points[distinct((points @ directions).argmax(axis=0))])


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


def _upwards(eye: Array, up: Array) -> Array:
    """Return the upward direction of the picture, shape (3,); seen from above, x points to the right."""
    if abs(eye @ up) > ABOVE:
        return np.asarray(np.eye(3)[1] if abs(up[1]) < 0.5 else -np.eye(3)[2])
    flat = up - (up @ eye) * eye
    return np.asarray(flat / np.linalg.norm(flat))


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
    figure = stick_figure(mechanism, nodes, joined, drawn.bare)
    shapes = [*drawn.shapes, *figure.solids]
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
    for link in tree_of(mechanism.xml).findall("link"):
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
