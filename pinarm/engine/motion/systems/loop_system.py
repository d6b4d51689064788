"""Free motion of trees, and along loops, couplings and laws: all coordinates are integrated, and rows kept closed.

The acceleration is that of Gauss's principle, ``min (a - a0)^T M (a - a0)`` with ``G a = -G' v``, a0 being that of the
tree without its constraints. After every accepted step the state is brought back onto the constraints by the least
change, measured by the masses: positions by Newton's method, velocities in one step.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import BLOCK, Closure
from pinarm.engine.constraints.nullspace import RANK, VANISHED, Decomposition, coupled_joints
from pinarm.engine.dynamics.dynamics import Dynamics, parts
from pinarm.engine.dynamics.equation import mass_matrices, mass_matrix, require_masses, solve
from pinarm.engine.integration.integrator import Interval, Manifold
from pinarm.engine.kinematics.newton import assembled
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems import KEPT, CompletedStates, Initial, efforts_of
from pinarm.engine.motion.systems.loop_motion import ITERATIONS, ROUNDED, LoopMotion, Regularity
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.motion.systems.compiled_motion import CompiledMotion

LASTING, ROUNDING = 1e-6, 1e-10
"""Part of the centripetal terms that redundant loops may leave: closed to rounding, they leave 1e-12; and what rounding
leaves where these terms vanish, relative to the square of the velocity [m]."""

REGULAR = 1e-6
"""Least singular value of G, over the largest, at which velocities may be given. At 6e-7 those of a four-bar were wrong
by 1e-4, at 1e-7 altogether."""

CLOSED, TURNED = 1e-13, 1e-15
"""Gap at which a state of a table counts as closed [m or rad]: one step more ends at rounding. And what rounding of an
angle of many turns leaves open, over the angle."""

QUICK = 1e-3
"""Part of a gap that a Newton step may leave for the next one to go by the same rows."""

LARGE = 10**7
"""Number of entries of G, of several rows of a table, that are taken apart at once."""


class LoopSystem(Record, frozen=True):
    """The whole state of a mechanism under its constraints; a tree without any has no rows.

    Attributes:
        own: Loops and couplings of the mechanism.
        rows: These, then one row for each prescribed coordinate.
        closure: ``rows`` without joint coordinates that follow laws, whose multipliers are efforts at joints.
        near: A configuration near closed ones, shape (nq,).
    """

    unshown = ("near",)

    prescribed: PrescribedCoordinates
    manifold: Manifold
    own: Closure
    rows: Closure
    closure: Closure
    near: Array

    @classmethod
    def of(cls, own: Closure, dynamics: Dynamics, prescribed: PrescribedCoordinates, near: Array) -> LoopSystem:
        """Return the system of a mechanism with its own constraints, some of whose coordinates follow laws."""
        prescribed, others = prescribed.linear_last()
        return cls(
            prescribed,
            dynamics.manifold,
            own,
            own.with_guides(prescribed.names, prescribed.coordinates),
            own.with_guides(prescribed.names[:others], prescribed.coordinates[:others]),
            near,
        )

    def begin(self, initial: Initial, start: float, end: float) -> tuple[Array, Array]:
        """Return the closed state nearest to the initial one that has what is given of it."""
        if not self.rows.size:
            return initial.q.copy(), initial.v.copy()
        w, dw, ddw = self.prescribed.on(start, end)(start)
        everything, values = initial.known(self.prescribed, self.rows)
        q = assembled(self.own, everything, initial.q, np.array([*w, *values]), start)
        self.require_independent(q)
        require_masses(self.rows, q[None], start)
        v = self._velocity(q, initial, dw)
        self._check_lasting(q, v, ddw)
        self._check_regular(q, v, start)
        return q, v

    def _check_regular(self, q: Array, v: Array, t: float) -> None:
        """Raise where a motion begins so near a singular position that digits of the position choose its velocities.

        Rounding of the rows, 1e-16, leaves an angle of 1e-16 over their least singular value s, and velocities that are
        wrong by 1e-16 over ``s^2``. Exactly there the rows count as dependent, and velocities tell the motions apart.
        """
        values = self.rows.values(q[None])[0]
        open_to = values[(values > VANISHED * self.rows.coarseness) & (values <= REGULAR * values[:1])]
        if not v.any() or not len(open_to):
            return
        raise InputError(
            f"at t = {t:.9g} s the motion begins at {open_to[0] / values[0]:.1g} of a regular position, next to one "
            "where several motions meet: the last digits of the start would choose its velocities",
            expected=f"a start at more than {REGULAR:g}, farther from the singular position, such as 0.01 deg",
            hint="the singular position itself, with velocities of all joints along one of the motions",
        )

    def _check_lasting(self, q: Array, v: Array, ddw: Array) -> None:
        """Raise where the loops allow velocities for an instant only, as of two bars in one line between fixed ends."""
        state = self.rows.state(q, v)
        rows, right = self.rows.rows(state), self.rates(ddw) - self.rows.drift(state)
        left = np.abs(rows @ self.rows.split(rows).particular(right) - right)
        rounding = np.maximum(ROUNDING, VANISHED * self.rows.reach) * float(np.abs(v).max(initial=0.0)) ** 2
        if (left > LASTING * np.abs(right).max(initial=0.0) + rounding).any():
            worst = left.max()
            torn = dict.fromkeys(
                constraint.name for (constraint, _), x in zip(self.rows.owners(), left, strict=True) if x > 0.1 * worst
            )
            raise InputError(
                f"the position is singular: {', '.join(torn)} can move with these velocities for an instant only",
                expected="velocities along one of the motions that meet here",
                hint="start beside the position, or at rest",
            )

    def require_independent(self, q: Array) -> None:
        """Raise where the motion of a coordinate that follows a law is determined by other laws and the loops."""
        names, own, rows = self.prescribed.names, self.own.size, self.rows.rows(self.rows.state(q))
        ranks = [self.rows.split(rows).rank] if names else []
        if not names or ranks[0] == self.own.split(rows[:own]).rank + len(names):
            return
        ranks = [Decomposition.of(rows[: own + k], self.rows.reach[: own + k]).rank for k in range(len(names) + 1)]
        k = int(np.flatnonzero(np.diff(ranks) == 0)[0])
        others = [*names[:k], *["the loops"] * bool(self.own.size)]
        raise InputError(
            f"the coordinate '{names[k]}' is already determined by {', '.join(others)}",
            expected="coordinates that can be prescribed independently",
        )

    def _velocity(self, q: Array, initial: Initial, dw: Array) -> Array:
        """Return the velocity of least kinetic energy that the constraints allow and that has what is given."""
        model = self.rows.model
        nv, mass = model.nv, mass_matrix(model, q)
        rows, right = self.rows.rows(self.rows.state(q)), self.rates(dw)
        moving = coupled_joints(rows, right, initial.v)
        known = sorted({*initial.velocities, *np.flatnonzero(~moving).tolist()})
        given = np.eye(nv)[known]
        split = self.rows.split(rows)
        x, scale = split.particular(right), 1.0 / self.rows.scale[known]
        left = initial.v[known] - x[known]
        ways = np.linalg.lstsq(scale[:, None] * split.free[known], scale * left, rcond=RANK)[0]
        values = x[known] + split.free[known] @ ways
        whole = Decomposition.of(np.vstack([rows, given]), np.append(self.rows.reach, np.ones(len(given))))
        return solve(whole, mass, np.zeros(nv), np.concatenate([right, values]))

    def rates(self, targets: Array) -> Array:
        """Return the right-hand side of the rows: 0 for the constraints, then what the laws ask for, shape (.., k)."""
        nothing = np.zeros((*targets.shape[:-1], self.rows.size - targets.shape[-1]))
        return np.concatenate([nothing, targets], axis=-1)

    def interval(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        compiled, remark = self._compiled(dynamics, start, end) if self._driven is not None else (None, "")
        motion = self._motion(dynamics, start, end)
        if not self.rows.size:
            flow = compiled.flow(motion) if compiled else None
            return Interval(start, end, motion.dynamics.acceleration(), compiled=flow, remark=remark)
        if compiled and not compiled.alone:
            from pinarm.engine.motion.systems.compiled_motion import LoadedMotion

            return LoadedMotion(compiled, motion).interval(start, end)
        flow, closed = compiled.flow(motion) if compiled else None, lambda _: motion.closed_acceleration
        routes = motion.acceleration, motion.settle, motion.floor, closed
        return Interval(start, end, *routes, near=lambda: motion.met, compiled=flow, remark=remark)

    def _motion(self, dynamics: Dynamics, start: float, end: float) -> LoopMotion:
        driven = self._driven
        regularity = Regularity.of(self.rows if driven is None else self.own, driven or ())
        return LoopMotion(self.rows, regularity, dynamics.on(start, end), self.prescribed.on(start, end))

    @property
    def _driven(self) -> tuple[int, ...] | None:
        """Indices in v of the joints that follow laws; ``None`` where something else follows one."""
        joints = tuple(self.prescribed.joint_laws)
        return joints if len(joints) == len(self.prescribed.names) else None

    @cached_property
    def _compiled(self) -> Callable[[Dynamics, float, float], tuple[CompiledMotion | None, str]]:
        """The motion in compiled code, as Pinocchio has judged it, kept for the next run: no run changes it."""
        from pinarm.engine.motion.systems.compiled_motion import compiled_motion

        def compiled(dynamics: Dynamics, start: float, end: float) -> tuple[CompiledMotion | None, str]:
            motion = self._motion(dynamics, start, end)
            return compiled_motion(motion, self.settled, self.near, self.prescribed.joint_laws, (start, end))

        return lru_cache(maxsize=KEPT)(compiled)

    def settled(self, q: Array, v: Array, w: Array, dw: Array, t: Array) -> tuple[Array, Array, Decomposition]:
        """Return the closed states nearest to given ones, the distance measured by the masses, and their rows apart."""
        if not self.rows.size:
            return q, v, self.rows.split(np.zeros((len(q), 0, v.shape[1])))
        model, rows, values, polished = self.rows.model, self.rows, self.rates(w), False
        mass, still, size = mass_matrices(model, q), np.zeros_like(v), max(1.0, rows.extent)
        whole, (gaps, matrices), fresh = size + np.abs(values).max(axis=1), rows.at(q), True
        splits = rows.split(matrices)
        for _ in range(ITERATIONS):
            gaps = self._closable(values - gaps, splits, whole)
            torn = np.abs(gaps).max(axis=1)
            if polished or (torn <= ROUNDED * whole).all():
                splits = splits if fresh else rows.split(matrices)
                return q, solve(splits, mass, (mass @ v[..., None])[..., 0], self.rates(dw)), splits
            q = _moved(model, q, solve(splits, mass, still, gaps))
            excess = torn - CLOSED * whole - TURNED * size * np.abs(q).max(axis=1)
            polished = bool((excess <= 0.0).all())
            gaps, matrices = rows.at(q)
            fresh = bool((np.abs(values - gaps).max(axis=1) > QUICK * torn).any())  # else the rows before do
            splits = rows.split(matrices) if fresh else splits
        worst = int(excess.argmax())
        raise self._open(float(t[worst]), q[worst], gaps[worst])

    def _closable(self, gaps: Array, splits: Decomposition, whole: Array) -> Array:
        """Return gaps, shape (n, m), without what redundant rows leave open as the file is rounded."""
        size, strict = np.abs(gaps), CLOSED * whole[:, None]
        if (size <= strict).all() or (size > self.rows.slack + strict).any():
            return gaps
        return splits.reached(gaps)

    def _open(self, t: float, q: Array, gap: Array) -> AssemblyError:
        owners = [(constraint.name, constraint.unit(row)) for constraint, row in self.rows.owners()]
        sizes = {owner: float(np.linalg.norm(gap[[other == owner for other in owners]])) for owner in owners}
        (name, measured), size = max(sizes.items(), key=lambda item: item[1])
        return AssemblyError(
            f"at t = {t:.9g} s {name} stays open by {size:.3g} {measured}",
            expected="a motion on which the loops stay closed",
            t=t,
            q=q,
            gap=gap,
        )

    def acting(self, dynamics: Dynamics) -> Dynamics:
        return dynamics

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        return q, v

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the motion, closed at every row, with accelerations, efforts and multipliers."""
        if not self.rows.size:
            a = np.concatenate([part.forward(grid.t[rows], q[rows], v[rows]) for rows, part in parts(dynamics, grid)])
            return CompletedStates(q, v, a, np.zeros_like(v), np.zeros((len(q), 0)))
        k, most = len(self.prescribed.names), max(1, min(BLOCK, LARGE // max(1, self.rows.size * self.rows.model.nv)))
        w = np.array([grid.evaluate(law) for law in self.prescribed.laws]).reshape(k, 3, len(q)).swapaxes(0, 1)
        lam = np.empty((len(q), self.rows.size))
        states = q.copy(), v.copy(), np.empty_like(v), np.empty_like(v), lam
        for part, local in parts(dynamics, grid):
            for begin in range(part.start, part.stop, most):
                some = slice(begin, min(begin + most, part.stop))
                solved = self._solved(local, grid.t[some], w[:, :, some].transpose(0, 2, 1), q[some], v[some])
                for whole, values in zip(states, solved, strict=True):
                    whole[some] = values
        q, v, a, needed, lam = states
        tau = np.zeros_like(v)
        if k:
            tau, lam = efforts_of(self.prescribed, self.closure, q, needed, lam[:, self.own.size :])
        return CompletedStates(q, v, a, tau, lam)

    def _solved(self, dynamics: Dynamics, t: Array, w: Array, q: Array, v: Array) -> tuple[Array, ...]:
        """Return closed states at n instants, accelerations, ``M a + nle - loads``, and multipliers of all rows."""
        q, v, splits = self.settled(q, v, w[0], w[1], t)
        mass, force = dynamics.mass_matrices(q), -dynamics.inverse(t, q, v, np.zeros_like(v))
        a = solve(splits, mass, force, self.rates(w[2]) - self.rows.drifts(q, v))
        needed = dynamics.inverse(t, q, v, a)
        return q, v, a, needed, splits.multipliers(needed)


def _moved(model: pin.Model, q: Array, x: Array) -> Array:
    """Return configurations, shape (n, nq), after motions x, shape (n, nv)."""
    if model.nq == model.nv:
        return q + x
    return np.array([pin.integrate(model, *pair) for pair in zip(q, x, strict=True)])
