"""Single bodies and open chains: masses, inertias, sizes, speeds, springs, angles, gimbal lock."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from catalogue import axes_along
from extreme import WRONG, Case, G, hinge, integrated, largest, pendulum, quarter, solved, swing
from linkage import GROUND, Body, Joint, Linkage
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipj

from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.forces.along_coordinate import JointSpring
from pinarm.use.accuracy.error_estimate import estimate_errors
from pinarm.use.facade import load
from pinarm.use.mechanism import Mechanism

EXPLICIT = "the two equations solved for the accelerations by hand, SciPy"
TOP = "symmetric top: precession about H at H/A, spin at (1 - C/A) w3"


def double(
    lengths: tuple[float, float], masses: tuple[float, float], end: float, folder: Path, away: float = 0.0
) -> float:
    """Two points on rods without mass, let go from 1 rad and 0.5 rad, at a distance from the origin."""
    (l1, l2), (m1, m2) = lengths, masses
    bodies = {"one": Body(m1, np.array([away, 0.0, -l1])), "two": Body(m2, np.array([away, 0.0, -l1 - l2]))}
    chain = Linkage(bodies, {"A": hinge(GROUND, "one", away), "B": hinge("one", "two", away, -l1)})
    run = solved(chain.build(folder), end, position={"A": 1.0, "B": -0.5})

    def rate(_: float, y: np.ndarray) -> list[float]:
        a, b, u, w = y
        s, c = np.sin(a - b), np.cos(a - b)
        lever = m1 + m2 * s * s
        first = -m2 * l1 * u * u * s * c + m2 * G * np.sin(b) * c - m2 * l2 * w * w * s - (m1 + m2) * G * np.sin(a)
        second = (m1 + m2) * (l1 * u * u * s - G * np.sin(b) + G * np.sin(a) * c) + m2 * l2 * w * w * s * c
        return [u, w, first / (l1 * lever), second / (l2 * lever)]

    exact = solve_ivp(rate, (0.0, end), [1.0, 0.5, 0.0, 0.0], "DOP853", run.grid.t, rtol=1e-13, atol=1e-14).y
    return largest(run.q - np.array([exact[0], exact[1] - exact[0]]).T)


def ball(folder: Path, inertia: tuple[float, float, float], place: str = "0 0 0", gravity: str | None = "none"):
    """A body on a ball joint."""
    size = " ".join(repr(x) for x in inertia)
    (folder / "ball.xml").write_text(
        f'<mujoco><worldbody><body name="body"><joint name="ball" type="ball"/>'
        f'<inertial pos="{place}" mass="1" diaginertia="{size}"/></body></worldbody></mujoco>')  # fmt: skip
    return Mechanism.load(folder / "ball.xml", values={"gravity": gravity} if gravity else None)


def spun(*rates: float) -> dict[str, float]:
    return {f"ball.angular_velocity.{axis}": rate for axis, rate in zip("xyz", rates, strict=True)}


def top(across: float, along: float, tilt: float, spin: float, end: float, folder: Path) -> float:
    """A symmetric body without torque; the error of its orientation, relative to all that it has turned."""
    run = solved(ball(folder, (across, across, along)), end, velocity=spun(tilt, 0.0, spin))
    momentum, t = np.array([across * tilt, 0.0, along * spin]), run.grid.t
    size, own = np.linalg.norm(momentum), (1.0 - along / across) * spin
    precession = Rotation.from_rotvec(np.outer(size / across * t, momentum / size))
    exact = precession * Rotation.from_rotvec(np.outer(own * t, [0.0, 0.0, 1.0]))
    turned = (size / across + abs(own)) * end
    return float((Rotation.from_quat(run.q) * exact.inv()).magnitude().max() / max(turned, 1.0))


def jacobi(inertia: tuple[float, float, float], w1: float, w3: float, end: float, folder: Path) -> float:
    """An asymmetric body without torque: w1 cn, b sn, w3 dn (Landau and Lifshitz, section 37)."""
    i1, i2, i3 = inertia
    run = solved(ball(folder, inertia), end, velocity=spun(w1, 0.0, w3))
    twice, square = i1 * w1**2 + i3 * w3**2, i1**2 * w1**2 + i3**2 * w3**2
    rate = np.sqrt((i3 - i2) * (square - twice * i1) / (i1 * i2 * i3))
    m = (i2 - i1) * (twice * i3 - square) / ((i3 - i2) * (square - twice * i1))
    sn, cn, dn, _ = ellipj(rate * run.grid.t, m)
    b = np.sqrt((twice * i3 - square) / (i2 * (i3 - i2)))
    return largest(run.v - np.array([w1 * cn, b * sn, w3 * dn]).T) / max(w1, w3)


def hung(length: float, mass: float, folder: Path) -> float:
    rate = np.sqrt(G / length)
    run = solved(pendulum(length, mass).build(folder), 8.0 * quarter(1.0, rate), position={"arm": 1.0})
    return largest(run.q[:, 0] - swing(run.grid.t, 1.0, rate))


def at_the_top(amplitude: float, quarters: int, folder: Path) -> float:
    """Places at the bottom and at the turning points."""
    time = quarters * quarter(amplitude, np.sqrt(G))
    run = solved(pendulum().build(folder), time, quarters + 1, position={"arm": amplitude})
    return largest(run.q[:, 0] - amplitude * np.array([1.0, 0.0, -1.0, 0.0, 1.0])[: quarters + 1])


def told(content: dict, exact: Callable[[np.ndarray], np.ndarray], folder: Path) -> float:
    """True error of an angle over five times the bound of it that --verify gives."""
    pendulum().build(folder)
    content = {"pinarm": 1, "mechanism": "mechanism.yaml", "outputs": ["joint.arm.position"], **content}
    (folder / "scenario.yaml").write_text(json.dumps(content))
    asked = load(folder / "scenario.yaml")
    result = asked.solve()
    found = result["joint.arm.position"].values
    bounds = estimate_errors(asked, result).errors
    scale = largest(found)
    return largest(found - exact(result.trajectory.grid.t)) / scale / (5.0 * bounds["joint.arm.position"])


def lingering(folder: Path) -> float:
    """A whole swing from so near the top that its error is as large as itself."""
    amplitude = float(np.radians(179.9999))
    end = 4.0 * quarter(amplitude, np.sqrt(G))
    content = {"problem": {"kind": "forward", "time": {"end": f"{end!r} s", "samples": 5},
                           "initial": {"position": {"arm": f"{amplitude!r} rad"}}}}  # fmt: skip
    return told(content, lambda t: amplitude * np.array([1.0, 0.0, -1.0, 0.0, 1.0]), folder)


def rounded(folder: Path) -> float:
    """A pendulum from 1e8 rad."""
    left = float(np.arctan2(np.sin(1e8), np.cos(1e8)))
    content = {"problem": {"kind": "forward", "time": {"end": "3 s", "samples": 21},
                           "initial": {"position": {"arm": "1e8 rad"}}}}  # fmt: skip
    return told(content, lambda t: 1e8 - left + swing(t, left, np.sqrt(G)), folder)


def far(angle: float, folder: Path) -> float:
    """A pendulum that has been turned often; what is left of its angle is reduced by the library of C, exactly."""
    run = solved(pendulum().build(folder), 3.0, position={"arm": angle}, tolerance=1e-9)
    left = float(np.arctan2(np.sin(angle), np.cos(angle)))
    return largest(run.q[:, 0] - angle + left - swing(run.grid.t, left, np.sqrt(G)))


def sprung(stiffness: float, damping: float, end: float, folder: Path, note: str = "", **accuracy) -> float:
    """A wheel of 1 kg m^2 on a spring; where a note has to be in the stamp, without it the answer is wrong."""
    wheel = Linkage({"wheel": Body(1.0, np.zeros(3), np.eye(3))}, {"arm": hinge(GROUND, "wheel")}, 0.0)
    spring = JointSpring(joint="arm", stiffness=stiffness, damping=damping, rest=0.0)
    outcome = integrated(wheel.build(folder), end, position={"arm": 1e-3}, loads={"spring": spring}, **accuracy)
    run, said = outcome.rows, " ".join(outcome.notes)
    return decay(run.grid.t, run.q[:, 0], damping, stiffness) if note in said and bool(note) == bool(said) else WRONG


def decay(t: np.ndarray, found: np.ndarray, damping: float, stiffness: float) -> float:
    """Error of ``x'' + damping x' + stiffness x = 0`` from rest, relative to its first value."""
    fast = -(damping + np.sqrt(complex(damping**2 - 4.0 * stiffness))) / 2.0
    slow = stiffness / fast
    exact = (slow * np.exp(fast * t) - fast * np.exp(slow * t)) / (slow - fast)
    return largest(found / found[0] - exact.real)


def angles_at_lock(miss: float, folder: Path) -> float:
    """A ball that turns through a pitch of 90 deg; its angles against its quaternion."""
    start = {"ball.pitch": np.pi / 2 - 1.0, "ball.yaw": 0.3}
    run = solved(ball(folder, (1.0, 1.0, 1.0)), 2.0, 201, position=start, velocity=spun(miss, 1.0, 0.0))
    asked = Quantities(run)
    angles = np.array([asked[f"joint.ball.{name}"].values for name in ("roll", "pitch", "yaw")]).T
    return float((Rotation.from_euler("xyz", angles) * Rotation.from_quat(run.q).inv()).magnitude().max())


def gimbal(pitch: float, rates: tuple[float, float, float], folder: Path) -> float:
    """A body in two rings without mass, which are nothing to it, against the body alone by its quaternion."""
    inertia = np.array([0.2, 0.3, 0.45])
    bodies = {"outer": Body(0.0), "inner": Body(0.0), "body": Body(1.0, np.zeros(3), np.diag(inertia))}
    axes = {"yaw": (GROUND, "outer", Z), "pitch": ("outer", "inner", Y), "roll": ("inner", "body", X)}
    joints = {name: Joint("revolute", *ends, np.zeros(3), axes_along(axis)) for name, (*ends, axis) in axes.items()}
    rings = Linkage(bodies, joints, 0.0).build(folder)
    velocity = dict(zip(("yaw", "pitch", "roll"), rates, strict=True))
    run = solved(rings, 1.0, 51, position={"pitch": pitch}, velocity=velocity)
    omega = np.array([rates[2], rates[1], 0.0]) + Rotation.from_euler("y", pitch).inv().apply([0.0, 0.0, rates[0]])

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        x, w = y[:3], y[4:]
        turn = 0.5 * np.array([*(y[3] * w + np.cross(x, w)), -x @ w])
        return np.concatenate([turn, np.cross(inertia * w, w) / inertia])

    start = [*Rotation.from_euler("y", pitch).as_quat(), *omega]
    exact = solve_ivp(rate, (0.0, 1.0), start, "DOP853", run.grid.t, rtol=1e-13, atol=1e-13).y[:4].T
    order = [rings.joints[name].q for name in ("roll", "pitch", "yaw")]
    return float((Rotation.from_euler("xyz", run.q[:, order]) * Rotation.from_quat(exact).inv()).magnitude().max())


def idle_tip(folder: Path) -> float:
    """An arm with a link without mass at its end that may turn."""
    bodies = {"arm": Body(1.0, np.array([0.0, 0.0, -1.0])), "tool": Body(0.0)}
    solved(Linkage(bodies, {"A": hinge(GROUND, "arm"), "B": hinge("arm", "tool", z=-1.0)}).build(folder), 1.0)
    return WRONG


def idle_spin(folder: Path) -> float:
    """A point on a ball joint, which may spin about its own line."""
    solved(ball(folder, (0.0, 0.0, 0.0), "0 0 -1", None), 1.0)
    return WRONG


def between(folder: Path) -> float:
    """Two slides, the first without mass: a parabola."""
    slides = {"x": Joint("prismatic", GROUND, "none", np.zeros(3), axes_along(X)),
              "z": Joint("prismatic", "none", "shell", np.zeros(3), axes_along(Z))}  # fmt: skip
    bodies = {"none": Body(0.0), "shell": Body(1.0, np.zeros(3), np.eye(3))}
    run = solved(Linkage(bodies, slides).build(folder), 2.0, velocity={"x": 3.0, "z": 10.0})
    t = run.grid.t
    return largest(run.q - np.array([3.0 * t, 10.0 * t - G * t * t / 2.0]).T) / 20.0


X, Y, Z = np.eye(3)
GROWN = "1e-12 a step, some hundred steps, errors grow on the way"
Entry = tuple[str, str, str, Callable[[Path], float], float, str]
ENTRIES: list[Entry] = [
    *[("masses", f"double pendulum, lower mass {ratio:g} times the upper", EXPLICIT,
       partial(double, (1.0, 1.0), (1.0, ratio), end), 1e-10, GROWN)
      for ratio, end in ((1e-12, 2.0), (1e12, 1e-5))],
    ("masses", "slide without mass that carries a body", "parabola", between, 1e-13, "rounding"),
    ("masses", "link without mass at the end of an arm, free to turn", "none: accelerations are undetermined",
     idle_tip, 0.0, "nothing determines it"),
    ("masses", "point on a ball joint, free to spin about its line", "none: accelerations are undetermined",
     idle_spin, 0.0, "nothing determines it"),
    *[("inertias", f"needle of C/A = {ratio:g} that spins at 1e3 rad/s", TOP, partial(top, 1.0, ratio, 1.0, 1e3, 1.0),
       1e-12, "relative to all angles turned") for ratio in (1e-12,)],
    ("inertias", "plate whose moments add up, I3 = I1 + I2, tumbling", "Jacobi's functions",
     partial(jacobi, (0.2, 0.3, 0.5), 0.8, 2.5, 12.0), 1e-10, GROWN),
    ("inertias", "body two of whose moments differ by 1e-6, tumbling", "Jacobi's functions",
     partial(jacobi, (0.5, 0.5 * (1.0 + 1e-6), 0.9), 0.8, 2.5, 12.0), 1e-10, GROWN),
    *[("sizes", f"pendulum of {length:g} m and {mass:g} kg, two periods", "Jacobi's functions",
       partial(hung, length, mass), 1e-10, GROWN)
      for length, mass in ((1e-6, 1e-12), (1e6, 1e12))],
    *[("sizes", f"double pendulum of rods of {l1:g} m and {l2:g} m", EXPLICIT,
       partial(double, (l1, l2), (1.0, 1.0), end), 5e-9, "the short rod turns often; errors grow")
      for l1, l2, end in ((1.0, 1e-6, 0.01),)],
    ("sizes", "double pendulum of rods of 1e-6 m and 1 m", EXPLICIT,
     partial(double, (1e-6, 1.0), (1.0, 1.0), 0.01), 1e-3, "condition of the masses 1e12"),
    ("sizes", "double pendulum of rods of 1 m, 1e6 m from the origin", EXPLICIT,
     partial(double, (1.0, 1.0), (1.0, 1.0), 2.0, away=1e6), 1e-10, GROWN),
    ("speeds", "symmetric top that tumbles at 1e5 rad/s", TOP, partial(top, 0.8, 0.5, 1e5, 1e5, 0.01),
     1e-11, "relative to all angles turned"),
    ("speeds", "asymmetric body at 1e5 rad/s", "Jacobi's functions",
     partial(jacobi, (0.2, 0.3, 0.45), 3e4, 1e5, 3e-3), 1e-10, GROWN),
    ("springs", "spring of 1e9 N m/rad, undamped, 10 periods", "sine", partial(sprung, 1e9, 0.0, 2e-3), 1e-10, GROWN),
    ("springs", "the same, by Radau IIA", "sine",
     partial(sprung, 1e9, 0.0, 2e-4, method="stiff", tolerance=1e-10), 1e-9, "tolerance 1e-10"),
    ("springs", "spring of 1e9 and damper of 1e6 N m s/rad over 10 s, by Radau IIA", "two exponentials",
     partial(sprung, 1e9, 1e6, 10.0, method="stiff", tolerance=1e-8), 1e-7, "tolerance 1e-8"),
    ("springs", "spring of 1e9 and damper of 1e6, explicit: right, and called stiff in the stamp", "two exponentials",
     partial(sprung, 1e9, 1e6, 5e-3, note="stiff:", tolerance=1e-9), 1e-9, "tolerance 1e-9"),
    ("springs", "spring of 1e9 and damper of 1e6 over 10 s, explicit", "two exponentials",
     partial(sprung, 1e9, 1e6, 10.0, tolerance=1e-9, max_steps=3000), 1e-9, "tolerance 1e-9"),
    *[("angles", f"pendulum from {angle:g} rad", "Jacobi's functions of the angle less its turns",
       partial(far, angle), bound, reason)
      for angle, bound, reason in ((1e6, 1e-8, "1e6 rad end at 1e-10"), (1e8, 2e-6, "1e8 rad end at 1.5e-8"))],
    ("angles", "pendulum from 179.9 deg, one period", "complete elliptic integral",
     partial(at_the_top, np.radians(179.9), 4), 5e-6, "1e-12 a step, and each way down multiplies errors by 600"),
    ("angles", "pendulum from 179.9999 deg to the bottom", "complete elliptic integral",
     partial(at_the_top, np.radians(179.9999), 1), 1e-5, "1e-12 a step, the way down multiplies errors by 6e5"),
    ("told errors", "pendulum from 179.9999 deg, one period: error over 10 times the estimate",
     "complete elliptic integral", lingering, 1.0, "the error is as large as the angle; it has to be told"),
    ("told errors", "pendulum from 1e8 rad: error over 10 times the estimate",
     "Jacobi's functions of the angle less its turns", rounded, 1.0, "the lost digits have to be told"),
    *[("gimbal lock", f"roll, pitch and yaw of a ball that passes it at {miss:g} rad", "its quaternion, by SciPy",
       partial(angles_at_lock, miss), 1e-14, "rounding") for miss in (1e-3, 1e-9, 0.0)],
    *[("gimbal lock", f"gimbal without mass that starts {miss:g} rad beside it", "the body alone, by its quaternion",
       partial(gimbal, np.pi / 2 - miss, (0.0, 0.0, 1.0)), 1e-10, GROWN) for miss in (1e-6, 1e-9, 0.0)],
    *[("gimbal lock", f"gimbal without mass that passes it, {name}", "the body alone, by its quaternion",
       partial(gimbal, np.pi / 2 - 0.5, rates), 1e-10, GROWN)
      for name, rates in (("straight", (0.0, 1.0, 0.0)), ("at 1e-3", (0.0, 1.0, 1e-3)), ("at 1e-9", (0.01, 1.0, 1e-9)),
                          ("far off", (0.3, 1.0, 0.5)))],
]  # fmt: skip
CASES = [Case(*entry) for entry in ENTRIES]
