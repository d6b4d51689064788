"""A decision is open where the error of its margin allows the other outcome."""

import pytest

from pinarm.engine.motion.outcome import Decision, open_notes


@pytest.mark.parametrize(
    ("margin", "error", "happens", "is_open"),
    [(2.0, 1.0, True, False), (1.0, 1.0, True, True), (-2.0, 1.0, False, False), (-2.0, 1.0, True, True),
     (0.0, 0.0, False, True), (1.0, float("nan"), True, True)],
)  # fmt: skip
def test_it_is_open_within_its_error_and_where_the_run_contradicts_its_margin(margin, error, happens, is_open):
    decision = Decision("the stop is met", 0.3, margin, error, "m", happens)
    assert decision.is_open is is_open
    assert len(open_notes([decision])) == is_open


def test_the_note_says_what_when_and_by_how_much():
    [note] = open_notes([Decision("event 'back' takes place", 0.25, -1e-9, 2e-8, "m", True)])
    for part in ("event 'back' takes place", "t = 0.25 s", "margin -1e-09 m", "error 2e-08 m"):
        assert part in note
