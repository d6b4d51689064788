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

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.constraint_rows import rows_of
from pinarm.engine.motion.standstill import at_rest, directions
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.use.result.curve_figures import ROUNDING, integrals
from pinarm.use.result.row_lookup import PLATEAU, Lookup

HELD = 1e-10
"""Singular value of what drives do to the free motions, relative to the largest, below which one holds the others."""


def load_inertia(run: Trajectory, coordinate: str, held: Iterable[str] = ()) -> Array:
    """Return the inertia that the drive of a coordinate feels in every row, rotors included, shape (n,).

    It is in kg*m^2 or kg, and infinite where the coordinate cannot move while the other drives are held.

    Args:
        run: The rows.
        coordinate: Name of the driven coordinate.
        held: Names of joints that follow laws beside those of ``run.drives``, as where simplification holds them.
    """
    mechanism = run.mechanism
    names = [coordinate, *(name for name in dict.fromkeys((*run.drives, *held)) if name != coordinate)]
    rows = rows_of(mechanism.model, [mechanism.coordinate(name) for name in names], run.q)
    masses, felt = run.dynamics.mass_matrices(run.q), np.empty(len(run.q))
    for places, free in mechanism.closure.free_motions(run.q):
        ways = np.einsum("ndj,fnj->ndf", rows[places], free)
        reduced = np.einsum("fnj,njk,gnk->nfg", free, masses[places], free)
        felt[places] = [_felt(way, mass) for way, mass in zip(ways, reduced, strict=True)]
    return felt


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


def rise_between(t: Array, values: Array) -> float:
    """Return by how much a curve may be above the largest of its values.

    From either end of a part of it the curve goes on no steeper than before: a concave one, as about a smooth peak,
    does so less and less. The less steep of two slopes counts, as one may be that of a jump.

    Args:
        t: Instants, ascending, shape (n,); twice where the curve may jump.
        values: Of the curve, shape (n,).
    """
    h, slopes = np.diff(t), _slopes(t, values)
    gentle = np.where(np.abs(slopes[1:]) < np.abs(slopes[:-1]), slopes[1:], slopes[:-1])
    ahead, behind = np.zeros_like(h), np.zeros_like(h)
    ahead[2:], behind[:-2] = gentle[:-1], -gentle[1:]
    reach = np.maximum(values[:-1] + h * ahead, values[1:] + h * behind)
    return float(reach.max(initial=values.max()) - values.max())


def left_of_trapezia(t: Array, values: Array) -> float:
    """Return an upper estimate of the error of the trapezoidal rule for the integral of a curve.

    A part of the length h with the second derivative f'' is wrong by ``h³ f'' / 12``, and with a jump D by ``h D / 2``;
    with the second divided difference ``f'' / 2``, or ``D / (2 h²)``, the cube of h times it is no less than either.

    Args:
        t: Instants, ascending, shape (n,); twice where the curve may jump.
        values: Of the curve, shape (n,).
    """
    h, slopes = np.diff(t), _slopes(t, values)
    bends = np.zeros(len(t))
    both = (h[1:] > 0.0) & (h[:-1] > 0.0)
    bends[1:-1] = np.where(both, np.abs(np.diff(slopes)) / np.where(both, h[1:] + h[:-1], 1.0), 0.0)
    return float((h**3 * np.maximum(bends[:-1], bends[1:])).sum())


def _slopes(t: Array, values: Array) -> Array:
    """Return the slopes between instants, 0 where two are one, shape (n - 1,)."""
    h = np.diff(t)
    return np.divide(np.diff(values), h, out=np.zeros_like(h), where=h > 0.0)


SAMPLES = 2000
"""Instants at which peaks and temperatures are looked at, spread over the intervals of a run by their lengths, besides
eight in each, and all at which integrals and the largest velocity, acceleration and effort were looked for."""


Columns = Callable[[Quantities], tuple[Array, Array, Array]]
"""Rows -> velocity, acceleration and y of the joint, each of shape (n,)."""

Known = tuple[float, float]
"""A number and its error."""


@dataclass(frozen=True)
class Duty:
    """One cycle of a joint.

    Attributes:
        t: Instants [s], shape (n,).
        v: Velocity of the joint [rad/s or m/s], shape (n,).
        a: Its acceleration, shape (n,).
        y: Effort at the gear's input times the ratio, efficiency included [N*m or N], shape (n,).
        load_inertia: Mean of what it feels of the masses, its own rotor left out, weighted with the square of the speed
            [kg*m^2 or kg], and its error; see ``load_inertia``.
        fastest: Largest size of the velocity, and its error.
        integrals: A, B, C and the integral of the size of the velocity, and their errors, shape (2, 4).
        rest: How long the joint is held by a brake after the motion, the motor without torque [s].
        course: The cycle itself; ``None`` where the instants are all that is known of it.
    """

    t: Array = field(repr=False)
    v: Array = field(repr=False)
    a: Array = field(repr=False)
    y: Array = field(repr=False)
    load_inertia: Known
    fastest: Known
    integrals: Array
    rest: float
    course: Course | None = field(default=None, repr=False)

    @property
    def length(self) -> float:
        """Length L of the cycle, its rest included [s]."""
        return float(self.t[-1] - self.t[0]) + self.rest

    def torque(self, inertia: float, ratio: float) -> Array:
        """Return the torque T of a motor [N*m], shape (n,)."""
        return inertia * ratio * self.a + self.y / ratio

    def terms(self, inertia: float, ratio: float) -> float:
        """Return the size of the terms that the torque of a motor sums [N*m]."""
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
        """Return the mean size of the velocity over the cycle, its rest included."""
        way, error = self.integrals[:, 3]
        return float(way / self.length), float(error / self.length)

    def largest(self, height: Height, terms: float) -> Known:
        """Return the largest of a function of velocity, acceleration and y at the instants, shape (n,).

        Args:
            height: The function; it is not negative.
            terms: Size of what it sums.
        """
        values = height(self.v, self.a, self.y)
        return float(values.max()), rise_between(self.t, values) + PLATEAU * terms

    def energy(self, inertia: float, ratio: float) -> tuple[Known, Known]:
        """Return the energy that a motor gives in a cycle, and what it takes back [J], both positive, of instants."""
        power = self.torque(inertia, ratio) * ratio * self.v
        delivered, taken = (
            (float(np.trapezoid(part, self.t)), left_of_trapezia(self.t, part))
            for part in (np.maximum(power, 0.0), np.maximum(-power, 0.0))
        )
        return delivered, taken

    def warmest(self, load: Array, time_constant: float) -> Known:
        """Return the peak of ``x' = (u - x) / T`` when cycles of the heat u follow each other for ever.

        Its error is what the trapezia through u leave of the heat, that of a mean for the course of u between two
        instants, ``h² |Δu| / (6 T)``, and how far x may be above both ends there where u falls below it,
        ``h |Δu| / (8 T)``.

        Args:
            load: u at the instants, shape (n,); 0 while the joint rests.
            time_constant: T [s].
        """
        h, rise = np.diff(self.t), np.abs(np.diff(load))
        steps = h / time_constant
        fade, mean = np.exp(-steps), 0.5 * (load[:-1] + load[1:])
        course = np.concatenate([[0.0], _recursion(fade, -np.expm1(-steps) * mean)])
        decay = np.exp(-(self.t - self.t[0]) / time_constant)
        rest, returned = np.exp(-self.rest / time_constant), -np.expm1(-self.length / time_constant)
        start = course[-1] * rest / returned
        heat = left_of_trapezia(self.t, load) + float((h * steps * rise).sum()) / 6.0
        above = float((steps * rise).max(initial=0.0)) / 8.0
        peak = float((course + start * decay).max())
        return peak, heat / time_constant / float(returned) + above + ROUNDING * len(load) * peak


Height = Callable[[Array, Array, Array], Array]
"""Velocity, acceleration and y of the joint -> values, all of shape (n,)."""


@dataclass(frozen=True)
class Course:
    """The cycle itself, between instants too.

    Attributes:
        run: The run.
        columns: What gives velocity, acceleration and y of its rows.
    """

    run: Lookup
    columns: Columns

    def largest(self, height: Height, terms: float) -> Known:
        """Return the largest of a function of velocity, acceleration and y.

        Args:
            height: The function; it is not negative.
            terms: Size of what it sums.

        Raises:
            InputError: It has no largest value.
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
        inside = _inside(run, rows, names[0], at_rest(v[:, None], a[:, None], pace)[:, 0])
        direction = directions(v[:, None], a[:, None], pace, sides, inside[:, None])[:, 0]
        y = tau * np.where(tau * direction < 0.0, efficiency, 1.0 / efficiency)
        seen.append((rows.trajectory.grid.t, v, a, y))
        return v, a, y

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
    t, v, a, y = _in_order(run, columns, [*seen, *_evenly(run, columns)])
    felt, error = _mean_inertia(run, names[0], lambda rows: load_inertia(rows, coordinate, held))
    inertia = felt - armature, error + ROUNDING * armature
    return Duty(t, v, a, y, inertia, speed, moments, rest, Course(run, columns))


def _inside(run: Lookup, rows: Quantities, velocity: str, still: Flags) -> Array:
    """Return velocities a little inside the intervals of rows that stand still, 0 of others, shape (n,)."""
    velocities, beside = np.zeros(len(still)), np.flatnonzero(still)
    if run.motion and len(beside):
        grid = rows.trajectory.grid.some(beside).moved_inside()
        velocities[beside] = rows.of(run.motion.at(grid))[velocity].values
    return velocities


def _evenly(run: Lookup, columns: Columns) -> list[tuple[Array, Array, Array, Array]]:
    """Return instants all over a run, and the columns there, interval by interval."""
    whole = run.run.grid.cuts[-1] - run.run.grid.cuts[0]
    parts = []
    for interval, (start, end, _) in enumerate(run.intervals):
        if end > start:
            t = np.linspace(start, end, 8 + round(SAMPLES * (end - start) / whole))
            parts.append((t, *columns(run.quantities_at(interval, t))))
    return parts


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


def _in_order(run: Lookup, columns: Columns, seen: Sequence[tuple[Array, ...]]) -> tuple[Array, ...]:
    """Return all instants that were looked at, both sides of jumps among them, and the columns there.

    Args:
        run: The run.
        columns: What gives the columns.
        seen: Instants, and the columns there.
    """
    every, parts = np.concatenate([np.array(columns_seen) for columns_seen in seen], axis=1), []
    every = every[:, np.unique(every[0], return_index=True)[1]]
    for interval, (start, end, _) in enumerate(run.intervals):
        if end > start:
            ends = np.array([(start, end), *columns(run.quantities_at(interval, np.array([start, end])))])
            inside = every[:, (every[0] > start) & (every[0] < end)]
            parts.append(np.concatenate([ends[:, :1], inside, ends[:, 1:]], axis=1))
    return tuple(np.concatenate(parts, axis=1))
