"""Graph of links: bodies as nodes, joints, loop joints and couplings as edges, the ground below."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinarm.engine.constraints.constraint_rows import joint_ties
from pinarm.engine.constraints.self_stresses import joint_kind
from pinarm.engine.mechanism import Mechanism
from pinarm.language import said
from pinarm.mechanics.joints import moved_links
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.use.show.labels import symbol
from pinarm.use.show.picture import COLOURS, INK, Note, Picture, drawing, write

WIDE, HIGH = 1.6, 1.2
"""Distance of nodes beside and above each other [inch]."""

LOOP, COUPLED, BENT = COLOURS[1], COLOURS[2], 0.25
"""Colours of loop joints and couplings, and how far edges beside others are bent, relative to their length."""


UPWARDS, LINE = 0.7, 5.0
"""Place of a label along its edge, from the lower body, as edges cross in the middle; half a line [points]."""


class Edge(NamedTuple):
    """Connection of two bodies, by joint index, 0 for the ground: its name and kind, and its colour."""

    ends: tuple[int, int]
    label: tuple[str, str]
    colour: str = INK


def link_graph(mechanism: Mechanism) -> Picture:
    """Return the graph of the links of a mechanism, each joint with its kind."""
    edges, model = _edges(mechanism), mechanism.model
    places = _places(edges)
    width = 1.0 + max(abs(x) for x, _ in places.values()) * 2.0 * WIDE
    height = 0.7 + max(y for _, y in places.values()) * HIGH
    with drawing(max(width + 1.0, 4.0), height + 0.5, mechanism.title) as picture:
        axis = picture.add_subplot()
        axis.set_axis_off()
        axis.set_xlim(-0.5 * width / WIDE - 0.3, 0.5 * width / WIDE + 0.3)
        axis.set_ylim(-0.4, height / HIGH - 0.2)
        met: dict[tuple[int, int], int] = {}
        for ends, label, colour in edges:
            start, goal = (np.array(places[end]) for end in ends)
            pair = (min(ends), max(ends))
            met[pair] = met.get(pair, 0) + 1
            between = [y for x, y in places.values() if abs(x - start[0]) < 0.1 and start[1] < y < goal[1]]
            bend = BENT * (met[pair] - 1 + bool(between and start[0] == goal[0])) * (1 if ends[0] <= ends[1] else -1)
            look = {"arrowstyle": "-", "color": colour, "lw": 1.5, "shrinkA": 0, "shrinkB": 0,
                    "connectionstyle": f"arc3,rad={bend}"}  # fmt: skip
            axis.annotate("", tuple(goal), tuple(start), arrowprops=look)
            share = UPWARDS if start[1] < goal[1] else 1.0 - UPWARDS if goal[1] < start[1] else 0.5
            middle = (
                (1.0 - share) * start + share * goal + 0.5 * bend * np.array([goal[1] - start[1], start[0] - goal[0]])
            )
            for text, up in zip(label, (LINE, -LINE), strict=True):
                write(axis, Note(text, middle, colour), (0.0, up))
        for body, place in places.items():
            name = symbol(moved_links(model, body)[0]) if body else said("ground")
            box = {"boxstyle": "round", "fc": "white" if body else "#e1e4e8", "ec": INK}
            axis.text(*place, name, ha="center", va="center", bbox=box)
    return picture


def _edges(mechanism: Mechanism) -> list[Edge]:
    model, idle = mechanism.model, {tie.rotor.index for tie in joint_ties(mechanism.constraints)}
    edges = [
        Edge((int(model.parents[k]), k), (symbol(str(model.names[k])), said(joint_kind(model, k))))
        for k in range(1, model.njoints)
        if k not in idle
    ]
    for constraint in mechanism.constraints:
        if isinstance(constraint, LoopJoint):
            ends = (int(model.frames[constraint.first].parentJoint), int(model.frames[constraint.second].parentJoint))
            edges.append(Edge((min(ends), max(ends)), (symbol(constraint.name), said(constraint.kind)), LOOP))
    for relation in mechanism.relations:
        bodies = [k for k in range(1, model.njoints) if model.joints[k].idx_v in relation.joints and k not in idle]
        bodies = [k for k in bodies if len(bodies) == 2 or k not in {model.parents[other] for other in bodies}]
        if len(bodies) == 2:  # a third one is the carrier of both
            edges.append(Edge((bodies[0], bodies[1]), (symbol(relation.name), said(relation.kind)), COUPLED))
    return edges


def _places(edges: list[Edge]) -> dict[int, tuple[float, float]]:
    """Return the place of each body: above the ground by the number of ties to it, near those that it is tied to."""
    depth, border = {0: 0}, [0]
    while border:
        ties = [
            (node, neighbour)
            for edge in edges
            for node, neighbour in (edge.ends, edge.ends[::-1])
            if edge.colour != COUPLED
        ]
        border = list(dict.fromkeys(neighbour for node, neighbour in ties if node in border and neighbour not in depth))
        depth |= dict.fromkeys(border, max(depth.values()) + 1)
    places: dict[int, tuple[float, float]] = {}
    for level in range(max(depth.values()) + 1):
        row = [body for body, at in depth.items() if at == level]
        below = {
            body: [places[end][0] for edge in edges for end in edge.ends if body in edge.ends and end in places]
            for body in row
        }
        row.sort(key=lambda body: float(np.mean(below[body] or [0.0])))
        places |= {body: (k - 0.5 * (len(row) - 1), float(level)) for k, body in enumerate(row)}
    return places
