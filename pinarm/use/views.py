"""How a result is shown and written: the one module through which ``Result`` reaches ``show`` and ``store``.

A view is imported when it is asked for: a run without plots does not load matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinarm.errors import PinarmError

if TYPE_CHECKING:
    import meshcat

    from pinarm.use.result.result import Result
    from pinarm.use.show.picture import Picture
    from pinarm.use.show.picture_files import PictureFormat
    from pinarm.use.show.replay.page import Replay

MOST_PLOTS = 8
"""Outputs that a notebook draws without being asked; ``plot`` draws any."""

MOST_LINES = 60
"""Rows of a table that a notebook shows."""

FRAME_HEIGHT = 400
"""Height of the replay in a notebook [px]."""


def plot(result: Result, names: tuple[str, ...], *, against: str | None = None) -> Picture:
    """Return a figure with one axis per quantity; see ``Result.plot``."""
    from pinarm.use.show.plot import graph, graph_named, plot

    drawn = graph_named(result, names)
    return plot(result, names, against=against) if drawn is None else graph(drawn, result.presentation)


def sketch(result: Result, forces: bool = False, at: float | str | None = None) -> Picture:
    """Return a drawing of the mechanism at the start and the end of the run, or its bodies with their loads."""
    from pinarm.use.show.free_bodies import free_body_diagrams
    from pinarm.use.show.sketch import sketch

    return free_body_diagrams(result, at) if forces else sketch(result)


def replay(
    result: Result, traces: Sequence[str], arrows: Sequence[str], plots: Sequence[str] | None, named: bool
) -> Replay:
    """Return the moving picture of the run; see ``Result.replay``."""
    from pinarm.use.show.replay import page

    return page.replay_page(result, traces=traces, arrows=arrows, plots=plots, named=named)


def show(result: Result, visualizer: Any, name: str) -> meshcat.Visualizer:
    """Show the run in a live viewer; see ``Result.show``."""
    from pinarm.use.show.replay import live

    return live.show(result, visualizer, name=name)


def save(result: Result, folder: Path, *, plots: PictureFormat | bool, dpi: int) -> Path:
    """Write the result as a folder; return the folder."""
    from pinarm.use.store import save

    return save.save(result, folder, plots=plots, dpi=dpi)


def html(result: Result) -> str:
    """Return ranges of the outputs, accuracy, plots, the positions at start and end, and the replay, for notebooks."""
    from pinarm.use.show.notebook import (
        blocks,
        folded,
        frame,
        heading,
        lines,
        picture,
        section_html,
        side_by_side,
        table,
    )
    from pinarm.use.show.terminal import ranges, remarks

    outputs = list(dict.fromkeys(result.content.outputs))
    parts = [heading(result.content.title or result.name), table(ranges(result)), lines(remarks(result))]
    parts += [section_html(section, result.presentation) for section in result.shown_sections.values()]
    parts += [
        folded(name, table(array.cells())) for name, array in result.arrays.items() if len(array.rows) <= MOST_LINES
    ]
    if len(result) > 1:
        parts.append(side_by_side(picture(plot(result, (*outputs[:MOST_PLOTS],))), picture(sketch(result))))
    try:
        parts.append(frame(replay(result, (), (), (), False).html, height=FRAME_HEIGHT))
    except PinarmError as error:
        parts.append(lines([f"no replay: {error}"]))
    return blocks(*parts)
