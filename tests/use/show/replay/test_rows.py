"""Which rows of a motion the page gets."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest


def test_many_rows_are_thinned_but_jumps_and_extremes_stay(
    scenario: Callable[..., Any], read: Callable[..., Any]
) -> None:
    result = scenario("inverse", "", ("samples: 9", "samples: 20001")).run()
    page = read(result.replay(plots=["M"]).html)
    rows, values = page.array(page.scene["rows"]), page.array(page.scene["plots"][0]["values"])
    assert len(rows) < 2500
    assert set(result.trajectory.grid.t[np.array(result.trajectory.grid.rows[:-1])]) <= set(rows)
    assert (values.min(), values.max()) == (result["M"].values.min(), result["M"].values.max())
    swing = scenario("forward", "", ("samples: 23", "samples: 20001")).run()
    page_of_swing = read(swing.replay(plots=["alpha"]).html)
    shown = page_of_swing.array(page_of_swing.scene["plots"][0]["values"])
    assert np.radians([shown.min(), shown.max()]) == pytest.approx(
        [swing["alpha"].values.min(), swing["alpha"].values.max()], abs=1e-14
    )
    assert page.scene["notes"] == [f"{len(rows)} of {len(result)} rows"]
