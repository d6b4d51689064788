"""Numbers far beyond mechanics: each ends in words, with bounded work."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import DynamicsError, InputError, PinarmError

SCENARIOS = Path(pinarm.__file__).parents[1] / "scenarios"


@pytest.mark.parametrize("value", ["1e308", "1e-300"])
@pytest.mark.parametrize(
    ("scenario", "path", "unit"),
    [
        ("crank_rocker_turning", "problem.motion.theta2.speed", "rad/s"),
        ("gen411_arm_static", "arguments.m_A", "kg"), ("gen411_arm_swing", "arguments.l1", "m"),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("error")
def test_no_number_ends_in_a_traceback_or_a_warning(scenario: str, path: str, unit: str, value: str, no_hang: None
                                                    ) -> None:  # fmt: skip
    try:
        given = pinarm.load(SCENARIOS / f"{scenario}.yaml", {path: f"{value} {unit}", "accuracy.max_steps": 1000})
        given.validate()
        given.run()
    except PinarmError as error:
        assert str(error)


@pytest.mark.parametrize(("given", "line"), [
    ("planar: {points: {A: [0 m, 0 m],\n B: [1e300 m, 0 m]}, ground: [A], links: {l: {points: [A, B]}}}", 2),
    ("robot: far.urdf", 2),
])  # fmt: skip
@pytest.mark.filterwarnings("error")
def test_places_beyond_all_lengths_are_refused_on_their_line(tmp_path: Path, given: str, line: int) -> None:
    """LAPACK wrote to the terminal, or eigenvalues did not converge, without a word on where the number is."""
    (tmp_path / "far.urdf").write_text(
        '<robot name="far"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link>\n<joint name="x" type="continuous"><origin xyz="0 0 -1e60"/>'
        '<parent link="a"/><child link="b"/></joint></robot>'
    )
    (tmp_path / "mechanism.yaml").write_text(f"{given}\npinarm: 1\n")
    with pytest.raises(PinarmError, match=r"1e\+(300|60)") as caught:
        pinarm.Mechanism.load(tmp_path / "mechanism.yaml")
    assert caught.value.location is not None
    assert caught.value.location.line == line
    assert caught.value.hint == "check the exponent and the unit"


@pytest.mark.filterwarnings("error")
def test_laws_that_are_too_fast_are_named() -> None:
    """Rows without any number are kept, with their headlines, without a word of Python's."""
    fast = {"law": "constant_acceleration", "acceleration": "1e100 rad/s^2"}
    values = {"problem.motion.alpha": fast, "problem.time.end": "1e100 s"}
    with pytest.raises(DynamicsError, match="is not finite at") as caught:
        pinarm.run(SCENARIOS / "magic_arms_kinematics.yaml", values)
    assert caught.value.hint.endswith("numbers beyond 1e150 there")
    kept = caught.value.partial
    with np.errstate(all="ignore"):  # as where rows are saved
        assert all(kept.headline(column) for column in kept.columns())


def test_fixed_steps_that_are_too_short_are_named_as_such() -> None:
    values = {"accuracy": {"method": "rk4", "step": "1e-300 s"}}
    with pytest.raises(InputError, match="steps of 1e-300 s are too short for 2 s"):
        pinarm.run(SCENARIOS / "gen411_arm_swing.yaml", values)


def test_huge_velocities_are_given_up_early() -> None:
    values = {"problem.initial.velocity": {"O": "1e9 rad/s"}, "accuracy.max_steps": 4000}
    with pytest.raises(PinarmError, match=r"has taken 1\d\d\d steps"):
        pinarm.run(SCENARIOS / "gen411_arm_swing.yaml", values)
