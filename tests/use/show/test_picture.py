"""Pictures by matplotlib: right lines and texts, without a display and without noise."""

import io
import re
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from pinarm.use.show.picture import Note, Picture, draw, drawing, fit, label, legend, limits, panels, write

SVG = "{http://www.w3.org/2000/svg}"


def curves(*lines: tuple[np.ndarray, np.ndarray], text: str = "", **look: Any) -> Picture:
    """A picture of lines of colour #123456, and of one text at six places."""
    with drawing(7.0, 3.0, text) as picture:
        [axis] = panels(picture, [text], text)
        axis.set_ylabel(label(text))
        legend(axis, [draw(axis, x, y, text, color="#123456", **look) for x, y in lines])
        write(axis, Note(text, np.zeros(2), "#000000"))
        fit(axis)
    return picture


def elements(picture: Picture) -> tuple[list[str], list[np.ndarray]]:
    """Texts of the SVG of a picture, and the corners of its lines of colour #123456 [points]."""
    root = ElementTree.fromstring(picture.svg())
    assert not list(root.iter(f"{SVG}script"))
    drawn = [path.get("d", "") for path in root.iter(f"{SVG}path") if "stroke: #123456" in path.get("style", "")]
    corners = [np.array(re.findall(r"[ML] (\S+) (\S+)", d), float) for d in drawn]
    return ["".join(text.itertext()) for text in root.iter(f"{SVG}text")], corners


@pytest.mark.parametrize("values", [np.ones(3) + 1e-15 * np.arange(3), np.full(3, 1e-30), np.zeros(0), -np.ones(1)])
def test_rounding_is_not_blown_up(values: np.ndarray) -> None:
    low, high = limits(values)
    assert high - low >= 0.19


@pytest.mark.parametrize(("text", "drawn"), [
    (r"$\frac{1$", "frac{1"), (r"$\alpha{$ \$ [N]", r"α{ \$ [N]"), ("$x_1_2$", "x₁₂"),
    (r"$\dot\psi_{2}$", r"$\dot\psi_{2}$"), ("力 é", "\N{REPLACEMENT CHARACTER} é"),
])  # fmt: skip
def test_what_matplotlib_cannot_write_is_replaced(text: str, drawn: str) -> None:
    """A formula that is none by its characters, a character that the font has not by one mark, without a warning."""
    assert label(text) == drawn
    curves((np.arange(2.0), np.arange(2.0)), text=text).savefig(io.BytesIO(), format="png", dpi=40)


@pytest.mark.parametrize("text", ["</svg><script>alert(1)</script>", '"onload="x', "\x00\x1b[31m"])
def test_texts_stay_texts(text: str) -> None:
    """Of a heading, a legend, three axes and a name in the drawing."""
    texts, _ = elements(curves((np.arange(2.0), np.arange(2.0)), text=text))
    assert texts.count("".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)) == 6


def test_a_long_curve_keeps_its_extremes() -> None:
    """A spike of one row among 100,000 is drawn, and the file stays small."""
    x = np.linspace(0.0, 1.0, 100_000)
    y = np.sin(40.0 * x)
    y[54_321], y[70_000] = 3.0, -4.0
    _, [drawn] = elements(curves((x, y)))
    _, [spikes] = elements(curves((x[[54_321, 70_000]], y[[54_321, 70_000]])))
    assert len(drawn) < 10_000
    assert (drawn[:, 1].min(), drawn[:, 1].max()) == pytest.approx((spikes[:, 1].min(), spikes[:, 1].max()), abs=0.1)
