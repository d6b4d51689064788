"""Stick figure of a mechanism: rods, discs, boxes, joints and supports, as lines and as solids."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Complex
from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, ValueRecord
from pinarm.use.show.bodies import LOOPS, BodyPoint, Connection, Node, point_of
from pinarm.use.show.meshes import Mesh
from pinarm.use.show.shapes import GROUND, Colour, Shape, colour_of

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

FLAT = 1e-6
"""Cosine of the angle between two normals up to which a plane is seen as a line."""

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
        return np.array([self.middle, self.outline[0]])

    def solid(self) -> Shape:
        """Return it as a plate, its two faces as fans about the axis."""
        n, half = len(self.outline), 0.5 * THICK * float(np.ptp(self.outline, axis=0).max()) * self.axis
        middles = [self.middle + half, self.middle - half]
        a, above, below = np.arange(n), np.full(n, 2 * n), np.full(n, 2 * n + 1)
        b = (a + 1) % n
        corners = [(above, a, b), (below, b + n, a + n), (a, a + n, b + n), (a, b + n, b)]
        triangles = np.concatenate([np.stack(triangle, axis=1) for triangle in corners])
        mesh = Mesh(np.concatenate([self.outline + half, self.outline - half, middles]), triangles)
        return Shape(self.node, pin.SE3.Identity(), "mesh", (1.0, 1.0, 1.0), colour_of(self.node), mesh)


class StickFigure(Record, frozen=True):
    """Geometry of the bodies, each in its own frame.

    Attributes:
        nodes: The bodies.
        size: Length that thicknesses are relative to [m].
        rods: Lines from the joint of a body to the points that it reaches.
        discs: Cams and rollers, and wheels among the bodies that reach nowhere.
        boxes: Boxes of the inertias of the other bodies that reach nowhere.
        joined: Springs, cables and loop joints.
    """

    nodes: Sequence[Node]
    size: float
    rods: Sequence[Stick]
    discs: Sequence[Disc]
    boxes: Sequence[Shape]
    joined: Sequence[Connection]

    @cached_property
    def lines(self) -> Sequence[Stick]:
        """The bodies as lines: rods, outlines and spokes of discs, edges of boxes."""
        lines = [(disc.node, line) for disc in self.discs for line in (disc.outline, disc.spoke)]
        edges = [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]
        lines += [(box.node, box.extent()[[*edge]]) for box in self.boxes for edge in edges]
        return [*self.rods, *(Stick(node, line, THIN) for node, line in lines)]

    def on(self, *kinds: str) -> list[int]:
        """Return the bodies on joints of some kinds whose parents carry links: others are part of a floating joint."""
        nodes = self.nodes
        behind = (k for k in range(1, len(nodes)) if nodes[k].carries and nodes[k].kind in kinds)
        return [k for k in behind if not nodes[k].parent or nodes[nodes[k].parent].carries]

    @cached_property
    def pins(self) -> Sequence[int]:
        """Bodies on joints that turn."""
        return self.on("turn")

    @cached_property
    def slides(self) -> Mapping[int, Stick]:
        """Bodies on joints that slide, and the lines, on their parents, along which they do in the whole motion."""
        return {k: _rail(self.nodes[k], BEYOND * self.size) for k in self.on("slide")}

    @cached_property
    def mounts(self) -> list[Array]:
        """Points of the world that pins, springs and loop joints are fixed to [m], shape (3,)."""
        fixed = [np.asarray(self.nodes[k].placement.translation) for k in self.pins if not self.nodes[k].parent]
        ends = [end for pair in self.joined if pair.kind != "slot" for end in pair.ends]
        return [*fixed, *(end.place for end in ends if not end.node)]

    @cached_property
    def tips(self) -> list[BodyPoint]:
        """Ends of rods at which there is neither a joint nor the end of a spring or a loop joint."""
        known = self.carried | {(end.node, tuple(end.place)) for pair in self.joined for end in pair.ends}
        ends = [BodyPoint(rod.node, rod.points[-1]) for rod in self.rods]
        return [end for end in ends if (end.node, tuple(end.place)) not in known]

    @cached_property
    def carried(self) -> set[tuple[int, tuple[float, ...]]]:
        """Places of joints: the body that carries one, and where."""
        return {(node.parent, tuple(node.placement.translation)) for node in self.nodes}

    def solids(self, up: Array, bare: frozenset[int]) -> list[Shape]:
        """Return the solids of some bodies, and of the joints at them.

        Args:
            up: Against gravity, shape (3,): feet stand below joints on the ground.
            bare: Bodies without shapes of their own; with 0 among them, joints on the ground stand on blocks.
        """
        shapes = [shape for rod in self.rods for shape in self._rod(rod)]
        shapes += [*self.boxes, *(disc.solid() for disc in self.discs)]
        shapes = [shape for shape in shapes if shape.node in bare]
        if 0 in bare:
            compact = {disc.node for disc in self.discs} | {box.node for box in self.boxes}
            standing = [self.nodes[k].placement for k in self.pins if not self.nodes[k].parent and k not in compact]
            places = {tuple(placement.translation.tolist()) for placement in standing}
            shapes += [self._foot(up, np.array(place)) for place in sorted(places)]
        moved = [k for k in range(1, len(self.nodes)) if bare & {k, self.nodes[k].parent or k}]
        return shapes + [shape for k in moved for shape in self._joint(k)]

    def _rod(self, rod: Stick) -> Iterator[Shape]:
        """Yield a rod, and a ball at its end if that carries no joint."""
        colour, (start, end) = colour_of(rod.node), rod.points
        yield _cylinder(rod.node, start, end, ROD * self.size, colour)
        if (rod.node, tuple(end)) not in self.carried:
            yield Shape(rod.node, pin.SE3(np.eye(3), end), "sphere", (POINT * self.size,), colour)

    def _foot(self, up: Array, at: Array) -> Shape:
        width, height = (edge * self.size for edge in FOOT)
        middle = at - (PIN * self.size + height / 2.0) * up
        return Shape(0, _along(middle, up), "box", (width, width, height), GROUND)

    def _joint(self, k: int) -> Iterator[Shape]:
        """Yield the sign of a joint: a pin along a revolute axis, a block on a rail for a slide, a ball for others."""
        radius, node = PIN * self.size, self.nodes[k]
        if k in self.pins:
            yield Shape(k, _along(np.zeros(3), node.axis), "cylinder", (radius, 3.2 * radius), DARK)
        elif k in self.slides:
            block = (2.4 * radius, 2.4 * radius, 4.0 * radius)
            yield Shape(k, _along(np.zeros(3), node.axis), "box", block, DARK)
            start, end = self.slides[k].points
            yield _cylinder(node.parent, start, end, 0.5 * ROD * self.size, GROUND)
        elif k in self.on("pose", "fixed") and node.placement.translation.any():
            yield Shape(k, pin.SE3.Identity(), "sphere", (radius,), DARK)


def stick_figure(mechanism: Mechanism, nodes: Sequence[Node], joined: Sequence[Connection]) -> StickFigure:
    """Return the figure of a mechanism; ``joined`` are its springs and loop joints."""
    model, reached = mechanism.model, reaches(mechanism.model, nodes)
    carrying = [node for node in range(1, len(nodes)) if nodes[node].carries]
    size = _size(model, [end for node in carrying for end in reached[node]])
    rods = [Stick(node, np.array([np.zeros(3), end])) for node in carrying for end in reached[node]]
    discs, wheels, boxes = list(_cams(mechanism, nodes)), dict(_wheels(mechanism)), list[Shape]()
    for node in sorted({node for node in carrying if not len(reached[node])} - {cam.node for cam in discs}):
        inertia, axis = model.inertias[node], nodes[node].axis
        radius = wheels.get(node) or min(_disc_radius(inertia, axis), BOX * size)
        if nodes[node].kind == "turn" and radius:
            across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
            across /= np.linalg.norm(across)
            rim = radius * (np.outer(RIM.real, across) + np.outer(RIM.imag, np.cross(axis, across)))
            discs.append(Disc(node, np.zeros(3), rim, axis))
        elif inertia.mass > 0.0:
            boxes.append(_box(inertia, node, size))
    return StickFigure(nodes, size, rods, discs, boxes, joined)


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


def _size(model: pin.Model, ends: Sequence[Array]) -> float:
    """Return the sum of the links, or ``LINKS`` typical ones; of bodies that reach nowhere draw all boxes whole."""
    if lengths := sorted(float(np.linalg.norm(end)) for end in ends):
        return min(sum(lengths), LINKS * lengths[len(lengths) // 2])
    return max([float(_cuboid(inertia)[0].max()) for inertia in model.inertias if inertia.mass > 0.0] or [BOX]) / BOX


def _cams(mechanism: Mechanism, nodes: Sequence[Node]) -> Iterator[Disc]:
    """Yield the cams whose contact is known, and their rollers, where the joints of both are on one carrier."""
    from pinarm.mechanics.couplings.cam import CamCoupling

    for cam in mechanism.constraints:
        if not (isinstance(cam, CamCoupling) and cam.contact):
            continue
        plane, follower, pair = cam.contact, cam.contact.follower, cam.contact.pair
        if any(nodes[member.body].parent != pair.carrier for member in (pair.first, pair.second)):
            continue
        yield _placed(nodes, pair.first.body, plane.origin, cam.shape, plane.axis)
        if follower.face is None:
            middle = plane.origin + plane.vectors(np.full(1, follower.start))[0]
            rim = middle + plane.vectors(follower.radius * RIM)
            yield _placed(nodes, pair.second.body, middle, rim, plane.axis)


def _placed(nodes: Sequence[Node], body: int, middle: Array, outline: Array, axis: Array) -> Disc:
    """Return a disc that is given in the body's carrier, where the joint is at 0."""
    joint = nodes[body].placement
    inside, turned = ((points - joint.translation) @ joint.rotation for points in (middle, outline))
    return Disc(body, inside, turned, np.asarray(axis @ joint.rotation))


def _wheels(mechanism: Mechanism) -> Iterator[tuple[int, float]]:
    from pinarm.mechanics.couplings.transmissions import ToothContact

    for coupling in mechanism.constraints:
        contact = coupling.transmission if isinstance(coupling, Coupling) else None
        if isinstance(contact, ToothContact):
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
        if abs(beside @ across) < FLAT:
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
