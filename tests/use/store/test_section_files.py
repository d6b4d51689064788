"""Sections come back from a file as they were."""

import math
from pathlib import Path

import numpy as np
import pytest

from pinarm.engine.series import Series
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.use.result.section import Curve, Graph, Section, SectionTable
from pinarm.use.store.files import SECTIONS, read_sections, sections_text

SERIES = Series("force", unit("kN"), np.array([0.1, 1e-300, -0.0]), "least multipliers")
TABLE = SectionTable("figures", "Peaks", ("", "x"), (None, unit("N*m")), [("a", 1 / 3), ("b", math.inf)])
GRAPH = Graph("path", "Path", [Curve(SERIES, SERIES, "tip", points=True)], equal=True)
SECTION = Section(
    "shaking", "Shaking", [TABLE],
    {"force.peak": Series("peak", unit("N") ** 2, np.array([2 / 3])), "open": Series("open", None, np.array([1.0]))},
    ["a remark"], [GRAPH], {"force.peak": 1e-9},
)  # fmt: skip


def test_sections_come_back_to_the_last_bit(tmp_path: Path) -> None:
    (tmp_path / SECTIONS).write_text(sections_text({"shaking": SECTION}))
    [again] = read_sections(tmp_path / SECTIONS).values()
    assert (again.key, again.title, list(again.remarks)) == (SECTION.key, SECTION.title, list(SECTION.remarks))
    assert again.tables[0].rows == SECTION.tables[0].rows
    assert again.tables[0].headings() == SECTION.tables[0].headings()
    assert again.errors == SECTION.errors
    for name, series in SECTION.numbers.items():
        assert again.numbers[name].unit == series.unit
        assert again.numbers[name].values.tolist() == series.values.tolist()
    curve = again.graphs[0].curves[0]
    assert curve.points
    assert again.graphs[0].equal
    assert curve.up.values.view(np.int64).tolist() == SERIES.values.view(np.int64).tolist()
    assert (curve.up.doubt, str(curve.up.unit)) == (SERIES.doubt, "kN")


@pytest.mark.parametrize(
    ("before", "after"),
    [("[", "{"), ('"kN"', "3]"), ('"figures"', '"../x"'), ('"path"', '"/tmp/x"'), ('"inf"', '"many"')],
)  # fmt: skip
def test_a_damaged_file_is_told(tmp_path: Path, before: str, after: str) -> None:
    text = sections_text({"shaking": SECTION})
    assert before in text
    (tmp_path / SECTIONS).write_text(text.replace(before, after, 1))
    with pytest.raises(InputError, match="holds no sections of a result"):
        read_sections(tmp_path / SECTIONS)
