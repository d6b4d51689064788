"""The inertia of a load: of a pendulum among springs and losses, of a linkage from its energy, of an arm by hand."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import pinarm
from pinarm.use.assessments.duty import duty_of, load_inertia

ROOT = Path(pinarm.__file__).parents[1]
LINK = (
    '<link name="{name}"><inertial><origin xyz="{c} 0 0"/><mass value="{m}"/>'
    '<inertia ixx="0.1" iyy="0.1" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/></joint>'
)
TWO_LINKS = (
    '<robot name="arm"><link name="base"/>'
    + LINK.format(name="upper", c=0.3, m=2.0, i=0.2)
    + LINK.format(name="fore", c=0.4, m=1.5, i=0.1)
    + JOINT.format(name="a", parent="base", child="upper", x=0)
    + JOINT.format(name="b", parent="upper", child="fore", x=0.6)
    + "</robot>"
)
WHOLE = {"law": "harmonic", "amplitude": "0.5 rad", "pulsation": "3 rad/s"}


def arm(folder: Path, problem: dict[str, Any], **mechanism: Any) -> Any:
    (folder / "arm.urdf").write_text(TWO_LINKS)
    drives = {"m": {"joint": "a", "ratio": 50.0, "rotor_inertia": "1e-4 kg*m^2", "efficiency": 0.7}}
    described = {"pinarm": 1, "robot": "arm.urdf", "gravity": {"direction": "-y"}, "drives": drives, **mechanism}
    grid = {"end": "1 s", "samples": 21}
    (folder / ".pinarm-root").touch()
    (folder / "arm.yaml").write_text(json.dumps(described))
    scenario: dict[str, Any] = {
        "pinarm": 1,
        "mechanism": "arm.yaml",
        "problem": {"time": grid, **problem},
        "outputs": ["a", "b"],
    }
    (folder / "s.yaml").write_text(json.dumps(scenario))
    return pinarm.run(folder / "s.yaml")


def locked(b: Any) -> Any:
    """Inertia about the shoulder with the elbow held."""
    return 0.2 + 2.0 * 0.3**2 + 0.1 + 1.5 * (0.6**2 + 0.4**2 + 2 * 0.6 * 0.4 * np.cos(b))


def test_other_drives_are_held_and_weights_springs_and_losses_have_no_part(tmp_path: Path) -> None:
    spring = {"s": {"kind": "joint_spring", "joint": "a", "stiffness": "1000 N*m/rad", "damping": "30 N*m*s/rad"}}
    result = arm(tmp_path, {"kind": "inverse", "motion": {"a": WHOLE, "b": {**WHOLE, "mean": "1 rad"}}}, forces=spring)
    rotor = 1e-4 * 50.0**2
    assert load_inertia(result.trajectory, "a") == pytest.approx(rotor + locked(result["b"].values), rel=1e-13)
    duty = duty_of(result.lookup, "a", rotor, 0.7, 0.0)
    energy, square = (
        quad(lambda t, of=of: of(t) * np.cos(3.0 * t) ** 2, 0.0, 1.0, epsabs=1e-14, epsrel=1e-14)[0]
        for of in (lambda t: locked(1.0 + 0.5 * np.sin(3.0 * t)), lambda t: 1.0)
    )
    mean, error = duty.load_inertia
    assert mean == pytest.approx(energy / square, abs=error + 1e-14)  # of quad
    assert error < 1e-12


def test_a_joint_without_a_drive_gives_way(tmp_path: Path) -> None:
    """Of a double pendulum driven at the shoulder: ``M_aa - M_ab² / M_bb``."""
    result = arm(tmp_path, {"kind": "forward", "motion": {"a": WHOLE}, "initial": {"position": {"b": "1 rad"}}})
    b = result["b"].values
    coupled, own = 0.1 + 1.5 * (0.4**2 + 0.6 * 0.4 * np.cos(b)), 0.1 + 1.5 * 0.4**2
    felt = 1e-4 * 50.0**2 + locked(b) - coupled**2 / own
    assert load_inertia(result.trajectory, "a") == pytest.approx(felt, rel=1e-12)


@pytest.mark.parametrize("more", [{}, {"share": "least_squares"}])
def test_of_a_linkage_with_one_drive_it_follows_from_the_kinetic_energy(more: dict[str, str]) -> None:
    problem = {
        "kind": "inverse", "time": {"end": "1.2 s", "samples": 41}, "drives": ["theta2", *(["theta4"] if more else [])],
        "motion": {"theta2": {"law": "constant_speed", "speed": "50 rpm"}}, **more,
        "start": {"theta2": "0 rad", "A": "40 deg", "theta4": "80 deg"},
    }  # fmt: skip
    scenario = {"pinarm": 1, "mechanism": str(ROOT / "models/crank_rocker/mechanism.yaml"), "problem": problem,
                "outputs": ["energy.kinetic"]}  # fmt: skip
    result = pinarm.run(scenario)
    felt = load_inertia(result.trajectory, "theta2")
    if more:  # the other drive, held, holds the crank
        assert np.isinf(felt).all()
        return
    speed = 50.0 * 2.0 * np.pi / 60.0
    assert felt == pytest.approx(2.0 * result["energy.kinetic"].values / speed**2, rel=1e-9)  # closed to rounding
    assert np.ptp(felt) > 0.1 * felt.mean()
