"""The page: everything of a replay in one HTML file. The same result gives the same bytes."""

from __future__ import annotations

import html
import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array, Indices
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import InputError, as_names
from pinarm.use.output.folder import write_file
from pinarm.use.show.labels import axis_label, name_label, runs, unicode_label, unit_text
from pinarm.use.show.replay import overlays
from pinarm.use.show.replay.framing import Framing, framing
from pinarm.use.show.replay.meshes import thinned
from pinarm.use.show.replay.modes import CYCLE, mode_pictures, require_bare
from pinarm.use.show.replay.names import gathered, names_of
from pinarm.use.show.replay.packing import Packing, compressed
from pinarm.use.show.replay.shapes import Shape, visuals
from pinarm.use.show.replay.sticks import sticks
from pinarm.use.show.replay.tracks import Node, nodes_of, placed, rows_shown
from pinarm.use.show.stick_figure import slots, stick_figure

if TYPE_CHECKING:
    from pinarm.input.units import Unit
    from pinarm.use.result.presentation import Presentation
    from pinarm.use.result.result import Result

FILES = Path(__file__).parent / "page"
SCRIPTS = ("data.js", "motion.js", "names.js", "solids.js", "view.js", "overlays.js", "plots.js", "modes.js", "main.js")
CURVES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#3a87b7")
LINKS = 6.0
"""Typical links along the extent of a mechanism; one of more has smaller marks."""

VIEW = ("up", "eye", "low", "high", "outline")
"""Fields of the framing that the page uses."""

Plain = dict[str, Any]


@dataclass(frozen=True)
class Replay:
    """A moving picture of a result, ready to be opened.

    Attributes:
        html: The page.
        notes: Visuals that cannot be drawn, and why.
        run: What it shows, of modes one period.
    """

    html: str = field(repr=False)
    notes: tuple[str, ...]
    run: Trajectory = field(repr=False)

    def save(self, path: str | Path) -> Path:
        """Write the page to a file and return its path; see ``write_file``.

        Raises:
            InputError: The file cannot be written.
        """
        path = Path(path)
        write_file(path, [self.html.encode()])
        return path

    def _repr_html_(self) -> str:
        """Return the page in a frame, for notebooks; saved ones keep it."""
        from pinarm.use.show.notebook import frame

        return frame(self.html, height=560)


def replay_page(
    result: Result, *, traces: Sequence[str] = (), arrows: Sequence[str] = (), plots: Sequence[str] | None = None,
    named: bool = False,
) -> Replay:  # fmt: skip
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
    scene, notes = _scene(run, as_names(traces), as_names(arrows), packing)
    scene |= {"names": _names(run, result.presentation), "named": named}
    scene["plots"] = [_curve(series, result.presentation, rows, CURVES[k % len(CURVES)], packing)
                      for k, series in enumerate(curves)]  # fmt: skip
    scene["parameter"] = _parameter(run, result.presentation.unit(result.parameter), result.presentation)
    if modes:
        phase = {"name": "phase", "unit": "°", "scale": np.pi / 180.0, "time": False, "discrete": False}
        scene |= {"modes": modes.plain(), "rows": packing.add(modes.phases), "parameter": {**phase, "seconds": CYCLE}}
        notes = (*modes.notes, *notes)
    skipped = f"{len(rows)} of {len(result)} rows" if len(rows) < len(result) else ""
    more = [f"and {len(notes) - 2} more"] if len(notes) > 2 else []
    scene["notes"] = [text for text in (skipped, *notes[:2], *more) if text]
    title = result.content.title or result.name
    parts = {
        "title": html.escape(title), "subtitle": html.escape(f"{run.mechanism.title} · {result.kind}"),
        "scene": _inline(scene), "arrays": packing.text(), "viewer": compressed(_viewer()),
        "style": _text("page.css"), "script": "\n".join(_text(name) for name in SCRIPTS),
    }  # fmt: skip
    pieces = re.split(r"\{\{(\w+)\}\}", _text("page.html"))
    page = "".join(parts[piece] if k % 2 else piece for k, piece in enumerate(pieces))
    return Replay(page, notes, modes.period if modes else result.trajectory)


def _scene(
    run: Trajectory, traces: Sequence[str], kinds: Sequence[str], packing: Packing
) -> tuple[Plain, tuple[str, ...]]:
    """Return the scene without plots, for JSON, and notes on visuals that cannot be drawn."""
    model = run.mechanism.model
    nodes, places = nodes_of(model, run.q), placed(model, run.q)
    drawn, joined = visuals(run.mechanism), overlays.pairs(run.mechanism, run.dynamics.forces)
    shapes = [*drawn.shapes, *sticks(model, nodes, stick_figure(run.mechanism, nodes, joined), drawn.bare)]
    paths, acting = [overlays.traced(model, name) for name in traces], overlays.arrows(run, nodes, kinds)
    marks = [end for pair in joined for end in pair.ends] + [point for path in paths for point, _ in path]
    seen = framing(model, nodes, shapes, places, [mark.path(places) for mark in marks])
    largest: dict[tuple[str, bool], float] = {}
    for arrow in acting:
        key = arrow.of, arrow.moment
        largest[key] = max(largest.get(key, 0.0), arrow.largest)
    scene = {
        "nodes": [_node(node, packing) for node in nodes],
        "rows": packing.add(run.grid.t),
        **_solids(shapes, seen, packing),
        "traces": [_trace(path) for path in paths],
        "slots": [{"node": slot.node, "points": slot.points.tolist()} for slot in slots(run.mechanism, seen, places)],
        "pairs": [pair.plain(places) for pair in joined],
        "arrows": [arrow.plain(packing, largest[arrow.of, arrow.moment]) for arrow in acting],
        "view": {**{name: getattr(seen, name).tolist() for name in VIEW}, "detail": _detail(nodes, seen)},
        "legend": [*_paths(traces), *_families(acting, largest), *_marks(joined)],
    }
    return scene, drawn.notes


def _names(run: Trajectory, how: Presentation) -> list[Plain]:
    """Return the names of parts, points and joints, points and joints first: they keep their places."""
    model = run.mechanism.model
    nodes, places = nodes_of(model, run.q), placed(model, run.q)
    size = float(np.ptp(places[:, :, :3, 3], axis=(0, 1)).max()) or 1.0
    shown = gathered(names_of(run.mechanism, nodes, how), places, size)
    return [{"runs": runs(name.text), "kind": name.kind, **name.at.plain()}
            for name in sorted(shown, key=lambda name: name.kind == "part")]  # fmt: skip


def _node(node: Node, packing: Packing) -> Plain:
    plain = {"parent": node.parent, "place": _place(node.placement), "kind": node.kind, "axis": node.axis.tolist()}
    return {**plain, "values": packing.add(node.values)} if node.kind != "fixed" else plain


def _place(placement: pin.SE3) -> list[float]:
    return [float(x) for x in pin.SE3ToXYZQUAT(placement)]


def _solids(shapes: Sequence[Shape], seen: Framing, packing: Packing) -> Plain:
    """Return shapes and meshes; a mesh that is drawn several times is there once."""
    meshes = list(dict.fromkeys(shape.mesh for shape in shapes if shape.mesh is not None))
    places = {id(mesh): k for k, mesh in enumerate(meshes)}
    plain = [
        {"node": shape.node, "place": _place(shape.placement), "kind": shape.kind, "size": list(shape.size),
         "colour": list(shape.colour), **({"mesh": places[id(shape.mesh)]} if shape.mesh is not None else {})}
        for shape in shapes
    ]  # fmt: skip
    return {"shapes": plain, "meshes": [mesh.pack(packing) for mesh in thinned(meshes, seen.size)]}


def _detail(nodes: Sequence[Node], seen: Framing) -> float:
    """Return the length [m] that marks are relative to: the extent, or less with many small links."""
    links = [length for node in nodes if (length := float(np.linalg.norm(node.placement.translation))) > 0.0]
    return min(seen.size, LINKS * float(np.median(links))) if links else seen.size


def _trace(path: Sequence[tuple[overlays.BodyPoint, float]]) -> Plain:
    if len(path) == 1:
        return path[0][0].plain()
    return {"masses": [{**point.plain(), "mass": mass} for point, mass in path]}


def _paths(traces: Sequence[str]) -> list[Plain]:
    """Return the legend of the paths."""
    return [
        {"trace": k, "text": "centre of mass" if name == "com" else f"path of {name}"} for k, name in enumerate(traces)
    ]


def _families(acting: Sequence[overlays.Arrow], largest: Mapping[tuple[str, bool], float]) -> list[Plain]:
    """Return the legend of the arrows: colours, and the value of the longest arrow of each kind."""
    legend: list[Plain] = []
    for (kind, moment), size in largest.items():
        partial = any(arrow.partial for arrow in acting if arrow.of == kind)
        name = overlays.ARROWS[kind] + (" (components that rigid bodies determine)" if partial else "")
        number = f"{float(f'{size:.4g}'):g}"
        legend.append(
            {"arrow": kind, "text": f"{name}: full arc {number} N·m" if moment else f"{name}: longest arrow {number} N"}
        )
    return legend


def _marks(joined: Sequence[overlays.Connection]) -> list[Plain]:
    return [{"loop": True, "text": "loop joint"}] if any(pair.kind in ("loop", "slot") for pair in joined) else []


def _parameter(run: Trajectory, measured: Unit | None, how: Presentation) -> Plain:
    name, scale = unicode_label(name_label(run.parameter, how)), measured.factor if measured else 1.0
    kind = {"time": run.parameter == "t", "discrete": run.numbered}
    return {"name": name, "unit": unit_text(measured), "scale": scale, **kind}


def _with_bounds(quantities: Quantities, names: Sequence[str]) -> Iterator[Series]:
    """Yield quantities, each followed by its bounds where it depends on how frictions at rest share a load.

    Ends of bands that are infinite are left out.
    """
    for name in names:
        bounds = quantities.bounds(name) if quantities.open_rows(name).any() else ()
        yield from (
            series for series in (quantities[name], *bounds) if not (series.unbounded and np.isinf(series.values).any())
        )


def _curve(series: Series, how: Presentation, rows: Indices, colour: str, packing: Packing) -> Plain:
    """Return a plot: its values at the rows, as they are shown."""
    drawn = how.shown(series.without_rounding())
    values: Array = drawn.values[rows]
    if not np.isfinite(values).all():
        raise InputError(f"{series.name} is not finite everywhere, and cannot be plotted")
    label = axis_label(series.name, drawn.unit, how, sys.maxsize)
    return {"label": unicode_label(label), "runs": runs(label), "unit": unit_text(drawn.unit), "colour": colour,
            "values": packing.add(values)}  # fmt: skip


def _inline(data: Plain) -> str:
    """Return JSON for HTML: nothing in it ends the element or begins another."""
    try:
        text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    except ValueError:
        raise InputError("the replay has places or sizes that are not finite",
                         expected="shapes and origins of links within 1e150 m") from None  # fmt: skip
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


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
