"""What is kept with a scenario: runs of it, and of it with other values, begin where the first one did."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import InputError


def same(result, other):
    """Tell whether two results are the same to the last bit."""
    one, two = result.trajectory, other.trajectory
    arrays = all(np.array_equal(getattr(one, name), getattr(two, name)) for name in ("q", "v", "a", "tau"))
    return arrays and np.array_equal(one.lam, two.lam) and result.figures == other.figures


def test_other_values_keep_the_mechanism_unless_they_are_its_own(scenario):
    one = scenario("forward")
    mechanism = one.mechanism
    shorter = one.varied({"problem.time.end": "3 s"})
    assert shorter.mechanism is mechanism
    assert same(shorter.run(), pinarm.run(one.document.path, {"problem.time.end": "3 s"}))
    for other in ({"gravity": "none"}, {"changes": {"drives": {"motor": {"ratio": 50}}}},
                  {"payloads": {"ball": {"point": "tip", "mass": "1 kg"}}}):  # fmt: skip
        changed = one.varied(other)
        assert changed.mechanism is not mechanism
        assert same(changed.run(), pinarm.run(one.document.path, other))


def test_a_model_of_pinocchio_in_place_of_a_mechanism_is_answered_with_what_makes_one():
    data = {"pinarm": 1, "mechanism": pin.buildSampleModelManipulator(), "outputs": ["t"], "problem": {"kind": "state"}}
    with pytest.raises(InputError, match=r"a model of Pinocchio\n.*\n  try: pinarm\.Mechanism\.of\(model\)"):
        pinarm.run(data)


def test_a_mechanism_may_be_the_data_of_its_file(tmp_path: Path) -> None:
    """A pendulum of 1 kg, a rod of 0.5 m on its pin: torque ``m g l/2 cos(a)``."""
    drawn = {"points": {"O": [0, 0], "E": ["0.5 m", 0]}, "ground": ["O"],
             "links": {"rod": {"points": ["O", "E"], "mass": "1 kg"}}}  # fmt: skip
    asked = {"pinarm": 1, "mechanism": {"pinarm": 1, "planar": drawn}, "outputs": ["joint.O.effort"],
             "problem": {"kind": "statics", "hold": {"O": "60 deg"}}}  # fmt: skip
    result = pinarm.run(asked)
    assert result["joint.O.effort"].values == pytest.approx([9.81 * 0.25 * 0.5], rel=1e-9)
    result.save(tmp_path / "saved")
    with pytest.raises(InputError, match="point"):
        pinarm.run({**asked, "mechanism": {"pinarm": 1, "planar": {**drawn, "points": 3}}})


@pytest.mark.parametrize("nothing", [[], None])
def test_what_is_no_scenario_is_refused_in_words(nothing: object) -> None:
    with pytest.raises(InputError, match="no scenario"):
        pinarm.run(nothing)  # type: ignore[arg-type]


@pytest.mark.parametrize("nothing", [{}, None, "x"])
def test_what_is_no_model_is_refused_in_words(nothing: object) -> None:
    with pytest.raises(InputError, match=r"made of a pin\.Model"):
        pinarm.Mechanism.of(nothing)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="robot: the model is given already"):
        pinarm.Mechanism.of(pin.Model(), robot="x")
