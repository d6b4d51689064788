"""The picture of the architecture is that of the imports as they are, and what pages name exists."""

import re
from pathlib import Path

import pytest
from architecture import PICTURE, Package, picture

import pinarm

pytestmark = pytest.mark.house

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "CONTRIBUTING.md", "docs/architecture.md")


def test_the_picture_shows_the_imports_as_they_are() -> None:
    def without_places(svg: str) -> str:  # they may round otherwise where another Python sums otherwise
        return re.sub(r"-?\d+\.\d", "", svg)

    drawn = picture(Package(Path(pinarm.__file__).parent))
    assert without_places(PICTURE.read_text(encoding="utf-8")) == without_places(drawn), (
        "docs/architecture.svg is stale: run 'python docs/architecture.py' and look at it"
    )


@pytest.mark.parametrize("page", PAGES)
def test_files_and_links_that_a_page_names_exist(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    links = [(ROOT / page).parent / link for link in re.findall(r"\]\((?!https?:|#)([^)#]+)[^)]*\)", text)]
    files = [ROOT / name for name in re.findall(r"`((?:pinarm|tests|docs|benchmarks|models|scenarios)/[\w./]+)`", text)]
    assert links
    assert [str(path) for path in [*links, *files] if not path.exists()] == []
