"""Segments of a motion: events that follow one another without end are no motion."""

from pathlib import Path
from types import SimpleNamespace

import pytest

import pinarm
from pinarm.engine.motion.segmented.segments import CROWDED, MotionSegment, SegmentedMotion
from pinarm.errors import IntegrationError


def motion_of(ends):
    return SegmentedMotion(None, [MotionSegment(None, SimpleNamespace(end=end), None, None, None) for end in ends])


def test_events_at_one_instant_end_the_integration():
    crowd = [0.3] * (CROWDED + 1)
    motion_of([0.1, 0.2, *crowd[1:]]).require_progress()
    motion_of([0.3 + 1e-12 * k for k in range(2 * CROWDED)]).require_progress()
    for ends in ([0.1, *crowd], [0.0] * (CROWDED + 1)):
        with pytest.raises(IntegrationError, match=f"{CROWDED} events follow one another there") as caught:
            motion_of(ends).require_progress()
        assert caught.value.partial.end == ends[-1]
    with pytest.raises(IntegrationError, match=f"{CROWDED} events follow one another there"):
        motion_of([0.3 + 1e-14 * k for k in range(2 * CROWDED)]).require_progress(1.0)


def test_what_holds_of_many_segments_is_told_once():
    """Bounces of a lever that dies down on its stop: some twenty segments, each with numbers of its own."""
    lever = Path(__file__).parents[4] / "docs" / "kind_examples" / "events" / "lever.yaml"
    given = {
        "pinarm": 1, "mechanism": str(lever), "outputs": ["O"], "accuracy": {"method": "rk4", "step": "0.1 s"},
        "problem": {"kind": "forward", "time": {"end": "1.5 s", "samples": 3},
                    "end_stops": {"O": {"lower": "-60 deg", "restitution": 0.5}}},
    }  # fmt: skip
    notes = pinarm.run(given).notes()
    assert len([note for note in notes if note.startswith("step too")]) == 1
