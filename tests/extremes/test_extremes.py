"""Every extreme case is right to its tolerance, or refused for a reason that is listed here."""

import re
from pathlib import Path

import numpy as np
import pytest
from cases import CASES
from extreme import Case, Outcome
from extreme_loops import NEWTON
from newton_euler import LONG
from table import DOCUMENT, with_rows

NO_MASS = "can move without mass"
SINGULAR = "the position is singular"
BEYOND = "out of reach"
STOPS = "it all but stops"
PERMITTED = {
    "link without mass at the end of an arm, free to turn": NO_MASS,
    "point on a ball joint, free to spin about its line": NO_MASS,
    "double pendulum of rods of 1e-6 m and 1 m": NO_MASS,
    "spring of 1e9 and damper of 1e6 over 10 s, explicit": "has taken 3000 steps",
    "gimbal without mass that starts 1e-09 rad beside it": NO_MASS,
    "gimbal without mass that starts 0 rad beside it": NO_MASS,
    "tip led to the border, the arm straight": f"{BEYOND}|{SINGULAR}|cannot be followed beyond",
    "tip led beyond the border": BEYOND,
    "tip that leaves from the border, the arm straight": SINGULAR,
    "tip led past the base at 1e-9 m, the arm folded": SINGULAR,
    "tip led through the base, the arm folded": SINGULAR,
    "tip of a shorter forearm led inside of the inner border": BEYOND,
    "parallelogram set in motion 1e-06 rad before all bars are in line": "last digits of the start would choose",
    "parallelogram set in motion 1e-09 rad before all bars are in line": SINGULAR,
    "parallelogram started in line, velocity of one crank given": SINGULAR,
    "parallelogram let go in line, at rest": STOPS,
    **{f"parallelogram that turns back {miss:g} rad beyond the position in line, closed at {cut}": STOPS
       for miss in (1e-3, 1e-7) for cut in "BC"},
    "slider-crank moved by its slider over the dead centre": SINGULAR,
}  # fmt: skip
"""Cases that may be refused, and a part of the reason: at rest on a singularity, out of reach, beyond stated ranges."""

FAST, SLOW = ([case for case in CASES if case.when == when] for when in ("fast", "slow"))


EXTENDED = np.finfo(LONG).eps < 1e-18


def without_digits(message: str) -> str:
    """A message without its numbers, whose last digits depend on the rounding of the machine."""
    return re.sub(r"[-+.\de]*\d", "#", message)


def holds(case: Case, folder: Path) -> None:
    if case.reference == NEWTON and not EXTENDED:
        pytest.skip("no extended precision on this machine")
    outcome = Outcome.of(case, folder)
    if case.name in PERMITTED:
        assert re.search(PERMITTED[case.name], outcome.refusal), f"{outcome.error:.1e}, {outcome.refusal}"
        listed = without_digits(DOCUMENT.read_text())
        stale = "|" not in PERMITTED[case.name] and f"| {without_digits(outcome.refusal)} |" not in listed
        assert not stale, (
            f"{DOCUMENT.name} has another message: python tests/extremes/table.py --quick\n{outcome.refusal}"
        )
    else:
        assert not outcome.refusal
        assert outcome.error <= case.tolerance


@pytest.mark.parametrize("case", FAST, ids=[f"{case.area}: {case.name}" for case in FAST])
def test_it_is_right_or_refused_for_a_permitted_reason(case, tmp_path):
    holds(case, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("case", SLOW, ids=[f"{case.area}: {case.name}" for case in SLOW])
def test_what_takes_longer_is_too(case, tmp_path):
    holds(case, tmp_path)


def test_names_are_used_once_and_refusals_are_of_cases():
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert set(PERMITTED) < set(names)
    assert len(PERMITTED) < len(names) / 4


def test_the_document_shows_every_case():
    shown = DOCUMENT.read_text()
    assert [case.name for case in (*FAST, *SLOW) if f"| {case.name} |" not in shown] == []
    assert "WRONG" not in shown


def test_rows_of_the_document_are_replaced_by_the_name_of_their_case():
    case = CASES[0]
    page = f"| {case.name} | a | b | c | d | e |\n| {case.name} twice | kept |\n"
    assert with_rows(page, {case: Outcome(refusal="because")}) == (
        f"| {case.name} | {case.reference} |  |  | because | refused |\n| {case.name} twice | kept |\n"
    )
