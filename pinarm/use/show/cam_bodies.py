"""Cams and their rollers as bodies: outlines in the plane in which they touch, and plates of that shape."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Complex
from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.couplings.cams.cam_contact import Roller
from pinarm.mechanics.couplings.cams.cam_coupling import CamContact, CamCoupling
from pinarm.records import Record
from pinarm.use.show.replay.meshes import Mesh
from pinarm.use.show.replay.shapes import Shape, colour_of
from pinarm.use.show.replay.tracks import Node

RIM: Complex = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 73))
"""Points of a circle."""

THICK = 0.12
"""Thickness of a plate, relative to its extent."""


class CamBody(Record, frozen=True):
    """A cam or a roller.

    Attributes:
        node: The body that it is fixed to.
        middle: Where its axis meets the plane of contact, in the body [m], shape (3,).
        outline: Points of its outline in the body [m], shape (n, 3).
        axis: Unit vector of its axis in the body, shape (3,).
    """

    node: int
    middle: Array
    outline: Array
    axis: Array

    @property
    def spoke(self) -> Array:
        """A line from its axis to its outline, by which one sees it turn [m], shape (2, 3)."""
        return np.array([self.middle, self.outline[0]])

    def plate(self) -> Shape:
        """Return it as a plate, its two faces as fans about the axis."""
        n, half = len(self.outline), 0.5 * THICK * float(np.ptp(self.outline, axis=0).max()) * self.axis
        vertices = np.concatenate([self.outline + half, self.outline - half, [self.middle + half, self.middle - half]])
        one = np.arange(n)
        two = (one + 1) % n
        above, below = np.full(n, 2 * n), np.full(n, 2 * n + 1)
        triangles = np.concatenate([
            np.stack(corners, axis=1) for corners in (
                (above, one, two), (below, two + n, one + n), (one, one + n, two + n), (one, two + n, two),
            )
        ])  # fmt: skip
        mesh = Mesh(vertices, triangles)
        return Shape(self.node, pin.SE3.Identity(), "mesh", (1.0, 1.0, 1.0), colour_of(self.node), mesh)


def cam_bodies(mechanism: Mechanism, nodes: Sequence[Node]) -> Iterator[CamBody]:
    """Yield the cams whose contact is known, each with its roller, if it has one.

    Those are left out whose carrier is not the parent of the joints of both.
    """
    for coupling in mechanism.constraints:
        if isinstance(coupling, CamCoupling) and coupling.contact:
            pair = coupling.contact.plane.pair
            if all(nodes[member.body].parent == pair.carrier for member in (pair.first, pair.second)):
                yield from _bodies(nodes, coupling, coupling.contact)


def _bodies(nodes: Sequence[Node], cam: CamCoupling, contact: CamContact) -> Iterator[CamBody]:
    plane, surface = contact.plane, contact.surface
    yield _placed(nodes, plane.pair.first.body, plane.origin, cam.shape, plane.axis)
    if isinstance(surface, Roller):
        middle = plane.vectors(np.full(1, contact.point.start))[0]
        rim = plane.vectors(surface.radius * RIM)
        follower = plane.pair.second.body
        yield _placed(nodes, follower, plane.origin + middle, plane.origin + middle + rim, plane.axis)


def _placed(nodes: Sequence[Node], body: int, middle: Array, outline: Array, axis: Array) -> CamBody:
    """Return a body that is given in its carrier where its joint is at 0."""
    own = nodes[body].placement
    inside, turned = ((points - own.translation) @ own.rotation for points in (middle, outline))
    return CamBody(body, inside, turned, np.asarray(axis @ own.rotation))
