"""Derivatives of quantities by the states and inputs of a linearised motion: the matrices C and D.

Every state and input is an imaginary step of configuration, velocities, accelerations, efforts and multipliers; a
quantity of these states, divided by the step, is its derivative. See ``derivatives``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.linear.derivatives import STEP, complex_kept
from pinarm.engine.linear.linearisation import LinearMotion
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.input.formulas.expressions import Expression
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace


def output_matrices(
    state: Trajectory, motion: LinearMotion, symbols: Mapping[str, Expression], names: Sequence[str]
) -> tuple[Array, Array]:
    """Return C, shape (p, 2 d), and D, shape (p, nv), of quantities, symbols or formulas.

    Args:
        state: The state, a table of one row with its efforts and multipliers.
        motion: The motion linearised about it.
        symbols: Symbols of the scenario.
        names: The quantities.

    Raises:
        InputError: A quantity does not exist, or has no derivative.
    """
    values = Quantities(_stepped(state, motion), symbols)
    with complex_kept():
        slopes = [np.imag(values[name].values) / STEP for name in names]
    whole = np.array(slopes).reshape(len(names), motion.whole_a.shape[1])
    size = 2 * len(motion.independent)
    return whole[:, :size], whole[:, size:]


def _stepped(state: Trajectory, motion: LinearMotion) -> Trajectory:
    """Return the state with an imaginary step along each state and each input, one a row."""
    model, d = state.mechanism.model, len(motion.independent)
    nv = model.nv
    nothing = np.zeros((nv, nv))
    q = np.hstack([motion.allowed, np.zeros((nv, d)), nothing]).T @ pin.tangentMap(model, state.q[0]).T
    v = np.hstack([motion.carried, motion.allowed, nothing]).T
    tau = np.hstack([np.zeros((nv, 2 * d)), np.eye(nv)]).T
    lam = np.asarray(state.lam)[0] + 1j * STEP * motion.whole_lam.T
    return replace(
        state, grid=Grid.cover(np.arange(1.0, 2 * d + nv + 1.0), []), q=state.q[0] + 1j * STEP * q,
        v=state.v[0] + 1j * STEP * v, a=state.a[0] + 1j * STEP * motion.whole_a.T, tau=state.tau[0] + 1j * STEP * tau,
        lam=Multipliers.known(lam, state.closure.size), columns={},
    )  # fmt: skip
