"""Drives of a mechanism: efforts ``tau`` and multipliers ``lam`` of a motion.

The equation of motion asks for ``S^T tau + G^T lam = M a + nle - loads``, with a row of S for every coordinate that a
drive acts along. With T a basis of the motions that the constraints allow, ``G T = 0``, the drives' part is
``(S T)^T tau = T^T (M a + nle - loads)``, whatever is redundant among the constraints.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags
from pinarm.engine.constraints.closure import Closure
from pinarm.errors import InputError, as_names
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint_rows import Constraint
    from pinarm.engine.mechanism import Mechanism
    from pinarm.engine.statics.effort_distribution import SelectedDrives


Actuation: TypeAlias = "DriveAtEveryJoint | SelectedDrives"
"""The drives of a mechanism and the constraints that they work against: those of the mechanism, then drives along task
coordinates. ``efforts(t, q, demand)`` returns tau at the joints and the multipliers for ``M a + nle - loads``, shape
(n, nv); ``driven`` tells which joints drives act on, shape (nv,); ``coordinates(mechanism)`` what they act along."""


class DriveAtEveryJoint(Record, frozen=True):
    """A drive at every joint that mimics no other: it carries what those that mimic it demand, too.

    With f the followers, l the leaders, and W = (W_f W_l) the rows of the couplings,
    ``tau_l = demand_l - (W_f^-1 W_l)^T demand_f`` and ``lam = W_f^-T demand_f``.

    Attributes:
        closure: The couplings; none of an open chain.
        followers: Indices in v of the joints that mimic others, one of each row, shape (m,).
    """

    closure: Closure
    followers: tuple[int, ...] = ()

    @property
    def driven(self) -> Flags:
        driven = np.ones(self.closure.model.nv, dtype=bool)
        driven[list(self.followers)] = False
        return driven

    @cached_property
    def _weights(self) -> Array:
        """The rows W of the couplings, the same at all configurations, shape (m, nv)."""
        return self.closure.rows(self.closure.state(pin.neutral(self.closure.model)))

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Array]:
        """Return the efforts of the leaders, 0 for the followers, and the multipliers."""
        if not self.followers:
            return demand, np.zeros((*demand.shape[:-1], 0))
        rows, followers = self._weights, list(self.followers)
        lam = np.asarray(np.linalg.solve(rows[:, followers].T, demand[:, followers].T).T, dtype=np.float64)
        tau = demand - lam @ rows
        tau[:, followers] = 0.0
        return tau, lam

    def coordinates(self, mechanism: Mechanism) -> Mapping[str, Coordinate]:
        leaders = (name for name, joint in mechanism.joints.items() if joint.v not in self.followers)
        return {name: mechanism.coordinates[name] for name in leaders}


def actuation(mechanism: Mechanism, drives: Sequence[str], prescribed: Sequence[str]) -> Actuation:
    """Return the drives of a run.

    Args:
        drives: Names of the coordinates that drives act along. Where none is named every joint of an open chain has
            a drive, but for those that mimic others, and a mechanism with loops one along every prescribed coordinate.
        prescribed: Names of the coordinates that follow laws.
    """
    if not drives and (every := everywhere(mechanism)) is not None:
        return every
    return along(mechanism, as_names(drives) or list(prescribed))


def along(mechanism: Mechanism, names: Collection[str]) -> Actuation:
    """Return drives along coordinates, and at no other joint."""
    if len(set(names)) < len(names):
        raise InputError(f"a drive is named twice in {', '.join(names)}", expected="one drive along each coordinate")
    from pinarm.engine.statics.effort_distribution import SelectedDrives  # open chains do without

    named: dict[str, Coordinate] = {name: mechanism.coordinate(name) for name in names}
    linear = {name: along for name, along in named.items() if isinstance(along, LinearCoordinate)}
    others = {name: along for name, along in named.items() if name not in linear}
    closure = mechanism.closure.with_guides(list(others), list(others.values()))
    return SelectedDrives(linear, others, mechanism.closure, closure)


def everywhere(mechanism: Mechanism) -> Actuation | None:
    """Return drives at every joint that mimics no other; ``None`` where loops or gears leave fewer joints to drive."""
    followers = followers_of(mechanism.constraints)
    return None if followers is None else DriveAtEveryJoint(mechanism.closure, followers)


def followers_of(constraints: Sequence[Constraint]) -> tuple[int, ...] | None:
    """Return the joints that mimic others, one of each constraint; ``None`` where there are other constraints."""
    followers = {joint for constraint in constraints if (joint := getattr(constraint, "follower", None)) is not None}
    return tuple(sorted(followers)) if len(followers) == len(constraints) else None
