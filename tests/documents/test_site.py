"""The site: a page and an example for every kind, and a strict build that needs no network."""

import html
import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
import yaml
from code_blocks import ROOT, blocks_of
from keys_page import PAGE
from keys_page import page as keys_page
from site_generator.api_page import pages as api_pages
from site_generator.errata import PLACE, with_errata
from site_generator.families import Kinds, definitions, families
from site_generator.formulas import with_mathml
from site_generator.gallery import ENTRIES
from site_generator.key_tables import key_tables
from site_generator.kind_pages import EXAMPLES, example_of
from site_generator.repository_pages import linked_files, with_site_links

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


def test_links_to_files_of_the_repository_lead_to_their_pages():
    text = "[a](../../scenarios/gen411_arm_static.yaml) [b](../loops.md#x) [c](https://x.org) [d](../../README.md)"
    assert list(linked_files(text, "start/page.md")) == ["scenarios/gen411_arm_static.yaml"]
    assert with_site_links(text, "start/page.md") == (
        "[a](../repository/scenarios/gen411_arm_static.yaml.md) [b](../loops.md#x) [c](https://x.org) [d](../index.md)"
    )


def test_every_formula_is_understood_in_full():
    """What the converter does not know it leaves as it is."""
    pages = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md")]
    tex = [formula for page in pages for formula in re.findall(r"\$\$(.+?)\$\$", page)]
    assert len(tex) > 15
    drawn = [with_mathml(f'<div class="arithmatex">\\[{html.escape(formula)}\\]</div>') for formula in tex]
    assert [formula for formula in drawn if "\\" in formula] == []


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
    content = {made.place: made.content for made in api_pages()}
    assert set(re.findall(r"heading: pinarm\.(\w+),", "".join(content.values()))) == set(pinarm.__all__)
    (members,) = re.findall(r"members: \[(.*)\]", content["api/Result.md"])
    assert {"plot", "number", "figures"} <= set(members.split(", "))


def test_the_page_of_keys_is_that_of_the_docstrings():
    assert PAGE.read_text(encoding="utf-8") == keys_page(), "write it anew: python docs/keys_page.py"


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


def test_the_drawing_of_the_first_steps_is_of_their_mechanism(tmp_path):
    (block,) = (block for block in blocks_of(ROOT / "docs/start/designer.md") if block.title == "flap/mechanism.yaml")
    (tmp_path / "mechanism.yaml").write_text(block.text)
    pinarm.explain(tmp_path / "mechanism.yaml").draw(tmp_path / "flap.svg")
    fresh, shown = ((folder / "flap.svg").read_text(encoding="utf-8") for folder in (tmp_path, ROOT / "docs/start"))
    texts, wanted = (re.findall(r'<text[^>]*? x="(.*?)" y="(.*?)".*?>(.*?)</text>', svg) for svg in (fresh, shown))
    assert [text for *_, text in texts] == [text for *_, text in wanted] != []
    places, others = (np.array([place for *place, _ in found], float) for found in (texts, wanted))
    assert places == pytest.approx(others, abs=0.5)  # points, by which fonts of other versions may differ
