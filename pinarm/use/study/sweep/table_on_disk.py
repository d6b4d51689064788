"""A table of numbers in a file, so that memory does not grow with its length."""

from __future__ import annotations

import mmap
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError
from pinarm.use.output.manifest import DRAFT

BLOCK = 1 << 17
"""Numbers that are written at once."""


def table_on_disk(rows: int, columns: int, folder: Path) -> Array:
    """Return a table that can be written, all NaN at first, shape (rows, columns), one column after the other.

    The system keeps as much of it in memory as there is room for. Its file has no name and goes with the table, however
    the process ends; its bytes are taken from the disk at once, as a full one could not be told later.

    Raises:
        InputError: There is no room for it, or its folder cannot be written.
    """
    block, left = np.full(BLOCK, np.nan), rows * columns
    try:
        with TemporaryFile(dir=folder, prefix=DRAFT) as file:
            for begin in range(0, left, BLOCK):
                file.write(block[: left - begin].tobytes())
            file.flush()
            mapped = mmap.mmap(file.fileno(), 8 * left)
    except OSError as error:
        raise InputError(f"a table of {rows} cases cannot be written in {folder}: {error.strerror}") from None
    return np.frombuffer(mapped).reshape(columns, rows).T
