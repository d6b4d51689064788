"""The engines: one module each, which makes of a problem the settings that are worth trying."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.race.problems import Problem

Run = Callable[[], np.ndarray]

ENGINES = {
    "pinarm": "pinarm",
    "pinocchio": "Pinocchio + SciPy",
    "mujoco": "MuJoCo",
    "drake": "Drake",
    "exudyn": "Exudyn",
}
"""Module of this package -> name for people."""


WORKERS = os.cpu_count() or 1
"""Threads or processes that a batch may use."""


class Unable(Exception):
    """The engine has no way to answer this problem; the message says why."""


@dataclass(frozen=True)
class Setting:
    """One way to answer a problem.

    Attributes:
        method: Of the integration, with whatever else is chosen.
        value: Tolerance or step; a method's settings follow each other from the coarsest to the finest.
        make: Builds the model, and returns what gives the answer; only the latter is timed.
    """

    method: str
    value: float
    make: Callable[[], Run]


def prepare(engine: str, problem: Problem) -> list[Setting]:
    """Return the settings of an engine for a problem, its model built.

    Raises:
        Unable: It is not installed, or cannot do it.
    """
    try:
        module = import_module(f"{__name__}.{engine}")
    except ImportError as error:
        raise Unable(f"not installed ({error})") from None
    settings: list[Setting] = module.prepare(problem)
    return settings


def flown(places: np.ndarray, turned: Rotation, joints: np.ndarray) -> np.ndarray:
    """Return the answer for a linkage that flies: places, entries of rotation matrices and angles, row by row."""
    return np.concatenate([places, turned.as_matrix().reshape(-1, 9), joints], axis=1)


def decades(first: float, last: float, per_decade: int) -> list[float]:
    """Return tolerances from 10^-first to 10^-last."""
    count = round((last - first) * per_decade) + 1
    return [10.0 ** -(first + k / per_decade) for k in range(count)]


def halvings(first: int, last: int) -> list[int]:
    """Return numbers of steps between samples: 1, 2, 3, 4, 6, 8, 12 ... between the two."""
    powers = [2**k for k in range(20)]
    return [n for n in sorted({*powers, *(3 * n // 2 for n in powers[1:])}) if first <= n <= last]
