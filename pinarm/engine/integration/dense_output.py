"""Dense output: states within steps, by polynomials over whole steps or over equal parts of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.records import Record


class DenseOutput(Record, frozen=True):
    """The dense output of n steps: a polynomial over each, or one over each of the equal parts that a step has.

    With x from 0 to 1 over a part it is ``base + x (r_0 + (1 - x) (r_1 + x (r_2 + (1 - x) (...))))``.

    Attributes:
        base: States [q, v] at the starts of all parts, shape (p, nq + nv).
        terms: Terms r of their polynomials, shape (p, d, nq + nv).
        counts: Number of parts of each step, shape (n,).
    """

    base: Array
    terms: Array
    counts: Indices

    @classmethod
    def whole(cls, base: Array, terms: Array) -> DenseOutput:
        """Return that of n steps which have one polynomial each."""
        return cls(base, terms, np.ones(len(base), dtype=np.intp))

    @classmethod
    def joined(cls, outputs: Sequence[DenseOutput]) -> DenseOutput:
        """Return that of the steps of several, one after the other."""
        base, terms, counts = zip(*((each.base, each.terms, each.counts) for each in outputs), strict=True)
        return cls(np.concatenate(base), np.concatenate(terms), np.concatenate(counts))

    def split(self) -> list[DenseOutput]:
        """Return that of each step."""
        counts = self.counts.tolist()
        spans = [slice(end - count, end) for end, count in zip(accumulate(counts), counts, strict=True)]
        return [DenseOutput(self.base[k], self.terms[k], self.counts[n : n + 1]) for n, k in enumerate(spans)]

    def states(self, step: Indices, x: Array) -> Array:
        """Return states within steps, before their projection onto the manifold, shape (m, nq + nv).

        Args:
            step: Index of the step of each, shape (m,).
            x: ``(t - start) / h`` of each in its step, shape (m,).
        """
        if len(self.base) > len(self.counts):
            step, x = divided_at((np.cumsum(self.counts) - self.counts)[step], self.counts[step], x)
        return interpolated(self.base[step], self.terms[step], x)


def divided_at(first: Indices, count: Indices, x: Array) -> tuple[Indices, Array]:
    """Return the part of its step in which each instant lies, and its place on the part, both of shape (m,).

    Args:
        first: First part of the step of each, shape (m,).
        count: Number of parts of this step, shape (m,).
        x: ``(t - start) / h`` of each in its step, shape (m,).
    """
    part = np.clip((x * count).astype(np.intp), 0, count - 1)
    return first + part, x * count - part


def interpolated(base: Array, terms: Array, x: Array) -> Array:
    """Return states on polynomials, shape (n, nq + nv): ``base + x (r_0 + (1 - x) (r_1 + x (r_2 + ...)))``.

    Args:
        base: States at the start of each, shape (n, nq + nv).
        terms: Terms r of each, shape (n, d, nq + nv).
        x: Place on each, shape (n,).
    """
    factors = np.empty(terms.shape[:2])  # x, x (1 - x), x (1 - x) x, ...
    factors[:, ::2], factors[:, 1::2] = x[:, None], 1.0 - x[:, None]
    y = np.vecmat(np.multiply.accumulate(factors, axis=1), terms)
    return np.where(x[:, None] == 0.0, base, base + y)  # the terms of a step that failed may be infinite
