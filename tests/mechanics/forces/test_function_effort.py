"""Loads given as functions in Python, against the same loads given by laws, springs and dampers."""

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError, PinarmError

LEVER = {
    "pinarm": 1,
    "planar": {
        "points": {"O": ["0 m", "0 m"], "P": ["0.4 m", "0 m"], "W": ["0.1 m", "0.3 m"]},
        "ground": ["O", "W"],
        "links": {"lever": {"points": ["O", "P"], "mass": "2 kg"}},
    },
    "coordinates": {"reach": {"kind": "distance", "between": ["W", "P"]}},
}
SPRING = {"kind": "coordinate_spring", "coordinate": "reach", "stiffness": "300 N/m", "damping": "9 N*s/m",
          "rest": "0.2 m"}  # fmt: skip
OUTPUTS = ["O", "joint.O.force.x", "joint.O.force.y", "power.strut", "force.strut.effort"]
PROBLEMS = {
    "forward": {"kind": "forward", "time": {"end": "1 s", "samples": 21}},
    "inverse": {"kind": "inverse", "time": {"end": "1 s", "samples": 21},
                "motion": {"O": {"law": "harmonic", "amplitude": "0.3 rad", "pulsation": "5 rad/s"}}},
    "statics": {"kind": "statics", "over": {"O": {"from": "-0.4 rad", "to": "0.5 rad", "samples": 9}}},
}  # fmt: skip


def strut(t, state):
    return -300.0 * (state["reach"] - 0.2) - 9.0 * state["coordinate.reach.velocity"]


def run(problem, forces=None, outputs=OUTPUTS, **keys):
    scenario = {"pinarm": 1, "mechanism": LEVER, "problem": {**PROBLEMS[problem], **keys}, "outputs": outputs}
    return pinarm.run(scenario, forces=forces)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_a_function_that_is_a_spring_and_damper_acts_as_they_do(problem):
    outputs = [*OUTPUTS, *(["joint.O.effort"] if problem != "forward" else [])]
    given = run(problem, {"strut": ("reach", strut)}, outputs)
    known = run(problem, outputs=outputs, loads={"strut": SPRING})
    for name in outputs:
        assert given[name].values == pytest.approx(known[name].values, abs=1e-6), name
    assert np.abs(given["force.strut.effort"].values).max() > 10.0


@pytest.mark.parametrize(("forces", "message"), [
    ({"strut": ("raech", strut)}, "no coordinate 'raech'"),
    ({"strut": strut}, "the force 'strut' is "),
    ({"gravity": ("reach", strut)}, "has a force 'gravity' already"),
    ({"strut": ("reach", lambda t, state: "5 N")}, "the force function 'strut' has returned '5 N' at t = 0 s"),
    ({"strut": ("reach", lambda t, state: state["raech"])}, "no quantity 'raech'"),
    ({"strut": ("reach", lambda t, state: 1 / 0)}, "the force function 'strut' fails at t = 0 s: ZeroDivisionError"),
])  # fmt: skip
def test_mistakes_in_functions_are_told(forces, message):
    with pytest.raises(PinarmError, match=message):
        run("inverse", forces)


def test_what_functions_do_not_tell_is_refused(tmp_path):
    with pytest.raises(InputError, match="'strut' is a function in Python, which no file holds"):
        run("statics", {"strut": ("reach", strut)}).save(tmp_path / "result")
    linear = {"kind": "linear", "about": {"equilibrium": {"O": "0 rad"}}}
    scenario = {"pinarm": 1, "mechanism": LEVER, "problem": linear, "outputs": ["O"]}
    with pytest.raises(InputError, match="the force function 'strut' has no exact derivatives"):
        pinarm.run(scenario, forces={"strut": ("reach", strut)})
