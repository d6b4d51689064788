"""Duty cycle of a joint, for any motor and gear: its effort and motion, and the integrals of rms torques.

With v and a of the joint, the effort tau that goes through the gear, its efficiency eta, and

    y = tau / eta  where the motor drives (tau v >= 0),    y = eta tau  where the load drives it,

with the direction of the motion (``motion.standstill``) where the joint stands still for an instant, a motor of the
rotor inertia J behind a gear of the ratio N gives the torque ``T = J N a + y / N``, so that

    rms(T)² = (J² N² A + 2 J B + C / N²) / L,    A = ∫ a² dt,  B = ∫ a y dt,  C = ∫ y² dt,

for a cycle of the length L: three integrals serve all motors and ratios. The least rms torque of a motor is at
``N² = C^(1/2) / (J A^(1/2))``, which is ``J_load / J`` where a constant inertia is all the load.

The inertia that the drive feels is the effort of the masses per acceleration. With the velocities v that the mechanism
can have, in which the driven coordinate moves at 1 and the coordinates of the other drives are held, and the mass
matrix M, it is the least ``vᵀ M v``: joints that nothing drives give way as they do when the coordinate is accelerated
from rest. Weights, springs and losses have no part in it. Where one drive moves the
mechanism it is ``2 T / w²``, with the kinetic energy T at the speed w.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.constraint_rows import rows_of
from pinarm.engine.motion.standstill import at_rest, directions
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.records import Record
from pinarm.use.result.curve_figures import ROUNDING, integrals
from pinarm.use.result.row_lookup import PLATEAU, Lookup

HELD = 1e-10
"""Singular value of what drives do to the free motions, relative to the largest, below which one holds the others."""

SAMPLES = 2000
"""Instants at which torques of all candidates, energies and temperatures are evaluated, spread over the intervals of a
run by their lengths, besides eight in each."""

Columns = Callable[[Quantities], tuple[Array, Array, Array]]
"""Rows -> velocity, acceleration and y of the joint, each of shape (n,)."""

Height = Callable[[Array, Array, Array], Array]
"""Velocity, acceleration and y of the joint -> values, all of shape (n,)."""

Known = tuple[float, float]
"""A number and its error."""


def load_inertia(run: Trajectory, coordinate: str) -> Array:
    """Return the inertia that the drive of a coordinate feels in every row, rotors included, shape (n,).

    It is in kg*m^2 or kg, and infinite where the coordinate cannot move while the other drives are held.

    Args:
        run: The rows.
        coordinate: Name of the driven coordinate.
    """
    mechanism = run.mechanism
    names = [coordinate, *(name for name in run.drives if name != coordinate)]
    rows = rows_of(mechanism.model, [mechanism.coordinate(name) for name in names], run.q)
    free = mechanism.closure.split_at(run.q).free
    reduced = free.swapaxes(1, 2) @ run.dynamics.mass_matrices(run.q) @ free
    return np.array([_felt(way, mass) for way, mass in zip(rows @ free, reduced, strict=True)])


def _felt(ways: Array, mass: Array) -> float:
    """Return the least ``uᵀ M u`` of free motions u, shape (f,), with ``ways u = (1, 0, ..)``; ways of shape (d, f)."""
    left, sizes, right = np.linalg.svd(ways)
    if len(sizes) < len(ways) or not sizes[-1] > HELD * sizes[0]:
        return np.inf
    u = right[: len(sizes)].T @ (left[0] / sizes)
    passive = right[len(sizes) :]
    if len(passive):
        u = u - passive.T @ np.linalg.lstsq(passive @ mass @ passive.T, passive @ (mass @ u))[0]
    return float(u @ mass @ u)


class Duty(Record, frozen=True):
    """One cycle of a joint.

    Attributes:
        run: The run.
        columns: What gives velocity, acceleration and y of its rows.
        t: Instants [s], shape (n,).
        v: Velocity of the joint [rad/s or m/s], shape (n,).
        a: Its acceleration, shape (n,).
        y: Effort at the gear's input times the ratio, efficiency included [N*m or N], shape (n,).
        load_inertia: Mean of what it feels of the masses, its own rotor left out, weighted with the square of the speed
            [kg*m^2 or kg], and its error; see ``load_inertia``.
        fastest: Largest size of the velocity, and its error.
        integrals: A, B, C and the integral of the size of the velocity, and their errors, shape (2, 4).
        rest: How long the joint is held by a brake after the motion, the motor without torque [s].
    """

    run: Lookup
    columns: Columns
    t: Array
    v: Array
    a: Array
    y: Array
    load_inertia: Known
    fastest: Known
    integrals: Array
    rest: float

    @property
    def length(self) -> float:
        return float(self.t[-1] - self.t[0]) + self.rest

    def torque(self, inertia: float, ratio: float) -> Array:
        return inertia * ratio * self.a + self.y / ratio

    def terms(self, inertia: float, ratio: float) -> float:
        return float(inertia * ratio * np.abs(self.a).max() + np.abs(self.y).max() / ratio)

    def rms_torque(self, inertia: float, ratio: float) -> Known:
        """Return the root of the mean square of T over the cycle [N*m].

        Where the rotor and the load nearly cancel, as a spring in resonance does, few digits of the square are left:
        with the error e of the square s the root is wrong by ``e / s^(1/2)`` at most, and by ``e^(1/2)``.
        """
        factors = np.array([(inertia * ratio) ** 2, 2.0 * inertia, 1.0 / ratio**2]) / self.length
        squares, errors = self.integrals[:, :3]
        terms = factors * squares
        root = max(float(terms.sum()), 0.0) ** 0.5
        error = float(factors @ errors + ROUNDING * np.abs(terms).sum())
        return root, error**0.5 if error >= root**2 else error / root

    def best_ratio(self, inertia: float) -> float:
        """Return the ratio of the least rms torque for a rotor inertia; infinite without one."""
        a, _, c, _ = self.integrals[0]
        return float((c / a) ** 0.25 / inertia**0.5) if a * inertia > 0.0 else float("inf")

    def mean_speed(self) -> Known:
        way, error = self.integrals[:, 3]
        return float(way / self.length), float(error / self.length)

    def largest(self, height: Height, terms: float) -> Known:
        """Return the largest of a function that is not negative, between instants too.

        Args:
            height: The function.
            terms: Size of what it sums.
        """

        def heights(rows: Quantities) -> Array:
            return height(*self.columns(rows))

        row, error = self.run.highest(heights, "the load of the motor", PLATEAU * terms)
        return float(heights(row)[0]), error

    def parts(self, product: Height, scale: float) -> tuple[Known, Known]:
        """Return the integrals of the positive and of the negative part of a function, both positive.

        Args:
            product: The function.
            scale: Its size, or that of the terms that it sums.
        """
        scale = scale or 1.0

        def parts(rows: Quantities) -> Array:
            values = product(*self.columns(rows)) / scale
            return np.stack([np.maximum(values, 0.0), np.maximum(-values, 0.0)], axis=1)

        total, error = integrals(self.run, parts)
        rounding = ROUNDING * float(np.ptp(self.run.run.grid.cuts))
        delivered, taken = zip((scale * total).tolist(), (scale * (error + rounding)).tolist(), strict=True)
        return delivered, taken

    def energy(self, inertia: float, ratio: float) -> tuple[float, float]:
        """Return the energy that a motor gives in a cycle, and what it takes back [J], both positive, of instants."""
        power = self.torque(inertia, ratio) * ratio * self.v
        delivered, taken = (np.trapezoid(np.maximum(sign * power, 0.0), self.t) for sign in (1.0, -1.0))
        return float(delivered), float(taken)

    def warmest(self, load: Array, time_constant: float) -> Known:
        """Return the peak of ``x' = (u - x) / T`` when cycles of the heat u follow each other for ever.

        Its error is the difference to that of every other instant.

        Args:
            load: u at the instants, shape (n,); 0 while the joint rests.
            time_constant: T [s].
        """
        half = np.unique(np.append(np.arange(0, len(self.t), 2), len(self.t) - 1))
        peak, rough = (_peak(self.t[k], load[k], self.rest, time_constant) for k in (slice(None), half))
        return peak, abs(peak - rough) + ROUNDING * len(load) * peak


def _peak(t: Array, load: Array, rest: float, time_constant: float) -> float:
    steps = np.diff(t) / time_constant
    course = np.append(0.0, _recursion(np.exp(-steps), -np.expm1(-steps) * 0.5 * (load[:-1] + load[1:])))
    returned = -np.expm1(-(t[-1] - t[0] + rest) / time_constant)
    start = course[-1] * np.exp(-rest / time_constant) / returned
    return float((course + start * np.exp(-(t - t[0]) / time_constant)).max())


def _recursion(factors: Array, terms: Array) -> Array:
    """Return x_k = factors_k x_(k-1) + terms_k from x = 0, shape (n,)."""
    x, values = 0.0, []
    for factor, term in zip(factors.tolist(), terms.tolist(), strict=True):
        x = factor * x + term
        values.append(x)
    return np.array(values)


def duty_of(run: Lookup, coordinate: str, armature: float, efficiency: float, rest: float) -> Duty:
    """Return the cycle of what a motor drives in a run.

    Args:
        run: The run; its rows are states of one motion in time.
        coordinate: Name of the driven coordinate.
        armature: What its effort in the run counts of the rotor of its own drive [kg*m^2 or kg].
        efficiency: Of the gear.
        rest: How long the joint is held by a brake after the motion [s].
    """
    names = [f"coordinate.{coordinate}.{part}" for part in ("velocity", "acceleration", "effort")]
    rates = [run.quantities.determined(name).values for name in names][:2]
    pace = np.array([[np.abs(rate).max()] for rate in rates])  # of the whole run, whichever states are looked at

    def columns(rows: Quantities) -> tuple[Array, Array, Array]:
        v, a, effort = (rows[name].values for name in names)
        tau, sides = effort - armature * a, rows.trajectory.grid.sides()
        inside = _inside(run, rows, names[0], at_rest(v[:, None], a[:, None], pace)[:, 0])
        direction = directions(v[:, None], a[:, None], pace, sides, inside[:, None])[:, 0]
        return v, a, tau * np.where(tau * direction < 0.0, efficiency, 1.0 / efficiency)

    v, a, y = columns(run.quantities)
    scale = np.array([np.abs(of).max() or 1.0 for of in (v, a, y)])

    def products(rows: Quantities) -> Array:
        v, a, y = (of / size for of, size in zip(columns(rows), scale, strict=True))
        return np.stack([a * a, a * y, y * y, np.abs(v)], axis=1)

    def size(k: int, rows: Quantities) -> Array:
        return np.abs(columns(rows)[k])

    sizes = np.array([scale[1] ** 2, scale[1] * scale[2], scale[2] ** 2, scale[0]])
    moments = sizes * integrals(run, products)
    fastest, *_ = (
        run.highest(partial(size, k), f"the {what} of '{coordinate}'")
        for k, what in enumerate(("velocity", "acceleration", "effort"))
    )
    speed = float(size(0, fastest[0])[0]), fastest[1]
    instants = _evenly(run, columns)
    felt, error = _mean_inertia(run, names[0], lambda rows: load_inertia(rows, coordinate))
    inertia = felt - armature, error + ROUNDING * armature
    return Duty(run, columns, *instants, inertia, speed, moments, rest)


def _inside(run: Lookup, rows: Quantities, velocity: str, still: Flags) -> Array:
    """Return velocities a little inside the intervals of rows that stand still, 0 of others, shape (n,)."""
    velocities, beside = np.zeros(len(still)), np.flatnonzero(still)
    if run.motion and len(beside):
        grid = rows.trajectory.grid.some(beside).moved_inside()
        velocities[beside] = rows.of(run.motion.at(grid))[velocity].values
    return velocities


def _evenly(run: Lookup, columns: Columns) -> tuple[Array, Array, Array, Array]:
    """Return instants all over a run, the ends of its intervals on both sides among them, and the columns there."""
    whole = run.run.grid.cuts[-1] - run.run.grid.cuts[0]
    parts = []
    for interval, (start, end, _) in enumerate(run.intervals):
        if end > start:
            t = np.linspace(start, end, 8 + round(SAMPLES * (end - start) / whole))
            parts.append((t, *columns(run.quantities_at(interval, t))))
    t, v, a, y = (np.concatenate(column) for column in zip(*parts, strict=True))
    return t, v, a, y


def _mean_inertia(run: Lookup, velocity: str, inertia: Callable[[Trajectory], Array]) -> Known:
    """Return the mean of an inertia, weighted with the square of the speed; of the time where it rests.

    Twice the mean kinetic energy over the mean square of the speed: finite where the motion passes a dead point.

    Args:
        run: The run.
        velocity: Name of the velocity.
        inertia: Rows -> the inertia, shape (n,).
    """
    fastest = float(np.abs(run.quantities[velocity].values).max())
    size = inertia(run.run)
    scale = float(size[np.isfinite(size)].max(initial=0.0)) or 1.0

    def products(rows: Quantities) -> Array:
        weights = (rows[velocity].values / fastest) ** 2 if fastest else np.ones(len(rows.trajectory))
        felt, energies = inertia(rows.trajectory) / scale, np.zeros_like(weights)
        return np.stack([np.multiply(felt, weights, out=energies, where=weights > 0.0), weights], axis=1)

    try:
        (energy, square), errors = integrals(run, products)
    except InputError:  # the coordinate is held by other drives
        return np.inf, 0.0
    mean = scale * float(energy / square)
    return mean, float((scale * errors[0] + abs(mean) * errors[1]) / square)
