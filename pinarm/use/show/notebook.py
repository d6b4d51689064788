"""What a notebook shows of results: numbers, plots and the replay, as HTML that needs nothing else.

Pictures are in it as data, and the replay is in a frame of its own, so that a saved notebook shows them offline.
"""

from __future__ import annotations

import html
from base64 import b64encode
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pinarm.errors import PinarmError
from pinarm.use.result.result import Result
from pinarm.use.show.terminal import ranges, remarks
from pinarm.use.study.accuracy import tradeoff_text as trades
from pinarm.use.study.answers import verdict_table as verdicts
from pinarm.use.study.sweep import sweep_text as sweeps

if TYPE_CHECKING:
    from pinarm.use.show.plot import Picture
    from pinarm.use.study.accuracy.tradeoff import Tradeoff
    from pinarm.use.study.answers.check import Finding
    from pinarm.use.study.batch.reduced_table import Table
    from pinarm.use.study.sweep.sweep import Sweep

MOST_PLOTS = 8
"""Outputs that are drawn of themselves; ``plot`` draws any."""


def of_result(result: Result) -> str:
    """Return the ranges of the outputs, what they are worth, their plots, start and end positions, and the replay."""
    outputs = list(dict.fromkeys(result.content.outputs))
    parts = [_heading(result.content.title or result.name), table(ranges(result)), lines(remarks(result))]
    if len(result) > 1:
        parts.append(_beside(picture(result.plot(*outputs[:MOST_PLOTS])), picture(result.sketch())))
    try:
        parts.append(frame(result.replay(plots=()).html, height=400))
    except PinarmError as error:
        parts.append(lines([f"no replay: {error}"]))
    return _whole(parts)


def of_sweep(sweep: Sweep) -> str:
    """Return the statistics of the results, the failures, and a plot of the first result."""
    return _whole([
        _heading(sweep.title or sweep.name), table(sweeps.ranges(sweep)), lines(sweeps.remarks(sweep)),
        picture(sweep.plot()),
    ])  # fmt: skip


def of_table(batch: Table) -> str:
    """Return the statistics of a batch's numbers, and why motions failed."""
    told = batch.summary()
    rows = [["", "unit", "min", "in motion", "mean", "deviation", "max", "in motion"]]
    for name, entry in told["columns"].items():
        numbers = [entry.get(key) for key in ("min", "at_min", "mean", "deviation", "max", "at_max")]
        rows.append([name, entry["unit"], *("-" if number is None else f"{number:.7g}" for number in numbers)])
    failed = [f"failed: {one['reason']} ({one['cases']})" for one in told["failures"]]
    return _whole([_heading(f"{batch.name}, {len(batch)} motions"), table(rows), lines(failed)])


def of_tradeoff(trade: Tradeoff) -> str:
    """Return what is recommended, the tables of settings and variants, and their plots."""
    drawn = {name: picture(figure) for name, figure in trade.plots().items()}
    parts = [_heading(trade.scenario.content.title or trade.scenario.name)]
    if trade.reference:
        parts += [lines(trades.advice(trade)), drawn["settings"]]
        parts.append(f"<details><summary>all settings</summary>{table(trades.settings(trade))}</details>")
    if trade.variants:
        parts += [table(trades.variants(trade)), lines(trades.remarks(trade)), drawn["variants"]]
    return _whole(parts)


def of_findings(findings: Sequence[Finding]) -> str:
    """Return the table of findings, why some are a miss, and how many there are of each."""
    rows = [list(verdicts.HEADING), *verdicts.rows(findings)]
    return _whole([table(rows), lines(verdicts.remarks(findings))])


def table(rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose first row is its heading, names and units to the left, numbers to the right."""

    def line(tag: str, row: Sequence[str]) -> str:
        sides = ["left", "left", *["right"] * (len(row) - 2)]
        cells = zip(sides, row, strict=True)
        return "".join(f'<{tag} style="text-align:{side}">{html.escape(text)}</{tag}>' for side, text in cells)

    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows[1:])
    return f"<table><thead><tr>{line('th', rows[0])}</tr></thead><tbody>{body}</tbody></table>"


def picture(figure: Picture) -> str:
    """Return a figure as an image that carries its own data."""
    data, size = figure._repr_png_()
    style = f"flex:0 1 {size['width']}px;min-width:0;max-width:min(100%, {size['width']}px)"
    return f'<img alt="plots" style="{style}" src="data:image/png;base64,{b64encode(data).decode()}">'


def frame(page: str, *, height: int) -> str:
    """Return a page within the page, as wide as there is room; it starts when it comes into sight."""
    style = f"width:100%;height:{height}px;border:1px solid #d9dee3;border-radius:4px"
    return f'<iframe loading="lazy" srcdoc="{html.escape(page)}" style="{style}"></iframe>'


def _heading(text: str) -> str:
    return f'<div style="font-weight:600;margin:.4em 0">{html.escape(text)}</div>'


def lines(texts: Sequence[str]) -> str:
    """Return lines of text, as they stand."""
    style = "font-size:90%;opacity:.8;white-space:pre-wrap;background:none;padding:0;margin:.6em 0"
    return f'<pre style="{style}">{html.escape(chr(10).join(texts))}</pre>'


def _beside(*parts: str) -> str:
    """Return parts side by side, smaller where there is no room."""
    return f'<div style="display:flex;align-items:flex-start">{"".join(parts)}</div>'


def _whole(parts: Sequence[str]) -> str:
    return f"<div>{''.join(f'<div>{part}</div>' for part in parts)}</div>"
