"""Random open and closed chains in free motion, and their motion by another integrator and another equation of motion.

The reference is SciPy's DOP853 on accelerations from ``aba`` for open chains and from
the dense equation ``[M G^T; G 0] [a; -lam] = [-nle; -gamma]`` for closed ones; it is never projected onto the loops.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
from catalogue import ABOUT_Y, bar
from linkage import GROUND, Joint, Linkage, random_body, random_turn
from scipy.integrate import solve_ivp

from pinarm.engine.motion.trajectory import Trajectory
from pinarm.use.facade import Scenario, load

SAMPLES = 41

FINE = 1e-12
"""Tolerance of the reference; the dense equation of a loop has not many more digits."""


def open_chain(generator: np.random.Generator) -> Linkage:
    """One to four bodies with joints about axes in any direction."""
    bodies, joints, parent = {}, {}, GROUND
    for k in range(generator.integers(1, 5)):
        name = f"body{k}"
        bodies[name] = random_body(generator, 10.0 ** generator.uniform(-1.0, 1.0))
        joints[f"joint{k}"] = Joint("revolute", parent, name, generator.uniform(-0.6, 0.6, 3), random_turn(generator))
        parent = name
    return Linkage(bodies, joints)


def closed_chain(generator: np.random.Generator) -> Linkage:
    """A planar loop of four or five bars, or a spatial one of three, turned in any direction."""
    spatial = generator.random() < 0.4
    corners = 4 if spatial else int(generator.integers(4, 6))
    angles = np.sort(np.arange(corners) + generator.uniform(-0.25, 0.25, corners)) * 2.0 * np.pi / corners
    points = 0.4 * generator.uniform(0.6, 1.4, (corners, 1)) * np.column_stack(
        [np.cos(angles), spatial * generator.uniform(-0.5, 0.5, corners), np.sin(angles)]
    )  # fmt: skip
    names = [GROUND, *(f"body{k}" for k in range(corners - 1)), GROUND]
    bodies = {
        names[k]: bar(points[k - 1], points[k], generator.uniform(0.5, 3.0), spatial * generator.normal(size=3) * 0.03)
        for k in range(1, corners)
    }
    kinds = ["revolute", "spherical", "universal", "revolute"] if spatial else ["revolute"] * corners
    joints = {
        f"joint{k}": Joint(kind, names[k], names[k + 1], points[k], ABOUT_Y if k in (0, corners - 1) or not spatial
                           else random_turn(generator))
        for k, kind in enumerate(kinds)
    }  # fmt: skip
    return Linkage(bodies, joints).turned(random_turn(generator))


def scenario(folder: Path, linkage: Linkage, tolerance: float, generator: np.random.Generator) -> Scenario:
    """A free motion of a linkage from rest or nearly so; the last joint closes the loop where there is one."""
    tree = len(linkage.joints) == len(linkage.bodies)
    mechanism = linkage.build(folder, () if tree else [list(linkage.joints)[-1]])
    moving = list(mechanism.joints)
    velocity = {name: f"{generator.normal():.3f} rad/s" for name in (moving if tree else moving[:1])}
    outputs = [f"joint.{name}.{level}" for name in moving[:3] for level in ("position", "velocity")]
    end = generator.uniform(0.3, 3.0 if tree else 0.8)
    content = {
        "pinarm": 1, "mechanism": "mechanism.yaml", "outputs": [*outputs, "energy.kinetic"],
        "problem": {"kind": "forward", "time": {"end": f"{end!r} s", "samples": SAMPLES},
                    "initial": {"velocity": velocity}},
        "accuracy": {"tolerance": tolerance, "max_steps": 20_000},
    }  # fmt: skip
    (folder / "scenario.yaml").write_text(json.dumps(content))
    return load(folder / "scenario.yaml")


def reference(run: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """q and v at the rows of a run, from its first row on."""
    model, closure = run.mechanism.model, run.mechanism.closure
    data, nv, m = model.createData(), model.nv, run.mechanism.closure.size

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        q, v = y[:nv], y[nv:]
        if not m:
            return np.concatenate([v, pin.aba(model, data, q, v, np.zeros(nv))])
        state = closure.state(q)
        rows = closure.rows(state)
        gamma, mass = closure.drift(closure.state(q, v)), pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = pin.nonLinearEffects(model, data, q, v)
        left = np.block([[mass, rows.T], [rows, np.zeros((m, m))]])
        right = np.concatenate([-bias, -gamma])
        return np.concatenate([v, np.linalg.lstsq(left, right, rcond=1e-12)[0][:nv]])

    begin = np.concatenate([run.q[0], run.v[0]])
    found = solve_ivp(rate, (run.grid.t[0], run.grid.t[-1]), begin, "DOP853", run.grid.t, rtol=FINE, atol=FINE / 10)
    assert found.success
    return found.y[:nv].T, found.y[nv:].T
