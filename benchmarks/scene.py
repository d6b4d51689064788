"""Only what a scene requires: time of a solution against that of the whole mechanism, what is chosen included.

Run with ``python benchmarks/scene.py``; the robots are those of example-robot-data. CPU time, best of several, the
pairs taken in turn; reading the model is no part of it.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any

import pinarm
from pinarm.use.facade import Scenario

ROUNDS = 7


def scenario(folder: Path, robot: str, problem: dict[str, Any], outputs: list[str], **more: Any) -> Scenario:
    mechanism = {"pinarm": 1, "robot": robot, "base": "fixed", "friction": "none"}
    (folder / "mechanism.yaml").write_text(json.dumps(mechanism), encoding="utf-8")
    told = {"pinarm": 1, "mechanism": "mechanism.yaml", "problem": problem, "outputs": outputs, **more}
    (folder / "scenario.yaml").write_text(json.dumps(told), encoding="utf-8")
    return pinarm.load(folder / "scenario.yaml")


def held(robot: str, moving: str) -> tuple[list[str], dict[str, Any]]:
    """Return the joints whose names begin like this, and laws that hold all others, or what they mimic."""
    mechanism = pinarm.Mechanism.load(robot, values={"base": "fixed"})
    mimics = [one.follower for one in mechanism.constraints]
    others = [one for one in mechanism.joints.values() if not one.name.startswith(moving)]
    laws = {one.name: {"law": "constant", "value": f"0.01 {one.unit}"} for one in others if one.v not in mimics}
    return [name for name in mechanism.joints if name.startswith(moving)], laws


def falling(folder: Path, robot: str, moving: str, **accuracy: Any) -> Scenario:
    joints, laws = held(robot, moving)
    start = {"position": dict.fromkeys(joints, "0.2 rad")}
    problem = {"kind": "forward", "time": {"end": "1 s"}, "motion": laws, "initial": start}
    return scenario(folder, robot, problem, joints, accuracy=accuracy)


def times(asked: Scenario) -> tuple[int, float, float]:
    """Return how many joints are removed, and the shortest time of the part and of the whole [s]."""
    both, best = (asked, asked.varied({"modelled": "whole"})), [float("inf"), float("inf")]
    for _ in range(ROUNDS):
        for k, one in enumerate(both):
            _ = one.mechanism
            one.__dict__.pop("scene", None)
            begin = time.process_time()
            one.run()
            best[k] = min(best[k], time.process_time() - begin)
    return len(asked.simplification.removals), best[0], best[1]


def main() -> None:
    print(f"{'':45s} {'removed':>8s} {'part [ms]':>10s} {'whole [ms]':>10s} {'gain':>6s}")
    cases = {
        "Talos, one arm falling (stiff)": lambda at: falling(at, "talos", "arm_right", method="stiff", tolerance=1e-5),
        "Panda, fingers held: falling": lambda at: falling(at, "panda", "panda_joint"),
    }
    for name, make in cases.items():
        with tempfile.TemporaryDirectory() as folder:
            removed, part, whole = times(make(Path(folder)))
        print(f"{name:45s} {removed:8d} {1e3 * part:10.1f} {1e3 * whole:10.1f} {whole / part:6.1f}")


if __name__ == "__main__":
    main()
