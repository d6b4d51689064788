"""Masses along the free motions of rows of a table: ``T^T M T``, its condition, and what loads make of it.

Of few joints M is a matrix; of many, M and its inverse are applied by recursion, ``rnea`` and ``aba`` without weights.
"""

from __future__ import annotations

from functools import cached_property, partial
from typing import Protocol

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.dynamics.mass_matrix import mass_diagonals, mass_solved, mass_times
from pinarm.engine.dynamics.masses import MASSLESS, NOTHING
from pinarm.records import Record


class FreeMasses(Protocol):
    """Masses along the free motions of n rows."""

    @property
    def condition(self) -> Array:
        """Largest condition number of ``T^T M T`` scaled to a diagonal of ones, infinite if one is singular; (..)."""
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
        found = np.asarray(np.linalg.solve(self.mass, np.stack([moving, most], axis=-1)), float)
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
        return condition_of(self._along)

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
        return condition_of(self._along)

    def responses(self, moving: Array, most: Array) -> tuple[Array, Array]:
        """See ``FreeMasses``."""
        return _along(self.free, self._along, moving, most)


class TreeMasses(_RecursiveMasses, frozen=True):
    """Masses of a tree of many joints that no constraint ties: T is the identity."""

    @cached_property
    def condition(self) -> Array:
        """See ``FreeMasses``; extreme eigenvalues by Lanczos' method."""
        from pinarm.engine.constraints.nullspaces.sparse_rows import largest_eigenpair

        nv, heavy, light, worst = self.model.nv, None, None, 0.0
        for q, square in zip(self.q, self.diagonal, strict=True):
            if not (square > NOTHING * square.max()).all():
                return np.asarray(np.inf)
            size = np.sqrt(square)
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
    values = np.linalg.eigvalsh(along / (size[..., :, None] * size[..., None, :]))
    idle |= ~(values[..., 0].min(axis=0) > MASSLESS)
    return np.where(idle, np.inf, (values[..., -1] / np.where(idle, 1.0, values[..., 0])).max(axis=0))


def _along(free: Array, mass: Array, moving: Array, most: Array) -> tuple[Array, Array]:
    """Return what ``FreeMasses.responses`` does, with T and ``T^T M T``."""
    loads = np.stack([np.vecmat(moving, free), np.vecmat(most, np.abs(free))], axis=-1)
    found = free @ np.linalg.solve(mass, loads)
    return found[..., 0], found[..., 1]
