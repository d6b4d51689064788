"""Segments of a motion: events that follow one another without end are no motion."""

from pathlib import Path
from types import SimpleNamespace

import pytest

import pinarm
from pinarm.engine.integration.integrator import Doubt
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


@pytest.mark.parametrize(("few", "many", "told"), [(2, 120, False), (60, 60, True)])
def test_a_motion_is_stiff_where_a_good_part_of_its_steps_is(few, many, told):
    """Behind an impact one or two steps may be at the limit of stability."""

    def segment(steps, doubts):
        method = SimpleNamespace(diagnose=lambda solution: doubts)
        return MotionSegment(None, SimpleNamespace(steps=[None] * steps, method=method), None, None, None)

    stiff, other = Doubt("stiff", 1.0, "stiff: on 100% of the steps"), Doubt("other", 0.0, "other")
    motion = SegmentedMotion(None, [segment(few, [stiff]), segment(many, [other])])
    assert motion.diagnose() == ["stiff: on 100% of the steps"] * told + ["other"]


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


URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
<joint name="b" type="continuous"><parent link="upper"/><child link="fore"/><origin xyz="1 0 0"/>
<axis xyz="0 0 1"/></joint>
</robot>"""


def test_a_segment_without_a_row_of_those_that_are_asked_for_is_left_out(tmp_path, monkeypatch):
    """Where a drive has losses, rows at rest are looked at again a little later; the segments of slip have none."""
    (tmp_path / "arm.urdf").write_text(URDF)
    monkeypatch.chdir(tmp_path)

    def motion(efficiency):
        mechanism = {
            "pinarm": 1, "robot": "arm.urdf", "gravity": {"direction": "-y"},
            "drives": {"motor": {"joint": "a", "ratio": 10.0, "efficiency": efficiency}},
            "friction": {"b": {"constant": "0.3 N*m"}},
        }  # fmt: skip
        law = {"law": "trapezoid", "from": "0 rad", "to": "0.5 rad", "acceleration": "10 rad/s^2"}
        problem = {"kind": "forward", "time": {"end": "1 s", "samples": 11}, "motion": {"a": law},
                   "initial": {"position": {"b": "0.9 rad"}}}  # fmt: skip
        outputs = ["b", "drive.motor.torque"]
        return pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": outputs})

    lossy, ideal = motion(0.8), motion(1.0)
    assert lossy["b"].values.tolist() == ideal["b"].values.tolist()
    assert lossy["drive.motor.torque"].values[1] == pytest.approx(ideal["drive.motor.torque"].values[1] / 0.8, rel=1e-9)
