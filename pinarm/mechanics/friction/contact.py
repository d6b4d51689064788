"""Where dry friction acts: the slip of a joint, of a loop joint or between the members of a coupling, and its law.

A slip with several components, of a joint that turns and slides or turns about a point, has one contact for each, all
with one name, one law and one bearing: friction is against the direction of the slip, and its limit is that of its
length. Of a joint with one component the direction is 1 or -1.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Flags, vecmat
from pinarm.input.units import Unit, unit
from pinarm.mechanics.coordinates import LinearCoordinate
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.couplings.transmissions import FixedContact, Kink
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import METRE, RADIAN
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.rotors import GearedRotor
from pinarm.records import Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.mechanics.coordinates import PairCoordinate
    from pinarm.mechanics.friction.coupling_friction import CamSlip, GearSlip

STRAIGHT = 1e-11
"""Part of a normal force across a line that rounding leaves of one along it."""


class Bearing(Record, frozen=True):
    """The load of one joint: ``N = sum_p |P_p w| + preload`` for the wrench ``w = [F; M]`` that it transmits.

    With a the joint's axis, F and M the force and the moment that the joint transmits, and an index n for what is
    normal to the axis:

    - One bearing carries F_n. Two, ``span`` apart and centred at the joint, carry ``F_n / 2 +- M_n x a / span``, which
      balances F_n and M_n; each has friction of its own.
    - A joint that turns slips on the circumference of its journals, at ``radius``, and on its shoulder, which carries
      the axial force, at ``thrust_radius``.
    - A joint that slides slips along its guides; a key at ``radius`` carries the moment about the axis, ``|M_a| /
      radius``.
    - A cylindrical joint slips on the circumference of its journals, at ``radius``, and along them.
    - A ball joint slips on its ball, of ``radius``, which carries F: the moment ``mu r F`` is against the angular
      velocity.

    A journal has the moment ``mu r F_n`` of textbooks. F_n being the resultant, of normal force and friction together,
    a dry journal with one line of contact has ``sin(atan mu)`` in place of mu: 0.5 % less at 0.1.

    The joint of the tree is centred at the origin of its child, a loop joint at its second frame. A part of the
    reaction for which there is no size has no friction.

    Attributes:
        parts: P, from wrenches to normal forces [N] times their levers, which are radii [m] or 1; shape (p, 3, 6).
        preload: [N*m or N].
    """

    parts: Array
    preload: float = 0.0

    @classmethod
    def none(cls) -> Bearing:
        return cls(np.zeros((0, 3, 6)))

    @classmethod
    def journal(
        cls, axis: Array, radius: float, thrust_radius: float = 0.0, span: float = 0.0, preload: float = 0.0
    ) -> Bearing:
        """Return the bearings of a joint that turns; a size of 0 is one that is not given.

        Args:
            axis: Unit vector, shape (3,).
            radius: Of the journals [m].
            thrust_radius: Mean radius of the shoulder [m].
            span: Distance between two journals [m]; one journal where it is 0.
            preload: Normal force that is always there [N].
        """
        thrust = [_component(axis, thrust_radius)] if thrust_radius else []
        return cls(np.array([*(radius * part for part in _radial(axis, span)), *thrust]), radius * preload)

    @classmethod
    def guide(cls, axis: Array, radius: float = 0.0, span: float = 0.0, preload: float = 0.0) -> Bearing:
        """Return the guides of a joint that slides; see ``journal``. ``radius`` is the lever of their key [m]."""
        key = [_component(np.concatenate([np.zeros(3), axis]), 1.0 / radius)] if radius else []
        return cls(np.array([*_radial(axis, span), *key]), preload)

    @classmethod
    def ball(cls, radius: float, preload: float = 0.0) -> Bearing:
        """Return a ball in its socket, which slips at its radius [m] under the whole force."""
        return cls(radius * np.eye(3, 6)[None], radius * preload)

    @classmethod
    def thread(cls, axis: Array, lever: float) -> Bearing:
        """Return a bearing loaded by the force along an axis, times a lever."""
        return cls(_component(axis, lever)[None])

    @classmethod
    def along(cls, lever: float) -> Bearing:
        """Return a bearing loaded by a multiplier, the first component of a wrench, times a lever."""
        return cls.thread(np.eye(3)[0], lever)

    def load(self, wrench: Array) -> Array:
        """Return N of wrenches, shape (.., 6), as an array of shape (..)."""
        return np.asarray(self.most(wrench) + self.preload)

    def most(self, wrench: Array) -> Array:
        """Return the most by which adding wrenches, shape (.., 6), can change N, shape (..)."""
        return np.asarray(np.sqrt((np.matvec(self.parts, wrench[..., None, :]) ** 2).sum(axis=-1)).sum(axis=-1))

    def slope(self, wrench: Array) -> Array:
        """Return the gradient of N, shape (.., 6); 0 of a normal force that vanishes."""
        normals = np.matvec(self.parts, wrench[..., None, :])
        size = np.sqrt((normals**2).sum(axis=-1, keepdims=True))
        ways = np.divide(normals, size, out=np.zeros_like(normals), where=size > 0.0)
        return np.asarray(np.einsum("...pi,pij->...j", ways, self.parts))

    def along_lines(self, wrenches: Array) -> Array | None:
        """Return normal forces with signs where those of k wrenches, shape (k, 6), are along one line in each part.

        Shape (p, k), linear in the wrenches, so that N of their sums is a sum of absolute values; ``None`` elsewhere.
        """
        normals = np.matvec(self.parts[:, None], wrenches)
        scale = np.sqrt((normals**2).sum(axis=-1)).max(axis=0, initial=0.0)
        _, sizes, lines = np.linalg.svd(normals / np.where(scale > 0.0, scale, 1.0)[:, None], full_matrices=False)
        if len(wrenches) > 1 and (sizes[:, 1] > STRAIGHT).any():
            return None
        return np.asarray(np.matvec(normals, lines[:, 0]))


def _component(row: Array, lever: float) -> Array:
    """Return the part of one component of a wrench, or of its force, times a lever, shape (3, 6)."""
    part = np.zeros((3, 6))
    part[0, : len(row)] = lever * row
    return part


def _radial(axis: Array, span: float) -> list[Array]:
    """Return the parts that carry what is normal to the axis: of one bearing, or of two."""
    across = np.eye(3) - np.outer(axis, axis)
    forces = np.hstack([across, np.zeros((3, 3))])
    if not span:
        return [forces]
    turned = np.cross(np.eye(3), axis).T  # M -> M x a
    moments = np.hstack([np.zeros((3, 3)), turned / span])
    return [0.5 * forces + moments, 0.5 * forces - moments]


class FrictionLaw(ValueRecord, frozen=True):
    """Resistance of one joint to slip, as a function of its load N and its speed u >= 0.

    While it slips ``F = mu(u) N + c(u) + viscous u``; at rest the friction is whatever keeps the joint at rest, up to
    ``static_mu N + static_constant``. With Stribeck's velocity w, ``mu(u) = mu + (static_mu - mu) exp(-(u / w)^2)``, c
    likewise; without one both drop at once when slip begins.

    N is in units of F: the normal forces in a bearing times their levers (``Bearing.load``).

    Attributes:
        constant: Part that does not depend on the load, while it slips [N*m or N].
        viscous: [N*m*s/rad or N*s/m].
        stribeck: w [rad/s or m/s]; 0 without a transition.
    """

    mu: float
    static_mu: float
    constant: float
    static_constant: float
    viscous: float = 0.0
    stribeck: float = 0.0

    def slipping(self, speed: Array | float) -> tuple[Array, Array]:
        """Return ``mu(u)`` and ``c(u) + viscous u``, each of the shape of the speeds u >= 0."""
        speed = np.asarray(speed)
        rest = np.exp(-((speed / self.stribeck) ** 2)) if self.stribeck else np.zeros_like(speed)
        mu = self.mu + (self.static_mu - self.mu) * rest
        constant = self.constant + (self.static_constant - self.constant) * rest
        return mu, constant + self.viscous * speed

    def words(self, effort: Unit) -> str:
        speed = RADIAN if effort == unit("N*m") else METRE
        sizes = ("mu ", self.mu, self.static_mu, ""), ("", self.constant, self.static_constant, f" {effort}")
        parts = [
            f"{name}{slipping:g}{measure}" + (f" ({resting:g}{measure} at rest)" if resting != slipping else "")
            for name, slipping, resting, measure in sizes
            if resting
        ]
        parts += [f"viscous {self.viscous:g} {effort}*s/{speed}"] if self.viscous else []
        parts += [f"Stribeck's velocity {self.stribeck:g} {speed}/s"] if self.stribeck else []
        return ", ".join(parts) or "none"

    @property
    def resting(self) -> tuple[float, float]:
        return self.static_mu, self.static_constant

    @property
    def loaded(self) -> bool:
        return self.static_mu > 0.0


class CoupledSlip(LinearCoordinate, frozen=True):
    """The slip of threads, teeth and belts: a sum of joint velocities.

    Attributes:
        acting: What friction does to the members; ``None`` where it acts as efforts at the coupled joints.
    """

    acting: FixedContact | None = None

    def wrenches(self, links: LinkPlacements, effort: Array) -> dict[int, Array]:
        return self.acting.wrenches(links, effort) if self.acting else {}


Slip: TypeAlias = "LinearCoordinate | PairCoordinate | CamSlip | GearSlip"
"""A velocity u = J v: coordinates are slips; ``wrenches`` are those of friction, shape (n,), on links."""


class FrictionContact(Record, frozen=True):
    """One slip u = J v [rad/s or m/s] with the friction f against it [N*m or N], whose load is ``J^T f``.

    Attributes:
        name: ``joint.J``, ``loop.L``, ``coupling.C`` or ``drive.D``: the components of one slip have one name.
        bearing: How its load follows from what is transmitted: of joints by the wrench in the axes of the child, of
            loop joints in those of frame 1, of couplings and gears by the multiplier as its first component.
        of: What slips: a joint of the tree by its index, a loop joint, a coupling, or the gear of a rotor.
        shared: Whether what rigid bodies leave open of its load is taken from the least multipliers.
        part: Component of the slip: ``x``, ``y``, ``z`` of a ball joint, ``tangential`` and ``axial`` of a cylindrical
            one; empty where there is one.
    """

    unshown = ("bearing",)

    name: str
    effort: Unit
    law: FrictionLaw
    bearing: Bearing
    slip: Slip
    of: int | LoopJoint | JointRelation | GearedRotor
    shared: bool = False
    part: str = ""

    @property
    def quantity(self) -> str:
        """Name of the friction, such as ``joint.J.friction`` or ``loop.L.friction.axial``."""
        return f"{self.name}.friction.{self.part}" if self.part else f"{self.name}.friction"

    @property
    def coupling(self) -> JointRelation | None:
        """The coupling between whose members it acts."""
        return self.of if isinstance(self.of, JointRelation) else None

    @property
    def replaces(self) -> bool:
        """Whether friction alone ties what the coupling would: of a belt that slips."""
        return self.coupling is not None and self.coupling.kind == "belt"

    @property
    def standing(self) -> LinearCoordinate | None:
        """Sum of joint coordinates, the largest weight 1, that stands still where the slip is 0, if J is constant."""
        if not isinstance(self.slip, LinearCoordinate):
            return None
        weights = self.slip.weights / np.abs(self.slip.weights).max()
        return LinearCoordinate(self.slip.unit, weights, self.slip.places)

    @property
    def _acting(self) -> FixedContact | None:
        return self.slip.acting if isinstance(self.slip, CoupledSlip) else None

    def kinks(self, links: LinkPlacements) -> list[Kink]:
        """Return where the wrenches of friction change their slope; see ``JointRelation``."""
        return self._acting.kinks(links) if self._acting else []

    def added(self, part: str, f: Array) -> Array:
        """Return the part of friction in a single force or moment of the coupling [N or N*m], shape (n,)."""
        acting = self._acting
        return acting.single[part].at(f) if acting and part in acting.single else np.zeros_like(f)

    def transmitted(self, links: LinkPlacements, joints: Array, lam: dict[str, Array]) -> Array:
        """Return the wrench that the bearing carries, in axes in which its parts are given, shape (n, 6).

        That of a coupling or a gear has its load as first component.

        Args:
            joints: Wrenches of parents on children, at the joints' origins, world axes, shape (n, njoints, 6).
            lam: Multipliers of the constraints by name, each of shape (n, m).
        """
        if not self.law.loaded:
            return np.zeros((len(joints), 6))
        if isinstance(self.of, int):
            return _turned_back(links.turns[:, self.of], joints[:, self.of])
        if isinstance(self.of, LoopJoint):
            return _turned_back(links.frame(self.of.first)[0], self.of.wrench(links, lam[self.of.name]))
        multiplier = lam[self.of.name][:, :1]
        if isinstance(self.of, JointRelation):
            multiplier = self.of.push(links.q, multiplier[:, 0])[:, None]
        return np.concatenate([multiplier, np.zeros((len(multiplier), 5))], axis=1)


def _turned_back(turn: Array, wrench: Array) -> Array:
    return np.concatenate([vecmat(wrench[:, :3], turn), vecmat(wrench[:, 3:], turn)], axis=1)


def slip_rows(model: pin.Model, contacts: Sequence[FrictionContact], q: Array) -> Array:
    """Return J of all contacts at configurations, shape (.., nq), as an array of shape (.., k, nv)."""
    if _constant(contacts):
        fixed = _constant_rows(model, tuple(contacts))
        return np.broadcast_to(fixed, (*q.shape[:-1], *fixed.shape))
    states = (Kinematics.at(model, row) for row in q.reshape(-1, q.shape[-1]))
    rows = [[contact.slip.row(state) for contact in contacts] for state in states]
    return np.array(rows).reshape(*q.shape[:-1], len(contacts), model.nv)


def slip_drifts(model: pin.Model, contacts: Sequence[FrictionContact], q: Array, v: Array) -> Array:
    """Return J' v of all contacts in states, shapes (n, nq) and (n, nv), as an array of shape (n, k)."""
    if _constant(contacts):
        return np.zeros((len(q), len(contacts)))
    states = (Kinematics.at(model, *row) for row in zip(q, v, strict=True))
    drifts = [[contact.slip.drift(state) for contact in contacts] for state in states]
    return np.array(drifts).reshape(len(q), len(contacts))


def _constant(contacts: Sequence[FrictionContact]) -> bool:
    """Return whether J is the same in all configurations."""
    return all(isinstance(contact.slip, LinearCoordinate) for contact in contacts)


@lru_cache(maxsize=16)  # asked at every evaluation of an equation of motion
def _constant_rows(model: pin.Model, contacts: tuple[FrictionContact, ...]) -> Array:
    """Return J of contacts whose rows are the same in all configurations, shape (k, nv); not to be written to."""
    state = Kinematics.at(model, pin.neutral(model))
    rows = np.array([contact.slip.row(state) for contact in contacts]).reshape(len(contacts), model.nv)
    rows.flags.writeable = False
    return rows


def same_joint(contacts: Sequence[FrictionContact]) -> Flags:
    """Return a mask of the pairs of contacts that are components of one slip, shape (k, k)."""
    return _same_names(tuple(contact.name for contact in contacts))


def several(contacts: Sequence[FrictionContact]) -> Flags:
    """Return a mask of the contacts whose slip has several components, shape (k,)."""
    return np.asarray(same_joint(contacts).sum(axis=1) > 1)


@lru_cache(maxsize=16)  # asked at every evaluation of an equation of motion
def _same_names(names: tuple[str, ...]) -> Flags:
    return np.array([[name == other for other in names] for name in names], dtype=bool).reshape(len(names), len(names))


def sizes(contacts: Sequence[FrictionContact], x: Array) -> Array:
    """Return the length of the slip that each component, shape (.., k), is of, shape (.., k)."""
    if not several(contacts).any():
        return np.abs(x)
    return np.asarray(np.sqrt(x**2 @ same_joint(contacts).astype(float)))


def unit_vectors(contacts: Sequence[FrictionContact], x: Array) -> Array:
    """Return ``x / |x|`` joint by joint, 0 where x is, of the shape of x, (.., k)."""
    length = sizes(contacts, x)
    return np.divide(x, length, out=np.zeros_like(x), where=length > 0.0)
