"""The one array type, double precision, and checks of arrays that a user gives; docstrings give shapes and units."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pinarm.errors import InputError
from pinarm.records import Record

if TYPE_CHECKING:  # it writes documentation when it is imported
    from numpy.typing import ArrayLike, NDArray

Array = np.ndarray[tuple[Any, ...], np.dtype[np.float64]]
Complex = np.ndarray[tuple[Any, ...], np.dtype[np.complex128]]
Indices = np.ndarray[tuple[Any, ...], np.dtype[np.intp]]
Flags = np.ndarray[tuple[Any, ...], np.dtype[np.bool_]]

STEP = 1e-30
"""Imaginary step h of complex steps: its square vanishes beside 1, and no difference is taken."""

AT_KINK = 1e-9
"""Change of a state in SI, rad or N, that would bring a size to 0: it is rounding of one that is 0."""


def real(x: ArrayLike, name: str) -> Array:
    """Return an array of real numbers; in SI, where something with a unit is given.

    Raises:
        InputError: It is none.
    """
    if type(x) is np.ndarray and x.dtype.char == "d":
        return x
    try:
        return np.asarray(getattr(x, "si", x)).astype(np.float64, casting="same_kind", copy=False)
    except (TypeError, ValueError):
        raise InputError(f"{name} is no array of real numbers", expected="an array of them") from None


def continued(function: Callable[[Array], Sequence[Array]], x: Array) -> Array:
    """Return f(x) by a function that returns f and f' at real x; complex steps continue it to first order.

    Splines, tables and curves given by points are not analytic.
    """
    if np.isrealobj(x):
        return function(x)[0]
    value, slope = function(np.real(x))
    return np.asarray(value + 1j * slope * np.imag(x))


def magnitude(x: Array) -> Array:
    """Return ``|x|``; complex steps continue it to first order, and are refused at 0: see ``length``."""
    if np.isrealobj(x):
        return np.asarray(np.abs(x))
    _require_no_kink(np.abs(np.real(x)), np.abs(np.imag(x)))
    return np.asarray(x * np.sign(np.real(x)))


def length(vectors: Array) -> Array:
    """Return lengths of vectors, shape (.., 3) to (..,); complex steps continue them to first order.

    Raises:
        FloatingPointError: A complex step changes a vector that is 0: its length has a kink there.
    """
    if np.isrealobj(vectors):
        return np.asarray(np.linalg.norm(vectors, axis=-1))
    _require_no_kink(*(np.linalg.norm(part, axis=-1) for part in (np.real(vectors), np.imag(vectors))))
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


def _require_no_kink(sizes: Array, steps: Array) -> None:
    change = steps / STEP
    if ((sizes <= AT_KINK * change) & (change > AT_KINK)).any():
        raise FloatingPointError("the size of what is 0 has a kink")


def vecmat(x: Array, matrices: Array) -> Array:
    """Return ``x^T M``, shapes (.., n) and (.., n, m); ``np.vecmat`` takes the conjugate of complex steps."""
    return np.asarray(np.vecmat(np.conj(x) if np.iscomplexobj(x) else x, matrices))


def as_rows(x: Array, width: int, name: str) -> Array:
    """Return an array of states as rows, shape (n, .., width), where axes between are those of variants.

    Raises:
        InputError: It has another shape, or is not of real numbers.
    """
    rows = x if type(x) is np.ndarray and x.dtype.char == "d" and x.ndim >= 2 else np.atleast_2d(real(x, name))
    if rows.shape[-1] != width:
        raise InputError(f"{name} has the shape {np.shape(x)}", expected=f"(n, {width}) or ({width},)")
    return rows


def same_rows(*arrays: Array) -> None:
    """Raise where arrays have different numbers of rows.

    Raises:
        InputError: Says how many each has.
    """
    first, *others = map(len, arrays)
    if any(count != first for count in others):
        rows = ", ".join(str(len(array)) for array in arrays)
        raise InputError(f"the arrays have {rows} rows", expected="as many in each")


def unit(vector: Array) -> Array:
    """Return the direction of a vector that is not 0, shape (k,), of any length: no square overflows or vanishes."""
    scaled = np.ldexp(vector, -np.frexp(np.abs(vector).max())[1])
    return np.asarray(scaled / np.linalg.norm(scaled))


def in_one(parts: Sequence[Array]) -> Array:
    """Return the rows of several arrays in one; of a single one itself, which keeps its order in memory."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def distinct(x: ArrayLike) -> NDArray[Any]:
    """Return the different values of an array, ascending: ``np.unique``, which imports ``numpy.ma`` for nothing."""
    ascending = np.sort(x, axis=None)
    kept: NDArray[Any] = ascending[np.concatenate([[True], ascending[1:] != ascending[:-1]])[: len(ascending)]]
    return kept


def others(places: Indices, count: int) -> Indices:
    """Return the places 0 to count - 1 that are not among the given places, ascending."""
    left = np.ones(count, dtype=bool)
    left[places] = False
    return np.flatnonzero(left)


def constants_of(x: Any) -> Hashable:
    """Return a key of the numbers in arrays and fields of a record: alike records have equal keys."""
    if isinstance(x, np.ndarray):
        return x.shape, (x + 0.0).tobytes()  # of -0 those of 0
    if isinstance(x, Record):
        return type(x), tuple(constants_of(getattr(x, name)) for name in x.__struct_fields__)
    if isinstance(x, tuple | list):
        return tuple(map(constants_of, x))
    known: Hashable = x  # a number, or a function
    return known
