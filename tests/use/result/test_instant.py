"""Places on a run: what they say, and mistakes that are told before anything is solved."""

from collections.abc import Callable
from typing import Any

import pytest

import pinarm
from pinarm.errors import PinarmError


@pytest.mark.parametrize("place", ["pivot=30 mm", "pivto=30 deg", "t=1, side=left", "side=left"])
def test_a_place_that_cannot_be_is_refused_before_the_run(scenario: Callable[..., Any], place: str) -> None:
    with pytest.raises(PinarmError):
        scenario("inverse", f"numbers: ['M @ {place}']\n").validate()
    with pytest.raises(PinarmError, match="--result"):
        pinarm.sweep(scenario("inverse"), {"problem.time.end": "1, 2 s"}, results=[f"M @ {place}"], workers=1)
