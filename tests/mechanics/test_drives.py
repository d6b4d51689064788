import numpy as np
import pytest

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.drives import Drive

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


@pytest.mark.parametrize("ratio", [RATIO, -RATIO])
@pytest.mark.parametrize("effort", [3.0, -3.0])
@pytest.mark.parametrize("v", [2.0, -2.0])
def test_the_gear_never_gives_power(ratio, effort, v):
    drive = Drive(joint="arm", ratio=ratio, efficiency=EFFICIENCY)
    motor = torque(drive, effort, np.sign(v)) * drive.speed(np.array([v]))[0]
    lost = motor - effort * v
    share = (1 / EFFICIENCY - 1) if effort * v > 0 else (1 - EFFICIENCY)
    assert lost == pytest.approx(share * abs(effort * v))


@pytest.mark.parametrize("ratio", [RATIO, -RATIO])
def test_rotor_takes_its_own_share_whatever_the_efficiency(ratio):
    drive = Drive(joint="arm", ratio=ratio, efficiency=EFFICIENCY, rotor_inertia=ROTOR)
    assert torque(drive, 0.0, 1.0, 7.0) == pytest.approx(ROTOR * ratio * 7.0)
    assert drive.armature == pytest.approx(ratio**2 * ROTOR)


@pytest.mark.parametrize("defect", [{"efficiency": 0.0}, {"efficiency": 1.1}, {"rotor_inertia": -1.0}, {"ratio": "x"}])
def test_impossible_drives_are_refused(defect):
    with pytest.raises(ValueError, match=next(iter(defect))):
        Drive(joint="arm", **defect)


def test_a_motor_that_is_off_has_no_torque(mechanism, chain):
    drive = {"joint": "arm", "ratio": RATIO, "efficiency": EFFICIENCY, "rotor_inertia": f"{ROTOR} kg*m^2"}
    falling = mechanism(chain(PENDULUM), drives={"motor": drive}).at([[0.3]], [[2.0]], tau=[[0.0]])
    assert falling["joint.arm.acceleration"].values[0] == pytest.approx(
        9.81 * 2.0 * 0.5 * np.cos(0.3) / (ABOUT_PIVOT + RATIO**2 * ROTOR)
    )
    assert falling["drive.motor.torque"].values == falling["drive.motor.power"].values == 0.0


def test_a_drive_without_gear_ratio_is_refused():
    with pytest.raises(ValueError, match="ratio"):
        Drive(joint="arm", ratio=0.0)


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
    assert found["joint.arm.effort"].values == pytest.approx(run.tau[:, 0] - RATIO**2 * ROTOR * run.a[:, 0], abs=1e-12)


def test_motor_with_losses_splits_link_and_rotor(mechanism, chain, swing):
    arm = driven(mechanism, chain, rotor_inertia=f"{ROTOR} kg*m^2", efficiency=EFFICIENCY)
    run = swing(arm)
    effort = ABOUT_PIVOT * run.a[:, 0] - 2.0 * 9.81 * 0.5 * np.cos(run.q[:, 0])
    gear = np.where(effort * run.v[:, 0] > 0, 1 / EFFICIENCY, EFFICIENCY)
    moving = np.abs(run.v[:, 0]) > 1e-6
    expected = gear * effort / RATIO + ROTOR * RATIO * run.a[:, 0]
    assert Quantities(run)["drive.motor.torque"].values[moving] == pytest.approx(expected[moving], abs=1e-13)
    assert (effort * run.v[:, 0] > 0).any() and (effort * run.v[:, 0] < 0).any()


def test_a_drive_names_an_existing_joint(mechanism, chain):
    with pytest.raises(InputError, match="no joint 'amr'"):
        driven(mechanism, chain, joint="amr")
