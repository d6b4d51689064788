"""What stays at rest beside a loop that is set in motion."""

import pytest

import pinarm

CRANK = {"points": ["O", "A", "E"], "mass": "1 kg", "centre": "O", "inertia": "0.01 kg*m^2"}
FOUR_BAR = {
    "points": {"O": [0, 0], "A": ["0.1 m", 0], "T": ["0.1 m", "-0.3 m"], "E": ["0 m", "0.05 m"],
               "B": ["0.33 m", "0.24 m"], "C": ["0.4 m", 0]},
    "ground": ["O", "C"],
    "links": {"crank": CRANK, "coupler": {"points": ["A", "B"], "mass": "3 kg"},
              "rocker": {"points": ["B", "C"], "mass": "2 kg"}, "pendulum": {"points": ["E", "T"], "mass": "1.5 kg"}},
}  # fmt: skip
"""A pendulum hangs on the crank of a four-bar, outside of its loop."""


@pytest.mark.parametrize(
    "given",
    [
        {"motion": {"O": {"law": "constant_speed", "speed": "5 rad/s"}}},
        {"initial": {"velocity": {"O": "5 rad/s"}}}, {"initial": {"velocity": {"C": "5 rad/s"}}},
        {"initial": {"velocity": {"O": "5 rad/s", "C": "5 rad/s"}}}, {"initial": {"velocity": {"h": "0.2 m/s"}}},
    ],
)  # fmt: skip
def test_what_no_loop_couples_to_a_motion_begins_at_rest(given: dict[str, object]) -> None:
    """By a law, by given velocities, by some that the loop does not allow, and by the rate of a point of the loop."""
    problem = {"kind": "forward", "time": {"end": "0.01 s", "samples": 2}, **given}
    height = {"h": {"kind": "point", "point": "B", "along": "y"}}
    result = pinarm.run({"pinarm": 1, "mechanism": {"pinarm": 1, "planar": FOUR_BAR, "coordinates": height},
                         "problem": problem, "outputs": ["joint.E.velocity", "joint.O.velocity"]})  # fmt: skip
    assert result["joint.E.velocity"].values[0] == pytest.approx(0.0, abs=1e-13)
    assert abs(result["joint.O.velocity"].values[0]) > 0.1
