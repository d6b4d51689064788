"""Speed of closed loops in forward dynamics, as ratios in one run: Andrews' mechanism, and the cost of many loops.

Run with ``python benchmarks/loops.py``; SciPy is needed. Times are the best of several, the pairs taken in turn.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pinocchio as pin

import pinarm
from pinarm.problems.common import Accuracy, TimeGrid
from pinarm.problems.forward import Forward, InitialState

ROOT = Path(__file__).parents[1]
JOINTS = ("beta", "Theta", "gamma", "delta", "Phi", "epsilon", "Omega")
BEGIN = (-0.0617138900142765, 0.0, 0.455279819163070, 0.487364979543844, 0.222668390165886, 1.23054744454982,
         -0.222668390165886)  # fmt: skip
END = (15.810771195159095, -15.756371058418573, 0.040822240119698, 0.524409965879957, -0.534730116341989,
       1.048080741041939, 0.534730116341989)  # fmt: skip
TURNED = {1: 31.914741297738026, 2: 31.750597186986102, 40: 31.59743374398574}
FOLDERS = {1: "four_bar", 2: "two_four_bars", 40: "forty_four_bars"}


def best(*functions: Callable[[], object], rounds: int) -> list[float]:
    """Return the shortest time of each function [s], the functions taken in turn."""
    times = [[] for _ in functions]
    for _ in range(rounds):
        for function, record in zip(functions, times, strict=True):
            begin = time.perf_counter()
            function()
            record.append(time.perf_counter() - begin)
    return [min(record) for record in times]


def motion(folder: str, end: float, initial: InitialState) -> Callable[[float], np.ndarray]:
    """Return what solves a motion of a model to a tolerance and gives its last configuration."""
    mechanism = pinarm.Mechanism.load(ROOT / "models" / folder / "mechanism.yaml")
    problem = Forward(time=TimeGrid(end=end, samples=21), initial=initial)
    return lambda tolerance: problem.solve(
        mechanism, Accuracy(tolerance=float(tolerance)), lambda *path: nullcontext()
    ).q[-1]


def loosest(method: Callable[[float], np.ndarray], error: Callable[[np.ndarray], float], wanted: float) -> float:
    """Return the loosest tolerance with which a method stays below an error, and so does with all tighter ones."""
    tolerances = 10.0 ** -np.arange(3.0, 12.0, 0.25)
    good = [error(method(tolerance)) < wanted for tolerance in tolerances]
    return float(tolerances[len(good) - next((k for k, x in enumerate(good[::-1]) if not x), len(good))])


def andrews_by_scipy() -> Callable[[float], np.ndarray]:
    """Return Andrews' mechanism as users of Pinocchio and SciPy write it: no projection, the spring by its Jacobian."""
    from scipy.integrate import solve_ivp

    mechanism = pinarm.Mechanism.load(ROOT / "models" / "andrews" / "mechanism.yaml")
    model, data = mechanism.model, mechanism.model.createData()
    loops, states = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for one in mechanism.constraints:
        first, second = model.frames[one.first], model.frames[one.second]
        loops.append(pin.RigidConstraintModel(
            pin.ContactType.CONTACT_3D, model, first.parentJoint, first.placement, second.parentJoint,
            second.placement, pin.LOCAL))  # fmt: skip
        states.append(loops[-1].createData())
    pin.initConstraintDynamics(model, data, loops, states)
    settings, nv = pin.ProximalSettings(1e-12, 1e-10, 8), model.nv
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
    ours = motion("andrews", 0.03, InitialState(position=dict(zip(JOINTS, BEGIN, strict=True))))
    theirs = andrews_by_scipy()

    def error(q: np.ndarray) -> float:
        return float(abs(q[places] - END).max())

    mine, other = loosest(ours, error, 1e-6), loosest(theirs, error, 1e-6)
    a, b = best(lambda: ours(mine), lambda: theirs(other), rounds=9)
    return a, b


def main() -> None:
    ours, other = andrews()
    print(f"Andrews to 1e-6: ours {1e3 * ours:.1f} ms, SciPy on constraintDynamics {1e3 * other:.1f} ms, "
          f"ratio {ours / other:.2f} (wanted 0.5)")  # fmt: skip
    for loops, folder in FOLDERS.items():
        solve = motion(folder, 10.0, InitialState(position={"upright_0": 0.0}, velocity={"upright_0": 1.0}))
        begin = time.perf_counter()
        q = solve(1e-9)
        print(f"{loops:3d} four-bars, tolerance 1e-9: {1e3 * (time.perf_counter() - begin):8.0f} ms, "
              f"error {abs(q[0] - TURNED[loops]):.1e} rad")  # fmt: skip


if __name__ == "__main__":
    main()
