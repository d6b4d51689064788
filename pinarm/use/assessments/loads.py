"""Loads of named joints: envelopes, lives of bearings, bushings, balance of rotors, and sets of loads for FEM.

A set has all that acts on every body at one instant, in the body's own axes, in balance: the wrenches of its joints,
couplings and force elements, its weight, and its inertia relief by d'Alembert, at the centre of mass c:

    force  -m a_c,    moment  -(I_c alpha + omega x I_c omega)

Their sum about the origin of the body is the residual of Newton's and Euler's equations; the accelerations in it are
those of forward kinematics.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Literal

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.family import NEWTON, NEWTON_METRE
from pinarm.engine.quantities.names import OPEN, Quantities
from pinarm.engine.quantities.reactions import Reactions
from pinarm.engine.series import Series
from pinarm.errors import InputError, within
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.input.yaml.schema import InputStruct
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.geometry.vectors import moved
from pinarm.mechanics.joints import METRE, links_behind
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.rotors import GearedRotor, counted_angle
from pinarm.records import Record, replace
from pinarm.use.assessments.elements import (
    LoadedJoint,
    LoadNumber,
    PlainBearing,
    RollingBearing,
    Rotor,
    bearing_numbers,
    rounding,
    worst_row,
)
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.result.section import Cell, Curve, Graph, Section, SectionTable, numbered

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario

BY_AXIS = {"radial": "force.radial", "axial": "force.axial", "overturning": "moment.radial"}
"""Peaks of joints with an axis, beside those of all joints."""
SIZES = {"force": "force.norm", "moment": "moment.norm"}
"""Peaks of all joints."""

EVEN = 1e-12
"""Distance of a component of a unit vector from 1 that is rounding."""


class JointLoads(InputStruct, frozen=True):
    """What is asked of one joint, beside the envelope of its loads.

    Attributes:
        bearing: A rolling bearing in it, whose rating life is asked.
        bushing: A plain bearing in it, whose pressure and speed are asked.
        coordinate: The coordinate whose rate is that of the bearing or bushing, where the joint has none of its own, as
            a ``point_on_line`` on a shaft.
    """

    bearing: RollingBearing | None = None
    bushing: PlainBearing | None = None
    coordinate: str | None = None


Peak = Literal["radial", "axial", "overturning", "force", "moment"]
"""A load whose peak is a worst instant: forces and moments by a joint's axis, and their sizes."""


class Loads(InputStruct, frozen=True):
    """Envelopes of the loads of joints with their instants, lives of bearings, and sets of loads for FEM.

    Attributes:
        joints: Joints of the tree and loop joints, by name (``joint.NAME`` or ``loop.NAME`` where both have it).
        sets: At which peaks of each joint every body's loads are written, in balance with its weight and inertia.
        rotors: Revolute joints whose bodies are rotors, for the grade of their balance, such as ``{O: {speed: 3000
            rpm}}``.
    """

    joints: dict[str, JointLoads] = {}
    sets: tuple[Peak, ...] = ("radial", "axial", "overturning")
    rotors: dict[str, Rotor] = {}

    def check(self) -> None:
        if not self.joints and not self.rotors:
            raise InputError("nothing is asked of any joint", expected="joints: {NAME: {}}, or rotors: {NAME: {}}")

    def units(self, quantities: Quantities) -> Mapping[str, Unit | None]:
        units = dict[str, Unit | None]()
        for joint, asked in self._loaded(quantities.trajectory.mechanism):
            units |= {f"{joint.name}.{part}.peak": unit for part, unit in peak_units(joint).items()}
            for bearing in (asked.bearing, asked.bushing):
                units |= {f"{joint.name}.{name}": unit for name, unit in bearing.units.items()} if bearing else {}
        for name, rotor in self.rotors.items():
            units |= {f"{name}.{part}": unit for part, unit in rotor.units.items()}
        return {**units, "sets.residual": DIMENSIONLESS} if self.sets else units

    def check_names(self, quantities: Quantities, scenario: Scenario) -> None:
        mechanism = quantities.trajectory.mechanism
        for joint, asked in self._loaded(mechanism):
            with within("joints", joint.name):
                joint.check(bearing=asked.bearing is not None, bushing=asked.bushing is not None)
        for name, rotor in self.rotors.items():
            with within("rotors", name):
                rotor.check_joint(mechanism, name)

    def evaluate(self, result: Result) -> Section:
        self.check_names(result.quantities, result.scenario)
        run, at, loaded = result.lookup, result.trajectory.unit, [*self._loaded(result.trajectory.mechanism)]
        rows, remarks, numbers, sets = list[Sequence[Cell]](), list[str](), dict[str, LoadNumber](), list[LoadSet]()
        for joint, _ in loaded:
            lines, said = envelope(run, joint)
            rows += lines
            remarks += said
            for part, (peak, row) in peaks(run, joint).items():
                numbers[f"{joint.name}.{part}.peak"] = peak
                sets += [LoadSet.at(row, f"{joint.name}.{part}")] if part in self.sets else []
        bearings = [(joint, part) for joint, asked in loaded for part in (asked.bearing, asked.bushing) if part]
        of_elements = [bearing_numbers(run, joint, part) for joint, part in bearings]
        of_elements += [rotor.balance(run, name) for name, rotor in self.rotors.items()]
        for results, said in of_elements:
            numbers |= results
            remarks += said
        by_remark = dict[str, list[str]]()
        for load_set in sets:
            for remark in load_set.remarks:
                by_remark.setdefault(remark, []).append(load_set.name)
        remarks += [f"sets {', '.join(names)}: {remark}" for remark, names in by_remark.items()]
        if any(load_set.rows for load_set in sets):
            residual = max(load_set.residual for load_set in sets)
            numbers["sets.residual"] = LoadNumber(residual, 0.0, DIMENSIONLESS)
        tables = [_numbers_table(numbers, at)]
        if rows:
            columns = ("joint", "component", "unit", "min", "min at", "max", "max at", "error")
            units = (None, None, None, None, at, None, at, None)
            tables.append(SectionTable("envelope", "Envelope of the components", columns, units, rows, row_unit=2))
        if "sets.residual" in numbers:
            tables.append(_sets_table(sets, at))
        graphs = list[Graph]()
        for joint, _ in loaded if not result.trajectory.numbered else ():
            if f"{joint.name}.radial.peak" in numbers:
                with suppress(InputError):
                    graphs.append(polar_diagram(run, joint))
        return Section("loads", "Loads of joints", tables, remarks=remarks, graphs=graphs, **numbered(numbers))

    def _loaded(self, mechanism: Mechanism) -> Iterator[tuple[LoadedJoint, JointLoads]]:
        for name, asked in self.joints.items():
            with within("joints", name):
                yield LoadedJoint.of(mechanism, name, asked.coordinate), asked


def _numbers_table(numbers: Mapping[str, LoadNumber], at: Unit) -> SectionTable:
    rows: list[Sequence[Cell]] = [
        (name, str(x.unit), x.value, "" if x.at is None else x.at, x.direction, x.axes, x.error)
        for name, x in numbers.items()
    ]
    columns = ("", "unit", "value", "at", "direction x y z", "in axes of", "error")
    units = (None, None, None, at, None, None, None)
    return SectionTable("numbers", "Peaks, lives and grades", columns, units, rows, row_unit=1)


def envelope(run: Lookup, joint: LoadedJoint) -> tuple[list[Sequence[Cell]], list[str]]:
    """Return the rows of a joint in the table, and what is to be said of its components."""
    names = [f"{kind}.along.{joint.body}.{axis}" for kind in ("force", "moment") for axis in "xyz"]
    names += [*SIZES.values(), *((*BY_AXIS.values(), "moment.axial") if joint.axis else ())]
    known, remarks = _determined(run, joint, names)
    rows = list[Sequence[Cell]]()
    for name, series in known.items():
        least = rounding(run, name, series)
        slack = least if np.ptp(series.values) <= least else 0.0
        ends = [run.extreme(which, series.name, slack) for which in ("min", "max")]
        low, high = ((float(row[series.name].values[0]), _place(row)) for _, row in ends)
        rows.append((joint.name, name, str(series.unit), *low, *high, max(peak.error for peak, _ in ends)))
    return rows, remarks


def peak_units(joint: LoadedJoint) -> Mapping[str, Unit]:
    """Return the peaks that a joint may have, and their units."""
    wanted = (BY_AXIS if joint.axis else {}) | SIZES
    return {part: NEWTON if name.startswith("force") else NEWTON_METRE for part, name in wanted.items()}


def peaks(run: Lookup, joint: LoadedJoint) -> Mapping[str, tuple[LoadNumber, Quantities]]:
    """Return the peaks of a joint that are determined and not 0, each with its row."""
    wanted = (BY_AXIS if joint.axis else {}) | SIZES
    known, _ = _determined(run, joint, list(wanted.values()))
    peaks_by_part = {}
    for part, name in wanted.items():
        if name in known:
            full, unit, least = known[name].name, known[name].unit, rounding(run, name, known[name])
            assert unit is not None
            row, value, error = worst_row(run, partial(_size, name=full), least)
            if value > least:
                direction = _direction(row, joint, part, name.partition(".")[0])
                peaks_by_part[part] = LoadNumber(value, error, unit, row[full].doubt, _place(row), *direction), row
    return peaks_by_part


def _direction(row: Quantities, joint: LoadedJoint, part: str, kind: str) -> tuple[str, str]:
    """Return the unit vector of a load and the link whose axes it is in; empty where its components are left open."""
    link, axis = joint.rings[0] if part in BY_AXIS else (joint.body, np.zeros(3))
    try:
        axial = row[f"{joint.prefix}.{BY_AXIS['axial']}"].values[0] if part == "axial" else 0.0
        vector = axis * axial if part == "axial" else _across(row, joint, kind, link, axis)[:, 0]
    except InputError:
        return "", ""
    return " ".join(f"{x + 0.0:.3g}" for x in np.round(vector / np.linalg.norm(vector), 4).tolist()), link or "world"


def _across(rows: Quantities, joint: LoadedJoint, kind: str, link: str, axis: Array) -> Array:
    """Return force or moment in the axes of a link, without its part along an axis in these, shape (3, n).

    Args:
        rows: The rows.
        joint: The joint.
        kind: ``force`` or ``moment``.
        link: Name of the link; empty for the world.
        axis: Unit vector, shape (3,); 0 for the whole vector.
    """
    name, still = f"{joint.prefix}.{kind}" + (f".along.{link}" if link else ""), np.zeros(len(rows.trajectory))
    vector = np.array(
        [
            still if abs(part) > 1.0 - EVEN else rows.determined(f"{name}.{letter}").values
            for letter, part in zip("xyz", axis, strict=True)
        ]
    )
    return np.asarray(vector - np.outer(axis, axis @ vector))


def polar_diagram(run: Lookup, joint: LoadedJoint) -> Graph:
    """Return the radial load over the run, seen along the joint's axis, in the axes of both links that meet there."""
    curves = []
    for link, axis in joint.rings:
        k = int(np.abs(axis).argmax())
        right, up = (k + 1) % 3, (k + 2) % 3
        across = np.eye(3)[right] - axis[right] * axis
        across /= np.linalg.norm(across)
        seen = np.array([across, np.sign(axis[k]) * np.cross(axis, across)])
        parts = seen @ _across(run.quantities, joint, "force", link, axis)
        label = f"in axes of {link or 'the world'}: {'xyz'[right]} to the right, {'xyz'[up]} up"
        right_part, up_part = (Series("radial load", NEWTON, part) for part in parts)
        curves.append(Curve(right_part, up_part, label))
    centre = Series("radial load", NEWTON, np.zeros(1))
    title = f"Polar diagram of {joint.prefix}: radial load on {joint.body}"
    name = re.sub(r"\W+", "_", f"polar_{joint.name}")
    return Graph(name, title, [*curves, Curve(centre, centre, "axis of the joint", points=True)], equal=True)


def _determined(run: Lookup, joint: LoadedJoint, names: list[str]) -> tuple[dict[str, Series], list[str]]:
    """Return the components that rigid bodies determine, and a remark on the others and on those in doubt."""
    known, left_open = dict[str, Series](), dict[str, list[str]]()
    for name in names:
        try:
            known[name] = run.quantities.determined(f"{joint.prefix}.{name}")
        except InputError as error:
            if run.run.no_efforts:
                raise
            why = error.message.partition(": ")[2]
            known_open = why.startswith("not determined")
            left_open.setdefault(why if known_open else f"not determined ({why})", []).append(name)
        else:
            if known[name].doubt:
                left_open.setdefault(known[name].doubt, []).append(name)
    return known, [f"{joint.name}: {', '.join(parts)}: {why}" for why, parts in left_open.items()]


def _size(rows: Quantities, name: str) -> Array:
    return np.abs(rows[name].values)


def _place(row: Quantities) -> float:
    return float(row.trajectory.grid.t[0])


SHARED = "several frictions or stops hold one motion: rigid bodies do not determine which of them holds how much"

WRENCH = ("x", "y", "z", "Fx", "Fy", "Fz", "Mx", "My", "Mz")
"""Columns of a load: point where it acts, force and moment there."""


class Action(Record, frozen=True):
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


class FreeBody(Record, frozen=True):
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


class LoadSet(Record, frozen=True):
    """The loads of all bodies at an instant.

    Attributes:
        name: Its name, such as ``B.radial``.
        rows: A row for each load, and one for each body's residual: set, instant, body, what acts, point and wrench.
        residual: Largest residual of a body, relative to the sum of the sizes of its loads.
        remarks: Which bodies are left out, and why.
    """

    name: str
    rows: Sequence[Sequence[Cell]]
    residual: float
    remarks: Sequence[str]

    @classmethod
    def at(cls, row: Quantities, name: str) -> LoadSet:
        """Return the set of one row of a run, without the bodies whose loads rigid bodies do not determine.

        Args:
            row: Quantities of one row; reactions in doubt are kept where it gives the least multipliers.
            name: Name of the set.
        """
        rows, residuals, remarks = list[Sequence[Cell]](), [0.0], dict[str, list[str]]()
        turns, places = row.reactions.links.turns[0], row.reactions.origins[0]
        for free in free_bodies(row):
            if free.doubt:
                how = "left out" if free.left_out else "least multipliers"
                remarks.setdefault(f"{how}; {free.doubt}", []).append(free.link)
            if free.left_out:
                continue
            vectors = [(x.point - places[free.body], x.wrench[:3], x.wrench[3:]) for x in free.actions]
            inner = np.array(vectors) @ turns[free.body]
            missed, relative = _residual(inner)
            residuals.append(relative)
            what = [*(action.what for action in free.actions), "residual"]
            head, lines = (name, _place(row), free.link), [*inner.reshape(-1, 9).tolist(), missed.tolist()]
            rows += [(*head, source, *line) for source, line in zip(what, lines, strict=True)]
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
    acting, model = _with_shares(row, plane), row.trajectory.mechanism.model
    for body, links in enumerate(links_behind(model)):
        if body and (links or model.inertias[body].mass):
            own = [action for action in acting if action.body == body]
            doubt = next((action.doubt for action in own if action.doubt), "")
            left_out = bool(doubt) and (row.undetermined != "minimum_norm" or doubt == SHARED)
            yield FreeBody(body, links[0] if links else str(model.names[body]), own, doubt, left_out)


def _sets_table(sets: Sequence[LoadSet], at: Unit) -> SectionTable:
    columns = ("set", "at", "body", "load", *(f"{name} in body axes" for name in WRENCH))
    units = (None, at, None, None, *[METRE] * 3, *[NEWTON] * 3, *[NEWTON_METRE] * 3)
    title = "Free-body diagrams in numbers: loads of every body at the worst instants"
    return SectionTable("sets", title, columns, units, [row for load_set in sets for row in load_set.rows])


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
        elif isinstance(constraint, JointRelation) and constraint.transmission:
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
    dynamics = next(dynamics for rows, dynamics in run.intervals() if rows.start < rows.stop)
    links = reactions.links
    for name, force in dynamics.forces.items():
        points = {model.frames[frame].parentJoint: links.frame(frame)[1][0] for frame in force.points}
        for body, wrench in force.wrenches(links, run.grid.t, run.v).items():
            if body:
                yield _at(body, f"force {name}", points.get(body, reactions.origins[0, body]), wrench[0])


def _of_masses(run: Trajectory) -> Iterator[Action]:
    model, links = run.mechanism.model, run.link_motion[0]
    momenta = moved(links.outwards(run.demands), links.places)[:2, 0].sum(axis=0)  # their rates, at the world's origin
    for body in range(1, model.njoints):
        inertia, still = model.inertias[body], np.zeros(3)
        centre = links.places[0, body] + links.turns[0, body] @ inertia.lever
        yield Action(body, "weight", centre, np.concatenate([inertia.mass * model.gravity.linear, still]))
        yield _at(body, "inertia relief", centre, -momenta[body])


def _at(body: int, what: str, point: Array, wrench: Array, doubt: str = "") -> Action:
    """Return the load of a wrench about the world's origin, moved to a point."""
    moved = np.concatenate([wrench[:3], wrench[3:] - np.cross(point, wrench[:3])])
    return Action(body, what, point, moved, doubt)


def _hyperstatic(reactions: Reactions, added: Sequence[Array]) -> str:
    """Return the doubt about a wrench to which self-stresses of length 1 add something; empty where they do not."""
    if any(np.abs(part).max(initial=0.0) > ACTS for part in added):
        return f"hyperstatic of degree {reactions.degree}: rigid bodies do not determine all of their loads"
    return ""


def _residual(acting: Array) -> tuple[Array, float]:
    """Return the sum of loads about a body's origin as a row, and its size relative to the sum of their sizes.

    The size of a moment is ``|m| + |r| |f|``: where forces act along their levers, nothing but rounding is left of both
    moments and their residual.

    Args:
        acting: Point, force and moment of each load, body axes, shape (k, 3, 3).
    """
    points, forces, moments = np.moveaxis(acting, 1, 0)
    about = moments + np.cross(points, forces)
    size, levers = np.linalg.norm(forces, axis=1), np.linalg.norm(points, axis=1)
    sizes = float(size.sum()), float((np.linalg.norm(moments, axis=1) + levers * size).sum())
    left = (float(np.linalg.norm(part.sum(axis=0))) for part in (forces, about))
    relative = max(part / whole if whole else 0.0 for part, whole in zip(left, sizes, strict=True))
    return np.concatenate([np.zeros(3), forces.sum(axis=0), about.sum(axis=0)]), relative
