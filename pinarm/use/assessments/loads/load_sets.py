"""Sets of loads of every body at one instant, in balance with its weight and inertia, as finite elements want them.

All that acts on a body, in its own axes: the wrenches of its joints, couplings and force elements, its weight, and its
inertia relief by d'Alembert, at the centre of mass c:

    force  -m a_c,    moment  -(I_c alpha + omega x I_c omega)

Their sum about the origin of the body is the residual of Newton's and Euler's equations; the accelerations in it are
those of forward kinematics.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import OPEN, Quantities
from pinarm.engine.quantities.reactions import Reactions
from pinarm.input.units import Unit, unit
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.kinematics import new_data
from pinarm.mechanics.joints import links_behind
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.rotors import GearedRotor, counted_angle
from pinarm.records import replace
from pinarm.use.result.section import SectionTable

METRE, NEWTON, NEWTON_METRE = unit("m"), unit("N"), unit("N*m")

SHARED = "several frictions or stops hold one motion: rigid bodies do not determine which of them holds how much"

WRENCH = ("x", "y", "z", "Fx", "Fy", "Fz", "Mx", "My", "Mz")
"""Columns of a load: point where it acts, force and moment there."""

SetRow = tuple[str, float, str, str, float, float, float, float, float, float, float, float, float]
"""Set, instant, body, what acts, the point where, force and moment."""


@dataclass(frozen=True, eq=False)
class Action:
    """A load on a body: a wrench at a point.

    Attributes:
        body: Pinocchio's index of the joint that moves the body.
        what: Source of the load, in words.
        point: Point of application [m], world axes, shape (3,).
        wrench: [f; m] about the point [N, N*m], world axes, shape (6,).
        doubt: Why rigid bodies do not determine the load; empty where they do.
    """

    body: int
    what: str
    point: Array
    wrench: Array
    doubt: str = ""


@dataclass(frozen=True, eq=False)
class FreeBody:
    """A body cut free, with all that acts on it.

    Attributes:
        body: Pinocchio's index of the joint that moves it.
        link: Name of its first link.
        actions: Wrenches of joints, couplings and force elements, weight, and inertia relief: they are in balance.
        doubt: Why rigid bodies do not determine one of them; empty where they determine all.
        left_out: Whether its loads are not to be shown because of that.
    """

    body: int
    link: str
    actions: Sequence[Action]
    doubt: str
    left_out: bool


@dataclass(frozen=True, eq=False)
class LoadSet:
    """The loads of all bodies at an instant.

    Attributes:
        name: Its name, such as ``B.radial``.
        rows: A row for each load, and one for each body's residual.
        residual: Largest residual of a body, relative to the sum of the sizes of its loads.
        remarks: Which bodies are left out, and why.
    """

    name: str
    rows: Sequence[SetRow]
    residual: float
    remarks: Sequence[str]

    @classmethod
    def at(cls, row: Quantities, name: str) -> LoadSet:
        """Return the set of one row of a run, without the bodies whose loads rigid bodies do not determine.

        Args:
            row: Quantities of one row; reactions in doubt are kept where it gives the least multipliers.
            name: Name of the set.
        """
        run, rows, residuals, remarks = row.trajectory, list[SetRow](), [0.0], dict[str, list[str]]()
        turns, places = row.reactions.links.turns[0], row.reactions.origins[0]
        for free in free_bodies(row):
            if free.doubt:
                how = "left out" if free.left_out else "least multipliers"
                remarks.setdefault(f"{how}; {free.doubt}", []).append(free.link)
            if free.left_out:
                continue
            inner = np.array([_inwards(action, turns[free.body], places[free.body]) for action in free.actions])
            missed, relative = _residual(inner)
            residuals.append(relative)
            named = [
                *((action.what, line) for action, line in zip(free.actions, inner, strict=True)),
                ("residual", missed),
            ]
            rows += [_row((name, float(run.grid.t[0]), free.link, what), line) for what, line in named]
        return cls(name, rows, max(residuals), [f"{', '.join(links)} {why}" for why, links in remarks.items()])


def free_bodies(row: Quantities, normal: Array | None = None) -> Iterator[FreeBody]:
    """Yield every body with all that acts on it in one row of a run; rotors and counters of turns are none.

    Args:
        row: Quantities of the row.
        normal: Of the plane of a planar mechanism, shape (3,): loads are forces in it and moments about it, which are
            determined where loads across it are not. Whole wrenches where it is left out.
    """
    plane = np.eye(6)
    if normal is not None:
        across = np.outer(normal, normal)
        plane = np.block([[np.eye(3) - across, np.zeros((3, 3))], [np.zeros((3, 3)), across]])
    acting, model = dict[int, list[Action]](), row.trajectory.mechanism.model
    for with_share in _with_shares(row, plane):
        acting.setdefault(with_share.body, []).append(with_share)
    for body, links in enumerate(links_behind(model)):
        if body and (links or model.inertias[body].mass):
            own = acting.get(body, [])
            doubt = next((action.doubt for action in own if action.doubt), "")
            left_out = bool(doubt) and (row.undetermined != "minimum_norm" or doubt == SHARED)
            yield FreeBody(body, links[0] if links else str(model.names[body]), own, doubt, left_out)


def sets_table(sets: Sequence[LoadSet], at: Unit) -> SectionTable:
    """Return the table of all sets, for the unit of the run's parameter."""
    columns = ("set", "at", "body", "load", *(f"{name} in body axes" for name in WRENCH))
    units = (None, at, None, None, *[METRE] * 3, *[NEWTON] * 3, *[NEWTON_METRE] * 3)
    rows = [row for load_set in sets for row in load_set.rows]
    return SectionTable(
        "sets", "Free-body diagrams in numbers: loads of every body at the worst instants", columns, units, rows
    )


def told(sets: Sequence[LoadSet]) -> list[str]:
    """Return the remarks on the sets, each once with the names of its sets."""
    names = dict[str, list[str]]()
    for load_set in sets:
        for remark in load_set.remarks:
            names.setdefault(remark, []).append(load_set.name)
    return [f"sets {', '.join(those)}: {remark}" for remark, those in names.items()]


def _with_shares(row: Quantities, plane: Array) -> list[Action]:
    """Return the loads on the bodies in one row, in doubt where they depend on how static frictions share a load.

    Args:
        row: The row.
        plane: Projection of a wrench on its wanted part, shape (6, 6).
    """
    whole = (row.whole or row).reactions
    acting = [*_actions(row.reactions, whole, plane)]
    scale = max((np.linalg.norm(load.wrench) for load in acting), default=0.0)
    for other in row.others:
        acting = [
            replace(own, doubt=SHARED) if np.abs(action.wrench - own.wrench).max() > OPEN * scale else own
            for own, action in zip(acting, _actions(other.reactions, whole, plane), strict=True)
        ]
    return acting


def _actions(reactions: Reactions, whole: Reactions, plane: Array) -> Iterator[Action]:
    """Yield the loads on the bodies in the first row; all rows of ``whole`` decide which loads are determined."""
    parts = _of_joints(reactions, whole, plane), _of_constraints(reactions, whole, plane), _of_friction(reactions)
    for action in chain(*parts, _of_forces(reactions), _of_masses(reactions.run)):
        yield replace(action, wrench=plane @ action.wrench)


def _of_joints(reactions: Reactions, whole: Reactions, plane: Array) -> Iterator[Action]:
    """Yield the wrenches of the tree's joints: on the child, and back on the parent."""
    model = reactions.model
    for joint in range(1, model.njoints):
        point, wrench, what = reactions.origins[0, joint], reactions.joints[0, joint], f"joint {model.names[joint]}"
        doubt = _hyperstatic(whole, [stress @ plane for stress in whole.stressed_joint(joint)])
        doubt = str(reactions.left_open[joint]) if joint in reactions.left_open else doubt
        yield Action(joint, what, point, wrench, doubt)
        if model.parents[joint]:
            yield Action(int(model.parents[joint]), what, point, -wrench, doubt)


def _of_constraints(reactions: Reactions, whole: Reactions, plane: Array) -> Iterator[Action]:
    """Yield the wrenches of loop joints and couplings, of drives along task coordinates and their rotors."""
    links, closure, lam = reactions.links, reactions.closure, reactions.multipliers[:1]
    for constraint, part in zip(closure.constraints, closure.slices.values(), strict=True):
        what, point, doubt = f"drive {constraint.name}", None, ""
        if isinstance(constraint, LoopJoint):
            what, point = f"loop {constraint.name}", reactions.loop_origins(constraint.name)[0]
            doubt = _hyperstatic(whole, [stress @ plane for stress in whole.stressed_loop(constraint.name)])
        elif isinstance(constraint, GearedRotor):
            angle = counted_angle(constraint.rotor.name)
            what = constraint.name if angle is None else f"effort along {angle}"
        elif isinstance(constraint, JointRelation) and constraint.known:
            what, point = f"coupling {constraint.name}", reactions.transmitted(constraint.name)[0][0]
            doubt = _hyperstatic(whole, whole.multiplier(constraint.name)[1])
        for body, wrench in constraint.wrenches(links, lam[:, part]).items():
            if body:
                yield _at(body, what, reactions.origins[0, body] if point is None else point, wrench[0], doubt)


def _of_friction(reactions: Reactions) -> Iterator[Action]:
    """Yield the friction wrenches of loop joints and threads; joint wrenches of the tree include their friction."""
    links = reactions.links
    for contact, f in zip(reactions.run.mechanism.frictions, reactions.run.friction.T, strict=True):
        for body, wrench in contact.slip.wrenches(links, f[:1]).items():
            if body:
                yield _at(body, f"friction {contact.name}", reactions.origins[0, body], wrench[0])


def _of_forces(reactions: Reactions) -> Iterator[Action]:
    run, model = reactions.run, reactions.model
    (_, dynamics), *_ = (
        (rows, dynamics_of_rows) for rows, dynamics_of_rows in run.intervals() if rows.start < rows.stop
    )
    links = reactions.links
    for name, force in dynamics.forces.items():
        points = {model.frames[frame].parentJoint: links.frame(frame)[1][0] for frame in force.points}
        for body, wrench in force.wrenches(links, run.grid.t, run.v).items():
            if body:
                yield _at(body, f"force {name}", points.get(body, reactions.origins[0, body]), wrench[0])


def _of_masses(run: Trajectory) -> Iterator[Action]:
    model, data = run.mechanism.model, new_data(run.mechanism.model)
    pin.forwardKinematics(model, data, run.q[0], run.v[0], run.a[0])
    for body in range(1, model.njoints):
        inertia, place, turn = model.inertias[body], data.oMi[body], data.oMi[body].rotation
        velocity, spatial = data.v[body], data.a[body]
        omega, alpha, arm = velocity.angular, spatial.angular, inertia.lever
        origin = spatial.linear + np.cross(omega, velocity.linear)  # of the body's origin, as a point
        acceleration = origin + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
        moment = inertia.inertia @ alpha + np.cross(omega, inertia.inertia @ omega)
        centre, still = place.act(arm), np.zeros(3)
        yield Action(body, "weight", centre, np.concatenate([inertia.mass * model.gravity.linear, still]))
        relief = np.concatenate([-inertia.mass * (turn @ acceleration), -(turn @ moment)])
        yield Action(body, "inertia relief", centre, relief)


def _at(body: int, what: str, point: Array, wrench: Array, doubt: str = "") -> Action:
    """Return the load of a wrench about the world's origin, moved to a point."""
    moved = np.concatenate([wrench[:3], wrench[3:] - np.cross(point, wrench[:3])])
    return Action(body, what, point, moved, doubt)


def _hyperstatic(reactions: Reactions, added: Sequence[Array]) -> str:
    """Return the doubt about a wrench to which self-stresses of length 1 add something; empty where they do not."""
    if any(np.abs(part).max(initial=0.0) > ACTS for part in added):
        return f"hyperstatic of degree {reactions.degree}: rigid bodies do not determine all of their loads"
    return ""


def _inwards(action: Action, turn: Array, place: Array) -> Array:
    """Return point, force and moment of an action in the axes of its body, shape (9,)."""
    return np.concatenate([vector @ turn for vector in (action.point - place, action.wrench[:3], action.wrench[3:])])


def _row(head: tuple[str, float, str, str], values: Array) -> SetRow:
    x, y, z, fx, fy, fz, mx, my, mz = values.tolist()
    return *head, x, y, z, fx, fy, fz, mx, my, mz


def _residual(acting: Array) -> tuple[Array, float]:
    """Return the sum of loads about a body's origin as a row, and its size relative to the sum of their sizes.

    The size of a moment is ``|m| + |r| |f|``: where forces act along their levers, nothing but rounding is left of both
    moments and their residual.

    Args:
        acting: Point, force and moment of each load, body axes, shape (k, 9).
    """
    points, forces, moments = np.moveaxis(acting.reshape(-1, 3, 3), 1, 0)
    about = moments + np.cross(points, forces)
    size, levers = np.linalg.norm(forces, axis=1), np.linalg.norm(points, axis=1)
    sizes = float(size.sum()), float((np.linalg.norm(moments, axis=1) + levers * size).sum())
    left = (float(np.linalg.norm(part.sum(axis=0))) for part in (forces, about))
    relative = max(part / whole if whole else 0.0 for part, whole in zip(left, sizes, strict=True))
    return np.concatenate([np.zeros(3), forces.sum(axis=0), about.sum(axis=0)]), relative
