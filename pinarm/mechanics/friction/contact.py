"""Where friction acts: the slip of a joint of the tree, or of one that closes a loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, vecmat
from pinarm.input.units import Unit
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements

if TYPE_CHECKING:
    from pinarm.mechanics.couplings.coupling import Kink
    from pinarm.mechanics.friction.bearing import Bearing
    from pinarm.mechanics.friction.law import FrictionLaw
    from pinarm.mechanics.loops.loop_joints import LoopJoint


class FrictionContact(Protocol):
    """One slip u = J v [rad/s or m/s] with the friction f against it [N*m or N], whose load is ``J^T f``."""

    @property
    def name(self) -> str:
        """``joint.J`` or ``loop.L``: the components of one slip have one name."""
        ...

    @property
    def quantity(self) -> str:
        """Name of the friction, ``joint.J.friction``."""
        ...

    @property
    def effort(self) -> Unit:
        """Unit of the friction."""
        ...

    @property
    def law(self) -> FrictionLaw:
        """How it depends on load and speed."""
        ...

    @property
    def bearing(self) -> Bearing:
        """How its load follows from what it transmits."""
        ...

    @property
    def shared(self) -> bool:
        """Whether what rigid bodies leave open of its load is taken from the least multipliers."""
        ...

    @property
    def row_is_constant(self) -> bool:
        """Whether J is the same in all configurations."""
        ...

    def row(self, state: Kinematics) -> Array:
        """Return J, shape (nv,)."""
        ...

    def drift(self, state: Kinematics) -> float:
        """Return J' v."""
        ...

    def wrenches(self, links: LinkPlacements, f: Array) -> dict[int, Array]:
        """Return what the friction, shape (n,), does to links, other than within a joint of the tree.

        Joint index -> [f; m] at the world's origin, world axes, shape (n, 6).
        """
        ...

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        """Return where these wrenches, linear in the friction between, change their slope; see ``JointRelation``."""
        ...

    def transmitted(self, links: LinkPlacements, joints: Array, lam: dict[str, Array]) -> Array:
        """Return the wrench that the bearing carries, in axes in which its parts are given, shape (n, 6).

        Args:
            links: Where the links are.
            joints: Wrenches of parents on children, at the joints' origins, world axes, shape (n, njoints, 6).
            lam: Multipliers of the constraints by name, each of shape (n, m).
        """
        ...


def quantity_of(name: str, part: str = "") -> str:
    """Return the name of a friction in tables."""
    return f"{name}.friction.{part}" if part else f"{name}.friction"


@dataclass(frozen=True, eq=False)
class JointContact:
    """The slip of a joint of the tree along one of its velocities.

    Attributes:
        name: ``joint.J``.
        effort: Unit of the friction.
        index: Pinocchio's joint index.
        v: Index in v.
        law: Of friction.
        bearing: In the axes of the child.
        shared: See ``FrictionContact``.
        part: ``x``, ``y`` or ``z`` of a ball joint, in the axes of the child; empty of a joint with one coordinate.
    """

    name: str
    effort: Unit
    index: int
    v: int
    law: FrictionLaw
    bearing: Bearing = field(repr=False)
    shared: bool = False
    part: str = ""

    @property
    def quantity(self) -> str:
        """``joint.J.friction``, of a ball joint ``joint.J.friction.x``."""
        return quantity_of(self.name, self.part)

    @property
    def row_is_constant(self) -> bool:
        return True

    def row(self, state: Kinematics) -> Array:
        unit = np.zeros(state.model.nv)
        unit[self.v] = 1.0
        return unit

    def drift(self, state: Kinematics) -> float:
        """Return 0: the row is constant."""
        return 0.0

    def wrenches(self, links: LinkPlacements, f: Array) -> dict[int, Array]:
        """Return nothing: it acts within the joint."""
        return {}

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        return []

    def transmitted(self, links: LinkPlacements, joints: Array, lam: dict[str, Array]) -> Array:
        turn = links.turns[:, self.index]
        wrench = joints[:, self.index]
        return np.concatenate([vecmat(wrench[:, :3], turn), vecmat(wrench[:, 3:], turn)], axis=1)


@dataclass(frozen=True, eq=False)
class LoopContact:
    """The slip of a loop joint that turns or slides, or one component of it.

    Attributes:
        name: ``loop.L``.
        effort: Unit of the friction.
        joint: The loop joint.
        slip: What it leaves free, as a joint of one row that holds it.
        law: Of friction.
        bearing: In the axes of the joint's first frame.
        shared: See ``FrictionContact``.
        part: Of a slip with several components: ``tangential`` and ``axial`` of a cylindrical joint, ``x``, ``y`` and
            ``z`` of a ball joint, in the axes of the first frame.
    """

    name: str
    effort: Unit
    joint: LoopJoint
    slip: LoopJoint
    law: FrictionLaw
    bearing: Bearing = field(repr=False)
    shared: bool = False
    part: str = ""

    @property
    def quantity(self) -> str:
        """``loop.L.friction``, and ``loop.L.friction.axial`` of a component."""
        return quantity_of(self.name, self.part)

    @property
    def row_is_constant(self) -> bool:
        return False

    def row(self, state: Kinematics) -> Array:
        return np.asarray(self.slip.rows(state)[0])

    def drift(self, state: Kinematics) -> float:
        return float(self.slip.drift(state)[0])

    def wrenches(self, links: LinkPlacements, f: Array) -> dict[int, Array]:
        return self.slip.wrenches(links, f[:, None])

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        """Return nothing: they are linear."""
        return []

    def transmitted(self, links: LinkPlacements, joints: Array, lam: dict[str, Array]) -> Array:
        """Return the wrench of the first link on the second, at frame 2, in the axes of frame 1."""
        wrench, turn = self.joint.wrench(links, lam[self.joint.name]), links.frame(self.joint.first)[0]
        return np.concatenate([vecmat(wrench[:, :3], turn), vecmat(wrench[:, 3:], turn)], axis=1)


def slip_rows_at(model: pin.Model, contacts: Sequence[FrictionContact], q: Array) -> Array:
    """Return J of all contacts at a configuration, shape (nq,), as an array of shape (k, nv)."""
    if all(contact.row_is_constant for contact in contacts):
        return _constant_rows(model, tuple(contacts))
    return _rows(contacts, Kinematics.at(model, q))


def slip_rows(model: pin.Model, contacts: Sequence[FrictionContact], q: Array) -> Array:
    """Return J of all contacts at configurations, shape (n, nq), as an array of shape (n, k, nv)."""
    if all(contact.row_is_constant for contact in contacts):
        fixed = _constant_rows(model, tuple(contacts))
        return np.broadcast_to(fixed, (len(q), *fixed.shape))
    states = (Kinematics.at(model, row) for row in q)
    return np.array([_rows(contacts, state) for state in states]).reshape(len(q), len(contacts), model.nv)


def slip_drifts(model: pin.Model, contacts: Sequence[FrictionContact], q: Array, v: Array) -> Array:
    """Return J' v of all contacts in states, shapes (n, nq) and (n, nv), as an array of shape (n, k)."""
    if all(contact.row_is_constant for contact in contacts):
        return np.zeros((len(q), len(contacts)))
    states = (Kinematics.at(model, *row) for row in zip(q, v, strict=True))
    return np.array([[contact.drift(state) for contact in contacts] for state in states]).reshape(len(q), len(contacts))


@lru_cache(maxsize=16)  # asked at every evaluation of an equation of motion
def _constant_rows(model: pin.Model, contacts: tuple[FrictionContact, ...]) -> Array:
    """Return J of contacts whose rows are the same in all configurations, shape (k, nv); not to be written to."""
    found = _rows(contacts, Kinematics.at(model, pin.neutral(model)))
    found.flags.writeable = False
    return found


def _rows(contacts: Sequence[FrictionContact], state: Kinematics) -> Array:
    return np.array([contact.row(state) for contact in contacts]).reshape(len(contacts), state.model.nv)
