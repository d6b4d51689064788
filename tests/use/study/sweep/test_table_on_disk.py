"""A table in a file that has no name."""

import os
from pathlib import Path

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.use.study.sweep.solving import BLOCK, table_on_disk


@pytest.mark.parametrize("rows", [1, BLOCK - 1, BLOCK + 3])
def test_it_is_an_array_like_others_and_leaves_nothing_behind(tmp_path: Path, rows: int) -> None:
    table = table_on_disk(rows, 2, tmp_path)
    assert np.isnan(table).all()
    table[rows - 1] = 1.0, 2.0
    assert table.shape == (rows, 2)
    assert table[:, 1].flags.c_contiguous
    assert table[rows - 1].tolist() == [1.0, 2.0]
    assert not os.listdir(tmp_path)


def test_a_folder_that_is_full_or_read_only_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a table of 3 cases cannot be written in"):
        table_on_disk(3, 2, tmp_path / "nowhere")
