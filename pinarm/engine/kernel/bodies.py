"""What the motion of rigid bodies demands, as virtual powers, by the compiled library.

The same numbers as those of ``checks.virtual_powers`` in arrays: of few links in few states numpy's calls take longer
than their work.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.kernel.library import contiguous, library, pointer
from pinarm.engine.kernel.links import SYMMETRIC
from pinarm.engine.kernel.structures import BODY, BodiesStructure
from pinarm.mechanics.geometry.model_cache import cached_by_model
from pinarm.records import Record

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pinarm.mechanics.geometry.link_placements import LinkPlacements

UPPER = SYMMETRIC[[0, 1, 2, 4, 5, 8]]
"""Places of xx, xy, xz, yy, yz, zz in Pinocchio's parameters of a body."""


class Bodies(Record, frozen=True):
    """The bodies of a tree, for the library.

    Attributes:
        structure: The C structure.
        arrays: What it points to.
    """

    structure: BodiesStructure
    arrays: tuple[NDArray[Any], ...]


def demanded_powers(
    motion: tuple[LinkPlacements, Array, Array, Array], wrenches: Array, sizes: Array
) -> tuple[Array, Array, Array] | None:
    """Return the virtual powers that the motion of the links asks for; ``None`` without the library.

    Args:
        motion: Where the links of one mechanism are in n states, their twists, the time derivatives of these, and the
            columns of the world Jacobian; see ``motion_of``.
        wrenches: What acts on the links, [f; m] at their origins, world axes, shape (n, njoints, 6).
        sizes: Of the forces and moments that these are the sums of, shape (n, njoints, 2).

    Returns:
        For every velocity the power beside that of the wrenches, and what wrenches of their sizes could do at most,
        both of shape (n, nv) [W per rad/s or m/s]; and the most that what the motion demands could do at the speeds of
        the links, ``|f| |v| + |m| |omega|``, shape (n,) [W].
    """
    links, twists, rates, columns = motion
    compiled, known = library(), _bodies(links.model)
    if compiled is None:
        return None
    n, nv = len(columns), known.structure.nv
    powers, most = np.empty((2, n, nv)), np.empty(n)
    arrays = [contiguous(x) for x in (links.turns, links.places, twists, rates, columns)]
    sums = -np.ascontiguousarray(wrenches), np.array(sizes, order="C")
    addresses = (ctypes.c_void_p(pointer(x)) for x in (*arrays, *sums, *powers, most))
    compiled.bodies_powers(ctypes.byref(known.structure), ctypes.c_ssize_t(n), *addresses)
    return powers[0], powers[1], most


@cached_by_model
def _bodies(model: pin.Model) -> Bodies:
    numbers = np.array([one.toDynamicParameters() for one in model.inertias.tolist()])
    bodies = np.zeros(len(numbers), BODY)
    bodies["mass"], bodies["moment"], bodies["inertia"] = numbers[:, 0], numbers[:, 1:4], numbers[:, UPPER]
    places = [np.array(each.tolist(), np.intp) for each in (model.parents, model.idx_vs, model.nvs)]
    sizes, gravity = (len(numbers), model.nv), (ctypes.c_double * 3)(*model.gravity.linear)
    arrays = *places, bodies
    return Bodies(BodiesStructure(*sizes, *map(pointer, arrays), gravity), arrays)
