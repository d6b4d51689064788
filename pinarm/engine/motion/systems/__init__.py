"""Equations of motion that are integrated: of trees, and of mechanisms whose constraints are not linear."""

from __future__ import annotations

from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems.system import CompletedStates, Initial, System

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
    if prescribed.linear_in(closure):
        from pinarm.engine.motion.systems.tree_system import TreeSystem

        return TreeSystem.of(closure, dynamics.manifold, prescribed, initial)
    from pinarm.engine.motion.systems.loop_system import LoopSystem

    return LoopSystem.of(closure, dynamics, prescribed, initial.q)
