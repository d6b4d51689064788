"""What friction does to the motion of a mechanism in one state: linear, as forces are in Newton's equations.

With the rows J of the slips, the friction f adds ``J^T f`` to the loads; the slips' accelerations are
``alpha = J a + J' v = alpha0 + A f``, and multipliers are linear in f, too. So are the wrenches that bearings carry,
``w(f)``, but for kinks of multipliers: see ``carried_loads``. With T a basis of the motions
that the constraints and laws allow, ``A = J T (T^T M T)^-1 T^T J^T``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import SplitRows, solved_positive
from pinarm.engine.dynamics.coordinate_partition import Targets
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import solve
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.friction.carried_loads import CarriedLoads
from pinarm.errors import DynamicsError
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.couplings.left_open import left_open
from pinarm.mechanics.friction.contact import FrictionContact, JointContact, slip_drifts, slip_rows_at
from pinarm.mechanics.friction.coupling_contact import ConstantSlip
from pinarm.mechanics.geometry.link_placements import LinkPlacements

DRIVEN = 1e-9
"""Part of a slip that constraints and laws leave free, below which they determine it."""

STILL = 1e-12
"""Part of the accelerations that efforts could give below which one that constraints and laws determine is rounding:
a joint that geometry holds still does not begin to slip by it."""

OPEN = 1e-9
"""What a self-stress of length 1 may add to a load: rounding leaves 1e-13."""


@dataclass(frozen=True, eq=False)
class SlipResponse:
    """Accelerations of k slips, and loads of their bearings, as functions of the friction.

    Attributes:
        acceleration: alpha0 [rad/s^2 or m/s^2], shape (k,).
        mobility: A, shape (k, k).
        loads: ``w(f)``.
        driven: Which slips the constraints and laws determine, shape (k,).
    """

    acceleration: Array
    mobility: Array
    loads: CarriedLoads
    driven: Flags

    def at(self, f: Array) -> Array:
        """Return alpha under friction f, shape (k,)."""
        return np.asarray(self.acceleration + self.mobility @ f)


@dataclass(frozen=True, eq=False)
class SlipEquation:
    """The equation of motion on one interval without jumps, and the slips in it.

    Attributes:
        contacts: The k joints with friction.
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
        """Whether any friction depends on what its joint carries."""
        return any(contact.law.loaded for contact in self.contacts)

    @cached_property
    def weight(self) -> float:
        """``m g^2`` of all links [N^2/kg]."""
        model = self.closure.model
        return float(sum(each.mass for each in model.inertias) * (model.gravity.linear @ model.gravity.linear))

    def at(self, t: float, q: Array, v: Array) -> SlipResponse:
        """Return how slips and loads respond to friction in a state, shapes (nq,) and (nv,)."""
        solved = _Solved.of(self, t, q, v)
        k = len(self.contacts)
        loads = CarriedLoads.linear(np.zeros((k, 6)), np.zeros((k, k, 6)))
        if self.loaded:
            loads = solved.loads()
        return SlipResponse(solved.alpha, solved.mobility, loads, solved.driven)

    def accelerations(self, t: Array, q: Array, v: Array) -> Array:
        """Return those of the slips without friction at n instants of one state [rad/s^2 or m/s^2], shape (n, k)."""
        here = self.in_state(q, v)
        return np.asarray(self.motions(t, q, v)[1] @ here.slips.T + here.drift)

    def carried(self, t: Array, q: Array, v: Array) -> Array:
        """Return what bearings carry without friction at n instants of one state, shape (n, k, 6)."""
        here, (force, a) = self.in_state(q, v), self.motions(t, q, v)
        lam, none = here.split.multipliers(a @ here.mass - force), np.zeros((len(t), len(self.contacts)))
        return self.transmission.wrenches(t, q, v, a, lam, none)

    def motion(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return efforts and loads less what weights and velocities do, and accelerations without friction, (nv,)."""
        return self._moved(self.in_state(q, v), self.dynamics.loads(t, q, v), self.targets(t)[2])

    def motions(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the same at n instants [s] of one state, shapes (nq,) and (nv,): both of shape (n, nv)."""
        states = (np.broadcast_to(x, (len(t), len(x))) for x in (q, v))
        ddw = np.array([self.targets(instant)[2] for instant in t.tolist()])
        return self._moved(self.in_state(q, v), self.dynamics.loads(t, *states), ddw)

    def _moved(self, here: _InState, loads: Array, ddw: Array) -> tuple[Array, Array]:
        force, right = self.efforts + loads - here.nle, np.empty((*ddw.shape[:-1], len(here.right)))
        right[:] = here.right
        right[..., len(here.right) - ddw.shape[-1] :] += ddw
        return force, solve(here.split, here.mass, force, right)

    @cached_property
    def in_state(self) -> Callable[[Array, Array], _InState]:
        """Returns what does not depend on the instant: where nothing moves, loads change alone."""
        last: list[tuple[bytes, _InState]] = []

        def in_state(q: Array, v: Array) -> _InState:
            asked = q.tobytes() + v.tobytes()
            if not last or last[0][0] != asked:
                last[:] = [(asked, _InState.of(self, q, v))]
            return last[0][1]

        return in_state

    @property
    def transmission(self) -> BearingReactions:
        """What the bearings carry."""
        return BearingReactions(self.contacts, self.closure, self.dynamics)

    def require_determined(self, q: Array) -> None:
        """Raise where the load of a bearing is not determined by rigid bodies; see ``BearingReactions``."""
        if self.loaded and self.closure.size:
            self.transmission.require_determined(self.closure.split(self.closure.rows(self.closure.state(q))), q)


@dataclass(frozen=True, eq=False)
class BearingReactions:
    """What the bearings of joints with friction carry, by Newton's and Euler's equations of the bodies.

    Attributes:
        contacts: The k joints.
        closure: Constraints, then coordinates that follow laws.
        dynamics: The equation of motion without this friction.
    """

    contacts: Sequence[FrictionContact]
    closure: Closure
    dynamics: Dynamics

    def wrenches(self, t: Array | float, q: Array, v: Array, a: Array, lam: Array, f: Array) -> Array:
        """Return the wrenches in one state under n accelerations, multipliers and frictions, shape (n, k, 6).

        Args:
            t: Instant [s], or n of them.
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            a: Accelerations, shape (n, nv).
            lam: Multipliers, shape (n, m).
            f: Friction [N*m or N], shape (n, k).
        """
        if self._by_multipliers:
            return self._carried(lam)
        return self._wrenches(LinkPlacements.at(self.closure.model, q[None]), t, q, v, a, lam, f)

    @property
    def _by_multipliers(self) -> bool:
        """Whether all loads that count are multipliers."""
        return all(isinstance(contact, ConstantSlip) or not contact.law.loaded for contact in self.contacts)

    def _carried(self, lam: Array) -> Array:
        """Return the multipliers as wrenches, shape (n, k, 6)."""
        named = {name: lam[:, rows] for name, rows in self.closure.slices.items()}
        carried = np.zeros((len(lam), len(self.contacts), 6))
        for i, contact in enumerate(self.contacts):
            if isinstance(contact, ConstantSlip):
                carried[:, i] = contact.carried(named)
        return carried

    def _wrenches(
        self, here: LinkPlacements, t: Array | float, q: Array, v: Array, a: Array, lam: Array, f: Array
    ) -> Array:
        """Return the same as ``wrenches``, links being where they are in one state."""
        model, data, slices = self.closure.model, self.dynamics.data, self.closure.slices
        named = {name: lam[:, rows] for name, rows in slices.items()}
        links = here.some(np.zeros(len(a), dtype=np.intp))
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

        Args:
            t: Instant [s].
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            a: Accelerations without friction, then with that of each joint alone, shape (1 + k, nv).
            lam: Multipliers likewise, shape (1 + k, m).
            sizes: These frictions [N*m or N], shape (k,).
        """
        if self._by_multipliers:
            wrenches = self._carried(lam)
            return CarriedLoads.linear(
                wrenches[0], ((wrenches[1:] - wrenches[0]) / sizes[:, None, None]).swapaxes(0, 1)
            )
        f, links = _each_alone(sizes), LinkPlacements.at(self.closure.model, q[None])
        distances, fold = self._kinks(links, lam, f)
        smooth = self._wrenches(links, t, q, v, a, lam, f) - np.vecmat(np.abs(distances)[:, None], fold)
        rate, response = ((x[1:] - x[0]) / sizes.reshape(-1, *(1,) * (x.ndim - 1)) for x in (distances, smooth))
        return CarriedLoads(smooth[0], response.swapaxes(0, 1), distances[0], rate.T, fold)

    def _kinks(self, links: LinkPlacements, lam: Array, f: Array) -> tuple[Array, Array]:
        """Return how far multipliers and frictions are from their kinks, shape (n, p), and K, shape (k, p, 6)."""
        model, slices = self.closure.model, self.closure.slices
        own = [(lam[:, slices[each.name].start], kink) for each in self.closure.constraints
               if isinstance(each, JointRelation) for kink in each.kinks(links)]  # fmt: skip
        own += [(x, kink) for contact, x in zip(self.contacts, f.T, strict=True) for kink in contact.kinks(links)]
        if not own:
            return np.zeros((len(lam), 0)), np.zeros((len(self.contacts), 0, 6))
        acting = np.zeros((len(own), model.njoints, 6))
        for each, (_, kink) in zip(acting, own, strict=True):
            for joint, wrench in kink.wrenches.items():
                each[joint] += wrench
        joints = links.at_joints(-np.stack([acting[:, list(each)].sum(axis=1) for each in model.subtrees], axis=1))
        none = {name: np.zeros((len(own), rows.stop - rows.start)) for name, rows in slices.items()}
        all_alike = links.some(np.zeros(len(own), dtype=np.intp))
        fold = np.array([contact.transmitted(all_alike, joints, none) for contact in self.contacts])
        return np.array([x - kink.at for x, kink in own]).reshape(len(own), len(lam)).T, fold

    def _acting(self, links: LinkPlacements, t: Array | float, q: Array, v: Array, lam: Array, f: Array) -> Array:
        """Return what loads, constraints and friction do to links, [f; m] at the world's origin, (n, njoints, 6)."""
        acting, instants = self.closure.wrenches(links, lam), np.atleast_1d(t).tolist()
        rows: Sequence[int | slice] = range(len(instants)) if len(instants) > 1 else [slice(None)]
        for force in self.dynamics.forces.values():
            for row, instant in zip(rows, instants, strict=True):
                for joint, wrench in force.wrenches(instant, q, v).items():
                    acting[row, joint] += wrench
        for contact, size in zip(self.contacts, f.T, strict=True):
            for joint, wrench in contact.wrenches(links, size).items():
                acting[:, joint] += wrench
        return acting

    def _require_known(self) -> None:
        """Raise where couplings whose forces on bodies are not known load a bearing.

        Raises:
            DynamicsError: Says which.
        """
        couplings = [constraint for constraint in self.closure.constraints if isinstance(constraint, JointRelation)]
        left = left_open(self.closure.model, couplings)
        for contact in self.contacts:
            reaction = left.get(contact.index) if isinstance(contact, JointContact) and contact.law.loaded else None
            if reaction is not None and contact.bearing.most(reaction.wrenches).max() > OPEN:
                raise DynamicsError(
                    f"the friction of {contact.name} depends on a reaction that is not known: {reaction}",
                    expected="couplings that say how they act on bodies, or friction without a load: constant",
                )

    def require_determined(self, rows: SplitRows, q: Array) -> None:
        """Raise where multipliers that do nothing load a bearing.

        Args:
            rows: Of the constraints, taken apart.
            q: Configuration, shape (nq,).

        Raises:
            DynamicsError: Says which joint's friction rigid bodies do not determine.
        """
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

    def undetermined(self, rows: SplitRows, q: Array) -> list[FrictionContact]:
        """Return the contacts whose bearings multipliers load that do nothing; see ``require_determined``."""
        m = self.closure.size
        stresses = np.vstack([np.zeros((1, m)), rows.stresses.T])
        still, none = np.zeros((len(stresses), self.closure.model.nv)), np.zeros((len(stresses), len(self.contacts)))
        wrenches = self.wrenches(0.0, q, still[0], still, stresses, none)
        added = (wrenches[1:] - wrenches[0]).swapaxes(0, 1)
        return [contact for contact, wrench in zip(self.contacts, added, strict=True)
                if contact.law.loaded and (contact.bearing.most(wrench) > OPEN).any()]  # fmt: skip


@dataclass(frozen=True, eq=False)
class _InState:
    """What does not depend on the instant: the mechanism in one state, and what frictions of size 1 do to it."""

    split: SplitRows
    mass: Array
    nle: Array
    right: Array
    slips: Array
    drift: Array
    accelerations: Array
    multipliers: Array
    driven: Flags

    @classmethod
    def of(cls, equation: SlipEquation, q: Array, v: Array) -> _InState:
        """Return it."""
        closure, model = equation.closure, equation.closure.model
        state = closure.state(q, v)
        split, mass = closure.split(closure.rows(state)), mass_matrix(model, q)
        slips = slip_rows_at(model, equation.contacts, q)
        drift = slip_drifts(model, equation.contacts, q[None], v[None])[0]
        free = slips @ split.free
        accelerations = split.free @ solved_positive(split.free.T @ mass @ split.free, free.T)  # (nv, k)
        driven = np.vecdot(free, free) <= DRIVEN**2 * np.vecdot(slips, slips)
        multipliers = np.array([split.multipliers(each) for each in accelerations.T @ mass - slips])
        nle = pin.nonLinearEffects(model, equation.dynamics.data, q, v).copy()
        return cls(split, mass, nle, -closure.drift(state), slips, drift, accelerations, multipliers, driven)


@dataclass(frozen=True, eq=False)
class _Solved:
    """The equation of motion solved in one state, without friction and for each friction of size 1."""

    equation: SlipEquation
    t: float
    q: Array
    v: Array
    split: SplitRows
    slips: Array
    a: Array
    lam: Array
    accelerations: Array
    multipliers: Array
    alpha: Array
    driven: Flags
    terms: Array

    @classmethod
    def of(cls, equation: SlipEquation, t: float, q: Array, v: Array) -> _Solved:
        """Return it in a state."""
        here = equation.in_state(q, v)
        force, a = equation.motion(t, q, v)
        lam, terms = here.split.multipliers(here.mass @ a - force), np.abs(force) + np.abs(here.mass @ a)
        masses, alpha = np.diag(here.mass), here.slips @ a + here.drift
        rounding = STILL * np.abs(here.slips) @ np.where(masses > 0.0, terms / np.where(masses > 0.0, masses, 1.0), 0.0)
        alpha = np.where(here.driven & (np.abs(alpha) <= rounding), 0.0, alpha)
        return cls(equation, t, q, v, here.split, here.slips, a, lam, here.accelerations, here.multipliers, alpha,
                   here.driven, terms)  # fmt: skip

    @property
    def mobility(self) -> Array:
        """A, shape (k, k)."""
        return np.asarray(self.slips @ self.accelerations)

    def loads(self) -> CarriedLoads:
        """Return the wrenches that bearings carry."""
        sizes = self._sizes()
        f = _each_alone(sizes)
        a, lam = self.a + f @ self.accelerations.T, self.lam + f @ self.multipliers
        return self.equation.transmission.loads(self.t, self.q, self.v, a, lam, sizes)

    def _sizes(self) -> Array:
        """Return frictions as large as the other efforts [N*m or N], powers of 2: differences lose no digits; (k,).

        Efforts along a slip may cancel, or be rounding of weights across it. So its friction has at least the energy,
        ``f^2 / M`` in equal times, that the effort of any joint and the weight have.
        """
        along = np.abs(self.slips)
        sizes = along @ self.terms / np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
        masses, moved = np.diag(self.equation.in_state(self.q, self.v).mass), np.diag(self.mobility)
        some = masses > 0.0
        energy = max(self.equation.weight, float((self.terms[some] ** 2 / masses[some]).max(initial=0.0)))
        free = ~self.driven & (moved > 0.0)
        sizes[free] = np.maximum(sizes[free], np.sqrt(energy / moved[free]))
        return np.exp2(np.round(np.log2(np.where(sizes > 0.0, sizes, 1.0))))


def _each_alone(sizes: Array) -> Array:
    """Return no friction, then that of each joint alone, shape (k,) to (1 + k, k)."""
    f = np.zeros((1 + len(sizes), len(sizes)))
    f[1:] = np.diag(sizes)
    return f
