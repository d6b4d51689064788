"""What stops prescribed coordinates at a singular position: the end of their travel, and the links in line there.

At the end of its travel a coordinate cannot move, and the mechanism moves while it rests: with J the rows of the
constraints and coordinates, ``y^T J = s x^T`` with a part of y on the row of the coordinate, and s all but 0. Along x
the coordinate turns back: it goes by ``s u + c u^2 / 2`` with ``c = y^T J' x``, and turns where ``u = -s / c``. Where c
vanishes as well, as of a folded arm whose tip is at its base, it may go on. Links that x turns are in line where the
joints between them are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array
from pinarm.mechanics.geometry.kinematics import Kinematics
from pinarm.mechanics.joints import RADIAN, moved_links
from pinarm.mechanics.loops.loop_joints import LoopJoint

if TYPE_CHECKING:
    from pinarm.engine.kinematics.newton import NewtonSolver

PART = 0.1
"""Part of a motion, or of a combination of rows, of length 1, from which on it is named; and the way u along x within
which a coordinate has to turn back."""

STRAIGHT = 1e-6
"""A c, and other singular values relative to the largest, that are not told from 0: configurations are known to it."""

IN_LINE = 1e-3
"""Largest distance of joints from a line, relative to their distances: a position counts as singular within 1e-6, and
an angle is known to the root of that."""


def travel(solver: NewtonSolver, q: Array) -> str:
    """Return which coordinates are at the end of their travel at a singular position, and why; empty where none is."""
    rows, own = solver.rows(solver.closure.state(q)), solver.closure.size
    if len(rows) != rows.shape[1]:
        return ""
    u, values, vt = np.linalg.svd(rows)
    state = solver.closure.state(q, solver.spread(vt[-1]))
    drifts = np.append(solver.closure.drift(state), [one.drift(state) for one in solver.coordinates])
    bend = abs(float(u[:, -1] @ (drifts / solver.measure)))
    if bend < STRAIGHT or values[-1] > PART * bend or (values[:-1] < STRAIGHT * values[0]).any():
        return ""
    named = zip(solver.names[own:], solver.coordinates, u[own:, -1], strict=True)
    stuck = [
        f"{name} = {math.degrees(one.value(state)):.6g} deg" if one.unit == RADIAN
        else f"{name} = {one.value(state):.6g} {one.unit}"
        for name, one, part in named if abs(part) > PART
    ]  # fmt: skip
    if not stuck:
        return ""
    links = [moved_links(state.model, joint)[0] for joint in _turning(state)]
    line = f", where links {' and '.join(links)} are in line" if len(links) == 2 and _in_line(solver, state) else ""
    return f"{', '.join(stuck)} {'is' if len(stuck) == 1 else 'are'} the end of travel{line}"


def _turning(state: Kinematics) -> list[int]:
    """Return the joints behind which bodies turn."""
    spins = np.array([np.linalg.norm(each.angular) for each in state.data.v])
    return np.flatnonzero(spins > PART * spins.max(initial=0.0)).tolist() if spins.any() else []


def _in_line(solver: NewtonSolver, state: Kinematics) -> bool:
    """Tell whether the joints between bodies that turn against each other are in line, seen along their axis."""
    points = np.array([*_joints(solver, state)])
    if len(points) < 3:  # two are always in line
        return False
    axis = max((each.angular for each in state.data.v), key=np.linalg.norm)
    axis = axis / np.linalg.norm(axis)
    apart = points - points.mean(axis=0)
    sizes = np.linalg.svd(apart - np.outer(apart @ axis, axis), compute_uv=False)
    return bool(sizes[1] <= IN_LINE * sizes[0])


def _joints(solver: NewtonSolver, state: Kinematics) -> Iterator[Array]:
    """Yield the places of joints whose two bodies turn against each other."""
    model, data = state.model, state.data
    turns = [data.oMi[k].rotation @ data.v[k].angular for k in range(model.njoints)]
    least = PART * max(float(np.linalg.norm(turn)) for turn in turns)
    for k in range(1, model.njoints):
        if np.linalg.norm(turns[k] - turns[model.parents[k]]) > least:
            yield data.oMi[k].translation
    for one in solver.closure.constraints:
        if isinstance(one, LoopJoint):
            first, second = (model.frames[frame].parentJoint for frame in (one.first, one.second))
            if np.linalg.norm(turns[first] - turns[second]) > least:
                yield data.oMf[one.first].translation
