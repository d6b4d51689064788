"""Pinocchio's recursions at many states: efforts, accelerations, mass matrices and transmitted wrenches.

States of one model have the shape (n, ..). Of k variants of a model they have the shape (n, k, ..), or (n, 1, ..) where
all variants move alike: Pinocchio then takes one variant after the other, whose numbers are written into one model.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.dynamics import mass_matrix
from pinarm.mechanics.geometry.kinematics import WIDE, cached_by_model, new_data
from pinarm.mechanics.geometry.link_placements import summed_wrenches
from pinarm.mechanics.geometry.model_variants import Model, ModelVariants

if TYPE_CHECKING:
    from pinarm.mechanics.geometry.link_placements import LinkPlacements

MANY = 2**15
"""Numbers in v of all states from which on a call takes so long, 5 ms, that threads gain more than they wait."""


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_forked = False
"""Whether this process is a fork of one that had loaded Pinocchio: it lacks the threads that OpenMP still counts on."""


def _note_fork() -> None:
    global _forked
    _forked = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note_fork)


def threads() -> int:
    """Return how many threads a call may use: all cores, or what ``OMP_NUM_THREADS`` allows; one after a fork."""
    if _forked:
        return 1
    allowed = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    return min(cores(), max(1, int(allowed))) if allowed.isdecimal() else cores()


def rnea(model: Model, q: Array, v: Array, a: Array) -> Array:
    """Return efforts of motions without loads, shape (n, .., nv)."""
    if model.nv > WIDE:
        data = new_data(model)
        return np.array([pin.rnea(model, data, *state) for state in zip(q, v, a, strict=True)])
    if not isinstance(model, ModelVariants):
        number = threads() if v.size > MANY else 1
        return _rnea(number, _single(model) if number == 1 else _several(model), q, v, a)
    return _of_variants(model, lambda pool, *states: _rnea(1, pool, *states), q, v, a)


def _rnea(number: int, pool: pin.ModelPool, q: Array, v: Array, a: Array) -> Array:
    efforts: Array = pin.rneaInParallel(number, pool, q.T, v.T, a.T)
    return efforts.reshape(v.shape[::-1]).T


def aba(model: Model, q: Array, v: Array, tau: Array) -> Array:
    """Return accelerations under efforts, shape (n, .., nv).

    State by state: ``pin.abaInParallel`` computes in world axes, where a mechanism far from the origin loses digits.
    """
    if isinstance(model, ModelVariants):
        return _of_variants(model, _aba_of_pool, q, v, tau)
    return _aba(model, new_data(model) if model.nv > WIDE else _single(model).getData(0), q, v, tau)


def _aba_of_pool(pool: pin.ModelPool, q: Array, v: Array, tau: Array) -> Array:
    return _aba(pool.getModel(0), pool.getData(0), q, v, tau)


def _aba(model: pin.Model, data: pin.Data, q: Array, v: Array, tau: Array) -> Array:
    rows = [pin.aba(model, data, *state) for state in zip(q, v, tau, strict=True)]
    return np.array(rows).reshape(len(q), model.nv)


def mass_matrices(model: Model, q: Array) -> Array:
    """Return M at configurations, shape (n, .., nq), as an array of shape (n, .., nv, nv); armatures are in it."""
    if not isinstance(model, ModelVariants):
        return mass_matrix.mass_matrices(model, q)
    return _of_variants(model, lambda pool, rows: mass_matrix.mass_matrices(pool.getModel(0), rows), q)


def transmitted(links: LinkPlacements, q: Array, v: Array, a: Array, acting: Array) -> Array:
    """Return the wrench of the parent on the child at every joint's origin; see ``summed_wrenches``.

    Of variants, and of complex steps, which numpy moves, by the sums of what the links beyond a joint demand.
    """
    if isinstance(links.model, ModelVariants) or np.iscomplexobj(q):
        return summed_wrenches(links, q, v, a, acting)
    outside, model, data = links.inwards(acting), links.model, new_data(links.model)
    inner, loaded = np.empty_like(outside), np.flatnonzero(outside.any(axis=(0, 2))).tolist()
    forces = pin.StdVec_Force()
    forces.extend([pin.Force.Zero() for _ in range(model.njoints)])
    external, internal = [forces[joint] for joint in loaded], [data.f[joint] for joint in range(model.njoints)]
    for k, loads in enumerate(outside[:, loaded]):
        for force, load in zip(external, loads, strict=True):
            force.vector = load
        pin.rnea(model, data, q[k], v[k], a[k], forces)
        inner[k] = [wrench.vector for wrench in internal]
    inner[:, 0] = 0.0  # of the world, not of a joint
    return links.outwards(inner)


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
def _several(model: pin.Model) -> pin.ModelPool:
    return pin.ModelPool(model, cores())
