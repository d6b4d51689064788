"""Linkages as graphs: bodies and joints, none of which is a loop joint before a spanning tree has been chosen.

At the reference pose, where all joints stand at 0, every link frame that is written has the axes of the world.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinarm.records import replace
from pinarm.use.mechanism import Mechanism

GROUND = "base"
X, Y, Z = np.eye(3)
SLIDE, TURN = "prismatic", "continuous"
BALL = ((TURN, X), (TURN, Y), (TURN, Z))
SIMPLE = {
    "fixed": (),
    "revolute": ((TURN, Z),),
    "prismatic": ((SLIDE, Z),),
    "cylindrical": ((SLIDE, Z), (TURN, Z)),
    "screw": ((SLIDE, Z), (TURN, Z)),
    "spherical": BALL,
    "universal": ((TURN, X), (TURN, Y)),
    "planar": ((SLIDE, X), (SLIDE, Y), (TURN, Z)),
    "point_on_line": ((SLIDE, Z), *BALL),
    "pin": ((SLIDE, Z), *BALL),
    "point_on_plane": ((SLIDE, X), (SLIDE, Y), *BALL),
    "rod": ((TURN, X), (TURN, Y), *BALL),
    "free": ((SLIDE, X), (SLIDE, Y), (SLIDE, Z), *BALL),
}
"""Every kind of joint, and the simple joints that make it: the motion of frame 2 seen from frame 1, in its axes.

The ball joint of a rod stands at its end; a free joint holds nothing. Those of a screw are coupled.
"""


@dataclass(frozen=True)
class Body:
    """A body at the reference pose: centre of mass and inertia about it, in world axes."""

    mass: float
    com: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True)
class Joint:
    """A joint between two bodies; ``turn`` and ``place`` are those of frame 1 at the reference pose, in the world.

    Frame 2 has the same axes and stands ``length`` further along z, which only a rod uses. ``lead``: of a screw.
    """

    kind: str
    first: str
    second: str
    place: np.ndarray
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    length: float = 0.0
    lead: float = 0.0

    @property
    def freedom(self) -> int:
        """Number of its free motions."""
        return 1 if self.kind == "screw" else len(SIMPLE[self.kind])

    def end(self) -> np.ndarray:
        """The place of frame 2."""
        return self.place + self.length * self.turn[:, 2]

    def simple(self) -> list[tuple[str, np.ndarray, np.ndarray]]:
        """The simple joints from first to second: type, axis and place in the world."""
        parts = SIMPLE[self.kind]
        ends = [self.place] * 2 + [self.end()] * 3 if self.kind == "rod" else [self.place] * len(parts)
        return [(kind, self.turn @ axis, at) for (kind, axis), at in zip(parts, ends, strict=True)]

    def reversed(self) -> Joint:
        """The same joint as ``between: [second, first]`` says it, for kinds that are the same seen from either side."""
        return replace(self, first=self.second, second=self.first)


@dataclass(frozen=True)
class Linkage:
    """Bodies and joints by name, and gravity in world axes."""

    bodies: dict[str, Body]
    joints: dict[str, Joint]
    gravity: float = 9.81

    def tree(self, cut: Iterable[str] = ()) -> list[tuple[str, str, str]]:
        """A spanning tree without the joints that are cut: joint, parent, child, depth first."""
        left = {name: joint for name, joint in self.joints.items() if name not in set(cut)}
        found: list[tuple[str, str, str]] = []

        def visit(body: str) -> None:
            for name, joint in list(left.items()):
                if name in left and body in (joint.first, joint.second):
                    child = joint.second if body == joint.first else joint.first
                    if child == GROUND or child in {known for _, _, known in found}:
                        continue
                    del left[name]
                    found.append((name, body, child))
                    visit(child)

        visit(GROUND)
        missing = set(self.bodies) - {child for _, _, child in found}
        assert not missing, f"the cut leaves {missing} loose"
        return found

    def build(self, folder: Path, cut: Iterable[str] = (), **description) -> Mechanism:
        """Write the mechanism whose loop joints are those not in the tree, and load it."""
        tree = self.tree(cut)
        held = {name: parent for name, parent, _ in tree}
        loops = {name: joint for name, joint in self.joints.items() if name not in held and joint.kind != "free"}
        (folder / "model.urdf").write_text(_Text(self, tree).urdf())
        written = {
            "pinarm": 1, "robot": "model.urdf",
            "gravity": {"direction": "-z", "magnitude": f"{self.gravity!r} m/s^2"} if self.gravity else "none",
            "loops": {name: self._loop(name, joint) for name, joint in loops.items()},
            "couplings": {f"{name}_thread": self._coupling(name, parent) for name, parent in held.items()
                          if self.joints[name].kind == "screw"},
            **description,
        }  # fmt: skip
        (folder / "mechanism.yaml").write_text(json.dumps(written))
        return Mechanism.load(folder / "mechanism.yaml")

    def _loop(self, name: str, joint: Joint) -> dict:
        further = {"rod": {"length": f"{joint.length!r} m"}, "screw": {"lead": f"{joint.lead!r} m"}}.get(joint.kind, {})
        return {"kind": joint.kind, "between": [f"{name}_1", f"{name}_2"], **further}

    def _coupling(self, name: str, parent: str) -> dict:
        """Couple the simple joints of a screw in the tree: seen from its first body, first it slides, then it turns."""
        joint = self.joints[name]
        letters = "ba" if parent == joint.first else "ab"
        return {"kind": "screw", "joints": [f"{name}_{letter}" for letter in letters], "lead": f"{joint.lead!r} m"}

    def turned(self, turn: np.ndarray) -> Linkage:
        """The linkage with everything but gravity turned about the origin."""
        return replace(
            self,
            bodies={
                name: Body(body.mass, turn @ body.com, turn @ body.inertia @ turn.T)
                for name, body in self.bodies.items()
            },
            joints={
                name: replace(joint, place=turn @ joint.place, turn=turn @ joint.turn)
                for name, joint in self.joints.items()
            },
        )

    def changed(self, change: Callable[[str, Body], Body]) -> Linkage:
        """The linkage with other bodies."""
        return replace(self, bodies={name: change(name, body) for name, body in self.bodies.items()})


class _Text:
    """The URDF of a linkage and one of its spanning trees."""

    def __init__(self, linkage: Linkage, tree: list[tuple[str, str, str]]) -> None:
        self.linkage, self.tree = linkage, tree
        self.at: dict[str, np.ndarray] = {GROUND: np.zeros(3)}
        self.parts = [f'<link name="{GROUND}"/>']

    def urdf(self) -> str:
        for name, parent, child in self.tree:
            self._joint(name, parent, child)
        for body in (GROUND, *self.linkage.bodies):
            self._marks(body)
        return f'<robot name="linkage">{"".join(self.parts)}</robot>'

    def _joint(self, name: str, parent: str, child: str) -> None:
        """The simple joints of a joint, with links without mass between them; backwards where the child is first."""
        joint = self.linkage.joints[name]
        parts = joint.simple()
        if joint.first == child:
            parts = [(kind, -axis, at) for kind, axis, at in reversed(parts)]
        last = joint.place if joint.first == child else joint.end()
        above = parent
        for k, (kind, axis, at) in enumerate(parts, 1):
            below = child if k == len(parts) else f"{name}_link_{k}"
            if below != child:
                self.parts.append(f'<link name="{below}"/>')
            self._add(name if len(parts) == 1 else f"{name}_{'abcdef'[k - 1]}", kind, above, below, at, axis)
            above = below
        if not parts:
            self._add(name, "fixed", parent, child, last, Z)
        self.parts.append(f'<link name="{child}">{self._inertial(child)}</link>')

    def _add(self, name: str, kind: str, parent: str, child: str, at: np.ndarray, axis: np.ndarray) -> None:
        self.at[child] = at
        limit = '<limit lower="-1e3" upper="1e3" effort="1e9" velocity="1e9"/>' if kind == SLIDE else ""
        self.parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{_words(at - self.at[parent])}"/><axis xyz="{_words(axis)}"/>{limit}</joint>'
        )

    def _inertial(self, name: str) -> str:
        body = self.linkage.bodies[name]
        if not body.mass:
            return ""
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia
        return (
            f'<inertial><origin xyz="{_words(body.com - self.at[name])}"/><mass value="{float(body.mass)!r}"/>'
            f'<inertia ixx="{float(xx)!r}" iyy="{float(yy)!r}" izz="{float(zz)!r}" ixy="{float(xy)!r}" '
            f'ixz="{float(xz)!r}" iyz="{float(yz)!r}"/></inertial>'
        )

    def _marks(self, body: str) -> None:
        """The frames of the joints on a body, and one at its centre of mass."""
        if body != GROUND:
            self._mark(f"{body}_com", body, self.linkage.bodies[body].com, np.eye(3))
        for name, joint in self.linkage.joints.items():
            if joint.first == body:
                self._mark(f"{name}_1", body, joint.place, joint.turn)
            if joint.second == body:
                self._mark(f"{name}_2", body, joint.end(), joint.turn)

    def _mark(self, name: str, body: str, at: np.ndarray, turn: np.ndarray) -> None:
        self.parts.append(
            f'<link name="{name}"/><joint name="{name}_fixed" type="fixed"><parent link="{body}"/>'
            f'<child link="{name}"/><origin xyz="{_words(at - self.at[body])}" '
            f'rpy="{_words(pin.rpy.matrixToRpy(turn))}"/></joint>'
        )


def _words(vector: np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in vector)


@dataclass(frozen=True)
class Poses:
    """How the bodies of a mechanism stand and move: orientation, and the motion of the centres of mass, world axes."""

    turn: dict[str, np.ndarray]
    place: dict[str, np.ndarray]
    omega: dict[str, np.ndarray]
    velocity: dict[str, np.ndarray]
    alpha: dict[str, np.ndarray]
    acceleration: dict[str, np.ndarray]

    @classmethod
    def of(cls, linkage: Linkage, mechanism: Mechanism, q, v, a) -> Poses:
        """By forward kinematics of the tree."""
        model = mechanism.model
        data = model.createData()
        pin.forwardKinematics(model, data, q, v, a)
        pin.updateFramePlacements(model, data)
        found = cls({}, {}, {}, {}, {}, {})
        for name in linkage.bodies:
            frame = model.getFrameId(f"{name}_com")
            velocity = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            acceleration = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            found.turn[name], found.place[name] = data.oMf[frame].rotation.copy(), data.oMf[frame].translation.copy()
            found.omega[name], found.velocity[name] = velocity.angular.copy(), velocity.linear.copy()
            found.alpha[name], found.acceleration[name] = acceleration.angular.copy(), acceleration.linear.copy()
        return found

    def stacked(self) -> np.ndarray:
        """All numbers of all bodies, each body's in a row."""
        parts = (self.place, self.turn, self.velocity, self.omega, self.acceleration, self.alpha)
        return np.array([np.concatenate([part[name].ravel() for part in parts]) for name in sorted(self.place)])


def random_turn(generator: np.random.Generator) -> np.ndarray:
    """A rotation, evenly distributed."""
    return np.asarray(pin.Quaternion(*_unit(generator.normal(size=4))).toRotationMatrix())


def random_body(generator: np.random.Generator, scale: float = 1.0) -> Body:
    """A body whose inertia some distribution of mass has."""
    points = generator.normal(size=(6, 3)) * 0.2
    com, mass = generator.uniform(-0.6, 0.6, 3), scale * generator.uniform(0.5, 2.0)
    points -= points.mean(axis=0)
    second = mass / 6 * points.T @ points
    return Body(mass, com, np.trace(second) * np.eye(3) - second)


def random_joint(generator: np.random.Generator, kind: str, first: str, second: str) -> Joint:
    """A joint anywhere near the origin, in any direction."""
    length = float(generator.uniform(0.4, 0.8)) if kind == "rod" else 0.0
    place, turn = generator.uniform(-0.6, 0.6, 3), random_turn(generator)
    lead = float(generator.uniform(-0.5, -0.2)) if kind == "screw" else 0.0
    return Joint(kind, first, second, place, turn, length, lead)


def _unit(x: np.ndarray) -> np.ndarray:
    return x / np.linalg.norm(x)
