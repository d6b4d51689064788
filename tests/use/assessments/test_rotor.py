"""Balance of rotors against closed forms of their unbalance, and against the forces in their bearings."""

from math import cos, hypot, pi, sin
from pathlib import Path

import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.assessments.elements import grade

ROUNDING = 1e-12
"""Relative: sums of a few terms."""
M, E, OMEGA = 12.0, 0.5e-3, 100 * pi


def balance(scenario: str, rotor: dict[str, object]) -> tuple[dict[str, float], list[str]]:
    section = pinarm.run(f"scenarios/{scenario}.yaml", {"loads": {"rotors": {"phi": rotor}}}).sections["loads"]
    return {name: float(series.values[0]) for name, series in section.numbers.items()}, list(section.remarks)


def test_static_unbalance_is_mass_times_eccentricity() -> None:
    found, remarks = balance("rotor_vertical", {})
    assert found["phi.unbalance"] == pytest.approx(M * E, rel=ROUNDING)
    assert found["phi.eccentricity"] == pytest.approx(E, rel=ROUNDING)
    assert found["phi.quality"] == pytest.approx(E * OMEGA, rel=ROUNDING)
    assert remarks == ["phi: e omega = 157.1 mm/s at 3000 rpm, static unbalance only: G 250 of ISO 21940-11"]


def test_unbalance_in_the_planes_of_the_bearings_is_what_these_feel() -> None:
    """The rotating forces there over omega²; the answer key has A = (-2.5e-3, -2.5e-4), B = (-3.5e-3, 2.5e-4) kg m."""
    found, _ = balance("rotor_vertical", {"planes": ["-0.2 m", "0.2 m"]})
    assert found["phi.unbalance.1"] == pytest.approx(hypot(2.5e-3, 2.5e-4), rel=ROUNDING)
    assert found["phi.unbalance.2"] == pytest.approx(hypot(3.5e-3, 2.5e-4), rel=ROUNDING)
    assert found["phi.quality"] == pytest.approx(hypot(3.5e-3, 2.5e-4) / (M / 2) * OMEGA, rel=ROUNDING)


@pytest.mark.parametrize(("second", "share"), [("0.3 m", 0.6), ("0.45 m", 9 / 13), ("1.8 m", 0.7)])
def test_the_lever_rule_ends_at_seven_to_three(second: str, share: float) -> None:
    """The plane at -0.2 m has the share L_2/L of what is permitted, but at most 0.7 of it, the other at least 0.3."""
    found, _ = balance("rotor_vertical", {"planes": ["-0.2 m", second]})
    each = found["phi.unbalance.1"] / share, found["phi.unbalance.2"] / (1.0 - share)
    assert found["phi.quality"] == pytest.approx(max(M * E, *each) / M * OMEGA, rel=ROUNDING)


def test_a_statically_balanced_rotor_is_graded_by_its_couple() -> None:
    """Its planes hold opposite unbalances, of the products of inertia over their distance."""
    planes = {"planes": ["-0.2 m", "0.2 m"]}
    found, _ = balance("rotor_static_balance", {})
    assert found["phi.quality"] < 1e-9  # rounding of U, 1e-17 kg m
    found, _ = balance("rotor_static_balance", planes)
    assert found["phi.unbalance.1"] == pytest.approx(found["phi.unbalance.2"], rel=1e-9)
    assert found["phi.quality"] > 1e-3


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_balanced_rotor_is_so_but_for_rounding(tmp_path: Path, tilt: float) -> None:
    """Eight masses, each with its mirror image on the other side of the axis: all of its unbalance is rounding."""
    places = [(0.1 * k * cos(7 * k + tilt), 0.1 * k * sin(7 * k + tilt), 0.37 / k) for k in range(1, 9)]
    links = ["<link name='base'/><link name='rotor'/><joint name='x' type='continuous'><parent link='base'/>"
             "<child link='rotor'/><axis xyz='0 0 1'/></joint>"]  # fmt: skip
    for k, (x, y, z) in enumerate([*places, *((-x, -y, z) for x, y, z in places)]):
        links.append(
            f"<link name='l{k}'><inertial><mass value='{0.1 * (k % 8 + 1)!r}'/><inertia ixx='0' iyy='0' izz='0' "
            f"ixy='0' ixz='0' iyz='0'/></inertial></link><joint name='j{k}' type='fixed'><parent link='rotor'/>"
            f"<child link='l{k}'/><origin xyz='{x!r} {y!r} {z!r}'/></joint>"
        )
    (tmp_path / "rotor.urdf").write_text(f"<robot name='rotor'>{''.join(links)}</robot>")
    motion = {"x": {"law": "constant_speed", "speed": f"{OMEGA} rad/s"}}
    section = pinarm.run({
        "pinarm": 1, "mechanism": pinarm.Mechanism.load(tmp_path / "rotor.urdf"), "outputs": ["x"],
        "problem": {"kind": "inverse", "time": {"end": "1 s", "samples": 3}, "motion": motion},
        "loads": {"rotors": {"x": {"planes": ["-1 m", "1 m"]}}},
    }).sections["loads"]  # fmt: skip
    for name in ("unbalance", "eccentricity", "unbalance.1", "unbalance.2", "quality"):
        assert section.numbers[f"x.{name}"].values[0] < 1e-10


def test_correction_masses_make_it_of_the_finest_grade() -> None:
    """Those of the scenario rotor_balanced, as printed: to 0.005 g and 0.005 deg of 50 g at 80 mm."""
    corrected = {"m_c1": "27.58 g", "a_c1": "-169.11 deg", "m_c2": "48.20 g", "a_c2": "173.80 deg"}
    values = {"arguments": corrected, "loads": {"rotors": {"phi": {"planes": ["-0.12 m", "0.12 m"]}}}}
    section = pinarm.run("scenarios/rotor_vertical.yaml", values).sections["loads"]
    left = 0.08 * hypot(5e-6, 0.05 * 0.005 * pi / 180) * 2  # in each plane, kg m
    assert float(section.numbers["phi.quality"].values[0]) < left / (M / 2) * OMEGA
    assert section.remarks[0].endswith("G 0.4 of ISO 21940-11")


@pytest.mark.parametrize(("quality", "said"), [(0.4e-3, "G 0.4 "), (2.5001e-3, "G 6.3 "), (5.0, "beyond G 4000")])
def test_grades_are_those_of_the_standard(quality: float, said: str) -> None:
    assert said in grade(quality)


@pytest.mark.parametrize(("rotors", "said"), [
    ({"psi": {}}, "no revolute joint 'psi'"),
    ({"tilt_x": {}}, "tilt_y, phi move beyond 'tilt_x'"),
    ({"phi": {"planes": ["1 cm", "1 cm"]}}, "same place"),
])  # fmt: skip
def test_what_is_no_rotor_is_refused_before_anything_is_solved(rotors, said) -> None:
    with pytest.raises(InputError, match=said):
        pinarm.validate("scenarios/rotor_vertical.yaml", {"loads": {"rotors": rotors}})


def test_planes_on_one_side_are_refused() -> None:
    with pytest.raises(InputError, match="not between the planes"):
        balance("rotor_vertical", {"planes": ["0.1 m", "0.2 m"]})
