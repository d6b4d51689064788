"""Pinocchio's recursions for variants of a model: their trees stand side by side in one model, some at a time.

A call from Python costs more than what a small tree takes, so that one for many trees and all states saves most of it.
What Pinocchio computes is the same as for each variant alone, as no joint of one tree is before a joint of another.

Where masses and inertias vary only, and all variants move alike, efforts are ``Y(q, v, a) p``: Pinocchio computes Y
once, and every variant has its p. (Atkeson, An, Hollerbach, *Estimation of inertial parameters of manipulator loads
and links*, 1986.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.dynamics.mass_matrix import weightless
from pinarm.engine.dynamics.parallel import Parallel
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.link_tree import LinkTree, components_first, states_first
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.mechanics.geometry.model_variants import PARAMETERS, ModelVariants, VariantsDiffer

WIDTH = 48
"""Coordinates side by side: more take longer to build, since Pinocchio's buffers grow with their third power."""

KEPT, LARGEST = 8, 4_000_000
"""Motions of a tree of which regressors are kept, and bytes of one at most."""

FREE = 6
"""Velocities of a joint that leaves everything free."""


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Inverse dynamics of variants, without loads; of n states of each, shape (n, k or 1, nq).

    Attributes:
        variants: The variants.
    """

    variants: ModelVariants = field(repr=False)

    def rnea(self, q: Array, v: Array, a: Array) -> Array:
        """Return efforts, shape (n, k, nv); see ``Parallel.rnea``."""
        if self._moving_alike(q, v, a):
            first = self.variants.first
            own, others = self._shares(first, q, v, a)
            return self._weighed(own, others + first.armature * a)
        return self._called(_forest(self.variants.first), pin.rneaInParallel, q, v, a)

    def aba(self, q: Array, v: Array, tau: Array) -> Array:
        """Return accelerations, shape (n, k, nv); see ``Parallel.aba``."""
        if self.variants.bodies or self.variants.moved:
            return self._called(_forest(self.variants.first), pin.abaInParallel, q, v, tau)
        flat = (np.ascontiguousarray(x).reshape(-1, x.shape[-1]) for x in (q, v, tau))
        return Parallel(self.variants.first).aba(*flat).reshape(v.shape)

    def aba_one_by_one(self, q: Array, v: Array, tau: Array) -> Array:
        """Return the same by the recursion for single states, which loses no digits far from the origin."""
        forest, found = _forest(self.variants.first), list[Array]()
        model, data = forest.pool.getModel(0), forest.pool.getData(0)
        for some, states in self._filled(forest, q, v, tau):
            rows = np.array([pin.aba(model, data, *state) for state in zip(*states, strict=True)])
            found.append(rows.reshape(len(q), forest.count, -1)[:, : len(some)])
        return np.concatenate(found, axis=1)

    def transmitted(self, links: LinkPlacements, q: Array, v: Array, a: Array, acting: Array) -> Array:
        """Return wrenches of parents on children, shape (n, k, njoints, 6); see ``Parallel.transmitted``.

        What moves a joint that leaves everything free is its wrench: such joints stand in the place of those of the
        trees, and move as these do. Then what else acts on the links beyond is taken off.
        """
        tree = LinkTree.of(self.variants)
        if len(tree.balls.links):
            raise VariantsDiffer("joints with several coordinates")
        states = _free_states(tree, q, v, a)
        beyond = links.at_joints(tree.carried(acting))
        if self._moving_alike(q, v, a):
            own, others = self._shares(_free_tree(self.variants.first), *states)
            return self._weighed(*(links.outwards(_wrenches(part)) for part in (own, others))) - beyond
        found = self._called(_free_forest(self.variants.first), pin.rneaInParallel, *states)
        return links.outwards(_wrenches(found)) - beyond

    def _moving_alike(self, *states: Array) -> bool:
        """Whether only the bodies of variants differ."""
        return bool(self.variants.bodies) and not self.variants.moved and all(x.shape[1] == 1 for x in states)

    def _shares(self, tree: pin.Model, *states: Array) -> tuple[Array, Array]:
        """Return what each parameter of bodies that vary gives to efforts, shape (n, p, w), and all others, (n, 1, w).

        Args:
            tree: The tree of the first variant, which may have other joints.
            states: q, v and a, each of shape (n, 1, ..).
        """
        shares, own = _regressors(tree, *states), np.array(self.variants.bodies) - 1
        given = np.array([body.toDynamicParameters() for body in tree.inertias[1:]])
        given[own] = 0.0
        return shares[:, own].reshape(len(shares), -1, tree.nv), np.einsum("bp,nbpw->nw", given, shares)[:, None]

    def _weighed(self, own: Array, others: Array) -> Array:
        """Return what shares, shape (n, p, ..) and (n, 1, ..), give with the parameters of all variants, (n, k, ..)."""
        weights = np.ascontiguousarray(self.variants.parameters.reshape(len(self.variants), -1).T)
        shares = np.ascontiguousarray(np.moveaxis(own, (-1, 1), (0, 1)).swapaxes(2, -1))
        given = np.zeros((len(shares), *shares.shape[2:], len(self.variants)))
        for total, component in zip(given, shares, strict=True):  # each fits into the caches
            for share, weight in zip(component, weights, strict=True):
                if share.any():  # in the plane most of them are 0
                    total += share[..., None] * weight
        return np.asarray(np.moveaxis(given, (-2, -1, 0), (0, 1, -1)) + others)

    def mass_matrices(self, q: Array) -> Array:
        """Return M, shape (n, k, nv, nv); armatures are in it."""
        if self._moving_alike(q):
            return self._weighed_masses(q)
        nv, forest = self.variants.nv, _forest(self.variants.first)
        model, data = forest.pool.getModel(0), forest.pool.getData(0)
        upper, every = np.empty((len(q), len(self.variants), nv, nv)), np.arange(forest.count)
        wholes = np.empty((len(q), forest.count, nv, forest.count, nv))
        for some, (states,) in self._filled(forest, q):
            for whole, state in zip(wholes.reshape(len(q), model.nv, model.nv), states, strict=True):
                whole[:] = pin.crba(model, data, state)
            upper[:, some] = wholes[:, every, :, every].swapaxes(0, 1)[:, : len(some)]
        above = np.triu(np.ones((nv, nv)), 1)
        return np.asarray(upper * (np.eye(nv) + above) + (upper * above).swapaxes(-2, -1))

    def _weighed_masses(self, q: Array) -> Array:
        """Return M by its columns: the efforts of unit accelerations at rest, without weights."""
        first, still = self.variants.first, np.zeros((len(q), 1, self.variants.nv))
        units = (np.broadcast_to(unit, still.shape) for unit in np.eye(self.variants.nv))
        columns = [self._weighed(*self._shares(weightless(first), q, still, unit)) for unit in units]
        return np.stack(columns, axis=-1) + np.diag(first.armature)

    def masses(self, q: Array) -> Array:
        """Return M: as ``mass_matrices``, variants have few joints."""
        return self.mass_matrices(q)

    def _called(self, forest: Forest, call: Callable[..., Array], *arrays: Array) -> Array:
        """Return what Pinocchio computes of all rows of states, shape (n, k, w)."""
        n, found = len(arrays[0]), list[Array]()
        for some, states in self._filled(forest, *arrays):
            own = call(1, forest.pool, *(x.T for x in states)).reshape(-1, n).T
            found.append(own.reshape(n, forest.count, -1)[:, : len(some)])
        return np.concatenate(found, axis=1)

    def _filled(self, forest: Forest, *arrays: Array) -> Iterator[tuple[Indices, list[Array]]]:
        """Yield some variants, of which the forest has the numbers, and their rows of arrays, each of shape (n, ..)."""
        every, count = np.arange(len(self.variants)), forest.count
        spread = [np.broadcast_to(x, (len(x), len(every), x.shape[-1])) for x in arrays]
        for start in range(0, len(every), count):
            some = every[start : start + count]
            trees = slice(start, start + count)
            if len(some) < count:  # those left over repeat the last variant
                trees = np.minimum(start + np.arange(count), every[-1])
            for copy, k in enumerate(every[trees].tolist()):
                forest.fill(copy, self._numbers[k])
            yield some, [np.ascontiguousarray(x[:, trees]).reshape(len(x), -1) for x in spread]

    @cached_property
    def _numbers(self) -> list[Numbers]:
        """Inertias and placements of each variant, as Pinocchio has them."""
        made, placed, v = pin.Inertia.FromDynamicParameters, pin.SE3, self.variants
        return [
            ([*zip(v.bodies, map(made, own), strict=True)], [*zip(v.moved, map(placed, turns, shifts), strict=True)])
            for own, turns, shifts in zip(v.parameters, v.turns, v.shifts, strict=True)
        ]


Numbers = tuple[list[tuple[int, pin.Inertia]], list[tuple[int, pin.SE3]]]
"""Inertias and placements of some joints."""


@dataclass(frozen=True, eq=False)
class Forest:
    """Copies of a tree side by side.

    Attributes:
        count: How many there are.
        size: Number of joints of each.
        pool: Pinocchio's model of all of them, and its buffers.
    """

    count: int
    size: int
    pool: pin.ModelPool

    @classmethod
    def of(cls, tree: pin.Model, joints: Callable[[int], pin.JointModel], width: int) -> Forest:
        """Return as many copies of a tree as fit, with other joints, of which each copy has so many velocities."""
        count = max(1, WIDTH // width)
        model = _copied(tree, joints, count)
        if width == tree.nv:  # of free joints the armature is none of the links' wrenches
            model.armature[:] = np.tile(tree.armature, count)
        return cls(count, tree.njoints - 1, pin.ModelPool(model, 1))

    def fill(self, copy: int, numbers: Numbers) -> None:
        """Give the numbers of a variant to one of the trees."""
        model, first = self.pool.getModel(0), copy * self.size
        inertias, places = model.inertias, model.jointPlacements
        for joint, inertia in numbers[0]:
            inertias[first + joint] = inertia
        for joint, place in numbers[1]:
            places[first + joint] = place


def _copied(tree: pin.Model, joints: Callable[[int], pin.JointModel], count: int) -> pin.Model:
    """Return a model of copies of a tree with other joints."""
    model = pin.Model()
    for copy in range(count):
        first = model.njoints - 1
        for joint in range(1, tree.njoints):
            parent = tree.parents[joint]
            place, name = tree.jointPlacements[joint], f"{copy}/{tree.names[joint]}"
            model.addJoint(parent + first if parent else 0, joints(joint), place, name)
            model.inertias[first + joint] = tree.inertias[joint]
    model.gravity = tree.gravity
    return model


def _free_states(tree: LinkTree, q: Array, v: Array, a: Array) -> list[Array]:
    """Return the states of joints that leave everything free, moved as those of the tree: places, twists, their rates.

    Shapes (n, k, 7 joints) and twice (n, k, 6 joints): of each a shift and a quaternion, ``S v`` and ``S a``.
    """
    q, v, a = (x[..., tree.single.q] for x in (q, v, a))
    places = np.zeros((*q.shape, 7))
    places[..., 6] = 1.0
    twists, rates = np.zeros((2, *q.shape, FREE))
    for joint, screw in enumerate(tree.subspace.T):
        angle = 0.5 * q[..., joint]
        for component in np.flatnonzero(screw).tolist():
            along = q[..., joint] if component < 3 else np.sin(angle)
            places[..., joint, component] = along * screw[component]
            twists[..., joint, component] = v[..., joint] * screw[component]
            rates[..., joint, component] = a[..., joint] * screw[component]
        if screw[3:].any():
            places[..., joint, 6] = np.cos(angle)
    return [x.reshape(*x.shape[:2], -1) for x in (places, twists, rates)]


def _wrenches(found: Array) -> Array:
    """Return efforts along all free joints, shape (n, k, 6 (njoints - 1)), as wrenches of links, (n, k, njoints, 6)."""
    moved = components_first(found.reshape(*found.shape[:2], -1, 6))
    wrenches = np.zeros((6, 1 + moved.shape[1], *found.shape[:2]))
    wrenches[:, 1:] = moved
    return states_first(wrenches)


def _regressors(tree: pin.Model, *states: Array) -> Array:
    """Return what each parameter of each body gives to the efforts, shape (n, njoints - 1, p, nv).

    Those of the last motions are kept: every block of cases asks for the same.

    Args:
        tree: The tree.
        states: q, v and a, each of shape (n, 1, ..).
    """
    known, key = _known_regressors(tree), b"".join(x.tobytes() for x in states)
    if key in known:
        return known[key]
    data = tree.createData()
    rows = [pin.computeJointTorqueRegressor(tree, data, *state).T
            for state in zip(*(x[:, 0] for x in states), strict=True)]  # fmt: skip
    found = np.reshape(rows, (len(rows), tree.njoints - 1, PARAMETERS, tree.nv))
    if found.nbytes <= LARGEST:
        known[key] = found
        if len(known) > KEPT:
            del known[next(iter(known))]
    return found


@cached_by_model
def _known_regressors(tree: pin.Model) -> dict[bytes, Array]:
    """Return the regressors that are kept of a tree, by the bytes of its states."""
    return {}


@cached_by_model
def _forest(tree: pin.Model) -> Forest:
    return Forest.of(tree, lambda joint: tree.joints[joint], tree.nv)


@cached_by_model
def _free_forest(tree: pin.Model) -> Forest:
    """Return the copies with joints that leave everything free."""
    return Forest.of(tree, lambda joint: pin.JointModelFreeFlyer(), FREE * (tree.njoints - 1))


@cached_by_model
def _free_tree(tree: pin.Model) -> pin.Model:
    """Return the tree with such joints."""
    return _copied(tree, lambda joint: pin.JointModelFreeFlyer(), 1)
