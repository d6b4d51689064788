"""The dynamics of a tree: ``M(q) a + nle(q, v) = tau + loads``, its terms and the recursive routes to tau and to a.

``tau`` are the efforts of the drives, ``loads`` those of springs, dampers and applied forces. Constraints add
``G^T lam`` to the right-hand side: see ``engine.dynamics.equation``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, as_rows, same_rows
from pinarm.engine.dynamics import equation
from pinarm.mechanics.forces.force_element import ForceElement, HeldLoad
from pinarm.mechanics.geometry.kinematics import WIDE, cached_by_model, new_data, require_depth_first
from pinarm.mechanics.geometry.link_placements import speeding
from pinarm.mechanics.geometry.model_variants import Model, ModelVariants
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.integration.integrator import Acceleration, Manifold
    from pinarm.mechanics.forces.load_laws import LoadLaw


def rnea(model: Model, q: Array, v: Array, a: Array) -> Array:
    """Return efforts of motions without loads, shape (n, .., nv)."""
    if isinstance(model, ModelVariants):
        return _of_variants(model, _rnea, q, v, a)
    if len(q) == 1 or model.nv > WIDE:
        data = _buffers(model)
        return np.array([pin.rnea(model, data, *state) for state in zip(q, v, a, strict=True)])
    return _rnea(_single(model) if v.size < SHARED or _threads() == 1 else _several(model), q, v, a)


def _rnea(pool: pin.ModelPool, q: Array, v: Array, a: Array) -> Array:
    efforts: Array = pin.rneaInParallel(pool.size(), pool, q.T, v.T, a.T)
    return efforts.reshape(v.shape[::-1]).T


SHARED = 2**15
"""Numbers in v of all states from which on a call takes so long, 5 ms, that threads gain more than they wait."""

_forks = [False]
"""Whether this process is a fork of another: it lacks the threads that OpenMP still counts on."""

if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: _forks.__setitem__(0, True))


def _threads() -> int:
    """Return the number of threads of a call: of all cores, or as ``OMP_NUM_THREADS`` says, and one after a fork."""
    allowed = os.environ.get("OMP_NUM_THREADS", "")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return 1 if _forks[0] else min(cores, max(1, int(allowed))) if allowed.isdecimal() else cores


@cached_by_model
def _several(model: pin.Model) -> pin.ModelPool:
    return pin.ModelPool(model, _threads())


def aba(model: Model, q: Array, v: Array, tau: Array) -> Array:
    """Return accelerations under efforts, shape (n, .., nv).

    State by state: ``pin.abaInParallel`` computes in world axes, where a mechanism far from the origin loses digits.
    """
    if isinstance(model, ModelVariants):
        return _of_variants(model, lambda pool, *states: _aba(pool.getModel(0), pool.getData(0), *states), q, v, tau)
    return _aba(model, _buffers(model), q, v, tau)


def _aba(model: pin.Model, data: pin.Data, q: Array, v: Array, tau: Array) -> Array:
    rows = [pin.aba(model, data, *state) for state in zip(q, v, tau, strict=True)]
    return np.array(rows).reshape(len(q), model.nv)


def mass_matrices(model: Model, q: Array) -> Array:
    """Return M at configurations, shape (n, .., nq), as an array of shape (n, .., nv, nv); armatures are in it."""
    if not isinstance(model, ModelVariants):
        return equation.mass_matrices(model, q)
    return _of_variants(model, lambda pool, rows: equation.mass_matrices(pool.getModel(0), rows), q)


def _of_variants(variants: ModelVariants, call: Callable[..., Array], *arrays: Array) -> Array:
    """Return the values of a call with the model of each variant and its states, shape (n, k, ..)."""
    spread = [np.broadcast_to(x, (len(x), len(variants), x.shape[-1])).swapaxes(0, 1) for x in arrays]
    values = [call(pool, *states) for pool, *states in zip(_each(variants), *spread, strict=True)]
    return np.stack(values, axis=1)


def _each(variants: ModelVariants) -> Iterator[pin.ModelPool]:
    """Yield Pinocchio's model with the numbers of one variant after the other, and its buffers."""
    pool = _of_variant(variants.first)
    inertias, placements = pool.getModel(0).inertias, pool.getModel(0).jointPlacements
    for parameters, turns, shifts in zip(variants.parameters, variants.turns, variants.shifts, strict=True):
        for joint, body in zip(variants.bodies, parameters, strict=True):
            inertias[joint] = pin.Inertia.FromDynamicParameters(body)
        for joint, turn, shift in zip(variants.moved, turns, shifts, strict=True):
            placements[joint] = pin.SE3(turn, shift)
        yield pool


@cached_by_model
def _of_variant(model: pin.Model) -> pin.ModelPool:
    return pin.ModelPool(model, 1)


@cached_by_model
def _single(model: pin.Model) -> pin.ModelPool:
    return pin.ModelPool(model, 1)


@cached_by_model
def _buffers(model: pin.Model) -> pin.Data:
    return new_data(model)


NO_FORCES: Mapping[str, ForceElement] = MappingProxyType({})

KEPT = 16
"""Number of intervals of time whose loads are kept, since each is asked for several times in a run."""


class Dynamics(Record, frozen=True):
    """The terms of the equation of motion of one tree, and the buffers of the integrators' kernels.

    Attributes:
        model: Pinocchio's model; gravity and the rotors' armature are in it. Or variants of one: states are then of
            shape (n, k, ..), see ``link_tree``.
        data: Pinocchio's buffers; every call fills them and reads them, and leaves nothing in them for another.
    """

    model: Model
    forces: Mapping[str, ForceElement]
    data: pin.Data

    @classmethod
    def of(cls, model: pin.Model, forces: Mapping[str, ForceElement] = NO_FORCES) -> Dynamics:
        """Return the dynamics of a model under the given forces."""
        require_depth_first(model)
        return cls(model, dict(forces), new_data(model))

    @classmethod
    def of_variants(cls, variants: ModelVariants, forces: Mapping[str, ForceElement] = NO_FORCES) -> Dynamics:
        """Return the dynamics of variants of a model, of which Pinocchio has no buffers, under the given forces."""
        return cls(variants, dict(forces), None)

    @cached_property
    def manifold(self) -> Manifold:
        return configuration_space(self.model)

    def mass_matrices(self, q: Array) -> Array:
        """Return M at configurations, shape (n, .., nq), as an array of shape (n, .., nv, nv)."""
        return mass_matrices(self.model, q)

    def loads(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the generalised loads of the force elements [N*m or N], shape (..., nv)."""
        tau = np.empty((*q.shape[:-1], self.model.nv))
        of_variants = isinstance(self.model, ModelVariants)  # each of which has steady loads of its own
        tau[:] = 0.0 if of_variants else self.steady
        for force in self._acting if of_variants else self.changing:
            force.add_load(t, q, v, tau)
        return tau

    def load_sizes(self, t: Array | float, q: Array, v: Array) -> Array:
        """Return the sum of the sizes of the loads of all force elements [N*m or N], shape (..., nv)."""
        sizes = np.zeros((*q.shape[:-1], self.model.nv))
        for force in self.forces.values():
            load = np.zeros_like(sizes)
            force.add_load(t, q, v, load)
            sizes += np.abs(load)
        return sizes

    @cached_property
    def _acting(self) -> tuple[ForceElement, ...]:
        return tuple(self.forces.values())

    def on(self, start: float, end: float) -> Dynamics:
        """Return the dynamics as it is on an interval of time in which no load jumps; buffers are shared."""
        return self._on(start, end) if any(force.jumps for force in self.forces.values()) else self

    @cached_property
    def _leaping(self) -> dict[str, LoadLaw]:
        """Laws of the loads that may jump with the state."""
        return {name: law for name, force in self.forces.items() if (law := force.law) is not None and law.leaps}

    def _following(self, laws: Mapping[str, LoadLaw]) -> Dynamics:
        return replace(self, forces={k: replace(x, law=laws[k]) if k in laws else x for k, x in self.forces.items()})

    def entered(self, q: Array, v: Array) -> Dynamics:
        """Return the dynamics from a state to the next jump of a load; see ``LoadLaw.entered``."""
        laws = {name: law.entered(q, v) for name, law in self._leaping.items()}
        return self._following(laws) if laws else self

    def recording(self) -> Dynamics:
        """Return the dynamics of a motion that begins, whose loads are noted as they jump."""
        laws = {name: replace(law, history=[]) for name, law in self._leaping.items()}
        return self._following(laws) if laws else self

    def note(self, t: float, entered: Dynamics) -> None:
        """Note what loads that jump are from an instant on [s]."""
        for name, law in self._leaping.items():
            law.history.append((t, entered._leaping[name]))

    def at_rows(
        self, grid: Grid, q: Array, v: Array, middle: Callable[[float, float], tuple[Array, Array]] | None = None
    ) -> Dynamics:
        """Return the dynamics with loads that jump as they were between the cuts of a grid, told by its n states.

        Of intervals without inner rows ``middle`` returns the state (q, v) from their ends.
        """
        recorded = self.recording()
        for start, end, rows in grid.intervals() if self._leaping else []:
            inner = (rows.start + rows.stop) // 2
            if rows.stop - rows.start > 2:
                recorded.note(start, self.entered(q[inner], v[inner]))
            elif middle and start != end:
                recorded.note(start, self.entered(*middle(start, end)))
            elif rows.start < rows.stop:
                recorded.note(start, self.entered(q[rows].mean(axis=0), v[rows].mean(axis=0)))
        return recorded

    @property
    def leaps(self) -> bool:
        """Whether loads may jump with the state of the mechanism."""
        return bool(self._leaping)

    @property
    def leaps_with_joints(self) -> bool:
        """Whether loads may jump with the state of the mechanism, and do so with single joints only."""
        return bool(self._leaping) and all(law.of_joints for law in self._leaping.values())

    @cached_property
    def _on(self) -> Callable[[float, float], Dynamics]:
        return lru_cache(maxsize=KEPT)(self._bound)

    def _bound(self, start: float, end: float) -> Dynamics:
        here = {name: force.on(start, end) for name, force in self.forces.items()}
        return Dynamics(self.model, here, self.data)

    def inverse(self, t: Array | float, q: Array, v: Array, a: Array) -> Array:
        """Return the efforts that the drives must give for a motion: ``rnea(q, v, a) - loads``.

        Returns:
            Efforts [N*m or N], shape (n, .., nv).
        """
        nq, nv = self.model.nq, self.model.nv
        q, v, a = as_rows(q, nq, "q"), as_rows(v, nv, "v"), as_rows(a, nv, "a")
        same_rows(q, v, a)
        if not len(q):
            return np.zeros((0, nv))
        tau = rnea(self.model, q, v, a)
        return tau - self.loads(t, q, v) if self.forces else tau

    def forward(self, t: Array | float, q: Array, v: Array, tau: Array | None = None) -> Array:
        """Return the accelerations under given efforts: ``aba(q, v, tau + loads)``.

        Returns:
            Accelerations, shape (n, nv).
        """
        q, v = as_rows(q, self.model.nq, "q"), as_rows(v, self.model.nv, "v")
        same_rows(q, v)
        total = self.loads(t, q, v) if len(q) else np.zeros_like(v)
        if tau is not None:
            efforts = as_rows(tau, self.model.nv, "tau")
            same_rows(q, efforts)
            total += efforts
        return aba(self.model, q, v, total)

    def acceleration(self) -> Acceleration:
        """Return the free motion's ``(t, q, v) -> a`` for one state at a time, with as few calls as there can be."""
        model, data, aba, load = self.model, self.data, pin.aba, self.load()

        def free(t: float, q: Array, v: Array) -> Array:
            return aba(model, data, q, v, load(t, q, v))  # type: ignore[no-any-return]

        return free

    def load(self) -> Acceleration:
        """Return ``(t, q, v) -> tau``, the load in one state, to be read only; steady loads are summed once."""
        steady, changing, tau = self.steady, self.changing, np.zeros(self.model.nv)
        if not changing:
            return lambda t, q, v: steady

        def loaded(t: float, q: Array, v: Array) -> Array:
            tau[:] = steady
            for force in changing:
                force.add_load(t, q, v, tau)
            return tau

        return loaded

    @cached_property
    def steady(self) -> Array:
        """The sum of the loads that are the same in all states and at all times [N*m or N], shape (nv,)."""
        tau, q, still = np.zeros(self.model.nv), pin.neutral(self.model), np.zeros(self.model.nv)
        for force in self.forces.values():
            if force.steady:
                force.add_load(0.0, q, still, tau)
        return tau

    @cached_property
    def held(self) -> tuple[HeldLoad, ...]:
        return tuple(held for force in self.forces.values() if (held := force.held) is not None)

    @cached_property
    def changing(self) -> tuple[ForceElement, ...]:
        """The other force elements."""
        return tuple(force for force in self._acting if not force.steady)

    def energy(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return kinetic and potential energy [J], each of shape (n, ..); rotors and springs included."""
        links, twists = speeding(self.model, q, v)
        kinetic, potential = (energies.sum(axis=-1) for energies in links.energies(twists))
        kinetic = kinetic + 0.5 * v**2 @ self.model.armature
        for force in (force for force in self.forces.values() if not force.steady):  # whose work counts as dissipated
            potential = potential + force.potential_energy(q)
        return kinetic, potential

    @cached_property
    def exchanging(self) -> Dynamics | None:
        """Dynamics with only the force elements that exchange energy and are not steady or held; or ``None``.

        On mechanisms with quaternions or (cos, sin) pairs steady and held elements are included: the work does not
        follow from a difference of configurations.
        """
        simple = self.model.nq == self.model.nv
        forces = {
            name: force
            for name, force in self.forces.items()
            if not (force.conservative or ((force.steady or force.held is not None) and simple))
        }
        return replace(self, forces=forces) if forces else None

    def dissipated_power(self, t: Array, q: Array, v: Array) -> Array:
        """Return the power that leaves through force elements [W], shape (n,); negative where they drive."""
        return np.asarray(sum((force.dissipated_power(t, q, v) for force in self._acting), np.zeros(len(q))))


def parts(dynamics: Dynamics, grid: Grid) -> list[tuple[slice, Dynamics]]:
    """Return the rows of every interval of a grid, each with the dynamics that holds there."""
    return [(rows, dynamics.on(start, end)) for start, end, rows in grid.intervals()]


def configuration_space(model: pin.Model) -> Manifold:
    """Return the space of configurations of a model, with quaternions or (cos, sin) pairs in them where it has such."""
    from pinarm.engine.integration.integrator import Manifold

    if model.nq == model.nv:
        return Manifold(model.nq, model.nv)

    def velocity(q: Array, v: Array) -> Array:
        if q.ndim == 1:
            return pin.tangentMap(model, q).dot(v)  # type: ignore[no-any-return]  # half the time of @
        return np.array([velocity(row, rate) for row, rate in zip(q, v, strict=True)]).reshape(q.shape)

    def project(q: Array) -> Array:
        if q.ndim == 1:
            return pin.normalize(model, q)  # type: ignore[no-any-return]
        return np.array([pin.normalize(model, row) for row in q]).reshape(q.shape)

    return Manifold(model.nq, model.nv, velocity, project)
