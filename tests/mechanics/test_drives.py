import json
from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.laws import Harmonic
from pinarm.mechanics.rotors import Drive
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import State
from pinarm.use.mechanism import Mechanism

RATIO, EFFICIENCY, ROTOR = 50.0, 0.8, 2e-5
PENDULUM = {"name": "arm", "axis": "0 1 0", "mass": 2.0, "com": "0.5 0 0", "inertia": (0.0, 0.2, 0.2)}
ABOUT_PIVOT = 0.2 + 2.0 * 0.5**2


def torque(drive, effort, direction, a=0.0):
    return drive.torque(np.array([effort]), np.array([direction]), np.array([a]))[0]


@pytest.mark.parametrize(
    ("effort", "direction", "expected"),
    [
        (10.0, 1.0, 10.0 / (RATIO * EFFICIENCY)),
        (-10.0, -1.0, -10.0 / (RATIO * EFFICIENCY)),
        (10.0, -1.0, 10.0 * EFFICIENCY / RATIO),
        (-10.0, 1.0, -10.0 * EFFICIENCY / RATIO),
        (10.0, 0.0, 10.0 / (RATIO * EFFICIENCY)),
        (-10.0, 0.0, -10.0 / (RATIO * EFFICIENCY)),
    ],
)
def test_torque_depends_on_the_direction_of_power(effort, direction, expected):
    assert torque(Drive(joint="arm", ratio=RATIO, efficiency=EFFICIENCY), effort, direction) == pytest.approx(expected)


@pytest.mark.parametrize("defect", [{"efficiency": 0.0}, {"efficiency": 1.1}, {"rotor_inertia": -1.0}, {"ratio": 0.0}])
def test_impossible_drives_are_refused(defect):
    with pytest.raises(ValueError, match=next(iter(defect))):
        Drive(joint="arm", **defect)


def driven(mechanism, chain, **drive):
    return mechanism(chain(PENDULUM), drives={"motor": {"joint": "arm", "ratio": RATIO, **drive}})


def test_rotor_counts_in_the_effort_as_inertia_about_the_joint(mechanism, chain):
    arm = driven(mechanism, chain, rotor_inertia=f"{ROTOR} kg*m^2")
    q, v, a = np.array([0.3]), np.array([1.1]), np.array([2.5])
    weight = -2.0 * 9.81 * 0.5 * np.cos(0.3)  # moment of the weight about y, which turns x towards -z
    expected = (ABOUT_PIVOT + RATIO**2 * ROTOR) * 2.5 + weight
    assert arm.inverse(q, v, a)[0] == pytest.approx(expected, rel=1e-14)
    assert arm.forward(q, v, np.array([expected]))[0] == pytest.approx(2.5, rel=1e-14)
    kinetic, _ = arm.dynamics.energy(q[None], v[None])
    assert kinetic[0] == pytest.approx(0.5 * (ABOUT_PIVOT + RATIO**2 * ROTOR) * 1.1**2, rel=1e-14)


@pytest.mark.parametrize("ratio", [RATIO, -RATIO])
def test_motor_without_losses_gives_the_power_of_the_whole_effort(mechanism, chain, swing, ratio):
    arm = driven(mechanism, chain, ratio=ratio, rotor_inertia=f"{ROTOR} kg*m^2")
    run = swing(arm)
    found = Quantities(run)
    assert found["drive.motor.power"].values == pytest.approx(run.tau[:, 0] * run.v[:, 0], abs=1e-12)
    assert found["joint.arm.power"].values == pytest.approx(found["drive.motor.power"].values, abs=1e-12)
    link = run.tau[:, 0] - RATIO**2 * ROTOR * run.a[:, 0]
    assert found["joint.arm.link_effort"].values == pytest.approx(link, abs=1e-12)
    assert found["joint.arm.moment.y"].values == pytest.approx(link, abs=1e-12)


ARMATURE = 3.0  # kg m^2, beside 0.7 of the arm
MJCF = """
<mujoco><compiler angle="radian"/><worldbody><body name="arm"><joint name="arm" axis="0 1 0" armature="3"
 range="-3 3" limited="true" actuatorfrcrange="-9 9" actuatorfrclimited="true"/>
 <inertial pos="0.5 0 0" mass="2" diaginertia="0.2 0.2 0.2"/></body></worldbody></mujoco>"""


@pytest.fixture
def geared(tmp_path):
    """Return an arm of MJCF, whose joint has an armature, behind a gear whose rotor counts too."""
    (tmp_path / "arm.xml").write_text(MJCF)
    drive = {"joint": "arm", "ratio": RATIO, "efficiency": EFFICIENCY, "rotor_inertia": f"{ROTOR} kg*m^2"}
    content = {"pinarm": 1, "robot": "arm.xml", "drives": {"motor": drive}}
    (tmp_path / "arm.yaml").write_text(json.dumps(content))
    return Mechanism.load(tmp_path / "arm.yaml")


def test_effort_and_power_are_those_of_the_inverse_problem_and_of_the_energy(geared, swing, differentiate):
    """The armature alone turns the effort's sign in places: what a motor is sized for has to count it."""
    run = swing(geared)
    found, (q, v, a) = Quantities(run), (run.q, run.v, run.a)
    weight = -2.0 * 9.81 * 0.5 * np.cos(q[:, 0])
    whole = (ABOUT_PIVOT + ARMATURE + RATIO**2 * ROTOR) * a[:, 0] + weight
    effort = found["joint.arm.effort"].values
    assert effort == pytest.approx(whole, abs=1e-12)
    assert effort == pytest.approx(geared.inverse(q, v, a)[:, 0], abs=1e-12)
    assert found["coordinate.arm.effort"].values == pytest.approx(effort, abs=1e-12)
    alone = geared.at(q, v, a)
    assert alone["joint.arm.effort"].values == pytest.approx(effort, abs=1e-12)
    link = ABOUT_PIVOT * a[:, 0] + weight
    assert found["joint.arm.link_effort"].values == pytest.approx(link, abs=1e-12)
    assert (link * effort < 0.0).any()
    law = Harmonic(mean=0.4, amplitude=0.9, pulsation=2.0)

    def energy(t):
        s, ds, _ = law.on(0.0, 3.0)(t)
        return sum(geared.dynamics.energy(s[:, None], ds[:, None]))

    assert found["joint.arm.power"].values == pytest.approx(differentiate(energy, run.grid.t), abs=1e-9)


def test_an_armature_of_the_model_is_a_load_of_the_gear(geared, swing):
    run = swing(geared)
    through = (ABOUT_PIVOT + ARMATURE) * run.a[:, 0] - 2.0 * 9.81 * 0.5 * np.cos(run.q[:, 0])
    gear = np.where(through * run.v[:, 0] > 0, 1 / EFFICIENCY, EFFICIENCY)
    expected = gear * through / RATIO + ROTOR * RATIO * run.a[:, 0]
    moving = np.abs(run.v[:, 0]) > 1e-6
    assert Quantities(run)["drive.motor.torque"].values[moving] == pytest.approx(expected[moving], abs=1e-13)


def test_motors_at_a_joint_and_along_a_sum_through_it_give_the_power_of_the_lift(mechanism, chain):
    """Two arms of 1 m and 1 kg, stretched out: the second motor lifts the forearm, ``m g l / 2``, past the elbow.

    At 1 and 1.5 rad/s the centres of mass rise at 0.5 m/s and 1.75 m/s; with no acceleration of the joints they gain no
    kinetic energy, as the centrifugal forces point along the arms.
    """
    arm = {"axis": "0 -1 0", "com": "0.5 0 0", "mass": 1.0}
    drives = {"first": {"joint": "O", "ratio": 10}, "second": {"along": "phi", "ratio": 10}}
    robot = mechanism(chain({"name": "O", **arm}, {"name": "A", "at": "1 0 0", **arm}), drives=drives,
                      coordinates={"phi": {"kind": "sum", "of": {"O": 1, "A": 1}}})  # fmt: skip
    asked = State(hold={"O": 0.0, "A": 0.0}, velocity={"O": 1.0, "A": 0.5}, drives=["O", "phi"])
    found = Quantities(asked.solve(robot, Accuracy(), lambda *path: nullcontext()).rows)
    assert found["drive.first.torque"].values[0] == pytest.approx(0.15 * 9.81, rel=1e-12)
    lift = sum(found[f"drive.{name}.power"].values[0] for name in drives)
    assert lift == pytest.approx((0.5 + 1.75) * 9.81, rel=1e-12)
