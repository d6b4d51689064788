"""Couplings of one mechanism: relations between joint coordinates, most of them sums that stay constant."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, Indices
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import LinearCoordinate, sum_of
from pinarm.mechanics.couplings.transmissions import Kink, Transmission
from pinarm.mechanics.geometry.kinematics import Kinematics, new_data
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import crossed
from pinarm.mechanics.joints import Joint
from pinarm.records import AbstractRecord, Record

if TYPE_CHECKING:
    from pinarm.mechanics.forces.force_element import Edge
    from pinarm.mechanics.laws.motion_law import MotionLaw


class JointRelation(ABC):
    """An equation between joint coordinates, held by forces on the bodies that it couples; a constraint of one row.

    Its multiplier is the effort at the joint whose coefficient in the row is 1. A relation in pieces, as of a cam, says
    where these meet: steps of integrations end there; see ``ForceElement`` for ``edges``, ``marked`` and ``passed``.

    Attributes:
        side: Sense in which its multiplier can act, 1 or -1; 0 where it holds both ways.
    """

    name: str
    kind: str
    missing: str
    size: int = 1

    @property
    def side(self) -> float:
        return 0.0

    @property
    def flaw(self) -> str:
        return ""

    @property
    def in_pieces(self) -> bool:
        return False

    def flawed(self, q: Array) -> Flags:
        """Return at which configurations, shape (n, nq), no part of its kind can do what it says, shape (n,)."""
        return np.zeros(len(q), dtype=bool)

    def whereabouts(self, q: Array) -> str:
        """Return the place of the coupling at a configuration, shape (nq,), such as ``cam = 30 deg``; may be empty."""
        return ""

    def has_kink(self, q: Array) -> bool:
        """Return whether the row has another slope to either side of a configuration, shape (1, nq)."""
        return False

    def edges(self) -> Sequence[Edge]:
        return ()

    def passages(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        """Return when one piece meets the next where joints follow laws, by their index in v, between instants [s]."""
        return []

    def marked(self, laws: Mapping[int, MotionLaw], start: float, end: float) -> list[float]:
        return []

    def passed(self, q: Array, v: Array) -> bool:
        return False

    def push(self, q: Array, lam: Array) -> Array:
        """Return the size of its forces at configurations, shape (n, nq), from its multipliers, both (n,)."""
        return lam

    def gap(self, state: Kinematics) -> Array:
        return self.gaps_at(state.q[None])

    def rows(self, state: Kinematics) -> Array:
        return self.rows_at(state.q[None])

    def drift(self, state: Kinematics) -> Array:
        return self.drifts_at(state.q[None], state.v[None])

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        """Return where its wrenches, which are linear in its multiplier between, change their slope."""
        return []

    @property
    @abstractmethod
    def joints(self) -> Indices:
        """Indices in v of the joints that it couples, ascending."""

    @property
    @abstractmethod
    def known(self) -> bool:
        """Whether the wrenches on bodies that do what the multiplier does are known."""

    @property
    @abstractmethod
    def second(self) -> int:
        """Index of the joint that moves the second member; the wrenches must be known."""

    @abstractmethod
    def unit(self, row: int) -> Unit:
        """Return the unit of the gap."""

    @abstractmethod
    def gaps_at(self, q: Array) -> Array:
        """Return the gaps [m or rad] at configurations, shape (n, nq), as an array of shape (n,)."""

    @abstractmethod
    def rows_at(self, q: Array) -> Array:
        """Return the row of G at configurations, shape (n, nq), as an array of shape (n, nv)."""

    @abstractmethod
    def drifts_at(self, q: Array, v: Array) -> Array:
        """Return ``G' v`` in states, shapes (n, nq) and (n, nv), as an array of shape (n,)."""

    @abstractmethod
    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        """Return wrenches of multipliers, shape (n, 1), on links: joint index -> [f; m] at the world's origin, (n, 6).

        Their virtual power is lam times the row. Empty where the wrenches are not known: the multipliers are then
        efforts at the coupled joints only.
        """

    @abstractmethod
    def transmitted(self, links: LinkPlacements, lam: Array) -> tuple[Array, Array]:
        """Return where the second member is acted on [m], (n, 3), and [f; m] on it there, world axes, (n, 6).

        lam are multipliers, shape (n, 1); the wrenches must be known.
        """

    @abstractmethod
    def parts(self) -> dict[str, Unit]:
        """Return the names of single forces, moments and measures of what transmits it, with their units."""

    @abstractmethod
    def part(self, name: str, q: Array, lam: Array) -> Array:
        """Return one of them at configurations, shape (n, nq), with multipliers, shape (n,), as an array (n,)."""

    @property
    @abstractmethod
    def description(self) -> str:
        """Transmitting parts, in words, such as ``two strands, pretension 50 N``."""


class Coupling(AbstractRecord, JointRelation, frozen=True):
    """A sum of joint coordinates that stays constant; its multiplier is the effort at a joint of weight 1.

    Attributes:
        constant: c, its value at all times.
        follower: Index in v of the joint that mimics the other one and has no drive; ``None`` where either may be
            driven.
        transmission: The wrenches on bodies that do what the multiplier does; ``None`` where they are not known.
    """

    name: str
    kind: str
    coordinate: LinearCoordinate
    constant: float
    follower: int | None = None
    transmission: Transmission | None = None
    missing: str = ""
    size: int = 1

    @property
    def joints(self) -> Indices:
        return np.flatnonzero(self.coordinate.weights)

    @property
    def known(self) -> bool:
        return self.transmission is not None

    @property
    def second(self) -> int:
        return self._known.second

    @property
    def _known(self) -> Transmission:
        assert self.transmission is not None
        return self.transmission

    def unit(self, row: int) -> Unit:
        return self.coordinate.unit

    def gaps_at(self, q: Array) -> Array:
        """Return ``sum_i w_i q_i - c`` at every configuration."""
        return np.asarray(q[:, self.coordinate.places] @ self.coordinate.weights - self.constant)

    def rows_at(self, q: Array) -> Array:
        return np.broadcast_to(self.coordinate.weights, (len(q), len(self.coordinate.weights)))

    def drifts_at(self, q: Array, v: Array) -> Array:
        return np.zeros(len(q))

    def wrenches(self, links: LinkPlacements, lam: Array) -> dict[int, Array]:
        return self.transmission.on_links(links, lam[..., 0]) if self.transmission else {}

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        return self.transmission.kinks(links) if self.transmission else []

    def transmitted(self, links: LinkPlacements, lam: Array) -> tuple[Array, Array]:
        known = self._known
        wrench = known.on_links(links, lam[..., 0])[known.second]
        point = links.places[:, known.carrier] + np.matvec(links.turns[:, known.carrier], known.point)
        return point, np.concatenate([wrench[:, :3], wrench[:, 3:] - crossed(point, wrench[:, :3])], axis=1)

    def parts(self) -> dict[str, Unit]:
        return self.transmission.parts() if self.transmission else {}

    def part(self, name: str, q: Array, lam: Array) -> Array:
        return self._known.part(name, lam)

    @property
    def description(self) -> str:
        return self.transmission.words if self.transmission else f"its forces on bodies are not known: {self.missing}"


def coupled(
    model: pin.Model, joints: Mapping[str, Joint], name: str, kind: str, weights: Mapping[Joint, float], constant: float
) -> Coupling:
    """Return the coupling ``sum_i w_i q_i = constant``; the first joint gives the unit."""
    first = next(iter(weights))
    if len(weights) < 2:
        raise InputError(f"the joint {first.name} cannot be coupled to itself", expected="two joints")
    coordinate = sum_of(model, joints, [first.name])
    row = np.zeros(model.nv)
    for joint, weight in weights.items():
        row[joint.v] = weight
    return Coupling(name, kind, LinearCoordinate(first.unit, row, coordinate.places), constant)


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
        if coupling.known:
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
    jacobian = pin.computeJointJacobian(model, new_data(model), pin.neutral(model), joint).reshape(6, -1)
    motions = jacobian[:, own.idx_v : own.idx_v + own.nv]
    return np.asarray(np.linalg.svd(motions.T)[2][own.nv :])
