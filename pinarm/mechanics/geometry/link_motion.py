"""Motions of all links at many states, by Pinocchio's forward kinematics or by ``moving``, whichever is faster."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.lib.stride_tricks import as_strided

from pinarm.arrays import Array
from pinarm.mechanics.geometry.link_placements import LinkPlacements, moving
from pinarm.mechanics.geometry.link_tree import components_far
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.mechanics.geometry.model_variants import Model, ModelVariants
from pinarm.mechanics.geometry.pinocchio_data import new_data
from pinarm.records import Record

STATES, LINKS = 64, 16
"""Up to so many states, and from so many links on at any number, Pinocchio's calls state by state take less time than
numpy's on all of them: of a chain of 1,000 links a seventh."""

PLACEMENT, MOTION = 12, 6
"""Numbers of a ``pin.SE3``, the columns of its rotation matrix and then its origin, and of a ``pin.Motion``."""


class LinkBuffers(Record, frozen=True):
    """Pinocchio's buffers of a model, and what it writes into them of all links, read where it stands.

    Attributes:
        data: The buffers.
        placements: Rotations and origins, shape (njoints, 12).
        twists: In link frames, shape (njoints, 6).
        rates: Their time derivatives, shape (njoints, 6).
    """

    data: pin.Data
    placements: Array
    twists: Array
    rates: Array

    def rows(self, model: pin.Model, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array, Array]:
        """Return what is read at n states, and the columns of the joints, shape (6, nv): a row each."""
        data, kinematics, jacobian = self.data, pin.forwardKinematics, pin.computeJointJacobians
        read = self.placements, self.twists, self.rates
        placements, twists, rates = (np.empty((len(q), *part.shape)) for part in read)
        columns = np.empty((len(q), 6, model.nv))
        for k, state in enumerate(zip(q, v, a, strict=True)):
            kinematics(model, data, *state)
            placements[k], twists[k], rates[k] = read
            columns[k] = jacobian(model, data).reshape(6, -1)
        return placements, twists, rates, columns


def motion_of(model: Model, q: Array, v: Array, a: Array) -> tuple[LinkPlacements, Array, Array, Array]:
    """Return the placements of links, their twists, the time derivatives of these, and the world Jacobian.

    Args:
        model: Pinocchio's model, or variants of one, of which it has no buffers.
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        a: Accelerations, shape (n, nv).

    Returns:
        As ``moving``.
    """
    if isinstance(model, ModelVariants) or (len(q) > STATES and model.njoints < LINKS):
        return moving(model, q, v, a)
    placements, twists, rates, columns = _buffers(model).rows(model, q, v, a)
    turns = placements[..., :9].reshape(len(q), model.njoints, 3, 3).swapaxes(-2, -1)
    links = LinkPlacements(model, components_far(turns, 3), components_far(placements[..., 9:]), q)
    return links, components_far(twists), components_far(rates), columns


@cached_by_model
def _buffers(model: pin.Model) -> LinkBuffers:
    data = new_data(model)
    placements = [place.rotation for place in (data.oMi[0], data.oMi[model.njoints - 1])]
    twists, rates = ([vector[k].linear for k in (0, model.njoints - 1)] for vector in (data.v, data.a))
    count = model.njoints
    return LinkBuffers(
        data, _read(placements, count, PLACEMENT), _read(twists, count, MOTION), _read(rates, count, MOTION)
    )


def _read(ends: Sequence[Array], count: int, width: int) -> Array:
    """Return the entries of one of Pinocchio's vectors, which follow one another in memory, shape (count, width).

    Args:
        ends: The beginnings of the first entry and of the last.
        count: Number of entries.
        width: Numbers of each.
    """
    first, last = ends
    step = (last.ctypes.data - first.ctypes.data) // max(count - 1, 1)
    return as_strided(first, (count, width), (step, first.itemsize))
