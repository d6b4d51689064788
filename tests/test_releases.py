"""The version is one, wherever it is written."""

import re
from pathlib import Path

import yaml

import pinarm

ROOT = Path(__file__).parents[1]


def test_the_changelog_and_the_citation_have_the_version_and_its_day() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = re.findall(r"^## (\d\S*) - (\d{4}-\d\d-\d\d)$", changelog, re.MULTILINE)
    assert versions[0] == (pinarm.__version__, citation["date-released"])
    assert citation["version"] == pinarm.__version__


def test_every_heading_of_the_changelog_stands_once_in_its_version() -> None:
    parts = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    for part in parts:
        headings = re.findall(r"^### (\w+)$", part, re.MULTILINE)
        assert len(headings) == len(set(headings))
        entries = re.findall(r"^- (.+)$", part, re.MULTILINE)
        assert len(entries) == len(set(entries)) > 0


def test_types_come_with_the_package() -> None:
    assert (Path(pinarm.__file__).parent / "py.typed").is_file()
