"""Linear analysis of a mechanism at a state of the user's own: derivatives, state-space matrices, modes by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, Complex, real
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.labelled_array import LabelledArray
from pinarm.engine.linear.derivatives import EquationDerivatives, equation_derivatives
from pinarm.engine.linear.linearisation import LinearMotion, Modes, linear_motion
from pinarm.engine.quantities import states
from pinarm.errors import InputError
from pinarm.input.units import Unit, unit
from pinarm.mechanics.ball_joints import coordinate_name
from pinarm.mechanics.joints import METRE
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism

AT_KINK = 1e-9
"""Distance of a load from its kink, relative to ``1 +`` the coordinate in SI, at which it has no one derivative."""


class Linearisation(Record, frozen=True):
    """A motion linearised about a state: ``x' = A x + B u``, with names.

    Attributes:
        motion: The matrices and their bases.
        states: Names of the states x: deviations of d independent coordinates, then of their velocities ``NAME'``.
        inputs: Names of the inputs u: efforts at joints.
        state_units: Units of the states.
        input_units: Units of the inputs.
        velocity_units: Units of all joints' coordinates.
        acceleration: Accelerations at the state, shape (nv,): 0 at an equilibrium.
    """

    motion: LinearMotion
    states: Sequence[str]
    inputs: Sequence[str]
    state_units: Sequence[Unit]
    input_units: Sequence[Unit]
    velocity_units: Sequence[Unit]
    acceleration: Array

    @property
    def A(self) -> Array:
        """State matrix, shape (2 d, 2 d)."""
        return self.motion.a

    @property
    def B(self) -> Array:
        """Input matrix, shape (2 d, k)."""
        return self.motion.b

    @property
    def modes(self) -> Modes:
        """Eigenvalues, frequencies, damping ratios, eigenvectors and their errors."""
        return self.motion.modes

    def shapes(self) -> Complex:
        """Return the mode shapes in all joint velocities, shape (nv, k), the largest component of each 1."""
        shapes = self.motion.motions(self.modes.vectors)
        largest = np.abs(shapes).argmax(axis=0)
        return np.asarray(shapes / shapes[largest, np.arange(shapes.shape[1])])

    def response(self, frequencies: Array, outputs: Array, inputs: Array | None = None) -> Complex:
        """Return the frequency response ``C (2 pi i f - A)^-1 B``.

        Args:
            frequencies: f [Hz], shape (n,).
            outputs: C, rows over the states, shape (p, 2 d).
            inputs: B, columns over the inputs, shape (2 d, k); that of efforts at all joints where it is left out.

        Returns:
            Shape (n, p, k): per unit of each input.
        """
        s = 2j * np.pi * np.asarray(frequencies, float)[:, None, None]
        right = np.asarray(self.B if inputs is None else inputs, dtype=complex)
        return np.asarray(np.asarray(outputs) @ np.linalg.solve(s * np.eye(len(self.states)) - self.A, right))

    def __repr__(self) -> str:
        """Return the states and the frequencies."""
        found = ", ".join(f"{frequency:.4g}" for frequency in self.modes.frequencies)
        return f"<Linearisation of {', '.join(self.states[: len(self.states) // 2])}; frequencies [Hz]: {found}>"

    def tables(self) -> dict[str, LabelledArray]:
        """Return eigenvalues, mode shapes and the matrices A and B as tables with names and units."""
        modes = [f"mode.{k}" for k in range(1, len(self.modes.eigenvalues) + 1)]
        rate, one = unit("1/s"), [unit("1")] * len(modes)
        inverse = [unit("1") / measured for measured in self.state_units]
        return {
            "eigenvalues": LabelledArray(self.modes.eigenvalues[None], ["eigenvalue"], modes, [rate], one),
            "shapes": LabelledArray(self.shapes(), self.inputs, modes, self.velocity_units, one),
            "A": LabelledArray(self.A, self.states, self.states, [own * rate for own in self.state_units], inverse),
            "B": LabelledArray(
                self.B, self.states, self.inputs, [own * rate for own in self.state_units],
                [unit("1") / measured for measured in self.input_units],
            ),
        }  # fmt: skip


def derivatives(mechanism: Mechanism, q: Array, v: Array, a: Array, tau: Array | None, t: float) -> EquationDerivatives:
    """Return the derivatives of the equation of motion; see ``Mechanism.derivatives``."""
    q, v, a, tau = _one_state(mechanism, q, v=v, a=a, tau=tau)
    return _derivatives(mechanism, mechanism.dynamics.on(t, float(np.nextafter(t, np.inf))), t, q, v, a, tau)


def _derivatives(
    mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array, a: Array, tau: Array
) -> EquationDerivatives:
    """Return the derivatives, with the multipliers that hold what the efforts do not."""
    _require_smooth(mechanism, dynamics, t, q, v)
    held = dynamics.inverse(t, q[None], v[None], a[None]) - tau
    lam = Multipliers.least(mechanism.closure, q[None], held, np.zeros((1, 0)))
    return equation_derivatives(dynamics, mechanism.constraints, t, q, v, a, lam[0])


def linearise(mechanism: Mechanism, q: Array, v: Array | None, tau: Array | None, t: float) -> Linearisation:
    """Return the linearised motion; see ``Mechanism.linearise``."""
    q, v, _, tau = _one_state(mechanism, q, v=v, a=None, tau=tau)
    a = np.asarray(states.forward(mechanism, q, v, tau, t))
    dynamics = mechanism.dynamics.on(t, float(np.nextafter(t, np.inf)))
    return linearised(mechanism, dynamics, t, q, v, tau, a)


def linearised(
    mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array, tau: Array, a: Array | None = None
) -> Linearisation:
    """Return the motion linearised about a state under the loads of a run; ``a`` is 0 where it is left out."""
    model, a = mechanism.model, np.zeros_like(v) if a is None else a
    motion = linear_motion(model, _derivatives(mechanism, dynamics, t, q, v, a, tau), v)
    names = [coordinate_name(model, index) for index in range(model.nv)]
    sliding = {joint.v for joint in mechanism.joints.values() if joint.unit == METRE}
    every = [unit("m") if index in sliding else unit("rad") for index in range(model.nv)]
    free = motion.independent.tolist()
    own = [every[index] for index in free]
    return Linearisation(
        motion,
        [*(names[index] for index in free), *(f"{names[index]}'" for index in free)],
        names,
        [*own, *(measured / unit("s") for measured in own)],
        [unit("N") if index in sliding else unit("N*m") for index in range(model.nv)],
        every,
        a,
    )


def _one_state(
    mechanism: Mechanism, q: Array, *, v: Array | None, a: Array | None, tau: Array | None
) -> tuple[Array, Array, Array, Array]:
    """Return one state as arrays, shapes (nq,) and (nv,); 0 where nothing is given.

    Raises:
        InputError: The shapes do not fit.
    """
    nv = mechanism.model.nv
    found = [real(q, "q")]
    for name, given in (("v", v), ("a", a), ("tau", tau)):
        found.append(np.zeros(nv) if given is None else real(given, name))
    for name, array, size in zip(("q", "v", "a", "tau"), found, (mechanism.model.nq, nv, nv, nv), strict=True):
        if array.shape != (size,):
            raise InputError(f"{name} has the shape {array.shape}", expected=f"one state, shape ({size},)")
    return found[0], found[1], found[2], found[3]


def _require_smooth(mechanism: Mechanism, dynamics: Dynamics, t: float, q: Array, v: Array) -> None:
    """Raise where the motion has no derivative: with dry friction, or at a kink of a load.

    Raises:
        InputError: Says where.
    """
    if mechanism.frictions:
        joints = ", ".join(dict.fromkeys(friction.name for friction in mechanism.frictions))
        raise InputError(
            f"dry friction has no derivative where it sticks: {joints}",
            expected="a mechanism without dry friction",
            hint="friction: {} in the mechanism file, or a coupling that holds the sticking joint",
        )
    for name, force in dynamics.forces.items():
        for edge in force.edges():
            near = np.abs(edge.value(np.array([t]), q[None], v[None])) <= AT_KINK * (1.0 + np.abs(q).max(initial=0.0))
            if near.any() and (edge.counts is None or edge.counts(np.array([t]), q[None], v[None]).any()):
                raise InputError(
                    f"the load '{name}' has a kink here: it is not linear on either side of it",
                    expected="a state beside the kink, such as with a cable taut",
                )
