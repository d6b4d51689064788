"""Masses along the free motions of rows of a table: ``T^T M T``, its condition, and what loads make of it.

Of few joints M is a matrix; of many, M and its inverse are applied by recursion, ``rnea`` and ``aba`` without weights.
"""

from __future__ import annotations

from functools import cached_property, partial
from typing import Protocol

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import solved_positive
from pinarm.engine.dynamics.mass_matrix import mass_diagonals, mass_solved, mass_times
from pinarm.engine.dynamics.masses import MASSLESS, NOTHING
from pinarm.records import Record

FEW = 4
"""Free motions up to which masses are taken apart entry by entry."""


class FreeMasses(Protocol):
    """Masses along the free motions of n rows."""

    @property
    def condition(self) -> Array:
        """Largest condition number of ``T^T M T``, infinite if one is singular, shape (..).

        Coordinates are scaled so that M has a diagonal of ones, and T is a basis of right angles then: which one it is
        has no part in it.
        """
        ...

    @property
    def diagonal(self) -> Array:
        """Diagonal of M, shape (n, .., nv)."""
        ...

    def times(self, x: Array) -> Array:
        """Return ``M x``, shape (n, .., nv)."""
        ...

    def responses(self, moving: Array, most: Array) -> tuple[Array, Array]:
        """Return ``T (T^T M T)^-1 T^T`` times loads, and the same of ``|T|^T`` times sizes, shape (n, .., nv) each."""
        ...


class TreeMassMatrices(Record, frozen=True):
    """Masses of a tree that no constraint ties, as matrices: T is the identity.

    Attributes:
        mass: M, shape (n, .., nv, nv).
    """

    mass: Array

    @property
    def condition(self) -> Array:
        """See ``FreeMasses``. Shape (), or (k,) of variants."""
        return condition_of(self.mass)

    @property
    def diagonal(self) -> Array:
        """Diagonal of M."""
        return self.mass.diagonal(axis1=-2, axis2=-1)

    def times(self, x: Array) -> Array:
        """Return ``M x``."""
        return np.asarray(np.matvec(self.mass, x))

    def responses(self, moving: Array, most: Array) -> tuple[Array, Array]:
        """See ``FreeMasses``."""
        found = _solved(self.mass, np.stack([moving, most], axis=-1))
        return found[..., 0], found[..., 1]


class MassMatrices(TreeMassMatrices, frozen=True):
    """Masses as matrices where constraints leave some of the motions free.

    Attributes:
        free: T, bases of the free motions, shape (n, .., nv, f).
    """

    free: Array

    @cached_property
    def _along(self) -> Array:
        """``T^T M T``, shape (n, .., f, f)."""
        return np.asarray(self.free.swapaxes(-2, -1) @ self.mass @ self.free)

    @property
    def condition(self) -> Array:
        """See ``FreeMasses``. Shape (), or (k,) of variants."""
        return condition_along(self.free, self.diagonal, self._along)

    def responses(self, moving: Array, most: Array) -> tuple[Array, Array]:
        """See ``FreeMasses``."""
        return _along(self.free, self._along, moving, most)


class _RecursiveMasses(Record, frozen=True):
    """Masses of many joints: products by recursion.

    Attributes:
        model: Pinocchio's model.
        q: Configurations, shape (n, nq).
    """

    model: pin.Model
    q: Array

    @cached_property
    def diagonal(self) -> Array:
        """Diagonal of M."""
        return mass_diagonals(self.model, self.q)

    def times(self, x: Array) -> Array:
        """Return ``M x``."""
        return np.array([mass_times(self.model, q, one) for q, one in zip(self.q, x, strict=True)])


class ConstrainedMasses(_RecursiveMasses, frozen=True):
    """Masses of many joints that constraints leave few free motions.

    Attributes:
        free: T, shape (n, nv, f).
    """

    free: Array

    @cached_property
    def _along(self) -> Array:
        moved = [mass_times(self.model, q, free) for q, free in zip(self.q, self.free, strict=True)]
        return np.asarray(self.free.swapaxes(-2, -1) @ np.array(moved))

    @property
    def condition(self) -> Array:
        """See ``FreeMasses``."""
        return condition_along(self.free, self.diagonal, self._along)

    def responses(self, moving: Array, most: Array) -> tuple[Array, Array]:
        """See ``FreeMasses``."""
        return _along(self.free, self._along, moving, most)


class TreeMasses(_RecursiveMasses, frozen=True):
    """Masses of a tree of many joints that no constraint ties: T is the identity."""

    @cached_property
    def condition(self) -> Array:
        """See ``FreeMasses``; extreme eigenvalues by Lanczos' method."""
        from pinarm.engine.dynamics.mass_matrix import largest_eigenpair

        nv, heavy, light, worst = self.model.nv, None, None, 0.0
        for q, square in zip(self.q, self.diagonal, strict=True):
            if not (square > NOTHING * square.max()).all():
                return np.asarray(np.inf)
            size = np.sqrt(square)
            if not np.isfinite(self._solved(q, size, size)).all():  # joints that move no mass together
                return np.asarray(np.inf)
            largest, heavy = largest_eigenpair(nv, partial(self._scaled, q, size), heavy)
            inverse, light = largest_eigenpair(nv, partial(self._solved, q, size), light)
            worst = max(worst, largest * inverse if 0.0 < inverse < 1.0 / MASSLESS else np.inf)
        return np.asarray(worst)

    def _scaled(self, q: Array, size: Array, x: Array) -> Array:
        return mass_times(self.model, q, x / size) / size

    def _solved(self, q: Array, size: Array, x: Array) -> Array:
        return size * mass_solved(self.model, q, size * x)

    def responses(self, moving: Array, most: Array) -> tuple[Array, Array]:
        """See ``FreeMasses``."""
        solved = [[mass_solved(self.model, *each) for each in zip(self.q, x, strict=True)] for x in (moving, most)]
        return np.array(solved[0]), np.array(solved[1])


def condition_of(along: Array) -> Array:
    """Return the largest condition number of matrices, shape (n, .., f, f), scaled to a diagonal of ones.

    Infinite if one is singular: a motion may move no mass at some positions only, such as a light crank at the dead
    centre of its slider.
    """
    if not along.shape[-1]:
        return np.ones(along.shape[1:-2])
    square = np.maximum(along.diagonal(axis1=-2, axis2=-1), 0.0)
    idle = (square <= NOTHING * square.max(axis=(0, -1), keepdims=True)).any(axis=(0, -1))
    size = np.sqrt(np.where(idle[..., None], 1.0, square))
    return _largest_ratio(along / (size[..., :, None] * size[..., None, :]), idle)


def condition_along(free: Array, diagonal: Array, along: Array) -> Array:
    """Return the largest condition number of masses along free motions, whatever basis of these is given.

    It is the ratio of the extreme eigenvalues of ``T^T M T x = value T^T D T x``, where D has the diagonal of M.

    Args:
        free: T, shape (n, .., nv, f).
        diagonal: Diagonal of M, shape (n, .., nv).
        along: ``T^T M T``, shape (n, .., f, f).
    """
    if free.shape[-1] < 2:
        return condition_of(along)
    metric = free.swapaxes(-2, -1) @ (diagonal[..., None] * free)
    square = metric.diagonal(axis1=-2, axis2=-1)
    size = 1.0 / np.sqrt(np.where(square > 0.0, square, 1.0))  # their units may lie many orders apart
    values, vectors = np.linalg.eigh(size[..., :, None] * metric * size[..., None, :])
    vectors = size[..., :, None] * vectors
    idle = (values[..., 0] <= NOTHING * values[..., -1].max(axis=0, keepdims=True)).any(axis=0)
    ways = vectors / np.sqrt(np.where(idle[..., None], 1.0, values))[..., None, :]
    return _largest_ratio(ways.swapaxes(-2, -1) @ along @ ways, idle)


def _largest_ratio(scaled: Array, idle: Array) -> Array:
    """Return the largest ratio of extreme eigenvalues of n matrices, infinite where one moves no mass, shape (..)."""
    least, most = _extreme_values(scaled)
    massless = idle | ~(least.min(axis=0) > MASSLESS)
    return np.where(massless, np.inf, (most / np.where(massless, 1.0, least)).max(axis=0))


def _extreme_values(x: Array) -> tuple[Array, Array]:
    """Return the least and the greatest eigenvalue of symmetric matrices, shape (.., f, f).

    Of one or two rows by formula: a call of LAPACK takes as long as much else that is asked of such a state.
    """
    if x.shape[-1] == 1:
        return x[..., 0, 0], x[..., 0, 0]
    if x.shape[-1] == 2:
        middle, half = 0.5 * (x[..., 0, 0] + x[..., 1, 1]), 0.5 * (x[..., 0, 0] - x[..., 1, 1])
        away = np.hypot(half, x[..., 1, 0])
        return middle - away, middle + away
    values = np.asarray(np.linalg.eigvalsh(x), dtype=np.float64)
    return values[..., 0], values[..., -1]


def _solved(mass: Array, loads: Array) -> Array:
    """Return ``M^-1 x`` of symmetric positive matrices, shape (.., f, f), and loads, shape (.., f, k).

    Small matrices are taken apart entry by entry in all states at once, as ``L D L^T``: LAPACK is called once a state.
    """
    f = mass.shape[-1]
    if f == 1:
        return loads / mass
    if f > FEW:
        return solved_positive(mass, loads)
    rows, x = np.moveaxis(mass, (-2, -1), (0, 1)).copy(), np.moveaxis(loads, (-2, -1), (0, 1)).copy()
    for k in range(f):
        for i in range(k + 1, f):
            share = rows[i, k] / rows[k, k]
            rows[i, k + 1 :] -= share * rows[k, k + 1 :]
            x[i] -= share * x[k]
    for k in reversed(range(f)):
        for i in range(k + 1, f):
            x[k] -= rows[k, i] * x[i]
        x[k] /= rows[k, k]
    return np.moveaxis(x, (0, 1), (-2, -1))


def _along(free: Array, mass: Array, moving: Array, most: Array) -> tuple[Array, Array]:
    """Return what ``FreeMasses.responses`` does, with T and ``T^T M T``."""
    loads = np.stack([np.vecmat(moving, free), np.vecmat(most, np.abs(free))], axis=-1)
    found = free @ _solved(mass, loads)
    return found[..., 0], found[..., 1]
