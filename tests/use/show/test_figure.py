"""Charts as figures of matplotlib: the same lines, without a display and without noise."""

import io

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.use.show.chart import Chart, Line, Note, Panel
from pinarm.use.show.figure import figure, label


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


def test_a_label_that_is_no_formula_is_told() -> None:
    with pytest.raises(InputError, match="no formula"):
        label(r"$\frac{1$")


def test_png_has_two_hundred_pixels_an_inch_unless_asked_otherwise() -> None:
    from PIL import Image

    made = figure(Chart("", [Panel([Line(np.arange(2.0), np.arange(2.0))])], 3.0, 2.0))
    for options, width in (({}, 600), ({"dpi": 50}, 150)):
        stream = io.BytesIO()
        made.savefig(stream, format="png", **options)
        assert Image.open(stream).size[0] == width
