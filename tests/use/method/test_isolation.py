"""Isolations of the reference mechanisms: those that their publications choose, and terms by their formulas."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.errors import InputError

SCENARIOS = Path(pinarm.__file__).parents[1] / "scenarios"
MODELS = SCENARIOS.parent / "models"


@cache
def run(name: str) -> pinarm.Result:
    return pinarm.run(SCENARIOS / f"{name}.yaml")


AXIS = "moment about {0}, along axis of {0}"
CHOSEN = [
    ("gen411_arm_dynamic", "C_B", [("BA", AXIS.format("B"))]),
    ("gen411_arm_dynamic", "F_Bx", [("BA", "resultant along x")]),
    ("gen411_arm_dynamic", "F_By", [("BA", "resultant along y")]),
    ("exoskeleton_leg_knee", "Cr", [("thigh load", AXIS.format("knee"))]),
    ("exoskeleton_leg_knee", "Cm", [("thigh load", AXIS.format("knee"))]),
    ("handling_arm_c1", "C1", [("link_1 link_2", AXIS.format("theta"))]),
    ("gyroscope_free", "theta", [("inner_gimbal rotor", AXIS.format("theta"))]),
    ("gyroscope_free", "psi", [("outer_gimbal inner_gimbal rotor", AXIS.format("psi"))]),
    ("gyroscope_free", "phi", [("rotor", AXIS.format("phi"))]),
    ("rotor_vertical", "A_x", [("tilt_x tilt_y rotor", "moment about B, along y of rotor")]),
    ("rotor_vertical", "B_y", [("tilt_x tilt_y rotor", "moment about tilt_x, along x of rotor")]),
    ("manipulator_pressure", "p",
     [("link_3 arm support cylinder rod", "kinetic energy of the whole, per unit rate of y")]),
    ("manipulator_operator", "coordinate.P_height.effort",
     [("link_3 arm support cylinder rod", "kinetic energy of the whole, per unit rate of P_height")]),
    ("manipulator_falling", "alpha",
     [("link_3 arm support cylinder rod", "kinetic energy of the whole, per unit rate of alpha")]),
    ("olive_vibrator_resonance", "X53", [("vibrator rotor", "resultant along axis of X")]),
    ("olive_vibrator_resonance", "Z53", [("link_2 vibrator rotor", AXIS.format("theta"))]),
    ("olive_vibrator_resonance", "Y53", [("boom link_2 vibrator rotor", "resultant along axis of Y")]),
    ("olive_vibrator_resonance", "beta", [
        ("boom link_2 vibrator rotor", "resultant along axis of Y"), ("vibrator rotor", "resultant along axis of X"),
        ("link_2 vibrator rotor", AXIS.format("theta")), ("trunk", AXIS.format("beta"))]),
]  # fmt: skip


@pytest.mark.parametrize(("scenario", "wanted", "chosen"), CHOSEN)
def test_the_isolation_is_that_of_the_publication(scenario: str, wanted: str, chosen: list[tuple[str, str]]) -> None:
    found = run(scenario).isolate(wanted)
    assert [(" ".join(one.bodies), one.theorem) for one in found.equations] == chosen
    assert found.residual < 1e-12
    assert all(one.residual < 1e-12 for one in found.equations)


def test_the_forces_of_an_opened_joint_come_one_by_one() -> None:
    found = run("olive_vibrator_resonance").isolate("beta", "max(beta)")
    assert [one.gives for one in found.equations] == ["gives Y53", "gives X53", "gives Z53", ""]
    assert "17 connected groups" in found.verdict


def values(found: object) -> dict[str, float]:
    return {term.name: term.value for equation in found.equations for term in equation.terms}  # type: ignore[attr-defined]


def test_terms_of_the_arm_are_those_of_its_formula() -> None:
    """``C_B - g l2 cos phi (m_A + m_BA/2) = l2^2 (m_A + m_BA/3) alpha``."""
    for angle in (-60.0, 0.0, 45.0):
        terms = values(run("gen411_arm_dynamic").isolate("C_B", f"phi={angle} deg"))
        assert terms["weight of BA"] == pytest.approx(-9.81 * 0.25 * np.cos(np.radians(angle)) * 0.6, rel=1e-12)
        assert terms["inertia of BA"] == pytest.approx(0.25**2 * (0.1 + 1.0 / 3.0) * 5.0, rel=1e-12)


def test_terms_of_the_gyroscope_are_those_of_its_equation() -> None:
    """``A theta'' - A psi'^2 sin cos + C psi' (phi' + psi' cos) sin = 0``; sources of velocities and accelerations."""
    result = run("gyroscope_free")
    found = result.isolate("theta", "t=0.3 s")
    terms, row = values(found), int(np.argmin(np.abs(result.parameter.values - 0.3)))
    theta, psd, thdd, spin = (float(result[name].values[row]) for name in ("theta", "psd", "thdd", "r"))
    assert terms["inertia of rotor, accelerations"] == pytest.approx(0.02 * thdd, rel=1e-9)
    turning = -0.02 * psd**2 * np.sin(theta) * np.cos(theta) + 0.035 * psd * spin * np.sin(theta)
    assert terms["inertia of rotor, velocities"] == pytest.approx(turning, rel=1e-9)


def test_the_manipulator_has_the_powers_of_its_key() -> None:
    """Weights: ``-m1 g (l-d)/2 cos``, ``-m g l cos - m2 g l cos``, ...; air ``p S r cos``; operator ``F l``."""
    result = run("manipulator_motion")
    found = result.isolate("joint.alpha.effort", "t=1 s")
    terms, angle = values(found), float(np.interp(1.0, result.parameter.values, result["alpha"].values))
    cosine = np.cos(angle)
    assert terms["weight of link_3"] == pytest.approx(-60 * 9.81 * 1.0 * cosine, rel=1e-9)
    assert terms["weight of support"] == pytest.approx(-(120 + 600) * 9.81 * 2.0 * cosine, rel=1e-9)
    assert terms["weight of arm"] == pytest.approx(9.81 * (270 * 1.25 - 100 * 0.375) * cosine, rel=1e-9)
    assert terms["operator"] == pytest.approx(250 * 2.0, rel=1e-12)
    assert terms["air_on_rod"] == pytest.approx(9000 * 0.75 * cosine, rel=1e-9)
    assert found.alternatives  # the chain that opens the loops


SIZES = {"l": 2, "d": 1.25, "r": 0.75, "h": 2, "AE": 0.6, "x_G2": 0.3, "y_G2": -0.2, "x_G7": 0.5, "y_G7": 0.1,
         "x_P": 0.4, "y_P": 0.7}  # fmt: skip


@pytest.mark.parametrize("wanted", ["loop.D.force.x", "joint.alpha.force.x"])
def test_a_mechanism_of_another_size_has_the_same_isolations(wanted: str) -> None:
    chosen = []
    for factor in (1e-6, 1.0, 1e6):
        arguments = {name: f"{size * factor!r} m" for name, size in SIZES.items()}
        mechanism = pinarm.Mechanism.load(MODELS / "manipulator" / "mechanism.yaml", arguments)
        found = mechanism.isolate(wanted, drives=["y"])
        chosen.append([(one.bodies, one.theorem, one.gives) for one in found.equations])
    assert chosen[0] == chosen[1] == chosen[2] != []


def test_a_body_without_mass_on_which_loads_act_passes_nothing_on() -> None:
    """The air pushes the cylinder up with 9 kN; the slide to the ground holds it down."""
    found = run("manipulator_motion").isolate("joint.x.force.y")
    assert found.equations[0].bodies == ("cylinder",)
    assert found.value == pytest.approx(-9000.0, rel=1e-12)


def test_reasons_name_why_an_action_has_no_part() -> None:
    found = pinarm.isolate(MODELS / "rotor_in_bearings" / "mechanism.yaml", "A_x")
    assert found.equations[0].vanishing == (
        ("action of B", "its force meets the axis, it transmits no moment along it"),
    )
    assert not found.where
    assert np.isnan(found.value)


def test_the_moment_of_a_joint_along_its_spring_is_refused() -> None:
    """It is the effort of the drive, which the equations give, and of the spring, which they do not tell."""
    arm = pinarm.Mechanism.load(
        MODELS / "handling_arm" / "mechanism.yaml",
        values={"forces": {"spring": {"kind": "joint_spring", "joint": "phi", "stiffness": "30 N*m/rad"}}},
    )
    q, v, a = (arm.rates({"theta": x, "phi": y}) for x, y in ((0.3, 0.7), (1.0, -2.0), (4.0, 5.0)))
    assert arm.isolate("C2", q, v, a).residual < 1e-12
    with pytest.raises(InputError, match="such as a spring in the joint"):
        arm.isolate("joint.phi.moment.z", q, v, a)


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        ("joint.B.force.norm", "length of a vector"), ("joint.B.force.z", "hyperstatic or known"),
        ("C_B + F_Bx", "depends on"), ("joint.C.effort", "no quantity"), ("A_x", "none of them"),
    ],
)  # fmt: skip
def test_what_no_equation_gives_is_refused(wanted: str, said: str) -> None:
    if said == "hyperstatic or known":
        assert run("gen411_arm_dynamic").isolate(wanted).solution == 0.0
        return
    with pytest.raises(InputError, match=said):
        run("gen411_arm_dynamic").isolate(wanted)


def test_an_instant_is_no_figure_of_the_run_and_a_run_without_efforts_has_no_numbers() -> None:
    with pytest.raises(InputError, match="figure of the whole run"):
        run("gen411_arm_dynamic").isolate("C_B", "rms")
    found = run("magic_arms_kinematics").isolate("alpha")
    assert found.equations[0].bodies == ("arm_1", "arm_2", "gondola")
    assert not found.where


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    path = str(SCENARIOS / "gen411_arm_dynamic.yaml")
    assert main(["explain", path, "--for", "C_B", "--at", "phi=0 deg"]) == 0
    text = capsys.readouterr().out
    assert "isolate BA: moment about B, along axis of B" in text
    assert "1.60691667 N*m" in text
    assert main(["explain", path, "--for", "C_B", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["wanted"]["quantity"] == "joint.B.effort"
    assert main(["explain", str(MODELS / "gen411_arm" / "mechanism.yaml"), "--for", "C_B", "--at", "t=1 s"]) == 2


def ladder(folder: Path, bays: int) -> Path:
    """Write uprights on the ground side by side, each tied to the next by a bar: as many loops as bays."""
    names = [k for k in range(bays + 1)]
    points = [f"O{k}: [{500 * k} mm, {10 * k} mm], A{k}: [{530 * k + 20} mm, {300 + 20 * k} mm]" for k in names]
    links = [f"    c{k}: {{points: [O{k}, A{k}], mass: 1 kg}}\n" for k in names]
    links += [f"    p{k}: {{points: [A{k - 1}, A{k}], mass: 1 kg}}\n" for k in names[1:]]
    ground = ", ".join(f"O{k}" for k in names)
    file = folder / "mechanism.yaml"
    file.write_text(
        f"pinarm: 1\nplanar:\n  points: {{{', '.join(points)}}}\n  ground: [{ground}]\n  links:\n{''.join(links)}"
    )
    return file


@pytest.mark.parametrize("bays", [1, 2, 4])
def test_each_loop_that_is_opened_at_a_pin_adds_two_equations(bays: int, tmp_path: Path) -> None:
    found = pinarm.Mechanism.load(ladder(tmp_path, bays)).isolate("joint.O0.effort", drives=["O0"])
    assert f"; {2 * bays + 1} equations with" in found.alternatives[0]


def test_an_equation_of_several_names_what_is_wanted(tmp_path: Path) -> None:
    found = pinarm.Mechanism.load(ladder(tmp_path, 1)).isolate("joint.O0.force.x", drives=["O0"])
    assert [term.name for term in found.equations[-1].terms if term.role == "unknown"] == [
        "joint.O0.force.x",
        "action of A1",
    ]


def test_a_formula_that_is_asked_for_has_its_value() -> None:
    """The gear of ratio 120 and efficiency 0.75 carries the torque of the knee, which its motor drives."""
    found = run("exoskeleton_leg_knee").isolate("Cm", "t=1.4 s")
    assert float(found.asked.removesuffix(" N*m")) == pytest.approx(found.value / 120 / 0.75, rel=1e-8)
    assert str(found).splitlines()[-1] == f"Cm = {found.asked}"


@pytest.mark.parametrize("angle", [-90.0, 90.0])
def test_an_equation_of_which_only_rounding_is_left_holds(angle: float, tmp_path: Path) -> None:
    """A rod above or below its pivot, at the world's origin: no weight has a moment there."""
    (tmp_path / "mechanism.yaml").write_text(
        "pinarm: 1\nplanar:\n  points: {O: [0, 0], A: [0.3 m, 0.1 m], B: [0.7 m, -0.2 m]}\n  ground: [O]\n"
        "  links: {a: {points: [O, A], mass: 1 kg}, b: {points: [A, B], mass: 0.7 kg}}\n"
    )
    arm = pinarm.Mechanism.load(tmp_path / "mechanism.yaml")
    inner, outer = np.arctan2(0.1, 0.3), np.arctan2(-0.3, 0.4)
    q = arm.rates({"O": np.radians(angle) - inner, "A": inner - outer})
    found = arm.isolate("joint.O.effort", q, drives=["O", "A"])
    assert abs(found.value) < 1e-14
    assert found.residual < 1e-14


@pytest.mark.parametrize(("name", "terms"), [("gear", {"joint.in.force.x", "action of C"}),
                                             ("belt", {"joint.in.force.x", "pretension of C"})])  # fmt: skip
def test_the_reaction_of_a_wheel_has_the_force_of_teeth_or_belt(name: str, terms: set[str]) -> None:
    """In numbers and without: the pretension of a belt is no unknown, and no zero."""
    result = pinarm.run(SCENARIOS.parent / "docs" / "kind_examples" / "couplings" / f"{name}.yaml")
    for derivation in (result.isolate("joint.in.force.x"), result.trajectory.mechanism.isolate("joint.in.force.x")):
        assert {term.name for term in derivation.equations[-1].terms} == terms
    assert result.isolate("joint.in.force.x").residual < 1e-12


def test_of_many_bodies_single_ones_and_those_beyond_a_joint_are_looked_at() -> None:
    """Eighty bodies; and one behind a floating joint, parts of which transmit nothing."""
    words = str(pinarm.Mechanism.load(MODELS / "bicycle" / "mechanism.yaml").isolate("joint.steer.effort"))
    assert "isolate fork + front_wheel: moment about steer, along axis of steer" in words
    words = str(pinarm.Mechanism.load(MODELS / "forty_four_bars" / "mechanism.yaml").isolate("joint.upright_0.effort"))
    assert "the theorem of kinetic energy gives joint.upright_0.effort" in words
