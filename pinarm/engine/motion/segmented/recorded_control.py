"""Controllers of an integrated motion: their efforts as they have been, columns of them, and limits of motors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.control.controls import (
    CONTROL,
    ControlEfforts,
    ControlledSystem,
    Controls,
    reference_of,
    with_control,
)
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.motion.segmented.segments import SegmentedMotion
from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.mechanics.control.controller import Controller
from pinarm.mechanics.control.motor_control import MotorController, TorqueSource
from pinarm.mechanics.joints import effort_unit
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.records import replace

UNITS = {
    "voltage": unit("V"),
    **dict.fromkeys(("current", "current_margin"), unit("A")),
    **dict.fromkeys(("torque", "margin", "continuous_margin"), unit("N*m")),
}
"""Units of columns of motors."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Quadrature within a step, where efforts are smooth: degree 7, the order of the dense output."""

AT_LIMIT = {"margin": "gives its peak torque", "current_margin": "is at its current limit"}
"""Distance of a motor to a limit -> words where that is 0."""

ROUNDING = 1e-9
"""Of such a distance, relative to the largest of the run: a current is integrated."""


def recorded(controls: Controls, motion: SegmentedMotion) -> SegmentedMotion:
    """Return an integrated motion under the efforts of controllers as they have been."""

    def integrals(t: Array) -> Array:
        parts = [(x.system.integrals(x.solution.states(t[here])[1]), here) for x, here in motion.parts(t)
                 if isinstance(x.system, ControlledSystem)]  # fmt: skip
        every = np.zeros((len(t), parts[0][0].shape[1] if parts else 0))
        for values, here in parts:
            every[here] = values
        return every

    return replace(motion, dynamics=with_control(motion.dynamics, controls.recorded(integrals)))


def without_control(dynamics: Dynamics) -> Dynamics:
    """Return an equation of motion without the efforts of controllers."""
    return replace(dynamics, forces={name: force for name, force in dynamics.forces.items() if name != CONTROL})


def record_of(motion: SegmentedMotion) -> ControlEfforts:
    """Return the efforts of the controllers of a motion as they have been; see ``recorded``."""
    record = motion.dynamics.forces[CONTROL]
    assert isinstance(record, ControlEfforts)
    return record


def control_rows(motion: SegmentedMotion, grid: Grid, q: Array, v: Array) -> tuple[Array, dict[str, Series]]:
    """Return efforts and columns of controllers at the rows of a grid, in states of shapes (n, nq) and (n, nv).

    Returns:
        Efforts of all drives as generalised loads [N*m or N], shape (n, nv); ``control.D.error`` and so on of every
        drive D.
    """
    record, efforts = record_of(motion), np.zeros_like(v)
    references = [np.zeros((len(q), len(controller.signals), 3)) for controller in record.controllers]
    parts = list[list[dict[str, Array]]]()
    for start, end, rows in grid.intervals():
        if rows.start == rows.stop:
            continue
        local, states = record.on(start, end), (grid.t[rows], q[rows], v[rows])
        local.add_load(*states, efforts[rows])
        parts.append(local.parts(*states))
        for controller, reference in zip(record.controllers, references, strict=True):
            if controller.references:
                reference[rows] = reference_of(controller.references, grid.t[rows], local.span)
    joined = [
        {name: np.concatenate([part[name] for part in group]) for name in group[0]}
        for group in zip(*parts, strict=True)
    ]
    return efforts, _columns(record.controllers, joined, references, q, v)


def _columns(
    controllers: Sequence[Controller], parts: list[dict[str, Array]], references: list[Array], q: Array, v: Array
) -> dict[str, Series]:
    columns = dict[str, Series]()
    for controller, part, reference in zip(controllers, parts, references, strict=True):
        measured = controller.measure(q, v)
        for i, (drive, joint) in enumerate(zip(controller.drives, controller.joints, strict=True)):
            effort = effort_unit(joint.unit)
            units = {**UNITS, "effort": effort, "command": UNITS.get(controller.supply, effort)}
            own = {name: values[:, i] for name, values in part.items()}
            rows = {name: (units[name], values) for name, values in own.items() if not np.isnan(values).all()}
            k = controller.followed(drive)
            if k is not None:
                rows["reference"] = controller.signals[k].unit, reference[:, k, 0]
                rows["error"] = controller.signals[k].unit, reference[:, k, 0] - measured[:, k, 0]
            names = {name: f"control.{drive}.{name}" for name in rows}
            columns |= {names[name]: Series(names[name], *values) for name, values in rows.items()}
    return columns


def control_schema(controls: Controls, q: Array, v: Array) -> dict[str, Series]:
    """Return the columns with values of no meaning, for states of shapes (n, nq) and (n, nv)."""
    controls.begin(0.0, 0.0)
    record, t = controls.recorded(lambda t: np.zeros((len(t), len(controls.integral)))), np.zeros(len(q))
    references = [np.zeros((len(q), len(controller.signals), 3)) for controller in record.controllers]
    return _columns(record.controllers, record.parts(t, q, v), references, q, v)


class _Nodes(NamedTuple):
    """Starts and ends of n steps of a motion [s], and states at m nodes in each: (n m,), (n m, nq), (n m, nv)."""

    start: Array
    end: Array
    t: Array
    q: Array
    v: Array

    @classmethod
    def of(cls, motion: SegmentedMotion) -> _Nodes:
        parts = []
        for segment in motion.segments:
            start, end = segment.solution.steps.t, segment.solution.steps.until
            t = (start[:, None] + 0.5 * (end - start)[:, None] * (NODES + 1.0)).ravel()
            index = np.repeat(np.arange(len(start)), len(NODES))
            states = segment.system.whole(t, *segment.solution.states_in(index, t))
            parts.append((start, end, t, *states))
        return cls(*map(np.concatenate, zip(*parts, strict=True)))

    def mean(self, values: Array) -> float:
        h = self.end - self.start
        return float((0.5 * values.reshape(len(h), -1) @ WEIGHTS) @ h / h.sum())


def motor_remarks(motion: SegmentedMotion) -> list[str]:
    """Return remarks on limits of motors: how long at peak, and above the continuous torque."""
    record, remarks = record_of(motion), list[str]()
    if not any(isinstance(controller, MotorController) for controller in record.controllers):
        return remarks
    nodes = _Nodes.of(motion)
    for controller, part in zip(record.controllers, record.parts(nodes.t, nodes.q, nodes.v), strict=True):
        if isinstance(controller, MotorController):
            own, (drive,), (joint,) = {name: x[:, 0] for name, x in part.items()}, controller.drives, controller.joints
            remarks += _at_limits(drive, own, nodes)
            if isinstance(controller, TorqueSource):
                remarks += _above_continuous(drive, controller, own, nodes, joint.v)
    return remarks


def _at_limits(drive: str, own: dict[str, Array], nodes: _Nodes) -> Iterator[str]:
    for name, does in AT_LIMIT.items():
        margin = own.get(name, np.full(len(nodes.t), np.nan))
        inside = (margin <= ROUNDING * np.nanmax(margin, initial=1.0)).reshape(len(nodes.start), -1).any(axis=1)
        if inside.any():
            start, end, total = nodes.start[inside][0], nodes.end[inside][-1], (nodes.end - nodes.start)[inside].sum()
            often = f", {total:.6g} s in all" if total < (1.0 - ROUNDING) * (end - start) else ""
            yield f"{drive} {does} from t = {start:.6g} s to {end:.6g} s{often}"


def _above_continuous(drive: str, motor: TorqueSource, own: dict[str, Array], nodes: _Nodes, v: int) -> Iterator[str]:
    if motor.continuous is None:
        return
    rms, speed = nodes.mean(own["torque"] ** 2) ** 0.5, nodes.mean(np.abs(motor.ratio * nodes.v[:, v]))
    if rms > (allowed := float(np.interp(speed, *motor.continuous))):
        yield (
            f"{drive} gives a torque of {rms:.3g} N*m rms at a mean speed of {speed:.3g} rad/s, more than "
            f"its continuous torque there, {allowed:.3g} N*m"
        )
