"""Failures of the arithmetic of a run, in words."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import SingularMasses
from pinarm.engine.motion.outcome import Outcome
from pinarm.errors import DynamicsError
from pinarm.mechanics.forces.force_element import refusals


@contextmanager
def failures_in_words() -> Iterator[None]:
    """Raise in words what the numbers of the input cause; any other error is a fault of the program, and stays.

    Floating-point warnings are off: the results are searched for numbers that are not finite.

    Raises:
        DynamicsError: The mass matrix is singular, or a number is beyond 1e308.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except SingularMasses as error:
        raise DynamicsError(
            f"the mass matrix of this mechanism is singular ({error}): the accelerations are not determined",
            hint="numbers of ordinary size, and a mass for whatever is free to move",
        ) from error
    except (OverflowError, FloatingPointError) as error:
        raise DynamicsError(
            f"a number of this run is too large to be computed with ({error})",
            hint="numbers of ordinary size: their squares, too, lie below 1e308",
        ) from error


CHECKABLE = 1e150
"""Size of numbers whose squares, and so energies and powers, are still finite."""


def is_too_large(outcome: Outcome) -> bool:
    """Tell whether squares of coordinates, velocities, accelerations or efforts of a run overflow."""
    return bool((np.abs(_state(outcome)) >= CHECKABLE).any())


def overflow(outcome: Outcome) -> DynamicsError:
    """Return the error of a run whose numbers are too large to be checked: says from where on."""
    run = outcome.rows
    row = int((~(np.abs(_state(outcome)) < CHECKABLE)).any(axis=1).argmax())
    at = f"{run.parameter} = {run.grid.t[row]:.9g} {run.unit}"
    said = (
        f"the numbers of this run are too large to be checked, from {at} on{refusals(run.dynamics.forces, run.q[row])}"
    )
    return DynamicsError(said, hint=f"numbers of a size below {CHECKABLE:g}", partial=outcome)


def _state(outcome: Outcome) -> Array:
    run = outcome.rows
    return np.hstack([run.q, run.v, run.a, run.tau])
