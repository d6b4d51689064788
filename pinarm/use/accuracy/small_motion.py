"""A linear analysis checked by the integrator: small free motions against ``exp(A t) x``, of two amplitudes.

A motion of the amplitude e differs from the linear one by ``e^2`` and higher powers. What is left of the difference at
e and e/2, relative to the amplitude, where e goes to 0, is the error of A.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.linear.linear_states import Linearisation
from pinarm.errors import PinarmError, nowhere
from pinarm.mechanics.ball_joints import coordinate_at, places_of
from pinarm.mechanics.forces.along_coordinate import CoordinateEffort
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.laws import Constant, ConstantSpeed
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.time_grid import TimeGrid
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.motion.trajectory import Trajectory
    from pinarm.problems.linear import Linear
    from pinarm.use.result.result import Result

AMPLITUDE, SAMPLES = 1e-4, 21
"""Largest deviation of a joint [rad or m], and instants of the motion."""

GROWTH, ANGLE = 10.0, 200.0
"""Largest growth of the motion, and largest angle of its fastest mode [rad]."""

LEAST = 1e-3
"""Size of a deviation, relative to the largest, below which its difference is relative to this part of the largest."""

TOLERANCE = 1e-12
"""Of the integrator: 1e-8 of the amplitude, as the second order that extrapolation leaves."""


def checked_by_motion(result: Result) -> Result:
    """Return the result of a linear analysis with what a small motion of the integrator tells of it.

    The figure ``small motion`` is the difference from the linear motion for the amplitude 0, relative to its largest
    deviation; ``linear up to`` is the amplitude at which it is 1 % [rad or m].
    """
    problem: Linear = result.scenario.problem  # type: ignore[assignment]
    linear = problem.linearisation(result.trajectory.mechanism, Accuracy(), nowhere)
    if not len(linear.modes.eigenvalues):
        return result
    figures = dict[str, float]()
    try:
        whole, half = (_difference(result, linear, amplitude) for amplitude in (AMPLITUDE, 0.5 * AMPLITUDE))
    except PinarmError as error:
        note = f"no small motion of the integrator checks the modes: {error.message}"
    else:
        left, bent = float(np.abs(2.0 * half - whole).max()), 2.0 * float(np.abs(whole - half).max())
        figures["small motion"] = left
        note = f"a small motion of the integrator differs from exp(A t) x by {left:.1e} of its size"
        if bent > 0.01 * AMPLITUDE:
            figures["linear up to"] = 0.01 * AMPLITUDE / bent
            note += f"; by 1 % at the amplitude {figures['linear up to']:.1g} rad or m"
    outcome = replace(result.outcome, notes=(*result.outcome.notes, note))
    return replace(result, outcome=outcome, figures={**result.figures, **figures})


def _difference(result: Result, linear: Linearisation, amplitude: float) -> Array:
    """Return the difference of a motion from the linear one, relative to its largest deviation, shape (n (e + d),)."""
    from scipy.linalg import expm

    motion, state = linear.motion, result.trajectory
    a, x = motion.a[np.ix_(motion.free, motion.free)], _start(linear)
    t = np.linspace(0.0, _duration(linear), SAMPLES)
    predicted = np.array([expm(a * instant) @ x for instant in t])
    whole = np.zeros(len(motion.a))
    whole[motion.free] = amplitude * x
    model, q, v = state.mechanism.model, state.q[0], state.v[0]
    start = pin.integrate(model, q, motion.position @ whole)
    rows = _forward(result, linear, start, v + motion.velocity @ whole, float(t[-1]))
    steady = [pin.integrate(model, q, instant * v) for instant in t]
    apart = np.array([pin.difference(model, *pair) for pair in zip(steady, rows.q, strict=True)])
    moved = np.hstack([apart[:, motion.placed], (rows.v - v)[:, motion.independent]]) / amplitude
    sizes = np.abs(predicted).max(axis=0)
    positions, velocities = sizes[: len(motion.placed)], sizes[len(motion.placed) :]
    least = np.concatenate([np.maximum(part, LEAST * part.max()) for part in (positions, velocities)])
    return np.asarray((moved - predicted) / least).ravel()


def _start(linear: Linearisation) -> Array:
    """Return a state in which all modes move, the largest deviation 1, shape (e + d,)."""
    vectors, half = linear.modes.vectors, len(linear.motion.placed)
    sizes = np.abs(vectors[:half]).max(axis=0)
    x = (vectors / np.where(sizes > 0.0, sizes, 1.0)).real.sum(axis=1)
    return np.asarray(x / np.abs(x[:half]).max())


def _duration(linear: Linearisation) -> float:
    """Return the duration of the motion [s]: a turn of the slowest mode, less where it grows or others are fast."""
    eigenvalues = linear.modes.eigenvalues
    rates = np.abs(eigenvalues)[eigenvalues != 0.0]
    if not len(rates):
        return 1.0
    growth = max(float(eigenvalues.real.max()), 0.0)
    most = np.log(GROWTH) / growth if growth else np.inf
    return float(min(2.0 * np.pi / rates.min(), ANGLE / rates.max(), most))


def _forward(result: Result, linear: Linearisation, q: Array, v: Array, end: float) -> Trajectory:
    """Return the rows of a free motion from a state: constant drive efforts, no controllers, forces of the state."""
    problem: Linear = result.scenario.problem  # type: ignore[assignment]
    mechanism, drives, motion = result.trajectory.mechanism, linear.drives, linear.motion
    mechanism = replace(mechanism, forces=linear.state.dynamics.forces, control=())
    here = Kinematics.at(mechanism.model, q)
    positions = {name: coordinate_at(mechanism.model, k).value(here) for k, name in enumerate(linear.joints)}
    chosen = {linear.joints[k] for k in motion.placed.tolist()}
    places = places_of(mechanism.joints, mechanism.balls)
    loads, laws = dict[str, Any](), dict[str, Any]()
    for name, coordinate, prescribed, effort in zip(
        drives.names, drives.coordinates, drives.prescribed, drives.efforts.tolist(), strict=True
    ):
        if prescribed:
            laws[name] = ConstantSpeed(speed=problem.about.steady.get(name, 0.0), start=coordinate.value(here))
        elif effort:
            loads[f"effort of {name}"] = CoordinateEffort(coordinate=name, effort=Constant(value=effort))
    question = Forward(
        time=TimeGrid(end=end, samples=SAMPLES),
        motion=laws,
        loads=loads,
        start={name: value for name, value in positions.items() if name not in chosen},
        initial=InitialState(
            position={name: positions[name] for name in chosen},
            velocity={name: float(v[place]) for name, place in places.items() if place in motion.independent},
        ),
    )
    return question.solve(mechanism, Accuracy(tolerance=TOLERANCE), nowhere).rows
