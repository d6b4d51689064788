"""What a notebook shows of results."""

import re
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import pinarm

PICTURE = re.compile(r'src="data:image/png;base64,([^"]+)"')


def rows(cell: str) -> list[list[str]]:
    """The cells of its table."""
    return [re.findall(r"<t[hd][^>]*>([^<]*)<", row) for row in re.findall("<tr>(.*?)</tr>", cell)]


def test_a_result_shows_numbers_plots_and_replay(scenario: Callable[..., Any]) -> None:
    cell = scenario("inverse").run()._repr_html_()
    assert rows(cell)[0] == ["", "unit", "min", "at t", "max", "at t"]
    assert [row[:2] for row in rows(cell)[1:]] == [["M", "N*m"], ["alpha", "deg"]]
    assert rows(cell)[2][4:] == ["57.29578", "2"]  # 1 rad, reached in 2 s
    assert "accuracy: relative residuals" in cell
    assert all(b64decode(data).startswith(b"\x89PNG") for data in PICTURE.findall(cell))
    assert len(PICTURE.findall(cell)) == 2  # curves, and the two positions
    assert len(re.findall("<iframe", cell)) == 1
    assert "http" not in re.sub(r'srcdoc="[^"]*"|http://www.w3.org', "", cell)


def test_a_state_has_numbers_and_a_picture_but_no_curve(scenario: Callable[..., Any]) -> None:
    cell = scenario("state").run()._repr_html_()
    assert rows(cell)[0] == ["", "unit", "row 0"]
    assert not PICTURE.findall(cell)
    assert "<iframe" in cell


def test_names_and_titles_are_text(scenario: Callable[..., Any]) -> None:
    evil = "</pre></td><script>alert(1)</script>"
    given = scenario("statics", f'symbols: {{"{evil}": 2*alpha}}\n', ("[M,", f'["{evil}", M,'), ("A pendulum", evil))
    assert "<script" not in re.sub(r'srcdoc="[^"]*"', "", given.run()._repr_html_())


def test_a_sweep_and_a_tradeoff_show_themselves(scenario: Callable[..., Any], folder: Path) -> None:
    swept = pinarm.sweep(scenario("statics"), {"problem.over.pivot.to": "90:180:2 deg"}, results=["M @ max"], workers=1)
    assert rows(swept._repr_html_())[1][:3] == ["M @ max", "N*m", f"{swept['M @ max'].values.min():.7g}"]
    assert "cases: 2" in swept._repr_html_()
    trade = pinarm.tradeoff(scenario("statics", "variants:\n  half: {changes.gravity.magnitude: 5 m/s^2}\n"))
    assert "5.0e-01" in trade._repr_html_()
    assert len(PICTURE.findall(trade._repr_html_())) == 1


def test_a_mistake_is_its_message_and_the_line_of_the_cell(capsys: pytest.CaptureFixture[str]) -> None:
    shells = pytest.importorskip("IPython.core.interactiveshell")
    shell = shells.InteractiveShell()
    shell.run_cell("import pinarm\ndef solved():\n    return pinarm.run('nothing.yaml')\nsolved()\n")
    shown = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert shown[0] == "InputError: nothing.yaml: there is no file nothing.yaml"
    assert shown[-1] == "in line 3: return pinarm.run('nothing.yaml')"
    assert len(shown) <= 4


def test_a_mechanism_and_its_quantities_are_tables(folder: Path) -> None:
    arm = pinarm.Mechanism.load(folder / "pendulum.yaml")
    captions = re.findall("<caption>([^<]*)<", arm._repr_html_())
    assert captions[:2] == ["Bodies", "Joints"]
    assert "<td" in arm._repr_html_()
    known = pinarm.quantities(arm)
    assert known._repr_html_().count("<tr>") == len(known)


OFFERED = re.compile(r"\bresult\.([a-z_]+)")


def test_completion_offers_what_the_pages_name(scenario: Callable[..., Any]) -> None:
    """And nothing that the object does not have, or that serves the program alone."""
    result = scenario("statics").run()
    root = Path(pinarm.__file__).parent.parent
    pages = "".join(file.read_text(encoding="utf-8") for file in [root / "README.md", *(root / "docs").glob("*.md")])
    named = {name for name in OFFERED.findall(pages) if hasattr(result, name)}
    assert len(named) > 8
    assert named <= set(dir(result))
    for thing in (result, result.scenario, result.scenario.mechanism, result["M"]):
        assert all(name[0] != "_" for name in dir(thing))
        assert not {"unshown", "require_finite", "written_sections"} & set(dir(thing))
