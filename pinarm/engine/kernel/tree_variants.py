"""Free motions of variants of a tree by the compiled library, each with links of its own."""

from __future__ import annotations

import ctypes

import numpy as np

from pinarm.arrays import Flags
from pinarm.engine.kernel.library import Flow, pointer
from pinarm.engine.kernel.links import links_of, links_of_variants
from pinarm.engine.kernel.structures import FlowStructure, TreeStructure
from pinarm.engine.kernel.tree import TreeFlow
from pinarm.mechanics.geometry.model_variants import ModelVariants


def variant_flows(flow: TreeFlow, variants: ModelVariants) -> tuple[list[Flow], Flags]:
    """Return the motions of variants under the same loads, and of which all numbers are finite, shape (k,).

    They share their buffers: they serve one thread.

    Args:
        flow: The motion of the first.
        variants: The variants.

    Raises:
        ValueError: The library does not know a joint.
    """
    first, flows = links_of(variants.first), list[Flow]()
    if first is None:
        raise ValueError("the library has lost the joints of the tree")
    links = links_of_variants(first, variants)
    for k in range(len(variants)):
        tree, structure = (type(x).from_buffer_copy(x) for x in (flow.system.structure, flow.structure))
        assert isinstance(tree, TreeStructure)
        assert isinstance(structure, FlowStructure)
        tree.link, structure.system = pointer(links) + k * links.strides[0], ctypes.addressof(tree)
        flows.append(Flow(structure, (tree, links, flow.system)))
    numbers = [links[name].reshape(len(flows), -1) for name in ("rotation", "translation", "mass", "moment", "inertia")]
    return flows, np.isfinite(np.concatenate(numbers, axis=1)).all(axis=1)
