"""Couplings of one mechanism: relations between joint coordinates, most of them sums that stay constant."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import Constraint, LinearCoordinate, Parts, sum_of
from pinarm.mechanics.couplings.transmissions import Kink, Transmission
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.link_tree import LinkTree
from pinarm.mechanics.joints import Joint
from pinarm.records import AbstractRecord, Record

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.cam import CamCoupling


class JointRelation(AbstractRecord, Constraint, frozen=True):
    """An equation between joint coordinates, held by forces on the bodies that it couples; a constraint of one row.

    Its multiplier is the effort at the joint whose coefficient in the row is 1.

    Attributes:
        transmission: The wrenches on bodies that do what the multiplier does; ``None`` where they are not known.
        missing: Why they are not.
    """

    name: str
    kind: str
    transmission: Transmission | None = None
    missing: str = ""

    @property
    def parts(self) -> Parts:
        return [(1.0, self)]

    @property
    def known(self) -> Transmission:
        """The transmission, which must be known."""
        assert self.transmission is not None
        return self.transmission

    def gap(self, state: Kinematics) -> Array:
        return self.at(state.q[None])

    def rows(self, state: Kinematics) -> Array:
        return self.rows_at(state.q[None])

    def drift(self, state: Kinematics) -> Array:
        return self.drifts_at(state.q[None], state.v[None])

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        return self.transmission.wrenches(links, lam[..., 0]) if self.transmission else {}

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        """Return where its wrenches, which are linear in its multiplier between, change their slope."""
        return self.transmission.kinks(links) if self.transmission else []

    @property
    def description(self) -> str:
        return self.transmission.words if self.transmission else f"its forces on bodies are not known: {self.missing}"

    @property
    @abstractmethod
    def joints(self) -> Indices:
        """Indices in v of the joints that it couples, ascending."""

    @abstractmethod
    def at(self, q: Array) -> Array:
        """Return the gaps [m or rad] at configurations, shape (n, nq), as an array of shape (n,)."""

    @abstractmethod
    def rows_at(self, q: Array) -> Array:
        """Return the row of G at configurations, shape (n, nq), as an array of shape (n, nv)."""

    @abstractmethod
    def drifts_at(self, q: Array, v: Array) -> Array:
        """Return ``G' v`` in states, shapes (n, nq) and (n, nv), as an array of shape (n,)."""


class Coupling(JointRelation, frozen=True, kw_only=True):
    """A sum of joint coordinates that stays constant; its multiplier is the effort at a joint of weight 1.

    Attributes:
        constant: c, its value at all times.
        follower: Index in v of the joint that mimics the other one and has no drive; ``None`` where either may be
            driven.
    """

    coordinate: LinearCoordinate
    constant: float
    follower: int | None = None

    @property
    def joints(self) -> Indices:
        return np.flatnonzero(self.coordinate.weights)

    def unit(self, row: int) -> Unit:
        return self.coordinate.unit

    def at(self, q: Array) -> Array:
        """Return ``sum_i w_i q_i - c`` at every configuration."""
        return np.asarray(q[:, self.coordinate.places] @ self.coordinate.weights - self.constant)

    def rows_at(self, q: Array) -> Array:
        return self.coordinate.rows_at(q)

    def drifts_at(self, q: Array, v: Array) -> Array:
        return np.zeros(len(q))


def cams_of(constraints: Iterable[Constraint]) -> list[CamCoupling]:
    """Return the cams among constraints."""
    return [cast("CamCoupling", tie) for tie in constraints if tie.kind == "cam"]


def coupled(
    model: pin.Model, joints: Mapping[str, Joint], name: str, kind: str, weights: Mapping[Joint, float],
    constant: float, transmission: Transmission | None = None, missing: str = "",
) -> Coupling:  # fmt: skip
    """Return the coupling ``sum_i w_i q_i = constant``; the first joint gives the unit."""
    first = next(iter(weights))
    if len(weights) < 2:
        raise InputError(f"the joint {first.name} cannot be coupled to itself", expected="two joints")
    coordinate = sum_of(model, joints, [first.name])
    row = np.zeros(model.nv)
    for joint, weight in weights.items():
        row[joint.v] = weight
    linear = LinearCoordinate(first.unit, row, coordinate.places)
    return Coupling(name, kind, transmission, "" if transmission else missing, coordinate=linear, constant=constant)


class OpenReaction(Record, frozen=True):
    """The part of a joint's reaction that couplings leave open.

    Attributes:
        wrenches: Wrenches [f; m] at the joint's origin, in its own axes, that span what they may add, shape (k, 6).
    """

    couplings: tuple[JointRelation, ...]
    wrenches: Array

    def __str__(self) -> str:
        named = (f"'{coupling.name}' ({coupling.kind}): {coupling.missing}" for coupling in self.couplings)
        return "couplings leave it open: " + "; ".join(named)


def left_open(model: pin.Model, couplings: Sequence[JointRelation]) -> dict[int, OpenReaction]:
    """Return the joints whose reactions are open, by their index.

    At a coupled joint all six components are: part of the coupling may be within it. At a joint between, its efforts
    are known, so that wrenches that do power on its own motion are not open.
    """
    reactions: dict[int, OpenReaction] = {}
    for coupling in couplings:
        if coupling.transmission:
            continue
        moved = set(coupling.joints.tolist())
        coupled = {k for k in range(1, model.njoints) if model.joints[k].idx_v in moved}
        for joint in _between(model, coupled):
            others = reactions[joint].couplings if joint in reactions else ()
            wrenches = np.eye(6) if joint in coupled else _without_power(model, joint)
            if joint in reactions and len(reactions[joint].wrenches) > len(wrenches):
                wrenches = reactions[joint].wrenches
            reactions[joint] = OpenReaction((*others, coupling), wrenches)
    return reactions


def _between(model: pin.Model, coupled: set[int]) -> list[int]:
    paths = [{int(j) for j in model.supports[joint]} for joint in coupled]
    carrying = set.intersection(*(path - {joint} for path, joint in zip(paths, coupled, strict=True)))
    return sorted(set.union(*paths) - carrying)


def _without_power(model: pin.Model, joint: int) -> Array:
    """Return the wrenches that do no power on a joint's own motion, in its axes, shape (6 - nv, 6)."""
    own = model.joints[joint]
    motions = LinkTree.of(model).subspace[:, own.idx_v : own.idx_v + own.nv]
    return np.asarray(np.linalg.svd(motions.T)[2][own.nv :])
