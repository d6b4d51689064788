"""Parts of bodies, springs and dampers in the energy of modes: which spring to stiffen, which mass to move.

With the mode shape x of all joints, the velocities v of the mode, a body's mass matrix ``M_i``, and the derivatives
``K_F = -dtau_F/dq`` and ``D_F = -dtau_F/dv`` of the load of a force element, the parts are

    x^H M_i x,    Re x^H K_F x,    Re v^H D_F v

each relative to their sum. K_F has the geometric stiffness of a prestressed element; those of the weights, of what
moves and of the forces of constraints are parts as well, so that the sum is the whole stiffness. Scaling a spring by
``1 + e`` raises the frequency of an undamped mode by ``e / 2`` times its part (Rayleigh).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinarm.arrays import Array, Complex
from pinarm.engine.labelled_array import LabelledArray
from pinarm.engine.linear.derivatives import element_derivatives, tree_derivatives
from pinarm.engine.linear.linear_states import Linearisation
from pinarm.input.units import DIMENSIONLESS
from pinarm.mechanics.geometry.link_placements import speeding
from pinarm.mechanics.joints import links_behind

NONE = 1e-9
"""Sum of parts, relative to the sum of their sizes, that is rounding of none."""

WEIGHTS, CONSTRAINTS = "weights and velocities", "forces of constraints"
"""Parts of the stiffness beside force elements."""


def participations(linear: Linearisation) -> dict[str, LabelledArray]:
    """Return the parts of bodies, springs and dampers in each mode as tables: rows are their names."""
    tables = {"masses": _masses(linear), "springs": _stiffness_parts(linear)[0], "dampers": _dampings(linear)}
    modes = [f"mode.{k}" for k in range(1, len(linear.modes.eigenvalues) + 1)]
    return {
        name: LabelledArray(_shares(parts), [*parts], modes, [DIMENSIONLESS] * len(parts), [DIMENSIONLESS] * len(modes))
        for name, parts in tables.items()
        if parts
    }


def rigid_modes(linear: Linearisation) -> list[str]:
    """Return notes on the modes with the eigenvalue 0, with the reason."""
    modes, shapes = linear.modes, np.abs(linear.shapes())
    parts, sizes = _stiffness_parts(linear)
    rigid: dict[str, list[str]] = {}
    for k in np.flatnonzero(modes.eigenvalues == 0.0).tolist():
        moving = [name for name, part in zip(linear.joints, shapes[:, k], strict=True) if part > 1e-6]
        acting = {name: part[k] for name, part in parts.items() if abs(part[k]) > NONE * sizes[name][k]}
        cancelled = abs(sum(acting.values())) <= NONE * sum(map(abs, acting.values()))
        slow = f"softer than rounding can tell: below {modes.errors[k] / (2.0 * np.pi):.2g} Hz"
        why = f"{', '.join(acting)} {'cancel each other' if cancelled else slow}"
        why = why if acting else "no force depends on where they are"
        rigid.setdefault(f"nothing drives {', '.join(moving)} back: {why}", []).append(str(k + 1))
    return [f"mode {', '.join(numbers)}: {why}" for why, numbers in rigid.items()]


def _stiffness_parts(linear: Linearisation) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return ``Re x^H K x`` and ``|K|`` times ``|x|^2`` of force elements, weights and constraints, shape (k,) each.

    Of those that have any stiffness.
    """
    at, shapes = linear.at, linear.motion.shapes[0]
    model, q, v, a = at.state.mechanism.model, at.state.q[0], at.state.v[0], at.state.a[0]
    loads = _slopes(linear, 0)
    tree = tree_derivatives(model, q, v, a)[1]
    held = at.derivatives.force_q - tree - sum(loads.values(), np.zeros_like(tree))
    least = NONE * float(at.derivatives.terms_q.max(initial=0.0))
    loads |= {name: k for name, k in ((WEIGHTS, tree), (CONSTRAINTS, held)) if np.abs(k).max(initial=0.0) > least}
    acting = {name: k for name, k in loads.items() if k.any()}
    sizes = {name: np.abs(k).max() * (np.abs(shapes) ** 2).sum(axis=0) for name, k in acting.items()}
    return {name: _power(shapes, k) for name, k in acting.items()}, sizes


def _masses(linear: Linearisation) -> dict[str, Array]:
    """Return ``x^H M_i x / 2`` of all bodies and rotors, shape (k,) each."""
    state, shapes = linear.at.state, linear.motion.shapes[0]
    model, masses = state.mechanism.model, dict[str, Array]()
    both = np.hstack([shapes.real, shapes.imag]).T
    links, twists = speeding(model, np.broadcast_to(state.q, (len(both), model.nq)), both)
    halves = links.energies(twists)[0]
    energies = halves.reshape(2, shapes.shape[1], halves.shape[-1]).sum(axis=0)
    for index, names in enumerate(links_behind(model)[1:], 1):
        if model.inertias[index].mass:
            masses[names[0] if names else str(model.names[index])] = energies[:, index]
    rotors = 0.5 * model.armature[:, None] * np.abs(shapes) ** 2
    return masses | {f"rotor at {linear.joints[k]}": rotors[k] for k in np.flatnonzero(model.armature).tolist()}


def _dampings(linear: Linearisation) -> dict[str, Array]:
    """Return ``Re v^H D v`` of force elements and of friction that slips, shape (k,) each; those that have any."""
    motion, at = linear.motion, linear.at
    velocities = motion.shapes[1]
    powers = {name: _power(velocities, d) for name, d in _slopes(linear, 1).items()}
    slipping = np.flatnonzero(~at.friction.stuck).tolist()
    friction: Complex = motion.friction[:, motion.free] @ linear.modes.vectors
    for row, k, f in zip(at.derivatives.rows[at.rows.slipping], slipping, friction, strict=True):
        powers[f"friction of {at.friction.contacts[k].name}"] = -np.real(np.conj(row @ velocities) * f)
    return {name: parts for name, parts in powers.items() if parts.any()}


def _slopes(linear: Linearisation, order: int) -> dict[str, Array]:
    """Return K or D of force elements by name: less the derivatives of their loads by q, or by v, shape (nv, nv)."""
    state = linear.at.state
    t, q, v = float(state.grid.t[0]), state.q[0], state.v[0]
    return {
        name: -element_derivatives(state.mechanism.model, force, t, q, v)[order]
        for name, force in state.dynamics.forces.items()
        if not force.steady
    }


def _power(shapes: Complex, matrix: Array) -> Array:
    return np.asarray(np.real(np.einsum("ik,ij,jk->k", shapes.conj(), matrix, shapes)))


def _shares(parts: Mapping[str, Array]) -> Array:
    """Return parts relative to their sum, NaN where that is rounding, shape (rows, k)."""
    table = np.array([*parts.values()])
    total, sizes = table.sum(axis=0), np.abs(table).sum(axis=0)
    known = np.abs(total) > NONE * sizes
    return np.where(known, table / np.where(known, total, 1.0), np.nan)
