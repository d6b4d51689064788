"""The site: a page and an example for every kind, and a strict build that needs no network."""

import html
import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser

import markdown
import numpy as np
import pytest
import yaml
from code_blocks import ROOT, blocks_of
from site_generator.api_page import page as api_page
from site_generator.code_breaks import with_breaks, with_columns
from site_generator.errata import PLACE, with_errata
from site_generator.families import Kinds, definitions, families
from site_generator.formulas import with_mathml
from site_generator.gallery import ENTRIES
from site_generator.key_tables import key_tables
from site_generator.kind_pages import EXAMPLES, example_of, with_kind_links
from site_generator.repository_pages import file_page, linked_files, with_plain_bars, with_site_links
from site_generator.solids import solids

import pinarm
from pinarm.use.show.replay.chromium import browser, chromium

pytestmark = pytest.mark.house


@pytest.fixture(scope="module")
def kinds() -> list[tuple[Kinds, str]]:
    """Every kind with the family that it is of."""
    return [(family, member) for family in families() for member in family.members]


def test_every_kind_has_an_example_and_every_example_is_of_a_kind(kinds):
    wanted = {example_of(family, member) for family, member in kinds}
    scenarios = {path for path in EXAMPLES.rglob("*.yaml") if "problem" in yaml.safe_load(path.read_text())}
    assert wanted == scenarios


def test_every_tag_of_the_schemas_is_a_kind_with_a_page(kinds):
    """The value of ``kind`` or ``law`` that says which structure a map is."""
    tagged = {
        (tag, name)
        for name, definition in definitions().items()
        for key in ("kind", "law")
        for tag in definition["properties"].get(key, {}).get("enum", ())
    }
    pages = {(member, family.members[member]) for family, member in kinds}
    assert len(tagged) > 55
    assert tagged - pages == set()


def test_an_example_has_the_kind_that_it_is_of(kinds):
    for family, member in kinds:
        scenario = pinarm.load(example_of(family, member))
        texts = [json.dumps(scenario.content.problem), example_of(family, member).read_text()]
        texts.append((scenario.folder / scenario.content.mechanism).read_text())
        assert any(re.search(family.sign.format(member=member), text) for text in texts), (family.name, member)


def test_every_key_of_every_kind_has_a_meaning(kinds):
    for family, member in kinds:
        if family.members[member] in definitions():
            rows = [row for row in key_tables(family.members[member]) if row.startswith("| `")]
            assert all(len(row.split(" | ")[1].strip(" |")) > 1 for row in rows), f"{family.name} {member}\n{rows}"


def test_a_table_of_keys_tells_value_unit_and_default():
    rows = key_tables("PointSpring")
    assert "| `stiffness` | Such as `2 kN/m`. | quantity in N/m | `0` |" in rows
    assert "| `between` | The links, such as `[frame, lever]`. | list of 2: text | required |" in rows
    assert any("[a law](../laws/index.md)" in row for row in key_tables("JointEffort"))
    assert any(row.startswith("### Keys of `spring rates`") for row in key_tables("Bushing"))


def test_names_in_the_table_of_kinds_are_links_where_they_are_kinds():
    table = "| forces | gravity, `wrench`, `other` |\n| drives | `wrench` |"
    assert with_kind_links(table).splitlines() == [
        "| forces | gravity, [`wrench`](kinds/forces/wrench.md), `other` |", "| drives | `wrench` |",
    ]  # fmt: skip


def test_links_to_files_of_the_repository_lead_to_their_pages():
    text = "[a](../../scenarios/gen411_arm_static.yaml) [b](../loops.md#x) [c](https://x.org) [d](../../README.md)"
    assert list(linked_files(text, "start/page.md")) == ["scenarios/gen411_arm_static.yaml"]
    assert with_site_links(text, "start/page.md") == (
        "[a](../repository/scenarios/gen411_arm_static.yaml.md) [b](../loops.md#x) [c](https://x.org) [d](../index.md)"
    )


def test_bars_in_code_of_tables_have_no_backslash():
    """Python-Markdown takes code as it stands, and does not part a table there."""
    row = "| `run A\\|B` | text `x \\| y` |"
    shown = markdown.markdown("| a | b |\n| --- | --- |\n" + with_plain_bars(row), extensions=["tables"])
    assert "<code>run A|B</code>" in shown
    assert "<code>x | y</code>" in shown
    assert with_plain_bars("a `b \\| c`") == "a `b \\| c`"


def test_files_are_shown_whole():
    shown = file_page("scenarios/gen411_arm_static.yaml")
    assert (ROOT / "scenarios/gen411_arm_static.yaml").read_text() in shown
    assert "## mechanism.yaml" in file_page("models/gen411_arm")
    assert "~~~~python" in file_page("examples/01_first_torque.ipynb")


def test_formulas_are_mathml():
    drawn = with_mathml(r'<span class="arithmatex">\(a &lt; \frac{1}{2}\)</span>')
    assert "<mfrac>" in drawn
    assert "&#x0003C;" in drawn  # the sign "less than", which is no tag
    assert "arithmatex" not in drawn


def test_dots_and_functions_of_formulas_are_set_as_by_tex():
    """A dot is an accent, not a small superscript; thin spaces part a function from its factor and its argument."""
    drawn = with_mathml(r'<div class="arithmatex">\[l\cos\varphi + \sin(a) \dot G\]</div>')
    assert re.search(r'<mover accent="true"><mi>G</mi><mo stretchy="false">&#x002D9;</mo></mover>', drawn)
    assert re.search(r"<mi>l</mi><mspace[^>]*/><mi>cos</mi><mspace[^>]*/><mi>&#x003C6;</mi>", drawn)
    assert re.search(r"<mo>&#x0002B;</mo><mi>sin</mi><mo", drawn)


def test_every_formula_is_understood_in_full():
    """What the converter does not know it leaves as it is."""
    pages = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md")]
    tex = [formula for page in pages for formula in re.findall(r"\$\$(.+?)\$\$", page)]
    assert len(tex) > 15
    drawn = [with_mathml(f'<div class="arithmatex">\\[{html.escape(formula)}\\]</div>') for formula in tex]
    assert [formula for formula in drawn if "\\" in formula] == []


def test_long_code_in_cells_may_be_divided_between_names():
    long = "body.arm_1.velocity.z/body.arm_2.norm + 0.5"
    shown = with_breaks(f"<td><code>{long}</code><code>a.b</code></td><p><code>{long}</code></p>")
    broken = "body.<wbr>arm_1.<wbr>velocity.<wbr>z/<wbr>body.<wbr>arm_2.<wbr>norm + 0.5"
    assert shown == f"<td><code>{broken}</code><code>a.b</code></td><p><code>{long}</code></p>"


def test_lines_of_printed_tables_are_not_broken() -> None:
    block = '<div class="language-text highlight"><pre><span></span><code>a sentence,\n{}\n</code></pre></div>'
    for row in ("rank  motor  ratio  verdict", "┃ a ┃"):
        assert with_columns(block.format(row)) == block.format(f'<span class="columns">{row}</span>')
    assert with_columns(block.format("accuracy: a  b")) == block.format("accuracy: a  b")


def test_every_misprint_of_the_answer_keys_is_listed():
    entries = [
        entry
        for path in (ROOT / "scenarios").glob("*.yaml")
        for entry in yaml.safe_load(path.read_text()).get("expect", [])
    ]
    wrong = [entry for entry in entries if entry.get("verdict") in ("misprint", "model_error")]
    rows = with_errata(PLACE).splitlines()[2:]
    assert len(rows) == len(wrong) > 25
    assert (ROOT / "docs/misprints.md").read_text().count(PLACE) == 1


def test_the_api_has_everything_that_is_public():
    assert set(re.findall(r"heading: pinarm\.(\w+),", api_page())) == set(pinarm.__all__)


def test_the_version_to_cite_is_the_version():
    assert f"version = {{{pinarm.__version__}}}" in (ROOT / "docs/cite.md").read_text()
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == pinarm.__version__


class Loaded(HTMLParser):
    """What a page loads when it is opened: not what it links to."""

    def __init__(self):
        super().__init__()
        self.urls = []

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        loads = {"script": "src", "img": "src", "iframe": "src", "source": "src"}
        if tag == "link" and given.get("rel") in ("stylesheet", "icon", "preload", "preconnect", "modulepreload"):
            self.urls.append(given["href"])
        elif tag in loads and given.get(loads[tag]):
            self.urls.append(given[loads[tag]])


def test_what_a_page_loads_is_seen():
    loaded = Loaded()
    loaded.feed('<a href="https://x.org"></a><script src="https://x.org/a.js"></script><link rel="icon" href="b.svg">')
    assert loaded.urls == ["https://x.org/a.js", "b.svg"]


@pytest.mark.slow
def test_the_site_is_built_strictly_and_works_without_network(tmp_path, kinds):
    """Building it solves the example of every kind. A search in it, opened as files, finds a page."""
    site = tmp_path / "site"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(site)], cwd=ROOT,
                          env=environment, capture_output=True, text=True, timeout=1200)  # fmt: skip
    assert done.returncode == 0, done.stderr
    for family, member in kinds:
        text = (site / f"kinds/{family.name}/{member}.html").read_text(encoding="utf-8")
        assert all(f'src="{member}_{name}.svg"' in text for name in family.pictures)
    assert len(ENTRIES) >= 4
    for page in set(site.rglob("*.html")) - {site / "404.html"}:  # which only a server shows
        loaded = Loaded()
        loaded.feed(page.read_text(encoding="utf-8"))
        assert len(loaded.urls) > 5 or page.parent.name == "gallery"  # whose replays load nothing
        assert [url for url in loaded.urls if url.startswith(("http", "//"))] == [], page
        broken = [url for url in loaded.urls if not url.startswith("data:") and not (page.parent / url).exists()]
        assert broken == [], page
    search_offline(site)


def search_offline(site):
    """Search in the opened page; skipped where there is no Chromium."""
    try:
        chromium()
    except pinarm.PinarmError:
        return
    ready = "<script>document.documentElement.dataset.ready = 'yes'</script></body>"
    index = (site / "index.html").read_text(encoding="utf-8").replace("</body>", ready)
    (site / "ready.html").write_text(index, encoding="utf-8")
    with browser() as page:
        page.open(site / "ready.html", "?q=torque_speed")
        found = "[...document.querySelectorAll('.md-search-result__link')].map((link) => link.href).join(' ')"
        page.evaluate(f"(async () => {{ while (!({found})) await new Promise((done) => setTimeout(done, 50)); }})()")
        assert "kinds/forces/torque_speed.html" in page.evaluate(found)
        asked = [event["params"]["request"]["url"] for event in page.events
                 if event["method"] == "Network.requestWillBeSent"]  # fmt: skip
        assert {url.split(":")[0] for url in asked} <= {"file", "data", "about", "blob"}


def test_a_body_on_a_cable_is_drawn_with_it():
    """At the start a straight line in blue, at the end one in orange."""
    picture = solids(pinarm.run(EXAMPLES / "loop_joints" / "cable.yaml"))
    lines = re.findall(r'<path d="M [^"]*L [^"LMCQz]*"[^>]*style="fill: none; stroke: (#\w+)', picture)
    assert [lines.count(colour) for colour in ("#0072b2", "#d55e00")] == [1, 1]


def test_the_drawing_of_the_first_steps_is_of_their_mechanism(tmp_path):
    (block,) = (block for block in blocks_of(ROOT / "docs/start/designer.md") if block.title == "flap/mechanism.yaml")
    (tmp_path / "mechanism.yaml").write_text(block.text)
    pinarm.explain(tmp_path / "mechanism.yaml").draw(tmp_path / "flap.svg")
    fresh, shown = ((folder / "flap.svg").read_text(encoding="utf-8") for folder in (tmp_path, ROOT / "docs/start"))
    texts, wanted = (re.findall(r'<text[^>]*? x="(.*?)" y="(.*?)".*?>(.*?)</text>', svg) for svg in (fresh, shown))
    assert [text for *_, text in texts] == [text for *_, text in wanted] != []
    places, others = (np.array([place for *place, _ in found], float) for found in (texts, wanted))
    assert places == pytest.approx(others, abs=0.5)  # points, by which fonts of other versions may differ
