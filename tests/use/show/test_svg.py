"""Charts as SVG: the numbers at their places, texts as texts, nothing that a file could smuggle in."""

import io
import re
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

from pinarm.use.show.chart import Chart, Line, Note, Panel
from pinarm.use.show.figure import figure
from pinarm.use.show.svg import Scale, round_numbers, svg, tick_texts

SVG = "{http://www.w3.org/2000/svg}"
PLACE = 0.01
"""Points: places are written with two digits."""

HALF = 0.36 * 9.0
"""Points: half the height of a digit, by which its foot is below its tick."""


def paths(root: ElementTree.Element, colour: str) -> list[np.ndarray]:
    """Corners of the paths of a colour [points]."""
    found = [path.get("d", "") for path in root.iter(f"{SVG}path") if path.get("stroke") == colour]
    return [np.array(re.findall(r"[ML](\S+) ([^ML]+)", d), float) for d in found]


def ticks(root: ElementTree.Element, anchor: str) -> dict[float, float]:
    """Numbers at the ticks -> places, of texts with an anchor."""
    places = {}
    for text in root.iter(f"{SVG}text"):
        number = "".join(text.itertext()).replace("\u2212", "-")
        if text.get("text-anchor") == anchor and re.fullmatch(r"-?[0-9.]+", number):
            places[float(number)] = float(text.get("x", "")) if anchor == "middle" else float(text.get("y", "")) - HALF
    return places


def test_a_curve_is_where_the_ticks_say() -> None:
    """Places of the curve, read back by the numbers at the axes, are its values."""
    x, y = np.linspace(0.0, 4.0, 9), np.linspace(-3.0, 5.0, 9) ** 3
    root = ElementTree.fromstring(svg(Chart("t", [Panel([Line(x, y, "#123456")], across="t")], 7.0, 3.0)))
    [drawn] = paths(root, "#123456")
    for axis, wanted, anchor in ((0, x, "middle"), (1, y, "end")):
        numbers, places = zip(*sorted(ticks(root, anchor).items()), strict=True)
        assert len(numbers) >= 3
        slope, start = np.polyfit(places, numbers, 1)
        assert slope * drawn[:, axis] + start == pytest.approx(wanted, abs=abs(slope) * 2 * PLACE)


def test_equal_axes_have_one_scale() -> None:
    circle = np.linspace(0.0, 2.0 * np.pi, 41)
    lines = [Line(3.0 * np.cos(circle), 3.0 * np.sin(circle), "#123456")]
    root = ElementTree.fromstring(svg(Chart("", [Panel(lines, equal=True, margin=0.1)], 7.0, 3.0)))
    [drawn] = paths(root, "#123456")
    wide, high = np.ptp(drawn, axis=0)
    assert wide == pytest.approx(high, abs=4 * PLACE)


def test_a_gap_is_a_gap() -> None:
    y = np.array([0.0, 1.0, np.nan, 1.0, 0.0])
    text = svg(Chart("", [Panel([Line(np.arange(5.0), y, "#123456")])], 7.0, 3.0))
    [path] = [path.get("d", "") for path in ElementTree.fromstring(text).iter(f"{SVG}path")
              if path.get("stroke") == "#123456"]  # fmt: skip
    assert (path.count("M"), path.count("L")) == (2, 2)
    assert "nan" not in text


def test_a_long_curve_keeps_its_extremes() -> None:
    """A spike of one row among 100,000 is drawn, and the file stays small."""
    x = np.linspace(0.0, 1.0, 100_000)
    y = np.sin(40.0 * x)
    y[54_321], y[70_000] = 3.0, -4.0
    text = svg(Chart("", [Panel([Line(x, y, "#123456")])], 7.0, 3.0))
    [drawn] = paths(ElementTree.fromstring(text), "#123456")
    spikes = [54_321, 70_000]
    few = [Line(x[::100], y[::100]), Line(x[spikes], y[spikes], "#654321")]
    [whole] = paths(ElementTree.fromstring(svg(Chart("", [Panel(few)], 7.0, 3.0))), "#654321")
    assert len(drawn) < 10_000
    assert (drawn[:, 1].min(), drawn[:, 1].max()) == pytest.approx((whole[:, 1].min(), whole[:, 1].max()), abs=PLACE)


@pytest.mark.parametrize("text", ["</svg><script>alert(1)</script>", "a & b < c", '"onload="x', "\x00\x1b[31m", "]]>"])
def test_texts_stay_texts(text: str) -> None:
    panel = Panel([Line(np.arange(2.0), np.arange(2.0), label=text)], [Note(0.0, 0.0, text)], text, text, text)
    root = ElementTree.fromstring(svg(Chart(text, [panel], 7.0, 3.0)))
    assert not list(root.iter(f"{SVG}script"))
    shown = ["".join(element.itertext()) for element in root.iter(f"{SVG}text")]
    assert sum("".join(c if c.isprintable() else "\ufffd" for c in text) == each for each in shown) == 6


def test_indices_stand_below_the_line() -> None:
    root = ElementTree.fromstring(svg(Chart("$M_{12}$", [Panel([Line(np.arange(2.0), np.arange(2.0))])], 7.0, 3.0)))
    letter, index, after = root.find(f"{SVG}text")  # type: ignore[misc]
    assert (letter.text, letter.get("font-style"), index.text) == ("M", "italic", "12")
    assert float(index.get("dy", "")) == -float(after.get("dy", "")) > 0.0


@pytest.mark.parametrize(("places", "texts", "power"), [
    ([0.0, 0.5, 1.0], ["0.0", "0.5", "1.0"], ""), ([-20.0, 0.0, 20.0], ["−20", "0", "20"], ""),
    ([0.0, 2e7, 4e7], ["0", "2", "4"], "×10⁷"), ([0.0, 5e-6], ["0", "5"], "×10⁻⁶"),
    ([1e8, 1.0005e8], ["1.0000", "1.0005"], "×10⁸"),
])  # fmt: skip
def test_numbers_at_ticks_have_the_digits_they_need(places: list[float], texts: list[str], power: str) -> None:
    assert tick_texts(places) == (texts, power)


@pytest.mark.parametrize(("low", "high", "wanted"), [
    (0.0, 1.0, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]), (-33.0, 33.0, [-20.0, 0.0, 20.0]), (1.0, 1.0001, None),
])  # fmt: skip
def test_ticks_are_round_numbers_within_the_axis(low: float, high: float, wanted: list[float] | None) -> None:
    found = round_numbers(low, high, 5)
    assert wanted is None or found == pytest.approx(wanted)
    assert 2 <= len(found) <= 6
    assert low - 1e-9 <= found[0] and found[-1] <= high + 1e-9


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("y", [np.full(9, 1e308), 1.7e308 * np.linspace(-1.0, 1.0, 9), np.linspace(0.0, 1e308, 9),
                               np.full(9, 0.99e300), np.linspace(-0.99e300, 0.99e300, 9)])  # fmt: skip
def test_what_is_near_the_largest_number_leaves_a_gap(y: np.ndarray) -> None:
    """What is not above 1e300 is drawn, and whatever it is, by both ways that pictures are made."""
    x = np.linspace(0.0, 1.0, 9)
    for line in (Line(x, y, "#123456"), Line(y, x, "#123456")):
        chart = Chart("", [Panel([line])], 7.0, 3.0)
        drawn = paths(ElementTree.fromstring(svg(chart)), "#123456")
        assert [len(path) for path in drawn] == [int((np.abs(y) < 1e300).sum())]
        assert np.isfinite(np.concatenate(drawn)).all()
        figure(chart).savefig(io.BytesIO(), format="png", dpi=20)


def test_a_scale_goes_both_ways_up() -> None:
    assert Scale(0.0, 2.0, 100.0, 20.0).at(np.array([0.0, 0.5, 2.0])).tolist() == [100.0, 80.0, 20.0]


def entries(root: ElementTree.Element, label: str) -> list[tuple[float, float]]:
    return [(float(text.get("x", "")), float(text.get("y", "")))
            for text in root.iter(f"{SVG}text") if "".join(text.itertext()) == label]  # fmt: skip


def test_the_legend_stands_where_no_line_runs() -> None:
    """A line of two points runs through the corners lower left and upper right, in which it has none."""
    lines = [Line(np.array([-1.0, 1.0]), np.array([-1.0, 1.0]), label="name"),
             Line(np.linspace(-1.0, -0.9, 5), np.full(5, 0.9)), Line(np.zeros(1), np.full(1, -1.0))]  # fmt: skip
    root = ElementTree.fromstring(svg(Chart("", [Panel(lines)], 7.0, 3.0)))
    [(x, y)] = entries(root, "name")
    assert x > 252.0  # to the right of the middle, and below it: 7 by 3 inches
    assert y > 108.0


def test_a_legend_below_has_one_column_where_names_are_long() -> None:
    names = [f"{k}: {'a long name of a curve ' * 2}" for k in range(3)]
    lines = [Line(np.arange(2.0), np.arange(2.0), label=name) for name in names]
    root = ElementTree.fromstring(svg(Chart("", [Panel(lines)], 5.6, 3.0, "below")))
    places = [entries(root, name)[0] for name in names]
    assert len({x for x, _ in places}) == 1
    assert all(b[1] - a[1] > 10.0 for a, b in pairwise(places))
    assert max(y for _, y in places) < 216.0
