"""A motion under controllers that has been integrated: their efforts as they have been, and columns of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.control.controlled_system import CONTROL, ControlledSystem
from pinarm.engine.control.controls import Controls, with_control
from pinarm.engine.control.efforts import RecordedEfforts, reference_of
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.motion.segmented.segments import MotionSegment, SegmentedMotion
from pinarm.engine.motion.systems import System
from pinarm.engine.motion.systems.frictional import FrictionalSystem
from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.mechanics.control.controller import Controller
from pinarm.mechanics.forces.joint_definitions import effort_unit
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace

UNITS = {
    "voltage": unit("V"),
    **dict.fromkeys(("current", "current_margin"), unit("A")),
    **dict.fromkeys(("torque", "margin", "continuous_margin"), unit("N*m")),
}
"""Units of what is told of motors."""


def recorded(controls: Controls, motion: SegmentedMotion) -> SegmentedMotion:
    """Return an integrated motion under the efforts of controllers as they have been."""
    efforts = controls.recorded(lambda t: _integrals(motion, t))
    dynamics = with_control(motion.dynamics, efforts)
    segments = [_under(segment, dynamics, efforts) for segment in motion.segments]
    return replace(motion, dynamics=dynamics, segments=segments)


def record_of(motion: SegmentedMotion) -> RecordedEfforts:
    """Return the efforts of the controllers of a motion as they have been; see ``recorded``."""
    record = motion.dynamics.forces[CONTROL]
    assert isinstance(record, RecordedEfforts)
    return record


def _under(segment: MotionSegment, dynamics: Dynamics, efforts: RecordedEfforts) -> MotionSegment:
    system = segment.system
    inner = system.inner if isinstance(system, ControlledSystem) else system
    if not isinstance(inner, FrictionalSystem):
        return replace(segment, dynamics=with_control(segment.dynamics, efforts))
    inner = inner.under(dynamics)
    around: System = replace(system, inner=inner) if isinstance(system, ControlledSystem) else inner
    return replace(segment, system=around, dynamics=inner.slowed(dynamics))


def _integrals(motion: SegmentedMotion, t: Array) -> Array:
    """Return the integrals of controllers at instants, shape (n,), as an array of shape (n, m)."""
    owners, parts = np.searchsorted(np.array(motion.seams), t), []
    for number, segment in enumerate(motion.segments):
        here = np.flatnonzero(owners == number)
        if len(here) and isinstance(segment.system, ControlledSystem):
            parts.append((here, segment.system.integrals(segment.solution.states(t[here])[1])))
    found = np.zeros((len(t), parts[0][1].shape[1] if parts else 0))
    for here, values in parts:
        found[here] = values
    return found


@dataclass(frozen=True, eq=False)
class ControlledRows:
    """What controllers have done at the rows of a grid, and the names of the quantities.

    Attributes:
        efforts: Efforts of all drives as generalised loads [N*m or N], shape (n, nv).
        columns: ``control.D.error`` and so on of every drive D.
    """

    efforts: Array
    columns: dict[str, Series]

    @classmethod
    def of(cls, motion: SegmentedMotion, grid: Grid, q: Array, v: Array) -> ControlledRows:
        """Return the rows of a motion at states of the mechanism, shapes (n, nq) and (n, nv)."""
        record = record_of(motion)
        controllers, efforts = (*record.sampled, *record.continuous), np.zeros_like(v)
        parts, references = (
            list[list[dict[str, Array]]](),
            [np.zeros((len(q), len(one.signals), 3)) for one in controllers],
        )
        for start, end, rows in grid.intervals():
            if rows.start == rows.stop:
                continue
            local, states = record.on(start, end), (grid.t[rows], q[rows], v[rows])
            local.add_load(*states, efforts[rows])
            parts.append(local.parts(*states))
            for one, reference in zip(controllers, references, strict=True):
                if one.references:
                    reference[rows] = reference_of(one.references, grid.t[rows], local.span)
        joined = [
            {name: np.concatenate([part[name] for part in each]) for name in each[0]}
            for each in zip(*parts, strict=True)
        ]  # fmt: skip
        return cls(efforts, _columns(controllers, joined, references, q, v))


def _columns(
    controllers: tuple[Controller, ...], parts: list[dict[str, Array]], references: list[Array], q: Array, v: Array
) -> dict[str, Series]:
    """Return the columns of all drives."""
    columns = dict[str, Series]()
    for one, part, reference in zip(controllers, parts, references, strict=True):
        measured = one.measure(q, v)
        for i, (drive, joint) in enumerate(zip(one.drives, one.joints, strict=True)):
            effort = effort_unit(joint)
            units = {**UNITS, "effort": effort, "command": UNITS.get(one.supply, effort)}
            told = {name: values[:, i] for name, values in part.items()}
            rows = {name: (units[name], values) for name, values in told.items() if not np.isnan(values).all()}
            k = one.followed(drive)
            if k is not None:
                rows["reference"] = one.signals[k].unit, reference[:, k, 0]
                rows["error"] = one.signals[k].unit, reference[:, k, 0] - measured[:, k, 0]
            names = {name: f"control.{drive}.{name}" for name in rows}
            columns |= {names[name]: Series(names[name], *values) for name, values in rows.items()}
    return columns


def control_schema(controls: Controls, q: Array, v: Array) -> dict[str, Series]:
    """Return the columns with values of no meaning, for states of shapes (n, nq) and (n, nv)."""
    controls.begin(0.0, 0.0)
    record, t = controls.recorded(lambda t: np.zeros((len(t), len(controls.memory.integral)))), np.zeros(len(q))
    controllers = (*record.sampled, *record.continuous)
    references = [np.zeros((len(q), len(one.signals), 3)) for one in controllers]
    return _columns(controllers, record.parts(t, q, v), references, q, v)
