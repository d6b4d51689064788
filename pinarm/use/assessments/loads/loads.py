"""Loads of named joints: envelopes, lives of bearings, bushings, balance of rotors, and sets of loads for FEM."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.family import NEWTON, NEWTON_METRE
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, within
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.input.yaml.schema import InputStruct
from pinarm.use.assessments.loads.elements import PlainBearing, RollingBearing, Rotor, bearing_numbers
from pinarm.use.assessments.loads.joint import LoadedJoint, LoadNumber, rounding, worst_row
from pinarm.use.assessments.loads.load_sets import LoadSet, sets_table, told
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

    def requested(self, mechanism: Mechanism) -> list[str]:
        names = [*mechanism.joints] if self.sets and self.joints else [*self.rotors]
        return [
            *(f"joint.{name}.force.x" for name in names),
            *(f"{joint.prefix}.force.x" for joint, _ in self._loaded(mechanism)),
        ]

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
        remarks += told(sets)
        if any(part.rows for part in sets):
            residual = max(part.residual for part in sets)
            numbers["sets.residual"] = LoadNumber(residual, 0.0, DIMENSIONLESS)
        tables = [_numbers_table(numbers, at)]
        if rows:
            columns = ("joint", "component", "unit", "min", "min at", "max", "max at", "error")
            units = (None, None, None, None, at, None, at, None)
            tables.append(SectionTable("envelope", "Envelope of the components", columns, units, rows, row_unit=2))
        if "sets.residual" in numbers:
            tables.append(sets_table(sets, at))
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
        low, high = ((float(row[series.name].values[0]), _place(row)) for row, _ in ends)
        rows.append((joint.name, name, str(series.unit), *low, *high, max(error for _, error in ends)))
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
