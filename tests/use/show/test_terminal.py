"""What a terminal shows of numbers: a zero where the rest is rounding."""

import pytest

from pinarm.use.show.terminal import without_rounding


@pytest.mark.parametrize(("given", "wanted"), [
    ((-902.7, 5e-15), (-902.7, 0.0)), ((-3e-18, 0.5), (0.0, 0.5)), ((-1e-9, 2.0), (-1e-9, 2.0)),
    ((-4e-16, 5e-16), (-4e-16, 5e-16)),  # nothing tells of what these are the rounding
    ((0.0, 0.0), (0.0, 0.0)), ((1e-300, 2e-300), (1e-300, 2e-300)),
])  # fmt: skip
def test_what_is_rounding_of_the_other_end_is_zero(given: tuple[float, float], wanted: tuple[float, float]) -> None:
    """The relative error of what is solved for is 1e-13: less than that of the largest value is none."""
    assert without_rounding(*given) == wanted
