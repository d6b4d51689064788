"""Verdicts: what agrees, what is rounding, what is a misprint, and that everything else is a miss.

The pendulum of 2 kg and 1 m is held at an angle a by 20 sin(a) N*m (g = 10 m/s^2): at most 20 N*m.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.study.answers.check import Finding, errata, remarks

MODELS = Path(__file__).parents[4] / "models"

ROOT = Path(__file__).parents[4]


@pytest.fixture
def verdict(scenario: Callable[..., Any]) -> Callable[..., Finding]:
    def of(entry: str, kind: str = "statics") -> Finding:
        [finding] = pinarm.check(scenario(kind, f"expect:\n  - {{{entry}, source: by hand}}\n"))
        return finding

    return of


def entry(**fields: str) -> str:
    return ", ".join(f"{key}: {value}" for key, value in {"quantity": "M", "at": "max", **fields}.items())


AGREES, ROUNDING, MISPRINT, MODEL_ERROR, MISS = "agrees", "rounding", "misprint", "model_error", "MISS"


VERDICTS = [
    # a value is met to half a unit of its own last digit, or to what is said
    ({"value": "20.00000 N*m"}, AGREES), ({"value": "2e1 N*m"}, AGREES), ({"value": "-20 N*m"}, MISS),
    ({"value": "20.4 N*m", "rtol": "0.02"}, AGREES), ({"value": "20.4 N*m", "rtol": "0.019"}, MISS),
    ({"value": "20.4 N*m", "atol": "0.41 N*m"}, AGREES), ({"value": "20.4 N*m", "atol": "390 N*mm"}, MISS),
    ({"value": "20.4 N*m", "rtol": "0", "atol": "0 N*m"}, MISS),
    # without a unit too: YAML reads the number, the digits are those of the text
    ({"quantity": "M/(1.02 N*m)", "value": "19.6"}, AGREES), ({"quantity": "M/(1.02 N*m)", "value": "19.60"}, MISS),
    ({"quantity": "M/(0.98 mN*m)", "value": "2.0e4"}, AGREES), ({"quantity": "M/(1 mN*m)", "value": "2.1e4"}, MISS),
    # the last of 17 digits is below rounding
    ({"value": "20.000000000000007 N*m"}, AGREES), ({"published": "20.000000000000007 N*m"}, AGREES),
    ({"at": "{alpha: 90 deg}", "value": "20.00000000000004 N*m"}, MISS),
        ({"published": "20.00000000000004 N*m"}, MISS),
    # a published figure is met to half a unit of its last digit
    ({"published": "20.0 N*m"}, AGREES), ({"published": "0.02 kN*m"}, AGREES),
    ({"value": "20 N*m", "published": "20.1 N*m"}, MISS),
    ({"value": "21 N*m", "published": "20 N*m"}, MISS),
    # claims: rounding is one unit of the last digit, or what the reason gives
    ({"value": "20.00 N*m", "published": "20.1 N*m", "verdict": ROUNDING}, ROUNDING),
    ({"value": "20.00 N*m", "published": "20.2 N*m", "verdict": ROUNDING}, MISS),
    ({"value": "20.00 N*m", "published": "20.2 N*m", "verdict": ROUNDING, "because": "2*10.1"}, ROUNDING),
    ({"value": "20.00 N*m", "published": "20.2 N*m", "verdict": ROUNDING, "because": "2*10.2"}, MISS),
    ({"value": "21.00 N*m", "published": "20.1 N*m", "verdict": ROUNDING}, MISS),
    ({"value": "20.00 N*m", "published": "20.0 N*m", "verdict": ROUNDING}, MISS),
    # claims: a misprint differs from the published figure, and the independent value confirms the computed one
    ({"value": "20.00 N*m", "published": "12.0 N*m", "verdict": MISPRINT}, MISPRINT),
    ({"value": "20.00 N*m", "published": "20.0 N*m", "verdict": MISPRINT}, MISS),
    ({"value": "12.0 N*m", "published": "12.0 N*m", "verdict": MISPRINT}, MISS),
    # a reason, where it is given, leads to what is printed
    ({"value": "20.00 N*m", "published": "12.0 N*m", "verdict": MISPRINT, "because": "2*6"}, MISPRINT),
    ({"value": "20.00 N*m", "published": "12.0 N*m", "verdict": MISPRINT, "because": "2*6.1"}, MISS),
    # claims: an error of the model follows from that model, and the independent value confirms the computed one
    ({"value": "20.00 N*m", "published": "12.0 N*m", "verdict": MODEL_ERROR, "because": "2*6"}, MODEL_ERROR),
    ({"value": "20.00 N*m", "published": "12.0 N*m", "verdict": MODEL_ERROR, "because": "2*6.1"}, MISS),
    ({"value": "20.00 N*m", "published": "20.0 N*m", "verdict": MODEL_ERROR, "because": "2*10"}, MISS),
    ({"value": "12.0 N*m", "published": "12.0 N*m", "verdict": MODEL_ERROR, "because": "2*6"}, MISS),
    # formulas, at every row
    ({"at": "all", "formula": "M"}, AGREES), ({"at": "all", "formula": "M*(1 + 1e-9)"}, MISS),
    ({"at": "all", "formula": "M*(1 + 1e-9)", "rtol": "1e-8"}, AGREES),
    ({"at": "all", "value": "20 N*m"}, MISS),
    # a formula that is 0 is met by what rounding leaves: of 20 N*m sin(pi), 2.4e-15 N*m
    ({"at": "end", "formula": "0*M"}, AGREES), ({"at": "end", "formula": "M - (20 N*m)*sin(alpha)"}, AGREES),
    ({"at": "{alpha: 1e-12 rad}", "formula": "0*M"}, MISS), ({"at": "end", "formula": "0*M + (1e-12 N*m)"}, MISS),
    # printed formulas
    ({"at": "all", "published_formula": "20*sin(alpha)"}, AGREES),
    ({"at": "all", "published_formula": "20*cos(alpha)"}, MISS),
    ({"at": "all", "formula": "M", "published_formula": "20*cos(alpha)", "verdict": MISPRINT}, MISPRINT),
    ({"at": "all", "formula": "M", "published_formula": "20*sin(alpha)", "verdict": MISPRINT}, MISS),
    ({"at": "all", "formula": "M", "published_formula": "10*sin(alpha)", "verdict": MODEL_ERROR,
      "because": "M/2"}, MODEL_ERROR),
    # a printed 20.0 reaches to 20.05
    ({"published": "20.0 N*m", "quantity": "M*1.0024"}, AGREES),
    ({"published": "20.0 N*m", "quantity": "M*1.0026"}, MISS),
    # what is no number, or infinite at one row, is met by nothing
    ({"at": "all", "formula": '"M*sqrt(alpha - 9)"'}, MISS),
    ({"at": "all", "formula": '"(1 N*m)/sin(alpha)"'}, MISS),
]  # fmt: skip


def test_verdicts(scenario: Callable[..., Any]) -> None:
    entries = "".join(f"  - {{{entry(**fields)}, source: by hand}}\n" for fields, _ in VERDICTS)
    findings = pinarm.check(scenario("statics", "expect:\n" + entries))
    for (fields, expected), finding in zip(VERDICTS, findings, strict=True):
        assert finding.verdict == expected, fields
        assert finding.ok == (expected != MISS), fields
        assert bool(finding.reason) == (expected == MISS), fields


@pytest.mark.parametrize(("fields", "where"), [
    ({"published": "1 N*m"}, "end"), ({"published_formula": "M"}, "all"), ({"value": "1 N*m"}, "max"),
    ({"formula": "M"}, "all"), ({"value": "1 N*m", "rtol": "1"}, "{pivot: 90 deg}"),
    ({"value": "1 N*m", "published": "2 N*m", "verdict": MISPRINT}, "end"),
])  # fmt: skip
def test_what_is_not_a_number_agrees_with_nothing(
    verdict: Callable[..., Finding], fields: dict[str, str], where: str
) -> None:
    try:
        finding = verdict(entry(**{"at": where, **fields, "quantity": '"M*sqrt(-1 - alpha)"'}))
    except pinarm.PinarmError:
        return  # to say so is as good
    assert finding.verdict == MISS


def test_what_is_known_worse_than_asked_does_not_agree() -> None:
    """The 10th percentile of the torque of a sampled controller, from two rows, is -0.8 +- 3 N*m."""
    control = {"kind": "pid", "drive": "x", "follows": {"law": "constant", "value": "0 rad"},
               "kp": "25 N*m/rad", "kd": "6 N*m*s/rad", "period": "50 ms"}  # fmt: skip
    problem = {"kind": "forward", "time": {"end": "2 s", "samples": 2}, "initial": {"position": {"x": "1 rad"}},
               "control": [control]}  # fmt: skip
    wrong = {"quantity": "joint.x.effort", "at": "p10", "value": "2.0 N*m", "source": "none"}
    [finding] = pinarm.check({"pinarm": 1, "mechanism": str(ROOT / "models/servo/mechanism.yaml"), "problem": problem,
                              "outputs": ["x"], "expect": [wrong]})  # fmt: skip
    assert finding.verdict == MISS
    assert re.search(r"it is known to \S+ N\*m only", finding.reason)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"quantity": "joint.pivto.effort", "value": "1 N*m"}, "joint.pivot.effort"),
        ({"published": "1e999 N*m"}, ""), ({"value": "20 N*m", "atol": "-1 N*m"}, ""), ({"value": "true"}, ""),
        ({"value": "20 N*m", "published": "12.0 N*m", "verdict": MODEL_ERROR}, "is confirmed by what it assumes"),
        ({"value": "20 N*m", "published": "12.0 N*m", "verdict": ROUNDING, "erratum": "sign"},
         "an erratum is a misprint or a model error, not 'rounding'"),
        ({"published": "12.0 N*m", "published_formula": "20*sin(alpha)"}, "not both"),
    ],
)  # fmt: skip
def test_entries_that_ask_too_much(verdict: Callable[..., Finding], fields: dict[str, str], says: str) -> None:
    with pytest.raises(InputError) as caught:
        verdict(entry(**fields))
    assert says in str(caught.value)
    assert "statics.yaml:9:" in str(caught.value), "the place of the entry"


def test_a_zero_without_decimals_does_not_say_how_near(scenario: Callable[..., Any]) -> None:
    """Half a unit of its last digit would be half a newton metre."""
    given = "expect:\n  - {{quantity: M, at: start, value: {}, source: s}}\n"
    with pytest.raises(InputError, match=r"'0 N.m' does not say how near") as caught:
        pinarm.check(scenario("statics", given.format("0 N*m")))
    assert caught.value.hint == "atol: 1e-9 N*m"
    assert pinarm.check(scenario("statics", given.format("0.00 N*m")))[0].verdict == AGREES


def test_an_erratum_counts_once_in_all_scenarios(scenario: Callable[..., Any]) -> None:
    wrong = "quantity: M, at: max, value: 20 N*m, published: 12.0 N*m, source: s"
    entries = [f"{wrong}, verdict: misprint, erratum: {name}" for name in ("sign", "sign", "digit")]
    entries += [f"{wrong}, verdict: misprint", f"{wrong}, verdict: misprint"]
    entries += [f"{wrong}, verdict: model_error, because: 2*6, erratum: {name}" for name in ("mass", "mass")]
    findings = pinarm.check(scenario("statics", "expect:\n" + "".join(f"  - {{{one}}}\n" for one in entries)))
    assert (errata(findings, MISPRINT), errata(findings, MODEL_ERROR)) == (4, 1)
    assert errata([*findings, *findings], MISPRINT) == 6, "those without a name count each"
    assert remarks(findings) == ["4 misprint in 5 entries; 1 model error in 2 entries"]
    assert remarks(findings[:1] + findings[2:3]) == ["2 misprint"]


def test_what_is_less_accurate_than_wanted_is_a_miss() -> None:
    """A double pendulum: no setting is right to 1e-18."""
    problem = {"kind": "forward", "time": {"end": "1 s", "samples": 3}, "initial": {"position": {"O": "1 rad"}}}
    arm = pinarm.Mechanism.load(MODELS / "gen411_arm" / "mechanism.yaml")
    scenario = {"pinarm": 1, "mechanism": arm, "problem": problem, "outputs": ["O"], "accuracy": {"target": 1e-18},
                "expect": [{"quantity": "O", "at": "start", "value": "1.0 rad", "source": "given"}]}  # fmt: skip
    [finding] = pinarm.check(scenario)
    assert finding.verdict == MISS
    assert re.fullmatch(r"the global error is \S+, not below its target 1e-18", finding.reason)


LARGEST = 20.0 * math.sin(math.radians(540.0 / 7.0))
"""Of the rows of M, every 180/7 deg [N*m]."""


def test_a_column_that_crosses_zero_is_judged_by_its_largest_value(verdict: Callable[..., Finding]) -> None:
    """M = 20 N*m sin(alpha) is 0 at both ends: 7.4e-8 N*m are 3.8e-9 of its largest row, at 540/7 deg."""
    met = verdict(entry(at="all", quantity="M + (7.4e-8 N*m)", formula="M", rtol="1e-5"))
    assert met.verdict == AGREES
    assert met.error == pytest.approx(7.4e-8 / LARGEST, rel=1e-6)
    assert met.allowed == pytest.approx(1e-5, rel=1e-6)
    assert verdict(entry(at="all", quantity="M + (7.4e-4 N*m)", formula="M", rtol="1e-5")).verdict == MISS


def test_a_miss_tells_its_row_both_numbers_their_difference_and_the_allowed_one(
    verdict: Callable[..., Finding],
) -> None:
    """The largest difference is in the largest row."""
    found = verdict(entry(at="all", quantity="1.07*M", formula="M", rtol="1e-5"))
    numbers = f"computed {1.07 * LARGEST:.9g} N*m, expected {LARGEST:.9g} N*m, difference 7 % (allowed 0.001 %)"
    assert remarks([found])[0] == f"MISS statics: 1.07*M at pivot = 77.1428571 deg: {numbers}"
    zero = verdict(entry(at="end", quantity="M + (0.5 N*m)", formula="0*M", atol="0.01 N*m"))
    assert remarks([zero])[0].endswith(
        "at pivot = 180 deg: computed 0.5 N*m, expected 0 N*m, difference 0.5 N*m (allowed 0.01 N*m)"
    )
    printed = verdict(entry(published="21 N*m"))
    assert "computed 20 N*m, published 21 N*m" in remarks([printed])[0]
    assert "difference 4.76 % (allowed 2.38 %)" in printed.reason
