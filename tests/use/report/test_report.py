"""The report: every number as the result has it, nothing from elsewhere, names as text, pages of A4."""

import html
import io
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pypdf
import pytest

import pinarm
from pinarm.errors import PinarmError
from pinarm.use.report.report import report
from pinarm.use.show.replay.chromium import chromium
from tests.use.conftest import INVERSE, MECHANISM, URDF

SHAKING = "numbers: [M @ rms, alpha @ end]\nshaking: {harmonics: 2}\n"
TRAPEZOID = "{law: trapezoid, from: 0 rad, to: 1 rad, acceleration: 1 rad/s^2}"
PERIODIC = TRAPEZOID, "{law: harmonic, amplitude: 1 rad, pulsation: 3.14159265358979 rad/s}"
"""What makes an inverse problem have numbers and a section."""


@pytest.fixture(scope="module")
def shaken(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The result of an inverse problem with numbers and a section."""
    folder = tmp_path_factory.mktemp("shaken")
    for name, text in ((".pinarm-root", ""), ("pendulum.urdf", URDF), ("pendulum.yaml", MECHANISM)):
        (folder / name).write_text(text)
    (folder / "inverse.yaml").write_text(INVERSE.replace(*PERIODIC) + SHAKING)
    return pinarm.run(folder / "inverse.yaml")


@pytest.fixture(scope="module")
def shaken_page(shaken: Any) -> str:
    return report(shaken).html


def body(page: str) -> str:
    """The page without replays, which are pages of their own with tests of their own."""
    return re.sub(r'srcdoc="[^"]*"', "", page)


def rows(page: str) -> list[list[str]]:
    """The cells of all its tables, row by row."""
    cells = (re.findall(r"<t[dh][^>]*>([^<]*)</t[dh]>", row) for row in re.findall(r"<tr>(.*?)</tr>", page, re.S))
    return [[html.unescape(cell) for cell in row] for row in cells]


def row(page: str, *begin: str) -> list[str]:
    """The only row that begins with some cells."""
    (found,) = (cells for cells in rows(page) if cells[: len(begin)] == list(begin))
    return found


def printed(value: float) -> str:
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value + 0.0:.4g}"


def test_every_output_is_printed_as_the_summary_has_it(scenario: Callable[..., Any]) -> None:
    result = scenario("inverse").run()
    page = report(result).html
    outputs = result.summary()["outputs"]
    assert set(outputs) == {"M", "alpha"}
    for name, entry in outputs.items():
        scale, unit = (np.pi / 180, "deg") if entry["unit"] == "rad" else (1.0, entry["unit"].replace("*", "·"))
        numbers = [entry["min"] / scale, entry["at_min"], entry["max"] / scale, entry["at_max"]]
        assert row(page, name, unit)[2:] == [printed(value) for value in numbers]
        assert [float(cell) for cell in row(page, name, unit)[2:]] == pytest.approx(numbers, rel=5e-4)


def test_a_joint_that_carries_nothing_has_zeros_beside_others_that_do() -> None:
    """The air pushes cylinder and rod, which have no mass, apart: their slide carries no force, other joints 20 kN."""
    page = report(pinarm.run(Path(pinarm.__file__).parents[1] / "scenarios/manipulator_motion.yaml"), student=True).html
    assert row(page, "y", "cylinder", "rod")[4:] == ["0", "0", "undetermined", "0", "0", "0"]


def test_a_floating_body_has_one_row_of_torsors() -> None:
    """Of the six simple joints of its floating joint, only the last carries a link."""
    page = report(pinarm.run(Path(pinarm.__file__).parents[1] / "scenarios" / "brick_thrown.yaml")).html
    rows = re.findall("<tr>.*?</tr>", page.partition("Static torsors of the joints")[2].partition("</table>")[0])
    assert sum(">brick<" in row for row in rows) == len(rows) - 1 == 1


def test_numbers_and_sections_are_printed_as_the_result_has_them(shaken: Any, shaken_page: str) -> None:
    """Angles in degrees."""
    result, page = shaken, shaken_page
    (torque, error), (angle, _) = result.numbers().values()
    assert row(page, "M @ rms")[1:3] == ["N·m", printed(float(torque.values[0]))]
    assert float(row(page, "M @ rms")[3]) == pytest.approx(error, rel=0.06)  # two digits
    assert row(page, "alpha @ end")[1:] == ["deg", printed(float(np.rad2deg(angle.values[0]))), "0"]
    section = result.sections["shaking"]
    assert len(section.tables) == 2
    for table in section.tables:
        wanted = [
            [cell.replace("*", "·") if isinstance(cell, str) else printed(cell) for cell in cells]
            for cells in table.cleared().rows
        ]  # fmt: skip
        assert all(cells in rows(page) for cells in wanted)
    told = {cell for cells in rows(page) for cell in cells}
    assert "[?]" not in body(page)
    assert all(printed(float(series.values[0])) in told for series in section.numbers.values())
    assert all(html.escape(remark) in page for remark in section.remarks)


def test_a_report_on_a_folder_is_that_on_its_result(shaken: Any, shaken_page: str, tmp_path: Path) -> None:
    """Sections too; the digest is that of what was solved, and not of the copy in the folder."""
    folder = shaken.save(tmp_path / "out", plots=False)
    (tmp_path / "out" / "summary.json").write_text(
        (folder / "summary.json").read_text().replace('"pinocchio": "', '"pinocchio": "0.0.')
    )
    direct, read = shaken_page, report(folder).html
    assert shaken.digest() in read
    assert "pinocchio 0.0." in read
    assert "pinocchio 0.0." not in direct
    assert any(cells[0] == "1" for cells in rows(direct))  # a harmonic of the section
    assert rows(direct) == rows(read)


def test_it_needs_no_other_file_and_no_network(shaken_page: str) -> None:
    page = shaken_page
    assert page.count("<iframe") == 1
    outside = re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?([^"\')\s>]+)', body(page))
    assert all(link.startswith("#") for link in outside), outside
    assert set(re.findall(r"https?://[^\"'\s<]+", body(page))) <= {
        "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink",
    }  # fmt: skip


EVIL = "</style></td></svg>--><script>alert(1)</script>"


def test_names_and_titles_are_text(scenario: Callable[..., Any]) -> None:
    changes = (("[M,", f'["{EVIL}", M,'), ("A pendulum", EVIL))
    given = scenario("statics", f'symbols: {{"{EVIL}": 2*alpha}}\n', *changes).run()
    made = report(given, title=EVIL)
    page = body(made.html)
    assert "<script>alert" not in page
    assert page.count("</style>") == page.count("<style")
    assert page.count("<script") == 1  # that which says that the page is there
    assert html.escape(EVIL) in made.html


def test_a_title_cannot_leave_its_string_in_the_style(scenario: Callable[..., Any]) -> None:
    page = report(scenario("statics").run(), title='"} body { display: none } x { content: "').html
    (content,) = re.findall(r"@bottom-left \{ content: \"([^\"]*)\"", page)
    assert re.fullmatch(r"(\\[0-9a-f]{6})+", content)
    assert (
        bytes(int(code, 16) for code in content.split("\\")[1:]).decode() == '"} body { display: none } x { content: "'
    )


def test_what_forbids_the_use_of_the_numbers_stands_first(scenario: Callable[..., Any]) -> None:
    wrong = "expect:\n- {quantity: alpha, at: start, value: 31 deg, source: a wrong value}\n"
    page = report(scenario("forward", wrong).run()).html
    (box,) = re.findall(r'<ul class="box warnings">(.*?)</ul>', page, re.S)
    assert "global error of this motion was not estimated" in box
    assert "MISS forward: alpha at t = 0 s: computed 30 deg, expected 31 deg, difference 3.23 %" in box
    assert "box merits" not in body(page).partition("<body>")[2]
    assert page.index('box warnings">') < page.index("<h3>Question")


def test_errors_stand_beside_their_numbers(scenario: Callable[..., Any]) -> None:
    right = "expect:\n- {quantity: alpha, at: start, value: 30 deg, source: the start}\n"
    result = scenario("forward", right).verified()
    page = report(result).html
    for name, bound in result.errors.items():
        assert row(page, name)[-1] == f"{bound:.1e}"
    (box,) = re.findall(r'<ul class="box merits">(.*?)</ul>', page, re.S)
    assert f"{result.error:.1e}" in box
    assert "All 1 entries of the answer key are met" in box


@pytest.mark.slow
def test_it_is_printed_on_pages_of_a4_with_text(shaken: Any, tmp_path: Path) -> None:
    try:
        chromium()
    except PinarmError as error:
        if os.environ.get("CI"):
            pytest.fail(f"CI must have a browser: {error}")
        pytest.skip("there is no Chromium")
    report(shaken, tmp_path / "report.pdf")
    pdf = pypdf.PdfReader(io.BytesIO((tmp_path / "report.pdf").read_bytes()))
    assert len(pdf.pages) >= 3
    for page in pdf.pages:
        assert [float(x) * 25.4 / 72 for x in (page.mediabox.width, page.mediabox.height)] == pytest.approx(
            [210.0, 297.0], abs=0.5
        )
    text = "\n".join(page.extract_text() for page in pdf.pages)
    for entry in shaken.summary()["outputs"].values():
        assert printed(entry["max"]) in text
    assert shaken.digest() in text.replace("\n", "")
    assert "Provenance" in text  # the last part is there too


def test_a_student_gets_no_expected_and_no_published_value(scenario: Callable[..., Any], tmp_path: Path) -> None:
    key = (
        "expect:\n- {quantity: M, at: start, value: 4.321 N*m, published: 9.876 N*m, source: the secret}\n"
        "- {quantity: alpha, at: end, value: 1 rad, source: the secret}\n"
    )
    result = scenario("inverse", "numbers: [M @ rms]\n" + key).run()
    folder = result.save(tmp_path / "out", plots=False)
    secrets = ("4.321", "9.876", "the secret", "MISS", "published")
    teacher = body(report(result).html)
    assert all(secret in teacher for secret in secrets)
    for source in (result, folder):
        page = body(report(source, student=True).html)
        assert not [secret for secret in secrets if secret in page]
        assert row(page, "M @ rms") == row(teacher, "M @ rms")


def test_a_student_reads_a_drawing_in_the_units_of_the_run(tmp_path: Path) -> None:
    """Parameters as the run has them, a slide without limits, and the loads of a joint without keys."""
    (tmp_path / "slide.yaml").write_text(
        "pinarm: 1\nparameters: {l: 200 mm, slope: 30 deg}\nplanar:\n  points: {O: [0, 0], E: [l, 0], A: [0, 0]}\n"
        "  ground: [O, E]\n  links: {block: {points: [A], mass: 1 kg}}\n  sliders: {x: {link: block, along: [O, E]}}\n"
    )
    document = {
        "pinarm": 1, "mechanism": "slide.yaml", "arguments": {"l": "300 mm"}, "outputs": ["joint.x.effort"],
        "problem": {"kind": "statics", "hold": {"x": "0 mm"}}, "units": {"length": "cm"},
        "loads": {"joints": {"x": {}}},
    }  # fmt: skip
    (tmp_path / "held.json").write_text(json.dumps(document))
    page = body(report(pinarm.run(tmp_path / "held.json"), student=True).html)
    assert "l = 30 cm, slope = 30 deg" in page
    assert "joints (x)" in page
    assert row(page, "x", "prismatic")[-1] == "unlimited"


def test_a_sweep_has_a_report_of_its_own(scenario: Callable[..., Any], tmp_path: Path) -> None:
    """From Python and from its folder alike: statistics, the values of all cases, a picture of each result."""
    swept = pinarm.sweep(
        scenario("statics"), {"problem.over.pivot.to": "90:180:3 deg"}, results=["M @ max", "alpha @ end"], workers=1
    )
    folder = swept.save(tmp_path / "out", plots=False)
    pages = [body(report(source, title="T").html) for source in (swept, folder)]
    for page in pages:
        assert row(page, "M @ max")[2] == printed(float(swept["M @ max"].values.min()))
        assert [float(row(page, str(case))[1]) for case in range(3)] == [90.0, 135.0, 180.0]
        assert float(row(page, "1")[3]) == pytest.approx(np.rad2deg(swept["alpha @ end"].values[1]), rel=5e-4)
        assert page.count("<figure") == 2
    assert rows(pages[0]) == rows(pages[1])
