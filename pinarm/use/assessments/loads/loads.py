"""Loads of named joints: what bearings, bushings and finite elements of the bodies are dimensioned by."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Literal

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, within
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.input.yaml.schema import InputStruct
from pinarm.use.assessments.loads.bearing import PlainBearing, RollingBearing, lives
from pinarm.use.assessments.loads.envelope import (
    EnvelopeRow,
    envelope,
    envelope_table,
    peak_units,
    peaks,
    polar_diagram,
)
from pinarm.use.assessments.loads.joint import LoadedJoint, LoadNumber
from pinarm.use.assessments.loads.load_sets import LoadSet, sets_table, told
from pinarm.use.assessments.loads.rotor import Rotor
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.result.section import Graph, Section, SectionTable

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.scenario.scenario import Scenario


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
        """Refuse a block that asks nothing."""
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
        self._check_joints(quantities)

    def _check_joints(self, quantities: Quantities) -> None:
        mechanism = quantities.trajectory.mechanism
        for joint, asked in self._loaded(mechanism):
            with within("joints", joint.name):
                joint.check(bearing=asked.bearing is not None, bushing=asked.bushing is not None)
        for name, rotor in self.rotors.items():
            with within("rotors", name):
                rotor.check_joint(mechanism, name)

    def evaluate(self, result: Result) -> Section:
        self._check_joints(result.quantities)
        run, at, loaded = result.lookup, result.trajectory.unit, [*self._loaded(result.trajectory.mechanism)]
        rows, numbers, remarks, sets = _joint_loads(run, [joint for joint, _ in loaded], self.sets)
        bearings = [(joint, part) for joint, asked in loaded for part in (asked.bearing, asked.bushing) if part]
        for results, said in (lives(run, bearings), *(rotor.balance(run, name) for name, rotor in self.rotors.items())):
            numbers |= results
            remarks += said
        tables = [envelope_table(rows, at)] if rows else []
        remarks += told(sets)
        if any(part.rows for part in sets):
            tables.append(sets_table(sets, at))
            numbers["sets.residual"] = LoadNumber.pure(max(part.residual for part in sets))
        series = {name: number.series(name) for name, number in numbers.items()}
        errors = {name: number.error for name, number in numbers.items()}
        tables = [_numbers_table(numbers, at), *tables]
        graphs = [] if result.trajectory.numbered else [*self._polar(run, [joint for joint, _ in loaded], numbers)]
        return Section("loads", "Loads of joints", tables, series, remarks, graphs, errors)

    def _polar(self, run: Lookup, joints: Sequence[LoadedJoint], numbers: Mapping[str, LoadNumber]) -> Iterator[Graph]:
        """Yield the polar diagram of every joint with a radial load whose components are determined."""
        for joint in joints:
            if f"{joint.name}.radial.peak" in numbers:
                with suppress(InputError):
                    yield polar_diagram(run, joint)

    def _loaded(self, mechanism: Mechanism) -> Iterator[tuple[LoadedJoint, JointLoads]]:
        for name, asked in self.joints.items():
            with within("joints", name):
                yield LoadedJoint.of(mechanism, name, asked.coordinate), asked


def _joint_loads(
    run: Lookup, joints: Sequence[LoadedJoint], wanted: Sequence[Peak]
) -> tuple[list[EnvelopeRow], dict[str, LoadNumber], list[str], list[LoadSet]]:
    """Return the rows of the envelope, the peaks, what is to be said, and the sets of loads at the wanted peaks."""
    rows, remarks, numbers, sets = list[EnvelopeRow](), list[str](), dict[str, LoadNumber](), list[LoadSet]()
    for joint in joints:
        lines, said = envelope(run, joint)
        rows += lines
        remarks += said
        for part, (peak, row) in peaks(run, joint).items():
            numbers[f"{joint.name}.{part}.peak"] = peak
            sets += [LoadSet.at(row, f"{joint.name}.{part}")] if part in wanted else []
    return rows, numbers, remarks, sets


def _numbers_table(numbers: Mapping[str, LoadNumber], at: Unit) -> SectionTable:
    rows: list[tuple[str | float, ...]] = [
        (
            name,
            str(number.unit),
            number.value,
            "" if number.at is None else number.at,
            number.direction,
            number.axes,
            number.error,
        )
        for name, number in numbers.items()
    ]
    columns = ("", "unit", "value", "at", "direction x y z", "in axes of", "error")
    units = (None, None, None, at, None, None, None)
    return SectionTable("numbers", "Peaks, lives and grades", columns, units, rows, row_unit=1)
