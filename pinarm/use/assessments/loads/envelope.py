"""Envelopes of the loads of joints: least and largest value of every component, and the peaks by the joint's axis."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.family import NEWTON, NEWTON_METRE
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import Unit
from pinarm.use.assessments.loads.joint import LoadedJoint, LoadNumber, rounding, worst_row
from pinarm.use.result.row_lookup import Lookup
from pinarm.use.result.section import Curve, Graph, SectionTable

BY_AXIS = {"radial": "force.radial", "axial": "force.axial", "overturning": "moment.radial"}
"""Peaks of joints with an axis, beside those of all joints."""
SIZES = {"force": "force.norm", "moment": "moment.norm"}
"""Peaks of all joints."""


EnvelopeRow = tuple[str, str, str, float, float, float, float, float]
"""Joint, component, unit, least value and where, largest value and where, and the error of both."""


def envelope_table(rows: Sequence[EnvelopeRow], at: Unit) -> SectionTable:
    """Return the table of the components, for the unit of the run's parameter."""
    columns = ("joint", "component", "unit", "min", "min at", "max", "max at", "error")
    return SectionTable("envelope", "Envelope of the components", columns,
                        (None, None, None, None, at, None, at, None), rows, row_unit=2)  # fmt: skip


def envelope(run: Lookup, joint: LoadedJoint) -> tuple[list[EnvelopeRow], list[str]]:
    """Return the rows of a joint in the table, and what is to be said of its components."""
    names = [f"{kind}.along.{joint.body}.{axis}" for kind in ("force", "moment") for axis in "xyz"]
    names += [*SIZES.values(), *((*BY_AXIS.values(), "moment.axial") if joint.axis else ())]
    known, remarks = _determined(run, joint, names)
    rows = list[EnvelopeRow]()
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
                peaks_by_part[part] = LoadNumber(value, unit, _place(row), error, row[full].doubt, *direction), row
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

    Raises:
        InputError: A component is not determined. That along the axis need not be, where the axis is one of the link's.
    """
    name, still = f"{joint.prefix}.{kind}" + (f".along.{link}" if link else ""), np.zeros(len(rows.trajectory))
    vector = np.array(
        [
            still if abs(part) > 1.0 - EVEN else rows.determined(f"{name}.{letter}").values
            for letter, part in zip("xyz", axis, strict=True)
        ]
    )
    return np.asarray(vector - np.outer(axis, axis @ vector))


EVEN = 1e-12
"""Distance of a component of a unit vector from 1 that is rounding."""


def polar_diagram(run: Lookup, joint: LoadedJoint) -> Graph:
    """Return the radial load over the run, seen along the joint's axis, in the axes of both links that meet there.

    Raises:
        InputError: A component is not determined.
    """
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
