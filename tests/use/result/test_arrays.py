"""Results that are no columns over the rows: the same numbers, names and units from a folder and another process."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.engine.labelled_array import LabelledArray
from pinarm.errors import InputError
from pinarm.input.units import unit
from pinarm.records import replace

SHAPES = LabelledArray(np.array([[1.0 + 2.0j, np.nan], [-0.5j, 3.0]]), ["pivot", "slide"], ["mode 1", "mode 2"],
                       [unit("rad"), unit("m")], [unit("1"), None])  # fmt: skip
STIFFNESS = LabelledArray(np.array([[20.0]]), ["pivot"], ["pivot"], [unit("N*m")], [unit("1/rad")])


def same(one: LabelledArray, two: LabelledArray) -> bool:
    units = [[str(x) for x in (*table.row_units, *table.column_units)] for table in (one, two)]
    names = [[*table.rows, *table.columns] for table in (one, two)]
    return (
        bool(np.array_equal(one.values, two.values, equal_nan=True)) and units[0] == units[1] and names[0] == names[1]
    )


def test_arrays_come_back_from_folders_and_processes(scenario: Callable[..., Any], folder: Path) -> None:
    result = scenario("statics").run()
    result = replace(result, outcome=replace(result.outcome, arrays={"shapes": SHAPES, "stiffness": STIFFNESS}))
    for again in (pinarm.restore(result.save(folder / "out", plots=False)), pickle.loads(pickle.dumps(result))):
        assert list(again.arrays) == ["shapes", "stiffness"]
        assert all(same(again.arrays[name], table) for name, table in result.arrays.items())
    with np.load(folder / "out" / "trajectory.npz") as stored:
        assert np.array_equal(stored["state.array.0.values"], SHAPES.values, equal_nan=True)


def test_entries_have_names_and_units() -> None:
    assert SHAPES.entry("pivot", "mode 1") == 1.0 + 2.0j
    assert (str(SHAPES.unit(1, 0)), SHAPES.unit(0, 1)) == ("m", None)
    assert STIFFNESS.unit(0, 0).dimension == unit("N*m/rad").dimension  # type: ignore[union-attr]
    with pytest.raises(InputError, match="no 'mode 3'"):
        SHAPES.entry("pivot", "mode 3")
