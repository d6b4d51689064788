"""Derivatives and bands of mechanisms in closed form: open chains, a four-bar, and a motion that is integrated."""

from collections.abc import Mapping
from math import cos, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pinarm
from pinarm.arrays import Array
from pinarm.errors import PinarmError
from pinarm.use.result.section import Section, SectionTable

SWING = "scenarios/gen411_arm_swing.yaml"
ARM, FOUR_BAR = "scenarios/gen411_arm_static.yaml", "scenarios/crank_rocker_turning.yaml"
G, L, M_A, M_BA = 9.81, 0.25, 0.1, 1.0
"""Of the arm: C_B = g l2 cos(phi) (m_A + m_BA/2), largest at phi = 0."""
FEW = {"problem.over.phi": {"from": "-10 deg", "to": "10 deg", "samples": 3}, "expect": []}
"""Fewer rows, so that runs are quick."""
PENDULUM = """\
<robot name="pendulum" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="l" default="0.8"/>
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 ${-$(arg l)}"/><mass value="2"/>
    <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint>
</robot>
"""


def section(path: str, asked: Mapping[str, Any], **more: Any) -> Section:
    found = pinarm.run(path, {**more, "sensitivity": asked}).sections["sensitivity"]
    assert isinstance(found, Section)
    return found


def rows(table: SectionTable) -> dict[str, dict[str, Any]]:
    return {str(row[0]): dict(zip(table.columns[1:], row[1:], strict=True)) for row in table.rows}


def values(found: Section) -> dict[str, float]:
    return {name: float(series.values[0]) for name, series in found.numbers.items()}


def test_the_torque_of_an_arm_by_length_and_masses() -> None:
    found = section(ARM, {"of": ["C_B @ max"], "to": {"l2": "250 ± 2 mm", "m_A": "5 %", "m_BA": "0.01 kg"}}, **FEW)
    effects = rows(found.tables[1])
    exact = {"l2": G * (M_A + M_BA / 2), "m_A": G * L, "m_BA": G * L / 2}
    parts = {"l2": exact["l2"] * 2e-3, "m_A": exact["m_A"] * 5e-3, "m_BA": exact["m_BA"] * 1e-2}
    square = sum(part**2 for part in parts.values())
    for name, derivative in exact.items():
        assert abs(effects[name]["derivative"] - derivative) <= effects[name]["its error"] < 1e-8
        assert effects[name]["± of the number"] == pytest.approx(parts[name], rel=1e-9)
        assert effects[name]["% of root-sum-square"] == pytest.approx(100 * parts[name] ** 2 / square, rel=1e-9)
    assert effects["m_A"]["unit of derivative"] == "N*m/kg"
    bands = rows(found.tables[0])["C_B @ max"]
    assert bands["± worst case"] == pytest.approx(sum(parts.values()), rel=1e-9)
    assert bands["± root-sum-square"] == pytest.approx(sqrt(square), rel=1e-9)
    corner = G * 0.252 * (0.105 + 1.01 / 2)  # bilinear: the corner is not linear
    assert bands["at largest corner"] == pytest.approx(corner, rel=1e-12)
    assert str(found.numbers["C_B_max.by.l2"].unit) == "N*m/m"
    assert values(found)["C_B_max.rss"] == bands["± root-sum-square"]
    [ranking] = found.graphs
    assert ranking.curves[0].across.values == pytest.approx(sorted(parts.values(), reverse=True), rel=1e-9)
    assert ranking.bars[2] == f"l2 {100 * parts['l2'] ** 2 / square:.3g} %"  # the masses have equal parts
    assert any(remark.endswith(f"{ranking.bars[2]} of root-sum-square") for remark in found.remarks)


def test_the_length_of_a_rod_changes_how_a_four_bar_closes() -> None:
    """The closure a e^(i t2) + b e^(i t3) = d + c e^(i t4), differentiated by each length."""
    result = pinarm.run(FOUR_BAR)
    instant = {"t": "0.1 s"}
    at = result.lookup.at(instant, "theta4")
    t2, t3, t4 = (float(at[name].values[0]) for name in ("theta2", "theta3", "theta4"))
    c, side = 0.25, sin(t4 - t3)
    exact = {"a": -cos(t2 - t3) / (c * side), "b": -1 / (c * side), "c": cos(t4 - t3) / (c * side),
             "d": cos(t3) / (c * side)}  # fmt: skip
    found = section(FOUR_BAR, {"of": ["theta4 @ t=0.1 s"], "to": dict.fromkeys("abcd", "0.1 mm")},
                    **{"problem.time.samples": 25, "expect": []})  # fmt: skip
    effects = rows(found.tables[1])
    for name, derivative in exact.items():
        assert abs(effects[name]["derivative"] - derivative) <= effects[name]["its error"]
        assert effects[name]["its error"] < 1e-7
    assert values(found)["theta4_t_0_1_s.worst_case"] == pytest.approx(1e-4 * sum(map(abs, exact.values())), rel=1e-7)


def test_the_period_of_a_pendulum_goes_with_the_root_of_its_length(tmp_path: Path) -> None:
    """T ~ (l/g)^(1/2) at any amplitude, so that dT/dl = T/2l and dT/dg = -T/2g: a motion that is integrated."""
    (tmp_path / "p.urdf.xacro").write_text(PENDULUM)
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: p.urdf.xacro\ngravity: {direction: -z, magnitude: 10 m/s^2}\n"
        "problem:\n  kind: forward\n  time: {end: 2 s, samples: 41}\n  initial: {position: {pivot: 40 deg}}\n"
        "outputs: [joint.pivot.position]\n"
        "sensitivity: {of: ['t @ joint.pivot.position=0 deg, occurrence=2'],\n"
        "  to: {arguments.l: 1 %, gravity.magnitude: 10 ± 0.1 m/s^2, problem.initial.position.pivot: 1 deg}}\n"
    )
    pinarm.validate(tmp_path / "s.yaml")
    result = pinarm.run(tmp_path / "s.yaml")
    time = result.number("t @ joint.pivot.position=0 deg, occurrence=2")[0]
    effects = rows(result.sections["sensitivity"].tables[1])
    length, gravity = effects["arguments.l"], effects["gravity.magnitude"]
    assert abs(length["derivative"] - time / 1.6) <= length["its error"] < 1e-5
    assert abs(gravity["derivative"] + time / 20) <= gravity["its error"] < 1e-5
    assert effects["problem.initial.position.pivot"]["unit of derivative"] == "s/rad"
    assert effects["problem.initial.position.pivot"]["± tolerance"] == pytest.approx(1.0)
    assert effects["problem.initial.position.pivot"]["derivative"] > 0


def test_a_force_that_is_0_depends_on_nothing() -> None:
    """The arm has no horizontal load: what changes in F_Bx is rounding, which has neither kinks nor shares."""
    asked = {"of": ["F_Bx @ max", "C_B @ max"], "to": {"m_A": "5 %", "l1": "1 mm"}, "monte_carlo": 8, "sobol": 4}
    found = section(ARM, asked, **FEW, **{"problem.hold.O": "37 deg"})
    for row in rows(found.tables[-2]).values():
        assert abs(row["derivative"]) <= row["its error"] < 1e-7  # N/kg, N/m
        assert np.isnan(row["% of root-sum-square"])
    assert sum(row["% of root-sum-square"] for row in rows(found.tables[-1]).values()) == pytest.approx(100.0)
    assert [remark for remark in found.remarks if "no input has a share" in remark] == [
        "all that the tolerances make of F_Bx @ max may be errors of its derivatives: no input has a share"
    ]
    assert any("fewer than 64 base samples" in remark for remark in found.remarks)
    assert not any("kink" in remark or "not linear" in remark for remark in found.remarks)
    assert np.isnan(values(found)["F_Bx_max.first.m_A"])
    assert any("F_Bx @ max does not vary within the tolerances" in remark for remark in found.remarks)
    assert np.isfinite(values(found)["C_B_max.first.m_A"])


def swinging_height(turned: float) -> float:
    """Return A_y [m] of the swinging arm after 1 s, with its first rod turned at the start, by SciPy."""
    l1, l2, mass, tip, bent = 0.3114, 0.3931, 0.723 + 0.4305 + 0.6732, 0.723 + 0.4305 / 2, 0.8394
    inertia = l2 * l2 * (0.723 + 0.4305 / 3)

    def rates(_: float, y: Array) -> list[float]:
        (a, b, w, u), coupling = y.tolist(), tip * l1 * l2
        masses = [[mass * l1 * l1, coupling * cos(b - a)], [coupling * cos(b - a), inertia]]
        forces = [coupling * sin(b - a) * u * u - mass * G * l1 * cos(a),
                  -coupling * sin(b - a) * w * w - tip * l2 * G * cos(b)]  # fmt: skip
        return [w, u, *np.linalg.solve(masses, forces)]

    start = -1.3664 + turned
    state = solve_ivp(rates, (0.0, 1.0), [start, start + bent, -3.8551, -3.8551 - 3.905], method="DOP853",
                      rtol=1e-13, atol=1e-14).y[:, -1]  # fmt: skip
    return float(0.5 + l1 * sin(state[0]) + l2 * sin(state[1]))


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_a_derivative_is_as_wrong_as_it_says_at_coarse_tolerances(tolerance: float) -> None:
    """Its steps are large there, 0.26 rad at 1e-6, over which the double pendulum is far from a power series."""
    exact = (swinging_height(1e-4) - swinging_height(-1e-4)) / 2e-4
    arguments = {"l1": "0.3114 m", "l2": "0.3931 m", "m_A": "0.723 kg", "m_BA": "0.4305 kg", "m_B": "0.6732 kg"}
    position, velocity = {"O": "-1.3664 rad", "B": "0.8394 rad"}, {"O": "-3.8551 rad/s", "B": "-3.905 rad/s"}
    more = {"arguments": arguments, "problem.initial": {"position": position, "velocity": velocity},
            "problem.time.end": "1 s", "accuracy.tolerance": tolerance, "expect": []}  # fmt: skip
    found = section(SWING, {"of": ["A_y @ end"], "to": {"problem.initial.position.O": "0.01 rad"}}, **more)
    row = rows(found.tables[1])["problem.initial.position.O"]
    assert abs(row["derivative"] - exact) <= row["its error"]


def test_a_kink_is_told_by_both_derivatives() -> None:
    found = section(ARM, {"of": ["max(m_A, 0.2*m_B) @ start"], "to": {"m_A": "1 g"}}, **FEW)
    assert rows(found.tables[1])["m_A"]["derivative"] == "kink: 0, 1"
    assert any("has a kink in m_A: its derivative is 0 below and 1 above" in remark for remark in found.remarks)
    assert values(found)["max_m_A_0_2_m_B_start.worst_case"] == pytest.approx(1e-3, rel=1e-9)


def test_the_numerical_error_stands_beside_the_bands() -> None:
    asked = {"of": ["C_B @ max", "C_B @ integral", "F_By @ phi=5 deg", "phi @ max(C_B)"], "to": {"m_A": "1 g"}}
    scenario = pinarm.load(ARM, {**FEW, "sensitivity": asked})
    plain = rows(scenario.run().sections["sensitivity"].tables[0])
    assert {row["numerical error"] for row in plain.values()} == {"not estimated"}
    verified = scenario.verified()
    known = rows(verified.sections["sensitivity"].tables[0])
    largest = float(np.abs(verified["C_B"].values).max())
    bound = verified.errors["C_B"] * largest + verified.number("C_B @ max")[1]
    assert known["C_B @ max"]["numerical error"] == pytest.approx(bound, rel=1e-12)
    assert 0 < known["C_B @ integral"]["numerical error"] < 1e-12
    assert 0 < known["F_By @ phi=5 deg"]["numerical error"] < 1e-12
    assert 1.4e-6 < known["phi @ max(C_B)"]["numerical error"] < 4e-6  # a cosine is level to 1e-12 that far


@pytest.mark.parametrize(
    ("asked", "message"),
    [({"of": ["C_B @ max"], "to": {"l3": "1 mm"}}, "no argument 'l3'"),
     ({"of": ["C_B @ max"], "to": {"problem.kind": "1 mm"}}, "'statics' stands there"),
     ({"of": ["C_B @ max"], "to": {"l2": "1 kg"}}, "not a unit of this quantity"),
     ({"of": ["C_B @ max"], "to": {"l2": "240 ± 1 mm"}}, "about 240 mm, and the value is 250 mm"),
     ({"of": ["C_B @ max"], "to": {"l2": "1 mm", "arguments.l2": "1 mm"}}, "two tolerances"),
     ({"of": ["C_B"], "to": {"l2": "1 mm"}}, "no number of a run"),
     ({"of": ["C_B @ max", "C_B@max"], "to": {"l2": "1 mm"}}, "name of another number"),
     ({"of": ["C_B @ max"], "to": {"l2": "1 mm"}, "sobol": 100}, "no power of 2"),
     ({"of": ["C_B @ max"], "to": {"l2": "1 mm"}, "monte_carlo": 1}, "one run has no distribution"),
     ({"of": ["C_B @ max"], "to": {"l2": "1 mm"}, "distribution": "gauss"}, "distribution")],
)  # fmt: skip
def test_mistakes_are_told_before_anything_is_solved(asked: dict[str, Any], message: str) -> None:
    with pytest.raises(PinarmError, match=message):
        pinarm.validate(ARM, {"sensitivity": asked})


def test_what_cannot_be_changed_both_ways_is_told() -> None:
    """A mass of 0 has no smaller one."""
    with pytest.raises(PinarmError, match=r"no run succeeds on both sides of 0\.0 kg: .*mass is negative"):
        section(ARM, {"of": ["C_B @ max"], "to": {"m_A": "10 g"}}, **{**FEW, "arguments.m_A": "0 kg"})


def drawn_arm(folder: Path, to: str, end: str = "[600 mm, 0 mm]") -> Section:
    """An arm of 5 kg, drawn level and held at the angle 0 of its drawing: ``m g x/2`` with the length x along x."""
    (folder / "m.yaml").write_text(
        f"pinarm: 1\ntitle: arm\nplanar:\n  points: {{O: [0 mm, 0 mm], A: {end}}}\n"
        "  ground: [O]\n  links: {arm: {points: [O, A], mass: 5 kg}}\n"
    )
    (folder / "s.yaml").write_text(
        "pinarm: 1\nmechanism: m.yaml\nproblem: {kind: statics, hold: {O: 0 deg}}\noutputs: [joint.O.effort]\n"
        f"sensitivity: {{of: [joint.O.effort @ start], to: {{{to}}}}}\n"
    )
    return pinarm.run(folder / "s.yaml").sections["sensitivity"]


def test_a_point_of_a_drawing_is_moved_while_prescribed_coordinates_keep_their_values(tmp_path: Path) -> None:
    x, y = "changes.planar.points.A.0", "changes.planar.points.A.1"
    found = drawn_arm(tmp_path, f"{x}: 0.1 mm, {y}: 0.1 mm")
    slope, error = (source[f"joint_O_effort_start.by.{x}"] for source in (found.numbers, found.errors))
    assert abs(slope.values[0] - 5.0 * 9.81 / 2.0) <= error
    assert abs(found.numbers[f"joint_O_effort_start.by.{y}"].values[0]) <= 1e-9
