"""The picture of the architecture is that of the imports as they are, and what pages name exists."""

import re
from collections import Counter
from pathlib import Path

import pytest
from architecture import PICTURE, Package, circles_cut, picture, reached, reduced
from layered_drawing import _spaced

import pinarm

pytestmark = pytest.mark.house

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "CONTRIBUTING.md", "docs/architecture.md")


@pytest.fixture
def package(tmp_path: Path) -> Package:
    """Two layers: engine with two rooms and modules of its own above and below them, and input."""
    texts = {
        "__init__": "", "errors": "", "engine/__init__": '"""Layer 2."""', "input/__init__": "",
        "engine/mechanism": "from pinarm.engine.dynamics import equation",
        "engine/source": "from pinarm.input.units import unit",
        "engine/dynamics/__init__": '"""Solves ``M a = f``. More of it."""',
        "engine/dynamics/equation": "import pinarm.errors\ndef f(): from pinarm.engine.constraints.rows import rows",
        "engine/constraints/__init__": '"""Rows."""',
        "engine/constraints/rows": "from pinarm.engine.source import Source\nimport pinarm.input.units\nimport numpy\n"
        "if TYPE_CHECKING:\n    from pinarm.engine.mechanism import Mechanism",
        "input/units": "",
    }  # fmt: skip
    for name, text in texts.items():
        file = tmp_path / "pinarm" / f"{name}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    return Package(tmp_path / "pinarm")


def test_the_picture_shows_the_imports_as_they_are() -> None:
    def without_places(svg: str) -> str:  # they may round otherwise where another Python sums otherwise
        return re.sub(r"-?\d+\.\d", "", svg)

    drawn = picture(Package(Path(pinarm.__file__).parent))
    assert without_places(PICTURE.read_text(encoding="utf-8")) == without_places(drawn), (
        "docs/architecture.svg is stale: run 'python docs/architecture.py' and look at it"
    )


def test_imports_are_found_wherever_they_stand(package: Package) -> None:
    assert package.imports["pinarm.engine.mechanism"] == {"pinarm.engine.dynamics.equation"}
    assert package.imports["pinarm.engine.dynamics.equation"] == {"pinarm.engine.constraints.rows", "pinarm.errors"}
    assert package.imports["pinarm.engine.constraints.rows"] == {"pinarm.engine.source", "pinarm.input.units"}


def test_modules_of_a_layer_are_one_room_above_its_rooms_and_one_below(package: Package) -> None:
    assert package.arrows == Counter({
        ("engine", "engine/dynamics"): 1, ("engine/dynamics", "engine/constraints"): 1,
        ("engine/constraints", "engine (lower)"): 1, ("engine/constraints", "input"): 1, ("engine (lower)", "input"): 1,
    })  # fmt: skip
    assert package.text("engine") == "mechanism"
    assert package.text("engine (lower)") == "source"
    assert package.text("engine/dynamics") == "Solves M a = f"


def test_arrows_that_follow_from_others_are_left_out(package: Package) -> None:
    arrows = set(package.arrows)
    assert arrows - reduced(arrows) == {("engine/constraints", "input")}


def test_a_circle_is_cut_where_the_fewest_imports_are() -> None:
    counts = Counter({("a", "b"): 3, ("b", "c"): 2, ("c", "a"): 1, ("a", "d"): 1})
    down, back = circles_cut(counts)
    assert back == {("c", "a")}
    assert down == set(counts) - back
    assert reached("a", down) == {"b", "c", "d"}


def test_boxes_of_a_row_are_nearest_to_where_they_want_to_be() -> None:
    """Two that want the same place stand a gap apart around it; a third that is far away stays there."""
    first, second, third = _spaced([300.0, 300.0, 700.0], [100.0, 100.0, 100.0])
    assert (first + second) / 2 == pytest.approx(300.0)
    assert second - first == pytest.approx(116.0)
    assert third == pytest.approx(700.0)


@pytest.mark.parametrize("page", PAGES)
def test_files_and_links_that_a_page_names_exist(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    links = [(ROOT / page).parent / link for link in re.findall(r"\]\((?!https?:|#)([^)#]+)[^)]*\)", text)]
    files = [ROOT / name for name in re.findall(r"`((?:pinarm|tests|docs|benchmarks|models|scenarios)/[\w./]+)`", text)]
    assert links
    assert [str(path) for path in [*links, *files] if not path.exists()] == []
