"""Work-precision plots: time against error, a panel for each problem."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.race.engines import ENGINES
from benchmarks.race.problems import Inverse, Motion, problems

STYLES = {
    "pinarm": ("#0072B2", "o"),
    "pinocchio": ("#E69F00", "s"),
    "mujoco": ("#009E73", "^"),
    "drake": ("#CC79A7", "D"),
    "exudyn": ("#D55E00", "v"),
}
"""Colours that colour-blind readers tell apart (Okabe and Ito), and markers."""

FIGURES = {"race_trees": "open chains", "race_loops": "closed loops"}


COLUMNS = 3
"""Panels beside one another."""


def save(results: dict[str, Any], folder: Path) -> list[str]:
    """Write the plots; return the names of their files."""
    import matplotlib

    matplotlib.use("Agg")
    groups: dict[str, list[str]] = {name: [] for name in FIGURES}
    for name in results:
        problem = problems()[name]
        ran = any(engine["runs"] for engine in results[name]["engines"].values())
        if ran and not isinstance(problem, Inverse):
            looped = isinstance(problem, Motion) and problem.linkage.loops
            groups["race_loops" if looped else "race_trees"].append(name)
    written = []
    for figure, names in groups.items():
        if names:
            _figure(results, names).savefig(folder / f"{figure}.png", dpi=200)
            written.append(f"{figure}.png")
    return written


def _figure(results: dict[str, Any], names: list[str]) -> Any:
    from matplotlib.figure import Figure

    rows = -(-len(names) // COLUMNS)
    figure = Figure(figsize=(11.0, 3.4 * rows + 0.6), layout="constrained")
    panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for panel, name in zip(panels, names, strict=False):
        panel.set_title(problems()[name].title, fontsize=9)
        for engine in ENGINES:
            _curve(panel, engine, results[name]["engines"][engine]["runs"])
        panel.set(xscale="log", yscale="log", xlim=(30.0, 1e-13))
        panel.grid(True, which="major", linewidth=0.4, alpha=0.6)
        panel.tick_params(labelsize=8)
    for panel in panels[len(names) :]:
        panel.set_axis_off()
    labels = panels[0].get_legend_handles_labels()
    figure.legend(*labels, loc="outside upper center", ncols=len(ENGINES), frameon=False, fontsize=10)
    figure.supxlabel("largest error [rad]", fontsize=9)
    figure.supylabel("time [s]", fontsize=9)
    return figure


def _curve(panel: Any, engine: str, runs: list[dict[str, Any]]) -> None:
    """Draw all runs of an engine, and a line through those that nothing of its own beats."""
    colour, marker = STYLES[engine]
    points = np.array([(run["error"], run["seconds"]) for run in runs if "error" in run]).reshape(-1, 2)
    panel.plot(*points.T, marker, color=colour, markersize=2.5, alpha=0.3, linestyle="none")
    ordered = points[np.argsort(points[:, 1])] if len(points) else points
    front = ordered[ordered[:, 0] <= np.minimum.accumulate(ordered[:, 0])] if len(points) else points
    panel.plot(*front.T, marker=marker, color=colour, markersize=4.5, linewidth=1.3, label=ENGINES[engine])
