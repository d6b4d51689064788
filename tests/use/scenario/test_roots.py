"""Numbers that are found whatever their size, against closed forms."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pytest

from pinarm.errors import InputError
from pinarm.input.units import read_quantity
from pinarm.input.yaml.schema import AnyQuantity
from pinarm.use.scenario.find import Find, Unknown
from pinarm.use.scenario.optimum import Run, Runs
from pinarm.use.scenario.searches import FoundValues, find_root


def found(
    starts: Mapping[str, str], left: Callable[..., float | Sequence[float]],
    runs: Callable[[float], bool] = lambda x: True,
) -> FoundValues:  # fmt: skip
    """Look for numbers for which a function of them in SI vanishes; not all of them can be run."""
    search = Find({path: Unknown.read(text) for path, text in starts.items()}, {"q": AnyQuantity.read("0 N")})

    def run(x: np.ndarray) -> Run:
        values = [read_quantity(text)[0] for text in search.case(x).values()]
        bad = [value for value in values if not runs(value)]
        if bad:
            return Run.refused("it cannot be", lambda: InputError(f"{bad} cannot be"))
        numbers = np.atleast_1d(left(*values)).astype(float)
        return Run(numbers, ["q"] * len(numbers))

    return find_root(search, Runs(lambda points: map(run, points)))


def positive(x: float) -> bool:
    return x >= 0.0


@pytest.mark.parametrize("size", [1e-5, 1e-4, 1e5])
@pytest.mark.parametrize("start", ["2 kg", "1 g", "0 kg"])
def test_masses_are_found_whatever_their_size_and_none_is_negative_on_the_way(size, start):
    """m + m^2/size = 6 size for m = 2 size: an equation whose other root, -3 size, cannot be run."""
    result = found({"m": start}, lambda m: m + m * m / size - 6.0 * size, runs=positive)
    assert not result.missed
    assert result.values == pytest.approx([2.0 * size], rel=1e-11)


def test_numbers_of_very_different_sizes_are_found_together():
    """a b = 2e-6 and a/b = 8e6 and a start far away."""
    result = found({"a": "1 kN", "b": "1e-8 m"}, lambda a, b: (a * b - 2e-6, (a - 8e6 * b) * 1e-6), runs=positive)
    assert result.values == pytest.approx([4.0, 5e-7], rel=1e-9)


def test_a_step_that_nearly_dependent_slopes_make_far_too_long_is_bent_downhill():
    """Beale's function, whose minimum is (3, 0.5) by construction."""
    starts = {"x": "1 kg", "y": "1 kg"}
    constants = ((1, 1.5), (2, 2.25), (3, 2.625))
    result = found(starts, lambda x, y: [c - x * (1.0 - y**i) for i, c in constants])
    assert not result.missed
    assert result.values == pytest.approx([3.0, 0.5], rel=1e-9)
    result = found({"x": "-3 kg", "y": "1.6 kg"}, lambda x, y: (math.tanh(x - 1.2 * y) + 0.3, math.hypot(x, y) - 0.8))
    assert not result.missed
    x, y = result.values
    assert (x - 1.2 * y, math.hypot(x, y)) == pytest.approx((-math.atanh(0.3), 0.8), rel=1e-9)


def test_what_is_not_met_is_missed_by_least_around():
    """Freudenstein and Roth's function from their start: the minimum of Moré, Garbow and Hillstrom (1981)."""
    left = lambda x, y: (-13.0 + x + ((5.0 - y) * y - 2.0) * y, -29.0 + x + ((y + 1.0) * y - 14.0) * y)  # noqa: E731
    result = found({"x": "0.5 kg", "y": "-2 kg"}, left)
    assert result.missed
    assert result.values == pytest.approx([11.4128, -0.896805], rel=1e-5)
    assert sum(each**2 for each in left(*result.values)) == pytest.approx(48.9842, rel=1e-5)


def test_what_is_less_than_nothing_is_refused_for_that():
    """m = -1 kg is wanted."""
    with pytest.raises(InputError, match="cannot be"):
        found({"m": "1 kg"}, lambda m: m + 1.0, runs=positive)


def test_a_jump_is_no_root() -> None:
    """The remainder changes its sign at 2 and is 1 on both sides."""
    assert found({"m": "1.9 kg"}, lambda m: math.copysign(1.0, m - 2.0) + 0.1 * (m - 2.0)).missed


def test_a_search_ends_in_the_noise_of_its_runs() -> None:
    """The real root of m^3 + m = 10, with changes of 1e-6 from run to run that no search can get below."""
    runs = list[float]()

    def left(m: float) -> float:
        runs.append(m)
        return m**3 + m - 10.0 + 1e-6 * math.sin(1e9 * m)

    result = found({"m": "1.5 kg"}, left)
    assert result.values == pytest.approx([2.0], rel=1e-6)
    assert result.residuals["q"] < 2e-6
    assert len(runs) <= 60


def test_a_refused_run_that_stops_a_search_is_told_with_its_values() -> None:
    """m^2 falls towards 0 and is to be -1: the search runs against the masses that are refused."""
    with pytest.raises(InputError, match=r"stopped by a run that is refused, at m \[kg\] = -\d.*cannot be"):
        found({"m": "1 kg"}, lambda m: m + 1.0, runs=positive)
