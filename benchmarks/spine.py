"""Speed as ratios in one run: start-up, inverse dynamics over many samples, and free motion against SciPy.

Run with ``python benchmarks/spine.py``; SciPy is needed. Each figure is the best of several, the pairs taken in turn.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

import pinarm
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Interval
from pinarm.engine.integration.methods.explicit import Adaptive

ROOT = Path(__file__).parents[1]
END_OF_DOUBLE_PENDULUM = np.array([0.522210808870693, 1.436052080126094])


def best(*functions: Callable[[], object], rounds: int) -> list[float]:
    """Return the shortest time of each function [s], the functions taken in turn."""
    times = [[] for _ in functions]
    for _ in range(rounds):
        for function, record in zip(functions, times, strict=True):
            begin = time.perf_counter()
            function()
            record.append(time.perf_counter() - begin)
    return [min(record) for record in times]


def process(*arguments: str) -> Callable[[], object]:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    return lambda: subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env=environment, check=True, stdout=subprocess.DEVNULL
    )


def startup() -> tuple[float, float]:
    with tempfile.TemporaryDirectory() as folder:
        run = process("-m", "pinarm", "run", "scenarios/gen411_arm_static.yaml", "--no-plots", "-o", folder)
        ours, bare = best(run, process("-c", "import numpy, pinocchio"), rounds=15)
    return ours, bare


def inverse() -> tuple[float, float]:
    arm = pinarm.Mechanism.load(ROOT / "models/gen411_arm/mechanism.yaml")
    q, v, a = np.random.default_rng(1).uniform(-2, 2, (3, 100_000, 2))
    pool = pin.ModelPool(arm.model, 1)
    ours, bare = best(lambda: arm.inverse(q, v, a), lambda: pin.rneaInParallel(1, pool, q.T, v.T, a.T), rounds=15)
    return ours, bare


def double_pendulum() -> pin.Model:
    rod = pin.Inertia(1.0, np.array([0.0, 0.0, -0.5]), np.diag([1 / 12, 1 / 12, 0.0]))
    model, parent = pin.Model(), 0
    for name, placement in (("upper", pin.SE3.Identity()), ("lower", pin.SE3(np.eye(3), np.array([0.0, 0.0, -1.0])))):
        parent = model.addJoint(parent, pin.JointModelRY(), placement, name)
        model.addJointFrame(parent)
        model.appendBodyToJoint(parent, rod, pin.SE3.Identity())
    return model


def free_motion() -> tuple[float, float]:
    """Return the times to reach an error of 1e-6 after 10 s, both with the loosest tolerance that does."""
    from scipy.integrate import solve_ivp

    model = double_pendulum()
    data, idle, start = model.createData(), np.zeros(2), np.array([0.8, 0.8])
    dynamics, samples = Dynamics.of(model), np.linspace(0.0, 10.0, 21)

    def ours(tolerance: float) -> np.ndarray:
        interval = Interval(0.0, 10.0, dynamics.acceleration())
        return integrate([interval], dynamics.manifold, start, idle, Adaptive(tolerance)).states(samples)[0][-1]

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[2:], pin.aba(model, data, y[:2], y[2:], idle)])

    def scipys(tolerance: float) -> np.ndarray:
        solution = solve_ivp(
            rate, (0.0, 10.0), [*start, 0.0, 0.0], "DOP853", t_eval=samples, rtol=tolerance, atol=tolerance
        )
        return solution.y[:2, -1]

    def loosest(method: Callable[[float], np.ndarray]) -> float:
        tolerances = 10.0 ** -np.arange(3.0, 12.0, 0.25)
        return next(t for t in tolerances if abs(method(t) - END_OF_DOUBLE_PENDULUM).max() < 1e-6)

    mine, theirs = loosest(ours), loosest(scipys)
    a, b = best(lambda: ours(mine), lambda: scipys(theirs), rounds=9)
    return a, b


def main() -> None:
    rows = [
        ("run of a scenario / import numpy, pinocchio", startup(), 2.0),
        ("inverse dynamics, 100,000 samples / rneaInParallel", inverse(), 2.0),
        ("double pendulum to 1e-6 / SciPy DOP853 on aba", free_motion(), 0.8),
    ]
    print(f"{'':52s} {'ours [ms]':>10s} {'other [ms]':>10s} {'ratio':>6s} {'wanted':>7s}")
    for name, (ours, other), wanted in rows:
        print(f"{name:52s} {1e3 * ours:10.2f} {1e3 * other:10.2f} {ours / other:6.2f} {wanted:7.1f}")


if __name__ == "__main__":
    main()
