"""Charts as figures of matplotlib: the same lines, without a display and without noise."""

import io
import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from pinarm.use.show.chart import Chart, Line, Note, Panel
from pinarm.use.show.figure import figure, label, svg

SVG = "{http://www.w3.org/2000/svg}"


def test_lines_and_texts_are_those_of_the_chart() -> None:
    line = Line(np.arange(3.0), np.arange(3.0) ** 2, "#123456", 2.0, "--", "o", 5.0, "none", "square")
    made = figure(Chart("heading", [Panel([line], [Note(1.0, 1.0, "P", 4.0, 3.0)], "M [N·m]", "t [s]")], 5.0, 3.0))
    [axis] = made.axes
    [drawn] = axis.lines
    assert np.array_equal(drawn.get_xydata(), np.stack([line.x, line.y], axis=1))
    look = drawn.get_color(), drawn.get_linestyle(), drawn.get_marker(), drawn.get_markerfacecolor()
    assert look == ("#123456", "--", "o", "none")
    assert (axis.get_title(loc="left"), axis.get_xlabel()) == ("M [N·m]", "t [s]")
    [note] = axis.texts
    assert (note.get_text(), note.xy, note.xyann) == ("P", (1.0, 1.0), (4.0, 3.0))
    assert made.get_size_inches().tolist() == [5.0, 3.0]


def test_what_the_font_has_not_is_one_mark() -> None:
    """A warning for each such character would be an error here."""
    assert label("力 é") == "\N{REPLACEMENT CHARACTER} é"
    made = figure(Chart("力", [Panel([Line(np.arange(2.0), np.arange(2.0), label="力")])], 5.0, 3.0))
    made.savefig(io.BytesIO(), format="png", dpi=40)


@pytest.mark.parametrize(("text", "drawn"), [
    (r"$\frac{1$", "frac{1"), (r"$\alpha{$ \$ [N]", r"α{ \$ [N]"), ("$x_1_2$", "x₁₂"),
    (r"$\dot\psi_{2}$", r"$\dot\psi_{2}$"),
])  # fmt: skip
def test_a_formula_that_cannot_be_read_is_written_by_its_characters(text: str, drawn: str) -> None:
    assert label(text) == drawn
    figure(Chart(text, [Panel([Line(np.arange(2.0), np.arange(2.0))])], 5.0, 3.0)).encoded("svg")


def elements(chart: Chart) -> tuple[list[str], list[np.ndarray]]:
    """Texts of the SVG of a chart, and the corners of its lines of colour #123456 [points]."""
    root = ElementTree.fromstring(svg(chart))
    assert not list(root.iter(f"{SVG}script"))
    drawn = [path.get("d", "") for path in root.iter(f"{SVG}path") if "stroke: #123456" in path.get("style", "")]
    corners = [np.array(re.findall(r"[ML] (\S+) (\S+)", d), float) for d in drawn]
    return ["".join(text.itertext()) for text in root.iter(f"{SVG}text")], corners


@pytest.mark.parametrize("text", ["</svg><script>alert(1)</script>", '"onload="x', "\x00\x1b[31m"])
def test_texts_stay_texts(text: str) -> None:
    """Of a heading, a legend, three axes and a name in the drawing."""
    panel = Panel([Line(np.arange(2.0), np.arange(2.0), label=text)], [Note(0.0, 0.0, text)], text, text, text)
    texts, _ = elements(Chart(text, [panel], 7.0, 3.0))
    assert texts.count("".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)) == 6


def test_a_long_curve_keeps_its_extremes() -> None:
    """A spike of one row among 100,000 is drawn, and the file stays small."""
    x = np.linspace(0.0, 1.0, 100_000)
    y = np.sin(40.0 * x)
    y[54_321], y[70_000] = 3.0, -4.0
    _, [drawn] = elements(Chart("", [Panel([Line(x, y, "#123456")])], 7.0, 3.0))
    spikes = [54_321, 70_000]
    few = [Line(x[::100], y[::100]), Line(x[spikes], y[spikes], "#123456")]
    _, [whole] = elements(Chart("", [Panel(few)], 7.0, 3.0))
    assert len(drawn) < 10_000
    assert (drawn[:, 1].min(), drawn[:, 1].max()) == pytest.approx((whole[:, 1].min(), whole[:, 1].max()), abs=0.1)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("y", [1.7e308 * np.linspace(-1.0, 1.0, 9), np.linspace(-0.99e300, 0.99e300, 9)])
def test_what_is_near_the_largest_number_leaves_a_gap(y: np.ndarray) -> None:
    """Numbers up to 1e300 are drawn, in both directions."""
    x = np.linspace(0.0, 1.0, 9)
    for line in (Line(x, y, "#123456", marker="x"), Line(y, x, "#123456", marker="x")):
        chart = Chart("", [Panel([line])], 7.0, 3.0)
        root = ElementTree.fromstring(svg(chart))
        marks = [use for use in root.iter(f"{SVG}use") if "stroke: #123456" in use.get("style", "")]
        assert len(marks) == int((np.abs(y) < 1e300).sum())
        assert np.isfinite([float(use.get(axis, "")) for use in marks for axis in "xy"]).all()


DRAWN = """
import hashlib
import numpy as np
from pinarm.use.show.chart import Chart, Line, Note, Panel
from pinarm.use.show.figure import figure
x = np.linspace(0.0, 1.0, 50)
panel = Panel([Line(x, x**k, marker="o", label=f"$x_{k}$") for k in (1, 2)], [Note(0.5, 0.5, "P")], "\\\\$ 5 <")
made = figure(Chart("heading", [panel], 5.0, 3.0))
for form in ("svg", "png", "pdf"):
    print(hashlib.sha256(made.encoded(form)).hexdigest())
"""


@pytest.mark.slow
def test_bytes_do_not_depend_on_hash_seeds_and_settings_of_the_user(tmp_path: Path) -> None:
    """A backend that does not exist and another style, as users may have for programs of their own."""
    (tmp_path / "matplotlibrc").write_text("font.size: 20\naxes.facecolor: red\ntext.usetex: True\n")
    settings = [
        {"PYTHONHASHSEED": "1"},
        {"PYTHONHASHSEED": "2", "MPLBACKEND": "nonsense", "MATPLOTLIBRC": str(tmp_path / "matplotlibrc")},
    ]
    runs = [subprocess.run([sys.executable, "-c", DRAWN], env={**os.environ, **each}, capture_output=True, text=True,
                           check=False) for each in settings]  # fmt: skip
    assert [run.stderr for run in runs] == ["", ""]
    assert runs[0].stdout == runs[1].stdout
    assert len(runs[0].stdout.split()) == 3
