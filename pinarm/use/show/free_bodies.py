"""Free-body diagrams: every body by itself, with an arrow to scale for each load, weight and inertia among them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.quantities.family import NEWTON, NEWTON_METRE
from pinarm.engine.series import Series
from pinarm.language import decimals, in_language, said, told
from pinarm.records import Record
from pinarm.use.assessments.loads import Action, free_bodies
from pinarm.use.result.presentation import Presentation
from pinarm.use.show.bodies import placed
from pinarm.use.show.labels import plain, shown, symbol, unit_text
from pinarm.use.show.notebook import rounded
from pinarm.use.show.picture import COLOURS, INK, Note, Picture, drawing, label
from pinarm.use.show.scene import Framing, scene
from pinarm.use.show.sketch import GROUND, PATH, POINTS, round_up, write_beside

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pinarm.use.result.result import Result

WIDE, HIGH, HEAD, FOOT = 264.0, 216.0, 30.0, 34.0
"""Size of the panel of a body, height of the heading, and of the scale below [points]."""

LONGEST, ARC, DOT = 46.0, 11.0, 3.0
"""Length of the largest force, radius of the arc of a moment, and size of marks [points]."""

ROOM = np.array([30.0, 30.0])
"""Room for names on each side of a panel: across, and up [points]."""

TINY = 1e-9
"""Size of a force or moment, relative to the largest of all bodies, that is rounding."""

LEAST = 0.05
"""Extent of a body, relative to that of the mechanism, below which it is drawn as if it had this extent."""

KINDS = {"weight": COLOURS[2], "inertia relief": COLOURS[3], "force": COLOURS[1]}
"""First words of a load, and their colours; loads of joints and couplings have the first colour."""

LAW = "inertia relief: −m a and −(I α + ω × I ω), at the centre of mass"
IN_PLANE = "forces in the plane, moments about its normal"
PROJECTED = "arrows are projections, numbers whole sizes"


class _Scale(Record, frozen=True):
    """Sizes of all bodies, and how they are shown.

    Attributes:
        force: The largest force [N].
        moment: The largest moment [N*m], or that of this force over the extent of the mechanism.
        per_newton: Length of an arrow [points per N].
        units: Of forces and of moments: factor, and name.
    """

    force: float
    moment: float
    per_newton: float
    units: Sequence[tuple[float, str]]

    def words(self, action: Action) -> str:
        """Return the name of a load with the sizes of its force and moment; empty where both are rounding."""
        sizes = [float(np.linalg.norm(action.wrench[part])) for part in PARTS]
        measured = zip(sizes, (self.force, self.moment), self.units, strict=True)
        parts = [f"{rounded(size * factor)} {unit}" for size, most, (factor, unit) in measured if size > TINY * most]
        return f"{told(action.what)} {said(', ').join(parts)}" if parts else ""


class _Panel(NamedTuple):
    """A body with its loads in the plane of the picture.

    Its outline [m], shape (k, 2) each; where the loads act [m], and their forces [points], shape (n, 2).
    """

    name: str
    actions: Sequence[Action]
    lines: Sequence[Array]
    points: Array
    arrows: Array

    def ends(self, per: float) -> Array:
        """Return the corners of the outline and the tips of the arrows at a scale [points per metre], shape (k, 2)."""
        corners = per * np.concatenate([*self.lines, self.points])
        return np.concatenate([corners, per * self.points + self.arrows])


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
    axes, place = seen.framing.axes, placed(mechanism.model, row.trajectory.q)[0]
    bodies = [*free_bodies(row, seen.framing.normal)]
    drawn = [action for free in bodies if not free.left_out for action in free.actions]
    scale, panels = _scale(drawn, axes, result.presentation, seen.framing.size), []
    for free in bodies:
        own = [] if free.left_out else [action for action in free.actions if scale.words(action)]
        if not (own or free.left_out):
            continue
        turn, origin = place[free.body, :3, :3], place[free.body, :3, 3]
        lines = [(stick.points @ turn.T + origin) @ axes.T for stick in seen.figure.lines if stick.node == free.body]
        points = np.array([action.point for action in own] or [origin]) @ axes.T
        forces = np.array([action.wrench[:3] for action in own] or [np.zeros(3)]) @ axes.T
        name = said("{link}: not determined", link=free.link) if free.left_out else free.link
        panels.append(_Panel(name, own, lines, points, scale.per_newton * forces))
    return _drawn(panels, scale, _heading(result, float(row.trajectory.grid.t[0]), titled), seen.framing)


def _scale(shown: Sequence[Action], axes: Array, how: Presentation, extent: float) -> _Scale:
    force, moment, flat = (
        max((float(np.linalg.norm(turn @ each.wrench[part])) for each in shown), default=0.0)
        for part, turn in ((PARTS[0], np.eye(3)), (PARTS[1], np.eye(3)), (PARTS[0], axes))
    )
    measured = [how.scale(Series("", unit, np.zeros(1))) for unit in (NEWTON, NEWTON_METRE)]
    units = [(factor, unit_text(unit)) for factor, unit in measured]
    return _Scale(force, max(moment, force * extent), LONGEST / flat if flat else 0.0, units)


def worst_instants(result: Result) -> dict[str, float]:
    """Return the instants of the sets of loads that are asked for, by the first set at each; at most ``MOST``."""
    tables = result.section("loads").tables if "loads" in result.numbered else ()
    sets, instants = [table for table in tables if table.name == "sets"], dict[float, str]()
    for name, at, *_ in (row for table in sets for row in table.rows):
        instants.setdefault(float(at), str(name))
    return {name: at for at, name in [*instants.items()][:MOST]}


MOST = 4
"""Instants whose free-body diagrams are drawn without being asked for one by one."""

PARTS = (slice(0, 3), slice(3, 6))
"""Force and moment of a wrench."""


def _heading(result: Result, t: float, titled: bool) -> str:
    factor, unit = shown(result.parameter, result.presentation)
    mark = {"1": "", "°": "°"}.get(str(unit or "1"), f" {unit}")
    place = f"{symbol(result.parameter.name)} = {plain(decimals(f'{t / factor:.5g}{mark}'))}"
    title = plain(result.content.title or result.name)
    return f"{title}, {place}" if titled else said("Free bodies at {place}", place=place)


def _drawn(panels: Sequence[_Panel], scale: _Scale, heading: str, framing: Framing) -> Picture:
    columns = max(1, min(2, len(panels)))
    rows = -(-len(panels) // columns)
    width, height = columns * WIDE, rows * HIGH + HEAD + FOOT
    with drawing(width / POINTS, height / POINTS, heading) as picture:
        picture.set_layout_engine("none")
        for k, panel in enumerate(panels):
            corner = (k % columns) / columns, (FOOT + HIGH * (rows - 1 - k // columns)) / height
            axis = picture.add_axes((*corner, 1.0 / columns, HIGH / height))
            _panel(axis, panel, scale, framing)
        foot = picture.add_axes((0.0, 0.0, 1.0, FOOT / height))
        foot.set(xlim=(0.0, width), ylim=(0.0, FOOT))
        foot.set_axis_off()
        if scale.per_newton:
            factor, unit = scale.units[0]
            size = round_up(0.3 * LONGEST / scale.per_newton * factor)
            length = scale.per_newton * size / factor
            _arrow(foot, np.array([14.0, 22.0]), np.array([14.0 + length, 22.0]), INK)
            foot.text(22.0 + length, 22.0, decimals(f"{size:g} {unit}"), va="center", fontsize=8)
        words = said(PROJECTED if framing.normal is None else IN_PLANE)
        foot.text(14.0, 8.0, f"{words}{said('; ')}{said(LAW)}", va="center", fontsize=6.5, color=GROUND)
    return picture


def _panel(axis: Axes, panel: _Panel, scale: _Scale, framing: Framing) -> None:
    """Draw a body with its loads; larger loads choose the places of their names first."""
    largest = float(np.ptp(np.concatenate([*panel.lines, panel.points]), axis=0).max())
    scales = np.geomspace(WIDE, 1.0, 120) / max(largest, LEAST * framing.size)
    room = np.array([WIDE, HIGH]) - 2.0 * ROOM
    fitting = (per for per in scales.tolist() if (np.ptp(panel.ends(per), axis=0) <= room).all())
    per, hidden, notes = next(fitting, float(scales[-1])), [*panel.lines], []
    ends = panel.ends(per)
    left, bottom = ((ends.min(axis=0) + ends.max(axis=0) - np.array([WIDE, HIGH])) / 2.0 / per).tolist()
    axis.set(xlim=(left, left + WIDE / per), ylim=(bottom, bottom + HIGH / per))
    axis.set_axis_off()
    axis.text(0.02, 0.97, label(plain(panel.name)), transform=axis.transAxes, fontsize=8, weight="bold", va="top")
    for line in panel.lines:
        axis.plot(*line.T, color=PATH, linewidth=2.2)
    for action, point, arrow in zip(panel.actions, panel.points, panel.arrows, strict=False):
        colour = next((colour for words, colour in KINDS.items() if action.what.startswith(words)), COLOURS[0])
        tip = point + arrow / per
        axis.plot(*point, "o", color=colour, markersize=DOT, markerfacecolor="white")
        hidden += [np.array([point, tip]), *_moment(axis, action, point, per, scale, framing.normal, colour)]
        _arrow(axis, point, tip, colour)
        notes.append((float(np.linalg.norm(arrow)), Note(plain(scale.words(action)), tip, colour)))
    write_beside(axis, [note for _, note in sorted(notes, key=lambda sized: -sized[0])], hidden, per, ())


def _moment(
    axis: Axes, action: Action, point: Array, per: float, scale: _Scale, normal: Array | None, colour: str
) -> list[Array]:
    """Draw the moment of a load in a plane as an arc, by its sign, and return its points; none where it is rounding."""
    moment = 0.0 if normal is None else float(normal @ action.wrench[3:])
    if abs(moment) <= TINY * scale.moment:
        return []
    turn = np.sign(moment) * np.deg2rad(np.linspace(-60.0, 210.0, 28))
    arc = point + ARC / per * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    axis.plot(*arc.T, color=colour, linewidth=1.1)
    _arrow(axis, arc[-4], arc[-1], colour)
    return [arc]


def _arrow(axis: Axes, start: Array, tip: Array, colour: str) -> None:
    look: dict[str, Any] = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.3, "shrinkA": 0.0, "shrinkB": 0.0}
    axis.annotate("", (float(tip[0]), float(tip[1])), (float(start[0]), float(start[1])), arrowprops=look)
