"""The instants of a table, and the memory that its rows need."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.yaml.schema import InputStruct, Time

MEMORY = 2_000_000_000
"""Most memory that rows may need [bytes]: a million rows of a robot with nine joints and seven outputs need as much."""

A_ROW, A_NUMBER = 150, 40
"""Memory that a run needs at its peak for each row and for each number of a row [bytes], of which results keep 8.

Measured on runs of 300,000 to 10 million rows, of open chains and loops: 33 to 40 a number. Places and wrenches of
links take up to three times as much.
"""


class TimeGrid(InputStruct, frozen=True):
    """Evenly spaced instants; those at which a law or load jumps are added, twice each: just before and just after.

    Attributes:
        start: First instant [s].
        end: Last instant [s].
        samples: Number of instants.
    """

    end: Time
    start: Time = 0.0
    samples: Annotated[int, msgspec.Meta(ge=2, le=10_000_000)] = 201

    def check(self) -> None:
        with within("end"):
            if not self.end - self.start < math.inf:
                raise InputError("the time has no finite length")
            if not self.end > self.start:
                raise InputError(f"the time ends at {self.end:g} s, not after its start at {self.start:g} s")

    def instants(self) -> Array:
        """Return the instants [s], shape (samples,)."""
        return np.linspace(self.start, self.end, self.samples)


def require_memory(rows: int, model: pin.Model, outputs: int, key: str) -> None:
    """Raise where the rows of a run need more memory than there may be."""
    numbers = 1 + model.nq + 3 * model.nv + outputs
    size = A_ROW + A_NUMBER * numbers
    if rows * size > MEMORY:
        raise InputError(
            f"{rows} rows of {numbers} numbers (t, q, v, a, efforts, outputs) need about {rows * size / 1e9:.3g} GB",
            expected=f"at most {MEMORY / 1e9:g} GB: {MEMORY // size} rows of this mechanism with these outputs",
            hint=f"a smaller {key}, fewer outputs, or several runs of a part of the rows each",
        )
