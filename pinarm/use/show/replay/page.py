"""The replay: a moving picture of a result in one HTML file. The same result gives the same bytes."""

from __future__ import annotations

import base64
import gzip
import html
import json
import re
import sys
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pinarm.arrays import Array, Indices, distinct
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.quantities.reactions import Reactions
from pinarm.engine.series import ROUNDING, Series
from pinarm.errors import InputError, as_names, choices
from pinarm.language import decimals, in_language, said, spoken, told
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.joints import frame_of
from pinarm.records import Record, ValueRecord
from pinarm.use.output import write_file
from pinarm.use.show.bodies import BodyPoint, Node, placed, point_of, visuals
from pinarm.use.show.labels import axis_label, name_label, runs, unicode_label, unit_text
from pinarm.use.show.replay.modes import CYCLE, mode_pictures, require_bare
from pinarm.use.show.scene import Scene, names_of, scene

if TYPE_CHECKING:
    from pinarm.use.result.result import Result

FILES = Path(__file__).parent / "page"
SCRIPTS = ("data.js", "motion.js", "names.js", "solids.js", "view.js", "overlays.js", "plots.js", "modes.js", "main.js")
CURVES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#3a87b7")
"""Colours of the plots."""

MARKS = 1.5
"""Length that marks are relative to, relative to that of thicknesses of links; at most the extent."""

VIEW = ("up", "eye", "low", "high", "outline")
"""Fields of the framing that the page uses."""

MOST_ROWS = 2400
"""Rows in the page: forty seconds at sixty pictures a second; of more, evenly spaced ones are taken."""

LEVEL = 6
"""Of compression: 9 takes twice the time for one part in a hundred."""

NAMED = 2
"""Notes that are shown in the page."""

_CODES = {np.dtype(np.float64): "f8", np.dtype(np.float32): "f4", np.dtype(np.uint32): "u4"}

Plain = dict[str, Any]


class Replay(Record, frozen=True):
    """A moving picture of a result, ready to be opened.

    Attributes:
        html: The page.
        notes: Visuals that cannot be drawn, and why.
        run: What it shows, of modes one period.
    """

    unshown = ("html", "run")

    html: str
    notes: tuple[str, ...]
    run: Trajectory

    def save(self, path: str | Path) -> Path:
        """Write the page to a file and return its path; see ``write_file``.

        Raises:
            InputError: The file cannot be written.
        """
        path = Path(path)
        write_file(path, [self.html.encode()])
        return path

    def _repr_html_(self) -> str:
        from pinarm.use.show.text import frame

        return frame(self.html, height=560)


class Packing:
    """Arrays of the page: one run of bytes, and references into it, ``[type, first byte, number of values]``."""

    def __init__(self) -> None:
        self.raw = bytearray()

    def add(self, array: NDArray[Any]) -> list[str | int]:
        """Return the reference of an array of doubles, floats or unsigned integers, row by row."""
        raw = array.astype(array.dtype.newbyteorder("<")).tobytes()
        reference: list[str | int] = [_CODES[array.dtype], len(self.raw), array.size]
        self.raw += raw + b"\0" * (-len(raw) % 8)  # typed arrays of the page begin at multiples of their size
        return reference


@in_language
def replay_page(
    result: Result,
    *,
    traces: Sequence[str] = (),
    arrows: Sequence[str] = (),
    plots: Sequence[str] | None = None,
    named: bool = False,
) -> Replay:
    """Return the moving picture of a result.

    Args:
        result: The result.
        traces: Links whose origins leave a path; ``com`` for the centre of mass.
        arrows: Of ``forces``, ``torques``, ``reactions``, or ``all``.
        plots: Quantities beside the picture; the outputs of the scenario where it is ``None``.
        named: Whether names of parts, points and joints are shown from the start; the key N shows and hides them.

    Raises:
        InputError: A name is unknown, or the run has no such quantities.
    """
    modes = None
    if "shapes" in result.arrays:
        require_bare(traces, arrows, plots)
        modes, plots = mode_pictures(result), ()
    names = list(dict.fromkeys(result.content.outputs if plots is None else as_names(plots)))
    curves = list(_with_bounds(result.quantities, names))
    rows = rows_shown(result.trajectory, [series.values for series in curves])
    run = result.trajectory.some(rows) if len(rows) < len(result) else result.trajectory
    run = modes.run if modes else run
    packing = Packing()
    content, notes = _content(result, run, as_names(traces), as_names(arrows), packing)
    plotted = [_curve(series, result, rows, CURVES[k % len(CURVES)], packing) for k, series in enumerate(curves)]
    content |= {"named": named, "plots": plotted, "parameter": _parameter(result, run)}
    if modes:
        phase = {"name": said("phase"), "unit": "°", "scale": np.pi / 180.0, "time": False, "discrete": False}
        content |= {"modes": modes.plain, "rows": packing.add(modes.phases), "parameter": {**phase, "seconds": CYCLE}}
        notes = (*modes.notes, *notes)
    skipped = [said("{shown} of {count} rows", shown=len(rows), count=len(result))] if len(rows) < len(result) else []
    more = [said("and {count} more", count=len(notes) - NAMED)] if len(notes) > NAMED else []
    content |= {"notes": [*skipped, *map(told, notes[:NAMED]), *more], "mark": decimals("0.0")[1]}
    content |= {"words": {"grid": said("grid"), "amplitude": said("amplitude")}}
    parts = {
        "title": html.escape(result.content.title or result.name),
        "subtitle": html.escape(f"{run.mechanism.title} · {told(result.kind)}"),
        "lang": spoken(),
        "scene": _inline(content),
        "arrays": _compressed(bytes(packing.raw)),
        "viewer": _compressed(_viewer()),
        "style": _text("page.css"),
        "script": "\n".join(map(_text, SCRIPTS)),
    }
    layout = re.sub(r"\[\[(.*?)\]\]", lambda text: html.escape(told(text[1])), _text("page.html"))
    pieces = re.split(r"\{\{(\w+)\}\}", layout)
    page = "".join(parts[piece] if k % 2 else piece for k, piece in enumerate(pieces))
    return Replay(page, notes, modes.period if modes else result.trajectory)


def rows_shown(run: Trajectory, extremes: list[Array]) -> Indices:
    """Return the rows that the page gets: all, or evenly spaced ones with all jumps and extremes.

    Args:
        run: The trajectory.
        extremes: Arrays whose smallest and largest value must be among them, each of shape (n,).
    """
    n = len(run)
    if n <= MOST_ROWS:
        return np.arange(n)
    ends = np.array(run.grid.rows)
    ends = np.concatenate([ends[:-1], ends[1:] - 1])
    peaks = [int(index) for values in extremes for index in (values.argmin(), values.argmax())]
    even = np.linspace(0, n - 1, MOST_ROWS).round().astype(np.intp)
    return distinct(np.concatenate([even, ends[(ends >= 0) & (ends < n)], np.array(peaks, np.intp)]))


def _content(
    result: Result, run: Trajectory, traces: Sequence[str], kinds: Sequence[str], packing: Packing
) -> tuple[Plain, tuple[str, ...]]:
    """Return the content of the page without plots, for JSON, and notes on visuals that cannot be drawn."""
    mechanism, drawn = run.mechanism, visuals(run.mechanism)
    paths = [traced(mechanism.model, name) for name in traces]
    further = [point for path in paths for point, _ in path]
    masses = [[{**point.plain(), "mass": mass} for point, mass in path] for path in paths]
    words = [said("centre of mass") if name == "com" else said("path of {name}", name=name) for name in traces]
    shown = scene(mechanism, run.dynamics.forces, run.q, drawn, further)
    acting, joined = arrows_of(run, shown.nodes, kinds), shown.figure.joined
    largest: dict[tuple[str, bool], float] = {}
    for arrow in acting:
        key = arrow.of, arrow.moment
        largest[key] = max(largest.get(key, 0.0), arrow.largest)
    marks = (
        [{"loop": True, "text": said("loop joint")}] if any(pair.kind in ("loop", "slot") for pair in joined) else []
    )
    names = names_of(mechanism, shown, result.presentation)
    content = {
        "rows": packing.add(run.grid.t),
        **_bodies(shown, packing),
        "names": [{"runs": runs(name.text), "kind": name.kind, **name.at.plain()} for name in names],
        "traces": [points[0] if len(points) == 1 else {"masses": points} for points in masses],
        "slots": [{"node": slot.node, "points": slot.points.tolist()} for slot in shown.slots],
        "pairs": [pair.plain(shown.places) for pair in joined],
        "arrows": [_arrow(arrow, largest[arrow.of, arrow.moment], packing) for arrow in acting],
        "legend": [{"trace": k, "text": text} for k, text in enumerate(words)] + [*_families(acting, largest), *marks],
    }
    return content, drawn.notes


def _bodies(shown: Scene, packing: Packing) -> Plain:
    """Return bodies, solids and view; a mesh that is drawn several times is there once."""
    seen = shown.framing
    meshes = list(dict.fromkeys(shape.mesh for shape in shown.shapes if shape.mesh is not None))
    places = {id(mesh): k for k, mesh in enumerate(meshes)}
    nodes, shapes = list[Plain](), list[Plain]()
    for node in shown.nodes:
        values = {"values": packing.add(node.values)} if node.kind != "fixed" else {}
        place = {"parent": node.parent, "place": _place(node.placement)}
        nodes.append({**place, "kind": node.kind, "axis": node.axis.tolist(), **values})
    for shape in shown.shapes:
        mesh = {"mesh": places[id(shape.mesh)]} if shape.mesh is not None else {}
        look = {"kind": shape.kind, "size": list(shape.size), "colour": list(shape.colour)}
        shapes.append({"node": shape.node, "place": _place(shape.placement), **look, **mesh})
    return {
        "nodes": nodes,
        "shapes": shapes,
        "meshes": [
            [packing.add(x) for x in (mesh.vertices.astype("f4"), mesh.triangles.astype("u4"))] for mesh in meshes
        ],
        "view": {
            **{name: getattr(seen, name).tolist() for name in VIEW},
            "detail": min(seen.size, MARKS * shown.figure.size),
        },
    }


def _place(placement: pin.SE3) -> list[float]:
    return [float(x) for x in pin.SE3ToXYZQUAT(placement)]


def _arrow(arrow: Arrow, largest: float, packing: Packing) -> Plain:
    """Return an arrow; ``largest`` is the magnitude of the longest one of its kind."""
    vectors = packing.add(arrow.vectors.astype(np.float32))
    return {"of": arrow.of, "moment": arrow.moment, "largest": largest, "vectors": vectors, **arrow.at.plain()}


def _families(acting: Sequence[Arrow], largest: dict[tuple[str, bool], float]) -> Iterator[Plain]:
    """Yield the legend of the arrows: colours, and the value of the longest arrow of each kind."""
    for (kind, moment), size in largest.items():
        partial = any(arrow.partial for arrow in acting if arrow.of == kind)
        name = said(ARROWS[kind]) + (said(" (components that rigid bodies determine)") if partial else "")
        number = decimals(f"{float(f'{size:.4g}'):g}")
        scale = said("full arc {number} N·m" if moment else "longest arrow {number} N", number=number)
        yield {"arrow": kind, "text": f"{name}{said(': ')}{scale}"}


def _parameter(result: Result, run: Trajectory) -> Plain:
    measured = result.presentation.unit(result.parameter)
    name, scale = name_label(run.parameter, result.presentation), measured.factor if measured else 1.0
    kind = {"time": run.parameter == "t", "discrete": run.numbered}
    return {"name": unicode_label(name), "unit": unit_text(measured), "scale": scale, **kind}


def _with_bounds(quantities: Quantities, names: Sequence[str]) -> Iterator[Series]:
    """Yield quantities, each followed by its bounds where it depends on how frictions at rest share a load.

    Ends of bands that are infinite are left out.
    """
    for name in names:
        bounds = quantities.bounds(name) if quantities.open_rows(name).any() else ()
        for series in (quantities[name], *bounds):
            if not (series.unbounded and np.isinf(series.values).any()):
                yield series


def _curve(series: Series, result: Result, rows: Indices, colour: str, packing: Packing) -> Plain:
    drawn = result.presentation.shown(series.without_rounding())
    values: Array = drawn.values[rows]
    if not np.isfinite(values).all():
        raise InputError(f"{series.name} is not finite everywhere, and cannot be plotted")
    label = axis_label(series.name, drawn.unit, result.presentation, sys.maxsize)
    texts = {"label": unicode_label(label), "runs": runs(label), "unit": unit_text(drawn.unit)}
    return {**texts, "colour": colour, "values": packing.add(values)}


def _inline(data: Plain) -> str:
    """Return JSON for HTML: nothing in it ends the element or begins another."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _compressed(raw: bytes) -> str:
    """Return bytes as base64 of gzip; the same bytes give the same text."""
    return base64.b64encode(gzip.compress(raw, LEVEL, mtime=0)).decode("ascii")


def _text(name: str) -> str:
    return (FILES / name).read_text(encoding="utf-8")


def _viewer() -> bytes:
    """Return meshcat's viewer script, without importing meshcat, which would start servers.

    Raises:
        InputError: meshcat is not installed, or another version that has no such script.
    """
    package = find_spec("meshcat")
    for folder in package.submodule_search_locations or () if package else ():
        script = Path(folder) / "viewer" / "dist" / "main.min.js"
        if script.is_file():
            return script.read_bytes()
    raise InputError("meshcat's viewer script is not there", hint="pip install 'meshcat>=0.3.2'")


ARROWS = {
    "forces": "weights and loads",
    "torques": "efforts of drives and end stops",
    "reactions": "reactions of the joints",
}
"""Kinds of arrows, and their names in the legend. Their colours are in ``overlays.js``."""


class Arrow(ValueRecord, frozen=True):
    """A force or a moment at a point, over the rows.

    Attributes:
        of: Its kind, one of ``ARROWS``.
        at: Where it acts.
        moment: Whether it is a moment: an arc, not an arrow.
        vectors: In world axes [N or N*m], shape (n, 3).
        partial: Whether components are left out that rigid bodies do not determine.
    """

    of: str
    at: BodyPoint
    moment: bool
    vectors: Array
    partial: bool = False

    @property
    def largest(self) -> float:
        """Its largest magnitude [N or N*m]."""
        return float(np.linalg.norm(self.vectors, axis=-1).max())


def traced(model: pin.Model, name: str) -> list[tuple[BodyPoint, float]]:
    """Return the points, with their weights, whose mean is traced: the origin of a link, or all masses for ``com``.

    Raises:
        InputError: There is no such link, or no mass.
    """
    if name != "com":
        return [(point_of(model, frame_of(model, name)), 1.0)]
    if not (centres := _centres(model)):
        raise InputError("the mechanism has no mass, and so no centre of mass")
    return centres


def _centres(model: pin.Model) -> list[tuple[BodyPoint, float]]:
    bodies = [(node, inertia) for node, inertia in enumerate(model.inertias) if node and inertia.mass > 0.0]
    return [(BodyPoint(node, np.array(inertia.lever)), float(inertia.mass)) for node, inertia in bodies]


def arrows_of(run: Trajectory, nodes: Sequence[Node], kinds: Sequence[str]) -> list[Arrow]:
    """Return the arrows of the wanted kinds.

    Args:
        run: The motion, of which every row is drawn.
        nodes: Its bodies.
        kinds: Of ``ARROWS``, or ``all``.

    Raises:
        InputError: There is no such kind, or the run has no forces.
    """
    wanted = dict.fromkeys(kind for name in kinds for kind in (ARROWS if name == "all" else [name]))
    for kind in wanted:
        if kind not in ARROWS:
            expected, hint = choices(kind, [*ARROWS, "all"])
            raise InputError(f"there are no arrows of '{kind}'", expected=expected, hint=hint)
    if wanted and run.no_efforts:
        raise InputError(f"arrows of {', '.join(wanted)}: {run.no_efforts}", hint="kind: inverse")
    places = placed(run.mechanism.model, run.q, len(run)) if wanted else np.zeros(0)
    makers = {"forces": _forces, "torques": _torques, "reactions": _reactions}
    drawn = [arrow for kind in wanted for arrow in makers[kind](run, nodes, places)]
    least = ROUNDING * Reactions(run).size() if "reactions" in wanted else 0.0  # as of a body in free flight
    return [arrow for arrow in drawn if arrow.largest > (least if arrow.of == "reactions" else 0.0)]


def _forces(run: Trajectory, nodes: Sequence[Node], places: Array) -> Iterator[Arrow]:
    """Yield the weights, and the forces and moments of loads and springs at their points.

    Of an element that meets a body at several points, as a cable on a pulley, none is drawn there.
    """
    model = run.mechanism.model
    for centre, mass in _centres(model):
        yield Arrow("forces", centre, False, np.tile(mass * np.asarray(model.gravity.linear), (len(run), 1)))
    for name, force in run.dynamics.forces.items():
        points = [point_of(model, frame) for frame in force.points]
        for at in points:
            if sum(other.node == at.node for other in points) == 1:
                wrench = _wrench(run, name, at.node)
                yield Arrow("forces", at, False, wrench[:, :3])
                moments = wrench[:, 3:] - np.cross(at.path(places), wrench[:, :3])
                if np.abs(moments).max() > 1e-9 * np.abs(wrench).max():  # less is rounding of the shift to the point
                    yield Arrow("forces", at, True, moments)


def _wrench(run: Trajectory, name: str, joint: int) -> Array:
    """Return the wrench of a force element on a body, about the world's origin, shape (n, 6)."""
    rows, links = np.zeros((len(run), 6)), LinkPlacements.at(run.mechanism.model, run.q)
    for part, dynamics in run.intervals():
        here = links.some(np.arange(part.start, part.stop))
        acting = dynamics.forces[name].wrenches(here, run.grid.t[part], run.v[part])
        rows[part] = acting.get(joint, np.zeros(6))
    return rows


def _torques(run: Trajectory, nodes: Sequence[Node], places: Array) -> Iterator[Arrow]:
    for joint in run.mechanism.joints.values():
        node, at = nodes[joint.index], BodyPoint(joint.index, np.zeros(3))
        axis = places[:, joint.index, :3, :3] @ node.axis
        yield Arrow("torques", at, node.kind == "turn", run.supplied[:, joint.v, None] * axis)


def _reactions(run: Trajectory, nodes: Sequence[Node], places: Array) -> Iterator[Arrow]:
    """Yield the forces of the parents on the children at the joints, as far as rigid bodies determine them."""
    reactions, model, others = Reactions(run), run.mechanism.model, [Reactions(other) for other in run.others]
    size = np.abs(reactions.joints[:, 1:, :3]).max(initial=0.0) or 1.0
    for joint in range(1, model.njoints):
        added = [stressed[:, :3] for stressed in reactions.stressed_joint(joint)]
        added += [(other.joints - reactions.joints)[:, joint, :3] / size for other in others]
        yield _reaction(BodyPoint(joint, np.zeros(3)), reactions.joints[:, joint, :3], added)
    for name, loop in reactions.loops.items():
        added = [stressed[:, :3] for stressed in reactions.stressed_loop(name)]
        added += [(other.loop(name) - reactions.loop(name))[:, :3] / size for other in others]
        yield _reaction(point_of(model, loop.second), reactions.loop(name)[:, :3], added)
    for name, cable in reactions.cables.items():
        (lam, stresses), ends = reactions.multiplier(name), [point_of(model, frame) for frame in cable.path.frames]
        parts = [after.path(places) - before.path(places) for before, after in pairwise(ends)]
        ways = [np.zeros((len(run), 3)), *(part / np.linalg.norm(part, axis=1)[:, None] for part in parts)]
        for end, (before, after) in zip(ends, pairwise([*ways, ways[0]]), strict=True):
            pull = after - before  # of a tension of 1 N along both parts
            yield _reaction(end, -lam[:, None] * pull, [stress[:, None] * pull for stress in stresses])


def _reaction(at: BodyPoint, forces: Array, added: Sequence[Array]) -> Arrow:
    """Return a reaction without the directions in which self-stresses, or other shares of frictions, can add to it.

    In planar loops of revolute joints, for example, the forces in the plane are determined, those across it are not.

    Args:
        at: Where it acts.
        forces: One choice of the reaction [N], shape (n, 3).
        added: Change of it by each self-stress of length 1, or by other static frictions, relative to the largest
            force, each of shape (n, 3).
    """
    _, sizes, axes = np.linalg.svd(np.concatenate([np.zeros((3, 3)), *added]), full_matrices=False)
    free = axes[sizes > ACTS]
    left = forces - forces @ free.T @ free if len(free) < 3 else np.zeros_like(forces)
    return Arrow("reactions", at, False, left, partial=len(free) > 0)
