"""Envelopes of the loads of joints: least and largest value of every component, and the peaks by the joint's axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.family import NEWTON, NEWTON_METRE
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.use.assessments.loads.joint import LoadedJoint
from pinarm.use.assessments.loads.number import LoadNumber, rounding, worst_row
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.result.section import SectionTable

BY_AXIS = {"radial": "force.radial", "axial": "force.axial", "overturning": "moment.radial"}
"""Peaks of joints with an axis, beside those of all joints."""
SIZES = {"force": "force.norm", "moment": "moment.norm"}
"""Peaks of all joints."""


EnvelopeRow = tuple[str, str, str, float, float, float, float, float]
"""Joint, component, unit, least value and where, largest value and where, and the error of both."""


def envelope_table(rows: Sequence[EnvelopeRow], at: Unit) -> SectionTable:
    """Return the table of the components, for the unit of the run's parameter."""
    columns = ("joint", "component", "unit", "min", "min at", "max", "max at", "error")
    return SectionTable("envelope", "Envelope of the components, body axes", columns,
                        (None, None, None, None, at, None, at, None), rows, row_unit=2)  # fmt: skip


def envelope(run: Lookup, joint: LoadedJoint) -> tuple[list[EnvelopeRow], list[str]]:
    """Return the rows of a joint in the table, and what is to be said of its components."""
    names = [f"{kind}.along.{joint.body}.{axis}" for kind in ("force", "moment") for axis in "xyz"]
    names += [*SIZES.values(), *((*BY_AXIS.values(), "moment.axial") if joint.axis else ())]
    known, remarks = _determined(run, joint, names)
    rows = list[EnvelopeRow]()
    for name, series in known.items():
        shown = name.replace(f".along.{joint.body}", "")
        least = rounding(run, name, series)
        slack = least if np.ptp(series.values) <= least else 0.0
        ends = [run.extreme(which, series.name, slack) for which in ("min", "max")]
        low, high = ((float(row[series.name].values[0]), _place(row)) for row, _ in ends)
        rows.append((joint.name, shown, str(series.unit), *low, *high, max(error for _, error in ends)))
    return rows, remarks


def peak_units(joint: LoadedJoint) -> Mapping[str, Unit]:
    """Return the peaks that a joint may have, and their units."""
    wanted = (BY_AXIS if joint.axis else {}) | SIZES
    return {part: NEWTON if name.startswith("force") else NEWTON_METRE for part, name in wanted.items()}


def peaks(run: Lookup, joint: LoadedJoint) -> Mapping[str, tuple[LoadNumber, Quantities]]:
    """Return the peaks of a joint that are determined and not 0, each with its row."""
    wanted = (BY_AXIS if joint.axis else {}) | SIZES
    known, _ = _determined(run, joint, list(wanted.values()))
    found = {}
    for part, name in wanted.items():
        if name in known:
            full, unit, least = known[name].name, known[name].unit, rounding(run, name, known[name])
            assert unit is not None
            row, value, error = worst_row(run, partial(_size, name=full), least)
            if value > least:
                found[part] = LoadNumber(value, unit, _place(row), error, row[full].doubt), row
    return found


def _determined(run: Lookup, joint: LoadedJoint, names: list[str]) -> tuple[dict[str, Series], list[str]]:
    """Return the components that rigid bodies determine, and a remark on the others and on those in doubt."""
    known, left_open = dict[str, Series](), dict[str, list[str]]()
    for name in names:
        shown = name.replace(f".along.{joint.body}", "")
        try:
            known[name] = run.quantities.determined(f"{joint.prefix}.{name}")
        except InputError as error:
            if run.run.no_efforts:
                raise
            why = error.message.partition(": ")[2]
            known_open = why.startswith("not determined")
            left_open.setdefault(why if known_open else f"not determined ({why})", []).append(shown)
        else:
            if known[name].doubt:
                left_open.setdefault(known[name].doubt, []).append(shown)
    return known, [f"{joint.name}: {', '.join(parts)}: {why}" for why, parts in left_open.items()]


def _size(rows: Quantities, name: str) -> Array:
    return np.abs(rows[name].values)


def _place(row: Quantities) -> float:
    return float(row.trajectory.grid.t[0])
