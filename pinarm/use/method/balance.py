"""The terms of an equation in numbers: what each action, weight and inertia does in the motion of a theorem."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

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
    """

    name: str
    kind: str
    wrenches: Array

    def power(self, twists: Array) -> float:
        """Return the power in the motions of bodies, shape (njoints, 6): a term of the equation."""
        return float((self.wrenches * twists).sum())

    def size(self, twists: Array, extent: float) -> float:
        """Return the size of that term whatever its directions are: what its rounding is relative to.

        A force has a moment by an arm of up to the extent [m].
        """
        force, moment, velocity, spin = (
            np.linalg.norm(half, axis=1) for whole in (self.wrenches, twists) for half in (whole[:, :3], whole[:, 3:])
        )
        return float((force * (velocity + extent * spin) + moment * spin).max())


def sources(state: Quantities, actions: Actions, *, split: bool) -> list[Source]:
    """Return everything that acts on the bodies in one state, each inside and outside of any group.

    Args:
        state: Quantities of one row, which has efforts.
        actions: The unknown actions at the configuration of that row.
        split: Whether what accelerations and what velocities demand are told apart.
    """
    run = state.trajectory
    still = np.zeros_like(run.a)
    parts = {", accelerations": replace(run, v=still), ", velocities": replace(run, a=still)} if split else {"": run}
    inertias = (inertia for words, part in parts.items() for inertia in inertias_of(part, words))
    acting = [*_carried(state, actions), *forces_of(run), *weights_of(run), *inertias]
    return [source for source in acting if source.wrenches.any()]


def _spread(run: Trajectory, acting: Mapping[int, Array]) -> Array:
    spread = np.zeros((run.mechanism.model.njoints, 6))
    for body, wrench in acting.items():
        spread[body] += np.reshape(wrench, 6)
    return spread


def _efforts(run: Trajectory, load: Array) -> Array:
    return _spread(run, joint_efforts(run.mechanism, run.link_motion[0], np.reshape(load, (1, 1, -1))))


def _carried(state: Quantities, actions: Actions) -> Iterator[Source]:
    run, model = state.trajectory, state.trajectory.mechanism.model
    links, total = run.link_motion[0], state.reactions.joints
    inner = links.inwards(moved(total, links.places))[0]
    for body in bodies_of(run.mechanism):
        joint = model.joints[body]
        subspace = LinkTree.of(model).subspace[:, joint.idx_v : joint.idx_v + joint.nv]
        part = np.zeros_like(total)
        part[0, body] = inner[body] - np.linalg.pinv(subspace).T @ (subspace.T @ inner[body])
        wrench = moved(links.outwards(part), links.places)[0, body]
        yield Source(str(model.names[body]), "joint", _spread(run, {int(model.parents[body]): -wrench, body: wrench}))
    for constraint in run.mechanism.constraints:
        yield from _of_constraint(run, constraint)
    rest = run.tau[0].copy()
    for carrier in actions.carriers:
        if carrier.kind in ("drive", "law"):
            wrenches, used = _of_drive(run, carrier.name, carrier.kind)
            rest -= used
            yield Source(carrier.name, carrier.kind, wrenches)
    yield Source("end stops and given efforts", "given", _efforts(run, rest))


def _of_constraint(run: Trajectory, constraint: Constraint) -> Iterator[Source]:
    """Yield the action of a constraint but for its part without a multiplier; see ``forces_of``."""
    kind = "loop" if isinstance(constraint, LoopJoint) else "tie" if hasattr(constraint, "rotor") else "coupling"
    links, lam = run.link_motion[0], run.lam[:, run.closure.slices[constraint.name]]
    if acting := constraint.wrenches(links, lam):
        idle = _spread(run, constraint.wrenches(links, 0.0 * lam))
        yield Source(constraint.name, kind, _spread(run, acting) - idle)
    else:
        rows = constraint.rows(run.mechanism.closure.state(run.q[0]))
        yield Source(constraint.name, kind, _efforts(run, lam[0] @ rows))


def _of_drive(run: Trajectory, name: str, kind: str) -> tuple[Array, Array]:
    """Return the wrenches on bodies of a drive, or a known effort at a joint, and its part of ``tau``, shape (nv,)."""
    mechanism, load = run.mechanism, np.zeros(run.v.shape[-1])
    if name in mechanism.balls:
        ball = mechanism.model.joints[mechanism.balls[name].index]
        load[ball.idx_v : ball.idx_v + ball.nv] = run.tau[0, ball.idx_v : ball.idx_v + ball.nv]
        return _efforts(run, load), load
    along = mechanism.coordinates[name]
    if isinstance(along, LinearCoordinate):
        effort = run.tau[:, along.joint] if kind == "law" and along.joint is not None else run.effort_along(name)
        load = load if effort is None else effort[0] * along.weights
        return _efforts(run, load), load
    if name not in run.closure.slices or kind == "law":
        return _spread(run, {}), load
    effort = run.lam[:, run.closure.slices[name].start]
    return _spread(run, along.wrenches(run.link_motion[0], effort)), load


def forces_of(run: Trajectory) -> Iterator[Source]:
    """Yield the actions of forces, pretensions of belts, frictions and rotors in one state."""
    links, [(_, dynamics)] = run.link_motion[0], run.intervals()
    for constraint in run.mechanism.constraints:
        yield Source(
            constraint.name, "pretension", _spread(run, constraint.wrenches(links, np.zeros((1, constraint.size))))
        )
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
        yield Source(name, "rotor", _efforts(run, np.where(np.arange(len(rotors)) == joint.v, rotors, 0.0)))


def weights_of(run: Trajectory) -> Iterator[Source]:
    """Yield the weights of the bodies."""
    for body, name, demands in _demands(run):
        yield Source(name, "weight", _spread(run, {body: -demands[2]}))


def inertias_of(run: Trajectory, words: str = "") -> Iterator[Source]:
    """Yield the inertia terms of the bodies; ``words`` are added to their names."""
    for body, name, demands in _demands(run):
        yield Source(name + words, "inertia", _spread(run, {body: demands[:2].sum(axis=0)}))


def _demands(run: Trajectory) -> Iterator[tuple[int, str, Array]]:
    """Yield bodies, their names, and the wrenches of accelerations, velocities and gravity, shape (3, 6)."""
    links = run.link_motion[0]
    demands = moved(links.outwards(run.demands), links.places)[:, 0]
    for body in bodies_of(run.mechanism):
        yield body, body_name(run.mechanism.model, body), demands[:, body]
