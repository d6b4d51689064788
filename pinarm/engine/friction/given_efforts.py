"""Friction in states whose efforts are given: which joints stick is decided in each by itself."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import mass_matrix
from pinarm.engine.friction.complementarity import MARGIN, Extremes, FrictionBalance, decided, extreme_frictions, filled
from pinarm.engine.friction.slip_equation import SlipEquation, jammed
from pinarm.mechanics.friction.contact import FrictionContact, several, sizes, slip_rows, unit_vectors

NOTHING = np.zeros(0)


def friction_under(
    contacts: Sequence[FrictionContact], dynamics: Dynamics, closure: Closure, t: float, q: Array, v: Array, tau: Array
) -> tuple[Array, list[tuple[Array, Flags]]]:
    """Return the friction of k joints under efforts of drives, shape (n, k) [N*m or N], and others that hold as well.

    These are the extremes of shares of joints at rest; see ``extreme_frictions`` and ``filled``. States q and v and
    efforts have the shapes (n, nq), (n, nv) and (n, nv); ``dynamics`` is without this friction.
    """
    joints = None if closure.size else _constant_laws(tuple(contacts))
    friction, extremes = np.zeros((len(q), len(contacts))), list[Extremes]()
    if joints is not None and (solved := _in_tree(joints, dynamics, t, q, v, tau)) is not None:
        return solved, []
    slips = np.matvec(slip_rows(closure.model, contacts, q), v)
    speeds = sizes(contacts, slips)
    for i, moving in enumerate(unit_vectors(contacts, slips)):
        equation = SlipEquation(contacts, closure, dynamics, lambda t: (NOTHING, NOTHING, NOTHING), tau[i])
        equation.require_determined(q[i])
        balance = FrictionBalance(contacts, equation.at(t, q[i], v[i]), speeds[i])
        slip = decided(balance, moving, np.zeros(len(contacts)))
        direction = np.array(slip.direction, float)
        solution = balance.solve(direction, slip.stuck, np.zeros(len(contacts), dtype=bool))
        if solution is None:
            raise jammed(contacts, np.ones(len(contacts)), "")
        friction[i] = solution.f
        extremes.append(extreme_frictions(balance, direction, slip.stuck, solution.f))
    return friction, filled(friction, extremes)


class _JointLaws(NamedTuple):
    """Friction of k joints of a tree that no load changes: indices in v, and the laws, shape (k,) each.

    ``decay`` is the reciprocal of Stribeck's velocity, 0 without one; ``None`` where no joint has one.
    """

    v: Indices
    resting: Array
    slipping: Array
    viscous: Array
    decay: Array | None

    def resistance(self, speed: Array) -> Array:
        """Return the friction of slip at speeds, shape (.., k) [N*m or N]."""
        if self.decay is None:
            return np.asarray(self.slipping + self.viscous * speed)
        rest = np.exp(-((speed * self.decay) ** 2)) * (self.decay > 0.0)
        return np.asarray(self.slipping + (self.resting - self.slipping) * rest + self.viscous * speed)


@lru_cache(maxsize=16)
def _constant_laws(contacts: tuple[FrictionContact, ...]) -> _JointLaws | None:
    """Return the laws of joints of the tree; ``None`` where one depends on a load, or has several components."""
    joints = [contact for contact in contacts if isinstance(contact.of, int) and not contact.law.loaded]
    if len(joints) < len(contacts) or several(contacts).any():
        return None
    laws = [(joint.law.static_constant, joint.law.constant, joint.law.viscous) for joint in joints]
    decay = np.array([1.0 / joint.law.stribeck if joint.law.stribeck else 0.0 for joint in joints])
    places = np.array([slip.joint for joint in joints if (slip := joint.standing)], dtype=np.intp)
    resting, slipping, viscous = np.array(laws).reshape(-1, 3).T.copy()
    return _JointLaws(places, resting, slipping, viscous, decay if decay.any() else None)


def _in_tree(joints: _JointLaws, dynamics: Dynamics, t: float, q: Array, v: Array, tau: Array) -> Array | None:
    """Return the friction of joints of a tree that no load changes, shape (n, k); ``None`` where it is not known."""
    slips = v[:, joints.v]
    friction = -np.sign(slips) * joints.resistance(np.abs(slips))
    if slips.all() or not (joints.resting.any() or joints.slipping.any()):
        return friction
    force = tau - dynamics.inverse(t, q, v, np.zeros_like(v))
    for i in np.flatnonzero(~slips.all(axis=1)).tolist():
        state = _TreeAtRest(joints, dynamics, q[i], force[i], friction[i], slips[i] == 0.0)
        try:
            solved = state.solved()
        except np.linalg.LinAlgError:  # a joint without mass
            return None
        if solved is None:
            return None
        friction[i] = solved
    return friction


class _TreeAtRest:
    """Complementarity of friction in one state of a tree, without loads: many joints are exchanged at once.

    With the accelerations of stuck joints 0, those of others are ``M_oo^-1 (f + force)_o``, and the friction of stuck
    joints is ``M_so a_o - force_s``.
    """

    def __init__(
        self, joints: _JointLaws, dynamics: Dynamics, q: Array, force: Array, friction: Array, resting: Flags
    ) -> None:
        self.joints, self.model, self.q = joints, dynamics.model, q
        self.force, self.friction, self.resting = force, friction, resting
        self.mass: Array | None = None

    def solved(self) -> Array | None:
        """Return the friction, shape (k,): begun slips are decided by the friction at rest, then have that of slip."""
        limits, signs, held = self.joints.resting, np.zeros(len(self.joints.v)), -self.force[self.joints.v]
        if len(held) == len(self.force) and self.resting.all() and (np.abs(held) <= limits).all():
            return held  # every joint sticks
        while True:
            answer = self._exchanged(signs, limits, kept=signs != 0.0)
            if answer is None or (answer[0] == signs).all():
                return None if answer is None else answer[1]
            signs = answer[0]
            limits = np.where(signs != 0.0, self.joints.resistance(np.zeros(len(signs))), self.joints.resting)

    def _exchanged(self, signs: Array, limits: Array, kept: Flags) -> tuple[Array, Array] | None:
        """Return directions in which resting joints begin to slip, 0 of stuck ones, and the friction; shape (k,)."""
        v, fewest = self.joints.v, len(signs) + 1
        for _ in range(50 * (1 + len(signs))):
            stuck = self.resting & (signs == 0.0)
            friction, a = self._motion(np.where(signs != 0.0, -signs * limits, self.friction), stuck)
            over = stuck & (np.abs(friction) > limits * (1.0 + MARGIN))
            wrong = np.flatnonzero(over | (signs * a[v] < -MARGIN * np.abs(a).max(initial=0.0)))
            if not len(wrong):
                return signs, friction
            if kept[wrong].any():
                return None
            some, fewest = (wrong, len(wrong)) if len(wrong) < fewest else (wrong[:1], fewest)
            signs = signs.copy()
            signs[some] = np.where(over[some], -np.sign(friction[some]), 0.0)
        return None

    def _motion(self, friction: Array, stuck: Flags) -> tuple[Array, Array]:
        """Return the friction with that of stuck joints, and the accelerations."""
        v, a, force = self.joints.v, np.zeros(len(self.force)), self.force.copy()
        others = np.ones(len(a), dtype=bool)
        others[v[stuck]] = False
        force[v] += np.where(stuck, 0.0, friction)
        held = -force[v]
        if others.any():
            if self.mass is None:
                self.mass = mass_matrix(self.model, self.q)
            a[others] = np.linalg.solve(self.mass[others][:, others], force[others])
            held += (self.mass @ a)[v]
        return np.where(stuck, held, friction), a
