"""What a notebook shows of results."""

import re
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import Any

import pytest

import pinarm


def test_a_result_shows_its_report_with_the_replay(scenario: Callable[..., Any]) -> None:
    cell = scenario("inverse").run()._repr_html_()
    page = re.fullmatch('<pre[^>]*>([^<]*)</pre><iframe loading="lazy" srcdoc="([^"]*)" style="[^"]*"></iframe>', cell)
    assert page
    assert "14.32942" in page[1]
    report = unescape(page[2])
    heads, *rows = [re.findall(r"<t[hd][^>]*>([^<]*)<", row) for row in re.findall("<tr>(.*?)</tr>", report)]
    assert heads == ["Given", "Of", "Value"]
    assert ["alpha", "deg"] in [row[:2] for row in rows]
    assert "accuracy: relative residuals" in report
    assert report.count("<svg ") >= 3  # curves, and the two positions; the graph of links
    assert report.count("<iframe") == 1
    assert "http" not in re.sub(r'srcdoc="[^"]*"|http://www.w3.org', "", report)


def test_names_and_titles_are_text(scenario: Callable[..., Any]) -> None:
    evil = "</pre></td><script>alert(1)</script>"
    given = scenario("statics", f'symbols: {{"{evil}": 2*alpha}}\n', ("[M,", f'["{evil}", M,'), ("A pendulum", evil))
    report = unescape(re.sub(r'srcdoc="[^"]*"', "", pinarm.report(given.run()).html))
    assert "<script>alert" not in pinarm.report(given.run()).html
    assert evil in report


def test_a_sweep_and_a_tradeoff_show_themselves(scenario: Callable[..., Any], folder: Path) -> None:
    swept = pinarm.sweep(scenario("statics"), {"problem.over.pivot.to": "90:180:2 deg"}, results=["M @ max"], workers=1)
    assert "Sweep over 2 cases" in unescape(swept._repr_html_())
    trade = pinarm.tradeoff(scenario("statics", "variants:\n  half: {changes.gravity.magnitude: 5 m/s^2}\n"))
    assert "5.0e-01" in trade._repr_html_()
    assert trade._repr_html_().count("<svg ") == 2


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
    assert len(repr(known).splitlines()) == len(known) + 1


OFFERED = re.compile(r"\bresult\.([a-z_]+)")


def test_completion_offers_what_the_pages_name(scenario: Callable[..., Any]) -> None:
    result = scenario("statics").run()
    root = Path(pinarm.__file__).parent.parent
    pages = "".join(file.read_text(encoding="utf-8") for file in [root / "README.md", *(root / "docs").glob("*.md")])
    named = {name for name in OFFERED.findall(pages) if hasattr(result, name)}
    assert len(named) > 8
    assert named <= set(dir(result))
    for thing in (result, result.scenario, result.scenario.mechanism, result["M"]):
        assert all(name[0] != "_" for name in dir(thing))
