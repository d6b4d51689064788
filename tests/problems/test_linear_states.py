"""States of linear analysis: steady motions, joints that friction holds, runs at an instant, small motions."""

import math
from pathlib import Path

import numpy as np
import pytest
from urdf_links import link, robot, tip

import pinarm
from pinarm.errors import DynamicsError, InputError

ROOT = Path(pinarm.__file__).parents[1]
G = 9.81


@pytest.fixture
def solve(tmp_path):
    """Return a function that solves a linear analysis of a URDF."""

    def run(xml, about, description=None, *, verify=False, explain=False, **more):
        (tmp_path / "made.urdf").write_text(xml)
        mechanism = {"pinarm": 1, "robot": str(tmp_path / "made.urdf"), **(description or {})}
        data = {
            "pinarm": 1,
            "mechanism": mechanism,
            "problem": {"kind": "linear", "about": about, **more},
            "outputs": ["mode.1.frequency"],
        }
        with pinarm.file_root(tmp_path):
            if explain:
                return pinarm.explain(data)
            return pinarm.load(data).verified() if verify else pinarm.run(data)

    return run


def rotor(transverse=(0.013, 0.013), springs=(60.0, 60.0)):
    """A disk on a gimbal with springs, which spins about z."""
    disk = {"mass": 1.0, "inertia": (*transverse, 0.02)}
    xml = robot(link("x", "base", "1 0 0"), link("y", "x_link", "0 1 0"), link("z", "y_link", "0 0 1", **disk))
    forces = {
        name: {"kind": "joint_spring", "joint": name, "stiffness": f"{k} N*m/rad"}
        for name, k in zip("xy", springs, strict=True)
    }
    return xml, {"gravity": "none", "forces": forces}


def test_a_whirling_rotor_has_its_two_frequencies_and_a_rigid_spin(solve):
    """``w = sqrt((I_p W / (2 I_t))^2 + k / I_t) +- I_p W / (2 I_t)``."""
    result = solve(*(rotor()[0], {"steady": {"z": "100 rad/s"}}, rotor()[1]), verify=True)
    half = 0.02 * 100.0 / (2.0 * 0.013)
    root = math.sqrt(half**2 + 60.0 / 0.013)
    whirling = np.sort(result.arrays["eigenvalues"].values[0].imag)[-2:]
    assert whirling == pytest.approx([root - half, root + half], rel=1e-9)
    assert [result[f"mode.{k}.{name}"].values[0] for k in (3, 4) for name in ("damping", "growth")] == [0.0] * 4
    assert "mode 1, 2: nothing drives z back: no force depends on where they are" in result.notes()
    assert result.figures["small motion"] < 1e-5


def test_an_unequal_rotor_on_unequal_springs_has_no_modes(solve):
    """Its coefficients are periodic. One of the two alone would have constant ones, in frames that turn or do not."""
    xml, description = rotor(transverse=(0.013, 0.017), springs=(60.0, 80.0))
    with pytest.raises(DynamicsError, match="periodic coefficients"):
        solve(xml, {"steady": {"z": "100 rad/s"}}, description)


def test_a_pendulum_turned_about_a_level_axis_is_steady_for_an_instant_only(solve):
    xml = robot(link("turn", "base", "1 0 0", mass=1.0), link("swing", "turn_link", "0 1 0", mass=1.0, com="0 0 -0.5"))
    with pytest.raises(DynamicsError, match="steady for an instant only"):
        solve(xml, {"steady": {"turn": "5 rad/s"}, "equilibrium": {"swing": "1 deg"}})


def test_a_bushing_across_a_joint_that_turns_on_makes_no_steady_motion(solve):
    xml, description = rotor()
    damper = {"kind": "bushing", "between": ["base", "z_link"], "damping": {"translation": ["9 N*s/m"] * 3}}
    across = {"gravity": "none", "forces": {**description["forces"], "damper": damper}}
    with pytest.raises(DynamicsError, match=r"part of a turn only; force 'damper': its frames .* acts up to 170 deg"):
        solve(xml, {"steady": {"z": "100 rad/s"}}, across)


def test_the_rate_of_a_sum_and_a_held_joint_determine_both(solve):
    """A governor whose ball turns with the sum of two joints about one axis, the first of them held."""
    xml = robot(
        link("a", "base", "0 0 1", mass=1.0, inertia=(1.0, 1.0, 0.01)),
        link("b", "a_link", "0 0 1"),
        link("arm", "b_link", "0 1 0", mass=0.5, com="0 0 -0.3"),
    )
    sums = {"coordinates": {"sum": {"kind": "sum", "of": ["a", "b"]}}}
    result = solve(xml, {"steady": {"sum": "12 rad/s"}, "hold": {"a": "0 deg"}, "equilibrium": {"arm": "70 deg"}}, sums)
    assert result["joint.b.velocity"].values == pytest.approx([12.0])
    assert result["joint.arm.position"].values == pytest.approx([math.acos(G / (144.0 * 0.3))], rel=1e-9)
    with pytest.raises(InputError, match="rates do not determine how fast a, b move"):
        solve(xml, {"steady": {"sum": "12 rad/s"}, "equilibrium": {"arm": "70 deg"}}, sums)


def test_a_position_along_a_line_is_held_by_its_effort(solve):
    """A pendulum held out by a level force at its tip: ``F = m g tan x``, and with F ``w^2 = g / (l cos x)``."""
    length, angle = 0.8, 0.6
    xml = robot(link("arm", "base", "0 1 0", mass=2.0, com=f"0 0 {-length}")).replace(
        "</robot>", f'<link name="tip"/><joint name="t" type="fixed"><parent link="arm_link"/><child link="tip"/>'
        f'<origin xyz="0 0 {-length}"/></joint></robot>')  # fmt: skip
    reach = length * math.sin(angle)
    result = solve(
        xml, {"hold": {"way": f"{-reach} m"}, "equilibrium": {"arm": f"{angle} rad"}},
        {"coordinates": {"way": {"kind": "point", "point": "tip", "along": "x"}}}, verify=True,
        inputs=["way"], outputs=["arm"], frequencies={"from": "0.01 Hz", "to": "1 Hz", "samples": 3},
    )  # fmt: skip
    assert abs(result["coordinate.way.effort"].values[0]) == pytest.approx(2.0 * G * math.tan(angle), rel=1e-9)
    expected = math.sqrt(G / (length * math.cos(angle)))
    assert result["mode.1.frequency"].values * 2.0 * math.pi == pytest.approx([expected], rel=1e-9)
    assert result.figures["small motion"] < 1e-6
    response = result.arrays["response"]
    w = 2.0 * math.pi * np.array([float(name.split()[0]) for name in response.rows])
    moved = -length * math.cos(angle) / (2.0 * length**2 * (expected**2 - w**2))
    assert response.values[:, 0] == pytest.approx(moved, rel=1e-9)


def test_friction_holds_a_pendulum_where_it_is_put(solve):
    """Of two pendulums in a row the upper one sticks at 1 deg; the lower one swings, ``w^2 = g / l``."""
    xml = robot(
        link("a", "base", "0 1 0", mass=1.0, com="0 0 -0.5"),
        link("b", "a_link", "0 1 0", at="0 0 -1", mass=2.0, com="0 0 -0.3"),
    )
    friction = {"friction": {"a": {"constant": "5 N*m"}}}
    result = solve(xml, {"equilibrium": {"a": "1 deg", "b": "0 deg"}}, friction, verify=True)
    assert result["joint.a.position"].values == pytest.approx([math.radians(1.0)])
    assert result["mode.1.frequency"].values * 2.0 * math.pi == pytest.approx([math.sqrt(G / 0.3)], rel=1e-9)
    assert "held by dry friction in the small motion: joint.a" in result.notes()
    assert result.figures["small motion"] < 1e-6
    with pytest.raises(DynamicsError, match=r"joint\.a begins to slip here"):
        solve(xml, {"equilibrium": {"a": "40 deg", "b": "-40 deg"}}, friction)
    with pytest.raises(DynamicsError, match="modes of the state: none"):  # and no traceback
        solve(xml, {"equilibrium": {"a": "1 deg"}}, {"friction": {key: {"constant": "50 N*m"} for key in "ab"}})


def test_explain_tells_the_modes_and_why_one_is_rigid(solve):
    xml = robot(
        link("slide", "base", "1 0 0", mass=1.0, kind="prismatic"),
        link("swing", "slide_link", "0 1 0", mass=1.0, com="0 0 -0.5"),
    )
    told = str(solve(xml, {}, explain=True))
    assert "modes of small motions of slide, swing:" in told
    assert "mode 1, 2: nothing drives slide back: no force depends on where they are" in told


def test_a_run_is_linearised_at_an_instant():
    """The state of a free run, and of one with laws, as that of the user's own."""
    free = pinarm.run(ROOT / "scenarios/crank_rocker_free.yaml")
    place = float(free.trajectory.grid.t[57])
    row = free.trajectory
    own = row.mechanism.linearise(row.q[57], row.v[57], row.tau[57], t=place)
    assert pytest.approx(own.A, rel=1e-6, abs=1e-6) == free.linearise(place).A  # of dense output
    moved = pinarm.run(ROOT / "scenarios/gen411_arm_dynamic_true.yaml")
    row = moved.trajectory
    own = row.mechanism.linearise(row.q[3], row.v[3], row.tau[3])
    found = moved.linearise(float(row.grid.t[3]))
    assert pytest.approx(own.A, rel=1e-9, abs=1e-9) == found.A
    held = moved.linearise(float(row.grid.t[3]), prescribed=["O"])
    assert held.states == ["B", "O", "B'", "O'"]
    assert held.A[2, 0] == pytest.approx(found.A[3, 1] - found.B[3, 0] / found.B[2, 0] * found.A[2, 1], rel=1e-9)
    with pytest.raises(InputError, match="is not reached in this run"):
        free.linearise(1e9)


def test_inputs_by_motor_and_by_effort_along_a_line(solve):
    """A motor of ratio 20 gives 20 times its torque; of a gear with losses it is refused."""
    xml = robot(link("arm", "base", "0 1 0", mass=2.0, com="0 0 -0.5"))
    drives = {"drives": {"motor": {"joint": "arm", "ratio": 20}}}
    more = {"inputs": ["drive.motor.torque", "joint.arm.effort"], "outputs": ["arm", "drive.motor.speed"]}
    b = solve(xml, {}, drives, **more).arrays["B"].values
    assert b[:, 0] == pytest.approx([0.0, 20.0 / 0.5])
    assert b[:, 1] == pytest.approx([0.0, 1.0 / 0.5])
    with pytest.raises(InputError, match="losses of the gear of 'motor'"):
        solve(xml, {}, {"drives": {"motor": {"joint": "arm", "ratio": 20, "efficiency": 0.9}}}, **more)
    with pytest.raises(InputError, match="is prescribed, and about does not say where"):
        solve(xml, {}, drives, inputs=["joint.arm.position"])
    with pytest.raises(InputError, match=r"there is no input 'drive\.motr\.torque'"):
        solve(xml, {}, drives, inputs=["drive.motr.torque"])


def test_a_critically_damped_pair_is_noted_as_defective(solve):
    """``c = 2 sqrt(k m)``: both eigenvalues are ``-sqrt(k / m)``, known to the root of rounding."""
    xml = robot(link("slide", "base", "1 0 0", mass=4.0, kind="prismatic"))
    damper = {"kind": "joint_spring", "joint": "slide", "stiffness": "100 N/m", "damping": "40 N*s/m"}
    result = solve(xml, {}, {"gravity": "none", "forces": {"mount": damper}})
    assert "mode 1, 2: a defective pair, one mode but for rounding" in result.notes()
    error = float(result["mode.1.error"].values[0])
    assert abs(result.arrays["eigenvalues"].values[0] + 5.0).max() <= error < 1e-5


def test_a_mount_of_bushings_about_its_free_position(solve):
    """A block on a bushing, free at 0: three frequencies ``sqrt(k / m)``, and the force of the floor under it."""
    xml = robot(link("z", "base", "0 0 1", mass=5.0, kind="prismatic"))
    bush = {"kind": "bushing", "between": ["base", "z_link"], "damping": {"translation": ["1 N*s/m"] * 3},
            "stiffness": {"translation": ["70 N/m", "80 N/m", "90 N/m"]}}  # fmt: skip
    result = solve(xml, {}, {"gravity": "none", "forces": {"bush": bush}}, inputs=["z"],
                   outputs=["force.bush.force.z", "energy.potential"])  # fmt: skip
    assert result["mode.1.frequency"].values == pytest.approx([math.sqrt(90.0 / 5.0) / (2.0 * math.pi)], rel=1e-12)
    assert result.arrays["C"].values == pytest.approx(np.array([[-90.0, -1.0], [0.0, 0.0]]), abs=1e-12)


def test_a_rotor_has_its_part_in_the_kinetic_energy(solve):
    """``N^2 J`` beside ``m l^2``."""
    xml = robot(link("arm", "base", "0 1 0", mass=2.0, com="0 0 -0.5"))
    drives = {"drives": {"motor": {"joint": "arm", "ratio": 20, "rotor_inertia": "5e-4 kg*m^2"}}}
    table = solve(xml, {}, drives).arrays["masses"]
    assert list(table.rows) == ["arm_link", "rotor at arm"]
    assert table.values[:, 0] == pytest.approx([0.5 / 0.7, 0.2 / 0.7])


def test_a_cable_that_carries_nothing_is_refused(solve):
    """A load that hangs on a cable; lifted by more than its weight, the cable would have to push."""
    arm = link("arm", "base", "0 1 0", mass=2.0, com="0 0 -0.5")
    xml = robot(arm, link("lift", "base", "0 0 1", at="0 0 -2", mass=1.0, kind="prismatic"))
    hung = {"loops": {"rope": {"kind": "cable", "through": ["base", "lift_link"], "length": "2 m"}}}
    assert len(solve(xml, {}, hung).arrays["eigenvalues"].columns) == 1
    lifted = {"lifting": {"kind": "joint_effort", "joint": "lift", "effort": {"law": "constant", "value": "15 N"}}}
    with pytest.raises(InputError, match="cable 'rope' carries no load here"):
        solve(xml, {}, hung, loads=lifted)


def test_springs_that_hold_each_other_balance_to_rounding(solve):
    """Without weights, what is left of their loads is rounding of these, and not all that acts."""
    arm = link("arm", "base", "0 1 0", mass=2.0, com="0 0 -0.5")
    xml = robot(arm, tip("post", "base", "0.4 0 0.1"), tip("end", "arm_link", "0.1 0 -0.3"))
    springs = {
        "one": {"kind": "joint_spring", "joint": "arm", "stiffness": "900 N*m/rad", "rest": "0.3 rad"},
        "other": {"kind": "point_spring", "between": ["post", "end"], "stiffness": "500 N/m"},
    }
    result = solve(xml, {}, {"gravity": "none", "forces": springs})
    assert max(result.figures[name] for name in ("equilibrium", "return trip")) < 1e-13
    assert result.notes() == []


@pytest.mark.parametrize("load", [
    {"kind": "torque_speed", "joint": "arm",
     "curve": [["0 rad/s", "9 N*m"], ["4 rad/s", "8 N*m"], ["9 rad/s", "0 N*m"]]},
    {"kind": "joint_effort", "joint": "arm", "over": "arm", "effort": {
        "law": "piecewise_linear", "points": [["-1 rad", "1 N*m"], ["0 rad", "0 N*m"], ["1 rad", "-5 N*m"]]}},
])  # fmt: skip
def test_a_corner_of_a_curve_is_refused(solve, load):
    """Where two lines of a characteristic meet there is no slope."""
    xml = robot(link("arm", "base", "0 1 0", mass=2.0, com="0 0 -0.5"))
    steady = {"steady": {"arm": "4 rad/s"}} if load["kind"] == "torque_speed" else {}
    with pytest.raises(InputError, match="'corner' has a kink here"):
        solve(xml, steady, {"gravity": "none", "forces": {"corner": load}})


def test_controllers_that_are_left_open_are_told(solve):
    xml = robot(link("a", "base", "0 1 0", mass=1.0, com="0 0 -1"))
    control = [{"kind": "pid", "drive": "a", "follows": {"law": "constant", "value": "0 rad"}, "kp": "5 N*m/rad"}]
    drives = {"a": {"joint": "a", "efficiency": 0.8}}
    result = solve(xml, {"equilibrium": {"a": 0.0}}, {"drives": drives, "control": control}, verify=True)
    assert result["mode.1.frequency"].values[0] == pytest.approx(math.sqrt(G) / (2.0 * math.pi), rel=1e-9)
    assert "controllers are left open: their efforts stay those of the state" in result.notes()
    assert "the small motion has no losses of gears: a" in result.notes()
    assert result.figures["small motion"] < 1e-6
