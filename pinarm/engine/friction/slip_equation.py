"""Friction of joints in one state: how it loads its own bearings, and joints that slip in given directions.

With the rows J of the slips, the friction f adds ``J^T f`` to the loads; the slips' accelerations are
``alpha = J a + J' v = alpha0 + A f``, and multipliers are linear in f, too. So are the wrenches of bearings, ``w(f)``,
but for kinks of multipliers: see ``CarriedLoads``. With T a basis of the motions that the constraints and laws allow,
``A = J T (T^T M T)^-1 T^T J^T``.

With directions s of the slips, coefficients mu and constants c of the laws, friction is a root of

    f_i + s_i (mu_i N_i(w(f)) + c_i) = 0        (1)

N is a sum of lengths, so ``N(w + x) - N(w) <= most(x)``: where the matrix C of ``mu_i`` times the most by which
friction j can change N_i has a spectral radius below 1, the map ``f -> -s (mu N + c)`` contracts in a suitable norm and
(1) has exactly one root. Elsewhere (1) may have none, as of a drawer that jams, or several; of one joint, N being
convex between kinks, it has none where it is nowhere below the friction. Where normal forces are along lines, as in a
plane, N is a sum of absolute values and (1) is linear for each choice of their signs and of sides of the kinks.
Source: Banach's theorem; the paradox is Painleve's (Lecons sur le frottement, 1895).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import Decomposition, solved_positive
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import mass_matrix, solve
from pinarm.engine.kinematics.prescribed import Targets
from pinarm.errors import DynamicsError
from pinarm.mechanics.couplings.coupling import JointRelation, left_open
from pinarm.mechanics.friction.contact import slip_drifts, slip_rows
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.mechanics.friction.contact import Bearing, FrictionContact

CONTRACTING = 1.0 - 1e-9
"""Spectral radius of C from which on (1) is not known to have one root."""

SIGNS = 10
"""Number of normal forces and kinks up to which all their signs are tried."""

CONSISTENT, SAME = 1e-12, 1e-9
"""Part of its terms by which a normal force or a kink may miss its sign, and by which two roots of (1) are one."""

CANCELLED = 1e-13
"""Part of its terms below which a load under known friction is 0: friction may have one root at no load, and none or
two beside it."""

SOLVED, ITERATIONS = 4e-16, 200
"""Residual of (1), relative to its terms, at which Newton's method ends, and its steps at most."""

ROUNDED = 1e-12
"""Part of the terms of an effort by which rounding may let a reserve be negative."""


def jammed(contacts: Sequence[FrictionContact], rubbing: Array, where: str, **data: Any) -> DynamicsError:
    """Return the error of friction without a root, in the joints of a mask, shape (k,), at a place in words."""
    names = ", ".join(dict.fromkeys(contact.name for contact, rubs in zip(contacts, rubbing, strict=True) if rubs))
    return DynamicsError(
        f"{where}friction of {names} raises the load that it depends on without end: it jams, and no effort moves it",
        expected="a smaller mu, a longer span of the guide, or a drive along another coordinate",
        **data,
    )


class CarriedLoads(Record, frozen=True):
    """Wrenches of k bearings as functions of m frictions, linear but for p kinks.

    Teeth press their wheels apart whichever flanks touch, and a strand of a belt that would be pushed is slack. With
    the distances ``g = g0 + G f`` of multipliers from their kinks,

        w_i(f) = w0_i + sum_j W_ij f_j + sum_p |g_p(f)| K_ip

    Attributes:
        wrench: w0 [N, N*m], shape (k, 6).
        response: W, wrench i per friction j, shape (k, m, 6).
        distance: g0 [N*m or N], shape (p,).
        rate: G, shape (p, m).
        fold: K, wrench i per size of distance p, shape (k, p, 6).
    """

    wrench: Array
    response: Array
    distance: Array
    rate: Array
    fold: Array

    @classmethod
    def linear(cls, wrench: Array, response: Array) -> CarriedLoads:
        """Return loads without kinks."""
        k, m, _ = response.shape
        return cls(wrench, response, np.zeros(0), np.zeros((0, m)), np.zeros((k, 0, 6)))

    def at(self, f: Array) -> Array:
        wrench = self.wrench + np.vecmat(f, self.response)
        return np.asarray(wrench + np.vecmat(np.abs(self.distances(f)), self.fold))

    def distances(self, f: Array) -> Array:
        """Return g under friction f, shape (p,)."""
        return np.asarray(self.distance + self.rate @ f)

    def slope(self, f: Array) -> Array:
        """Return the wrench i per friction j about friction f, shape (k, m, 6)."""
        return np.asarray(self.response + (np.sign(self.distances(f))[:, None] * self.rate).T @ self.fold)

    def far(self, f: Array) -> Array:
        """Return the wrenches per x, under friction ``x f``, for large x, shape (k, 6)."""
        return np.asarray(np.vecmat(f, self.response) + np.vecmat(np.abs(self.rate @ f), self.fold))

    def crossings(self, f: Array, way: Array) -> Array:
        """Return the x at which multipliers pass kinks under friction ``f + x way``, shape (.,)."""
        rates = self.rate @ way
        return np.asarray(-self.distances(f)[rates != 0.0] / rates[rates != 0.0])

    def most(self, i: int, bearing: Bearing) -> Array:
        """Return a bound of the change of the load N of bearing i by each friction of size 1, shape (m,).

        Between any two f that differ by x in friction j the mean slope of ``|g_p|`` is ``s_p G_pj`` with s_p from -1 to
        1, and w changes by ``x (W_ij + sum_p s_p G_pj K_ip)``.
        """
        folds = self.rate[..., None] * self.fold[i][:, None]
        return np.asarray(bearing.most(self.response[i]) + bearing.most(folds).sum(axis=0))

    def reduced(self, fixed: Array, ways: Array) -> CarriedLoads:
        """Return the wrenches as functions of x for ``f = fixed + ways x``, shapes (m,) and (m, n)."""
        wrench, distance = self.wrench + np.vecmat(fixed, self.response), self.distances(fixed)
        terms = (np.abs(self.wrench) + np.vecmat(np.abs(fixed), np.abs(self.response))).reshape(-1, 2, 3)
        size = np.repeat(terms.max(axis=-1), 3, axis=-1)
        wrench = np.where(np.abs(wrench) <= CANCELLED * size, 0.0, wrench)
        beside = np.abs(self.distance) + np.abs(self.rate) @ np.abs(fixed)
        distance = np.where(np.abs(distance) <= CANCELLED * beside, 0.0, distance)
        return CarriedLoads(wrench, ways.T @ self.response, distance, self.rate @ ways, self.fold)


class Slipping(Record, frozen=True):
    """Joints that slip, and the equation (1) of their friction.

    Attributes:
        direction: s: 1, -1, components of a unit vector where the slip has several, or 0 without friction here, (k,).
        mu: Shape (k,).
        constant: c [N*m or N], shape (k,).
    """

    contacts: Sequence[FrictionContact]
    direction: Array
    mu: Array
    constant: Array
    loads: CarriedLoads

    @classmethod
    def of(
        cls,
        contacts: Sequence[FrictionContact],
        direction: Array,
        resting: Flags,
        speeds: Array,
        loads: CarriedLoads,
    ) -> Slipping:
        """Return joints that slip at speeds, shape (k,); ``resting`` ones, which only begin to, by the law of rest."""
        each = zip(contacts, resting, speeds, strict=True)
        laws = [contact.law.resting if rest else contact.law.slipping(speed) for contact, rest, speed in each]
        mu, constant = np.array(laws).reshape(-1, 2).T * (direction != 0.0)
        return cls(contacts, direction, mu, constant, loads)

    @cached_property
    def _rubbing(self) -> list[int]:
        """Joints that slip and whose friction depends on their load."""
        some: list[int] = (self.mu * self.direction).nonzero()[0].tolist()
        return some

    @cached_property
    def _most(self) -> Array:
        """C, its rows times |s|, shape (k, k): 0 of joints whose friction does not depend on their load."""
        most, some = np.zeros((len(self.mu), len(self.mu))), self._rubbing
        for i in some:
            bound = self.loads.most(i, self.contacts[i].bearing)
            most[i, some] = self.mu[i] * abs(self.direction[i]) * bound[some]
        return most

    def contraction(self) -> float:
        """Return the spectral radius of C: below 1 there is exactly one root."""
        return float(np.abs(np.linalg.eigvals(self._most)).max(initial=0.0))

    @cached_property
    def contracts(self) -> bool:
        """Whether C tells that there is exactly one root."""
        bound = float(self._most.sum(axis=1).max(initial=0.0))  # of the spectral radius, and much cheaper
        return bound < CONTRACTING or self.contraction() < CONTRACTING

    @cached_property
    def roots(self) -> list[Array] | None:
        """All roots f, shape (k,), where normal forces are along lines; ``None`` where they are not known.

        With signs of the distances g and of the normal forces (1) is linear: ``f + s (mu sign (n + R f) + c) = 0``.
        """
        loads, constant, k = self.loads, self.constant.copy(), len(self.mu)
        kinks, normals, owners = len(loads.distance), [np.zeros((0, 1 + k + len(loads.distance)))], list[int]()
        for i in self._rubbing:
            bearing = self.contacts[i].bearing
            along = bearing.along_lines(np.vstack([loads.wrench[i], loads.response[i], loads.fold[i]]))
            if along is None:
                return None
            normals.append(along)
            owners += [i] * len(along)
            constant[i] += self.mu[i] * bearing.preload
        terms, roots = np.vstack(normals), list[Array]()
        resisting = (self.direction * self.mu)[:, None] * np.equal.outer(np.arange(k), np.array(owners))
        if kinks + len(terms) > SIGNS:
            return None
        for signs in map(np.array, product([1.0, -1.0], repeat=kinks + len(terms))):
            folds = terms[:, 1 + k :] * signs[:kinks]
            first = np.append(loads.distance, terms[:, 0] + folds @ loads.distance)
            rate = np.vstack([loads.rate, terms[:, 1 : 1 + k] + folds @ loads.rate])
            signed = resisting * signs[kinks:]
            matrix = np.eye(k) + signed @ rate[kinks:]
            if np.linalg.cond(matrix) > 1.0 / SAME:  # it may have infinitely many
                return None
            f = np.linalg.solve(matrix, -signed @ first[kinks:] - self.direction * constant)
            slack = CONSISTENT * (np.abs(first) + np.abs(rate) @ np.abs(f))
            known = any(np.abs(f - root).max() <= SAME * np.abs(root).max() for root in roots)
            if (signs * (first + rate @ f) >= -slack).all() and not known:
                roots.append(f)
        return roots

    def require_one_root(self, *, any_load: bool = True) -> bool:
        """Return whether (1) has a root: one that changes little with the loads, or one for these loads alone."""
        if self.contracts:
            return True
        if not any_load and self.roots is not None and len(self.roots) < 2:
            return bool(self.roots)
        coupled = np.flatnonzero(self._most.any(axis=1)).tolist()
        if len(coupled) == 1:
            ray = np.abs(self.direction) * (np.arange(len(self.mu)) == coupled[0])
            others = -self.direction * self.resistance(np.zeros(len(ray))) * (ray == 0.0)
            if self._least_reserves(ray, others)[coupled[0]] > 0.0:
                return False
        names = " and ".join(dict.fromkeys(self.contacts[i].name for i in coupled))
        raise DynamicsError(
            f"the friction of {names} and the reactions that it depends on do not determine each other: "
            f"friction raises its own load {self.contraction():.3g} times; more than one motion is possible, or none",
            expected="friction that raises its load less than once",
            hint="a smaller mu, a longer span of a guide; of a worm or screw that locks itself: a drive, or friction, "
            "at the joint of the worm or the screw, above all where loads act there",
        )

    def resistance(self, f: Array) -> Array:
        """Return ``mu N(w(f)) + c`` [N*m or N], shape (k,)."""
        wrench, resistance = self.loads.at(f), self.constant.copy()
        for i in self.mu.nonzero()[0].tolist():
            resistance[i] += self.mu[i] * self.contacts[i].bearing.load(wrench[i])
        return resistance

    def friction(self) -> Array:
        """Return the root f, shape (k,), of an equation that has one.

        Newton's method, and the contraction itself where it goes astray at a normal force that vanishes.
        """
        if not self.contracts and self.roots:
            return self.roots[0]
        f = -self.direction * self.resistance(np.zeros(len(self.mu)))
        left = self._left(f)
        for _ in range(ITERATIONS):
            if np.abs(left).max(initial=0.0) <= SOLVED * np.abs(f).max(initial=0.0):
                break
            better = f - np.linalg.solve(self._slope(f), left)
            if not np.abs(self._left(better)).max() < 0.5 * np.abs(left).max():
                better = f - left
            if np.array_equal(better, f):
                break
            f, left = better, self._left(better)
        return f

    def _left(self, f: Array) -> Array:
        return np.asarray(f + self.direction * self.resistance(f))

    def _slope(self, f: Array) -> Array:
        """Return the derivative of (1), shape (k, k)."""
        wrench, response, slope = self.loads.at(f), self.loads.slope(f), np.eye(len(f))
        for i in self._rubbing:
            slope[i] += self.direction[i] * self.mu[i] * response[i] @ self.contacts[i].bearing.slope(wrench[i])
        return slope

    def locks(self, slips: Array, effort: float) -> bool:
        """Return whether joints at rest, with their friction at rest, hold any effort that would make them slip.

        The effort T of a drive and the friction are in balance for ``T = T0 - J f``, with the slips J per unit of the
        drive's coordinate. Where no reserve along a ray of frictions is negative, friction holds every effort from T0
        on, as a worm does that is driven at its wheel. Joints whose friction is constant have it throughout: with the
        others at 0 they hold any part of it before.

        Args:
            slips: J, shape (k,).
            effort: Size of the terms of the effort, which rounding is judged by [N*m or N].
        """
        if self.contracts:
            return False
        constant = -self.direction * self.constant * (self.mu == 0.0)
        return any(
            (self._least_reserves(ray, constant) * np.abs(slips) >= -ROUNDED * effort).all()
            for ray in self._rays(np.abs(self.direction) * (slips != 0.0))
        )

    def _rays(self, size: Array) -> Iterator[Array]:
        """Yield r, shape (k,): of each joint alone, and the one in which all raise their loads most, by C."""
        names = {self.contacts[i].name for i in self._rubbing if size[i]}
        for name in sorted(names):
            yield size * (self.mu > 0.0) * np.array([contact.name == name for contact in self.contacts])
        if len(names) > 1:
            values, vectors = np.linalg.eig(np.where(np.outer(size, size) > 0.0, self._most, 0.0))
            yield np.abs(vectors[:, np.abs(values).argmax()])

    def _least_reserves(self, ray: Array, others: Array) -> Array:
        """Return the least reserve of each joint along a ray r, shape (k,); 0 of joints out of it.

        For frictions ``f_i = -sign(s_i) r_i x`` the reserve ``|s_i| (mu_i N_i(w(f)) + c_i) - r_i x`` is convex in x >=
        0 between kinks of the loads; it has no least where N grows more slowly than x. Joints out of the ray have the
        friction ``others``.
        """
        friction, size, least = -np.sign(self.direction) * ray, np.abs(self.direction), np.zeros(len(ray))
        added, kinks = self.loads.far(friction), self.loads.crossings(others, friction)
        for i in np.flatnonzero(ray).tolist():

            def reserve(x: float, i: int = i) -> float:
                return float(size[i] * self.resistance(others + x * friction)[i] - ray[i] * x)

            grows = size[i] * self.mu[i] * self.contacts[i].bearing.most(added[i]) * CONTRACTING > ray[i]
            least[i] = _least_of(reserve, kinks) if grows else -np.inf
        return least


def _least_of(h: Callable[[float], float], kinks: Array) -> float:
    """Return the least value of a function of ``x >= 0`` that is convex between kinks and grows at last."""
    ends = [0.0, *sorted(kinks[kinks > 0.0].tolist())]
    last, step = ends[-1], abs(h(ends[-1])) + 1.0
    while h(last + 2.0 * step) < h(last + step):
        step *= 2.0
    return min(_least_between(h, low, high) for low, high in pairwise([*ends, last + 2.0 * step]))


def _least_between(h: Callable[[float], float], low: float, high: float) -> float:
    """Return the least value of a convex function between two places, by bisection in three parts."""
    for _ in range(ITERATIONS):
        third = (high - low) / 3.0
        low, high = (low, high - third) if h(low + third) < h(high - third) else (low + third, high)
    return h(low)


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


class SlipEquation(Record, frozen=True):
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


class BearingReactions(Record, frozen=True):
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
