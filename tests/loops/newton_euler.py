"""Newton-Euler equations of all bodies of a linkage, each with six coordinates of its own, in extended precision.

Every joint, also those that the program puts in a tree, holds scalar products of vectors that are fixed in its bodies:
``e1 . (p2 - p1) = 0``, ``u1 . w2 = 0``, ``|p2 - p1|^2 = L^2``. Their second derivatives are those of products.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from linkage import GROUND, Joint, Linkage, Poses

LONG = np.longdouble


@dataclass(frozen=True)
class Jet:
    """A vector that moves with the bodies: value, rate, its second rate while no body accelerates, and the Jacobian."""

    value: np.ndarray
    rate: np.ndarray
    bias: np.ndarray
    jacobian: np.ndarray

    def __sub__(self, other: Jet) -> Jet:
        return Jet(self.value - other.value, self.rate - other.rate, self.bias - other.bias,
                   self.jacobian - other.jacobian)  # fmt: skip

    def dot(self, other: Jet) -> tuple[np.ndarray, LONG, LONG, LONG]:
        """Row, rate, second rate without accelerations, and value of a scalar product."""
        row = self.value @ other.jacobian + other.value @ self.jacobian
        rate = self.rate @ other.value + self.value @ other.rate
        bias = self.bias @ other.value + 2 * (self.rate @ other.rate) + self.value @ other.bias
        return row, rate, bias, self.value @ other.value


def cross_matrix(x: np.ndarray) -> np.ndarray:
    return np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]], LONG)


def screwed(lead: float, way: tuple, cosine: tuple, sine: tuple) -> tuple:
    """``way - lead angle / (2 pi)`` of an angle given by its cosine and its sine, but for whole leads."""
    (c_row, c_rate, c_bias, c), (s_row, s_rate, s_bias, s) = cosine, sine
    square, pitch, turn = c * c + s * s, lead / (2 * LONG(np.pi)), 2 * LONG(np.pi)
    rate = (c * s_rate - s * c_rate) / square
    bias = (c * s_bias - s * c_bias) / square - 2 * rate * (c * c_rate + s * s_rate) / square
    missing = way[3] / pitch - np.arctan2(s, c)
    return (way[0] - pitch * (c * s_row - s * c_row) / square, way[1] - pitch * rate, way[2] - pitch * bias,
            pitch * (missing - turn * np.round(missing / turn)))  # fmt: skip


class Bodies:
    """The bodies of a linkage in one state; six columns for each: velocity of the centre of mass, then omega."""

    def __init__(self, linkage: Linkage, poses: Poses) -> None:
        self.linkage, self.names = linkage, list(linkage.bodies)
        self.n = 6 * len(self.names)
        self.turn = {name: poses.turn[name].astype(LONG) for name in self.names}
        self.place = {name: poses.place[name].astype(LONG) for name in self.names}
        self.omega = {name: poses.omega[name].astype(LONG) for name in self.names}
        self.velocity = {name: poses.velocity[name].astype(LONG) for name in self.names}

    def vector(self, body: str, fixed: np.ndarray) -> Jet:
        """A vector fixed in a body, given in the axes of the reference pose."""
        jacobian, still = np.zeros((3, self.n), LONG), np.zeros(3, LONG)
        if body == GROUND:
            return Jet(fixed.astype(LONG), still, still, jacobian)
        value, omega = self.turn[body] @ fixed.astype(LONG), self.omega[body]
        rate = np.cross(omega, value)
        k = 6 * self.names.index(body)
        jacobian[:, k + 3 : k + 6] = -cross_matrix(value)
        return Jet(value, rate, np.cross(omega, rate), jacobian)

    def point(self, body: str, at: np.ndarray) -> Jet:
        """A point fixed in a body, given by its place at the reference pose."""
        if body == GROUND:
            return self.vector(body, at)
        arm = self.vector(body, at - self.linkage.bodies[body].com)
        k = 6 * self.names.index(body)
        jacobian = arm.jacobian.copy()
        jacobian[:, k : k + 3] = np.eye(3)
        return Jet(self.place[body] + arm.value, self.velocity[body] + arm.rate, arm.bias, jacobian)

    def rows(self, joint: Joint) -> list[tuple]:
        """What a joint holds."""
        x, y, z = (self.vector(joint.first, axis) for axis in joint.turn.T)
        x2, y2, z2 = (self.vector(joint.second, axis) for axis in joint.turn.T)
        apart = self.point(joint.second, joint.end()) - self.point(joint.first, joint.place)
        ball = [x.dot(apart), y.dot(apart), z.dot(apart)]
        parallel = [x.dot(z2), y.dot(z2)]
        if joint.kind == "screw":
            return [*ball[:2], *parallel, screwed(joint.lead, ball[2], x.dot(x2), y.dot(x2))]
        return {
            "fixed": [*ball, *parallel, x.dot(y2)],
            "revolute": [*ball, *parallel],
            "prismatic": [*ball[:2], *parallel, x.dot(y2)],
            "cylindrical": [*ball[:2], *parallel],
            "spherical": ball,
            "universal": [*ball, x.dot(y2)],
            "planar": [ball[2], *parallel],
            "point_on_line": ball[:2],
            "pin": ball[:2],
            "point_on_plane": ball[2:],
            "rod": [apart.dot(apart)],
            "free": [],
        }[joint.kind]

    def masses(self) -> np.ndarray:
        """Mass matrix, shape (n, n), block by block."""
        matrix = np.zeros((self.n, self.n), LONG)
        for i, name in enumerate(self.names):
            body, turn, k = self.linkage.bodies[name], self.turn[name], 6 * i
            matrix[k : k + 3, k : k + 3] = body.mass * np.eye(3)
            matrix[k + 3 : k + 6, k + 3 : k + 6] = turn @ body.inertia.astype(LONG) @ turn.T
        return matrix

    def forces(self, matrix: np.ndarray) -> np.ndarray:
        """Weights and gyroscopic moments, shape (n,)."""
        total = np.zeros(self.n, LONG)
        for i, name in enumerate(self.names):
            k, omega = 6 * i, self.omega[name]
            total[k + 2] -= self.linkage.bodies[name].mass * LONG(self.linkage.gravity)
            total[k + 3 : k + 6] = -np.cross(omega, matrix[k + 3 : k + 6, k + 3 : k + 6] @ omega)
        return total


@dataclass(frozen=True)
class Answer:
    """Accelerations of the bodies, and the wrench [f; m] of every joint's first body on its second at frame 2."""

    acceleration: dict[str, np.ndarray]
    alpha: dict[str, np.ndarray]
    wrench: dict[str, np.ndarray]
    open: float
    speed: float
    redundant: int
    pushes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Mesh:
    """Teeth that push the second body along a line of action that is fixed in the ground, the first one against it."""

    first: str
    second: str
    at: np.ndarray
    along: np.ndarray

    def row(self, bodies: Bodies) -> tuple:
        """Row, rate and second rate without accelerations of ``n . (v2 - v1)`` of what is at the pitch point."""
        row, rate, bias = np.zeros(bodies.n, LONG), LONG(0), LONG(0)
        for body, sign in ((self.first, -1), (self.second, 1)):
            k, n = 6 * bodies.names.index(body), sign * self.along.astype(LONG)
            arm, omega, v = self.at - bodies.place[body], bodies.omega[body], bodies.velocity[body]
            row[k : k + 3], row[k + 3 : k + 6] = n, np.cross(arm, n)
            rate += n @ (v + np.cross(omega, arm))
            bias -= n @ np.cross(omega, v)  # the arm grows by -v
        return row, rate, bias, LONG(0)


def newton_euler(linkage: Linkage, poses: Poses, dependent: float = 1e-9, meshes: tuple[Mesh, ...] = ()) -> Answer:
    """Solve ``M x'' = f + J^T lam``, ``J x'' = -bias``, by orthogonalising the rows of ``J M^-1/2``.

    Where rows are redundant the first ones carry the load. ``dependent`` is the part of a row of length 1 below which
    it depends on the others; 0 where none may.
    """
    bodies = Bodies(linkage, poses)
    owners = [name for name, joint in linkage.joints.items() for _ in bodies.rows(joint)]
    found = [row for joint in linkage.joints.values() for row in bodies.rows(joint)]
    found += [mesh.row(bodies) for mesh in meshes]
    rows, rates, biases = np.array([row for row, _, _, _ in found]), [r[1] for r in found], [r[2] for r in found]
    matrix = bodies.masses()
    root = inverse_root(matrix)
    free = root.T @ bodies.forces(matrix)  # in scaled coordinates y = M^1/2 x''
    scaled = rows @ root
    length = np.sqrt((scaled**2).sum(axis=1))
    kept, basis, lower = orthogonal(scaled / length[:, None], dependent)
    right = -np.array(biases)[kept] / length[kept]
    weights = forward_substitution(lower, right - (scaled[kept] / length[kept][:, None]) @ free)
    motion = root @ (free + basis.T @ weights)
    lam = np.zeros(len(rows), LONG)
    lam[kept] = backward_substitution(lower.T, weights) / length[kept]
    ends = {name: bodies.point(joint.second, joint.end()).value for name, joint in linkage.joints.items()}
    wrench = {name: np.zeros(6) for name in linkage.joints}
    for name, joint in linkage.joints.items():
        mine = [i for i, owner in enumerate(owners) if owner == name]
        wrench[name] = _on_second(bodies, joint, ends[name], rows[mine].T @ lam[mine])
    closed = [
        abs(value - linkage.joints[owner].length ** 2) for owner, (_, _, _, value) in zip(owners, found, strict=False)
    ]
    k = {name: 6 * i for i, name in enumerate(bodies.names)}
    return Answer(
        {name: motion[i : i + 3].astype(float) for name, i in k.items()},
        {name: motion[i + 3 : i + 6].astype(float) for name, i in k.items()},
        wrench, float(max(closed, default=0)), float(np.abs(rates).max(initial=0)), len(rows) - len(kept),
        tuple(lam[len(owners) :].astype(float)),
    )  # fmt: skip


def _on_second(bodies: Bodies, joint: Joint, end: np.ndarray, load: np.ndarray) -> np.ndarray:
    """The wrench at frame 2; where the second body is the ground it is the opposite of that on the first."""
    body, sign = (joint.second, 1) if joint.second != GROUND else (joint.first, -1)
    k = 6 * bodies.names.index(body)
    force, moment = sign * load[k : k + 3], sign * load[k + 3 : k + 6]
    return np.concatenate([force, moment + np.cross(bodies.place[body] - end, force)]).astype(float)


def inverse_root(matrix: np.ndarray) -> np.ndarray:
    """M^-1/2 of a matrix of 3 by 3 blocks, as the inverse of a triangular factor: ``R R^T = M^-1``."""
    root = np.zeros_like(matrix)
    for k in range(0, len(matrix), 3):
        block = matrix[k : k + 3, k : k + 3]
        lower = np.zeros((3, 3), LONG)
        for i in range(3):
            for j in range(i + 1):
                left = block[i, j] - lower[i, :j] @ lower[j, :j]
                lower[i, j] = np.sqrt(left) if i == j else left / lower[j, j]
        root[k : k + 3, k : k + 3] = np.array([forward_substitution(lower, e) for e in np.eye(3, dtype=LONG)])
    return root


def orthogonal(rows: np.ndarray, dependent: float) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Rows that are independent, in the order of their size left, an orthonormal basis B of them, L with rows = L B."""
    left, kept, basis = rows.copy(), [], np.zeros((0, rows.shape[1]), LONG)
    for _ in range(min(rows.shape)):
        size = np.sqrt((left**2).sum(axis=1))
        best = int(size.argmax())
        if size[best] <= dependent or best in kept:
            break
        kept.append(best)
        direction = left[best] / size[best]
        direction -= basis.T @ (basis @ direction)  # once more: nothing of the others may be left
        basis = np.vstack([basis, direction / np.sqrt(direction @ direction)])
        left = left - np.outer(left @ basis[-1], basis[-1])
        left[kept] = 0
    return kept, basis, np.tril(rows[kept] @ basis.T)


def forward_substitution(lower: np.ndarray, right: np.ndarray) -> np.ndarray:
    x = np.zeros(len(right), LONG)
    for i in range(len(right)):
        x[i] = (right[i] - lower[i, :i] @ x[:i]) / lower[i, i]
    return x


def backward_substitution(upper: np.ndarray, right: np.ndarray) -> np.ndarray:
    return forward_substitution(upper[::-1, ::-1], right[::-1])[::-1]


def self_stresses(linkage: Linkage, poses: Poses) -> list[dict[str, np.ndarray]]:
    """What the joints of a linkage can do to each other without any load: wrench of each joint, as in ``Answer``."""
    bodies = Bodies(linkage, poses)
    owners = [name for name, joint in linkage.joints.items() for _ in bodies.rows(joint)]
    rows = np.array([row for joint in linkage.joints.values() for row, *_ in bodies.rows(joint)])
    length = np.sqrt((rows**2).sum(axis=1))
    u, s, _ = np.linalg.svd((rows / length[:, None]).astype(float))
    found = []
    for stress in u[:, int((s > 1e-9).sum()) :].T:
        wrenches = {}
        for name, joint in linkage.joints.items():
            mine = [i for i, owner in enumerate(owners) if owner == name]
            end = bodies.point(joint.second, joint.end()).value
            load = rows[mine].T @ (stress[mine] / length[mine])
            wrenches[name] = _on_second(bodies, joint, end, load)
        found.append(wrenches)
    return found
