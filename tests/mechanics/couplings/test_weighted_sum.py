"""Sums of coordinates that stay constant, such as the differential of an axle."""

import pytest
from catalogue import disc
from motions import free

from pinarm.errors import InputError
from pinarm.mechanics.forces.along_coordinate import JointEffort
from pinarm.mechanics.laws import Constant

INERTIAS = {"left": 0.2, "right": 0.3, "cage": 0.5}


def axle(mechanism, **more):
    xml = "".join(disc(name, inertia) for name, inertia in INERTIAS.items())
    sum_of = {"kind": "sum", "weights": {"cage": 2.0, "left": -1.0, "right": -1.0}, **more}
    return mechanism(f'<robot name="axle"><link name="base"/>{xml}</robot>', couplings={"differential": sum_of})


def test_a_differential_shares_the_torque_alike(mechanism):
    """``2 cage = left + right``; by Lagrange: J' = J + 4 J_l J_r / (J_l + J_r) is what the cage feels."""
    run = free(axle(mechanism), loads={"motor": JointEffort(joint="cage", effort=Constant(value=6.0))})
    left, right, cage = (run.a[:, run.mechanism.joints[name].v] for name in INERTIAS)
    felt = 0.5 + 4.0 * 0.2 * 0.3 / (0.2 + 0.3)
    assert cage == pytest.approx(6.0 / felt, rel=1e-12)
    assert 0.2 * left == pytest.approx(0.3 * right, rel=1e-12)
    assert left + right == pytest.approx(2.0 * cage, rel=1e-12)


@pytest.mark.parametrize(("weights", "message"), [
    ({"sun": 1.0, "nut": 2.0}, "cannot mix angles and lengths"),
    ({"sun": 1.0, "arm": 0.0}, "0 is out of bounds"),
    ({"sun": 1.0, "arms": 1.0}, "no joint 'arms'"),
    ({"sun": 1.0}, ">= 2"),
])  # fmt: skip
def test_what_is_no_sum_is_refused(gearbox, weights, message):
    with pytest.raises(InputError, match=message):
        gearbox(it={"kind": "sum", "weights": weights})
