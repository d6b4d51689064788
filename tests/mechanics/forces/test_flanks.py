"""Elastic gears and backlash: two natural frequencies, free travel, and what flanks do, against closed forms."""

import numpy as np
import pytest
from scipy.linalg import expm

import pinarm
from pinarm.errors import InputError

URDF = """<robot name="inertia"><link name="base"/><link name="rotor"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="continuous"><parent link="base"/><child link="rotor"/><axis xyz="0 0 1"/></joint></robot>"""

N, ROTOR, LOAD, K = 10.0, 2e-4, 0.05, 8.0
OWN = N * N * ROTOR
"""Inertia of the rotor at the joint."""

RELATIVE = np.sqrt(K * (1.0 / OWN + 1.0 / LOAD))
"""Pulsation of the deflection while both move freely."""


@pytest.fixture
def servo(tmp_path):
    """Make an inertia behind an elastic gear."""

    def made(damping=0.0, values=None, **keys):
        (tmp_path / "inertia.urdf").write_text(URDF)
        elasticity = {"stiffness": f"{K} N*m/rad", "damping": f"{damping} N*m*s/rad"}
        drive = {"joint": "x", "ratio": N, "rotor_inertia": f"{ROTOR} kg*m^2", "elasticity": elasticity,
                 "motor": {"kind": "ideal"}, **keys}  # fmt: skip
        drive = {key: value for key, value in drive.items() if value is not None}
        return pinarm.Mechanism.load(tmp_path / "inertia.urdf", values={"drives": {"servo": drive}, **(values or {})})

    return made


def run(mechanism, control=(), end="1 s", outputs=("x", "drive.servo.deflection"), start=None, **problem):
    return pinarm.run({"pinarm": 1, "mechanism": mechanism, "outputs": list(outputs), "problem": {
        "kind": "forward", "time": {"end": end, "samples": 41}, "initial": start or {}, "control": list(control),
        **problem,
    }})  # fmt: skip


def constant(torque, **keys):
    return {"kind": "state_feedback", "drive": "servo", "states": ["x"], "gains": [["0 N*m/rad", "0 N*m*s/rad"]],
            "bias": [f"{torque} N*m"], **keys}  # fmt: skip


def test_two_inertias_and_two_springs_have_two_frequencies(servo):
    """The joint held to the ground by 3 N m/rad: ``M x'' + K x = 0`` by its matrix exponential."""
    ground = {"ground": {"kind": "joint_spring", "joint": "x", "stiffness": "3 N*m/rad"}}
    start = {"position": {"x": "0.5 rad", "servo.rotor": "-0.2 rad"}}
    result = run(servo(), start=start, loads=ground, outputs=("x", "servo.rotor"))
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2:, :2] = [[-(K + 3.0) / LOAD, K / LOAD], [K / OWN, -K / OWN]]
    exact = np.array([expm(a * t) @ [0.5, -0.2, 0.0, 0.0] for t in result["t"].values])
    assert np.abs(result["x"].values - exact[:, 0]).max() < 1e-7  # tolerance 1e-9 a step
    assert np.abs(result["servo.rotor"].values - exact[:, 1]).max() < 1e-7
    assert result.figures["energy"] < 1e-8


@pytest.mark.parametrize("damping, period", [(0.0, {}), (0.1, {"period": "20 ms"})])
def test_a_torque_deflects_the_gear(servo, damping, period):
    """``w'' = N T / J1 - (k w + c w') (1/J1 + 1/J2)``; the joint gets ``k w + c w'``."""
    torque, t = 0.3, np.linspace(0.0, 1.0, 41)
    result = run(servo(damping), [constant(torque, **period)], outputs=("drive.servo.deflection", "joint.x.effort"))
    both = 1.0 / OWN + 1.0 / LOAD
    a = np.array([[0, 1, 0], [-K * both, -damping * both, N * torque / OWN], [0, 0, 0]])
    exact = np.array([expm(a * instant) @ [0.0, 0.0, 1.0] for instant in result["t"].values])
    assert len(result["t"].values) >= len(t)
    assert np.abs(result["drive.servo.deflection"].values - exact[:, 0]).max() < 1e-7
    effort = K * exact[:, 0] + damping * exact[:, 1]
    assert np.abs(result["joint.x.effort"].values - effort).max() < 1e-5
    assert np.abs(result["drive.servo.torque"].values - torque).max() < 1e-12
    assert result.figures["energy"] < 1e-7
    assert result.figures["equilibrium"] < 1e-12


@pytest.mark.parametrize("measures", [{}, {"measures": "x"}])
def test_a_controller_sees_the_rotor_or_the_joint(servo, measures):
    """PD by the encoder of the motor, or by one at the joint: the matrix exponential of four states."""
    control = {"kind": "pid", "drive": "servo", "follows": {"law": "constant", "value": "0 rad"}, "kp": "0.2 N*m/rad",
               "kd": "0.01 N*m*s/rad", **measures}  # fmt: skip
    result = run(servo(0.05), [control], "0.5 s", ("x",), {"position": {"x": "1 rad"}})
    gain = N * np.array([[0.2, 0.0, 0.01, 0.0] if measures else [0.0, 0.2, 0.0, 0.01]])
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    spring = np.array([-K, K, -0.05, 0.05])
    a[2], a[3] = spring / LOAD, -(spring + gain[0]) / OWN
    exact = np.array([expm(a * t) @ [1.0, 1.0, 0.0, 0.0] for t in result["t"].values])
    assert np.abs(result["x"].values - exact[:, 0]).max() < 1e-7


BACKLASH = 0.04
"""[rad]"""


@pytest.mark.parametrize("sign", [-1.0])
def test_the_rotor_travels_freely_before_it_meets_a_flank(servo, sign):
    """Until ``h = N T t^2 / 2 J1`` the joint rests; then the deflection is a parabola's end on a spring."""
    torque, half = 0.05, 0.5 * BACKLASH
    result = run(servo(backlash=f"{BACKLASH} rad"), [constant(sign * torque)], "0.2 s")
    t, push = result["t"].values, N * torque / OWN
    meets = np.sqrt(2.0 * half / push)
    after = np.maximum(t - meets, 0.0)
    middle, rate = push / RELATIVE**2, push * meets
    d = middle * (1.0 - np.cos(RELATIVE * after)) + rate / RELATIVE * np.sin(RELATIVE * after)
    expected = np.where(t < meets, 0.5 * push * t**2, half + d)
    assert 0.02 < meets < 0.1
    assert (d[t > meets] > 0.0).all()  # the flank is not left in this time
    assert np.abs(result["x"].values[t <= meets]).max() < 1e-12  # the step that meets the flank has stages beyond it
    assert np.abs(result["drive.servo.deflection"].values - sign * expected).max() < 1e-9
    assert np.abs(result["joint.x.effort"].values - sign * K * np.where(t < meets, 0.0, d)).max() < 1e-7


def test_free_travel_and_flanks_make_a_period(servo):
    """At the relative speed u: ``b / u`` of travel and ``pi / w`` on each flank, whatever the number of contacts."""
    u = 2.0
    result = run(
        servo(backlash=f"{BACKLASH} rad"), end="2 s", start={"velocity": {"x": "0 rad/s", "servo.rotor": f"{u} rad/s"}}
    )
    travel, touch = BACKLASH / u, np.pi / RELATIVE
    phase = (result["t"].values + 0.5 * travel) % (2.0 * (travel + touch))
    side, phase = np.where(phase < travel + touch, 1.0, -1.0), phase % (travel + touch)
    pushed = 0.5 * BACKLASH + u / RELATIVE * np.sin(RELATIVE * (phase - travel))
    expected = side * np.where(phase < travel, u * phase - 0.5 * BACKLASH, pushed)
    assert np.abs(result["drive.servo.deflection"].values - expected).max() < 2e-7  # some 20 contacts
    assert result.figures["energy"] < 5e-7  # tolerance 1e-9 a step, and as many steps end at contacts


def test_flanks_with_a_damper_break_a_joint_loose_as_they_touch(servo):
    """Their push jumps from 0 to ``c u``, past the 0.05 N m of dry friction that hold the joint until then."""
    rub, damping, u = 0.05, 0.2, 2.0
    mechanism = servo(damping, backlash=f"{BACKLASH} rad", values={"friction": {"x": {"constant": f"{rub} N*m"}}})
    start = {"velocity": {"servo.rotor": f"{u} rad/s"}}
    result = run(mechanism, end="0.05 s", start=start, outputs=("x",))
    t, both, drag = result["t"].values, 1.0 / OWN + 1.0 / LOAD, rub / LOAD
    a = np.array([[0, 1, 0, 0], [-K * both, -damping * both, 0, drag], [K / LOAD, damping / LOAD, 0, -drag], [0] * 4])
    after = np.maximum(t - 0.5 * BACKLASH / u, 0.0)
    speed = np.array([expm(a * one) @ [0.0, u, 0.0, 1.0] for one in after])[:, 2]
    assert damping * u > rub
    assert np.abs(result["joint.x.velocity"].values - speed).max() < 1e-7
    assert result.figures["energy"] < 1e-7


def test_the_motor_of_an_elastic_gear_is_not_taken_for_a_rigid_one(servo):
    law = {"x": {"law": "harmonic", "amplitude": "0.3 rad", "pulsation": "5 rad/s"}}
    inverse = {"pinarm": 1, "mechanism": servo(), "outputs": ["drive.servo.torque"], "problem": {
        "kind": "inverse", "time": {"end": "1 s", "samples": 5}, "motion": law}}  # fmt: skip
    with pytest.raises(InputError, match="the rotors of servo move by themselves"):
        pinarm.run(inverse)
    with pytest.raises(InputError, match="is not the motor behind its elastic gear"):
        run(servo(), motion=law, outputs=("drive.servo.torque",))


@pytest.mark.parametrize("keys, said", [
    ({"elasticity": None, "backlash": "1 deg"}, "need a stiffness"), ({"rotor_inertia": None}, "needs an inertia"),
    ({"backlash": "1 mm"}, "not a unit"),
    ({"backlash": "-1 deg"}, "out of bounds"), ({"elasticity": {"stiffness": "1 N/m"}}, "not a unit"),
    ({"elasticity": {"stiffness": "0 N*m/rad"}}, "out of bounds"),
])  # fmt: skip
def test_mistakes_are_told(servo, keys, said):
    with pytest.raises(InputError, match=said):
        servo(**keys)
