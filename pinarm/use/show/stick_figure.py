"""What a drawing shows of the bodies of a mechanism: sticks between their points, wheels, boxes, and their joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.couplings.coupling import Coupling, JointRelation
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import ValueRecord
from pinarm.use.show.chart import Style
from pinarm.use.show.replay.framing import Framing
from pinarm.use.show.replay.overlays import LOOPS, BodyPoint, Connection, point_of
from pinarm.use.show.replay.shapes import Shape, primitives
from pinarm.use.show.replay.sticks import cuboid, reaches
from pinarm.use.show.replay.tracks import Node

WHEEL = np.linspace(0.0, 2.0 * np.pi, 73)
"""Angles of the points of a wheel's rim."""

BOX = 0.35
"""Largest edge of the box of an inertia, relative to the longest stick."""

THIN = 0.45
"""Width of the lines of wheels and boxes, relative to that of sticks."""

SIMPLE = 3
"""Solids of a body that are drawn by their edges: of more one would see lines only."""

BEYOND = 0.15
"""How far a rail goes on beyond the ways of its slide, relative to the longest stick."""

RAIL = 0.4
"""Width of the lines of rails, relative to that of sticks."""

HALF = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 19)
"""Angles of the points of the round end of a slot."""

SLOT = 0.017
"""Half width of slots, relative to the extent of the mechanism."""

FLAT = 1e-6
"""Cosine of the angle of a plane's normal to that of the drawing up to which the plane is a line in it."""

EVEN = 1e-9
"""Difference of two moments of inertia, relative to them, up to which they are the same."""


class Stick(ValueRecord, frozen=True):
    """A polyline that is fixed to a body.

    Attributes:
        node: The body.
        points: Its corners in the body [m], shape (k, 3).
        weight: Its width, relative to that of others.
        style: How it is dashed.
    """

    node: int
    points: Array
    weight: float = 1.0
    style: Style = "-"


class StickFigure(ValueRecord, frozen=True):
    """What is drawn of the bodies.

    Attributes:
        sticks: Polylines.
        pins: Bodies on joints that turn.
        slides: Bodies on joints that slide.
        rails: What these slide on: lines on the bodies that carry them, as long as the way of the whole motion.
        mounts: Points of the world that the mechanism stands on [m], shape (3,).
        tips: Points that carry nothing further; their paths are drawn.
    """

    sticks: Sequence[Stick]
    pins: Sequence[int]
    slides: Sequence[int]
    rails: Sequence[Stick]
    mounts: Sequence[Array]
    tips: Sequence[BodyPoint]


def stick_figure(
    mechanism: Mechanism, nodes: Sequence[Node], joined: Sequence[Connection], slots: Sequence[Stick] = ()
) -> StickFigure:
    """Return the figure of a mechanism.

    Args:
        mechanism: The mechanism.
        nodes: Its bodies.
        joined: Springs and loop joints.
        slots: Slots that pins slide along.
    """
    model, wheels = mechanism.model, dict(_wheels(mechanism))
    reached = reaches(model, nodes)
    drawn, tips, compact = list[Stick](), list[BodyPoint](), list[int]()
    known = {(node.parent, tuple(node.placement.translation)) for node in nodes}
    known |= {(end.node, tuple(end.place)) for pair in joined for end in pair.ends}
    for node in (k for k in range(1, len(nodes)) if nodes[k].carries):
        ends = reached[node]
        drawn += [Stick(node, np.array([np.zeros(3), end])) for end in ends]
        compact += [] if len(ends) else [node]
        tips += [BodyPoint(node, end) for end in ends if (node, tuple(end)) not in known]
    longest = max((float(np.linalg.norm(stick.points[-1])) for stick in drawn), default=np.inf)
    own_shapes = list(primitives(mechanism)) if compact else []
    cams = list(_cams(mechanism, nodes))
    drawn += cams
    for node in (node for node in compact if all(node != stick.node for stick in cams)):
        shapes = [shape for shape in own_shapes if shape.node == node]
        simple = node not in wheels and len(shapes) <= SIMPLE
        solid = [stick for shape in shapes for stick in _edges(shape)] if simple else []
        drawn += solid or _box(model, nodes, node, wheels, BOX * longest)
    own = [k for k, node in enumerate(nodes) if k and node.carries and (not node.parent or nodes[node.parent].carries)]
    pins = [k for k in own if nodes[k].kind == "turn"]
    slides = [k for k in own if nodes[k].kind == "slide"]
    rails = [_rail(nodes[k], BEYOND * longest if np.isfinite(longest) else 0.0) for k in slides]
    mounts = [np.asarray(nodes[k].placement.translation) for k in pins if not nodes[k].parent]
    mounts += [end.place for pair in joined if pair.kind != "slot" for end in pair.ends if not end.node]
    return StickFigure(drawn, pins, slides, [*rails, *slots], mounts, tips)


def _cams(mechanism: Mechanism, nodes: Sequence[Node]) -> Iterator[Stick]:
    """Yield the outlines of cams and rollers, each with a spoke by which one sees it turn."""
    if any(isinstance(each, JointRelation) and each.kind == "cam" for each in mechanism.constraints):
        from pinarm.use.show.cam_bodies import cam_bodies

        for body in cam_bodies(mechanism, nodes):
            yield from (Stick(body.node, line, THIN) for line in (body.outline, body.spoke))


def slots(mechanism: Mechanism, seen: Framing, places: Array) -> list[Stick]:
    """Return the slots of a mechanism that is seen flat: outlines around the way of the pin, and a little beyond.

    Args:
        mechanism: The mechanism.
        seen: From where.
        places: Placements of its bodies, shape (rows, njoints, 4, 4).
    """
    if seen.normal is None:
        return []
    model, found = mechanism.model, list[Stick]()
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
                found.append(Stick(slot.node, slot.place + _oblong(ways, along, beside, seen.size), RAIL))
    return found


def _oblong(ways: Array, along: Array, beside: Array, size: float) -> Array:
    """Return the outline of a slot around ways of its pin [m]: two lines that half circles join, shape (n, 3)."""
    half = SLOT * size
    turned = half * np.stack([np.cos(HALF), np.sin(HALF)], axis=1)
    low, high = (np.array([end, 0.0]) for end in (ways.min() - 2.0 * half, ways.max() + 2.0 * half))
    front, back = high + turned, low - turned
    return np.asarray(np.concatenate([front, back, front[:1]]) @ np.stack([along, beside]))


def _rail(node: Node, beyond: float) -> Stick:
    """Return the line along which a joint slides, and so far beyond both ends of its way [m]."""
    ways = np.array([node.values.min() - beyond, node.values.max() + beyond])
    points = np.outer(ways, node.axis) @ node.placement.rotation.T + node.placement.translation
    return Stick(node.parent, np.asarray(points), RAIL, "-.")


def _wheels(mechanism: Mechanism) -> Iterator[tuple[int, float]]:
    """Yield the bodies that have teeth, with their pitch radii [m]."""
    for coupling in mechanism.constraints:
        contact = coupling.transmission if isinstance(coupling, Coupling) else None
        if contact is not None:
            from pinarm.mechanics.couplings.transmissions import ToothContact

            if isinstance(contact, ToothContact):
                yield from zip((contact.first, contact.second), contact.surfaces.radii, strict=True)


def _edges(shape: Shape) -> Iterator[Stick]:
    """Yield the edges of a solid; of a cylinder or a capsule also lines along it and a spoke, of a sphere circles."""
    corners, centre = shape.extent(), shape.placement.translation
    if shape.kind == "box":
        for a in range(8):
            for b in (a | bit for bit in (1, 2, 4) if not a & bit):
                yield Stick(shape.node, corners[[a, b]], THIN)
        return
    x, y, z = shape.placement.rotation.T
    if shape.kind == "sphere":
        for one, two in ((x, y), (y, z), (z, x)):
            yield Stick(shape.node, centre + _circle(shape.size[0], one, two), THIN)
        return
    radius, length = shape.size
    for end in (-0.5, 0.5):
        yield Stick(shape.node, centre + end * length * z + _circle(radius, x, y), THIN)
    yield Stick(shape.node, centre + 0.5 * length * z + np.outer([0.0, radius], x), THIN)
    for side in (x, -x, y, -y):
        yield Stick(shape.node, centre + radius * side + np.outer([-0.5, 0.5], length * z), THIN)


def _circle(radius: float, one: Array, two: Array) -> Array:
    """Return the points of a circle between two directions [m], shape (n, 3)."""
    return np.asarray(radius * (np.outer(np.cos(WHEEL), one) + np.outer(np.sin(WHEEL), two)))


def _box(
    model: pin.Model, nodes: Sequence[Node], node: int, wheels: Mapping[int, float], largest: float
) -> Iterator[Stick]:
    """Yield a body that is all in one place and draws nothing: a wheel about an axis of symmetry, else its box.

    The box is as large as its inertia says, and at most as ``largest`` says [m].
    """
    inertia, axis = model.inertias[node], nodes[node].axis
    radius = wheels.get(node, _disc(inertia, axis) if nodes[node].kind == "turn" else 0.0)
    if 0.0 < radius < np.inf:
        across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
        across /= np.linalg.norm(across)
        rim = _circle(radius, across, np.cross(axis, across))
        yield Stick(node, rim, THIN)
        yield Stick(node, np.array([np.zeros(3), rim[0]]), THIN)
    elif inertia.mass > 0.0:
        edges, axes = cuboid(inertia)
        edges *= min(1.0, largest / max(float(edges.max()), 1e-300))
        corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        for a in range(8):
            for b in (a | bit for bit in (1, 2, 4) if not a & bit):
                yield Stick(node, inertia.lever + (corners[[a, b]] * edges) @ axes.T, THIN)


def _disc(inertia: pin.Inertia, axis: Array) -> float:
    """Return the radius [m] of the disc that has an inertia, ``I = m r^2 / 2``; 0 where an axis is none of symmetry."""
    moments, largest = inertia.inertia @ axis, float(np.abs(inertia.inertia).max())
    own = float(axis @ moments)
    others = np.linalg.eigvalsh(inertia.inertia - own * np.outer(axis, axis))
    crossed = np.linalg.norm(moments - own * axis) > EVEN * largest
    if inertia.mass <= 0.0 or own <= 0.0 or crossed or abs(others[-1] - others[-2]) > EVEN * largest:
        return 0.0
    return float(np.sqrt(2.0 * own / inertia.mass))
