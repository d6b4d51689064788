"""Scenarios of linear analysis against closed forms."""

import math

import numpy as np
import pytest
from scipy.linalg import eigh

import pinarm
from pinarm.errors import AssemblyError, DynamicsError, InputError
from pinarm.input.units import unit

GOVERNOR = """<robot name="governor"><link name="base"/>
<link name="column"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="spindle" type="continuous"><parent link="base"/><child link="column"/><axis xyz="0 0 1"/></joint>
<link name="ball"><inertial><origin xyz="0 0 -0.3"/><mass value="0.5"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="arm" type="continuous"><parent link="column"/><child link="ball"/><axis xyz="0 1 0"/></joint></robot>"""
LENGTH, MASS, COLUMN, G = 0.3, 0.5, 0.01, 9.81


@pytest.fixture
def governor(tmp_path):
    (tmp_path / "governor.urdf").write_text(GOVERNOR)
    (tmp_path / "governor.yaml").write_text("pinarm: 1\nrobot: governor.urdf\ngravity: {direction: -z}\n")

    def run(about, **more):
        with pinarm.file_root(tmp_path):
            return pinarm.run({
                "pinarm": 1, "mechanism": str(tmp_path / "governor.yaml"),
                "problem": {"kind": "linear", "about": about, **more},
                "outputs": ["joint.arm.position", "mode.1.frequency", "mode.2.frequency"],
            })  # fmt: skip

    return run


def test_a_governor_settles_where_its_ball_is_in_balance_and_swings_about_that(governor):
    """``cos x = g/(w^2 l)``; with the free spindle ``w2 = w^2 sin^2 x (1 + 4 m l^2 cos^2 x/(I + m l^2 sin^2 x))``.

    ``x'' = w^2 sin x cos x - g/l sin x`` and ``((I + m l^2 sin^2 x) w)' = 0``, linearised.
    """
    speed = 12.0
    result = governor({"steady": {"spindle": "12 rad/s"}, "equilibrium": {"arm": "70 deg"}})
    angle = math.acos(G / (speed**2 * LENGTH))
    assert result["joint.arm.position"].values == pytest.approx([angle], rel=1e-10)
    sine, cosine = math.sin(angle), math.cos(angle)
    inertia = COLUMN + MASS * LENGTH**2 * sine**2
    square = speed**2 * sine**2 * (1.0 + 4.0 * MASS * LENGTH**2 * cosine**2 / inertia)
    frequencies = result.arrays["eigenvalues"].values[0].imag
    assert max(frequencies) == pytest.approx(math.sqrt(square), rel=1e-9)


def test_a_held_arm_is_linearised_with_the_effort_that_holds_it(governor):
    """Level, ``x'' = -g/l cos x dx``: neither swings nor falls but for the second order."""
    result = governor({"hold": {"arm": "60 deg", "spindle": "0 deg"}})
    assert result["joint.arm.effort"].values == pytest.approx([MASS * G * LENGTH * math.sin(math.radians(60.0))])
    expected = math.sqrt(G / LENGTH * math.cos(math.radians(60.0))) / (2.0 * math.pi)
    assert max(np.abs(result.arrays["eigenvalues"].values[0])) / (2.0 * math.pi) == pytest.approx(expected, rel=1e-9)


def test_an_upright_pendulum_is_said_to_be_unstable(governor):
    result = governor({"equilibrium": {"arm": "175 deg"}})
    assert any(note.startswith("unstable: mode") for note in result.notes())
    assert result.figures["unstable modes"] == 1.0


@pytest.mark.parametrize(
    ("about", "error", "message"),
    [
        ({"hold": {"arn": "1 deg"}}, InputError, "no coordinate 'arn'"),
        ({"steady": {"arm": "1 m/s"}}, InputError, "m/s"),
        ({"steady": {"spindle": "1 rad/s"}, "hold": {"spindle": "1 deg"}}, InputError, "held and turns"),
    ],
)
def test_mistakes_are_located(governor, about, error, message):
    with pytest.raises(error, match=message) as caught:
        governor(about)
    assert "about" in str(caught.value.path) or "about" in str(caught.value)


def test_two_drives_on_one_freedom_are_refused():
    """Whether the crank or the rocker holds a four-bar, its frequencies differ: 1.6 and 2.1 Hz."""
    held = {"theta2": "1 rad", "theta4": "1.7166977177865481 rad"}
    with pytest.raises(InputError, match="not determine the efforts of theta2, theta4"):
        pinarm.run("scenarios/crank_rocker_turning.yaml", {
            "problem": {"kind": "linear", "about": {"hold": held, "equilibrium": {"A": "-0.51 rad"}}}, "expect": [],
            "symbols": {}, "outputs": ["mode.1.frequency"],
        })  # fmt: skip


def test_a_crank_at_constant_speed_is_no_steady_motion():
    with pytest.raises(DynamicsError, match="does not stay closed at these velocities"):
        pinarm.run("scenarios/crank_rocker_turning.yaml", {
            "problem": {"kind": "linear", "about": {"steady": {"theta2": "100 rpm"}}}, "expect": [], "symbols": {},
            "outputs": ["theta4"],
        })  # fmt: skip


def test_without_an_equilibrium_the_closest_position_is_said(governor):
    with pytest.raises(AssemblyError, match="the start leads to no equilibrium"):
        governor({"equilibrium": {"arm": "80 deg"}}, loads={
            "push": {"kind": "joint_effort", "joint": "arm", "effort": {"law": "constant", "value": "40 N*m"}},
        })  # fmt: skip


CARRIAGE = """<robot name="carriage"><link name="rail"/><link name="body"><inertial><origin xyz="0 0 0.2"/>
<mass value="2"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="body"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="1e6" velocity="1e3"/></joint></robot>"""


def test_the_response_of_a_carriage_on_a_spring(tmp_path):
    """``x/F = 1/(k - m w^2 + i c w)``; its acceleration, ``-w^2`` times that; the moment of the rail, ``m h x''``."""
    mass, stiffness, damping, height = 2.0, 300.0, 4.0, 0.2
    (tmp_path / "carriage.urdf").write_text(CARRIAGE)
    with pinarm.file_root(tmp_path):
        result = pinarm.run({
            "pinarm": 1,
            "mechanism": {"pinarm": 1, "robot": str(tmp_path / "carriage.urdf"), "gravity": "none", "forces": {
                "mount": {"kind": "joint_spring", "joint": "slide", "stiffness": "300 N/m", "damping": "4 N*s/m"}}},
            "problem": {"kind": "linear", "frequencies": {"from": "0.1 Hz", "to": "50 Hz", "samples": 7},
                        "outputs": ["slide", "point.body.acceleration.x", "joint.slide.moment.y"]},
            "outputs": ["mode.1.frequency", "mode.1.damping"],
        })  # fmt: skip
    table = result.arrays["response"]
    frequencies = np.array([float(name.removesuffix(" Hz")) for name in table.rows])
    assert np.isin(np.geomspace(0.1, 50.0, 7).round(6), frequencies.round(6)).all()
    w = 2.0 * np.pi * frequencies
    moved = 1.0 / (stiffness - mass * w**2 + 1j * damping * w)
    expected = np.column_stack([moved, -(w**2) * moved, height * mass * -(w**2) * moved])
    assert list(table.columns) == ["slide / slide", "point.body.acceleration.x / slide", "joint.slide.moment.y / slide"]
    assert table.values == pytest.approx(expected, rel=1e-11)
    natural = math.sqrt(stiffness / mass)
    assert result["mode.1.frequency"].values[0] == pytest.approx(natural / (2.0 * math.pi), rel=1e-12)
    assert result["mode.1.damping"].values[0] == pytest.approx(damping / (2.0 * mass * natural), rel=1e-12)


def test_results_are_restored_with_their_tables(governor, tmp_path):
    result = governor({"equilibrium": {"arm": "10 deg"}})
    again = pinarm.restore(result.save(tmp_path / "saved"))
    assert again.arrays["A"].values == pytest.approx(result.arrays["A"].values, abs=0.0)
    assert list(again.arrays["shapes"].rows) == ["spindle", "arm"]


MOUNTED = """<robot name="mounted"><link name="floor"/><link name="base"/><joint name="shake" type="prismatic">
<parent link="floor"/><child link="base"/><axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="1e6" velocity="1e3"/>
</joint><link name="machine"><inertial><mass value="12"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link><joint name="mount" type="prismatic"><parent link="base"/><child link="machine"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="1e6" velocity="1e3"/></joint></robot>"""


def mounted(tmp_path, **forces):
    """A machine on a spring and damper, on a floor without mass that moves."""
    (tmp_path / "mounted.urdf").write_text(MOUNTED)
    mount = {"kind": "joint_spring", "joint": "mount", "stiffness": "5 kN/m", "damping": "60 N*s/m"}
    return {"pinarm": 1, "robot": str(tmp_path / "mounted.urdf"), "gravity": {"direction": "-z"},
            "forces": {"mount": mount, **forces}}  # fmt: skip


def test_the_transmissibility_of_a_shaken_base(tmp_path):
    """``(k + i c w) / (k - m w^2 + i c w)``; the force of the mount on the floor, ``-m w^2`` times that."""
    mass, k, c = 12.0, 5e3, 60.0
    with pinarm.file_root(tmp_path):
        result = pinarm.run({
            "pinarm": 1, "mechanism": mounted(tmp_path),
            "problem": {"kind": "linear", "about": {"hold": {"shake": "0 mm"}}, "inputs": ["joint.shake.position"],
                        "outputs": ["point.machine.position.z", "joint.shake.effort", "mount"],
                        "frequencies": {"from": "0.1 Hz", "to": "50 Hz", "samples": 9}},
            "outputs": ["mode.1.frequency", "joint.shake.effort"],
        })  # fmt: skip
    table = result.arrays["response"]
    w = 2.0 * np.pi * np.array([float(name.split()[0]) for name in table.rows])
    carried = (k + 1j * c * w) / (k - mass * w**2 + 1j * c * w)
    assert table.columns[0] == "point.machine.position.z / joint.shake.position"
    assert table.values[:, 0] == pytest.approx(carried, rel=1e-11)
    assert table.values[:, 1] == pytest.approx(-mass * w**2 * carried, rel=1e-11)
    assert table.values[:, 2] == pytest.approx(carried - 1.0, rel=1e-11, abs=1e-12)
    assert result["joint.shake.effort"].values == pytest.approx([mass * 9.81])
    assert len(result.arrays["eigenvalues"].columns) == 1  # the base has no mode
    assert list(result.arrays["A"].rows) == ["mount", "shake", "mount'", "shake'"]
    assert list(result.arrays["B"].columns) == ["shake''"]
    assert result["mode.1.frequency"].values == pytest.approx(math.sqrt(k / mass) / (2.0 * math.pi), rel=1e-12)


def test_a_shaking_force_is_an_input_by_its_amplitude(tmp_path):
    """``1 / (k - m w^2 + i c w)`` in m/N, whatever the amplitude; the floor feels ``k + i c w`` times that."""
    mass, k, c = 12.0, 5e3, 60.0
    shaking = {"kind": "wrench", "point": "machine", "force": ["0 N", "0 N", "40 N"],
               "factor": {"law": "harmonic", "amplitude": "1 1", "pulsation": "30 rad/s"}}  # fmt: skip
    with pinarm.file_root(tmp_path):
        result = pinarm.load({
            "pinarm": 1, "mechanism": mounted(tmp_path, shaking=shaking),
            "problem": {"kind": "linear", "about": {"hold": {"shake": "0 mm"}},
                        "inputs": ["force.shaking", "joint.shake.position"],
                        "outputs": ["mount", "joint.shake.force.z", "power.shaking"],
                        "frequencies": {"from": "0.1 Hz", "to": "50 Hz", "samples": 9}},
            "outputs": ["mode.1.frequency"],
        }).verified()  # fmt: skip
    table = result.arrays["response"]
    w = 2.0 * np.pi * np.array([float(name.split()[0]) for name in table.rows])
    moved = 1.0 / (k - mass * w**2 + 1j * c * w)
    assert table.columns[0] == "mount / force.shaking"
    assert table.unit(0, 0).dimension == (unit("m") / unit("N")).dimension
    assert table.values[:, 0] == pytest.approx(moved, rel=1e-11)
    assert table.values[:, 2] == pytest.approx(-(k + 1j * c * w) * moved, rel=1e-11)
    assert table.values[:, 4] == pytest.approx(0.0, abs=1e-12)  # nothing moves in the state
    assert result.figures["small motion"] < 1e-6  # its law does not act in the small motion


def test_parts_of_springs_dampers_and_bodies_by_hand(tmp_path):
    """Carriages of 2 and 3 kg in a row: ``x^T K_i x`` and ``x^T M_i x`` of the eigenvectors of 2 by 2 matrices."""
    links = "".join(
        f'<link name="{name}"><inertial><mass value="{mass}"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="{name}_slide" type="prismatic"><parent link="{parent}"/><child link="{name}"/>'
        '<axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="1e6" velocity="1e3"/></joint>'
        for name, parent, mass in (("one", "rail", 2), ("two", "one", 3))
    )
    (tmp_path / "row.urdf").write_text(f'<robot name="row"><link name="rail"/>{links}</robot>')
    springs = {
        "first": {"kind": "joint_spring", "joint": "one_slide", "stiffness": "70 N/m", "damping": "0.02 N*s/m"},
        "second": {"kind": "joint_spring", "joint": "two_slide", "stiffness": "40 N/m", "damping": "0.06 N*s/m"},
    }
    with pinarm.file_root(tmp_path):
        result = pinarm.run({
            "pinarm": 1, "problem": {"kind": "linear"}, "outputs": ["mode.1.frequency"],
            "mechanism": {"pinarm": 1, "robot": str(tmp_path / "row.urdf"), "gravity": "none", "forces": springs},
        })  # fmt: skip
    stiffness = np.array([[110.0, -40.0], [-40.0, 40.0]])  # over absolute positions
    x = eigh(stiffness, np.diag([2.0, 3.0]))[1]
    stretched = np.array([x[0], x[1] - x[0]])
    energy = np.array([70.0, 40.0])[:, None] * stretched**2
    assert list(result.arrays["springs"].rows) == ["first", "second"]
    # shapes of lightly damped modes differ by the damping
    assert result.arrays["springs"].values == pytest.approx(energy / energy.sum(axis=0), abs=1e-5)
    kinetic = np.array([2.0, 3.0])[:, None] * x**2
    assert result.arrays["masses"].values == pytest.approx(kinetic / kinetic.sum(axis=0), abs=1e-5)
    lost = np.array([0.02, 0.06])[:, None] * stretched**2
    assert result.arrays["dampers"].values == pytest.approx(lost / lost.sum(axis=0), abs=1e-5)


@pytest.mark.parametrize("speed", ["165 rpm", "200 rpm", "260 rpm"])
def test_the_choice_of_independent_joints_does_not_hang_on_rounding(speed):
    """Both arms of a governor are as good: as it turns on, the same one has to be chosen."""
    findings = pinarm.check("scenarios/porter_governor_modes.yaml", {"problem.about.steady.spindle": speed})
    assert [finding.expectation.quantity for finding in findings if not finding.ok] == []
