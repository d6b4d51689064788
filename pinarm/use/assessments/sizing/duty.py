"""What a joint asks of any motor and gear over one cycle: its effort and motion, and the integrals of rms torques.

With v and a of the joint, the effort tau that goes through the gear, its efficiency eta, and

    y = tau / eta  where the motor drives (tau v >= 0),    y = eta tau  where the load drives it,

a motor of the rotor inertia J behind a gear of the ratio N gives the torque ``T = J N a + y / N``, so that

    rms(T)² = (J² N² A + 2 J B + C / N²) / L,    A = ∫ a² dt,  B = ∫ a y dt,  C = ∫ y² dt,

for a cycle of the length L: three integrals serve all motors and ratios. The least rms torque of a motor is at
``N² = C^(1/2) / (J A^(1/2))``, which is ``J_load / J`` where a constant inertia is all the load.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.motion.standstill import directions
from pinarm.engine.quantities.names import Quantities
from pinarm.use.assessments.sizing.load_inertia import load_inertia
from pinarm.use.result.figures.curve_figures import ROUNDING, integrals
from pinarm.use.result.row_lookup import Lookup

SAMPLES = 2000
"""Instants at which peaks and temperatures are looked at, spread over the intervals of a run by their lengths, besides
eight in each, and all at which integrals and the largest velocity, acceleration and effort were looked for."""


Columns = Callable[[Quantities], tuple[Array, Array, Array]]
"""Rows -> velocity, acceleration and y of the joint, each of shape (n,)."""


@dataclass(frozen=True)
class Duty:
    """One cycle of a joint.

    Attributes:
        t: Instants [s], shape (n,).
        v: Velocity of the joint [rad/s or m/s], shape (n,).
        a: Its acceleration, shape (n,).
        y: Effort at the gear's input times the ratio, efficiency included [N*m or N], shape (n,).
        load_inertia: Mean of what it feels of the masses, its own rotor left out, weighted with the square of the speed
            [kg*m^2 or kg]; see ``load_inertia``.
        squares: A, B and C.
        errors: Of A, B and C, by their quadrature.
        rest: How long the joint is held by a brake after the motion, the motor without torque [s].
    """

    t: Array = field(repr=False)
    v: Array = field(repr=False)
    a: Array = field(repr=False)
    y: Array = field(repr=False)
    load_inertia: float
    squares: tuple[float, float, float]
    errors: tuple[float, float, float]
    rest: float

    @property
    def length(self) -> float:
        """Length L of the cycle, its rest included [s]."""
        return float(self.t[-1] - self.t[0]) + self.rest

    def torque(self, inertia: float, ratio: float) -> Array:
        """Return the torque T of a motor [N*m], shape (n,)."""
        return inertia * ratio * self.a + self.y / ratio

    def rms_torque(self, inertia: float, ratio: float) -> tuple[float, float]:
        """Return the root of the mean square of T over the cycle, and its error [N*m].

        Where the rotor and the load nearly cancel, as a spring in resonance does, few digits of the square are left:
        with the error e of the square s the root is wrong by ``e / s^(1/2)`` at most, and by ``e^(1/2)``.
        """
        factors = np.array([(inertia * ratio) ** 2, 2.0 * inertia, 1.0 / ratio**2]) / self.length
        terms = factors * self.squares
        root = max(float(terms.sum()), 0.0) ** 0.5
        error = float(factors @ self.errors + ROUNDING * np.abs(terms).sum())
        return root, error**0.5 if error >= root**2 else error / root

    def best_ratio(self, inertia: float) -> float:
        """Return the ratio of the least rms torque for a rotor inertia; infinite without one."""
        a, _, c = self.squares
        return float((c / a) ** 0.25 / inertia**0.5) if a * inertia > 0.0 else float("inf")

    def mean_speed(self) -> float:
        """Return the mean size of the velocity over the cycle, its rest included."""
        return float(np.trapezoid(np.abs(self.v), self.t) / self.length)

    def energy(self, torque: Array, ratio: float) -> tuple[float, float]:
        """Return the energy that a motor gives in a cycle, and what it takes back [J], both positive."""
        power = torque * ratio * self.v
        given, taken = (float(np.trapezoid(np.maximum(sign * power, 0.0), self.t)) for sign in (1.0, -1.0))
        return given, taken

    def warmest(self, load: Array, time_constant: float) -> float:
        """Return the peak of ``x' = (u - x) / T`` when cycles of the heat u follow each other for ever.

        Args:
            load: u at the instants, shape (n,); 0 while the joint rests.
            time_constant: T [s].
        """
        steps = np.diff(self.t) / time_constant
        fade, mean = np.exp(-steps), 0.5 * (load[:-1] + load[1:])
        course = np.concatenate([[0.0], _recursion(fade, -np.expm1(-steps) * mean)])
        decay = np.exp(-(self.t - self.t[0]) / time_constant)
        rest = np.exp(-self.rest / time_constant)
        start = course[-1] * rest / -np.expm1(-self.length / time_constant)
        return float((course + start * decay).max())


def _recursion(factors: Array, terms: Array) -> Array:
    """Return x_k = factors_k x_(k-1) + terms_k from x = 0, shape (n,)."""
    x, values = 0.0, []
    for factor, term in zip(factors.tolist(), terms.tolist(), strict=True):
        x = factor * x + term
        values.append(x)
    return np.array(values)


def duty_of(
    run: Lookup, coordinate: str, armature: float, efficiency: float, rest: float, held: Collection[str] = ()
) -> Duty:
    """Return the cycle of what a motor drives in a run.

    Args:
        run: The run; its rows are states of one motion in time.
        coordinate: Name of the driven coordinate.
        armature: What its effort in the run counts of the rotor of its own drive [kg*m^2 or kg].
        efficiency: Of the gear.
        rest: How long the joint is held by a brake after the motion [s].
        held: Joints that simplification holds on their laws; see ``load_inertia``.
    """
    names = [f"coordinate.{coordinate}.{part}" for part in ("velocity", "acceleration", "effort")]
    rates = [run.quantities.determined(name).values for name in names][:2]
    pace = np.array([[np.abs(rate).max()] for rate in rates])  # of the whole run, whichever states are looked at
    seen = list[tuple[Array, Array, Array, Array]]()

    def columns(rows: Quantities) -> tuple[Array, Array, Array]:
        v, a, effort = (rows[name].values for name in names)
        tau, sides = effort - armature * a, rows.trajectory.grid.sides()
        direction = directions(v[:, None], a[:, None], pace, sides, np.zeros((len(v), 1)))[:, 0]
        y = tau * np.where(tau * direction < 0.0, efficiency, 1.0 / efficiency)
        seen.append((rows.trajectory.grid.t, v, a, y))
        return v, a, y

    _, a, y = columns(run.quantities)
    scale = np.array([np.abs(a).max() or 1.0, np.abs(y).max() or 1.0])

    def squares(rows: Quantities) -> Array:
        _, a, y = columns(rows)
        a, y = a / scale[0], y / scale[1]
        return np.stack([a * a, a * y, y * y], axis=1)

    def size(k: int, rows: Quantities) -> Array:
        return np.abs(columns(rows)[k])

    total, error = integrals(run, squares)
    sizes = np.array([scale[0] ** 2, scale[0] * scale[1], scale[1] ** 2])
    for k, what in enumerate(("velocity", "acceleration", "effort")):
        run.highest(partial(size, k), f"the {what} of '{coordinate}'")
    t, v, inertia = _samples(run, lambda rows: (columns(rows)[0], load_inertia(rows.trajectory, coordinate, held)))
    (a_square, product, y_square), (of_a, of_both, of_y) = (total * sizes).tolist(), (error * sizes).tolist()
    mean = _mean_inertia(t, v, inertia - armature)
    t, v, a, y = _in_order(run, columns, seen)
    return Duty(t, v, a, y, mean, (a_square, product, y_square), (of_a, of_both, of_y), rest)


def _samples(run: Lookup, columns: Callable[[Quantities], tuple[Array, ...]]) -> tuple[Array, ...]:
    """Return instants all over a run, both sides of jumps among them, and the columns there."""
    whole = run.run.grid.cuts[-1] - run.run.grid.cuts[0]
    parts = []
    for interval, (start, end, _) in enumerate(run.intervals):
        if end > start:
            t = np.linspace(start, end, 8 + round(SAMPLES * (end - start) / whole))
            parts.append((t, *columns(run.quantities_at(interval, t))))
    return tuple(np.concatenate(each) for each in zip(*parts, strict=True))


def _mean_inertia(t: Array, v: Array, inertia: Array) -> float:
    """Return the mean of an inertia, weighted with the square of the speed; of the time where it rests.

    Twice the mean kinetic energy over the mean square of the speed: finite where the motion passes a dead point.
    """
    squares = v**2
    if not squares.any():
        return float(np.trapezoid(inertia, t) / (t[-1] - t[0]))
    energies = np.multiply(inertia, squares, out=np.zeros_like(squares), where=squares > 0.0)
    return float(np.trapezoid(energies, t) / np.trapezoid(squares, t))


def _in_order(run: Lookup, columns: Columns, seen: Sequence[tuple[Array, ...]]) -> tuple[Array, ...]:
    """Return all instants that were looked at, both sides of jumps among them, and the columns there.

    Args:
        run: The run.
        columns: What gives the columns.
        seen: Instants, and the columns there.
    """
    every, parts = np.concatenate([np.array(each) for each in seen], axis=1), []
    every = every[:, np.unique(every[0], return_index=True)[1]]
    for interval, (start, end, _) in enumerate(run.intervals):
        if end > start:
            ends = np.array([(start, end), *columns(run.quantities_at(interval, np.array([start, end])))])
            inside = every[:, (every[0] > start) & (every[0] < end)]
            parts.append(np.concatenate([ends[:, :1], inside, ends[:, 1:]], axis=1))
    return tuple(np.concatenate(parts, axis=1))
