"""Arrays for the page: one run of bytes, and references into it that JSON can hold."""

from __future__ import annotations

import base64
import gzip
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEVEL = 6
"""Of compression: 9 takes twice the time for one part in a hundred."""

_CODES = {np.dtype(np.float64): "f8", np.dtype(np.float32): "f4", np.dtype(np.uint32): "u4", np.dtype(np.uint16): "u2"}


class Packing:
    """Collects arrays. The page gets them by their references ``[type, first byte, number of values]``."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, array: NDArray[Any]) -> list[str | int]:
        """Return the reference of an array of doubles, floats or unsigned integers, row by row."""
        code, raw = _CODES[array.dtype], array.astype(array.dtype.newbyteorder("<")).tobytes()
        reference: list[str | int] = [code, self._size, array.size]
        padded = raw + b"\0" * (-len(raw) % 8)  # typed arrays of the page begin at multiples of their size
        self._parts.append(padded)
        self._size += len(padded)
        return reference

    def text(self) -> str:
        """Return all bytes as text that HTML can hold."""
        return compressed(b"".join(self._parts))


def compressed(raw: bytes) -> str:
    """Return bytes as base64 of gzip; the same bytes give the same text."""
    return base64.b64encode(gzip.compress(raw, LEVEL, mtime=0)).decode("ascii")
