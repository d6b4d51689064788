"""Plots: an axis for each quantity, names that are drawn as they stand, and the files that are written."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.use.result.section import Curve, Graph
from pinarm.use.show.picture import graph
from pinarm.use.show.picture_files import picture_format, pictures, write_pictures

ROOT = Path(pinarm.__file__).parents[1]


def test_what_is_drawn_are_the_numbers(scenario: Callable[..., Any]) -> None:
    result = scenario("inverse").run()
    [axis] = result.plot("M", against="alpha").axes
    x, y = axis.lines[0].get_data()
    assert np.array_equal(y, result["M"].values)
    assert np.asarray(x) == pytest.approx(np.degrees(result["alpha"].values), rel=1e-15)  # angles in degrees
    assert "°" in axis.get_xlabel()
    assert axis.get_title(loc="left") == "M [N·m]"


def test_published_figures_stand_over_the_curve_and_misprints_beside_it() -> None:
    """The dynamic torque of the two-rod arm: a printed number that holds, and a printed formula that does not."""
    result = pinarm.load(ROOT / "scenarios" / "gen411_arm_dynamic.yaml").run()
    [axis] = result.plot("C_B").axes
    curve, *marks = axis.lines
    looks = {line.get_label(): (line.get_marker(), line.get_linestyle()) for line in marks}
    assert looks == {"published": ("o", "None"), "printed formula, a misprint": ("None", "--")}
    [point] = [line for line in marks if line.get_label() == "published"]
    assert point.get_xydata() == pytest.approx(np.array([[0.0, 1.6069167]]), abs=1e-12)
    [wrong] = [line for line in marks if line.get_linestyle() == "--"]
    assert np.abs(wrong.get_ydata() - curve.get_ydata()).min() > 1.0  # its sign is reversed


def test_rows_that_stand_for_themselves_are_not_joined(scenario: Callable[..., Any]) -> None:
    [axis] = scenario("equilibria").run().plot("alpha").axes
    [line] = axis.lines
    assert (line.get_linestyle(), line.get_marker()) == ("None", "o")
    assert list(axis.get_xticks()) == [1.0, 2.0]
    [axis] = scenario("statics").run().plot("M").axes
    assert axis.lines[0].get_linestyle() == "-"


@pytest.mark.parametrize(
    ("form", "begins"),
    [
        ("svg", b"<?xml"),
        pytest.param("png", b"\x89PNG", marks=pytest.mark.slow),
        pytest.param("pdf", b"%PDF", marks=pytest.mark.slow),
    ],
)
def test_plots_are_written_in_the_format_that_is_asked_for(
    scenario: Callable[..., Any], tmp_path: Path, form: Any, begins: bytes
) -> None:
    """The same result gives the same bytes."""
    result = scenario("inverse").run()
    files = write_pictures(pictures(result), tmp_path / "plots", form)
    assert [file.name for file in files] == [f"outputs_1.{form}", f"positions.{form}"]
    first = [file.read_bytes() for file in files]
    assert all(raw.startswith(begins) for raw in first)
    assert [file.read_bytes() for file in write_pictures(pictures(result), tmp_path / "plots", form)] == first


def test_the_resolution_of_png_is_as_asked_for(scenario: Callable[..., Any]) -> None:
    """7 inches at 100 and, where nothing is said, at 200 pixels each."""
    from PIL import Image

    drawn = scenario("inverse").run().plot("M")
    assert Image.open(io.BytesIO(drawn.encoded("png", 100))).size[0] == 700
    assert Image.open(io.BytesIO(drawn.encoded("png"))).size[0] == 1400


@pytest.mark.parametrize(("form", "dpi", "said"), [
    ("png", 0, "0 is no resolution"), (True, "x", "'x' is no resolution"), ("gif", 200, "not written as 'gif'"),
])  # fmt: skip
def test_formats_and_resolutions_that_no_picture_has(form: Any, dpi: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        picture_format(form, dpi)


def test_many_curves_differ_by_colour_or_by_dashes_and_are_named_below() -> None:
    across = Series("t", unit("s"), np.arange(3.0))
    curves = [Curve(across, Series("x", unit("m"), k + np.arange(3.0)), f"case {k}") for k in range(15)]
    drawn = graph(Graph("cases", "Cases", curves))
    [axis] = drawn.axes
    assert len({(line.get_color(), line.get_linestyle()) for line in axis.lines}) == 15
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == [f"case {k}" for k in range(15)]
    assert graph(Graph("cases", "Cases", curves[:6])).axes[0].get_legend() is not None
