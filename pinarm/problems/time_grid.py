"""The instants of a table."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, within
from pinarm.input.yaml.schema import InputStruct, Time


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
        """Refuse a time that does not go forward."""
        with within("end"):
            if not self.end - self.start < math.inf:
                raise InputError("the time has no finite length")
            if not self.end > self.start:
                raise InputError(f"the time ends at {self.end:g} s, not after its start at {self.start:g} s")

    def instants(self) -> Array:
        """Return the instants [s], shape (samples,)."""
        return _even(self.start, self.end, self.samples).copy()


@lru_cache(maxsize=1)
def _even(start: float, end: float, samples: int) -> Array:
    """Return evenly spaced numbers, which a run of few rows copies in a tenth of the time."""
    return np.linspace(start, end, samples)
