"""Reactions: the wrenches that joints transmit, those of the tree and those that close loops.

The multipliers act on the tree as outside wrenches; one recursion then gives what every joint of the tree transmits.
Where constraints are redundant some multipliers do nothing: these self-stresses are added freely to any solution, so
that a component on which one of them acts is not determined by rigid bodies at all.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.dynamics import Dynamics
from pinarm.engine.split import Split
from pinarm.engine.trajectory import Trajectory
from pinarm.mechanics.loops import LoopJoint

SAMPLE = 64
"""Largest number of rows at which self-stresses are looked for: they belong to the structure, not to an instant."""


class Reactions:
    """Wrenches over the rows of one trajectory, kept once computed.

    Args:
        run: The trajectory.
    """

    def __init__(self, run: Trajectory) -> None:
        self.run, self.model, self.closure = run, run.mechanism.model, run.closure
        self.loops = {one.name: one for one in self.closure.constraints if isinstance(one, LoopJoint)}

    @cached_property
    def origins(self) -> Array:
        """Places of the joints' origins [m], world axes, shape (n, njoints, 3)."""
        model, data = self.model, self.model.createData()
        rows = np.empty((len(self.run), model.njoints, 3))
        for i, q in enumerate(self.run.q):
            pin.forwardKinematics(model, data, q)
            rows[i] = [place.translation for place in data.oMi]
        return rows

    @cached_property
    def multipliers(self) -> Array:
        """Multipliers of the constraints, and efforts of drives along task coordinates [N or N*m], shape (n, m)."""
        return np.asarray(self.run.lam)

    @cached_property
    def joints(self) -> Array:
        """Wrench of the parent on the child at every joint's origin, world axes [N, N*m], shape (n, njoints, 6)."""
        return self.run.gather(self._joints)

    def _joints(self, dynamics: Dynamics, part: slice) -> Array:
        run, model, data = self.run, self.model, self.model.createData()
        rows = np.zeros((part.stop - part.start, model.njoints, 6))
        outside = pin.StdVec_Force()
        outside.extend([pin.Force.Zero() for _ in range(model.njoints)])
        for i in range(part.start, part.stop):
            q, v, a = run.q[i], run.v[i], run.a[i]
            pin.forwardKinematics(model, data, q)
            acting = self._acting(dynamics, i)
            for joint in {joint for wrenches in acting for joint in wrenches}:
                total = sum((wrenches[joint] for wrenches in acting if joint in wrenches), np.zeros(6))
                outside[joint] = data.oMi[joint].actInv(pin.Force(total))
            pin.rnea(model, data, q, v, a, outside)
            for joint in range(1, model.njoints):
                turn, wrench = data.oMi[joint].rotation, data.f[joint]
                row = rows[i - part.start, joint]
                row[:3], row[3:] = turn @ wrench.linear, turn @ wrench.angular
        return rows

    def _acting(self, dynamics: Dynamics, row: int) -> list[dict[int, Array]]:
        """Return what loads and constraints do to the bodies at a row: joint index -> [f; m] at the world's origin."""
        q = self.run.q[row]
        found = [force.wrenches(self.run.grid.t[row], q, self.run.v[row]) for force in dynamics.forces.values()]
        if self.closure.size:
            self.closure.place(q)
            found.append(self.closure.wrenches(self.multipliers[row]))
        return found

    def figures(self) -> dict[str, float]:
        """Return how well the wrenches of the tree's joints keep every body in balance; nothing where none was asked.

        ``bodies``: what Newton's and Euler's equations of a body miss at most, at a sample of the rows, relative to the
        largest sum of the terms of one body: the wrenches of its joints, loads, weight, and the rate of its momentum,
        by forward kinematics, about the origin of its joint. Forces and moments each on their own.
        """
        if "joints" not in vars(self) or not len(self.run):
            return {}
        missed, terms = np.moveaxis(self.run.gather(self._balances), 1, 0)
        parts = [slice(0, 3), slice(3, 6)]
        sizes = [(np.linalg.norm(missed[..., k], axis=-1).max(), terms[..., k].max()) for k in parts]
        return {"bodies": max(float(left / size) if size else 0.0 for left, size in sizes)}

    def _balances(self, dynamics: Dynamics, part: slice) -> Array:
        """Return what is missed and the sums of absolute terms, body by body, shape (k, 2, njoints - 1, 6)."""
        run, model, data = self.run, self.model, self.model.createData()
        sampled = np.linspace(0, len(run) - 1, min(len(run), SAMPLE)).astype(int)
        rows = sampled[(sampled >= part.start) & (sampled < part.stop)]
        inertias, upwards = model.inertias.tolist(), -model.gravity
        shape = len(rows), model.njoints
        turns, places, asked, loads = (np.zeros((*shape, *size)) for size in ((3, 3), (3,), (6,), (6,)))
        for k, i in enumerate(rows):
            for wrenches in self._acting(dynamics, i):
                for body, wrench in wrenches.items():
                    loads[k, body] += wrench
            pin.forwardKinematics(model, data, run.q[i], run.v[i], run.a[i])
            states = list(zip(inertias, data.v.tolist(), data.a.tolist(), data.oMi.tolist(), strict=True))
            turns[k], places[k] = [place.rotation for *_, place in states], [place.translation for *_, place in states]
            asked[k] = [(inertia * (rate + place.actInv(upwards)) + twist.cross(inertia * twist)).vector
                        for inertia, twist, rate, place in states]  # fmt: skip
        forces, moments = (turns @ asked[..., part, None] for part in (slice(0, 3), slice(3, 6)))
        asked, wrenches = np.concatenate([forces, moments], axis=2)[..., 0], self.joints[rows]
        parents = np.array(model.parents)
        carries = (parents == np.arange(model.njoints)[:, None]).astype(float)
        carried, outside = _moved(wrenches, places - places[:, parents]), _moved(loads, -places)
        missed = wrenches + outside - asked - carries @ carried
        terms = np.abs(wrenches) + np.abs(outside) + np.abs(asked) + carries @ np.abs(carried)
        return np.asarray(np.stack([missed, terms], axis=1)[:, :, 1:])

    def loop(self, name: str) -> Array:
        """Return the wrench of a loop joint's first link on its second, at frame 2, world axes, shape (n, 6)."""
        return self._loop(name, self.multipliers)

    def loop_origins(self, name: str) -> Array:
        """Return the places of a loop joint's second frame [m], world axes, shape (n, 3)."""
        rows = np.empty((len(self.run), 3))
        for i, q in enumerate(self.run.q):
            self.closure.place(q)
            rows[i] = self.closure.data.oMf[self.loops[name].second].translation
        return rows

    def _loop(self, name: str, lam: Array) -> Array:
        rows, joint, part = np.zeros((len(lam), 6)), self.loops[name], self.closure.slices()[name]
        for i in np.flatnonzero(lam[:, part].any(axis=1)):
            self.closure.place(self.run.q[i])
            rows[i] = joint.wrench(self.closure.data, lam[i, part])
        return rows

    @cached_property
    def stresses(self) -> list[Array]:
        """Multipliers of length 1 that do nothing, each of shape (n, m), at a sample of the rows; 0 at the others."""
        run, closure, m = self.run, self.closure, self.run.mechanism.closure.size
        found: list[Array] = []
        sampled = np.linspace(0, len(run) - 1, min(len(run), SAMPLE if m else 0)).astype(int)
        for i in sampled:
            closure.place(run.q[i])
            split = Split.of(closure.rows()[:m])
            free = split.scale[:, None] * split.redundant
            free /= np.linalg.norm(free, axis=0)
            while len(found) < free.shape[1]:
                found.append(np.zeros((len(run), closure.size)))
            for k in range(free.shape[1]):
                found[k][i, :m] = free[:, k]
        return found

    @cached_property
    def stressed_joints(self) -> list[Array]:
        """What each self-stress adds to the wrenches of the tree's joints, each of shape (n, njoints, 6)."""
        return [self._stressed(stress) for stress in self.stresses]

    def stressed_loop(self, name: str) -> list[Array]:
        """Return what each self-stress adds to the wrench of a loop joint, each of shape (n, 6)."""
        return [self._loop(name, stress) for stress in self.stresses]

    def _stressed(self, stress: Array) -> Array:
        rows = np.zeros((len(stress), self.model.njoints, 6))
        for i in np.flatnonzero(stress.any(axis=1)):
            self.closure.place(self.run.q[i])
            acting = self.closure.wrenches(stress[i])
            for joint in range(1, self.model.njoints):
                beyond = [int(k) for k in self.model.subtrees[joint]]
                total = -sum((acting[k] for k in beyond if k in acting), np.zeros(6))
                rows[i, joint, :3] = total[:3]
                rows[i, joint, 3:] = total[3:] - np.cross(self.origins[i, joint], total[:3])
        return rows


def _moved(wrenches: Array, arms: Array) -> Array:
    """Return wrenches, shape (.., 6), about points from which arms, shape (.., 3), lead to where they were taken."""
    return np.concatenate([wrenches[..., :3], wrenches[..., 3:] + np.cross(arms, wrenches[..., :3])], axis=-1)
