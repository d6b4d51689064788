"""Segments of a motion: events that follow one another without end are no motion."""

from pathlib import Path

import pinarm


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
