"""The velocity at the start of a motion where rates of coordinates are given that are not those of joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import coupled_joints, split_rows
from pinarm.engine.dynamics.equation import solve
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems import Initial
from pinarm.errors import InputError

UNMET = 1e-9
"""Part of a given rate that may be missed: rounding leaves 1e-14."""


def velocity_with_rates(
    initial: Initial, closure: Closure, prescribed: PrescribedCoordinates, q: Array, span: Sequence[float]
) -> Array:
    """Return the velocity nearest to the given one, by the masses, that has all given rates, shape (nv,).

    Joints that are not coupled to any that moves are at rest.

    Args:
        initial: The given velocities of joints, and the rates of other coordinates.
        closure: Constraints of the mechanism.
        prescribed: Coordinates that follow laws.
        q: Configuration, assembled, shape (nq,).
        span: The first interval without jumps [s].

    Raises:
        InputError: Laws, loops and given velocities do not allow a rate.
    """
    rows, model = closure.with_guides(prescribed.names, prescribed.coordinates), closure.model
    state, mass = rows.state(q), mass_matrix(model, q)
    rates, along = np.array([rate for _, rate in initial.rates]), np.array([one.row(state) for one, _ in initial.rates])
    laws = prescribed.on(span[0], span[1])(span[0])[1]
    asked, right = np.vstack([rows.rows(state), along]), np.concatenate([np.zeros(closure.size), laws, rates])
    resting = np.flatnonzero(~coupled_joints(asked, right, initial.v)).tolist()
    known = sorted({*initial.velocities, *resting})
    split = split_rows(np.vstack([asked, np.eye(model.nv)[known]]))
    v = solve(split, mass, mass @ initial.v, np.concatenate([right, initial.v[known]]))
    left = np.abs(along @ v - rates)
    if left.max() > UNMET * np.abs(rates).max():
        raise InputError(
            f"the velocities that are given cannot be had at once: {left.max():.3g} of {rates[left.argmax()]:.6g} is "
            "left over",
            expected="velocities that loops, laws and each other allow",
        )
    return v
