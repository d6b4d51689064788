"""Loops: masses, sizes, singular positions; arms at the border of their workspace."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from catalogue import TWO_CRANKS, axes_along, bar, four_bar, rssr, slider_crank, two_cranks
from extreme import WRONG, Case, G, hinge, integrated, largest, solved
from extreme_bodies import X, decay
from linkage import GROUND, Body, Joint, Linkage
from motions import driven, poses
from newton_euler import newton_euler
from random_chains import reference
from scipy.integrate import solve_ivp

from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.forces.along_coordinate import JointSpring
from pinarm.mechanics.laws import Constant, ConstantSpeed, Harmonic
from pinarm.records import replace

NEWTON = "Newton-Euler equations of all bodies in extended precision"


def against_newton(linkage: Linkage, run: Trajectory, dependent: float = 1e-9) -> float:
    """Error of all accelerations at all rows, relative to the largest."""
    found = []
    for pose in poses(linkage, run):
        right = newton_euler(linkage, pose, dependent)
        for mine, theirs in ((pose.acceleration, right.acceleration), (pose.alpha, right.alpha)):
            size = max(largest(one) for one in theirs.values())
            found.append(max(largest(mine[name] - theirs[name]) for name in linkage.bodies) / max(size, 1e-300))
    return max(found)


def uneven(linkage: Linkage, cut: str, body: str, ratio: float, folder: Path) -> float:
    """A loop one of whose bodies is much lighter or heavier; what it gains or loses of energy counts as well."""
    one = linkage.changed(
        lambda name, b: replace(b, mass=b.mass * ratio, inertia=b.inertia * ratio) if name == body else b
    )
    run = integrated(one.build(folder, [cut]), 0.05, 5, velocity={"O": 2.0}, max_steps=1000)
    return max(against_newton(one, run.rows), run.measures()["energy"])


def crank(size: float, speed: float, turns: float, cut: str, folder: Path) -> float:
    """A crank of 0.1 and a rod of 0.3 times the size at constant speed: place of the slider and torque of the crank.

    With the angle t of the crank, x = r cos t + sqrt(l^2 - r^2 sin^2 t), and the torque is the rate of the kinetic
    energy over the speed; the rod's mass stands in two halves at its ends and has no inertia of its own about itself
    beyond theirs, so that only the slider with its half counts.
    """
    r, l = 0.1 * size, 0.3 * size
    o, a, b = np.zeros(3), np.array([0.0, 0.0, r]), np.array([np.sqrt(l * l - r * r), 0.0, 0.0])
    along = b - a
    dumbbell = Body(2.0, (a + b) / 2, 2.0 / 4.0 * (along @ along * np.eye(3) - np.outer(along, along)))
    bodies = {"crank": Body(1.0, o, r * r * np.eye(3)), "rod": dumbbell, "slider": Body(3.0, b)}
    joints = {"O": hinge(GROUND, "crank"), "A": hinge("crank", "rod", *a[::2]), "B": hinge("rod", "slider", *b[::2]),
              "C": Joint("prismatic", GROUND, "slider", b, axes_along(X))}  # fmt: skip
    mechanism = Linkage(bodies, joints, 0.0).build(folder, [cut])
    run = driven(mechanism, {"O": ConstantSpeed(speed=speed)}, turns * 2.0 * np.pi / speed, 201)
    asked = Quantities(run)
    t = np.pi / 2 - speed * run.grid.t
    root = np.sqrt(l * l - (r * np.sin(t)) ** 2)
    x = r * np.cos(t) + root
    slope = -r * np.sin(t) - r * r * np.sin(t) * np.cos(t) / root  # dx/dt, then d2x/dt2
    bend = -r * np.cos(t) - r * r * np.cos(2 * t) / root - (r * r * np.sin(t) * np.cos(t)) ** 2 / root**3
    torque = -4.0 * speed**2 * slope * bend
    place, effort = asked["point.slider_com.position.x"].values, asked["joint.O.effort"].values
    return max(largest(place - x) / size, largest(effort - torque) / largest(torque))


def sized(linkage: Linkage, cut: str, size: float, folder: Path) -> float:
    """A loop in free motion, lengths times the size and times times its root, against the same of 1 m."""
    lengths = {name: replace(one, place=size * one.place, length=size * one.length)
               for name, one in linkage.joints.items()}  # fmt: skip
    bodies = {name: Body(one.mass, size * one.com, size**2 * one.inertia) for name, one in linkage.bodies.items()}
    end = 0.5 * np.sqrt(size)
    run = solved(Linkage(bodies, lengths).build(folder, [cut]), end, 6, velocity={"O": 1.0 / end})
    usual = solved(linkage.build(folder, [cut]), 0.5, 6, velocity={"O": 2.0})
    exact, _ = reference(usual)
    return largest(run.q - exact)


def parallelogram(start: float, speeds: dict[str, float], end: float, cut: str, folder: Path, **more) -> float:
    """Two equal cranks and a coupler, which on their branch move as one pendulum; pi/2 is the position in line."""
    mechanism = replace(two_cranks(start), gravity=0.0 if "loads" in more else G).build(folder, [cut])
    run = solved(mechanism, end, 31, velocity=speeds, **more)
    found = run.q[:, mechanism.joints["O"].q]
    inertia, moment = TWO_CRANKS
    if "loads" in more:
        return decay(run.grid.t, found - REST, DAMPING / inertia, STIFFNESS / inertia)
    turn = [start, speeds.get("O", 0.0)]
    exact = solve_ivp(lambda _, y: [y[1], moment / inertia * np.sin(y[0])], (0.0, end), turn, "DOP853", run.grid.t,
                      rtol=1e-13, atol=1e-13).y[0]  # fmt: skip
    return largest(found + start - exact)


STIFFNESS, DAMPING, REST = 1e9, 1e6, 1e-3
STIFF_LOOP = {"loads": {"spring": JointSpring(joint="O", stiffness=STIFFNESS, damping=DAMPING, rest=REST)},
              "method": "stiff", "tolerance": 1e-8}  # fmt: skip


def arm(x: object, z: object, start: tuple[float, float], folder: Path, fore: float = 1.0) -> float:
    """Two rods in a plane whose tip follows laws: the angle between them by the law of cosines."""
    elbow, tip = np.array([1.0, 0.0, 0.0]), np.array([1.0 + fore, 0.0, 0.0])
    bodies = {"upper": bar(np.zeros(3), elbow, 1.0), "fore": bar(elbow, tip, 1.0)}
    joints = {"A": hinge(GROUND, "upper"), "B": hinge("upper", "fore", 1.0), "T": Joint("free", "fore", GROUND, tip)}
    points = {axis: {"kind": "point", "point": "T_1", "along": axis} for axis in "xz"}
    mechanism = Linkage(bodies, joints).build(folder, ["T"], coordinates=points)
    run = driven(mechanism, {"x": x, "z": z}, 1.0, 101, start=dict(zip("AB", start, strict=True)))
    reached = np.array([run.grid.evaluate(law)[0] for law in (x, z)])
    cosine = ((reached**2).sum(axis=0) - 1.0 - fore**2) / (2.0 * fore)
    return largest(np.cos(run.q[:, 1]) - cosine)


def dead_centre(folder: Path) -> float:
    """A slider-crank moved by its slider over the dead centre, which the law of the slider does not decide."""
    mechanism = slider_crank().build(folder, ["A"])
    driven(mechanism, {"C": Harmonic(mean=-0.1, amplitude=0.2, pulsation=2.0)}, 5.0, 201)
    return WRONG


BENT, STILL = (-0.5, 1.0), Constant(value=0.0)
DIGITS = "rounding, over the distance to the border"
PENDULUM = "one pendulum, SciPy"
LOOPS = {"four-bar": (four_bar(), "B"), "spatial four-bar": (rssr(), "A"), "slider-crank": (slider_crank(), "A")}
FLAT = np.pi / 2
Entry = tuple[str, str, str, Callable[[Path], float], float, str]
ENTRIES: list[Entry] = [
    *[("masses in loops", f"{name}, {body} {ratio:g} times as heavy", NEWTON,
       partial(uneven, *LOOPS[name], body, ratio), 1e-9, "energy over the steps at a tolerance of 1e-12", when)
      for name, body in (("four-bar", "coupler"), ("spatial four-bar", "coupler"), ("spatial four-bar", "crank"),
                         ("slider-crank", "rod"), ("slider-crank", "slider"))
      for ratio, when in ((1e-12, "fast"), (1e12, "fast"))],
    *[("sizes of loops", f"slider-crank of {size:g} m at constant speed, closed at {cut}",
       "closed form of place and torque", partial(crank, size, 10.0, 3.2, cut), 1e-12, "rounding")
      for size, cut in ((1e-6, "A"), (1e6, "C"))],
    *[("sizes of loops", f"{name} of {0.4 * size:g} m in free motion",
       "dense equation of motion at 1 m, SciPy, by similarity", partial(sized, *LOOPS[name], size), bound,
       "1e-12 a step, relative to 1 rad/s; a large one is slower", when)
      for name in ("four-bar", "spatial four-bar")
      for size, bound, when in ((1e-6, 1e-9, "slow"), (1e6, 2e-8, "fast"))],
    ("speeds", "crank of a slider-crank at 1e5 rad/s", "closed form of place and torque",
     partial(crank, 1.0, 1e5, 3.2, "A"), 1e-12, "rounding"),
    ("springs", "spring of 1e9 and damper of 1e6 in a loop, by Radau IIA", "two exponentials",
     partial(parallelogram, 0.3, {}, 1.0, "B", **STIFF_LOOP), 2e-5, "tolerance 1e-8 of 1 rad, moved by 1e-3"),
    *[("arms", f"tip led to {gap:g} m from the border", "law of cosines",
       partial(arm, ConstantSpeed(start=1.0, speed=1.0 - gap), STILL, BENT), 1e-13, "rounding")
      for gap in (1e-6, 1e-9)],
    ("arms", "tip that touches 1e-6 m from the border and turns back", "law of cosines",
     partial(arm, Harmonic(mean=1.5, amplitude=0.5 - 1e-6, pulsation=2 * np.pi), STILL, BENT), 1e-13, "rounding"),
    ("arms", "tip led to the border, the arm straight", "none: velocities are infinite",
     partial(arm, ConstantSpeed(start=1.0, speed=1.0), STILL, BENT), 0.0, "there is none"),
    ("arms", "tip led beyond the border", "none: out of reach",
     partial(arm, ConstantSpeed(start=1.0, speed=1.5), STILL, BENT), 0.0, "there is none"),
    ("arms", "tip that leaves from the border, the arm straight", "none: the branch is not determined",
     partial(arm, ConstantSpeed(start=2.0, speed=-1.0), STILL, (0.0, 0.0)), 0.0, "there are two"),
    ("arms", "tip led past the base at 1e-3 m, the arm folded", "law of cosines",
     partial(arm, ConstantSpeed(start=1.0, speed=-2.0), Constant(value=1e-3), (-0.5, 2.0)), 1e-12, DIGITS),
    ("arms", "tip led past the base at 1e-9 m, the arm folded", "law of cosines",
     partial(arm, ConstantSpeed(start=1.0, speed=-2.0), Constant(value=1e-9), (-0.5, 2.0)), 1e-12, DIGITS),
    ("arms", "tip led through the base, the arm folded", "none: the upper arm may turn freely there",
     partial(arm, ConstantSpeed(start=1.0, speed=-2.0), STILL, (-0.5, 2.0)), 0.0, "nothing determines it"),
    ("arms", "tip of a shorter forearm led inside of the inner border", "none: out of reach",
     partial(arm, ConstantSpeed(start=1.0, speed=-0.7), STILL, (-0.5, 2.0), fore=0.6), 0.0, "there is none"),
    *[("singular loops", f"parallelogram that turns over and passes 2 singular positions a turn, closed at {cut}",
       PENDULUM, partial(parallelogram, 0.3, {"O": 15.0}, 3.0, cut), 1e-6, "noise close to singular positions")
      for cut in "BC"],
    *[("singular loops", f"parallelogram set in motion {miss:g} rad before all bars are in line", PENDULUM,
       partial(parallelogram, FLAT - miss, {"O": 5.0}, 3.0, "B"), 1e-6, "noise close to singular positions")
      for miss in (1e-3, 1e-5, 1e-6, 1e-9)],
    ("singular loops", "parallelogram started in line, velocities of both cranks given", PENDULUM,
     partial(parallelogram, FLAT, {"O": 5.0, "C": 5.0}, 3.0, "B"), 1e-6, "noise close to singular positions"),
    ("singular loops", "parallelogram started in line, velocity of one crank given", "none: two motions meet",
     partial(parallelogram, FLAT, {"O": 5.0}, 3.0, "B"), 0.0, "two motions meet"),
    ("singular loops", "parallelogram let go in line, at rest", "none: two motions meet",
     partial(parallelogram, FLAT, {}, 1.0, "C"), 0.0, "two motions meet"),
    *[("singular loops", f"parallelogram that turns back {miss:g} rad beyond the position in line, closed at {cut}",
       PENDULUM, partial(parallelogram, FLAT - miss, {}, 1.0, cut), 1e-6, "noise close to singular positions")
      for miss in (1e-1, 1e-3, 1e-7) for cut in "BC"],
    ("singular loops", "slider-crank moved by its slider over the dead centre", "none: the crank may go either way",
     dead_centre, 0.0, "two motions meet"),
]  # fmt: skip
CASES = [Case(*entry) for entry in ENTRIES]
