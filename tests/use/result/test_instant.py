"""Places on a run: what they say, and mistakes that are told before anything is solved."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError, PinarmError
from pinarm.use.result.row_lookup import instant, located


def test_a_coordinate_and_its_value(scenario: Callable[..., Any]) -> None:
    quantities = scenario("inverse").quantities()
    at = {"pivot": "30 deg", "side": "left", "occurrence": 2}
    assert (instant(at), instant("max")) == ({"pivot": "30 deg"}, {})
    assert located(at, quantities) == ("pivot", pytest.approx(np.pi / 6))
    for wrong, says in (
        ({"side": "left"}, "an instant names one coordinate"), ({"pivot": "1 rad", "t": "1 s"}, "names one coordinate"),
        ({"pivto": "30 deg"}, "there is no quantity 'pivto'"), ({"pivot": "30 mm"}, "'mm' is not a unit"),
        ({"pivot": "30"}, "'30' has no unit"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=says):
            located(wrong, quantities)


@pytest.mark.parametrize("place", ["pivot=30 mm", "pivto=30 deg", "t=1, side=left", "side=left"])
def test_a_place_that_cannot_be_is_refused_before_the_run(scenario: Callable[..., Any], place: str) -> None:
    with pytest.raises(PinarmError):
        scenario("inverse", f"numbers: ['M @ {place}']\n").validate()
    with pytest.raises(PinarmError, match="--result"):
        pinarm.sweep(scenario("inverse"), {"problem.time.end": "1, 2 s"}, results=[f"M @ {place}"], workers=1)
