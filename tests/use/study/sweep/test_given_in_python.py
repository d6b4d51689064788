"""A sweep goes on from cases of the same mechanism only, though no file says what it is."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm

MODEL = Path(__file__).parents[4] / "models" / "gen411_arm" / "mechanism.yaml"
DATA = {
    "pinarm": 1, "outputs": ["theta"],
    "problem": {"kind": "forward", "time": {"end": "1 s", "samples": 11}, "initial": {"position": {"O": "-60 deg"}}},
}  # fmt: skip


def scenario(mass: str = "0.2 kg") -> pinarm.Scenario:
    return pinarm.load({**DATA, "mechanism": pinarm.Mechanism.load(MODEL, {"m_A": mass})})


def least(given: pinarm.Scenario, folder: Path | None) -> Any:
    return pinarm.sweep(given, {"problem.time.end": "0.5:1:2 s"}, workers=1, folder=folder)["min theta"].values


def test_a_sweep_of_another_mechanism_does_not_go_on_from_the_first(tmp_path: Path) -> None:
    light = least(scenario(), tmp_path / "out")
    heavy = least(scenario("2 kg"), tmp_path / "out")
    assert np.array_equal(heavy, least(scenario("2 kg"), None))
    assert np.abs(heavy - light).max() > 1e-3


FACTOR = 2.0


def first_value(result: Any) -> Any:
    return FACTOR * result["theta"][:1].to("deg")


def test_functions_are_columns_with_units_that_a_sweep_goes_on_with(tmp_path: Path) -> None:
    """They are those of the module as it was, and of the case alone; the journal knows them in another process too."""
    solved = list[int]()

    def span(result: Any) -> float:
        return result.number("theta @ range")[0] + 0.0 * len(solved)

    over, given = {"problem.time.end": "0.5:1:3 s"}, {**DATA, "mechanism": str(MODEL)}
    ask = lambda: pinarm.sweep(given, over, results=[first_value, span, "theta @ range"], workers=1, folder=tmp_path)  # noqa: E731
    swept = ask()
    assert swept["span"].values == pytest.approx(swept["theta @ range"].values, abs=0.0)
    assert str(swept["first_value"].unit) == "rad"
    assert swept["first_value"].values == pytest.approx(-2.0 * np.pi / 3.0)
    size = (tmp_path / "journal.jsonl").stat().st_size
    assert np.array_equal(ask()["span"].values, swept["span"].values)
    assert (tmp_path / "journal.jsonl").stat().st_size == size
    solved.append(1)  # what a function holds belongs to it
    ask()
    assert (tmp_path / "journal.jsonl").stat().st_size > size


@pytest.mark.parametrize(("function", "said"), [
    (lambda result: 1.0, "has no name for its column"),
    (open, "raised TypeError"),
    (str, "returned .<Result"),
])  # fmt: skip
def test_a_function_that_cannot_be_a_column_says_why(function: Any, said: str) -> None:
    with pytest.raises(pinarm.PinarmError, match=said):
        pinarm.sweep({**DATA, "mechanism": str(MODEL)}, {"problem.time.end": "0.5, 1 s"}, results=function, workers=1)
