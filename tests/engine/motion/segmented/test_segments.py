"""Segments of a motion: events that follow one another without end are no motion."""

from types import SimpleNamespace

import pytest

from pinarm.engine.motion.segmented.segments import CROWDED, MotionSegment, SegmentedMotion
from pinarm.errors import IntegrationError


def motion_of(ends):
    return SegmentedMotion(None, [MotionSegment(None, SimpleNamespace(end=end), None, None) for end in ends])


def test_events_at_one_instant_end_the_integration():
    crowd = [0.3] * (CROWDED + 1)
    motion_of([0.1, 0.2, *crowd[1:]]).require_progress()
    motion_of([0.3 + 1e-12 * k for k in range(2 * CROWDED)]).require_progress()
    for ends in ([0.1, *crowd], [0.0] * (CROWDED + 1)):
        with pytest.raises(IntegrationError, match=f"{CROWDED} events follow one another there") as caught:
            motion_of(ends).require_progress()
        assert caught.value.partial.end == ends[-1]


@pytest.mark.parametrize(("few", "many", "told"), [(2, 120, False), (60, 60, True)])
def test_a_motion_is_stiff_where_a_good_part_of_its_steps_is(few, many, told):
    """Behind an impact one or two steps may be at the limit of stability."""

    def segment(steps, doubts):
        method = SimpleNamespace(diagnose=lambda solution: doubts)
        return MotionSegment(None, SimpleNamespace(steps=[None] * steps, method=method), None, None)

    motion = SegmentedMotion(None, [segment(few, ["stiff: on 100% of the steps"]), segment(many, ["other"])])
    assert motion.diagnose() == ["stiff: on 100% of the steps"] * told + ["other"]
