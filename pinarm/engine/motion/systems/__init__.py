"""Systems: what is integrated of a mechanism, chosen by what ties its coordinates; the others are not imported."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.nullspace import MANY
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems.system import CompletedStates, Initial, System
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.laws import Constant

if TYPE_CHECKING:
    from pinarm.engine.dynamics.many_points import ManyPointConstraints
    from pinarm.engine.dynamics.pinocchio_constraints import PointConstraints

__all__ = ["CompletedStates", "Initial", "System", "system_of"]


def system_of(closure: Closure, dynamics: Dynamics, prescribed: PrescribedCoordinates, initial: Initial) -> System:
    """Return what has to be integrated while the prescribed coordinates follow their laws.

    Args:
        closure: Constraints of the mechanism.
        dynamics: Its equation of motion with all the forces of the run.
        prescribed: Coordinates with laws, none for free motion.
        initial: The initial state; joints with given values stay free if they can.

    Raises:
        InputError: They cannot be prescribed independently.
    """
    linear = [coordinate for coordinate in prescribed.coordinates if isinstance(coordinate, LinearCoordinate)]
    if not prescribed.linear_in(closure):
        return _constrained(closure, dynamics, prescribed, initial, linear)
    couplings = [constraint for constraint in closure.constraints if isinstance(constraint, Coupling)]
    if couplings or linear:
        return _partitioned(closure, dynamics, prescribed, initial, couplings, linear)
    from pinarm.engine.motion.systems.free import FreeSystem

    return FreeSystem(dynamics.manifold, closure)


def _constrained(
    closure: Closure, dynamics: Dynamics, prescribed: PrescribedCoordinates, initial: Initial,
    linear: Sequence[LinearCoordinate],
) -> System:  # fmt: skip
    """Return the system of a mechanism with loops, or with laws that are not linear in the coordinates."""
    from pinarm.engine.motion.systems.constrained import ConstrainedSystem
    from pinarm.engine.motion.systems.point_constrained import PointSystem

    general = ConstrainedSystem.of(closure, dynamics, prescribed, initial.q)
    driven = [coordinate.joint for coordinate in linear if coordinate.joint is not None]
    points = _points(closure, initial, driven) if len(driven) == len(prescribed.names) else None
    return PointSystem(general, points) if points else general


def _points(closure: Closure, initial: Initial, driven: list[int]) -> PointConstraints | ManyPointConstraints | None:
    """Return the loops as points, dense where they are few."""
    if closure.model.nv <= MANY:
        from pinarm.engine.dynamics.pinocchio_constraints import PointConstraints

        return PointConstraints.of(closure, initial.q, driven)
    if driven:
        return None
    from pinarm.engine.dynamics.many_points import ManyPointConstraints

    return ManyPointConstraints.of(closure, initial.q)


def _partitioned(
    closure: Closure, dynamics: Dynamics, prescribed: PrescribedCoordinates, initial: Initial,
    couplings: Sequence[Coupling], linear: Sequence[LinearCoordinate],
) -> System:  # fmt: skip
    """Return the system of a tree in which sums of coordinates are tied or follow laws: of those that stay free."""
    from pinarm.engine.dynamics.coordinate_partition import CoordinatePartition
    from pinarm.engine.integration.integrator import Flat
    from pinarm.engine.motion.systems.partitioned import FreeCoordinates, PartitionedSystem

    rows = [one.weights for one in [*(coupling.coordinate for coupling in couplings), *linear]]
    held = PrescribedCoordinates(
        (*(one.name for one in couplings), *prescribed.names),
        (*(one.coordinate for one in couplings), *linear),
        (*(Constant(value=one.constant) for one in couplings), *prescribed.laws),
    )
    given = tuple(sorted({*initial.positions, *initial.velocities}))
    reduction = CoordinatePartition.of(closure.model, np.array(rows), held.names, given)
    nq, nv = len(reduction.free_q), len(reduction.free_v)
    flat, neutral = closure.model.nq == closure.model.nv, np.asarray(pin.neutral(closure.model))
    space = Flat(nq, nv) if flat else FreeCoordinates(dynamics.manifold, reduction, neutral, nq, nv)
    partitioned = PartitionedSystem(held, reduction, space, closure)
    if flat and not linear:
        from pinarm.engine.motion.systems.coupled import CoupledSystem

        return CoupledSystem(partitioned, dynamics.manifold)
    if couplings:
        return partitioned
    from pinarm.engine.motion.systems.driven import DrivenSystem

    return DrivenSystem.of(partitioned, dynamics, linear) or partitioned
