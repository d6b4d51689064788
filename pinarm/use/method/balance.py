"""The terms of an equation in numbers: what each action, weight and inertia does in the motion of a theorem."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.constraint_rows import Constraint
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.geometry.vectors import moved
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, replace
from pinarm.use.method.actions import Actions, bodies_of, body_name, joint_efforts


class Source(Record, frozen=True):
    """Something that acts on bodies in one state.

    Attributes:
        name: Of the carrier, the force, or the body.
        kind: That of a carrier, or ``weight``, ``inertia``, ``force``, ``rotor``, ``friction``,
            ``pretension``, ``given``, ``tie``.
        wrenches: On every body, [f; m] at the world's origin, world axes, shape (njoints, 6); of an inertia what the
            motion demands.
        efforts: Of an unknown that acts as efforts at joints: these, shape (nv,).
        parts: Sums of the sizes of what the wrenches are sums of, shape (njoints, 6); ``None`` where they are no sums.
    """

    name: str
    kind: str
    wrenches: Array
    efforts: Array | None = None
    parts: Array | None = None

    def power(self, twists: Array) -> float:
        """Return the power in the motions of bodies, shape (njoints, 6): a term of the equation."""
        return float((self.wrenches * twists).sum())

    def size(self, twists: Array, extent: float) -> float:
        """Return the size of that term's parts, whatever their directions: what its rounding is relative to.

        A force has a moment by an arm of up to the extent [m].
        """
        parts = self.wrenches if self.parts is None else self.parts
        force, moment, velocity, spin = (
            np.linalg.norm(each, axis=1) for both in (parts, twists) for each in (both[:, :3], both[:, 3:])
        )
        return float((force * (velocity + extent * spin) + moment * spin).max())


def sources(state: Quantities, actions: Actions, *, split: bool = False) -> list[Source]:
    """Return everything that acts on the bodies in one state, each inside and outside of any group.

    Args:
        state: Quantities of one row, which has efforts.
        actions: The unknown actions at the configuration of that row.
        split: Whether what accelerations and what velocities demand are told apart.
    """
    run = state.trajectory
    parts = {"": run}
    if split:
        still = np.zeros_like(run.a)
        parts = {", accelerations": replace(run, v=still), ", velocities": replace(run, a=still)}
    inertias = (inertia for words, part in parts.items() for inertia in _inertias(part, words))
    weights = (inertia for inertia in _inertias(run, "") if inertia.kind == "weight")
    actions_of_run = [
        *_carried(state, actions),
        *forces_of(run),
        *weights,
        *(inertia for inertia in inertias if inertia.kind == "inertia"),
    ]
    return [source for source in actions_of_run if source.wrenches.any() or source.parts is not None]


def _spread(run: Trajectory, acting: dict[int, Array]) -> Array:
    """Return wrenches on bodies as one array, shape (njoints, 6)."""
    spread = np.zeros((run.mechanism.model.njoints, 6))
    for body, wrench in acting.items():
        spread[body] += np.reshape(wrench, 6)
    return spread


def _efforts(run: Trajectory, load: Array) -> Array:
    """Return the wrenches of efforts at the joints, shape (nv,), on the links, shape (njoints, 6)."""
    return _spread(run, joint_efforts(run.mechanism, run.link_motion[0], np.reshape(load, (1, 1, -1))))


def _carried(state: Quantities, actions: Actions) -> Iterator[Source]:
    run = state.trajectory
    model, links, lam = run.mechanism.model, run.link_motion[0], np.asarray(run.lam)
    tree, total = LinkTree.of(model), state.reactions.joints
    inner = links.inwards(moved(total, links.places))[0]
    for body in bodies_of(run.mechanism):
        subspace = tree.subspace[:, model.joints[body].idx_v : model.joints[body].idx_v + model.joints[body].nv]
        part = np.zeros_like(total)
        part[0, body] = inner[body] - np.linalg.pinv(subspace).T @ (subspace.T @ inner[body])
        wrench = moved(links.outwards(part), links.places)[0, body]
        acting = {int(model.parents[body]): -wrench, body: wrench}
        yield Source(str(model.names[body]), "joint", _spread(run, acting))
    for constraint in run.mechanism.constraints:
        kind = "loop" if isinstance(constraint, LoopJoint) else "tie" if hasattr(constraint, "rotor") else "coupling"
        yield from _of_constraint(run, constraint, kind, lam[:, run.closure.slices[constraint.name]])
    rest = run.tau[0].copy()
    for carrier in actions.carriers:
        if carrier.kind in ("drive", "law"):
            wrenches, used = _of_drive(run, carrier.name, carrier.kind)
            rest -= used
            yield Source(carrier.name, carrier.kind, wrenches, used)
    yield Source("end stops and given efforts", "given", _efforts(run, rest))


def _of_constraint(run: Trajectory, constraint: Constraint, kind: str, lam: Array) -> Iterator[Source]:
    """Yield the action of a constraint, and its part without a multiplier, such as the pretension of a belt."""
    links = run.link_motion[0]
    if acting := constraint.wrenches(links, lam):
        idle = _spread(run, constraint.wrenches(links, 0.0 * lam))
        yield Source(constraint.name, kind, _spread(run, acting) - idle)
        yield Source(constraint.name, "pretension", idle)
        return
    load = lam[0] @ constraint.rows(run.mechanism.closure.state(run.q[0]))
    yield Source(constraint.name, kind, _efforts(run, load), load)


def _of_drive(run: Trajectory, name: str, kind: str) -> tuple[Array, Array]:
    """Return the wrenches on bodies of a drive, or a known effort at a joint, and its part of ``tau``, shape (nv,)."""
    mechanism, nothing = run.mechanism, np.zeros(run.v.shape[-1])
    if name in mechanism.balls:
        ball = mechanism.model.joints[mechanism.balls[name].index]
        nothing[ball.idx_v : ball.idx_v + ball.nv] = run.tau[0, ball.idx_v : ball.idx_v + ball.nv]
        return _efforts(run, nothing), nothing
    along = mechanism.coordinates[name]
    if isinstance(along, LinearCoordinate):
        effort = run.tau[:, along.joint] if kind == "law" and along.joint is not None else run.effort_along(name)
        load = nothing if effort is None else effort[0] * along.weights
        return _efforts(run, load), load
    if name not in run.closure.slices or kind == "law":
        return _spread(run, {}), nothing
    effort = run.lam.along[:, run.closure.slices[name].start - mechanism.closure.size]
    return _spread(run, along.wrenches(run.link_motion[0], effort)), nothing


def forces_of(run: Trajectory) -> Iterator[Source]:
    """Yield the actions of forces, frictions and rotors in one state."""
    links, [(_, dynamics)] = run.link_motion[0], run.intervals()
    for name, force in dynamics.forces.items():
        acting, load = force.wrenches(links, run.grid.t, run.v), np.zeros_like(run.v)
        if not acting:
            force.add_load(run.grid.t, run.q, run.v, load)
        yield Source(name, "force", _spread(run, acting) if acting else _efforts(run, load))
    if run.mechanism.frictions:
        from pinarm.mechanics.friction.contact import slip_rows

        rows = slip_rows(run.mechanism.model, run.mechanism.frictions, run.q)[0]
        for contact, f, row in zip(run.mechanism.frictions, run.friction.T, rows, strict=True):
            acting = contact.slip.wrenches(links, f)
            yield Source(contact.name, "friction", _spread(run, acting) if acting else _efforts(run, f[0] * row))
    rotors = -run.mechanism.model.armature * run.a[0]
    for name, joint in run.mechanism.joints.items():
        own = np.zeros_like(rotors)
        own[joint.v] = rotors[joint.v]
        yield Source(name, "rotor", _efforts(run, own))


def _inertias(run: Trajectory, words: str) -> Iterator[Source]:
    links = run.link_motion[0]
    demands = moved(links.outwards(run.demands), links.places)[:, 0]
    for body in bodies_of(run.mechanism):
        name, moving, weight = body_name(run.mechanism.model, body), demands[:2, body], -demands[2, body]
        if weight.any():
            yield Source(name, "weight", _spread(run, {body: weight}))
        if run.mechanism.model.inertias[body].mass or moving.any():
            parts = _spread(run, {body: np.abs(moving).sum(axis=0)})
            yield Source(name + words, "inertia", _spread(run, {body: moving.sum(axis=0)}), parts=parts)
