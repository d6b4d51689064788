"""A state about which a motion is linearised, with imaginary steps along its states and inputs.

Every state and input is an imaginary step of configuration, velocities, accelerations, efforts, multipliers and
friction; a quantity of these states, divided by the step, is its derivative: the matrices C and D. See ``derivatives``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import STEP, Array, Flags
from pinarm.engine.constraints.constraint_rows import ConstraintRows, Measured
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.linear.derivatives import EquationDerivatives, complex_kept, equation_derivatives
from pinarm.engine.linear.friction import FrictionState, friction_slopes, friction_state, measured, with_friction
from pinarm.engine.linear.inputs import force_load, stepped_force
from pinarm.engine.linear.linearisation import DEPENDENT, LinearMotion, Rows, linear_motion
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import Record, replace

SHARED = 1e-9
"""Change of an output by a self-stress of length 1 that is rounding."""


class Drives(Record, frozen=True):
    """Drives along coordinates at a state.

    Attributes:
        efforts: Efforts along them [N*m or N], shape (k,): constant in the small motion, but of prescribed ones.
        prescribed: Which of them have prescribed positions, shape (k,).
    """

    names: Sequence[str] = ()
    coordinates: Sequence[Coordinate] = ()
    efforts: Array = np.zeros(0)
    prescribed: Flags = np.zeros(0, dtype=bool)

    def acting(self, nv: int, efforts: Array) -> tuple[Array, Array]:
        """Return efforts along coordinates, shape (k, c), at joints, shape (nv, c), and along task coordinates."""
        tau, guides = np.zeros((nv, efforts.shape[1])), list[Array]()
        for coordinate, effort in zip(self.coordinates, efforts, strict=True):
            if isinstance(coordinate, LinearCoordinate):
                tau += np.multiply.outer(coordinate.weights, effort)
            else:
                guides.append(effort)
        return tau, np.array(guides).reshape(len(guides), efforts.shape[1])


class SteppedState(Record, frozen=True):
    """A state, and what holds, moves and slips at it.

    Attributes:
        state: A table of one row with its accelerations, efforts, multipliers and friction; its closure has the
            constraints of the mechanism, then the drives along task coordinates.
    """

    state: Trajectory
    drives: Drives = Drives()

    @cached_property
    def friction(self) -> FrictionState:
        """Friction at the state."""
        return friction_state(self.state)

    @cached_property
    def _own(self) -> int:
        """Number of rows of the mechanism's constraints."""
        return self.state.mechanism.closure.size

    @cached_property
    def rows(self) -> Rows:
        """Rows of constraints, drives and slips, in this order, that hold, move or slip."""
        drives, slips = self._own + np.arange(len(self.drives.names)), self._own + len(self.drives.names)
        prescribed, stuck = drives[self.drives.prescribed], self.friction.stuck
        holding = np.concatenate([np.arange(self._own), prescribed, slips + np.flatnonzero(stuck)])
        return Rows(
            holding,
            self._own + np.arange(len(prescribed)),
            slips + np.flatnonzero(~stuck),
            self.state.mechanism.closure.rolling,
        )

    @cached_property
    def _measured(self) -> list[Measured]:
        """Constraints, coordinates of drives, and slips."""
        return [*self.state.mechanism.constraints, *self.drives.coordinates, *map(measured, self.friction.contacts)]

    @cached_property
    def derivatives(self) -> EquationDerivatives:
        """Derivatives of the equation of motion, with constraints, drives and slips."""
        state = self.state
        lam = np.concatenate([np.asarray(state.lam)[0, : self._own], self.drives.efforts, self.friction.f])
        t, q, v, a = float(state.grid.t[0]), state.q[0], state.v[0], state.a[0]
        return equation_derivatives(state.dynamics, self._measured, t, q, v, a, lam)

    @cached_property
    def motion(self) -> LinearMotion:
        """The motion linearised about the state."""
        model, v, friction = self.state.mechanism.model, self.state.v[0], self.friction
        scale = self.state.mechanism.closure.scale
        if not len(self.rows.slipping):
            return linear_motion(model, self.derivatives, v, self.rows, scale)
        slipping = [contact for contact, stuck in zip(friction.contacts, friction.stuck, strict=True) if not stuck]
        return linear_motion(
            model, self.derivatives, v, self.rows, scale, lambda motion: friction_slopes(self.steps(motion), slipping)
        )

    def steps(self, motion: LinearMotion) -> Trajectory:
        """Return the state with an imaginary step along each state and each input of a motion, one a row."""
        size, nv = motion.b.shape[0], self.state.mechanism.model.nv
        nothing, tau = np.zeros((nv, motion.b.shape[1])), np.zeros_like(motion.whole_a)
        tau[:, size : size + nv] = np.eye(nv)
        position, velocity = (np.hstack([x, nothing]) for x in (motion.position, motion.velocity))
        return self._stepped(position, velocity, motion.whole_a, tau, motion.whole_lam, motion.friction)

    def _stepped(
        self, q: Array, v: Array, a: Array, tau: Array, lam: Array, slipping: Array, **changes: Any
    ) -> Trajectory:
        """Return the state with c imaginary steps, a row each.

        Args:
            q: Steps of positions, shape (nv, c).
            v: Of velocities, likewise.
            a: Of accelerations.
            tau: Of efforts at joints.
            lam: Of the multipliers of rows that hold, shape (m, c).
            slipping: Of friction that slips, shape (k, c).
        """
        state, model, count = self.state, self.state.mechanism.model, q.shape[1]
        efforts, f = np.zeros((len(self.drives.names), count)), np.zeros((len(self.friction.f), count))
        own, held = self._own, self._own + int(self.drives.prescribed.sum())
        efforts[self.drives.prescribed] = lam[own:held]
        f[self.friction.stuck], f[~self.friction.stuck] = lam[held:], slipping
        driven, guides = self.drives.acting(model.nv, efforts)
        t, tangent = float(state.grid.t[0]), pin.tangentMap(model, state.q[0])
        stepped = replace(
            state,
            grid=Grid(np.full(count, t), (t, float(np.nextafter(t, np.inf))), (0, count)),
            columns={},
            q=state.q[0] + 1j * STEP * (tangent @ q).T,
            v=state.v[0] + 1j * STEP * v.T,
            a=state.a[0] + 1j * STEP * a.T,
            tau=state.tau[0] + 1j * STEP * (tau + driven).T,
            lam=Multipliers.known(np.asarray(state.lam)[0] + 1j * STEP * np.vstack([lam[:own], guides]).T, own),
            directions=np.sign(np.broadcast_to(state.v, (count, model.nv))),
            **changes,
        )
        return with_friction(stepped, state.friction[0] + 1j * STEP * f.T)

    def slopes(self, names: Sequence[str]) -> Array:
        """Return the derivatives of quantities or formulas by all states and inputs, shape (p, n + i)."""
        self._require_shared(names)
        return _slopes(self.steps(self.motion), names)

    def force_slopes(self, names: Sequence[str], forces: Sequence[str]) -> tuple[Array, Array]:
        """Return loads of forces per amplitude, shape (nv, k), and derivatives of quantities by these, shape (p, k)."""
        loads, slopes = np.zeros((len(forces), self.state.v.shape[1])), np.zeros((len(forces), len(names)))
        for k, name in enumerate(forces):
            loads[k] = force_load(self.state, name)
            slopes[k] = self._force_slopes(names, name, loads[k])
        return loads.T, slopes.T

    def _force_slopes(self, names: Sequence[str], name: str, load: Array) -> Array:
        motion, size, nv = self.motion, len(self.motion.a), len(load)
        a, lam, slipping = (
            (x[:, size : size + nv] @ load)[:, None] for x in (motion.whole_a, motion.whole_lam, motion.friction)
        )
        still, dynamics = np.zeros((nv, 1)), self.state.dynamics
        changed = replace(dynamics, forces={**dynamics.forces, name: stepped_force(dynamics.forces[name])})
        return _slopes(self._stepped(still, still, a, still, lam, slipping, dynamics=changed), names)[:, 0]

    def _require_shared(self, names: Sequence[str]) -> None:
        """Raise where an output depends on how joints that friction holds share a load with constraints."""
        held = self._own + int(self.drives.prescribed.sum())
        if not self.friction.stuck.any() or not names:
            return
        rows = ConstraintRows.of(self.state.mechanism.model, self._measured).at(self.state.q).matrices[0]
        left, values, _ = np.linalg.svd(rows[self.rows.holding])
        rank = int((values > DEPENDENT * values.max(initial=0.0)).sum())
        stresses = left[:, rank:]
        stresses = stresses[:, np.abs(stresses[held:]).max(axis=0, initial=0.0) > SHARED]
        if not stresses.size:
            return
        still = np.zeros((rows.shape[1], stresses.shape[1]))
        slipping = np.zeros((int((~self.friction.stuck).sum()), stresses.shape[1]))
        slopes = _slopes(self._stepped(still, still, still, still, stresses, slipping), names)
        for name, slope in zip(names, slopes, strict=True):
            if np.abs(slope).max() > SHARED:
                raise InputError(
                    f"'{name}' depends on how joints that friction holds share their load with each other",
                    expected="an output that they do not change, or friction in fewer joints",
                )


def _slopes(steps: Trajectory, names: Sequence[str]) -> Array:
    """Return the derivatives of quantities along imaginary steps, shape (p, c)."""
    values, slopes = Quantities(steps), np.zeros((len(names), len(steps)))
    for k, name in enumerate(names):
        try:
            with complex_kept():
                slopes[k] = np.imag(values[name].values) / STEP
        except FloatingPointError:
            raise InputError(
                f"'{name}' has a kink here: it depends on the size of something that is 0 in this state",
                expected="its components, or a state in which it is not 0",
            ) from None
        except (TypeError, np.exceptions.ComplexWarning):  # of Pinocchio, and of functions of real numbers
            raise InputError(f"the linear analysis has no derivatives of '{name}'", expected="another output") from None
    return slopes
