"""From the motion of coordinates to that of the joints: positions, velocities and accelerations, exact to rounding.

With coordinates w imposed on a mechanism, the constraints phi of its loops and couplings, and J the rows of both:
``phi(q) = 0`` and ``w(q) = w_d(t)`` by Newton's method, then ``J v = (0, w_d')`` and ``J a = (0, w_d'') - J' v``.
There may be more rows than unknowns where a loop is overconstrained. Nothing is differentiated numerically.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.closure import Closure, Split
from pinarm.engine.mechanism import Mechanism
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate, joint_of, spelled
from pinarm.mechanics.couplings import Coupling, independent
from pinarm.mechanics.motion import Grid, MotionLaw, Values

CLOSED = 1e-12
"""Largest gap of a solved position [m or rad], relative to ``1 + |w|``; Newton's method ends near 1e-16."""

REACH = 0.3
"""Largest correction of a predicted position [rad or m]: beyond it the step in time is halved."""

SINGULAR = 1e-6
"""Smallest ratio of singular values of J that still determines velocities. Near a stretched position Newton's method
leaves an angle of the square root of ``CLOSED``, so a smaller ratio is not told from 0."""

ITERATIONS = 60

SMALLEST = 1e-9
"""Smallest part of a sample interval that the continuation takes at once: what lies beyond is out of reach."""


@dataclass(frozen=True)
class Imposed:
    """Coordinates with the laws that they follow.

    Attributes:
        names: Names of the coordinates.
        coordinates: The coordinates, in the same order.
        laws: Their laws, in the same order.
    """

    names: tuple[str, ...]
    coordinates: tuple[Coordinate, ...]
    laws: tuple[MotionLaw, ...]

    @classmethod
    def of(cls, mechanism: Mechanism, motion: Mapping[str, MotionLaw]) -> Imposed:
        """Return the imposed coordinates of a mechanism all of whose joints are to follow.

        Raises:
            InputError: A coordinate does not exist, or there are too few or too many.
        """
        coordinates = tuple(mechanism.coordinate(name) for name in motion)
        imposed = cls(tuple(motion), coordinates, tuple(motion.values()))
        imposed._check_count(mechanism)
        return imposed

    @classmethod
    def some(cls, mechanism: Mechanism, motion: Mapping[str, MotionLaw]) -> Imposed:
        """Return imposed coordinates that leave others free.

        Raises:
            InputError: A coordinate does not exist, or nothing is left free.
        """
        coordinates = tuple(mechanism.coordinate(name) for name in motion)
        if len(coordinates) >= mechanism.model.nv:
            raise InputError("every coordinate follows a law: nothing is left to integrate", hint="kind: inverse")
        return cls(tuple(motion), coordinates, tuple(motion.values()))

    def _check_count(self, mechanism: Mechanism) -> None:
        model = mechanism.model
        if model.nq != model.nv:
            raise InputError("a motion can be imposed on joints with one coordinate only; this model has others")
        rows = mechanism.closure.size  # redundant ones among them leave more freedom than this says
        if len(self.names) < model.nv - rows:
            raise self._miscounted(mechanism, model.nv - rows)
        if len(self.names) > model.nv - min(rows, 1):
            raise self._miscounted(mechanism, model.nv - min(rows, 1))

    def check_mobility(self, mechanism: Mechanism, q: Array) -> None:
        """Raise where there are more or fewer coordinates than the assembled mechanism has degrees of freedom.

        Raises:
            InputError: Says which could be added, or how many are too many.
        """
        mechanism.closure.place(q)
        mobility = Split.of(mechanism.closure.rows()).free.shape[1]
        if len(self.names) != mobility:
            raise self._miscounted(mechanism, mobility)

    def _miscounted(self, mechanism: Mechanism, mobility: int) -> InputError:
        missing = mobility - len(self.names)
        if missing > 0:
            free = [name for name in mechanism.joints if name not in self.names]
            return InputError(
                f"{mobility} coordinates have to follow a law and {len(self.names)} do",
                expected=f"laws for {missing} more, such as of the joints {', '.join(free)}",
            )
        return InputError(
            f"{len(self.names)} coordinates follow a law, but the mechanism has only {mobility} degrees of freedom",
            expected=f"{mobility} of {', '.join(self.names)}" if mobility else "a mechanism that can move",
        )

    def linear_last(self) -> tuple[Imposed, int]:
        """Return the same coordinates with those of joints, and sums of them, last; and how many others there are."""
        is_linear = [isinstance(one, LinearCoordinate) for one in self.coordinates]
        places = sorted(range(len(is_linear)), key=is_linear.__getitem__)
        ordered = Imposed(
            tuple(self.names[k] for k in places),
            tuple(self.coordinates[k] for k in places),
            tuple(self.laws[k] for k in places),
        )
        return ordered, is_linear.count(False)

    def on(self, start: float, end: float) -> Callable[[float], tuple[Array, Array, Array]]:
        """Return ``t -> w, w', w''`` of all coordinates on a stretch without jumps, each of shape (k,)."""
        functions = [law.on(start, end) for law in self.laws]

        def target(t: float) -> tuple[Array, Array, Array]:
            instant = np.array([t])
            values = [function(instant) for function in functions]
            w, dw, ddw = (np.array([value[k][0] for value in values]) for k in range(3))
            return w, dw, ddw

        return target


def follow(
    mechanism: Mechanism, imposed: Imposed, grid: Grid, start: Mapping[str, float]
) -> tuple[Array, Array, Array]:
    """Return the motion of the joints under imposed coordinates.

    Args:
        mechanism: The mechanism.
        imposed: As many coordinates as it has degrees of freedom.
        grid: Instants.
        start: Rough values of joint coordinates at the first instant [rad or m]: they choose the branch.

    Returns:
        q of shape (n, nq), v and a of shape (n, nv).

    Raises:
        AssemblyError: The positions cannot be reached; ``data`` holds the closest configuration and its gap.
    """
    q0 = start_configuration(mechanism, {**start, **_imposed_at_start(mechanism, imposed, grid)})
    couplings = [one for one in mechanism.constraints if isinstance(one, Coupling)]
    linear = all(isinstance(coordinate, LinearCoordinate) for coordinate in imposed.coordinates)
    if linear and len(couplings) == len(mechanism.constraints) and independent(couplings):
        return _follow_linear(mechanism, couplings, imposed, grid)
    return _follow_by_steps(mechanism, imposed, grid, q0)


def assembled(closure: Closure, imposed: Imposed, q: Array, w: Array, t: float) -> Array:
    """Return the configuration near q in which the loops are closed and the coordinates have the values w, shape (k,).

    Raises:
        AssemblyError: There is none that damped steps reach; ``data`` holds the closest configuration and its gap.
    """
    solver = _Solver(closure, imposed)
    return solver.assemble(q, w, t) if solver.names else q


def joint_rates(mechanism: Mechanism, imposed: Imposed, q: Array, dw: Array, ddw: Array) -> tuple[Array, Array]:
    """Return the joints' velocities and accelerations at given states of the imposed coordinates.

    Args:
        mechanism: The mechanism.
        imposed: As many coordinates as it has degrees of freedom.
        q: Configurations, shape (n, nq).
        dw: Velocities of the coordinates, the same at every row, shape (k,).
        ddw: Their accelerations, shape (k,).

    Returns:
        v and a, each of shape (n, nv).

    Raises:
        AssemblyError: A position is singular.
    """
    if not dw.any() and not ddw.any():  # at rest, which a singular position does not hinder
        return np.zeros((len(q), mechanism.model.nv)), np.zeros((len(q), mechanism.model.nv))
    solver = _Solver(mechanism.closure, imposed)
    pairs = [solver.rates(row, dw, ddw, float(i)) for i, row in enumerate(q)]
    return np.array([v for v, _ in pairs]), np.array([a for _, a in pairs])


def start_configuration(mechanism: Mechanism, start: Mapping[str, float]) -> Array:
    """Return the neutral configuration with the given joint coordinates set, shape (nq,).

    Raises:
        InputError: A joint does not exist.
    """
    q: Array = pin.neutral(mechanism.model)
    for name, value in start.items():
        q[joint_of(mechanism.joints, name).q] = value
    return q


def _imposed_at_start(mechanism: Mechanism, imposed: Imposed, grid: Grid) -> dict[str, float]:
    """Return the first values of the laws that joints follow: a way there from elsewhere may end on another branch."""
    begin, end, _ = grid.stretches()[0]
    values = imposed.on(begin, end)(float(grid.t[0]))[0]
    return {name: float(w) for name, w in zip(imposed.names, values, strict=True) if name in mechanism.joints}


def _follow_linear(
    mechanism: Mechanism, couplings: Sequence[Coupling], imposed: Imposed, grid: Grid
) -> tuple[Array, Array, Array]:
    """Solve for all instants at once: the rows are constant and there is no drift."""
    linear = [c for c in imposed.coordinates if isinstance(c, LinearCoordinate)]
    rows = np.array([one.weights for one in [*(coupling.coordinate for coupling in couplings), *linear]])
    if len(rows) != mechanism.model.nv:
        imposed.check_mobility(mechanism, pin.neutral(mechanism.model))
    _check_rank(rows, (*(coupling.name for coupling in couplings), *imposed.names), grid.t[0])
    still, n = np.zeros(len(grid.t)), len(grid.t)
    values: list[Values] = [(np.full(n, one.constant), still, still) for one in couplings]
    values += [grid.evaluate(law) for law in imposed.laws]
    solved = [np.linalg.solve(rows, np.array([value[k] for value in values])).T for k in range(3)]
    q = np.empty_like(solved[0])
    q[:, linear[0].places] = solved[0]
    return q, np.ascontiguousarray(solved[1]), np.ascontiguousarray(solved[2])


def _follow_by_steps(mechanism: Mechanism, imposed: Imposed, grid: Grid, q: Array) -> tuple[Array, Array, Array]:
    """Continue from instant to instant, each predicted from the one before by its velocity and acceleration."""
    solver = _Solver(mechanism.closure, imposed)
    n, nv = len(grid.t), solver.model.nv
    motion = np.empty((3, n, nv))
    t, v, a = grid.t[0], np.zeros(nv), np.zeros(nv)
    for begin, end, rows in grid.stretches():
        target = imposed.on(begin, end)
        for row in range(rows.start, rows.stop):
            if row == 0:
                q = solver.assemble(q, target(t)[0], t)
                imposed.check_mobility(mechanism, q)
                v, a = solver.rates(q, *target(t)[1:], t)
            else:
                q, v, a = solver.advance(q, v, a, t, grid.t[row], target)
            t = grid.t[row]
            motion[:, row] = q, v, a
    return motion[0], motion[1], motion[2]


class _Solver:
    """Newton's method on the constraints and the imposed coordinates of one mechanism."""

    def __init__(self, closure: Closure, imposed: Imposed) -> None:
        self.closure, self.model, self.data = closure, closure.model, closure.data
        self.coordinates = imposed.coordinates
        owners = self.closure.owners()
        self.names = (*(constraint.name for constraint, _ in owners), *imposed.names)
        straight = [isinstance(one, Coupling) for one, _ in owners]
        straight += [isinstance(one, LinearCoordinate) for one in imposed.coordinates]
        self.curved = ~np.array(straight, dtype=bool)
        self.units = [*(one.unit(row) for one, row in owners), *(c.unit for c in imposed.coordinates)]

    def gap(self, q: Array, w: Array) -> Array:
        """Return ``(-phi(q), w - w(q))``, shape (m + k,); leaves Jacobians and frames of q in the buffers."""
        self.closure.place(q)
        reached = np.array([coordinate.value(self.data, q) for coordinate in self.coordinates])
        return np.concatenate([-self.closure.gap(q), w - reached])

    def rows(self) -> Array:
        """Return J at the configuration last given to ``gap``, shape (m + k, nv)."""
        own = [coordinate.row(self.model, self.data) for coordinate in self.coordinates]
        return np.vstack([self.closure.rows(), *own])

    def assemble(self, q: Array, w: Array, t: float) -> Array:
        """Return the configuration with ``w(q) = w`` that damped least-squares steps reach from q.

        Raises:
            AssemblyError: They end where the gap can shrink no more.
        """
        closest, gap = self._closest(q, w)
        if self._closed(gap, w):
            return self._polish(closest, w)
        raise self._unreachable(closest, gap, t)

    def _closest(self, q: Array, w: Array) -> tuple[Array, Array]:
        """Return the configuration with the smallest gap that damped steps from q reach, and that gap."""
        gap = self.gap(q, w)
        damping = 0.0
        for _ in range(ITERATIONS):
            if self._closed(gap, w):
                break
            rows = self.rows()
            still = np.zeros(self.model.nv)
            step = np.linalg.lstsq(
                np.vstack([rows, damping * np.eye(len(still))]), np.concatenate([gap, still]), rcond=1e-12
            )[0]
            turning = rows[self.curved].any(axis=0)  # the turns of a screw are many and need no caution
            step *= min(1.0, 0.5 / np.abs(step[turning]).max(initial=1e-300))
            trial = pin.integrate(self.model, q, step)
            trial_gap = self.gap(trial, w)
            if np.linalg.norm(trial_gap) < np.linalg.norm(gap):
                q, gap, damping = trial, trial_gap, damping / 10
            else:
                damping = max(1e-3, damping * 10)
                self.gap(q, w)
        return q, gap

    def _polish(self, q: Array, w: Array) -> Array:
        """Take two more Newton steps: from 1e-12 they end at rounding."""
        for _ in range(2):
            gap = self.gap(q, w)
            if np.linalg.cond(rows := self.rows()) < 1 / SINGULAR:
                q = pin.integrate(self.model, q, _solve(rows, gap))
        return q

    def advance(
        self, q: Array, v: Array, a: Array, t: float, to: float, target: Callable[[float], tuple[Array, Array, Array]]
    ) -> tuple[Array, Array, Array]:
        """Return q, v, a at the instant ``to``, from those at t; the step is cut where the prediction is poor.

        Raises:
            AssemblyError: The branch cannot be continued.
        """
        pending, smallest = [to], SMALLEST * abs(to - t)
        while pending:
            h = pending[-1] - t
            w, dw, ddw = target(pending[-1])
            found = self._newton(pin.integrate(self.model, q, h * v + 0.5 * h * h * a), w)
            if found is not None:
                q, t = found, pending.pop()
                v, a = self.rates(q, dw, ddw, t)
            elif abs(h) > smallest:
                pending.append(t + 0.5 * h)
            else:
                raise self._unreachable(*self._closest(q, target(to)[0]), to)
        return q, v, a

    def _newton(self, q: Array, w: Array) -> Array | None:
        """Return the solution near a prediction, ``None`` where it is not near or does not come."""
        moved = 0.0
        for _ in range(12):
            gap = self.gap(q, w)
            rows = self.rows()
            try:
                step = _solve(rows, gap)
            except np.linalg.LinAlgError:
                return None
            size = float(np.abs(step).max())
            moved += size
            if not moved < REACH:
                return None
            q = pin.integrate(self.model, q, step)
            if size < 1e-9:  # Newton doubles the digits: the next step would be below rounding
                return q if self._closed(gap, w) else None
        return None

    def rates(self, q: Array, dw: Array, ddw: Array, t: float) -> tuple[Any, Any]:
        """Return v and a, each of shape (nv,).

        Raises:
            AssemblyError: The position is singular: the coordinates do not determine the velocities.
        """
        self.gap(q, np.zeros(len(dw)))
        rows, still = self.rows(), np.zeros(self.closure.size)
        _check_rank(rows, self.names, t)
        v = _solve(rows, np.concatenate([still, dw]))
        drift = self.closure.drift(q, v)
        own = np.array([coordinate.drift(self.model, self.data) for coordinate in self.coordinates])
        return v, _solve(rows, np.concatenate([-drift, ddw - own]))

    def _closed(self, gap: Array, w: Array) -> bool:
        k = self.closure.size
        return bool((np.abs(gap[:k]) <= CLOSED).all() and (np.abs(gap[k:]) <= CLOSED * (1.0 + np.abs(w))).all())

    def _unreachable(self, q: Array, gap: Array, t: float) -> AssemblyError:
        worst = int(np.abs(gap).argmax())
        missed = "stays open" if worst < self.closure.size else "misses its value"
        torn = {name: None for name, size in zip(self.names, np.abs(gap), strict=True) if size > 0.1 * abs(gap[worst])}
        others = ", ".join(name for name in torn if name != self.names[worst])
        return AssemblyError(
            f"the motion is out of reach at {t:.9g}: {self.names[worst]} {missed} by {abs(gap[worst]):.3g} "
            f"{self.units[worst]}" + (f", and with it {others}" if others else ""),
            expected=f"a motion that the mechanism can follow; the closest it comes is {spelled(self.model, q)}",
            hint="other values of the law, or another start that chooses the branch",
            t=t, q=q, gap=gap,
        )  # fmt: skip


def _solve(rows: Array, right: Array) -> Array:
    """Return x with ``rows x = right``; where there are more rows than unknowns they agree, to rounding."""
    if rows.shape[0] == rows.shape[1]:
        return np.asarray(np.linalg.solve(rows, right))
    return np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0])


def _check_rank(rows: Array, names: Sequence[str], t: float) -> None:
    nv = rows.shape[1]
    singular = np.linalg.svd(rows, compute_uv=False)
    if len(rows) < nv or singular[nv - 1] < SINGULAR * singular[0]:
        weak = np.linalg.svd(rows)[0][:, min(len(rows), nv) - 1]
        tied = [name for name, weight in zip(names, weak, strict=True) if abs(weight) > 0.1]
        raise AssemblyError(
            f"the position is singular at {t:.9g}: the coordinates {', '.join(tied)} do not move independently there",
            expected="imposed coordinates that determine the velocity of every joint",
            hint="a motion that keeps clear of the straight or folded position, or other coordinates",
            t=t,
        )
