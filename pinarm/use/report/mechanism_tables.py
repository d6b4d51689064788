"""The mechanism of a result in tables: bodies and their masses, joints, loops and couplings, forces and drives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.kinematics.mobility import joint_kind, mobility_of
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.joint_axes import screw_of
from pinarm.mechanics.joints import RADIAN, Joint, moved_links
from pinarm.mechanics.loops.kinds import CableLoop
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.rotors import GearedRotor
from pinarm.use.report.tables import ReportTable, number, shortened, unit_text

if TYPE_CHECKING:
    from pinarm.engine.mechanism import Mechanism
    from pinarm.use.result.result import Result

FRAME = "frame"
"""Name of the ground."""

NAMED = 3
"""Links of a body that are named."""

WITHIN = 1e-12
"""Part of a unit vector that is rounding."""


def mechanism_tables(mechanism: Mechanism) -> list[ReportTable]:
    """Return the tables of a mechanism, without those that would be empty."""
    tables = [_bodies(mechanism), _joints(mechanism), _constraints(mechanism), _acting(mechanism)]
    return [table for table in tables if table.rows]


def mobility_words(result: Result) -> str:
    """Return in a sentence how the mechanism can move where its run begins, and how it is tied."""
    mobility = mobility_of(result.trajectory.mechanism, result.trajectory.q[0])
    counted = f"Mobility {mobility.mobility}: {mobility.joints} joint coordinates"
    if not mobility.rows:
        return f"{counted}, no loop."
    tied = f"{counted}, {mobility.rank} independent of {mobility.rows} rows of constraints"
    if not mobility.degree:
        return f"{tied}; isostatic."
    return (f"{tied}; hyperstatic of degree {mobility.degree}: rigid bodies do not determine all reactions of "
            f"{shortened(', '.join(mobility.undetermined), 200)}.")  # fmt: skip


def body_name(model: pin.Model, index: int) -> str:
    """Return the name of the body behind a joint: that of its first link."""
    return moved_links(model, index)[0] if index else FRAME


def _bodies(mechanism: Mechanism) -> ReportTable:
    model = mechanism.model
    rows = [_body(model, index) for index in range(1, model.njoints)]
    total = sum(inertia.mass for inertia in list(model.inertias)[1:])
    return ReportTable(
        ["Body", "fixed to it", "mass [kg]", *(f"{axis} [m]" for axis in "xyz"),
         *(f"I{axis * 2} [kg·m²]" for axis in "xyz")], rows, range(2),
        "Bodies", f"Mass that moves: {number(total)} kg. Centre of mass in the axes of the body's joint; moments of "
        "inertia about it, in the same axes.",
    )  # fmt: skip


def _body(model: pin.Model, index: int) -> Sequence[str]:
    first, *others = moved_links(model, index)
    more = [f"{len(others) - NAMED} more"] if len(others) > NAMED else []
    inertia = model.inertias[index]
    if not inertia.mass:
        return [first, ", ".join([*others[:NAMED], *more]), "0", *[""] * 6]
    numbers = [inertia.mass, *inertia.lever, *np.diag(inertia.inertia)]
    return [first, ", ".join([*others[:NAMED], *more]), *(number(float(x)) for x in numbers)]


def _joints(mechanism: Mechanism) -> ReportTable:
    model = mechanism.model
    rows = [
        [model.names[index], joint_kind(model, index), body_name(model, model.parents[index]), body_name(model, index),
         _axis(model, index), _range(model, mechanism.joints.get(model.names[index]))]
        for index in range(1, model.njoints)
    ]  # fmt: skip
    return ReportTable(["Joint", "kind", "from", "to", "axis", "range"], rows, range(6), "Joints",
                       "Axes in those of the joint.")  # fmt: skip


def _axis(model: pin.Model, index: int) -> str:
    """Return the axis of a joint with one, in its own axes: ``z``, or three numbers."""
    screw = screw_of(model.joints[index])
    return _direction(screw[1]) if screw else ""


def _direction(axis: Array) -> str:
    for name, vector in zip("xyz", np.eye(3), strict=True):
        for sign in (1.0, -1.0):
            if np.abs(axis - sign * vector).max() < WITHIN:
                return name if sign > 0.0 else f"-{name}"
    return " ".join(f"{x + 0.0:.4g}" for x in axis)


def _range(model: pin.Model, joint: Joint | None) -> str:
    """Return the limits of a joint with one coordinate, angles in degrees."""
    if joint is None:
        return ""
    low, high = model.lowerPositionLimit[joint.q], model.upperPositionLimit[joint.q]
    if not (np.isfinite(low) or np.isfinite(high)):
        return "unlimited"
    factor, unit = (180.0 / np.pi, "°") if joint.unit == RADIAN else (1.0, f" {unit_text(joint.unit)}")
    return f"{low * factor:.6g} to {high * factor:.6g}{unit}"


def _constraints(mechanism: Mechanism) -> ReportTable:
    return ReportTable(["Loop or coupling", "kind", "between", "rows"], list(_ties(mechanism)), range(3),
                       "Joints that close loops, and couplings")  # fmt: skip


def _ties(mechanism: Mechanism) -> Iterator[Sequence[str]]:
    for tie in mechanism.constraints:
        if isinstance(tie, LoopJoint):
            frames = [mechanism.model.frames[index].name for index in (tie.first, tie.second)]
            yield tie.name, tie.kind, f"{frames[0]} and {frames[1]}", str(tie.size)
        elif isinstance(tie, JointRelation):
            yield tie.name, tie.kind, tie.description, "1"
        elif isinstance(tie, CableLoop):
            yield tie.name, tie.kind, tie.path.words(mechanism.model), "1"
        elif isinstance(tie, GearedRotor):
            yield tie.name, "rotor", tie.rotor.name, "1"


def _acting(mechanism: Mechanism) -> ReportTable:
    rows = [("force", name, element.description) for name, element in mechanism.forces.items()]
    rows += [("dry friction", contact.name, "") for contact in mechanism.frictions]
    rows += [("drive", name, f"at {drive.coordinate}") for name, drive in mechanism.drives.items()]
    return ReportTable(["What acts", "name", ""], rows, range(3), "Forces and drives")
