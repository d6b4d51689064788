"""Formulas of numbers: against the closed form of the arm's torque, c cos(phi) for phi from -60 to 60 deg."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.use.cases.solving import VariantNumbers
from pinarm.use.result.numbers import CombinedNumber, read_number

ARM = Path(__file__).parents[3] / "scenarios" / "gen411_arm_static.yaml"
C, SIXTH = 1.4715, math.pi / 3
"""Largest torque [N*m], and the largest angle [rad]."""
MEAN = C * math.sin(SIXTH) / SIXTH

FORMULAS = {
    "C_B @ max - C_B @ min": (C / 2, "N*m"),
    "C_B @ range": (C / 2, "N*m"),
    "C_B @ max / C_B @ min": (2.0, "1"),
    "(C_B @ phi=0 deg - C_B @ start)/2": (C / 4, "N*m"),
    "C_B @ phi=0 deg-C_B @ phi=60 deg, side=left": (C / 2, "N*m"),
    "2*(C_B @ mean) - (C_B*phi) @ phi=30 deg": (2 * MEAN - C * math.cos(math.pi / 6) * math.pi / 6, "N*m"),
    "max(C_B @ min, C_B @ mean) + abs(phi @ min) * 1": (None, ""),
    "phi @ max - phi @ min": (2 * SIXTH, "rad"),
    "phi @ range / (phi @ max)": (2.0, "1"),
    "phi @ max(C_B) + phi @ max": (SIXTH, "rad"),
}  # fmt: skip


@pytest.fixture(scope="module")
def arm() -> Any:
    return pinarm.run(ARM)


@pytest.mark.parametrize("text", FORMULAS)
def test_a_formula_has_the_value_and_the_unit_of_the_closed_form(arm: Any, text: str) -> None:
    value, unit = FORMULAS[text]
    if value is None:
        with pytest.raises(pinarm.PinarmError, match="do not go together"):
            arm.number(text)
        return
    number = read_number(text)
    assert isinstance(number, CombinedNumber)
    assert arm.number(text)[0] == pytest.approx(value, abs=1e-8)  # a place of an extreme is known to 1e-8 rad
    assert str(number.described(arm.quantities, {}).unit) == unit


def test_errors_of_the_parts_are_carried_along() -> None:
    """As the differential of the formula has them: of a/b - c, da/|b| + |a| db/b² + dc."""
    number = read_number("x @ max / x @ min - y @ mean")
    assert isinstance(number, CombinedNumber)
    value, error = number.of([(3.0, 1e-6), (-2.0, 2e-6), (5.0, 3e-6)])
    assert value == -6.5
    assert error == pytest.approx(1e-6 / 2 + 3 * 2e-6 / 4 + 3e-6, rel=1e-5)
    assert np.isnan(number.of([(3.0, 0.0), (np.nan, 0.0), (5.0, 0.0)])[0])
    assert number.of([(3.0, np.inf), (-2.0, 0.0), (5.0, 0.0)])[1] == np.inf


def test_its_error_bound_follows_from_those_of_its_numbers() -> None:
    """Beyond which the number of a much finer solution does not lie."""
    swing = ARM.with_name("gen411_arm_swing.yaml")
    asked = ["theta @ range", "theta @ max", "theta @ min"]
    result = pinarm.load(swing, {"numbers": asked, "accuracy": {"tolerance": 1e-6}}).verified()
    exact = pinarm.run(swing, {"accuracy": {"tolerance": 1e-13}}).number("theta @ range")[0]
    whole, *parts = (result.number_errors.get(text) for text in asked)
    assert whole is not None and None not in parts
    assert 0.0 < whole == pytest.approx(sum(parts), rel=1e-6)
    assert 0.0 < abs(result.number("theta @ range")[0] - exact) < whole


@pytest.mark.parametrize(("text", "said"), [
    ("2*C_B @ max - 1", "what '@' belongs to"),
    ("C_B @ max - C_B", "'C_B' in 'C_B @ max - C_B' has a value at every row"),
    ("C_B @ max - phi @ max", "do not go together"),
    ("C_B @ max / (phi @ phi=0 deg)", "is not finite"),
    ("C_B @ max - C_B @ maxi", "'C_B @ maxi' is no number of a run"),
])  # fmt: skip
def test_what_is_no_number_says_why(arm: Any, text: str, said: str) -> None:
    with pytest.raises(pinarm.PinarmError, match=said):
        arm.number(text)


def test_find_limits_expect_and_variants_take_formulas(monkeypatch: pytest.MonkeyPatch) -> None:
    """The torque is proportional to m_A + m_BA/2, with m_BA/2 = 0.5 kg; cases of a sweep are solved together."""
    find = {"for": {"arguments.m_A": "0.1 kg"}, "so_that": {"C_B @ max - C_B @ min": f"{C} N*m"}}
    expect = [{"quantity": "C_B @ range / (C_B @ max)", "value": "0.500", "source": "cos(60 deg)"}]
    given = {"limits": {"keep": {"C_B @ range": "< 3 N*m"}}, "expect": expect}
    assert [finding.verdict for finding in pinarm.check(pinarm.load(ARM, given))] == ["agrees"]
    result = pinarm.run(ARM, {**given, "find": find})
    assert result.figures["arguments.m_A [kg]"] == pytest.approx(2 * 0.6 - 0.5, rel=1e-9)
    assert result.number("limits.C_B_range.margin")[0] == pytest.approx(3 - C, abs=1e-9)
    together = list[int]()
    solve = VariantNumbers.told
    monkeypatch.setattr(VariantNumbers, "told", lambda own, *given: together.append(1) or solve(own, *given))
    over = {"arguments.m_A": "0.1:0.5:5 kg"}
    swept = pinarm.sweep(ARM, over, results=["C_B @ range / (C_B @ max)", "C_B @ range"], workers=1)
    assert swept["C_B @ range / (C_B @ max)"].values == pytest.approx(0.5, abs=1e-9)
    assert swept["C_B @ range"].values == pytest.approx(C / 2 / 0.6 * np.linspace(0.6, 1.0, 5), abs=1e-9)
