"""Speed of closed loops: inverse dynamics of many samples, Andrews' mechanism, and what more loops cost.

Run with ``python benchmarks/loops.py``; SciPy is needed. Times are the best of several, the pairs taken in turn.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pinocchio as pin

import pinarm
from pinarm.engine.motion.outcome import Outcome
from pinarm.mechanics.forces.points import Wrench
from pinarm.mechanics.laws import ConstantSpeed, Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid

ROOT = Path(__file__).parents[1]
JOINTS = ("beta", "Theta", "gamma", "delta", "Phi", "epsilon", "Omega")
BEGIN = (-0.0617138900142765, 0.0, 0.455279819163070, 0.487364979543844, 0.222668390165886, 1.23054744454982,
         -0.222668390165886)  # fmt: skip
END = (15.810771195159095, -15.756371058418573, 0.040822240119698, 0.524409965879957, -0.534730116341989,
       1.048080741041939, 0.534730116341989)  # fmt: skip
TURNED = {1: 31.914741297738026, 2: 31.750597186986102, 40: 31.59743374398574}
FOLDERS = {1: "four_bar", 2: "two_four_bars", 40: "forty_four_bars"}
STANDING = InitialState(position={"upright_0": 0.0}, velocity={"upright_0": 1.0})
SAMPLES = 100_000
TURNING, SWINGING = ConstantSpeed(speed=2 * np.pi), Harmonic(mean=0.2, amplitude=0.9, pulsation=2 * np.pi)
ASSEMBLED = {"B": -0.5, "E": 0.5, "x": -0.65, "y": 1.6}
PUSHED = {"rod": Wrench(point="D5", force=(0.0, -9e3, 0.0)), "cylinder": Wrench(point="H", force=(0.0, 9e3, 0.0)),
          "operator": Wrench(point="P", force=(0.0, 250.0, 0.0), axes="arm")}  # fmt: skip
INVERSE = {
    "crank and rocker": ("crank_rocker", {"theta2": TURNING}, {"A": 0.7, "theta4": 1.4}, {}, 5.0),
    "four-bar of equal rods": ("four_bar", {"upright_0": SWINGING}, {}, {}, 5.0),
    "manipulator": ("manipulator", {"alpha": SWINGING}, ASSEMBLED, {}, 15.0),
    "manipulator, three wrenches": ("manipulator", {"alpha": SWINGING}, ASSEMBLED, PUSHED, 15.0),
}
"""Model, motion, start, loads, and the time a sample that is wanted [us]."""


def best(*functions: Callable[[], object], rounds: int) -> list[float]:
    """Return the shortest time of each function [s], the functions taken in turn."""
    times = [[] for _ in functions]
    for _ in range(rounds):
        for function, record in zip(functions, times, strict=True):
            begin = time.perf_counter()
            function()
            record.append(time.perf_counter() - begin)
    return [min(record) for record in times]


def anywhere(*path: object) -> nullcontext:
    """Return the place of mistakes in no file at all."""
    return nullcontext()


def motion(folder: Path, end: float, initial: InitialState) -> Callable[[float], Outcome]:
    """Return what solves a motion of a model to a tolerance."""
    mechanism = pinarm.Mechanism.load(folder / "mechanism.yaml")
    problem = Forward(time=TimeGrid(end=end, samples=21), initial=initial)
    return lambda tolerance: problem.solve(mechanism, Accuracy(tolerance=float(tolerance)), anywhere)


def inverse() -> None:
    """Print the times a sample of a motion with its drive's efforts, and of efforts for given states in any order."""
    print(f"{'inverse dynamics, us a sample':32s} {'motion':>7s} {'states':>7s} {'bare rnea':>10s} {'wanted':>7s}")
    for name, (folder, laws, start, loads, wanted) in INVERSE.items():
        mechanism = pinarm.Mechanism.load(ROOT / "models" / folder / "mechanism.yaml")
        (drive,) = laws
        problem = Inverse(
            time=TimeGrid(end=1.0, samples=SAMPLES), motion=laws, drives=[drive], start=start, loads=loads
        )
        run = problem.solve(mechanism, Accuracy(), anywhere).rows
        order, pool = np.random.default_rng(0).permutation(SAMPLES), pin.ModelPool(mechanism.model, 1)
        q, v, a = run.q[order], run.v[order], run.a[order]
        times = best(
            lambda problem=problem, mechanism=mechanism: problem.solve(mechanism, Accuracy(), anywhere),
            lambda mechanism=mechanism, q=q, v=v, a=a, drive=drive: mechanism.at(q, v, a, drives=[drive]),
            lambda pool=pool, q=q, v=v, a=a: pin.rneaInParallel(1, pool, q.T, v.T, a.T), rounds=5,
        )  # fmt: skip
        moving, given, bare = (1e6 * x / SAMPLES for x in times)
        print(f"{name:32s} {moving:7.2f} {given:7.2f} {bare:10.2f} {wanted:7.1f}")


def four_bars(folder: Path, n: int) -> None:
    """Write the model of n four-bars of equal rods, which begins with those of the models."""
    shared = (ROOT / "models" / "four_bar" / "four_bars.xacro").read_text()
    (folder / "four_bars.xacro").write_text(shared)
    rods = "".join(f'<xacro:upright_and_coupler i="{i}"/>' for i in range(n))
    (folder / "model.urdf.xacro").write_text(
        '<robot name="four_bars" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        f'<xacro:include filename="four_bars.xacro"/><xacro:foundation N="{n}"/>{rods}<xacro:upright i="{n}"/></robot>'
    )
    loops = "".join(
        f"  top_{i}: {{kind: revolute, between: [coupler_{i - 1}_end, upright_{i}_end], axis: z}}\n"
        for i in range(1, n + 1)
    )
    (folder / "mechanism.yaml").write_text(
        "pinarm: 1\nrobot: model.urdf.xacro\narguments: {l: m, m: kg}\n"
        f"gravity: {{direction: -y, magnitude: 9.81 m/s^2}}\nloops:\n{loops}"
    )


def curve() -> None:
    """Print what an evaluation costs with more and more loops, everything around it included, and a loop's share."""
    print(f"{'four-bars to 1e-6, 2 s':>24s} {'ms':>8s} {'evaluations':>12s} {'us each':>8s} {'us a loop':>10s}"
          f" {'bare, us a loop':>16s}")  # fmt: skip
    for n in (1, 2, 3, 5, 10, 20, 40):
        with tempfile.TemporaryDirectory() as text:
            four_bars(Path(text), n)
            solve = motion(Path(text), 2.0, STANDING)
            mechanism = pinarm.Mechanism.load(Path(text) / "mechanism.yaml")
        evaluations = solve(1e-6).figures["evaluations"]
        model, loops, states, settings = by_points(mechanism)
        data, idle = model.createData(), np.zeros(model.nv)
        pin.initConstraintDynamics(model, data, loops, states)
        bare = lambda: [pin.constraintDynamics(model, data, idle, idle, idle, loops, states, settings)  # noqa: B023, E731
                        for _ in range(100)]  # fmt: skip
        whole, calls = best(lambda solve=solve: solve(1e-6), bare, rounds=5)
        each = 1e6 * whole / evaluations
        print(f"{n:24d} {1e3 * whole:8.1f} {evaluations:12.0f} {each:8.1f} {each / n:10.1f} {1e4 * calls / n:16.2f}")


def loosest(method: Callable[[float], np.ndarray], error: Callable[[np.ndarray], float], wanted: float) -> float:
    """Return the loosest tolerance with which a method stays below an error, and so does with all tighter ones."""
    tolerances = 10.0 ** -np.arange(3.0, 12.0, 0.25)
    good = [error(method(tolerance)) < wanted for tolerance in tolerances]
    return float(tolerances[len(good) - next((k for k, x in enumerate(good[::-1]) if not x), len(good))])


def by_points(mechanism: pinarm.Mechanism) -> tuple:
    """Return a model with its loops as pairs of points, their buffers, and settings, for ``constraintDynamics``."""
    model = mechanism.model
    loops, states = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for one in mechanism.constraints:
        first, second = model.frames[one.first], model.frames[one.second]
        loops.append(pin.RigidConstraintModel(
            pin.ContactType.CONTACT_3D, model, first.parentJoint, first.placement, second.parentJoint,
            second.placement, pin.LOCAL))  # fmt: skip
        states.append(loops[-1].createData())
    return model, loops, states, pin.ProximalSettings(1e-12, 1e-10, 8)


def andrews_by_scipy() -> Callable[[float], np.ndarray]:
    """Return Andrews' mechanism as users of Pinocchio and SciPy write it: no projection, the spring by its Jacobian."""
    from scipy.integrate import solve_ivp

    mechanism = pinarm.Mechanism.load(ROOT / "models" / "andrews" / "mechanism.yaml")
    model, loops, states, settings = by_points(mechanism)
    data, nv = model.createData(), model.nv
    pin.initConstraintDynamics(model, data, loops, states)
    hook, anchor = model.getFrameId("D"), np.array([0.014, 0.072, 0.0])
    drive = mechanism.joints["beta"].v

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        q, v = y[:nv], y[nv:]
        jacobian = pin.computeFrameJacobian(model, data, q, hook, pin.LOCAL_WORLD_ALIGNED)[:3]
        apart = anchor - data.oMi[model.frames[hook].parentJoint].act(model.frames[hook].placement).translation
        length = np.sqrt(apart @ apart)
        tau = jacobian.T @ (4530.0 * (length - 0.07785) / length * apart)
        tau[drive] += 0.033
        return np.concatenate([v, pin.constraintDynamics(model, data, q, v, tau, loops, states, settings)])

    start = np.zeros(2 * nv)
    for name, value in zip(JOINTS, BEGIN, strict=True):
        start[mechanism.joints[name].q] = value

    def solve(tolerance: float) -> np.ndarray:
        times = np.linspace(0.0, 0.03, 21)
        return solve_ivp(rate, (0.0, 0.03), start, "DOP853", t_eval=times, rtol=tolerance, atol=tolerance).y[:nv, -1]

    return solve


def andrews() -> tuple[float, float]:
    """Return the times to reach 1e-6 rad after 0.03 s, both with the loosest tolerance that does."""
    joints = pinarm.Mechanism.load(ROOT / "models" / "andrews" / "mechanism.yaml").joints
    places = [joints[name].q for name in JOINTS]
    run = motion(ROOT / "models" / "andrews", 0.03, InitialState(position=dict(zip(JOINTS, BEGIN, strict=True))))
    ours = lambda tolerance: run(tolerance).q[-1]  # noqa: E731
    theirs = andrews_by_scipy()

    def error(q: np.ndarray) -> float:
        return float(abs(q[places] - END).max())

    mine, other = loosest(ours, error, 1e-6), loosest(theirs, error, 1e-6)
    a, b = best(lambda: ours(mine), lambda: theirs(other), rounds=9)
    return a, b


def main() -> None:
    inverse()
    ours, other = andrews()
    print(f"Andrews to 1e-6: ours {1e3 * ours:.1f} ms, SciPy on constraintDynamics {1e3 * other:.1f} ms, "
          f"ratio {ours / other:.2f} (wanted 0.5)")  # fmt: skip
    for loops, folder in FOLDERS.items():
        solve = motion(ROOT / "models" / folder, 10.0, STANDING)
        begin = time.perf_counter()
        q = solve(1e-9).q[-1]
        print(f"{loops:3d} four-bars, tolerance 1e-9: {1e3 * (time.perf_counter() - begin):8.0f} ms, "
              f"error {abs(q[0] - TURNED[loops]):.1e} rad")  # fmt: skip
    curve()


if __name__ == "__main__":
    main()
