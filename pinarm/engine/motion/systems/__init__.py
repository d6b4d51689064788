"""Systems: what is integrated of a mechanism, chosen by what ties its coordinates."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.coordinate_partition import CoordinatePartition
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.pinocchio_constraints import PointConstraints
from pinarm.engine.integration.integrator import Flat
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems.constrained import ConstrainedSystem
from pinarm.engine.motion.systems.coupled import CoupledSystem
from pinarm.engine.motion.systems.free import FreeSystem
from pinarm.engine.motion.systems.partitioned import FreeCoordinates, PartitionedSystem
from pinarm.engine.motion.systems.point_constrained import PointSystem
from pinarm.engine.motion.systems.system import CompletedStates, Initial, System
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling, independent
from pinarm.mechanics.laws import Constant

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
    couplings = [constraint for constraint in closure.constraints if isinstance(constraint, Coupling)]
    linear = [coordinate for coordinate in prescribed.coordinates if isinstance(coordinate, LinearCoordinate)]
    bent = len(linear) < len(prescribed.coordinates) or len(couplings) < len(closure.constraints)
    if bent or not independent(couplings):
        general = ConstrainedSystem.of(closure, dynamics, prescribed, initial.q)
        driven = [coordinate.joint for coordinate in linear if coordinate.joint is not None]
        points = PointConstraints.of(closure, initial.q, driven) if len(driven) == len(prescribed.names) else None
        return PointSystem(general, points) if points else general
    rows = [one.weights for one in [*(coupling.coordinate for coupling in couplings), *linear]]
    if not rows:
        return FreeSystem(dynamics.manifold, closure)
    held = PrescribedCoordinates(
        (*(one.name for one in couplings), *prescribed.names),
        (*(one.coordinate for one in couplings), *linear),
        (*(Constant(value=one.constant) for one in couplings), *prescribed.laws),
    )
    given = tuple(sorted({*initial.positions, *initial.velocities}))
    reduction = CoordinatePartition.of(closure.model, np.array(rows), held.names, given)
    nq, nv = len(reduction.free_q), len(reduction.free_v)
    if closure.model.nq == closure.model.nv:
        partitioned = PartitionedSystem(held, reduction, Flat(nq, nv), closure)
        return partitioned if linear else CoupledSystem(partitioned, dynamics.manifold)
    neutral = np.asarray(pin.neutral(closure.model))
    space = FreeCoordinates(dynamics.manifold, reduction, neutral, nq, nv)
    return PartitionedSystem(held, reduction, space, closure)
