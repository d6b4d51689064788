"""Equilibria: configurations at which the forces of a mechanism at rest balance, and small motions about them."""

from __future__ import annotations

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.dynamics.mass_matrix import MASSLESS
from pinarm.engine.linear.derivatives import load_at_kink
from pinarm.engine.linear.force_balance import ZERO, ForceBalance
from pinarm.records import Record

SAME, SAME_FLAT = 1e-8, 1e-4
"""Distance below which two configurations are one, relative to ``1 + |q|`` [rad or m]: usually, and where a stiffness
of 0 leaves Newton's method with the cube root of its tolerance."""


class Modes(Record, frozen=True):
    """Small motions about an equilibrium, those of ``M x'' + K x = 0``.

    Attributes:
        squares: ``w^2`` of ``K x = w^2 M x`` [rad^2/s^2], ascending, shape (n,); NaN where a direction has no mass.
        stiffnesses: Eigenvalues of K, ascending, shape (n,).
        stability: 1 stable, 0 indifferent, -1 unstable; that of K alone where a direction has no mass; NaN where the
            forces do not balance.
        edge: Name of a load whose slope is another one to either side: then all of these are NaN; empty for none.
    """

    squares: Array
    stiffnesses: Array
    stability: float
    edge: str = ""

    @classmethod
    def unknown(cls, count: int, edge: str = "") -> Modes:
        """Return unknown modes in so many directions."""
        return cls(np.full(count, np.nan), np.full(count, np.nan), np.nan, edge)

    @classmethod
    def of(cls, stiffness: Array, mass: Array, doubt: Array) -> Modes:
        """Return the small motions.

        Args:
            stiffness: K, shape (n, n); not symmetric under loads without a potential.
            mass: M, shape (n, n).
            doubt: How large an entry of K may be and still be 0, shape (n, n).
        """
        unit, massless = np.eye(len(mass)), _massless(mass)
        springs, _ = _modes_of(stiffness, unit, doubt)
        squares, modes = _modes_of(stiffness, unit if massless else mass, doubt)
        unsure = np.einsum("ik,ij,jk->k", np.abs(modes), doubt, np.abs(modes))
        falls = (squares.real < -unsure) | (np.abs(squares.imag) > unsure)
        stability = -1.0 if falls.any() else float((squares.real > unsure).all())
        ascending = np.full(len(mass), np.nan) if massless else np.sort(squares.real)
        return cls(ascending, np.sort(springs.real), stability)


def _modes_of(stiffness: Array, mass: Array, doubt: Array) -> tuple[Array, Array]:
    """Return the eigenvalues of ``K x = w^2 M x``, shape (n,), and x with ``x^H M x = 1`` as columns, shape (n, n).

    Where K is symmetric within ``doubt`` they are real; under loads without a potential they may be complex.
    """
    from scipy.linalg import eig, eigh

    if (np.abs(stiffness - stiffness.T) <= doubt).all():
        squares, modes = eigh(0.5 * (stiffness + stiffness.T), mass)
    else:
        squares, modes = eig(stiffness, mass)
        modes = modes / np.sqrt(np.einsum("ik,ij,jk->k", modes.conj(), mass, modes).real)
    return squares, modes


def _massless(mass: Array) -> bool:
    size = np.sqrt(np.diag(mass))
    return bool((size == 0.0).any() or np.linalg.eigvalsh(mass / np.outer(size, size))[0] < MASSLESS)


class Equilibrium(Record, frozen=True):
    """A configuration at which the forces balance.

    Attributes:
        q: Configuration [rad or m], shape (nq,).
        starts: How many starts led to it.
    """

    q: Array
    modes: Modes
    starts: int = 1

    def is_at(self, q: Array, turns: Array) -> bool:
        """Tell whether a configuration is this one but for full turns; ``turns`` are 1 for joints that turn, else 0."""
        apart = q - self.q
        apart -= turns * 2 * np.pi * np.round(apart / (2 * np.pi))
        tolerance = SAME if self.modes.stability else SAME_FLAT
        return bool((np.abs(apart) <= tolerance * (1.0 + np.abs(q))).all())


def equilibrium_near(balance: ForceBalance, q: Array, start: str) -> Equilibrium:
    """Return the equilibrium that Newton steps from q reach, with its small motions; ``start`` names q in errors."""
    balance.basis(q)  # there has to be one
    q, forces = balance.solved(q, start)
    slopes, basis = balance.slopes(q, forces), forces.free
    scale, still = balance.closure.scale, np.zeros_like(forces.v)
    if edge := load_at_kink(balance.dynamics, 0.0, q, still, scale, float(slopes.terms_q.max())):
        return Equilibrium(q, Modes.unknown(basis.shape[1], edge))
    stiffness, mass = basis.T @ slopes.force_q @ basis, basis.T @ slopes.mass @ basis
    return Equilibrium(q, Modes.of(stiffness, mass, ZERO * (np.abs(basis).T @ slopes.terms_q @ np.abs(basis))))
