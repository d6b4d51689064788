"""Linear response of a mechanism to friction in one state.

With the rows J of the slips, the friction f adds ``J^T f`` to the loads; the slips' accelerations are
``alpha = J a + J' v = alpha0 + A f``, and multipliers are linear in f, too. So are the wrenches of bearings, ``w(f)``,
but for kinks of multipliers: see ``CarriedLoads``. With T a basis of the motions that the constraints and laws allow,
``A = J T (T^T M T)^-1 T^T J^T``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import Decomposition, solved_positive
from pinarm.engine.dynamics.coordinate_partition import Targets
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import solve
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.friction.slipping import CarriedLoads
from pinarm.errors import DynamicsError
from pinarm.mechanics.couplings.coupling import JointRelation, left_open
from pinarm.mechanics.friction.contact import FrictionContact, slip_drifts, slip_rows
from pinarm.mechanics.geometry.link_placements import LinkPlacements

DRIVEN = 1e-9
"""Part of a slip that constraints and laws leave free, below which they determine it."""

STILL = 1e-12
"""Part of the accelerations that efforts could give below which one that constraints and laws determine is rounding:
a joint that geometry holds still does not begin to slip by it."""

OPEN = 1e-9
"""Change of a load by a self-stress of length 1 that is rounding, which leaves 1e-13."""


class SlipResponse(NamedTuple):
    """Accelerations ``alpha0 + A f`` of k slips, and loads of their bearings, as functions of the friction f.

    ``driven`` tells which slips the constraints and laws determine, shape (k,).
    """

    acceleration: Array
    mobility: Array
    loads: CarriedLoads
    driven: Flags

    def at(self, f: Array) -> Array:
        return np.asarray(self.acceleration + self.mobility @ f)


class _InState(NamedTuple):
    """Mechanism in one state (q, v), and accelerations (nv, k) and multipliers (k, m) per friction of size 1."""

    key: bytes
    split: Decomposition
    mass: Array
    nle: Array
    right: Array
    slips: Array
    drift: Array
    accelerations: Array
    multipliers: Array
    driven: Flags


@dataclass(frozen=True, eq=False)
class SlipEquation:
    """The equation of motion on one interval without jumps, and the slips in it.

    Attributes:
        closure: Constraints, then coordinates that follow laws.
        dynamics: The equation of motion without this friction.
        targets: ``t -> w, w', w''`` of the coordinates that follow laws.
        efforts: Of drives [N*m or N], shape (nv,); none where it is 0.
    """

    contacts: Sequence[FrictionContact]
    closure: Closure
    dynamics: Dynamics
    targets: Targets
    efforts: Array | float = 0.0

    @cached_property
    def loaded(self) -> bool:
        return any(contact.law.loaded for contact in self.contacts)

    @cached_property
    def _last(self) -> list[_InState]:
        return []

    def _in_state(self, q: Array, v: Array) -> _InState:
        """Return the parts that do not depend on the instant; kept, as loads alone change where nothing moves."""
        key = q.tobytes() + v.tobytes()
        if not self._last or self._last[0].key != key:
            closure, model = self.closure, self.closure.model
            state = closure.state(q, v)
            split, mass = closure.split(closure.rows(state)), mass_matrix(model, q)
            slips = slip_rows(model, self.contacts, q)
            free = slips @ split.free
            accelerations = split.free @ solved_positive(split.free.T @ mass @ split.free, free.T)
            self._last[:] = [_InState(
                key, split, mass, pin.nonLinearEffects(model, self.dynamics.data, q, v).copy(), -closure.drift(state),
                slips, slip_drifts(model, self.contacts, q[None], v[None])[0], accelerations,
                np.array([split.multipliers(column) for column in accelerations.T @ mass - slips]),
                np.vecdot(free, free) <= DRIVEN**2 * np.vecdot(slips, slips),
            )]  # fmt: skip
        return self._last[0]

    def at(self, t: float, q: Array, v: Array) -> SlipResponse:
        here, k = self._in_state(q, v), len(self.contacts)
        force, ddw = self.efforts + self.dynamics.loads(t, q, v) - here.nle, self.targets(t)[2]
        right = here.right.copy()
        right[len(right) - len(ddw) :] += ddw
        a = solve(here.split, here.mass, force, right)
        terms, masses = np.abs(force) + np.abs(here.mass @ a), np.diag(here.mass)
        alpha, mobility = here.slips @ a + here.drift, np.asarray(here.slips @ here.accelerations)
        rounding = STILL * np.abs(here.slips) @ np.where(masses > 0.0, terms / np.where(masses > 0.0, masses, 1.0), 0.0)
        alpha = np.where(here.driven & (np.abs(alpha) <= rounding), 0.0, alpha)
        if not self.loaded:
            loads = CarriedLoads.linear(np.zeros((k, 6)), np.zeros((k, k, 6)))
            return SlipResponse(alpha, mobility, loads, here.driven)
        sizes = self._sizes(here, terms)
        f, lam = _each_alone(sizes), here.split.multipliers(here.mass @ a - force)
        loads = BearingReactions(self.contacts, self.closure, self.dynamics).loads(
            t, q, v, a + f @ here.accelerations.T, lam + f @ here.multipliers, sizes
        )
        return SlipResponse(alpha, mobility, loads, here.driven)

    def _sizes(self, here: _InState, terms: Array) -> Array:
        """Return frictions as large as the other efforts and the weight, powers of 2: differences lose no digits; (k,).

        Larger ones would lose none either, as the loads are linear; efforts may be rounding of weights across them.
        """
        model, along = self.closure.model, np.abs(here.slips).max(axis=1)
        weight = float(sum(link.mass for link in model.inertias) * np.linalg.norm(model.gravity.linear))
        most = max(weight, float(terms.max(initial=0.0))) or 1.0
        return np.exp2(np.round(np.log2(np.where(along > 0.0, most / np.where(along > 0.0, along, 1.0), 1.0))))

    def require_determined(self, q: Array) -> None:
        if self.loaded and self.closure.size:
            rows = self.closure.split_at(q)
            BearingReactions(self.contacts, self.closure, self.dynamics).require_determined(rows, q)


@dataclass(frozen=True, eq=False)
class BearingReactions:
    """Wrenches of the bearings of k joints with friction, by Newton's and Euler's equations of the bodies.

    ``closure`` has the constraints, then coordinates that follow laws; ``dynamics`` is without this friction.
    """

    contacts: Sequence[FrictionContact]
    closure: Closure
    dynamics: Dynamics

    def _wrenches(self, links: LinkPlacements, t: float, q: Array, v: Array, a: Array, lam: Array, f: Array) -> Array:
        """Return wrenches in one state under n accelerations, multipliers and frictions, shape (n, k, 6)."""
        model, data = self.closure.model, self.dynamics.data
        named = {name: lam[:, rows] for name, rows in self.closure.slices.items()}
        links = links.some(np.zeros(len(a), dtype=np.intp))
        acting, inner = links.inwards(self._acting(links, t, q, v, lam, f)), np.empty((len(a), model.njoints, 6))
        outside = pin.StdVec_Force()
        outside.extend([pin.Force.Zero() for _ in range(model.njoints)])
        loaded = np.nonzero(acting.any(axis=(0, 2)))[0].tolist()
        for k in range(len(a)):
            for joint in loaded:
                outside[joint] = pin.Force(acting[k, joint])
            pin.rnea(model, data, q, v, a[k], outside)
            inner[k] = [wrench.vector for wrench in data.f.tolist()]
        joints = links.outwards(inner)
        return np.array([contact.transmitted(links, joints, named) for contact in self.contacts]).swapaxes(0, 1)

    def loads(self, t: float, q: Array, v: Array, a: Array, lam: Array, sizes: Array) -> CarriedLoads:
        """Return the wrenches as functions of the friction in one state.

        Accelerations, shape (1 + k, nv), and multipliers, shape (1 + k, m), are those without friction, then
        those with a friction of the given size of each joint alone, shape (k,).
        """
        f, links = _each_alone(sizes), LinkPlacements.at(self.closure.model, q[None])
        distances, fold = self._kinks(links, lam, f)
        smooth = self._wrenches(links, t, q, v, a, lam, f) - np.vecmat(np.abs(distances)[:, None], fold)
        rate, response = ((x[1:] - x[0]) / sizes.reshape(-1, *(1,) * (x.ndim - 1)) for x in (distances, smooth))
        return CarriedLoads(smooth[0], response.swapaxes(0, 1), distances[0], rate.T, fold)

    def _kinks(self, links: LinkPlacements, lam: Array, f: Array) -> tuple[Array, Array]:
        """Return the distances of multipliers and frictions from their kinks, shape (n, p), and K, shape (k, p, 6)."""
        model, slices = self.closure.model, self.closure.slices
        relations = [relation for relation in self.closure.constraints if isinstance(relation, JointRelation)]
        own = [(lam[:, slices[relation.name].start], kink) for relation in relations for kink in relation.kinks(links)]
        own += [(x, kink) for contact, x in zip(self.contacts, f.T, strict=True) for kink in contact.kinks(links)]
        if not own:
            return np.zeros((len(lam), 0)), np.zeros((len(self.contacts), 0, 6))
        acting = np.zeros((len(own), model.njoints, 6))
        for row, (_, kink) in zip(acting, own, strict=True):
            for joint, wrench in kink.wrenches.items():
                row[joint] += wrench
        joints = links.at_joints(-np.stack([acting[:, list(part)].sum(axis=1) for part in model.subtrees], axis=1))
        none = {name: np.zeros((len(own), rows.stop - rows.start)) for name, rows in slices.items()}
        all_alike = links.some(np.zeros(len(own), dtype=np.intp))
        fold = np.array([contact.transmitted(all_alike, joints, none) for contact in self.contacts])
        acts = fold.any(axis=(0, 2))
        return np.array([x - kink.at for x, kink in own]).reshape(len(own), len(lam)).T[:, acts], fold[:, acts]

    def _acting(self, links: LinkPlacements, t: float, q: Array, v: Array, lam: Array, f: Array) -> Array:
        """Return wrenches [f; m] of loads, constraints and friction on links at the world's origin, (n, njoints, 6)."""
        acting = self.closure.wrenches(links, lam)
        own = [
            force.wrenches(links.some(np.zeros(1, dtype=np.intp)), np.array([t]), v[None])
            for force in self.dynamics.forces.values()
        ]
        own += [contact.slip.wrenches(links, size) for contact, size in zip(self.contacts, f.T, strict=True)]
        for wrenches in own:
            for joint, wrench in wrenches.items():
                acting[:, joint] += wrench
        return acting

    def _require_known(self) -> None:
        """Raise where couplings whose forces on bodies are not known load a bearing."""
        couplings = [constraint for constraint in self.closure.constraints if isinstance(constraint, JointRelation)]
        left = left_open(self.closure.model, couplings)
        for contact in self.contacts:
            reaction = left.get(contact.of) if isinstance(contact.of, int) and contact.law.loaded else None
            if reaction is not None and contact.bearing.most(reaction.wrenches).max() > OPEN:
                raise DynamicsError(
                    f"the friction of {contact.name} depends on a reaction that is not known: {reaction}",
                    expected="couplings that say how they act on bodies, or friction without a load: constant",
                )

    def require_determined(self, rows: Decomposition, q: Array) -> None:
        """Raise where multipliers that do nothing load a bearing, at a configuration with its rows."""
        self._require_known()
        for contact in self.undetermined(rows, q):
            if not contact.shared:
                raise DynamicsError(
                    f"the friction of {contact.name} depends on a reaction that rigid bodies do not determine: the "
                    "mechanism is hyperstatic",
                    expected="a joint that is loosened until its reaction is determined, or friction without a "
                    "load: constant",
                    hint="no thrust_radius or span, or undetermined: minimum_norm, for the least multipliers",
                )

    def undetermined(self, rows: Decomposition, q: Array) -> list[FrictionContact]:
        """Return the contacts whose bearings multipliers load that do nothing; see ``require_determined``."""
        m, nv, links = self.closure.size, self.closure.model.nv, LinkPlacements.at(self.closure.model, q[None])
        stresses = np.vstack([np.zeros((1, m)), rows.stresses.T])
        still, none = np.zeros((len(stresses), nv)), np.zeros((len(stresses), len(self.contacts)))
        wrenches = self._wrenches(links, 0.0, q, still[0], still, stresses, none)
        added = (wrenches[1:] - wrenches[0]).swapaxes(0, 1)
        return [
            contact
            for contact, wrench in zip(self.contacts, added, strict=True)
            if contact.law.loaded and (contact.bearing.most(wrench) > OPEN).any()
        ]


def _each_alone(sizes: Array) -> Array:
    """Return no friction, then that of each joint alone, shape (k,) to (1 + k, k)."""
    f = np.zeros((1 + len(sizes), len(sizes)))
    f[1:] = np.diag(sizes)
    return f
