"""Drawing of the mechanism with names: start and end of a run in colour, positions in between in grey."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, distinct
from pinarm.engine.mechanism import Mechanism
from pinarm.records import ValueRecord, replace
from pinarm.use.show.chart import COLOURS, Chart, Line, Note, Panel, Window, extent
from pinarm.use.show.labels import PLAIN, plain, shown, symbol
from pinarm.use.show.note_places import leaders, note_places
from pinarm.use.show.replay.overlays import BodyPoint, Connection
from pinarm.use.show.replay.tracks import placed
from pinarm.use.show.scene import GROUND, PATH, Scene, floor, mark, mounts, scene_of, shadow, stroke, triad

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

BETWEEN = 4
"""Positions between start and end."""

FINE = 600
"""Rows by which paths are drawn."""

SIZE = 5.6
"""Width [inch], and largest height of what is drawn."""

INSIDE = 320.0
"""Width of the drawing, and its largest height, without numbers, legend and heading [points]."""

LOWEST = 150.0
"""Least height of the drawing: flat mechanisms have names and ticks too [points]."""

EDGE = 32.0
"""Around what is drawn, for names [points]."""

POINT = 1e-100
"""Size of a drawing below which it is one point [m]: a scale in points per metre would overflow."""

POINTS = 72.0
"""Points per inch."""

FRAME, HEADING, ENTRIES = 42.0, 30.0, 22.0
"""Height of the numbers below a drawing, of its heading, and of a row of the legend [points]."""

COIL = np.array([0.0, 0.0, 1.0, *[-1.0, 1.0] * 5, -1.0, 0.0, 0.0])
"""Corners of a spring: distance from its axis, relative to its half width."""

ALONG = np.array([0.0, 0.15, *np.linspace(0.18, 0.82, 12), 0.85, 1.0])
"""Places of these corners along the spring, relative to its length."""

WIDE, SLENDER = {"spring": 0.018, "cylinder": 0.011}, 0.13
"""Half width of springs and of cylinders at most, relative to the extent of the mechanism and to their length."""

BARREL = 0.7
"""Length of the barrel of a cylinder, relative to the least distance of its ends."""

EVEN = 1e-9
"""Component of a unit vector that is rounding."""

WRAP = 58
"""Letters of a line of the title."""

MOVED = 0.05
"""Distance of start and end, relative to the extent, from which a point is named at both."""

SAME = 2e-3
"""Distance of start and end, relative to the extent, up to which they are drawn as one: the width of a line."""

FAINT = "#d0d4d9"
"""Colour of positions in between."""


class Pose(ValueRecord, frozen=True):
    """A position in colour.

    Attributes:
        place: Placements of the bodies, shape (njoints, 4, 4).
        label: Its name in the legend.
        colour: Its colour.
    """

    place: Array
    label: str
    colour: str


def sketch(result: Result) -> Chart:
    """Return a drawing of the mechanism at the start and the end of a run, with names and the paths of its ends.

    Separate rows, such as equilibria, are all drawn in colour. A planar mechanism is seen along its axes, any other as
    its replay shows it.
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
    between = [place for row, place in places.items() if row not in chosen]
    return _chart(
        scene, poses, between, [] if run.numbered else _paths(scene, model, run.q), result.content.title or result.name
    )


def _paths(scene: Scene, model: pin.Model, q: Array) -> list[Array]:
    """Return the paths of the ends of a mechanism through configurations, each of shape (FINE, 3)."""
    if not (tips := scene.figure.tips):
        return []
    places = placed(model, q, FINE)
    return [tip.path(places) for tip in tips]


def structure(mechanism: Mechanism, q: Array, label: str) -> Chart:
    """Return a drawing of a mechanism in one configuration, with names.

    Args:
        mechanism: The mechanism.
        q: Pinocchio's configuration, shape (nq,).
        label: Name of the configuration in the legend.
    """
    scene = scene_of(mechanism, mechanism.forces, q[None], PLAIN)
    pose = Pose(placed(mechanism.model, q[None])[0], plain(label), COLOURS[0])
    return _chart(scene, [pose], [], [], mechanism.title)


def _same(scene: Scene, poses: Sequence[Pose]) -> bool:
    apart = [pose.place[:, :3] - poses[0].place[:, :3] for pose in poses]
    return all(np.abs(difference[..., :3]).max() < SAME and np.abs(difference[..., 3]).max() < SAME * scene.framing.size
               for difference in apart)  # fmt: skip


def _chart(scene: Scene, poses: Sequence[Pose], between: Sequence[Array], paths: Sequence[Array], title: str) -> Chart:
    flat = scene.framing.normal is not None
    lines = [] if flat else [*floor(scene), *(line for pose in poses for line in shadow(scene, pose.place))]
    for path in paths:
        lines.append(stroke(scene.view.flat(path), PATH, 0.7, ":"))
    for place in between:
        lines += _drawn(scene, place, FAINT, scene.thickness)
    lines += [*_guides(scene), *mounts(scene)]
    for pose in poses:
        first, *others = _drawn(scene, pose.place, pose.colour, 2.2 * scene.thickness)
        lines += [replace(first, label=pose.label), *others]
    window, per = _window(lines)
    axes, letters, taken = ([], [], []) if flat else triad(scene, window, per)
    notes = _notes(scene, poses, lines, window, per, taken)
    across, up = _axis_names(scene) if flat else ("", "")
    drawn = [*lines, *leaders(notes, per), *axes]
    panel = Panel(drawn, [*notes, *letters], across=across, up=up, equal=True, framed=bool(across),
                  grid=False, window=window)  # fmt: skip
    heading = plain("\n".join(textwrap.wrap(title, WRAP)))
    height = per * (window[1][1] - window[1][0]) + (FRAME if across else 0.0)
    height += HEADING * (1 + heading.count("\n")) + ENTRIES * -(-len(poses) // 2)
    return Chart(heading, [panel], SIZE, height / POINTS, "below")


def _window(lines: Sequence[Line]) -> tuple[Window, float]:
    """Return the window of the drawing, with room for names around the lines, and its scale [points per metre]."""
    low, high = extent(lines)
    size = high - low
    per = float((INSIDE - 2.0 * EDGE) / size.max()) if size.max() > POINT else 1.0
    room = np.array([INSIDE, max(LOWEST, float(per * size[1]) + 2.0 * EDGE)]) / per
    (left, bottom), (right, top) = (low + high - room) / 2.0, (low + high + room) / 2.0
    return ((float(left), float(right)), (float(bottom), float(top))), per


def _guides(scene: Scene) -> Iterator[Line]:
    """Yield rails and slots of the ground."""
    for rail in scene.guides:
        if not rail.node:
            yield stroke(scene.view.flat(rail.points), GROUND, 1.0, rail.style)


def _drawn(scene: Scene, place: Array, colour: str, width: float) -> Iterator[Line]:
    figure = scene.figure
    for stick in (*figure.lines, *(rail for rail in scene.guides if rail.node)):
        points = stick.points @ place[stick.node, :3, :3].T + place[stick.node, :3, 3]
        yield stroke(scene.view.flat(points), colour, width * stick.weight, stick.style)
    for pair, shortest in zip(scene.pairs, scene.shortest, strict=True):
        yield from _joined(scene, place, pair, shortest, colour, width)
    for node in figure.slides:
        yield mark(scene.flat(place, BodyPoint(node, np.zeros(3))), colour, 2.4 * width, "s")
    for node in figure.pins:
        yield mark(scene.flat(place, BodyPoint(node, np.zeros(3))), colour, 2.2 * width)


def _joined(
    scene: Scene, place: Array, pair: Connection, shortest: float, colour: str, width: float
) -> Iterator[Line]:  # fmt: skip
    """Yield the drawing of a connection.

    A spring is a coil, a cylinder a barrel and its rod, a rod or a cable a line, a bushing a block, and a loop joint
    its pin, which in a slot is that of the second point.
    """
    start, tip = (scene.flat(place, end) for end in pair.ends)
    along, length = tip - start, float(np.linalg.norm(tip - start))
    half = min(WIDE.get(pair.kind, 0.0) * scene.framing.size, SLENDER * length)
    beside = half * np.array([-along[1], along[0]]) / length if length else np.zeros(2)
    if pair.kind in ("loop", "slot"):
        yield mark(tip if pair.kind == "slot" else start, colour, 2.2 * width)
    elif pair.kind == "bushing":
        yield replace(mark(start, colour, 3.0 * width, "s"), fill=colour)
    elif pair.kind == "spring":
        yield stroke(start[:, None] + np.outer(along, ALONG) + np.outer(beside, COIL), colour, 0.6 * width)
    elif pair.kind == "cylinder":
        [now] = pair.lengths(place[None]).tolist()
        end = start + along * (BARREL * shortest / now if now else 0.0)
        corners = [start + beside, end + beside, end - beside, start - beside, start + beside]
        yield stroke(np.array(corners).T, colour, 0.6 * width)
        yield stroke(np.array([end, tip]).T, colour, 1.2 * width)
    else:
        yield stroke(np.array([start, tip]).T, colour, (0.4 if pair.kind == "cable" else 0.6) * width)
    if pair.kind in ("spring", "cylinder", "cable"):
        for end in (start, tip):
            yield mark(end, colour, 1.5 * width)


def _notes(
    scene: Scene, poses: Sequence[Pose], lines: Sequence[Line], window: Window, per: float, taken: Sequence[Array]
) -> list[Note]:  # fmt: skip
    """Return the names that have room.

    Those of points and joints at the first position come first, then those of parts, then those of points and joints
    that have moved at further positions.
    """
    wanted: list[Note] = []
    start = [(name, scene.flat(poses[0].place, name.at)) for name in scene.names]
    start.sort(key=lambda named: named[0].kind == "part")
    for name, at in start:
        colour = PATH if name.kind == "part" else poses[0].colour if name.at.node else GROUND
        wanted.append(Note(float(at[0]), float(at[1]), name.text, colour=colour))
    for pose in poses[1:]:
        for name, before in start:
            at = scene.flat(pose.place, name.at)
            if name.kind != "part" and np.linalg.norm(at - before) > MOVED * scene.framing.size:
                wanted.append(Note(float(at[0]), float(at[1]), name.text, colour=pose.colour))
    strong = [line for line in lines if line.colour in {pose.colour for pose in poses} | {GROUND}]
    return note_places(wanted, strong, window, per, taken)


def _axis_names(scene: Scene) -> tuple[str, str]:
    """Return the names of the axes of a flat picture; empty where these are no axes of the world."""
    names = ["xyz"[k] for direction in scene.view.axes for k in range(3) if direction[k] > 1.0 - EVEN]
    return (f"{names[0]} [m]", f"{names[1]} [m]") if len(names) == 2 else ("", "")


def _where(result: Result, row: int) -> str:
    """Return the name of a position in the legend."""
    run = result.trajectory
    scale, measured = shown(result.parameter, result.presentation)
    value = f"{run.grid.t[row] / scale:.4g}".replace("-", "−")
    if run.numbered:
        return f"row {value}"
    unit = {"1": "", "°": "°"}.get(str(measured or "1"), f" {measured}")
    return f"{'end' if row else 'start'}: {symbol(run.parameter)} = {plain(value + unit)}"
