"""Torsors: change of point, comoment as power, zeros of joints, what rigid bodies do not determine."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError

SCENARIOS = Path(pinarm.__file__).parents[1] / "scenarios"


@cache
def run(name: str) -> pinarm.Result:
    return pinarm.run(SCENARIOS / f"{name}.yaml")


@pytest.mark.parametrize(
    ("scenario", "of", "options", "shape"),
    [
        ("gen411_arm_swing", "B", {}, "X Y Z L M 0"),
        ("gen411_arm_dynamic", "B", {}, "X Y Z L M N"),  # its motor is part of it
        ("rotor_vertical", "tilt_x", {}, "X Y Z 0 M N"),
        ("rotor_vertical", "B", {"along": "rotor"}, "X Y 0 0 0 0"),
        ("rotor_vertical", "B", {"at": "tilt_x", "along": "rotor"}, "X Y 0 L M 0"),
        ("rotor_vertical", "phi", {"kind": "kinematic", "along": "rotor"}, "0 0 r 0 0 0"),
        ("olive_vibrator_resonance", "X", {"along": "link_2"}, "0 Y Z L M N"),
        ("olive_vibrator_resonance", "O3", {"along": "link_2"}, "X Y Z 0 0 0"),
        ("olive_vibrator_resonance", "O3", {"kind": "kinematic"}, "p q 0 0 0 0"),
        ("olive_vibrator_resonance", "boom", {"kind": "kinetic"}, "0 P_y 0 0 0 0"),
    ],
)
def test_the_shape_is_that_of_the_joint(scenario: str, of: str, options: dict[str, str], shape: str) -> None:
    assert " ".join(run(scenario).torsor(of, **options).shape) == shape


def test_another_point_and_basis_are_those_of_the_quantities() -> None:
    result = run("gen411_arm_dynamic")
    found = result.torsor("B", at="A", along="BA")
    for k, axis in enumerate("xyz"):
        np.testing.assert_allclose(found.resultant[:, k], result[f"joint.B.force.along.BA.{axis}"].values, atol=1e-12)
        moment = result[f"joint.B.moment.about.A.along.BA.{axis}"].values
        np.testing.assert_allclose(found.moment[:, k], moment, atol=1e-12)
    dynamic = result.torsor("BA", at="B", kind="dynamic")
    np.testing.assert_allclose(dynamic.moment[:, 2], result["dynamic.B.moment.about.B.z"].values, atol=1e-12)
    kinetic = run("gyroscope_free").torsor("rotor", kind="kinetic", along="rotor")
    np.testing.assert_allclose(kinetic.moment[:, 2], 0.035 * run("gyroscope_free")["r"].values, rtol=1e-12)


def test_the_comoment_is_a_power_at_any_point() -> None:
    """Of an action and the motion in the joint: effort times rate, whatever the point; 0 of a ball joint's."""
    result = run("handling_arm_profile")
    action, motion = result.torsor("phi"), result.torsor("phi", kind="kinematic")
    power = result["joint.phi.power"].values
    size = np.abs(power).max()
    assert size > 1.0
    np.testing.assert_allclose(action.comoment(motion), power, atol=1e-12 * size)
    away = motion.moved_to(np.array([3.0, -1.0, 2.0]), "away")
    np.testing.assert_allclose(away.comoment(action), power, atol=1e-11 * size)
    loop = run("olive_vibrator_resonance")
    held = loop.torsor("O3").comoment(loop.torsor("O3", kind="kinematic"))
    lost = -15.0 * loop["bed"].values ** 2  # friction of the ball joint, which the model has at beta
    assert np.abs(held).max() < 1e-6 * np.abs(lost).max()


def test_what_rigid_bodies_do_not_determine_has_no_number() -> None:
    found = run("manipulator_motion").torsor("F")
    assert found.undetermined.tolist() == [False, False, True, True, True, False]
    assert np.isnan(found.components[:, 2:5]).all()
    assert "undetermined" in str(found)


@pytest.mark.parametrize(
    ("of", "options", "said"),
    [
        ("C", {}, "no joint"), ("B", {"at": "nowhere"}, "no point 'nowhere'"), ("B", {"kind": "kinetic"}, None),
        ("O", {"kind": "potential"}, "no kind of torsor"), ("BA", {"kind": "static"}, "no joint"),
    ],
)  # fmt: skip
def test_mistakes_are_told(of: str, options: dict[str, str], said: str | None) -> None:
    if said is None:
        assert run("gen411_arm_dynamic").torsor(of, **options).kind == "kinetic"  # B is a link, too
        return
    with pytest.raises(InputError, match=said):
        run("gen411_arm_dynamic").torsor(of, **options)
