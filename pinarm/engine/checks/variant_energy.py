"""The energy balance of motions of variants, of all of them at once: see ``balance.energy_balance``."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.checks.balance import STEPS, gauss_nodes, part_weights, unaccounted
from pinarm.engine.checks.figures import sampled
from pinarm.engine.dynamics.dynamics import Dynamics

if TYPE_CHECKING:
    from pinarm.engine.integration.ensemble import Ensemble


class VariantParts(NamedTuple):
    """Parts of the steps of k motions, in order; those of motions that have fewer end in parts of no length.

    Attributes:
        step: The step of each, shape (n, k).
        start: Its start [s], shape (n, k).
        h: Its length [s], shape (n, k).
    """

    step: Indices
    start: Array
    h: Array

    @classmethod
    def of(cls, ensemble: Ensemble, divided: Flags) -> VariantParts:
        """Return the steps of motions, some of which are divided, shape (steps,)."""
        steps, counts = ensemble.solution.steps, np.where(divided, ensemble.solution.method.subdivisions, 1)
        step = np.repeat(np.arange(len(counts)), counts)
        number = np.arange(len(step))
        part = number - np.repeat(np.cumsum(counts) - counts, counts)
        h = ((steps.until - steps.t) / counts)[step]
        motion = ensemble.motion[step]
        own = np.bincount(motion, minlength=len(ensemble.counts))
        place = number - np.repeat(np.cumsum(own) - own, own)
        last = np.maximum(ensemble.firsts + ensemble.counts - 1, 0)
        shape = int(own.max(initial=1)), len(own)
        found = cls(np.tile(last, (shape[0], 1)), np.tile(steps.until[last], (shape[0], 1)), np.zeros(shape))
        for values, given in zip(found, (step, steps.t[step] + part * h, h), strict=True):
            values[place, motion] = given
        return found


def variant_energies(dynamics: Dynamics, ensemble: Ensemble, interpolated: Flags) -> Array:
    """Return the energy that nothing accounts for of motions of variants, relative to what is exchanged, shape (k,).

    NaN where it is unknown.

    Args:
        dynamics: The equation of motion of the variants, whose force elements are springs and dampers of joints.
        ensemble: Their motions.
        interpolated: Steps within which there are rows of the table, shape (steps,).
    """
    exchanging = dynamics.exchanging
    divided = np.ones_like(interpolated) if exchanging else _divided(ensemble, interpolated)
    parts = VariantParts.of(ensemble, divided)
    last = np.maximum(ensemble.firsts + ensemble.counts - 1, 0)
    steps = ensemble.solution.steps
    step, ends = np.vstack([parts.step, last]), np.vstack([parts.start, steps.until[last]])
    q, v = ensemble.states_in(step, ends)
    lost = _losses(exchanging, ensemble, parts) if exchanging else np.zeros_like(parts.h)
    columns = *dynamics.energy(q, v), np.concatenate([0.0 * lost[:1], np.cumsum(lost, axis=0)])
    drift = np.sum([column - column[0] for column in columns], axis=0)
    return unaccounted(np.abs(drift).max(axis=0), np.array(columns))


def _divided(ensemble: Ensemble, looked: Flags) -> Flags:
    """Return the steps that are looked into, shape (steps,): those that have been, and an even choice besides."""
    divided = looked.copy()
    for first, count in zip(ensemble.firsts.tolist(), ensemble.counts.tolist(), strict=True):
        divided[first + sampled(count, STEPS)] = True
    return divided


def _losses(dynamics: Dynamics, ensemble: Ensemble, parts: VariantParts) -> Array:
    """Return the energy that elements take out in parts of steps [J], shape (n, k)."""
    nodes = 0.5 * (gauss_nodes() + 1.0)
    t = parts.start + nodes[:, None, None] * parts.h
    q, v = ensemble.states_in(np.broadcast_to(parts.step, t.shape), t)
    power = np.sum([force.dissipated_power(t, q, v) for force in dynamics.forces.values()], axis=0)
    return np.asarray(np.tensordot(part_weights(1)[0], power, 1) * parts.h)
