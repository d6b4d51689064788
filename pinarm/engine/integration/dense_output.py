"""Dense output: states within steps, by polynomials over whole steps or over equal parts of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array, Indices


class DenseOutput(NamedTuple):
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
        return cls(*(np.concatenate(parts) for parts in zip(*outputs, strict=True)))

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
            count = self.counts[step]
            part = np.clip((x * count).astype(np.intp), 0, count - 1)
            step, x = (np.cumsum(self.counts) - self.counts)[step] + part, x * count - part
        return self._interpolated(step, x)

    def _interpolated(self, part: Indices, x: Array) -> Array:
        """Return states at places x on parts, shape (m, nq + nv), by Horner's scheme.

        Components are first while they are computed: numpy then works on long rows.
        """
        base = self.base.T.take(part, axis=1)
        y, back = np.zeros_like(base), 1.0 - x
        terms = np.ascontiguousarray(self.terms.transpose(1, 2, 0)) if len(part) > len(self.base) else None
        for k in range(self.terms.shape[1] - 1, -1, -1):
            y += self.terms[part, k].T if terms is None else terms[k].take(part, axis=1)
            y *= back if k % 2 else x
        return np.where(x == 0.0, base, base + y).T  # the terms of a step that failed may be infinite
