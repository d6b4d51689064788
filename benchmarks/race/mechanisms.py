"""The mechanisms of the race as plain numbers, from which every engine's model is built."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
ORIGIN, UPRIGHT = (0.0, 0.0, 0.0), (X, Y, Z)


@dataclass(frozen=True)
class Body:
    """A body and the joint that carries it, revolute as a rule; the link frame stands at the joint.

    Attributes:
        name: Of the joint.
        parent: Index of the body that it turns on; -1 for the ground.
        place: Origin of the joint in the parent's frame [m].
        axis: Of the joint, in the link frame.
        mass: [kg].
        com: Mass centre, link frame [m].
        inertia: About the mass centre, link axes [kg*m^2].
        rotation: Axes of the link frame in the parent's at angle 0, a matrix.
        q: Angle at the start [rad].
        v: Its velocity [rad/s].
        torque: Of a motor, constant [N*m].
        stiffness: Of a spring that is free at angle 0 [N*m/rad].
        damping: [N*m*s/rad].
        slides: Whether the joint is prismatic: metres then, not radians.
    """

    name: str
    parent: int
    place: Vector
    axis: Vector
    mass: float
    com: Vector
    inertia: Matrix
    rotation: Matrix = UPRIGHT
    q: float = 0.0
    v: float = 0.0
    torque: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    slides: bool = False


@dataclass(frozen=True)
class Loop:
    """A revolute joint that closes a loop: a point of one body meets a point of another, which shares its axis there.

    Attributes:
        bodies: Indices of the two; -1 for the ground.
        points: In their link frames [m].
        axis: In either link frame, at angles 0.
        planar: Whether the tree keeps the axis by itself: then the two points are all there is to close.
    """

    bodies: tuple[int, int]
    points: tuple[Vector, Vector]
    axis: Vector = Z
    planar: bool = True


@dataclass(frozen=True)
class Spring:
    """A spring from a point of a body to a point of the ground: body, point [m], anchor [m], [N/m], free length [m]."""

    body: int
    point: Vector
    anchor: Vector
    stiffness: float
    length: float


@dataclass(frozen=True)
class Flight:
    """The first body is not held: it starts at the origin, unturned, with these velocities [m/s], [rad/s]."""

    linear: Vector
    angular: Vector


@dataclass(frozen=True)
class Linkage:
    """Bodies, depth first, their loops, and what acts on them.

    Attributes:
        bodies: All bodies.
        gravity: [m/s^2].
        loops: Joints that close loops.
        spring: Between a body and the ground.
        flight: Of a first body that flies; its joint is none then.
    """

    bodies: tuple[Body, ...]
    gravity: Vector = ORIGIN
    loops: tuple[Loop, ...] = ()
    spring: Spring | None = None
    flight: Flight | None = None

    @property
    def hinged(self) -> tuple[Body, ...]:
        """The bodies that a joint carries."""
        return self.bodies[1:] if self.flight else self.bodies

    @cached_property
    def q(self) -> np.ndarray:
        """Angles of the joints at the start [rad], shape (n,)."""
        return np.array([body.q for body in self.hinged])

    @cached_property
    def v(self) -> np.ndarray:
        """Their velocities [rad/s], shape (n,)."""
        return np.array([body.v for body in self.hinged])

    @cached_property
    def torque(self) -> np.ndarray:
        """Torques of the motors [N*m], shape (n,)."""
        return np.array([body.torque for body in self.hinged])

    @cached_property
    def stiffness(self) -> np.ndarray:
        """Of the joints' springs [N*m/rad], shape (n,)."""
        return np.array([body.stiffness for body in self.hinged])

    @cached_property
    def damping(self) -> np.ndarray:
        """Of the joints' dampers [N*m*s/rad], shape (n,)."""
        return np.array([body.damping for body in self.hinged])


def diagonal(x: float, y: float, z: float) -> Matrix:
    return ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z))


def rod(name: str, parent: int, place: Vector, axis: Vector, end: Vector, **start: float) -> Body:
    """Return a uniform rod of 1 kg from its joint to ``end``.

    Its inertia about its own line, which no planar motion sees, is a millionth: some engines refuse 0.
    """
    length = float(np.linalg.norm(end))
    across, along = length**2 / 12, 1e-6 * length**2
    inertia = diagonal(*(across + (along - across) * (x / length) ** 2 for x in end))
    return Body(name, parent, place, axis, 1.0, tuple(0.5 * x for x in end), inertia, **start)


NOTHING = diagonal(0.0, 0.0, 0.0)


def double_pendulum() -> Linkage:
    down = (0.0, -1.0, 0.0)
    upper = rod("upper", -1, ORIGIN, Z, down, q=0.8)
    return Linkage((upper, rod("lower", 0, down, Z, down, q=0.8)), (0.0, -9.81, 0.0))


def four_bars(count: int) -> Linkage:
    """IFToMM A02: uprights 1 m apart, joined at their tops, turning about -z; the tops start with 1 m/s."""
    axis, bodies, loops = (0.0, 0.0, -1.0), [], []
    for i in range(count + 1):
        bodies.append(rod(f"upright_{i}", -1, (float(i), 0.0, 0.0), axis, Y, v=1.0))
        if i:
            loops.append(Loop((2 * i - 1, 2 * i), (X, Y)))
        if i < count:
            bodies.append(rod(f"coupler_{i}", 2 * i, Y, axis, X, v=-1.0))
    return Linkage(tuple(bodies), (0.0, -9.81, 0.0), tuple(loops))


def scissor(count: int) -> Linkage:
    """Return a row of crosses of two equal bars, a square of 1 m each, on one hinge; all of them move alike.

    The falling bar of a cross carries the rising bar of the next at its lower end, and is carried at its middle by its
    own rising bar, whose upper end a loop ties to the falling bar of the next.
    """
    bodies, loops = [], []
    for k in range(count):
        place = (0.5, -0.5, 0.0) if k else ORIGIN
        rising = rod(f"rising_{k}", 2 * k - 1, place, Z, (1.0, 1.0, 0.0))
        bodies += [rising, Body(f"falling_{k}", 2 * k, rising.com, Z, rising.mass, ORIGIN, rising.inertia)]
        if k:
            loops.append(Loop((2 * k - 2, 2 * k + 1), ((1.0, 1.0, 0.0), (-0.5, 0.5, 0.0))))
    return Linkage(tuple(bodies), (0.0, -9.81, 0.0), tuple(loops))


def chain(count: int) -> Linkage:
    """Return rods of 1 m and 1 kg in a row, let go in a straight line that is 0.5 rad from hanging."""
    down = (0.0, -1.0, 0.0)
    bodies = (rod(f"link_{k}", k - 1, down if k else ORIGIN, Z, down, q=0.0 if k else 0.5) for k in range(count))
    return Linkage(tuple(bodies), (0.0, -9.81, 0.0))


def andrews() -> Linkage:
    """Andrews' squeezing mechanism, IVP Test Set."""

    def body(name: str, parent: int, x: float, y: float, m: float, cx: float, cy: float, i: float, q: float) -> Body:
        return Body(name, parent, (x, y, 0.0), Z, m, (cx, cy, 0.0), diagonal(i, i, i), q=q)

    a, b = (-0.06934, -0.00227), (-0.03635, 0.03273)
    crank = Body("beta", -1, ORIGIN, Z, 0.04325, (0.00092, 0.0, 0.0), diagonal(2.194e-6, 2.194e-6, 2.194e-6),
                 q=-0.0617138900142765, torque=0.033)  # fmt: skip
    bodies = (
        crank,
        body("Theta", 0, 0.007, 0.0, 0.00365, -0.0115, 0.0, 4.410e-7, 0.0),
        body("gamma", -1, *b, 0.02373, 0.01043, -0.01874, 5.255e-6, 0.455279819163070),
        body("delta", -1, *a, 0.07050, 0.02308, 0.00916, 1.169e-5, 0.487364979543844),
        body("Phi", 3, 0.04, 0.0, 0.00706, 0.0, -0.00579, 5.667e-7, 0.222668390165886),
        body("epsilon", -1, *a, 0.05498, 0.01228, 0.00449, 1.912e-5, 1.23054744454982),
        body("Omega", 5, 0.0, -0.04, 0.00706, 0.00579, 0.0, 5.667e-7, -0.222668390165886),
    )
    point = (-0.028, 0.0, 0.0)
    ends = ((2, (0.0, -0.035, 0.0)), (4, (0.0, -0.02, 0.0)), (6, (0.02, 0.0, 0.0)))
    spring = Spring(2, (0.02, -0.018, 0.0), (0.014, 0.072, 0.0), 4530.0, 0.07785)
    return Linkage(bodies, loops=tuple(Loop((1, k), (point, end)) for k, end in ends), spring=spring)


def bricard() -> Linkage:
    """IFToMM A04: rods of square section along edges of a unit cube, P0 to P5; the sixth rod is the ground."""
    edges = (X, (0.0, -1.0, 0.0), Z, (-1.0, 0.0, 0.0), Y)
    across, along = (1 + 0.1**2) / 12, 0.1**2 / 6
    bodies = tuple(
        Body(f"P{k}", k - 1, edges[k - 1] if k else ORIGIN, axis, 1.0, tuple(0.5 * x for x in edge),
             diagonal(*(along if x else across for x in edge)))
        for k, (axis, edge) in enumerate(zip((Y, Z, X, Y, Z), edges, strict=True))
    )  # fmt: skip
    loop = Loop((4, -1), (Y, Z), axis=X, planar=False)
    return Linkage(bodies, (0.0, -9.81, 0.0), (loop,))


def manipulator() -> Linkage:
    """The manipulator of ``models/manipulator``: a parallelogram with a counterweight, and a massless cylinder."""
    l, d, r, h, ae = 2.0, 1.25, 0.75, 2.0, 0.6
    arm, support, link, counterweight, load = 100.0, 120.0, 60.0, 270.0, 600.0

    def bar(mass: float, length: float, x: float) -> tuple[float, Vector, Matrix]:
        return mass, (x, 0.0, 0.0), diagonal(0.0, mass * length**2 / 12, mass * length**2 / 12)

    first = lumped([bar(arm, l + d, 0.5 * (l - d)), (counterweight, (-d, 0.0, 0.0), NOTHING)])
    second = lumped([(support, (0.3, -0.2, 0.0), NOTHING), (load, (0.5, 0.1, 0.0), NOTHING)])
    bodies = (
        Body("alpha", -1, ORIGIN, Z, *first),
        Body("B", 0, (l, 0.0, 0.0), Z, *second),
        Body("E", -1, (0.0, ae, 0.0), Z, *bar(link, l, 0.5 * l)),
        Body("x", -1, (0.0, -h, 0.0), X, 0.0, ORIGIN, NOTHING, slides=True),
        Body("y", 3, ORIGIN, Y, 0.0, ORIGIN, NOTHING, slides=True),
    )
    loops = (Loop((1, 2), ((0.0, ae, 0.0), (l, 0.0, 0.0))), Loop((0, 4), ((-r, 0.0, 0.0), ORIGIN)))
    return Linkage(bodies, (0.0, -9.81, 0.0), loops)


def lumped(parts: list[tuple[float, Vector, Matrix]]) -> tuple[float, Vector, Matrix]:
    """Return mass, mass centre and inertia about it of parts, given the same of each."""
    total = sum(mass for mass, _, _ in parts)
    centre = sum(mass * np.array(com) for mass, com, _ in parts) / total
    inertia = np.zeros((3, 3))
    for mass, com, own in parts:
        apart = np.array(com) - centre
        inertia += np.array(own) + mass * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    return total, tuple(centre.tolist()), tuple(map(tuple, inertia.tolist()))


def panda() -> Linkage:
    """The robot of example-robot-data with its fingers locked, without gravity, as Pinocchio reads it."""
    import pinocchio as pin

    from pinarm.input.roots import example_robot_data

    folder = example_robot_data() / "robots" / "panda_description" / "urdf"
    whole = pin.buildModelFromUrdf(str(folder / "panda.urdf"))
    fingers = [whole.getJointId(name) for name in whole.names if "finger" in name]
    model = pin.buildReducedModel(whole, fingers, pin.neutral(whole))
    start = (0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4)
    torques = (0.2, -0.4, 0.2, 0.4, 0.1, -0.1, 0.04)
    assert all(model.joints[k].shortname() == "JointModelRZ" for k in range(1, 8))
    bodies = []
    for k, (q, torque) in enumerate(zip(start, torques, strict=True)):
        placement, inertia = model.jointPlacements[k + 1], model.inertias[k + 1]
        rotation, moments = (tuple(map(tuple, x.tolist())) for x in (placement.rotation, inertia.inertia))
        place, com = (tuple(x.tolist()) for x in (placement.translation, inertia.lever))
        bodies.append(Body(f"panda_{k + 1}", k - 1, place, Z, float(inertia.mass), com, moments, rotation, q=q,
                           torque=torque))  # fmt: skip
    return Linkage(tuple(bodies))


def beam() -> Linkage:
    """A steel rule let go: a hinged rod of 1 m and 1 kg in eight segments, stiff springs and dampers between them."""
    count = 8
    mass, length = 1.0 / count, 1.0 / count
    moment = mass * length**2 / 12
    segment = {"mass": mass, "com": (0.5 * length, 0.0, 0.0), "inertia": diagonal(0.01 * moment, moment, moment)}
    first = Body("hinge", -1, ORIGIN, Z, q=-0.5, **segment)
    rest = (Body(f"bend_{k}", k - 1, (length, 0.0, 0.0), Z, stiffness=1e4, damping=10.0, **segment)
            for k in range(1, count))  # fmt: skip
    return Linkage((first, *rest), (0.0, -9.81, 0.0))


def satellite() -> Linkage:
    """A tumbling hub of 10 kg with two arms of two rods, weightless; springs hold the arms."""
    bodies = [Body("hub", -1, ORIGIN, Z, 10.0, (0.02, 0.01, 0.0), diagonal(0.3, 0.4, 0.5))]
    for side, name in ((1.0, "right"), (-1.0, "left")):
        end = (0.5 * side, 0.0, 0.0)
        shoulder = rod(f"{name}_shoulder", 0, (0.2 * side, 0.0, 0.05), Y, end, q=0.3 * side, v=0.5, stiffness=2.0)
        elbow = rod(f"{name}_elbow", len(bodies), end, Z, end, q=0.4, v=-0.3 * side, stiffness=2.0)
        bodies += [shoulder, elbow]
    return Linkage(tuple(bodies), flight=Flight((0.1, -0.2, 0.05), (1.5, 0.1, 0.1)))
