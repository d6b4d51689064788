"""Static torsors of joints as a table of a report: which components a joint transmits, and their ranges in the run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.self_stresses import joint_kind
from pinarm.engine.series import Series
from pinarm.input.units import unit
from pinarm.language import said
from pinarm.mechanics.joints import moved_links
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.use.method.actions import bodies_of
from pinarm.use.method.torsors import LETTERS, Torsor, torsor
from pinarm.use.result.measures import SOLVED
from pinarm.use.show.document import ReportTable, rounded, with_unit

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

TITLE = "Static torsors of the joints"
REMARK = (
    "Action of the first body on the second, at the joint's own point, in the axes of the second; least and greatest "
    "value of the run. 0: the joint does not transmit it, or it is 0 but for rounding. Along a driven axis stands the "
    "effort of the drive."
)

MOST_JOINTS = 40
"""Joints of a table that a person reads."""


def joint_torsors(result: Result) -> ReportTable:
    """Return the table of the static torsors; without rows where the run has no efforts."""
    letters, *units = LETTERS["static"]
    scales = [result.presentation.scale(Series("", unit(each), np.zeros(0))) for each in units]
    headings = [said("Joint"), said("first body"), said("second body"), said("kind")]
    headings += [with_unit(letter, scales[k // 3][1]) for k, letter in enumerate(letters)]
    torsors = [*_torsors(result)] if not result.trajectory.no_efforts else []
    largest = max((_largest(acting.resultant) for *_, acting in torsors), default=0.0)
    rows = [[*words, *(_range(acting, k, scales[k // 3][0], largest) for k in range(6))] for *words, acting in torsors]
    return ReportTable(headings, rows, range(4), TITLE, REMARK)


def _torsors(result: Result) -> Iterator[tuple[str, str, str, str, Torsor]]:
    """Yield name, bodies and kind of each joint with its torsor."""
    mechanism, model = result.trajectory.mechanism, result.trajectory.mechanism.model
    ties = [(str(model.names[k]), joint_kind(model, k), int(model.parents[k]), k) for k in bodies_of(mechanism)]
    for constraint in mechanism.constraints:
        if isinstance(constraint, LoopJoint):
            first, second = (int(model.frames[frame].parentJoint) for frame in (constraint.first, constraint.second))
            ties.append((constraint.name, constraint.kind, first, second))
    for name, kind, *bodies in ties[:MOST_JOINTS]:
        before, after = (moved_links(model, body)[0] if body else "" for body in bodies)
        acting = torsor(result, name, "", after, "static")
        yield name, before or said("ground"), after or said("ground"), said(kind), acting


def _largest(values: Array) -> float:
    return float(np.nanmax(np.abs(values), initial=0.0))


def _range(acting: Torsor, k: int, scale: float, largest: float) -> str:
    """Return the range of a component, one number where it is constant; 0 where the joint does not transmit it.

    Args:
        acting: The torsor.
        k: The component.
        scale: From SI to the unit of the table.
        largest: Largest force in any joint [N].
    """
    if acting.shape[k] == "0":
        return "0"
    if acting.undetermined[k]:
        return said("undetermined")
    values, size = acting.components[:, k], largest * (acting.extent if k >= 3 else 1.0)
    values = np.where(np.abs(values) > SOLVED * max(size, _largest(values)), values * scale, 0.0)
    least, greatest = rounded(float(values.min())), rounded(float(values.max()))
    return least if least == greatest else f"{least} … {greatest}"
