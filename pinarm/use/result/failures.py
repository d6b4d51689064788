"""Failures of the arithmetic of a run, in words."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from pinarm.engine.constraints.nullspace import SingularMasses
from pinarm.engine.motion.outcome import Outcome
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import DynamicsError
from pinarm.mechanics.forces.force_element import refusals
from pinarm.mechanics.joints import format_configuration


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


def too_large(run: Trajectory, row: int) -> str:
    """Return advice on coordinates or velocities whose products overflow; empty where there are none.

    Args:
        run: The rows.
        row: Number of the row whose coordinates and velocities are looked at.
    """
    rates = 0.0 if run.unknown else run.v[row]
    if not (np.abs(run.q[row]) < CHECKABLE).all() or not (np.abs(rates) < CHECKABLE).all():
        return f"smaller numbers in the laws of motion: coordinates or velocities are beyond {CHECKABLE:g} there"
    return ""


def is_too_large(outcome: Outcome) -> bool:
    """Tell whether squares of coordinates, velocities, accelerations or efforts of a run overflow."""
    run = outcome.rows
    return any(bool((np.abs(x) >= CHECKABLE).any()) for x in (run.q, run.v, run.a, run.tau))


def overflow(outcome: Outcome) -> DynamicsError:
    """Return the error of a run whose numbers are too large to be checked: says from where on."""
    run = outcome.rows
    state = np.hstack([run.q, run.v, run.a, run.tau])
    row = int((~(np.abs(state) < CHECKABLE)).any(axis=1).argmax())
    at = format_configuration(run.mechanism.model, run.q[row])
    where = f"{run.parameter} = {run.grid.t[row]:.9g} {run.unit} on, where {at}"
    reasons = refusals(run.dynamics.forces, run.q[row])
    said = f"the numbers of this run are too large to be checked, from {where}{reasons}"
    return DynamicsError(said, hint=too_large(run, row), partial=outcome)
