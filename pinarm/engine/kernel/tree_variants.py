"""Free motions of variants of a tree by the compiled library, each with links of its own."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.kernel.library import contiguous, pointer
from pinarm.engine.kernel.links import links_of, links_of_variants
from pinarm.engine.kernel.structures import FlowStructure, TreeStructure
from pinarm.engine.kernel.tree import TreeFlow
from pinarm.mechanics.geometry.model_variants import ModelVariants

TREE, FLOW = np.dtype(TreeStructure), np.dtype(FlowStructure)
"""A tree and a motion as elements of arrays."""


@dataclass(frozen=True, eq=False)
class TreeVariants:
    """The free motions of k variants of a tree under the same loads. They share their buffers: they serve one thread.

    Attributes:
        flows: The motions, shape (k,), of ``FLOW``.
        finite: Of which of them all numbers are finite, shape (k,).
        kept: What they point to.
    """

    flows: NDArray[np.void]
    finite: Flags
    kept: tuple[Any, ...] = field(repr=False)

    @classmethod
    def of(cls, flow: TreeFlow, variants: ModelVariants) -> TreeVariants:
        """Return the motions of variants, given that of the first.

        Raises:
            ValueError: The library does not know a joint.
        """
        first, count = links_of(variants.first), len(variants)
        if first is None:
            raise ValueError("the library has lost the joints of the tree")
        links = links_of_variants(first, variants)
        trees = np.repeat(np.frombuffer(bytes(flow.system.structure), TREE), count)
        trees["link"] = pointer(links) + links.strides[0] * np.arange(count)
        flows = np.repeat(np.frombuffer(bytes(flow.structure), FLOW), count)
        flows["system"] = pointer(trees) + trees.strides[0] * np.arange(count)
        numbers = [links[name].reshape(count, -1) for name in ("rotation", "translation", "mass", "moment", "inertia")]
        finite = np.isfinite(np.concatenate(numbers, axis=1)).all(axis=1)
        return cls(flows, finite, (flow, links, trees))

    def places(self, motions: Indices) -> list[int]:
        """Return the addresses of some of the motions."""
        found: list[int] = (pointer(self.flows) + self.flows.strides[0] * motions).tolist()
        return found

    def slopes(self, motions: Indices, y: Array) -> Array:
        """Return the slopes of states [q, v], each of one of the motions, shape (n, nq + nv)."""
        states, slopes = contiguous(y).copy(), np.empty_like(y, order="C")
        rows = zip(
            self.flows["system"][motions].tolist(),
            range(pointer(states), pointer(states) + states.nbytes, states.strides[0]),
            range(pointer(slopes), pointer(slopes) + slopes.nbytes, slopes.strides[0]),
            strict=True,
        )
        for system, state, slope in rows:
            self._rates(system, 0.0, state, slope)
        return slopes

    @cached_property
    def _rates(self) -> Callable[..., Any]:
        """The function of the library that writes the slope of a state."""
        kind = ctypes.PYFUNCTYPE(None, ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p)
        return kind(int(self.flows["rates"][0]))
