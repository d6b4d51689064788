"""The drawing of a mechanism: parts, points, joints and loops with their names, where its loops close."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.errors import InputError

MODELS = Path(pinarm.__file__).parents[1] / "models"


def test_a_mechanism_is_drawn_with_its_names() -> None:
    """Slider-crank of 45 mm and 145 mm, stretched or folded along x; its points by Pinocchio's convention of z."""
    found = pinarm.explain(MODELS / "slider_crank" / "mechanism.yaml")
    [axis] = found.sketch().axes
    names = {text.get_text(): text.xy for text in axis.texts}
    [piston] = [xy for text, xy in names.items() if text.startswith("B3, B")]
    [pin] = [xy for text, xy in names.items() if text.split(", ")[0] == "A"]
    assert np.hypot(*np.subtract(piston, pin)) == pytest.approx(0.145, abs=1e-9)
    assert np.hypot(*pin) == pytest.approx(0.045, abs=1e-12)
    assert {"crank", "rod"} <= names.keys()


def test_a_spatial_mechanism_has_the_axes_of_the_world() -> None:
    [axis] = pinarm.explain(MODELS / "bricard" / "mechanism.yaml").sketch().axes
    texts = [text.get_text() for text in axis.texts]
    assert {"x", "y", "z"} <= set(texts)
    assert any("P5" in text.split(", ") for text in texts)  # the joint that closes the loop


@pytest.mark.parametrize(("form", "begins"), [("svg", b"<svg"), ("png", b"\x89PNG"), ("pdf", b"%PDF")])
def test_the_command_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str], form: str, begins: bytes) -> None:
    file = tmp_path / f"four_bar.{form}"
    assert main(["explain", str(MODELS / "four_bar" / "mechanism.yaml"), "--draw", str(file)]) == 0
    assert file.read_bytes().startswith(begins)
    assert f"written to {file}" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["drawing", "drawing.gif", "drawing.html"])
def test_another_format_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="pictures are not written as"):
        pinarm.explain(MODELS / "four_bar" / "mechanism.yaml").draw(tmp_path / name)
    assert not (tmp_path / name).exists()


def test_a_notebook_shows_both() -> None:
    shown = pinarm.explain(MODELS / "four_bar" / "mechanism.yaml")._repr_html_()
    assert "data:image/png" in shown
    assert "mobility 1" in shown
