"""French documents: the catalogue has every text and no other, numbers take a comma, no English word is left."""

import ast
import csv
import html
import json
import re
import string
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.language import catalogue, decimals, said, spoken, told
from pinarm.problems import KINDS
from pinarm.use.method.isolation import WORDS
from pinarm.use.method.torsors import HEADING, LETTERS
from pinarm.use.report.chapter import LABELS, REMARK, TITLE
from pinarm.use.result.measures import COSTS, MEASURES
from pinarm.use.show.drawings import IN_PLANE, LAW, PROJECTED, sketch
from pinarm.use.show.picture import ERRORS, OPEN
from pinarm.use.show.replay.page import ARROWS
from pinarm.use.show.text import report as terminal
from pinarm.use.study.answers.check import LOOKS
from pinarm.use.study.lab import FACTOR_IN, FACTORS, PARTLY, SIGN_IN

PACKAGE = Path(pinarm.__file__).parent
ROOT = PACKAGE.parent
FRENCH = catalogue("fr")
PAGE = (PACKAGE / "use/show/replay/page/page.html").read_text()
TREES = [ast.parse(path.read_text()) for path in PACKAGE.rglob("*.py")]
TABLES = (
    WORDS.values(), (kind.question for kind in KINDS.values()), KINDS, LABELS.values(), MEASURES, MEASURES.values(),
    COSTS, ERRORS.values(), ARROWS.values(), FACTORS, LETTERS, LOOKS.values(),
    (HEADING, TITLE, REMARK, IN_PLANE, LAW, PROJECTED, OPEN, SIGN_IN, FACTOR_IN, PARTLY),
    re.findall(r"\[\[([^0-9]*?)\]\]", PAGE),
)  # fmt: skip
"""Texts that are translated by a name of the table that they are in."""


def asked() -> Iterator[str]:
    """Yield the texts at the calls that translate, and of the tables."""
    for node in (node for tree in TREES for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args):
        name, first = getattr(node.func, "id", ""), node.args[0]
        if name in ("said", "told", "part"):
            ends = (first.body, first.orelse) if isinstance(first, ast.IfExp) else (first,)
            yield from (end.value for end in ends if isinstance(end, ast.Constant))
        elif name == "map" and getattr(first, "id", "") == "said" and isinstance(node.args[1], ast.Tuple):
            yield from (each.value for each in node.args[1].elts if isinstance(each, ast.Constant))
    yield from (text for table in TABLES for text in table)


def strings() -> Iterator[str]:
    """Yield all texts of the package, and names of keys, which reports write as words."""
    for node in (node for tree in TREES for node in ast.walk(tree)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        elif isinstance(node, ast.AnnAssign | ast.keyword | ast.FunctionDef):
            name = node.target if isinstance(node, ast.AnnAssign) else node
            yield str(getattr(name, "id", "") or getattr(name, "arg", "") or getattr(name, "name", ""))
    yield PAGE


def places(text: str) -> list[str]:
    return sorted({name for _, name, _, _ in string.Formatter().parse(text) if name})


def test_the_catalogue_has_every_text() -> None:
    assert {text for text in asked() if text} - FRENCH.keys() == set()


def test_the_catalogue_has_no_text_that_is_written_nowhere() -> None:
    """Texts of several pieces are looked for piece by piece."""
    written = "\n".join(text.replace("_", " ").lower() for text in strings())
    pieces = {(text, piece.strip()) for text in FRENCH for piece in APART.split(text.lower().replace("_", " "))}
    assert {(text, piece) for text, piece in pieces if piece not in written} == set()


APART = re.compile(
    r"\{[^{}]*\}|[:;,] |^[=~!x] |[()%±\[\]]| g | (?:of|to|in) |\b(?:largest|smallest)\b|the (?:origin of the )?world"
)
"""What is between the pieces that texts are put together of."""


def test_translations_fill_the_same_placeholders() -> None:
    assert {text for text, french in FRENCH.items() if places(text) != places(french)} == set()
    assert len(FRENCH) == (PACKAGE / "locale/fr.po").read_text().count('\nmsgid "') - 1  # none twice, none empty


def test_french_marks_have_their_spaces() -> None:
    """No-break spaces before double marks, and inside of quotation marks."""
    spaced = {text for text, french in FRENCH.items() if re.search(r" [:;?!»%](?!\w)|« ", french) and text[1:2] != " "}
    assert spaced == set()


def test_numbers_take_a_comma_and_versions_do_not() -> None:
    with pinarm.writing("fr"):
        assert decimals("-1.5 N, 2.0e-07, 3.11.2, link1.5, 12.") == "-1,5 N, 2,0e-07, 3.11.2, link1.5, 12."
        assert (
            said("at {parameter} = {value:.6g} {unit}", parameter="q1.x", value=0.25, unit="s") == "pour q1.x = 0,25 s"
        )
        assert told("condition of the masses: 1.5") == "conditionnement des masses\u00a0: 1,5"
    assert spoken() == "en"
    assert decimals("1.5") == "1.5"


def test_another_language_is_refused() -> None:
    with pytest.raises(InputError, match="'de'"), pinarm.writing("de"):
        pass


ENGLISH = re.compile(
    r"\b(the|of|and|with|is|are|was|not|at|in the|by|for|from|to|no|moment about|body|joint|which|how|its|than|"
    r"largest|least|value|force on|drive|error|weight|right|answer|run|rows?)\b",
    re.IGNORECASE,
)
"""Words of English texts; names of quantities have dots in them."""

SCENARIOS = ("gen411_arm_dynamic", "slider_crank_bearings", "four_bar_shaking", "gen411_arm_modes")


def words(page: str) -> str:
    """Return the texts of a page without names of quantities, formulas, files and the user's texts."""
    page = re.sub(r"<(script|style)\b.*?</\1>|<iframe.*?</iframe>|<dl>.*?</dl>|<!--.*?-->", " ", page, flags=re.S)
    shown = html.unescape(re.sub(r"<[^<>]*>", " | ", page))
    return re.sub(r"\S*[\w*](?:[._*@/=]\w\S*)|@ \w+|'[^']*'", " ", shown)


def english(page: str, *own: str) -> set[str]:
    """Return the lines of a page with English words, without the user's own texts."""
    for text in sorted(filter(None, own), key=len, reverse=True):
        page = page.replace(html.escape(text), " ")
    return {line.strip() for line in re.split(r"\||\n", words(page)) if ENGLISH.search(line)}


@pytest.mark.parametrize("name", SCENARIOS)
def test_no_english_word_is_left_in_a_report(name: str) -> None:
    result = pinarm.run(ROOT / f"scenarios/{name}.yaml", {"lang": "fr"})
    own = {result.content.title, result.trajectory.mechanism.title, *(entry.source for entry in result.content.expect)}
    notes = {told(note) for note in result.notes()}
    for student in (False, True):
        page = pinarm.report(result, student=student).html
        assert '<html lang="fr">' in page
        assert english(page, *own, *notes) == set()
    assert "Rapport de simulation" in page
    assert "Report on a simulation" in pinarm.report(result, lang="en").html
    assert "accuracy: relative residuals" in terminal(result)


def test_no_english_word_is_left_in_a_replay_a_sketch_and_a_plot() -> None:
    result = pinarm.run(ROOT / "scenarios/gen411_arm_dynamic.yaml", {"lang": "fr"})
    page = result.replay(traces=["com"], arrows=["all"]).html
    scene = json.loads(re.search(r'id="scene">(.*?)</script>', page, re.S)[1])  # type: ignore[index]
    attributes = " | ".join(re.findall(r'title="([^"]*)"', page))
    title = result.content.title
    assert english(f"{page} | {attributes} | {' | '.join(entry['text'] for entry in scene['legend'])}", title) == set()
    assert scene["mark"] == ","
    drawn = [result.plot(), sketch(result, titled=False), result.sketch(forces=True)]
    assert [english(picture.svg(), title) for picture in drawn] == [set()] * 3
    assert ",5" in drawn[0].svg()
    assert "début" in drawn[1].svg()


def test_numbers_of_a_notebook_are_french() -> None:
    result = pinarm.run(ROOT / "scenarios/manipulator_motion.yaml", {"lang": "fr"})
    page = html.unescape(result._repr_html_())
    assert '<html lang="fr">' in page
    assert "-39,99921" in page
    assert "en t" in page


def test_torsors_and_isolations_are_written_in_french() -> None:
    path = ROOT / "scenarios/gen411_arm_dynamic.yaml"
    french, plain = pinarm.run(path, {"lang": "fr"}), pinarm.run(path)
    torsor, isolation = french.torsor("B"), french.isolate("C_B", "phi=0 deg")
    assert str(torsor).startswith("torseur statique de B en B, axes de bâti")
    assert "résultante" in torsor._repr_html_()
    assert "isoler BA\u00a0: théorème du moment dynamique en B" in str(isolation)
    assert f"{isolation.value:.9g}".replace(".", ",") in str(isolation)
    assert english(str(isolation), french.trajectory.mechanism.title) == set()
    assert str(plain.isolate("C_B", "phi=0 deg")).startswith("Two-rod arm: one isolation gives C_B")  # not inherited
    with pinarm.writing("fr"):
        chain = plain.scenario.mechanism.isolate("C_B")
    assert "un seul isolement" in str(chain)  # as it was made


def test_the_command_line_says_the_language(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pinarm.cli.main import main

    assert main(["explain", str(ROOT / "models/gen411_arm/mechanism.yaml"), "--for", "C_B", "--lang", "fr"]) == 0
    assert "isoler" in capsys.readouterr().out
    assert (
        main(["lab", str(ROOT / "scenarios/gen411_arm_static.yaml"), "-o", str(tmp_path / "a.ipynb"), "--lang=fr"]) == 0
    )
    assert "{'lang': 'fr'}" in (tmp_path / "a.ipynb").read_text()


def test_a_sheet_asks_and_judges_in_french(tmp_path: Path) -> None:
    path = ROOT / "scenarios/gen411_arm_static.yaml"
    sheet = pinarm.Sheet(path, {"lang": "fr"})
    assert all(english(question) == set() for question in sheet.questions)
    assert sheet.check(2, "1,4715 N*m") == "Exact."
    assert (
        sheet.check(1, "0,5*2*g*l2*cos(phi)*(m_A + m_BA/2)")
        == ("Exact pour ces valeurs, mais pas pour d'autres\u00a0: un nombre figure à la place d'un symbole.")
        or sheet.check(1, "0,5*2*g*l2*cos(phi)*(m_A + m_BA/2)") == "Exact."
    )
    assert "facteur 2" in sheet.check(2, "2,943 N*m")
    assert "signe" in sheet.check(2, "-1,4715 N*m")
    assert pinarm.Sheet(path).check(2, "1.4715 N*m") == "Right."
    sheet_file = pinarm.lab(path, tmp_path / "sheet.ipynb", {"lang": "fr"})
    cells = ["".join(cell["source"]) for cell in json.loads(sheet_file.read_text())["cells"]]
    assert english(" | ".join(cells[2::2])) == set()


def test_csv_files_have_semicolons_and_the_result_is_restored(tmp_path: Path) -> None:
    scenario = pinarm.load(ROOT / "docs/kind_examples/assessments/shaking.yaml", {"csv": "semicolons"})
    result = scenario.run()
    folder = result.save(tmp_path / "result", plots=False)
    heading, *lines = csv.reader((folder / "trajectory.csv").read_text().splitlines(), delimiter=";")
    series = result[heading[1].partition(" [")[0]]
    read = np.array([float(line[1].replace(",", ".")) for line in lines])
    assert np.array_equal(read, result.presentation.written(series).values)
    assert "." not in lines[1][1]
    assert ";" in (folder / "shaking_figures.csv").read_text()
    again = pinarm.restore(folder)
    assert np.array_equal(again[series.name].values, series.values)
    assert again.presentation.csv == "semicolons"


def test_names_of_a_user_are_no_words(tmp_path: Path) -> None:
    """A link called ``error`` and a title ``Answers`` stay as they are."""
    text = (ROOT / "docs/kind_examples/assessments/loads.yaml").read_text()
    scenario = tmp_path / "answers.yaml"
    scenario.write_text("""pinarm: 1
title: Answers
mechanism:  mechanism.yaml
lang: fr
problem: {kind: statics, hold: {pin: 30 deg}}
outputs: [joint.pin.effort]
loads: {joints: {pin: {}}}
""")
    (tmp_path / "mechanism.yaml").write_text("""pinarm: 1
title: Mass
planar:
  points: {pin: [0, 0], error: [1 m, 0]}
  ground: [pin]
  links: {weight: {points: [pin, error], mass: 1 kg}}
""")
    page = pinarm.report(pinarm.run(scenario)).html
    assert text and "<h1>Answers</h1>" in page
    assert '<td class="text whole">weight</td>' in page
