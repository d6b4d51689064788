"""Drawings of a mechanism: start and end of a run with names, and every body by itself with all its loads to scale."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pinarm.arrays import Array, Flags, distinct
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.quantities.family import NEWTON, NEWTON_METRE
from pinarm.engine.series import Series
from pinarm.language import decimals, in_language, said, told
from pinarm.mechanics.joints import METRE
from pinarm.records import Record
from pinarm.use.assessments.loads import Action, free_bodies
from pinarm.use.result.presentation import Presentation
from pinarm.use.show.bodies import BodyPoint, Connection, placed
from pinarm.use.show.labels import PLAIN, axis_label, plain, shown, symbol, unit_text
from pinarm.use.show.picture import COLOURS, INK, Note, Picture, drawing, label, legend_below, write
from pinarm.use.show.scene import Framing, Scene, names_of, scene
from pinarm.use.show.text import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

    from pinarm.use.result.result import Result

BETWEEN, FINE = 4, 600
"""Positions between start and end; rows by which paths are drawn."""

SIZE, INSIDE, LOWEST, EDGE = 5.6, 320.0, 150.0, 32.0
"""Width of the picture [inch]; width and largest height, least height, and margin for names of the drawing [points]."""

FRAME, HEADING, ENTRIES, WRAP = 42.0, 30.0, 22.0, 58
"""Height of the numbers below a drawing, of a line of its heading, of a row of the legend [points]; letters a line."""

POINTS = 72.0
"""Points per inch."""

COIL = np.array([0.0, 0.0, 1.0, *[-1.0, 1.0] * 5, -1.0, 0.0, 0.0])
ALONG = np.array([0.0, 0.15, *np.linspace(0.18, 0.82, 12), 0.85, 1.0])
"""Corners of a spring: distances from its axis, relative to its half width, and places along it, to its length."""

WIDE, SLENDER, BARREL = {"spring": 0.018, "cylinder": 0.011}, 0.13, 0.7
"""Half width of springs and of cylinders at most, relative to the extent of the mechanism and to their length; length
of the barrel of a cylinder, relative to the least distance of its ends."""

EVEN = 1e-9
"""Component of a unit vector that is rounding."""

MOVED = 0.05
"""Distance of start and end, relative to the extent, from which a point is named at both."""

THICK, THINNEST = 2.5, 0.35
"""Width of lines and marks, relative to four typical links over the extent, at most 1; their least relative width."""

PATH, GROUND, FAINT = "#8b949e", "#59595f", "#d0d4d9"
"""Colours of paths, of the ground, and of positions in between."""

AXES, TRIAD, LETTER = (("x", "#d6453d"), ("y", "#3a9d4a"), ("z", "#3569c9")), 26.0, 6.0
"""Names and colours of the world's axes, as in the replay; length of the axes in the corner, and half the size of
their letters, with a margin [points]."""

MOUNT = ((0.0, 0.0), (-0.8, -1.2), (0.8, -1.2), (0.0, 0.0))
"""Support of a joint on the ground, in the size of its mark."""


class Pose(Record, frozen=True):
    """A position in colour: placements of the bodies, shape (njoints, 4, 4), and its label in the legend."""

    place: Array
    label: str
    colour: str


@in_language
def sketch(result: Result, *, titled: bool = True) -> Picture:
    """Return a drawing of the mechanism at the start and the end of a run, with names and the paths of its ends.

    Separate rows, such as equilibria, are all drawn in colour. A planar mechanism is seen along its axes, any other
    from the direction of its replay, in parallel projection.
    """
    run, model = result.trajectory, result.trajectory.mechanism.model
    seen = scene(run.mechanism, run.dynamics.forces, run.q)
    rows = distinct(np.linspace(0, len(run) - 1, BETWEEN + 2).round().astype(np.intp)).tolist()
    places = dict(zip(rows, placed(model, run.q[rows]), strict=True))
    chosen = rows if run.numbered else distinct(np.array([0, len(run) - 1])).tolist()
    poses = [Pose(places[row], _where(result, row), COLOURS[k % len(COLOURS)]) for k, row in enumerate(chosen)]
    paths = [] if run.numbered else [tip.path(placed(model, run.q, FINE)) for tip in seen.figure.tips]
    between = [place for row, place in places.items() if row not in chosen]
    title = result.content.title or result.name if titled else ""
    return _Sketch(run.mechanism, seen, result.presentation).picture(poses, between, paths, title)


def structure(mechanism: Mechanism, q: Array, text: str) -> Picture:
    """Return a drawing of a mechanism in one configuration, shape (nq,), with names and a text as legend."""
    drawn = _Sketch(mechanism, scene(mechanism, mechanism.forces, q[None]), PLAIN)
    return drawn.picture([Pose(placed(mechanism.model, q[None])[0], plain(text), COLOURS[0])], [], [], mechanism.title)


def _where(result: Result, row: int) -> str:
    run, place = result.trajectory, _place(result, float(result.trajectory.grid.t[row]), 4)
    if run.numbered:
        return said("row {number}", number=place)
    return f"{said('end' if row else 'start')}{said(': ')}{symbol(run.parameter)} = {place}"


def _place(result: Result, t: float, digits: int) -> str:
    """Return a value of the parameter of a run [SI] as a label, with its unit."""
    factor, measured = shown(result.parameter, result.presentation)
    unit = {"1": "", "°": "°"}.get(str(measured or "1"), f" {measured}")
    return plain(decimals(f"{t / factor:.{digits}g}").replace("-", "−") + unit)


class _Sketch:
    """A drawing of a scene in the making: its lines are those of the axes."""

    def __init__(self, mechanism: Mechanism, seen: Scene, how: Presentation) -> None:
        self.seen, self.axes, self.names = seen, seen.framing.axes, names_of(mechanism, seen, how)
        self.flat, self.how = seen.framing.normal is not None, how
        self.thickness = float(np.clip(THICK * seen.figure.size / seen.framing.size, THINNEST, 1.0))
        """Factor of the widths of lines and marks: less than 1 where the links are many and short."""

    def picture(self, poses: Sequence[Pose], between: Sequence[Array], paths: Sequence[Array], title: str) -> Picture:
        heading = plain("\n".join(textwrap.wrap(title, WRAP)))
        with drawing(SIZE, SIZE, heading) as picture:
            self.axis: Axes = picture.subplots()
            for path in paths:
                self._line(path, PATH, 0.7, ":")
            for place in between:
                self._bodies(place, FAINT, self.thickness)
            self._ground()
            entries = [self._pose(pose) for pose in poses]
            per = self._framed()
            self._write_names(poses, per, [] if self.flat else [self._triad(per)])
            legend_below(picture, entries)
            height = per * np.ptp(self.axis.get_ylim()) + (FRAME if self.axis.axison else 0.0)
            height += HEADING * (1 + heading.count("\n")) + ENTRIES * -(-len(poses) // 2)
            picture.set_size_inches(SIZE, height / POINTS)
        return picture

    def _pose(self, pose: Pose) -> Line2D:
        """Draw a position; return its first line, with its label."""
        count = len(self.axis.lines)
        self._bodies(pose.place, pose.colour, 2.2 * self.thickness)
        self.axis.lines[count].set_label(label(pose.label))
        return self.axis.lines[count]

    def _line(self, points: Array, colour: str, width: float, style: str = "-") -> None:
        self.axis.plot(*self.axes @ points.T, color=colour, linewidth=width, linestyle=style)

    def _mark(self, point: Array, colour: str, size: float, marker: str = "o", fill: str = "#ffffff") -> None:
        self.axis.plot(*point[:, None], marker, color=colour, markersize=size, markerfacecolor=fill)

    def _at(self, place: Array, point: BodyPoint) -> Array:
        return np.asarray(self.axes @ point.path(place[None])[0])

    def _bodies(self, place: Array, colour: str, width: float) -> None:
        figure = self.seen.figure
        rails = [rail for rail in (*figure.slides.values(), *self.seen.slots) if rail.node]
        for stick in (*figure.lines, *rails):
            points = stick.points @ place[stick.node, :3, :3].T + place[stick.node, :3, 3]
            self._line(points, colour, width * stick.weight, stick.style)
        for pair in figure.joined:
            self._connection(place, pair, colour, width)
        for nodes, size, marker in ((figure.slides, 2.4, "s"), (figure.pins, 2.2, "o")):
            for node in nodes:
                self._mark(self._at(place, BodyPoint(node, np.zeros(3))), colour, size * width, marker)

    def _connection(self, place: Array, pair: Connection, colour: str, width: float) -> None:
        """Draw a connection.

        A spring is a coil, a cylinder a barrel and its rod, a rod or a cable a line, a bushing a block, and a loop
        joint its pin, which in a slot is that of the second point.
        """
        start, tip = (self._at(place, end) for end in pair.ends)
        if pair.kind in ("loop", "slot"):
            self._mark(tip if pair.kind == "slot" else start, colour, 2.2 * width)
            return
        if pair.kind == "bushing":
            self._mark(start, colour, 3.0 * width, "s", fill=colour)
            return
        along, length = tip - start, float(np.linalg.norm(tip - start)) or 1.0
        half = min(WIDE.get(pair.kind, 0.0) * self.seen.framing.size, SLENDER * length)
        beside = half * np.array([-along[1], along[0]]) / length
        thin, lines = (0.4 if pair.kind == "cable" else 0.6) * width, [np.array([start, tip])]
        if pair.kind == "spring":
            lines = [start + np.outer(ALONG, along) + np.outer(COIL, beside)]
        elif pair.kind == "cylinder":
            now = float(pair.lengths(place[None])[0]) or 1.0
            end = start + along * BARREL * float(pair.lengths(self.seen.places).min()) / now
            lines = [np.array([start + beside, end + beside, end - beside, start - beside, start + beside])]
            lines.append(np.array([end, tip]))
        for k, line in enumerate(lines):
            self.axis.plot(*line.T, color=colour, linewidth=(1 + k) * thin)
        for at in (start, tip) if pair.kind != "rod" else ():
            self._mark(at, colour, 1.5 * width)

    def _ground(self) -> None:
        figure = self.seen.figure
        for rail in (*figure.slides.values(), *self.seen.slots):
            if not rail.node:
                self._line(rail.points, GROUND, 1.0, rail.style)
        if figure.mounts:
            places, size = self.axes @ np.transpose(figure.mounts), 14.0 * self.thickness
            self.axis.plot(*places, linestyle="", marker=MOUNT, color=GROUND, markersize=size)

    def _framed(self) -> float:
        """Set the limits, with room for names around the lines, and the names of the axes.

        Return the scale of the drawing [points per metre].
        """
        low, high = np.array(self.axis.dataLim.min), np.array(self.axis.dataLim.max)
        size = high - low
        per = float((INSIDE - 2.0 * EDGE) / (size.max() or 1.0))
        room = np.array([INSIDE, max(LOWEST, float(per * size[1]) + 2.0 * EDGE)]) / per
        (left, bottom), (right, top) = ((low + high - room) / 2.0).tolist(), ((low + high + room) / 2.0).tolist()
        self.axis.set(xlim=(left, right), ylim=(bottom, top))
        self.axis.set_aspect("equal", adjustable="box")
        self.axis.grid(visible=False)
        names = ["xyz"[k] for direction in self.axes for k in range(3) if direction[k] > 1.0 - EVEN]
        if not self.flat or len(names) < 2:
            self.axis.set_axis_off()
            return per
        scale, measured = shown(Series("", METRE, np.zeros(0)), self.how)
        across, up = (axis_label(name, measured) for name in names)
        self.axis.set(xlabel=across, ylabel=up)
        for ticks in (self.axis.xaxis, self.axis.yaxis) if scale != 1.0 else ():
            ticks.set_major_formatter(lambda place, _: f"{place / scale:.6g}".replace("-", "−"))
        return per

    def _triad(self, per: float) -> Array:
        """Draw the world's axes in the lower left corner; return their box (left, bottom, right, top)."""
        corner = np.array([self.axis.get_xlim()[0], self.axis.get_ylim()[0]])
        reach = 1.35 * TRIAD / per * self.axes.T
        origin = corner + LETTER / per - np.minimum(reach.min(axis=0), 0.0)
        for (name, colour), end in zip(AXES, reach, strict=True):
            self.axis.plot(*np.array([origin, origin + end / 1.35]).T, color=colour, linewidth=1.8)
            write(self.axis, Note(name, origin + end, colour), size=9.0)
        return np.concatenate([corner, origin + np.maximum(reach.max(axis=0), 0.0) + LETTER / per])

    def _write_names(self, poses: Sequence[Pose], per: float, taken: Sequence[Array]) -> None:
        """Write the names that have room.

        Those of points and joints at the first position come first, then those of parts, then those of points and
        joints that have moved at further positions.
        """
        start, notes = [self._at(poses[0].place, name.at) for name in self.names], list[Note]()
        for name, at in zip(self.names, start, strict=True):
            colour = PATH if name.kind == "part" else poses[0].colour if name.at.node else GROUND
            notes.append(Note(name.text, at, colour))
        for pose in poses[1:]:
            for name, before in zip(self.names, start, strict=True):
                at = self._at(pose.place, name.at)
                if name.kind != "part" and np.linalg.norm(at - before) > MOVED * self.seen.framing.size:
                    notes.append(Note(name.text, at, pose.colour))
        strong = {pose.colour for pose in poses} | {GROUND}
        hidden = [np.asarray(line.get_xydata()) for line in self.axis.lines if line.get_color() in strong]
        write_beside(self.axis, notes, hidden, per, taken)


DISTANCES = np.array([5.0, 11.0, 19.0, 28.0, 38.0, 50.0])
"""From a point to the edge of its name [points]."""

BESIDE, CLEAR, DENSE, MOST = 12.0, 1.5, 2.0, 8
"""Distance up to which a name is seen to belong to its point, from farther away a line leads to it; room between two
names, and between a name and a line; distance of the sample points of lines [points]; of these a name may cover."""

TURNS = np.deg2rad([45.0, 135.0, -45.0, -135.0, 90.0, 0.0, -90.0, 180.0])
TOWARDS = np.round(np.stack([np.cos(TURNS), np.sin(TURNS)], axis=1), 15)
"""Directions from a point to its name, the preferred one first, shape (8, 2)."""


def write_beside(
    axis: Axes, notes: Sequence[Note], hidden: Sequence[Array], per: float, taken: Sequence[Array]
) -> None:
    """Write names beside their points, on the page, none over another.

    Those that come first choose first; a name that has no room is left out.

    Args:
        axis: The drawing, with its limits.
        notes: The names.
        hidden: Corners of lines that names should not cover, shape (n, 2) each.
        per: Scale of the drawing [points per unit of the axes].
        taken: Boxes where no name may be (left, bottom, right, top), in units of the axes, shape (4,) each.
    """
    page = per * np.array([*axis.get_xlim(), *axis.get_ylim()])[[0, 2, 1, 3]]
    lines, boxes = _dense([per * corners for corners in hidden]), per * np.array(taken).reshape(-1, 4)
    for note in notes:
        text = write(axis, note)
        box = text.get_window_extent()
        size = np.array([box.width, box.height]) * POINTS / axis.figure.dpi
        offset = _best(per * note.at, size, page, lines, boxes)
        if offset is None:
            text.remove()
            continue
        text.xyann = (float(offset[0]), float(offset[1]))
        middle = per * note.at + offset
        boxes = np.vstack([boxes, [*(middle - size / 2.0), *(middle + size / 2.0)]])
        way = offset - np.clip(offset, -size / 2.0, size / 2.0)
        if np.linalg.norm(way) > BESIDE:
            axis.plot(*np.array([note.at, note.at + way / per]).T, color=PATH, linewidth=0.5)


def _best(point: Array, size: Array, page: Array, lines: Array, boxes: Array) -> Array | None:
    """Return the offset of a name on the page where it covers the fewest points of lines; ``None`` without room.

    Args:
        point: The point that is named [points], shape (2,).
        size: Width and height of the name.
        page: Left, bottom, right, top.
        lines: Sample points of lines, shape (n, 2).
        boxes: Boxes of other names, shape (m, 4).
    """
    offsets = (TOWARDS * DISTANCES[:, None, None] + np.sign(TOWARDS) * size / 2.0).reshape(-1, 2)
    low, high = (point + offsets - size / 2.0)[:, None], (point + offsets + size / 2.0)[:, None]
    on_page = ((low >= page[:2]) & (high <= page[2:])).all(axis=(1, 2))
    over: Flags = ((boxes[:, :2] < high + CLEAR) & (boxes[:, 2:] > low - CLEAR)).all(axis=2).any(axis=1)
    covered = np.count_nonzero(((lines > low - CLEAR) & (lines < high + CLEAR)).all(axis=2), axis=1)
    costs = covered + 0.6 * np.repeat(DISTANCES, len(TURNS)) + 0.02 * np.arange(len(offsets))
    costs[~on_page | over | (covered > MOST)] = np.inf
    return np.asarray(offsets[costs.argmin()]) if np.isfinite(costs).any() else None


def _dense(lines: Sequence[Array]) -> Array:
    """Return points along lines, shape (n, 2) each, close to each other [points]."""
    points = [np.zeros((0, 2))]
    for corners in lines:
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
        places = np.linspace(0.0, along[-1], 1 + int(np.ceil(along[-1] / DENSE)))
        points.append(np.stack([np.interp(places, along, corners[:, k]) for k in (0, 1)], axis=1))
    return np.concatenate(points)


ACROSS, HIGH, HEAD, FOOT = 264.0, 216.0, 30.0, 34.0
"""Size of the panel of a body, height of the heading, and of the scale below [points]."""

LONGEST, ARC, DOT, ROOM = 46.0, 11.0, 3.0, 30.0
"""Length of the largest force, radius of the arc of a moment, size of marks, and room for names on each side of a
panel [points]."""

TINY = 1e-9
"""Size of a force or moment, relative to the largest of all bodies, that is rounding."""

LEAST = 0.05
"""Extent of a body, relative to that of the mechanism, below which it is drawn as if it had this extent."""

KINDS = {"weight": COLOURS[2], "inertia relief": COLOURS[3], "force": COLOURS[1]}
"""First words of a load, and their colours; loads of joints and couplings have the first colour."""

LAW = "inertia relief: −m a and −(I α + ω × I ω), at the centre of mass"
IN_PLANE = "forces in the plane, moments about its normal"
PROJECTED = "arrows are projections, numbers whole sizes"

INSTANTS = 4
"""Instants whose free-body diagrams are drawn without being asked for one by one."""

PARTS = (slice(0, 3), slice(3, 6))
"""Force and moment of a wrench."""


class _Panel(NamedTuple):
    """A body with its loads in the plane of the picture.

    Its outline [m], shape (k, 2) each; where the loads act [m], and their forces [points], shape (n, 2); their names.
    """

    name: str
    actions: Sequence[Action]
    lines: Sequence[Array]
    points: Array
    arrows: Array
    words: Sequence[str]


@in_language
def free_body_diagrams(result: Result, at: float | str | None = None, *, titled: bool = True) -> Picture:
    """Return a panel for every body: all that acts on it at one instant, each force as an arrow, to one scale.

    A planar mechanism is seen along its axes, and moments are arcs; in any other arrows are projections.

    Args:
        result: The run.
        at: Value of its parameter, in SI or with its unit; the first row where it is left out.
        titled: Whether the title of the scenario is above it.

    Raises:
        InputError: The run does not come there.
    """
    row, mechanism = result.row_at(at), result.trajectory.mechanism
    seen = scene(mechanism, result.trajectory.dynamics.forces, result.trajectory.q)
    framing, place = seen.framing, placed(mechanism.model, row.trajectory.q)[0]
    bodies, axes = [*free_bodies(row, framing.normal)], framing.axes
    drawn = np.array([action.wrench for free in bodies if not free.left_out for action in free.actions])
    force, moment = (np.linalg.norm(drawn.reshape(-1, 6)[:, part], axis=1).max(initial=0.0) for part in PARTS)
    flat = np.linalg.norm(drawn.reshape(-1, 6)[:, :3] @ axes.T, axis=1).max(initial=0.0)
    least, per_newton = TINY * np.array([force, max(moment, force * framing.size)]), LONGEST / flat if flat else 0.0
    units = [result.presentation.scale(Series("", unit, np.zeros(1))) for unit in (NEWTON, NEWTON_METRE)]

    def words(action: Action) -> str:
        """Return the name of a load with the sizes of its force and moment; empty where both are rounding."""
        sizes = [float(np.linalg.norm(action.wrench[part])) for part in PARTS]
        measured = zip(sizes, least, units, strict=True)
        parts = [
            f"{rounded(size * factor)} {unit_text(unit)}" for size, none, (factor, unit) in measured if size > none
        ]
        return f"{told(action.what)} {said(', ').join(parts)}" if parts else ""

    panels = []
    for free in bodies:
        own = [] if free.left_out else [action for action in free.actions if words(action)]
        if not (own or free.left_out):
            continue
        turn, origin = place[free.body, :3, :3], place[free.body, :3, 3]
        lines = [(stick.points @ turn.T + origin) @ axes.T for stick in seen.figure.lines if stick.node == free.body]
        points = np.array([action.point for action in own] or [origin]) @ axes.T
        forces = np.array([action.wrench[:3] for action in own] or [np.zeros(3)]) @ axes.T
        name = said("{link}: not determined", link=free.link) if free.left_out else free.link
        panels.append(_Panel(name, own, lines, points, per_newton * forces, [plain(words(action)) for action in own]))
    where = f"{symbol(result.parameter.name)} = {_place(result, float(row.trajectory.grid.t[0]), 5)}"
    title = plain(result.content.title or result.name)
    heading = f"{title}, {where}" if titled else said("Free bodies at {place}", place=where)
    columns = max(1, min(2, len(panels)))
    rows = -(-len(panels) // columns)
    width, height = columns * ACROSS, rows * HIGH + HEAD + FOOT
    with drawing(width / POINTS, height / POINTS, heading) as picture:
        picture.set_layout_engine("none")
        for k, panel in enumerate(panels):
            corner = (k % columns) / columns, (FOOT + HIGH * (rows - 1 - k // columns)) / height
            axis = picture.add_axes((*corner, 1.0 / columns, HIGH / height))
            _panel(axis, panel, framing, float(least[1]))
        foot = picture.add_axes((0.0, 0.0, 1.0, FOOT / height))
        foot.set(xlim=(0.0, width), ylim=(0.0, FOOT))
        foot.set_axis_off()
        if per_newton:
            factor, unit = units[0]
            size = float(f"{0.3 * LONGEST / per_newton * factor:.0e}")
            end = 14.0 + per_newton * size / factor
            _arrow(foot, np.array([14.0, 22.0]), np.array([end, 22.0]), INK)
            foot.text(end + 8.0, 22.0, decimals(f"{size:g} {unit_text(unit)}"), va="center", fontsize=8)
        view = said(PROJECTED if framing.normal is None else IN_PLANE)
        foot.text(14.0, 8.0, f"{view}{said('; ')}{said(LAW)}", va="center", fontsize=6.5, color=GROUND)
    return picture


def worst_instants(result: Result) -> dict[str, float]:
    """Return the instants of the sets of loads that are asked for, by the first set at each; at most ``INSTANTS``."""
    tables = result.section("loads").tables if "loads" in result.numbered else ()
    sets, instants = [table for table in tables if table.name == "sets"], dict[float, str]()
    for name, at, *_ in (row for table in sets for row in table.rows):
        instants.setdefault(float(at), str(name))
    return {name: at for at, name in [*instants.items()][:INSTANTS]}


def _panel(axis: Axes, panel: _Panel, framing: Framing, least: float) -> None:
    """Draw a body with its loads; larger loads choose the places of their names first. Smaller moments have no arc."""
    page, notes, hidden = np.array([ACROSS, HIGH]), list[tuple[float, Note]](), [*panel.lines]
    corners, reach = np.concatenate([*panel.lines, panel.points]), np.abs(panel.arrows).max(axis=0)
    extent = np.maximum(np.ptp(corners, axis=0), LEAST * framing.size)
    per = float(((page - 2.0 * (ROOM + reach)) / extent).min())
    left, bottom = ((corners.min(axis=0) + corners.max(axis=0) - page / per) / 2.0).tolist()
    axis.set(xlim=(left, left + ACROSS / per), ylim=(bottom, bottom + HIGH / per))
    axis.set_axis_off()
    axis.text(0.02, 0.97, label(plain(panel.name)), transform=axis.transAxes, fontsize=8, weight="bold", va="top")
    for line in panel.lines:
        axis.plot(*line.T, color=PATH, linewidth=2.2)
    loads = zip(panel.actions, panel.points, panel.arrows, panel.words, strict=False)
    for action, point, arrow, words in loads:
        colour = next((colour for start, colour in KINDS.items() if action.what.startswith(start)), COLOURS[0])
        tip = point + arrow / per
        axis.plot(*point, "o", color=colour, markersize=DOT, markerfacecolor="white")
        hidden.append(np.array([point, tip]))
        moment = 0.0 if framing.normal is None else float(framing.normal @ action.wrench[3:])
        if abs(moment) > least:
            turn = np.sign(moment) * np.deg2rad(np.linspace(-60.0, 210.0, 28))
            hidden.append(point + ARC / per * np.stack([np.cos(turn), np.sin(turn)], axis=1))
            axis.plot(*hidden[-1].T, color=colour, linewidth=1.1)
            _arrow(axis, hidden[-1][-4], hidden[-1][-1], colour)
        _arrow(axis, point, tip, colour)
        notes.append((float(np.linalg.norm(arrow)), Note(words, tip, colour)))
    write_beside(axis, [note for _, note in sorted(notes, key=lambda sized: -sized[0])], hidden, per, ())


def _arrow(axis: Axes, start: Array, tip: Array, colour: str) -> None:
    look: dict[str, Any] = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.3, "shrinkA": 0.0, "shrinkB": 0.0}
    axis.annotate("", (float(tip[0]), float(tip[1])), (float(start[0]), float(start[1])), arrowprops=look)
