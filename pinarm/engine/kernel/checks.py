"""What is checked before the compiled library gets it: places within their arrays, and numbers that are finite."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.engine.kernel.structures import LAW_BOUNDS, MOST_ROWS

if TYPE_CHECKING:
    from numpy.typing import NDArray

COORDINATES, VELOCITIES = np.array([1, 2, 4, 7, 4, 3]), np.array([1, 1, 3, 6, 3, 3])
"""Numbers in q and in v of the kinds of joints: see ``joints.h``."""


def finite(records: NDArray[Any]) -> bool:
    """Return whether all numbers of records are finite, those of records in them too; bounds of laws need not be."""
    if records.dtype.names is None:
        return bool(np.isfinite(records).all())
    return all(finite(records[name]) for name in records.dtype.names if name not in LAW_BOUNDS)


def within(first: NDArray[Any], count: NDArray[Any] | int, size: int) -> bool:
    """Return whether ``count`` places from ``first`` on are in an array of a size, all of them."""
    return bool(((first >= 0) & (first <= size - np.asarray(count))).all())


def links_are_sound(links: NDArray[np.void], nq: int, nv: int) -> bool:
    """Return whether the links of a tree have their parents before them, and each its own coordinates."""
    kinds, before = links["kind"], np.arange(len(links))
    if not len(links) or not within(kinds, 1, len(COORDINATES)) or not finite(links):
        return False
    in_q, in_v = COORDINATES[kinds], VELOCITIES[kinds]
    apart = bool(((links["parent"] >= -1) & (links["parent"] < before)).all())
    return apart and (in_q.sum(), in_v.sum()) == (nq, nv) and within(links["q"], in_q, nq) and within(
        links["v"], in_v, nv
    )  # fmt: skip


def loads_are_sound(
    degrees: NDArray[np.void], balls: NDArray[np.void], lines: NDArray[np.void], laws: NDArray[np.void], links: int,
    nq: int,
) -> bool:  # fmt: skip
    """Return whether what acts along velocities, at ball joints, between points and by laws is within the tree."""
    nv = len(degrees)
    return (
        all(map(finite, (degrees, balls, lines, laws)))
        and within(degrees["screw"]["axis"], 1, 3)
        and within(degrees["sprung"], 1, nq)
        and within(balls["q"], 4, nq)
        and within(balls["v"], 3, nv)
        and within(lines["link"] + 1, 1, links + 1)
        and bool((laws["unit"] > 0.0).all())
        and within(laws["v"], 1, nv)
        and within(laws["q"] + 1, 1, nq + 1)
    )


def loops_are_sound(loops: NDArray[np.void], links: int) -> bool:
    """Return whether the frames of loop joints are on links of a tree, and their rows within their room."""
    rows = within(loops["rows"] - 1, 1, MOST_ROWS)
    return bool(len(loops)) and rows and within(loops["link"] + 1, 1, links + 1) and finite(loops)
