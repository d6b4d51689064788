"""A tree of links and joints, as any format of model describes it, before Pinocchio sees it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import ModelError, choices

Kind = Literal["fixed", "revolute", "prismatic", "ball", "planar", "floating"]

TRIANGLE = 1e-9
"""Relative violation of the triangle inequality of the principal moments that rounding of printed digits explains."""

NOTHING = 1e-25
"""Moment of inertia that is rounding of 0 [kg*m^2]."""


@dataclass(frozen=True)
class Bounds:
    """Limits of a joint with one coordinate; infinite where the model gives none.

    Attributes:
        lower: Least coordinate [rad or m].
        upper: Largest coordinate [rad or m].
        velocity: Largest speed [rad/s or m/s].
        effort: Largest absolute effort of the drive [N*m or N].
    """

    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf


@dataclass(frozen=True)
class TreeJoint:
    """A joint with the link that it carries.

    Attributes:
        name: Its name.
        kind: How it moves; a revolute joint counts turns.
        parent: Link it is mounted on.
        child: Link it carries.
        placement: Of the joint in its parent link, at coordinate 0.
        offset: Of the child link in the joint.
        axis: Unit vector in the joint's axes, shape (3,): of rotation or sliding, or normal to the plane.
        bounds: Its limits.
        damping: [N*m*s/rad or N*s/m], the same for all its directions.
        friction: Dry friction [N*m or N], likewise.
        stiffness: Of a spring to the rest position [N*m/rad or N/m], likewise.
        rest: Coordinate at which that spring is free [rad or m]; 0 for joints with several coordinates.
        armature: Inertia of a rotor, at the joint [kg*m^2 or kg], likewise.
        drawn: Coordinate at which the model draws it [rad or m].
    """

    name: str
    kind: Kind
    parent: str
    child: str
    placement: pin.SE3
    axis: Array
    offset: pin.SE3 = field(default_factory=pin.SE3.Identity)
    bounds: Bounds = Bounds()
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    armature: float = 0.0
    drawn: float = 0.0


@dataclass(frozen=True)
class Mimic:
    """A joint that a model couples to another: ``q = multiplier * q_of + offset``.

    Attributes:
        joint: The joint that follows.
        of: The joint that leads.
        multiplier: Ratio of the coordinates [rad/rad, m/rad, ...].
        offset: Coordinate of the follower where the leader's is 0 [rad or m].
    """

    joint: str
    of: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Tree:
    """What a model's text says of masses and joints.

    Attributes:
        name: Name of the model.
        links: Inertia of every link about its own frame, 0 where it has none; the root first.
        joints: Every joint after the one that carries its parent link, children before siblings.
        mimics: Joints coupled to others.
        gravity: Field that the text asks for [m/s^2], world axes, shape (3,); ``None`` where it says nothing.
        defects: What cannot be as the text has it, though the model could be built, in words.
        notes: What is not modelled as the text has it, in words.
    """

    name: str
    links: Mapping[str, pin.Inertia]
    joints: tuple[TreeJoint, ...]
    mimics: tuple[Mimic, ...] = ()
    gravity: Array | None = None
    defects: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def root(self) -> str:
        """The link that no joint carries."""
        return next(iter(self.links))


def inertia(mass: float, centre: Array, moments: Array) -> pin.Inertia:
    """Return an inertia about a link's frame; Pinocchio's constructor refuses moments that are negative by rounding.

    Args:
        mass: [kg].
        centre: Mass centre in the link's axes [m], shape (3,).
        moments: Moments and products about it, link's axes [kg*m^2], shape (3, 3).
    """
    made = pin.Inertia(mass, centre, np.zeros((3, 3)))
    made.inertia = moments
    return made


def inertia_defect(moments: Array) -> str:
    """Return what is wrong with an inertia, in words; nothing for one that a body can have.

    Args:
        moments: Moments and products about the mass centre [kg*m^2], shape (3, 3).
    """
    principal = np.linalg.eigvalsh(moments)
    slack = TRIANGLE * np.abs(principal).max() + NOTHING
    if principal[0] < -slack:
        return f"a principal moment of inertia is negative ({principal[0]:g} kg*m^2)"
    if principal[0] + principal[1] < principal[2] - slack:
        return (f"no body has principal moments of inertia {', '.join(f'{m:g}' for m in principal)} kg*m^2: "
                "each is at most the sum of the other two")  # fmt: skip
    return ""


def checked_mimics(mimics: Iterable[Mimic], joints: Mapping[str, Kind]) -> tuple[tuple[Mimic, ...], tuple[str, ...]]:
    """Return the couplings whose leaders exist, and in words those without one.

    Raises:
        ModelError: A joint follows itself, directly or through others, or one that has not one coordinate.
    """
    leaders = {mimic.joint: mimic.of for mimic in mimics}
    kept, orphans = [], []
    for mimic in mimics:
        if mimic.of not in joints:
            close = choices(mimic.of, joints)[1]
            meant = f"; '{close}' does" if close else ""
            orphans.append(f"joint '{mimic.joint}' mimics '{mimic.of}', which does not exist{meant}")
            continue
        if joints[mimic.of] not in ("revolute", "prismatic"):
            raise ModelError(f"joint '{mimic.joint}' mimics '{mimic.of}', which is {joints[mimic.of]}",
                             expected="a leader with one coordinate")  # fmt: skip
        chain = [mimic.joint]
        while chain[-1] in leaders and leaders[chain[-1]] not in chain:
            chain.append(leaders[chain[-1]])
        if chain[-1] in leaders:
            raise ModelError(f"joint '{mimic.joint}' mimics itself: {' -> '.join([*chain, leaders[chain[-1]]])}")
        kept.append(mimic)
    return tuple(kept), tuple(orphans)


def listed(what: str, names: Sequence[str]) -> str:
    """Return names after what they name."""
    return f"{what}{'s' if len(names) > 1 else ''} {several(names)}"


def several(names: Sequence[str], most: int = 6) -> str:
    """Return names in a row, the rest counted where there are many."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def from_z(axis: Array) -> Array:
    """Return the smallest rotation that takes z to a unit vector; half a turn about x for -z. Shape (3, 3)."""
    if axis[2] <= -1.0 + 1e-15:
        return np.diag([1.0, -1.0, -1.0])
    w = np.cross([0.0, 0.0, 1.0], axis)
    skew = pin.skew(w)
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + axis[2]))
