"""Trees with joints that follow laws: all coordinates are integrated, in compiled code where it knows laws and loads.

The accelerations are those of the independent coordinates under the laws. In compiled code a driven joint has an
armature that outweighs the tree, and stands where its law says; states are taken from their independent part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.mass_matrix import mass_matrix
from pinarm.engine.integration.integrator import Accelerations, Interval, Manifold
from pinarm.engine.kernel.laws import Followed, is_known
from pinarm.engine.kernel.links import links_of
from pinarm.engine.motion.systems.partitioned import PartitionedSystem
from pinarm.engine.motion.systems.system import CompletedStates, Initial, KeptIntervals
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.forces.joint_efforts import AppliedEffort
from pinarm.mechanics.forces.joint_springs import BallSpring, SpringDamper
from pinarm.mechanics.forces.point import TwoPointSpring
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.kernel.library import Flow

IMMOVABLE = 1e20
"""Armature of a driven joint, relative to the largest inertia of the tree: what else acts there is below rounding."""


class DrivenSystem(Record, KeptIntervals, frozen=True):
    """All coordinates of a tree are integrated, some of whose joints follow laws.

    Attributes:
        inner: The independent coordinates.
        manifold: Space of all.
        joints: Indices in v and in q of the joints that follow laws, in the order of these.
    """

    inner: PartitionedSystem
    manifold: Manifold
    joints: tuple[tuple[int, int], ...]

    @classmethod
    def of(
        cls, inner: PartitionedSystem, dynamics: Dynamics, linear: Sequence[LinearCoordinate]
    ) -> DrivenSystem | None:  # fmt: skip
        """Return the system; ``None`` where compiled code knows a joint, a load or a law not, or a sum is driven.

        Also where nothing is left free. Whether there is compiled code makes no difference.
        """
        model, laws, free = inner.reduction.model, inner.prescribed.laws, len(inner.reduction.free_v)
        driven = [one.joint for one in linear if one.joint is not None]
        if not free or len(driven) < len(laws) or links_of(model) is None or not _known(dynamics, laws):
            return None
        joints = tuple((v, int(inner.reduction.scalar_q[v])) for v in driven)
        return cls(inner, dynamics.manifold, joints)

    @property
    def closure(self) -> Closure:
        """No constraints."""
        return self.inner.closure

    def begin(self, initial: Initial, start: float, end: float) -> tuple[Array, Array]:
        """Return the state of the mechanism that belongs to the initial one."""
        return self._filled(self.inner.prescribed.on(start, end)(start), *self.inner.begin(initial, start, end))

    def _prepared(self, dynamics: Dynamics, start: float, end: float) -> Interval:
        inner, reduction = self.inner.interval(dynamics, start, end), self.inner.reduction
        targets = self.inner.prescribed.on(start, end)

        def acceleration(t: float, q: Array, v: Array) -> Array:
            return reduction.velocity(inner.acceleration(t, *self.inner.part(q, v)), targets(t)[2])

        flow, remark = self._compiled(dynamics, start, end, acceleration)
        batch = self._batch(inner.batch, start, end)
        return Interval(start, end, acceleration, batch=batch, compiled=flow, remark=remark)

    def _batch(self, inner: Accelerations | None, start: float, end: float) -> Accelerations | None:
        reduction, targets = self.inner.reduction, self.inner.prescribed.along(start, end)
        if inner is None:
            return None
        return lambda t, q, v: reduction.velocity(inner(t, *self.inner.part(q, v)), targets(t)[2])

    def _compiled(
        self, dynamics: Dynamics, start: float, end: float, acceleration: Callable[..., Array]
    ) -> tuple[Flow | None, str]:  # fmt: skip
        """Return the motion in compiled code where Pinocchio agrees, and what is to be said where it does not."""
        from pinarm.engine.kernel.tree import AGREEMENT, DISAGREES, CompiledTree, disagreement

        here, targets, laws = dynamics.on(start, end), self.inner.prescribed.on(start, end), self.inner.prescribed.laws
        tree = CompiledTree.of(self._heavy)
        guided = [Followed(*joint, law.on(start, end)) for joint, law in zip(self.joints, laws, strict=True)]
        flow = tree.flow(here.steady, here.changing, guided) if tree else None
        if flow is None:
            return None, ""

        def onto(q: Array, v: Array) -> tuple[Array, Array]:
            return self._filled(targets(start), *self.inner.part(q, v))

        apart = disagreement(dynamics.model, flow, acceleration, start, onto)
        return (flow, "") if apart <= AGREEMENT else (None, DISAGREES.format(apart))

    @cached_property
    def _heavy(self) -> pin.Model:
        """The model with armatures at the driven joints."""
        model, held = pin.Model(self.inner.reduction.model), [v for v, _ in self.joints]
        model.armature[held] += IMMOVABLE * float(np.diag(mass_matrix(model, pin.neutral(model))).max())
        return model

    def _filled(self, targets: tuple[Array, Array, Array], q: Array, v: Array) -> tuple[Array, Array]:
        """Return states from their independent part and what the laws say."""
        w, dw, _ = targets
        return self.inner.reduction.configuration(q, w), self.inner.reduction.velocity(v, dw)

    def part(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the states themselves."""
        return q, v

    def whole(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the states, with the driven joints where the laws say."""
        return self.inner.whole(t, *self.inner.part(q, v))

    def complete(self, dynamics: Dynamics, grid: Grid, q: Array, v: Array) -> CompletedStates:
        """Return the whole motion; see ``PartitionedSystem.complete``."""
        return self.inner.complete(dynamics, grid, *self.inner.part(q, v))


def _known(dynamics: Dynamics, laws: Sequence[MotionLaw]) -> bool:
    """Return whether compiled code knows all loads, and all laws between their breakpoints."""
    known = (SpringDamper, BallSpring, TwoPointSpring, AppliedEffort)
    followed = [*laws, *(law for force in dynamics.changing for law in force.laws())]
    loads = all(isinstance(force, known) for force in dynamics.changing)
    return loads and all(is_known(piece.function) for law in followed for piece in law.smooth_pieces)
