"""Newton's method on the constraints of a mechanism and its prescribed coordinates, one configuration at a time.

With phi the constraints of loops and couplings, w the prescribed coordinates and J the rows of both: ``phi(q) = 0`` and
``w(q) = w_d``, then ``J v = (0, w_d')`` and ``J a = (0, w_d'') - J' v``, exact to rounding. There may be more rows than
unknowns where a loop is overconstrained. Nothing is differentiated numerically. Lengths are in the units that suit the
loops (``Closure.measure``), so that they are solved alike at any size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.constraints.closure import SMALL, Closure
from pinarm.engine.constraints.constraint_rows import joint_ties
from pinarm.engine.constraints.nullspace import MANY, RANK, UNCLOSED, VANISHED
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.kinematics.singular import (
    ENOUGH,
    at,
    check_rank,
    instant,
    is_in_states,
    on_branch,
    part_of_leap,
)
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.ball_joints import configuration
from pinarm.mechanics.coordinates import Constraint, GuidedCoordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.joints import format_configuration

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

CLOSED = 1e-12
"""Largest gap of a solved position, relative to ``1 + |w|``; Newton's method ends near 1e-16."""

CONTRACTION = 0.25
"""Largest ratio of a correction to the one before: Newton's method on its way to the only solution nearby."""

REACH = 0.3
"""Largest correction of a predicted position: beyond it the step in time is halved."""

AGREED, SHORT = 1e-7, 1e-3
"""Largest disagreement of redundant rows, relative to their terms: loops closed to rounding leave 1e-12. And the length
with which rates and centripetal terms are compared that have vanished but for rounding."""

ITERATIONS, POLISHED = 60, 4
"""Most steps in which a gap may fail to halve: slower steps count as not converging. And most steps from a closed
position until its gap is rounding."""

SMALLEST = 1e-9
"""Smallest part of a sample interval that the continuation takes at once: what lies beyond is out of reach."""

CUTS, CUTS_A_ROW = 10_000, 20
"""Cuts of the intervals between the rows of a table, in all and more for each row; a turn of a crank takes about 30."""

REDUNDANT = (
    f"; where joints hold more than the motion needs, their places to more digits ({UNCLOSED:g} of the extent, or rad, "
    "counts as rounding), or a loop joint that holds less"
)
"""Hint where only a small gap is left."""

Target = Callable[[float], tuple[Array, Array, Array]]
"""``t -> w, w', w''`` of prescribed coordinates, each of shape (k,)."""

Motion = tuple[Array, Array, Array]
"""q, v and a at one instant."""


def assembled(closure: Closure, prescribed: PrescribedCoordinates, q: Array, w: Array, t: float) -> Array:
    """Return the configuration near q with closed loops in which the coordinates have the values w, shape (k,)."""
    solver = NewtonSolver(closure, prescribed)
    return solver.assemble(q, w, t) if solver.names else q


def start_configuration(mechanism: Mechanism, start: Mapping[str, float]) -> Array:
    """Return the configuration with the given joint coordinates, shape (nq,); see ``configuration``.

    The others are those that the mechanism file gives as ``start``, or 0.
    """
    given = [name for name in mechanism.balls if any(key.startswith(f"{name}.") for key in start)]
    own = {
        key: value for key, value in mechanism.start.items() if not any(key.startswith(f"{name}.") for name in given)
    }
    return configuration(mechanism.model, mechanism.joints, mechanism.balls, {**own, **start})


class NewtonSolver:
    """Newton's method on the constraints and the prescribed coordinates of one mechanism, or of a part of it."""

    def __init__(
        self, closure: Closure, prescribed: PrescribedCoordinates, moving: Indices | slice = slice(None)
    ) -> None:
        closure = closure.holonomic
        self.closure, self.model, self.moving = closure, closure.model, moving
        self.coordinates = prescribed.coordinates
        self.whole = closure.with_guides(prescribed.names, prescribed.coordinates)
        owners = self.whole.owners()
        self.names = [constraint.name for constraint, _ in owners]
        self.units = [constraint.unit(row) for constraint, row in owners]
        self.curved = np.array([not _is_straight(constraint) for constraint, _ in owners], dtype=bool)
        self.measure, self.scale, self.cuts = self.whole.measure, closure.scale, CUTS
        threads = [constraint.helical(row) for constraint, row in owners]
        sums = [coordinate.weights for coordinate in self.coordinates if isinstance(coordinate, LinearCoordinate)]
        ties = joint_ties(closure.constraints)
        self.following = [tie for tie in ties if not any(weights[tie.rotor.v] for weights in sums)]
        self.untied = np.ones(len(self.names))
        for tie in self.following:
            self.untied[closure.slices[tie.name]] = 0.0
        self.sliding = 1.0 - np.array(threads, dtype=np.float64)
        self._last: tuple[Array, Array] | None = None

    def gap(self, state: Kinematics, w: Array) -> Array:
        """Return ``(-phi(q), w - w(q))`` in SI, shape (m + k,)."""
        gap = -self.whole.gap(state)
        gap[self.closure.size :] += w
        return gap

    def rows(self, state: Kinematics) -> Array:
        """Return J in the mechanism's units, shape (m + k, nv); rows that are 0 but for rounding are 0.

        Of a part it has the columns of the part.
        """
        if self._last is None or not np.array_equal(self._last[0], state.q):  # rates ask for those of a solution again
            rows = self.whole.rows(state)
            counts = np.sqrt((rows * rows).sum(axis=1)) > VANISHED * self.whole.reach
            self._last = (
                state.q.copy(),
                np.asarray((rows * self.scale * (counts / self.measure)[:, None])[:, self.moving]),
            )
        return self._last[1]

    def moved(self, q: Array, step: Array) -> Array:
        """Return the configuration a step away, which is in the mechanism's units."""
        return np.asarray(pin.integrate(self.model, q, self.spread(step)))

    def spread(self, x: Array) -> Array:
        """Return velocities of all joints [SI], shape (nv,), from those of the part in the mechanism's units."""
        v = np.zeros(self.model.nv)
        v[self.moving] = x
        return np.asarray(self.scale * v)

    def assemble(self, q: Array, w: Array, t: float) -> Array:
        """Return the configuration with ``w(q) = w`` that damped least-squares steps reach from q, to rounding."""
        return self._polish(self.close(q, w, t), w)

    def close(self, q: Array, w: Array, t: float) -> Array:
        """Return the configuration of ``assemble``, closed to ``CLOSED`` only.

        Nuts first slide to their places, then turn to the nearest thread: to turn all the way would take many steps.
        Joints without a body do not move the other joints, and follow them once these are closed. Joints that count
        turns begin on the turn nearest to their start.
        """
        if not self.sliding.all():
            q, _ = self.closest(q, w, self.sliding * self.untied)
        if self.following:
            q = self._followed(self.closest(q, w, self.untied)[0])
        closest, gap = self.closest(q, w, np.ones(len(self.names)))
        if not self.closed(self.closure.state(closest), gap, w):
            raise self.unreachable(closest, gap, t)
        return closest

    def _followed(self, q: Array) -> Array:
        """Return a configuration, shape (nq,), with joints without a body where what they are tied to has them."""
        closed = q.copy()
        for tie in self.following:
            closed[tie.rotor.q] -= tie.gap(self.closure.state(closed))[0]
        return closed

    def closest(self, q: Array, w: Array, weight: Array) -> tuple[Array, Array]:
        """Return the configuration with the smallest gap that damped steps from q reach, and that gap."""
        state = self.closure.state(q)
        gap, damping = weight * self.gap(state, w), 0.0
        sizes = [np.inf] * ITERATIONS
        while not self.closed(state, gap, w) and self._size(gap) <= 0.5 * sizes[-ITERATIONS]:
            rows = weight[:, None] * self.rows(state)
            step = _damped(rows, gap / self.measure, damping)
            turning = rows[self.curved].any(axis=0)  # the turns of a screw are many and need no caution
            step *= min(1.0, 0.5 / np.abs(step[turning]).max(initial=1e-300))
            trial = self.closure.state(self.moved(state.q, step))
            trial_gap = weight * self.gap(trial, w)
            before, left = self._size(gap), self._size(trial_gap)
            sizes.append(before)
            if left < before:
                state, gap, damping = trial, trial_gap, damping / 10
            else:
                damping = max(1e-3, damping * 10)
        return state.q, gap

    def _size(self, gap: Array) -> float:
        """Return the size of gaps: of many loops that of the worst, as a step of all of them opens each a little."""
        return float(np.linalg.norm(gap / self.measure, np.inf if self.model.nv > MANY else None))

    def _polish(self, q: Array, w: Array) -> Array:
        """Take further Newton steps while they close what is left: from 1e-12 two end at rounding."""
        gap = self.gap(self.closure.state(q), w) / self.measure
        for _ in range(POLISHED):
            try:
                nearer = self.moved(q, _solve(self.rows(self.closure.state(q)), gap))
            except np.linalg.LinAlgError:
                return q
            left = self.gap(self.closure.state(nearer), w) / self.measure
            if not np.abs(left).max(initial=0.0) < np.abs(gap).max(initial=0.0):
                return q
            q, gap = nearer, left
        return q

    def advance(self, q: Array, v: Array, a: Array, t: float, to: float, target: Target) -> Motion:
        """Return q, v, a at the instant ``to``, from those at t; see ``steps``."""
        *_, (_, *last) = self.steps(q, v, a, t, to, target)
        return last[0], last[1], last[2]

    def steps(
        self, q: Array, v: Array, a: Array, t: float, to: float, target: Target
    ) -> Iterator[tuple[float, Array, Array, Array]]:
        """Yield t, q, v, a after every step from the instant t to ``to``; a step is cut where its prediction is poor.

        It is cut as well where it would change sides of a singular position without coming close to it: branches that
        all but meet, as of a crank and a rod of nearly the same length, are as smooth across as along.
        """
        pending, smallest = [to], SMALLEST * abs(to - t)
        self.cuts += CUTS_A_ROW
        rows = self.rows(self.closure.state(q))
        while pending:
            h, part = pending[-1] - t, 0.5
            w, dw, ddw = target(pending[-1])
            predicted = pin.integrate(self.model, q, h * v + 0.5 * h * h * a)
            newton = self._newton(predicted, w)
            if newton is not None:
                try:
                    rates = self.rates(newton, dw, ddw, pending[-1])
                except AssemblyError:
                    if len(pending) == 1 or abs(h) <= smallest:
                        raise
                    pending[-1] = t + part * h  # between rows, and all but singular: there are others beside it
                    continue
                if self.continues(h * (rates[0] - v - h * a), predicted, newton):
                    there = self.rows(self.closure.state(newton))
                    part = part_of_leap(rows, there)
                    if part == 1.0:
                        q, (v, a), t, rows = newton, rates, pending.pop(), there
                        yield t, q, v, a
                        continue
            self.cuts -= 1
            if abs(h) <= smallest:
                raise self._lost(q, t, to, target(to)[0])
            if self.cuts < 0:
                raise InputError(
                    "the rows of the table are too far apart to follow the motion between them: after some "
                    f"{CUTS} steps it has come to {instant(t)} on the way to {instant(to)}",
                    expected="a few turns between two rows",
                    hint="more samples, a shorter range, or a slower law",
                )
            pending.append(t + part * h)

    def continues(self, turned: Array, predicted: Array, closed: Array) -> bool:
        """Return whether a solution is on the branch of its prediction; see ``on_branch``."""
        correction = np.asarray(np.abs(pin.difference(self.model, predicted, closed) / self.scale).max())
        return bool(on_branch(turned / self.scale, correction))

    def _newton(self, q: Array, w: Array) -> Array | None:
        """Return the solution near a prediction, ``None`` where it is not near or does not come."""
        size, moved = np.inf, 0.0
        while size > ENOUGH:
            state = self.closure.state(q)
            gap = self.gap(state, w)
            try:
                step = _solve(self.rows(state), gap / self.measure)
            except np.linalg.LinAlgError:
                return None
            size, before = float(np.abs(step).max()), size
            moved += size
            if not moved < REACH or not (size < CONTRACTION * before or size < ENOUGH):
                return None
            q = self.moved(q, step)
        state = self.closure.state(q)
        return q if self.closed(state, self.gap(state, w), w) else None

    def rates(self, q: Array, dw: Array, ddw: Array, t: float) -> tuple[Any, Any]:
        rows, still = self.rows(self.closure.state(q)), np.zeros(self.closure.size)
        check_rank(rows, self.names, t)
        x = self.agreed(rows, np.concatenate([still, dw]) / self.measure, 0.0, t)
        v = self.spread(x)
        state = self.closure.state(q, v)
        right = (np.concatenate([still, ddw]) - self.whole.drift(state)) / self.measure
        return v, self.spread(self.agreed(rows, right, float(np.abs(x).max()) ** 2, t))

    def agreed(self, rows: Array, right: Array, square: float, t: float) -> Array:
        """Return x with ``rows x = right``, on which redundant rows agree, unless the loops move for an instant only.

        Terms in the ``square`` of a velocity [1/s^2] may have vanished in the right-hand side but for their rounding.
        """
        x = _solve(rows, right)
        left, terms = np.abs(rows @ x - right), np.abs(rows) @ np.abs(x) + np.abs(right)
        if left.max(initial=0.0) > AGREED * (terms.max(initial=0.0) + SHORT * square):
            torn = dict.fromkeys(name for name, part in zip(self.names, left, strict=True) if part > 0.1 * left.max())
            raise AssemblyError(
                f"the position{at(t)} is singular: {', '.join(torn)} can move that way for an instant only",
                expected="a motion on which the loops stay closed",
                hint="a position beside it, or no velocity there",
                t=t,
                q=None,
            )
        return x

    def closed(self, state: Kinematics, gap: Array, w: Array) -> bool:
        """Return whether a gap is rounding of numbers; of what redundant rows leave open, of the file."""
        wanted = np.concatenate([np.zeros(self.closure.size), np.abs(w)])
        strict = CLOSED * (np.maximum(self.measure, self.whole.reach) + wanted)
        if (np.abs(gap) <= strict).all() or (np.abs(gap) > strict + self.whole.slack).any():
            return bool((np.abs(gap) <= strict).all())
        reached = self.whole.split(self.whole.rows(state)).reached(gap)
        return bool((np.abs(reached) <= strict).all())

    def _lost(self, q: Array, t: float, to: float, w: Array) -> AssemblyError:
        """Return why a branch that has come to q at t does not go on: values w out of reach at ``to``, or what else."""
        closest, gap = self.closest(q, w, np.ones(len(self.names)))
        if not self.closed(self.closure.state(closest), gap, w):
            return self.unreachable(closest, gap, to, f", as it does up to {instant(t)}")
        return AssemblyError(
            f"the motion cannot be followed beyond {instant(t)}, though the loops close at {instant(to)} on another "
            "branch",
            expected="laws and velocities that are continuous, along positions that are not singular",
            hint="a motion that keeps clear of a singular position, or another start, which chooses the branch; at "
            f"{instant(t)} it is {format_configuration(self.model, q)}",
            t=t,
            q=q,
        )

    def unreachable(self, q: Array, gap: Array, t: float, followed: str = "") -> AssemblyError:
        """Return the error of a position out of reach, with the largest gap and the closest configuration."""
        owners, given = list(zip(self.names, self.units, strict=True)), self.names[self.closure.size :]
        sizes = {owner: float(np.linalg.norm(gap[[other == owner for other in owners]])) for owner in owners}
        worst = max(sizes, key=sizes.__getitem__)
        torn = dict.fromkeys(name for (name, _), size in sizes.items() if size > 0.1 * sizes[worst])
        others = ", ".join(name for name in torn if name != worst[0])
        others = f", and with it {others}" if others else ""
        what = f"the motion is out of reach at {instant(t)}" if given else "the loops do not close"
        wanted = "a motion that the mechanism can follow" if given else "loops that close"
        if given and is_in_states():
            what, wanted = "the values are out of reach", "values that the mechanism can take"
        missed, still = (
            ("misses its value", "") if worst[0] in given else ("stays open", f", with {worst[0]} still open,")
        )
        turning = [name for name, coordinate in zip(given, self.coordinates, strict=True) if coordinate.wraps]
        counted = f"; beyond 180 deg, turns: [{', '.join(turning)}] in the mechanism file" if turning else ""
        small = (np.abs(gap) <= SMALL * self.whole.reach).all()
        return AssemblyError(
            f"{what}: {worst[0]} {missed} by {sizes[worst]:.3g} {worst[1]}{others}",
            expected=f"{wanted}{followed}; the closest it comes{still} is {format_configuration(self.model, q)}",
            hint=f"other values, or another start that chooses the branch{counted}{REDUNDANT if small else ''}",
            t=t,
            q=q,
            gap=gap,
        )


def _is_straight(constraint: Constraint) -> bool:
    """Tell whether the row of a constraint is the same in all configurations, of couplings and their like."""
    guided = isinstance(constraint, GuidedCoordinate) and isinstance(constraint.coordinate, LinearCoordinate)
    return guided or isinstance(constraint, Coupling)


def _damped(rows: Array, right: Array, damping: float) -> Array:
    """Return the x that minimises ``|rows x - right|^2 + damping^2 |x|^2``, the shortest one without damping."""
    nv = rows.shape[1]
    whole, still = np.vstack([rows, damping * np.eye(nv)]), np.zeros(nv)
    return np.asarray(np.linalg.lstsq(whole, np.concatenate([right, still]), rcond=RANK)[0])


def _solve(rows: Array, right: Array) -> Array:
    """Return x with ``rows x = right``; where there are more rows than unknowns they agree, to rounding."""
    if rows.shape[0] == rows.shape[1]:
        return np.asarray(np.linalg.solve(rows, right))
    return np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0])
