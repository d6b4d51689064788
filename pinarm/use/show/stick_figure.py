"""Stick figure of a mechanism: rods, discs, boxes, joints and supports, which drawings and replays show alike."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Complex
from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.couplings.coupling import Coupling, JointRelation
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, ValueRecord
from pinarm.use.show.chart import Style
from pinarm.use.show.replay.framing import Framing
from pinarm.use.show.replay.overlays import LOOPS, BodyPoint, Connection, point_of
from pinarm.use.show.replay.shapes import Shape, colour_of, primitives
from pinarm.use.show.replay.tracks import Node

RIM: Complex = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 73))
"""Points of a circle of radius 1."""

BOX, THINNEST = 0.18, 0.014
"""Largest and least edge of the box of an inertia, relative to the size of the figure."""

LINKS = 4.0
"""Typical links along the size of a figure; with more links, its thicknesses follow the link length."""

BEYOND = 0.06
"""Length of a rail beyond the ways of its slide, relative to the size of the figure."""

SIMPLE = 3
"""Solids of a body that are drawn by their edges: edges of more are no longer told apart."""

THIN, RAIL = 0.45, 0.4
"""Widths of the lines of discs and solids, and of rails, relative to rods."""

SLOT = 0.017
"""Half width of slots, relative to the extent of the mechanism."""

FLAT = 1e-6
"""Cosine of the angle between two normals up to which a plane is seen as a line."""

EVEN = 1e-9
"""Difference of two moments of inertia, relative to them, that is rounding."""


class Stick(ValueRecord, frozen=True):
    """A polyline that is fixed to a body.

    Attributes:
        node: The body.
        points: Its corners in the body [m], shape (k, 3).
        weight: Its width, relative to rods.
        style: How it is dashed.
    """

    node: int
    points: Array
    weight: float = 1.0
    style: Style = "-"


class Disc(Record, frozen=True):
    """A cam, a roller or a wheel.

    Attributes:
        node: The body that it is fixed to.
        middle: Point of its axis in the plane of the outline, in the body [m], shape (3,).
        outline: Points of its outline in the body [m], shape (n, 3).
        axis: Unit vector of its axis in the body, shape (3,).
    """

    node: int
    middle: Array
    outline: Array
    axis: Array

    @property
    def spoke(self) -> Array:
        """A line from its axis to its outline, which shows how it turns [m], shape (2, 3)."""
        return np.array([self.middle, self.outline[0]])


class StickFigure(Record, frozen=True):
    """Geometry of the bodies, each in its own frame.

    Attributes:
        size: Length that thicknesses are relative to [m].
        rods: Lines from the joint of a body to the points that it reaches.
        discs: Cams and rollers, and wheels among the bodies that reach nowhere.
        boxes: Boxes of the inertias of the other bodies that reach nowhere.
        solids: Solids that the model's file draws of bodies that reach nowhere.
        pins: Bodies on joints that turn.
        slides: Bodies on joints that slide.
        balls: Bodies on other joints, away from the origin of their parents.
        rails: Lines on the bodies that carry slides, as long as the way of the whole motion.
        mounts: Points of the world that the mechanism stands on [m], shape (3,).
        tips: Points that carry nothing further.
    """

    size: float
    rods: Sequence[Stick]
    discs: Sequence[Disc]
    boxes: Sequence[Shape]
    solids: Sequence[Shape]
    pins: Sequence[int]
    slides: Sequence[int]
    balls: Sequence[int]
    rails: Sequence[Stick]
    mounts: Sequence[Array]
    tips: Sequence[BodyPoint]

    @cached_property
    def lines(self) -> Sequence[Stick]:
        """The bodies as lines: rods, outlines and spokes of discs, edges of solids and boxes."""
        rims = [Stick(disc.node, line, THIN) for disc in self.discs for line in (disc.outline, disc.spoke)]
        return [*self.rods, *rims, *(edge for shape in (*self.solids, *self.boxes) for edge in _edges(shape))]


def stick_figure(mechanism: Mechanism, nodes: Sequence[Node], joined: Sequence[Connection]) -> StickFigure:
    """Return the figure of a mechanism; ``joined`` are its springs and loop joints."""
    model, reached = mechanism.model, reaches(mechanism.model, nodes)
    carrying = [node for node in range(1, len(nodes)) if nodes[node].carries]
    size = _size(model, nodes, [reached[node] for node in carrying])
    rods = [Stick(node, np.array([np.zeros(3), end])) for node in carrying for end in reached[node]]
    cams = list(_cams(mechanism, nodes))
    compact = {node for node in carrying if not len(reached[node])} - {cam.node for cam in cams}
    wheels = dict(_wheels(mechanism))
    solids = [shape for shape in primitives(mechanism) if shape.node in compact - wheels.keys()] if compact else []
    drawn = [shape.node for shape in solids]
    solids = [shape for shape in solids if drawn.count(shape.node) <= SIMPLE]
    compact -= {shape.node for shape in solids}
    discs = [disc for node in sorted(compact) for disc in _disc(model, nodes, node, wheels, BOX * size)]
    compact -= {disc.node for disc in discs}
    own = [k for k in carrying if not nodes[k].parent or nodes[nodes[k].parent].carries]
    pins, slides = ([k for k in own if nodes[k].kind == kind] for kind in ("turn", "slide"))
    others = [k for k in own if nodes[k].kind in ("pose", "fixed") and nodes[k].placement.translation.any()]
    return StickFigure(
        size, rods, [*cams, *discs], [box for node in sorted(compact) for box in _box(model, node, size)], solids,
        pins, slides, others, [_rail(nodes[k], BEYOND * size) for k in slides],
        list(_supports(nodes, pins, joined)), list(_tips(nodes, rods, joined)),
    )  # fmt: skip


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
    return [np.array(sorted({tuple(point.tolist()) for point in places if point.any()})).reshape(-1, 3)
            for places in points]  # fmt: skip


def _size(model: pin.Model, nodes: Sequence[Node], reached: Sequence[Array]) -> float:
    """Return the reach of the stretched figure, or ``LINKS`` typical links; without any, all boxes are drawn whole."""
    reach, links = np.zeros(len(nodes)), []
    for index, node in enumerate(nodes[1:], start=1):
        links.append(float(np.linalg.norm(node.placement.translation)))
        reach[index] = reach[node.parent] + links[-1]
    ends = [float(np.linalg.norm(point)) for points in reached for point in points]
    lengths = sorted(length for length in [*ends, *links] if length > 0.0)
    if lengths:
        return float(min(reach.max() + lengths[-1], LINKS * lengths[len(lengths) // 2]))
    return max([float(_cuboid(inertia)[0].max()) for inertia in model.inertias if inertia.mass > 0.0] or [BOX]) / BOX


def _cams(mechanism: Mechanism, nodes: Sequence[Node]) -> Iterator[Disc]:
    """Yield the cams whose contact is known, each with its roller, if it has one.

    Those are left out whose carrier is not the parent of the joints of both.
    """
    if not any(isinstance(element, JointRelation) and element.kind == "cam" for element in mechanism.constraints):
        return
    from pinarm.mechanics.couplings.cams.cam_contact import Roller
    from pinarm.mechanics.couplings.cams.cam_coupling import CamCoupling

    for cam in mechanism.constraints:
        if not (isinstance(cam, CamCoupling) and cam.contact):
            continue
        plane, surface = cam.contact.plane, cam.contact.surface
        pair = plane.pair
        if any(nodes[member.body].parent != pair.carrier for member in (pair.first, pair.second)):
            continue
        yield _placed(nodes, pair.first.body, plane.origin, cam.shape, plane.axis)
        if isinstance(surface, Roller):
            middle = plane.origin + plane.vectors(np.full(1, cam.contact.point.start))[0]
            rim = middle + plane.vectors(surface.radius * RIM)
            yield _placed(nodes, pair.second.body, middle, rim, plane.axis)


def _placed(nodes: Sequence[Node], body: int, middle: Array, outline: Array, axis: Array) -> Disc:
    """Return a disc that is given in the body's carrier, where the joint is at 0."""
    own = nodes[body].placement
    inside, turned = ((points - own.translation) @ own.rotation for points in (middle, outline))
    return Disc(body, inside, turned, np.asarray(axis @ own.rotation))


def _wheels(mechanism: Mechanism) -> Iterator[tuple[int, float]]:
    """Yield the bodies that have teeth, with their pitch radii [m]."""
    for coupling in mechanism.constraints:
        contact = coupling.transmission if isinstance(coupling, Coupling) else None
        if contact is not None:
            from pinarm.mechanics.couplings.transmissions import ToothContact

            if isinstance(contact, ToothContact):
                yield from zip((contact.first, contact.second), contact.surfaces.radii, strict=True)


def _disc(
    model: pin.Model, nodes: Sequence[Node], node: int, wheels: Mapping[int, float], largest: float
) -> Iterator[Disc]:
    """Yield a body as a wheel of its pitch radius, or as the disc of its inertia, ``I = m r^2 / 2``."""
    inertia, axis = model.inertias[node], nodes[node].axis
    radius = wheels.get(node, 0.0)
    if not radius and nodes[node].kind == "turn" and _is_symmetric(inertia, axis):
        radius = min(float(np.sqrt(2.0 * axis @ inertia.inertia @ axis / inertia.mass)), largest)
    if 0.0 < radius < np.inf:
        across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
        across /= np.linalg.norm(across)
        yield Disc(node, np.zeros(3), _circle(radius, across, np.cross(axis, across)), axis)


def _is_symmetric(inertia: pin.Inertia, axis: Array) -> bool:
    """Tell whether all directions across an axis have the same moment of inertia."""
    moments, largest = inertia.inertia @ axis, float(np.abs(inertia.inertia).max())
    own = float(axis @ moments)
    across = np.linalg.eigvalsh(inertia.inertia - own * np.outer(axis, axis))
    tilted = np.linalg.norm(moments - own * axis) > EVEN * largest
    return bool(inertia.mass > 0.0 < own and not tilted and abs(across[-1] - across[-2]) <= EVEN * largest)


def _box(model: pin.Model, node: int, size: float) -> Iterator[Shape]:
    """Yield the box of the inertia of a body, unless it has no mass."""
    inertia = model.inertias[node]
    if inertia.mass > 0.0:
        edges, axes = _cuboid(inertia)
        edges *= min(1.0, BOX * size / max(float(edges.max()), 1e-300))
        x, y, z = np.maximum(edges, THINNEST * size).tolist()
        yield Shape(node, pin.SE3(axes, inertia.lever), "box", (x, y, z), colour_of(node))


def _cuboid(inertia: pin.Inertia) -> tuple[Array, Array]:
    """Return edges [m] and axes of the homogeneous box of an inertia: ``a^2 = 6 (I_b + I_c - I_a) / m``."""
    moments, axes = np.linalg.eigh(inertia.inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments) / inertia.mass, 0.0)), axes


def _rail(node: Node, beyond: float) -> Stick:
    """Return the line along which a joint slides, and so far beyond both ends of its way [m]."""
    ways = np.array([node.values.min() - beyond, node.values.max() + beyond])
    points = np.outer(ways, node.axis) @ node.placement.rotation.T + node.placement.translation
    return Stick(node.parent, np.asarray(points), RAIL, "-.")


def _supports(nodes: Sequence[Node], pins: Sequence[int], joined: Sequence[Connection]) -> Iterator[Array]:
    """Yield the points of the world that pins, springs and loop joints are fixed to."""
    yield from (np.asarray(nodes[k].placement.translation) for k in pins if not nodes[k].parent)
    yield from (end.place for pair in joined if pair.kind != "slot" for end in pair.ends if not end.node)


def _tips(nodes: Sequence[Node], rods: Sequence[Stick], joined: Sequence[Connection]) -> Iterator[BodyPoint]:
    """Yield the ends of rods at which there is neither a joint nor the end of a spring or a loop joint."""
    known = {(node.parent, tuple(node.placement.translation)) for node in nodes}
    known |= {(end.node, tuple(end.place)) for pair in joined for end in pair.ends}
    yield from (BodyPoint(rod.node, rod.points[-1]) for rod in rods if (rod.node, tuple(rod.points[-1])) not in known)


def slots(mechanism: Mechanism, seen: Framing, places: Array) -> list[Stick]:
    """Return the slots of a mechanism that is seen flat: outlines around the way of the pin, and a little beyond.

    Args:
        mechanism: The mechanism.
        seen: From where.
        places: Placements of its bodies, shape (rows, njoints, 4, 4).
    """
    if seen.normal is None:
        return []
    model, outlines = mechanism.model, list[Stick]()
    for joint in mechanism.constraints:
        if isinstance(joint, LoopJoint) and LOOPS.get(joint.kind) == "slot":
            from pinarm.mechanics.loops.lower_pairs import LowerPair

            assert isinstance(joint.pair, LowerPair)
            slot, pin_point = (point_of(model, frame) for frame in (joint.first, joint.second))
            turn, origin = places[:, slot.node, :3, :3], slot.path(places)
            normal = turn[0].T @ seen.normal
            beside = model.frames[joint.first].placement.rotation @ joint.pair.axis
            along = np.cross(beside, normal)
            if abs(beside @ normal) < FLAT:
                ways = np.vecmat(pin_point.path(places) - origin, turn) @ along
                outlines.append(Stick(slot.node, slot.place + _oblong(ways, along, beside, SLOT * seen.size), RAIL))
    return outlines


def _oblong(ways: Array, along: Array, beside: Array, half: float) -> Array:
    """Return the outline of a slot around ways of its pin [m]: two lines that half circles join, shape (n, 3)."""
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 19)
    turned = half * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    low, high = (np.array([end, 0.0]) for end in (ways.min() - 2.0 * half, ways.max() + 2.0 * half))
    front, back = high + turned, low - turned
    return np.asarray(np.concatenate([front, back, front[:1]]) @ np.stack([along, beside]))


def _edges(shape: Shape) -> Iterator[Stick]:
    """Yield the edges of a solid; of a cylinder or a capsule also lines along it and a spoke, of a sphere circles."""
    corners, centre = shape.extent(), shape.placement.translation
    x, y, z = shape.placement.rotation.T
    if shape.kind == "box":
        pairs = [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]
        lines = [corners[[a, b]] for a, b in pairs]
    elif shape.kind == "sphere":
        lines = [centre + _circle(shape.size[0], first, second) for first, second in ((x, y), (y, z), (z, x))]
    else:
        radius, length = shape.size
        lines = [centre + end * length * z + _circle(radius, x, y) for end in (-0.5, 0.5)]
        lines.append(centre + 0.5 * length * z + np.outer([0.0, radius], x))
        lines += [centre + radius * side + np.outer([-0.5, 0.5], length * z) for side in (x, -x, y, -y)]
    yield from (Stick(shape.node, line, THIN) for line in lines)


def _circle(radius: float, first: Array, second: Array) -> Array:
    """Return the points of a circle between two directions [m], shape (n, 3)."""
    return np.asarray(radius * (np.outer(RIM.real, first) + np.outer(RIM.imag, second)))
