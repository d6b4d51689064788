"""Drives of a mechanism: efforts ``tau`` and multipliers ``lam`` of a motion.

The equation of motion asks for ``S^T tau + G^T lam = M a + nle - loads``, with a row of S for every coordinate that a
drive acts along. With T a basis of the motions that the constraints allow, ``G T = 0``, the drives' part is
``(S T)^T tau = T^T (M a + nle - loads)``, whatever is redundant among the constraints.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.constraints.multipliers import Multipliers
from pinarm.errors import InputError, as_names
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint_rows import Constraint
    from pinarm.engine.mechanism import Mechanism


class Actuation(Protocol):
    """The drives of a mechanism and the constraints that they work against."""

    @property
    def closure(self) -> Closure:
        """Constraints with multipliers: those of the mechanism, then drives along task coordinates."""
        ...

    @property
    def driven(self) -> Flags:
        """Joints that drives act on, alone or with others, shape (nv,)."""
        ...

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Multipliers]:
        """Return tau at the joints, shape (n, nv), and the multipliers.

        Args:
            t: Instants, for messages, shape (n,).
            q: Configurations, shape (n, nq).
            demand: ``M a + nle - loads``, shape (n, nv).
        """
        ...

    def coordinates(self, mechanism: Mechanism) -> Mapping[str, Coordinate]:
        """Return the coordinates that the drives act along, by name."""
        ...


class DriveAtEveryJoint(Record, frozen=True):
    """A drive at every joint of an open chain, without constraints: each joint's demand is its effort."""

    closure: Closure

    @property
    def driven(self) -> Flags:
        """Every joint, shape (nv,)."""
        return np.ones(self.closure.model.nv, dtype=bool)

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Multipliers]:
        """Return the demand itself."""
        return demand, Multipliers.known(np.zeros((*demand.shape[:-1], 0)), 0)

    def coordinates(self, mechanism: Mechanism) -> Mapping[str, Coordinate]:
        """Return those of all joints."""
        return {name: mechanism.coordinates[name] for name in mechanism.joints}


class DriveAtEveryLeader(Record, frozen=True):
    """A drive at every joint that mimics no other: it carries what those that mimic it demand, too.

    With f the followers, l the leaders, and W = (W_f W_l) the rows of the couplings,
    ``tau_l = demand_l - (W_f^-1 W_l)^T demand_f`` and ``lam = W_f^-T demand_f``.

    Attributes:
        closure: The couplings.
        followers: Indices in v of the joints that mimic others, one of each row, shape (m,).
    """

    closure: Closure
    followers: Indices

    @property
    def driven(self) -> Flags:
        """Every joint that mimics no other, shape (nv,)."""
        driven = np.ones(self.closure.model.nv, dtype=bool)
        driven[self.followers] = False
        return driven

    @cached_property
    def _weights(self) -> Array:
        """The rows W of the couplings, the same at all configurations, shape (m, nv)."""
        return self.closure.rows(self.closure.state(pin.neutral(self.closure.model)))

    def efforts(self, t: Array, q: Array, demand: Array) -> tuple[Array, Multipliers]:
        """Return the efforts of the leaders, 0 for the followers, and the multipliers."""
        rows = self._weights
        lam = np.asarray(np.linalg.solve(rows[:, self.followers].T, demand[:, self.followers].T).T, dtype=np.float64)
        tau = demand - lam @ rows
        tau[:, self.followers] = 0.0
        return tau, Multipliers.known(lam, self.closure.size)

    def coordinates(self, mechanism: Mechanism) -> Mapping[str, Coordinate]:
        """Return those of the joints that mimic no other."""
        leaders = (name for name, joint in mechanism.joints.items() if joint.v not in self.followers)
        return {name: mechanism.coordinates[name] for name in leaders}


def actuation(mechanism: Mechanism, drives: Sequence[str], prescribed: Sequence[str]) -> Actuation:
    """Return the drives of a run.

    Args:
        mechanism: The mechanism.
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
    constraints, closure = mechanism.constraints, mechanism.closure
    if not constraints:
        return DriveAtEveryJoint(closure)
    followers = followers_of(constraints)
    return None if followers is None else DriveAtEveryLeader(closure, followers)


def followers_of(constraints: Sequence[Constraint]) -> Indices | None:
    """Return the joints that mimic others, one of each constraint; ``None`` where there are other constraints."""
    followers = {joint for constraint in constraints if (joint := getattr(constraint, "follower", None)) is not None}
    return np.array(sorted(followers), dtype=np.intp) if len(followers) == len(constraints) else None
