"""Tables of a mechanism: bodies, joints, loops and couplings, forces and drives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.self_stresses import joint_kind
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.language import decimals, said, told
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.joints import Joint, moved_links, screw_of
from pinarm.mechanics.loops.loop_joints import CableLoop, LoopJoint
from pinarm.mechanics.planar_drawing import FAR
from pinarm.mechanics.rotors import GearedRotor
from pinarm.use.result.presentation import DEGREE, Presentation
from pinarm.use.show.labels import PLAIN
from pinarm.use.show.notebook import ReportTable, number, unit_text, with_unit

FRAME = "frame"
"""Name of the ground."""

NAMED = 3
"""Links of a body that are named."""

WITHIN = 1e-12
"""Part of a unit vector that is rounding."""


def mechanism_tables(mechanism: Mechanism, how: Presentation = PLAIN) -> list[ReportTable]:
    """Return the tables of a mechanism, in the units of a presentation, without those that would be empty."""
    tables = [_bodies(mechanism, how), _joints(mechanism, how), _constraints(mechanism), _acting(mechanism)]
    return [table for table in tables if table.rows]


def body_name(model: pin.Model, index: int) -> str:
    """Return the name of the body behind a joint: that of its first link."""
    return moved_links(model, index)[0] if index else said(FRAME)


def _bodies(mechanism: Mechanism, how: Presentation) -> ReportTable:
    model = mechanism.model
    (kg, mass), (m, length), (kg_m2, inertia) = (how.scale(Series("", unit(text), np.zeros(0))) for text in MEASURES)
    rows = [_body(model, index, np.array([kg, m, m, m, kg_m2, kg_m2, kg_m2])) for index in range(1, model.njoints)]
    total = kg * sum(inertia.mass for inertia in list(model.inertias)[1:])
    headings = [said("Body"), said("fixed to it"), with_unit(said("mass"), mass),
                *(with_unit(x, length) for x in "xyz"), *(with_unit(f"I{x}{x}", inertia) for x in "xyz")]  # fmt: skip
    centre = "Centre of mass in the axes of the body's joint; moments of inertia about it, in the same axes."
    moving = said("Mass that moves: {mass} {unit}.", mass=decimals(number(total)), unit=unit_text(mass))
    return ReportTable(headings, rows, range(2), "Bodies", f"{moving} {said(centre)}")


MEASURES = ("kg", "m", "kg*m^2")
"""SI units of masses, places and moments of inertia."""


def _body(model: pin.Model, index: int, scales: Array) -> Sequence[str]:
    first, *others = moved_links(model, index)
    more = [said("{count} more", count=len(others) - NAMED)] if len(others) > NAMED else []
    inertia = model.inertias[index]
    values = scales * np.array([inertia.mass, *inertia.lever, *np.diag(inertia.inertia)])
    numbers = [number(x) for x in values.tolist()]
    return [first, ", ".join([*others[:NAMED], *more]), *(numbers if inertia.mass else ["0", *[""] * 6])]


def _joints(mechanism: Mechanism, how: Presentation) -> ReportTable:
    model, rows = mechanism.model, []
    for index in range(1, model.njoints):
        name, screw = model.names[index], screw_of(model.joints[index])
        bodies = body_name(model, model.parents[index]), body_name(model, index)
        way = (_direction(screw[1]) if screw else "", _range(model, mechanism.joints.get(name), how))
        rows.append([name, said(joint_kind(model, index)), *bodies, *way])
    headings = list(map(said, ("Joint", "kind", "from", "to", "axis", "range")))
    return ReportTable(headings, rows, range(6), "Joints", "Axes in those of the joint.")


def _direction(axis: Array) -> str:
    """Return an axis as ``z``, or as three numbers."""
    for name, vector in zip("xyz", np.eye(3), strict=True):
        for sign in (1.0, -1.0):
            if np.abs(axis - sign * vector).max() < WITHIN:
                return name if sign > 0.0 else f"-{name}"
    return decimals(" ".join(f"{x + 0.0:.4g}" for x in axis))


def _range(model: pin.Model, joint: Joint | None, how: Presentation) -> str:
    if joint is None:
        return ""
    low, high = model.lowerPositionLimit[joint.q], model.upperPositionLimit[joint.q]
    if min(-low, high) >= float(FAR):
        return said("unlimited")
    factor, measured = how.scale(Series("", joint.unit, np.zeros(0)))
    shown = "°" if measured == DEGREE else f" {unit_text(measured)}"
    return said("{low:.6g} to {high:.6g}{unit}", low=low * factor, high=high * factor, unit=shown)


def _constraints(mechanism: Mechanism) -> ReportTable:
    headings = list(map(said, ("Loop or coupling", "kind", "between", "rows")))
    return ReportTable(headings, list(_ties(mechanism)), range(3), "Joints that close loops, and couplings")


def _ties(mechanism: Mechanism) -> Iterator[Sequence[str]]:
    for tie in mechanism.constraints:
        if isinstance(tie, LoopJoint):
            frames = [mechanism.model.frames[index].name for index in (tie.first, tie.second)]
            yield tie.name, said(tie.kind), said(" and ").join(frames), str(tie.size)
        elif isinstance(tie, JointRelation):
            yield tie.name, said(tie.kind), told(tie.description), "1"
        elif isinstance(tie, CableLoop):
            yield tie.name, said(tie.kind), told(tie.path.words(mechanism.model)), "1"
        elif isinstance(tie, GearedRotor):
            yield tie.name, said("rotor"), tie.rotor.name, "1"


def _acting(mechanism: Mechanism) -> ReportTable:
    rows = [(said("force"), name, told(element.description)) for name, element in mechanism.forces.items()]
    rows += [(said("dry friction"), contact.name, "") for contact in mechanism.frictions]
    rows += [
        (said("drive"), name, said("at {place}", place=drive.coordinate)) for name, drive in mechanism.drives.items()
    ]
    return ReportTable([said("What acts"), said("name"), ""], rows, range(3), "Forces and drives")
