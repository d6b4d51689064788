"""The graph of links: every body and joint has its name in it, and its count gives the degree of hyperstatism."""

from pathlib import Path

import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.use.show.structure import link_graph

MODELS = Path(pinarm.__file__).parents[1] / "models"


def test_every_body_and_joint_is_in_it() -> None:
    [axis] = link_graph(pinarm.Mechanism.load(MODELS / "planetary_gear" / "mechanism.yaml")).axes
    texts = [text.get_text() for text in axis.texts]
    assert {"ground", "arm_bar", "planet_wheel", "ring_wheel", "sun_wheel", "inside", "outside", "planet"} <= set(texts)
    assert texts.count("revolute") == 4
    assert texts.count("gear") == 2


@pytest.mark.parametrize(
    ("name", "counted"),
    [
        ("manipulator", "1 + 12 - 9 = 4"), ("olive_vibrator", "2 + 6 - 8 = 0"), ("planetary_gear", "2 + 0 - 4 + 2 = 0"),
        ("two_four_bars", "1 + 12 - 7 = 6"), ("bicycle", "3 + 12 - 15 = 0"), ("screw_jack", "1 + 0 - 2 + 1 = 0"),
    ],
)  # fmt: skip
def test_the_degree_is_counted_line_by_line(name: str, counted: str) -> None:
    found = pinarm.explain(MODELS / name / "mechanism.yaml")
    assert counted in str(found)
    assert counted.endswith(f"= {found.mobility.degree}")


def test_the_command_draws_it(tmp_path: Path) -> None:
    file = tmp_path / "graph.svg"
    path = str(MODELS / "manipulator" / "mechanism.yaml")
    assert main(["explain", path, "--draw", str(file), "--graph"]) == 0
    assert "link_3" in file.read_text(encoding="utf-8")
    assert "ground" in file.read_text(encoding="utf-8")
