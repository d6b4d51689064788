"""The mechanism as a stick figure with names, where a run starts and where it ends, faintly in between; for print."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pinarm.arrays import Array, distinct
from pinarm.engine.mechanism import Mechanism
from pinarm.records import ValueRecord, replace
from pinarm.use.show.chart import COLOURS, Chart, Line, Note, Panel
from pinarm.use.show.labels import PLAIN, plain, shown, symbol
from pinarm.use.show.note_places import note_places
from pinarm.use.show.replay.overlays import BodyPoint, Connection
from pinarm.use.show.replay.tracks import placed
from pinarm.use.show.scene import GROUND, PATH, Scene, mark, scene_of, stroke
from pinarm.use.show.scenery import floor, mounts, shadow, triad

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

BETWEEN = 4
"""Positions between start and end."""

FINE = 600
"""Rows by which paths are drawn."""

SIZE = 5.6
"""Width and height [inch]."""

INSIDE = 47.0
"""Of each inch of the picture, what lines fill, without numbers, legend and margins [points]."""

COIL = np.array([0.0, 0.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 0.0, 0.0])
"""A spring: how far its points stand beside its axis, in its half width."""

EVEN = 1e-9
"""Part of an axis that may stand out of the picture for the axis still to lie in it."""

WRAP = 58
"""Letters of a line of the title."""

MOVED = 0.05
"""How far from its start a point must end, relative to the extent, to be named there again."""

SAME = 2e-3
"""How far, relative to the extent, start and end may be apart and still be drawn as one: as far as a line is wide."""

FAINT = "#d0d4d9"
"""Colour of positions in between."""


class Pose(ValueRecord, frozen=True):
    """A position that is drawn strongly.

    Attributes:
        place: Placements of the bodies, shape (njoints, 4, 4).
        label: What the legend calls it.
        colour: Its colour.
    """

    place: Array
    label: str
    colour: str


def sketch(result: Result) -> Chart:
    """Return a drawing of the mechanism at the start and the end of a run, with names and the paths of its ends.

    Rows that stand for themselves, such as equilibria, are drawn alike. A planar mechanism is seen along its axes, any
    other as its replay shows it.
    """
    run, how = result.trajectory, result.presentation
    model = run.mechanism.model
    scene = scene_of(run.mechanism, run.dynamics.forces, run.q, how)
    rows = distinct(np.linspace(0, len(run) - 1, BETWEEN + 2).round().astype(np.intp)).tolist()
    places = dict(zip(rows, placed(model, run.q[rows]), strict=True))
    chosen = rows if run.numbered else [0, len(run) - 1]
    poses = [Pose(places[row], _where(result, row), COLOURS[k % len(COLOURS)]) for k, row in enumerate(chosen)]
    if not run.numbered and _same(scene, poses):
        poses = [replace(poses[0], label=f"{poses[0].label}, {poses[1].label}")] if len(run) > 1 else poses[:1]
    paths = [] if run.numbered else [tip.path(placed(model, run.q, FINE)) for tip in scene.figure.tips]
    between = [place for row, place in places.items() if row not in chosen]
    return _chart(scene, poses, between, paths, result.content.title or result.name)


def structure(mechanism: Mechanism, q: Array, label: str) -> Chart:
    """Return a drawing of a mechanism in one configuration, with names.

    Args:
        mechanism: The mechanism.
        q: Pinocchio's configuration, shape (nq,).
        label: Which position that is, in words.
    """
    scene = scene_of(mechanism, mechanism.forces, q[None], PLAIN)
    pose = Pose(placed(mechanism.model, q[None])[0], plain(label), COLOURS[0])
    return _chart(scene, [pose], [], [], mechanism.title)


def _same(scene: Scene, poses: Sequence[Pose]) -> bool:
    """Tell whether all positions are one."""
    apart = [pose.place[:, :3] - poses[0].place[:, :3] for pose in poses]
    return all(np.abs(each[..., :3]).max() < SAME and np.abs(each[..., 3]).max() < SAME * scene.framing.size
               for each in apart)  # fmt: skip


def _chart(scene: Scene, poses: Sequence[Pose], between: Sequence[Array], paths: Sequence[Array], title: str) -> Chart:
    flat = scene.framing.normal is not None
    lines = [] if flat else [*floor(scene), *(line for pose in poses for line in shadow(scene, pose.place))]
    for path in paths:
        lines.append(stroke(scene.view.flat(path), PATH, 0.7, ":"))
    for place in between:
        lines += _drawn(scene, place, FAINT, 1.0)
    lines += mounts(scene)
    for pose in poses:
        first, *others = _drawn(scene, pose.place, pose.colour, 2.2)
        lines += [replace(first, label=pose.label), *others]
    notes = _notes(scene, poses, lines)
    axes, letters = ([], []) if flat else triad(scene, lines)
    across, up = _axis_names(scene) if flat else ("", "")
    panel = Panel([*lines, *axes], [*notes, *letters], across=across, up=up, equal=True, framed=bool(across),
                  margin=0.1, grid=False)  # fmt: skip
    return Chart(plain("\n".join(textwrap.wrap(title, WRAP))), [panel], SIZE, SIZE, "below")


def _drawn(scene: Scene, place: Array, colour: str, width: float) -> Iterator[Line]:
    """Yield one position."""
    for stick in scene.figure.sticks:
        points = stick.points @ place[stick.node, :3, :3].T + place[stick.node, :3, 3]
        yield stroke(scene.view.flat(points), colour, width * stick.weight)
    for pair in scene.pairs:
        yield _joined(pair, [scene.flat(place, end) for end in pair.ends], colour, width)
    for node, zero in scene.figure.rails:
        ends = np.array([scene.flat(place, zero), scene.flat(place, BodyPoint(node, np.zeros(3)))]).T
        yield stroke(ends, colour, 0.4 * width, "-.")
        yield mark(ends[:, 1], colour, 2.4 * width, "s")
    for node in scene.figure.pins:
        yield mark(scene.flat(place, BodyPoint(node, np.zeros(3))), colour, 2.2 * width)


def _joined(pair: Connection, ends: list[Array], colour: str, width: float) -> Line:
    """Return what joins two points: a spring as a coil, a cylinder thick and light, a loop joint as its pin."""
    one, two = ends
    along, share = two - one, np.linspace(0.0, 1.0, len(COIL))
    if pair.kind == "loop":
        return mark(one, colour, 2.2 * width)
    beside = 0.06 * np.array([-along[1], along[0]])[:, None] * COIL if pair.kind == "spring" else 0.0
    wide, opacity = (2.5 * width, 0.4) if pair.kind == "cylinder" else (0.6 * width, 1.0)
    return stroke(one[:, None] + along[:, None] * share + beside, colour, wide, opacity=opacity)


def _notes(scene: Scene, poses: Sequence[Pose], lines: Sequence[Line]) -> list[Note]:
    """Return the names: those of points and joints at the first position; others where there is room.

    These are those of parts, and those of points and joints that have moved at further positions.
    """
    wanted: list[Note] = []
    start = [(name, scene.flat(poses[0].place, name.at)) for name in scene.names]
    start.sort(key=lambda named: named[0].kind == "part")
    for name, at in start:
        colour = PATH if name.kind == "part" else poses[0].colour if name.at.node else GROUND
        wanted.append(Note(float(at[0]), float(at[1]), name.text, colour=colour))
    kept = sum(name.kind != "part" for name, _ in start)
    for pose in poses[1:]:
        for name, before in start:
            at = scene.flat(pose.place, name.at)
            if name.kind != "part" and np.linalg.norm(at - before) > MOVED * scene.framing.size:
                wanted.append(Note(float(at[0]), float(at[1]), name.text, colour=pose.colour))
    strong = [line for line in lines if line.colour in {pose.colour for pose in poses} | {GROUND}]
    return note_places(wanted, lines, strong, INSIDE * SIZE, kept=kept)


def _axis_names(scene: Scene) -> tuple[str, str]:
    """Return what is right and up in a flat picture; nothing where these are no axes of the world."""
    names = ["xyz"[k] for direction in scene.view.axes for k in range(3) if direction[k] > 1.0 - EVEN]
    return (f"{names[0]} [m]", f"{names[1]} [m]") if len(names) == 2 else ("", "")


def _where(result: Result, row: int) -> str:
    """Return what the legend calls a position."""
    run = result.trajectory
    scale, measured = shown(result.parameter, result.presentation)
    value = f"{run.grid.t[row] / scale:.4g}".replace("-", "−")
    if run.numbered:
        return f"row {value}"
    unit = {"1": "", "°": "°"}.get(str(measured or "1"), f" {measured}")
    return f"{'end' if row else 'start'}: {symbol(run.parameter)} = {plain(value + unit)}"
