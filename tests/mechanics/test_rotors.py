"""Motors behind gears along coordinates that are no joint's: against the same joint in the tree, and known inertias."""

import numpy as np
import pytest
from catalogue import four_bar, rssr, screw_jack, slider_crank
from motions import driven, freely, states, wrench

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.laws import Harmonic

RATIO, EFFICIENCY, ROTOR = 40.0, 0.8, 3e-4
MOTOR = {"ratio": RATIO, "efficiency": EFFICIENCY, "rotor_inertia": f"{ROTOR} kg*m^2"}
LINKAGES = {"four-bar": four_bar(), "rssr": rssr(), "slider-crank": slider_crank()}
CASES = {
    "crank": ("four-bar", "O", "A", "angle"), "spatial rocker": ("rssr", "C", "A", "angle"),
    "slider": ("slider-crank", "C", "A", "position"),
}  # fmt: skip
"""Linkage, driven joint, another one that is cut in its place, coordinate."""


def pair(case, folder, **motor):
    """The mechanism with a motor at a joint of the tree, and at the same joint as the one that closes the loop."""
    name, cut, other, part = CASES[case]
    motor = {**MOTOR, **motor}
    tree = LINKAGES[name].build(folder, [other], drives={"motor": {"joint": cut, **motor}})
    loop = LINKAGES[name].build(folder, [cut], drives={"motor": {"along": f"{cut}.{part}", **motor}})
    return tree, loop


@pytest.mark.parametrize("case", CASES)
class TestAtALoopJoint:
    def test_torque_speed_and_power_are_those_of_the_joint_in_the_tree(self, case, tmp_path):
        tree, loop = pair(case, tmp_path)
        linkage, cut, _, part = CASES[case]
        law = Harmonic(amplitude=0.02 if part == "position" else -0.05, pulsation=3.0)
        right, run = driven(tree, {cut: law}, samples=9), driven(loop, {f"{cut}.{part}": law}, samples=9)
        expected, found = Quantities(right), Quantities(run)
        for quantity in ("torque", "speed", "power"):
            values = expected[f"drive.motor.{quantity}"].values
            size = np.abs(values).max()
            assert size > 0.0
            assert found[f"drive.motor.{quantity}"].values == pytest.approx(values, rel=1e-8, abs=1e-9 * size)
        again = wrench(LINKAGES[linkage], run, "B")  # carries what the motor does, and is in the tree either way
        for component, values in wrench(LINKAGES[linkage], right, "B").items():
            if component in again:
                assert again[component] == pytest.approx(values, rel=1e-7, abs=1e-7), component

    def test_the_rotor_slows_free_motion_as_much(self, case, tmp_path):
        tree, loop = pair(case, tmp_path, efficiency=1.0)
        bare, _ = pair(case, tmp_path, rotor_inertia="0 kg*m^2")
        linkage = LINKAGES[CASES[case][0]]
        right, run, without = (freely(one, 0.2, 5, tolerance=1e-10).rows for one in (tree, loop, bare))
        assert states(linkage, run) == pytest.approx(states(linkage, right), rel=1e-6, abs=1e-6)
        assert np.abs(states(linkage, without) - states(linkage, right)).max() > 1e-2
        for part in ("kinetic", "total"):
            values = Quantities(right)[f"energy.{part}"].values
            assert Quantities(run)[f"energy.{part}"].values == pytest.approx(values, rel=1e-6, abs=1e-6)


def test_the_rotor_of_a_screw_that_closes_a_loop(tmp_path):
    """Its inertia adds to that of the spindle, ``N^2 J``: the jack falls as with a heavier spindle."""
    jack = screw_jack()
    motor = {"along": "S.angle", "ratio": 5.0, "rotor_inertia": "2e-3 kg*m^2"}
    loop = jack.build(tmp_path, ["S"], drives={"motor": motor})
    fall = freely(loop, 0.1, 3, tolerance=1e-10).rows
    found = Quantities(fall)
    angle = found["coordinate.S.angle.velocity"].values
    energy = found["energy.kinetic"].values
    bare = jack.build(tmp_path, ["S"])
    alone = np.array([bare.dynamics.energy(q[None, : bare.model.nq], v[None, : bare.model.nv])[0][0]
                      for q, v in zip(fall.q, fall.v, strict=True)])  # fmt: skip
    assert energy - alone == pytest.approx(0.5 * 5.0**2 * 2e-3 * angle**2, rel=1e-9, abs=1e-12)
    assert found["joint.motor.rotor.position"].values == pytest.approx(found["loop.S.angle"].values, abs=1e-9)


WHEELS = ({"name": "one", "axis": "0 0 1"}, {"name": "two", "axis": "0 0 1", "at": "0.3 0 0"})
I1, I2 = 0.1, 0.1
A, B = 0.5, -1.5
"""Weights of the sum that the motor turns."""


@pytest.fixture
def differential(mechanism, chain):
    """Two wheels side by side, and a motor along a weighted sum of their angles."""

    def build(**motor):
        first, second = chain(WHEELS[0]), chain(WHEELS[1])
        link = second[second.index('<link name="two_link"') : second.index("</robot>")]
        return mechanism(
            first.replace("</robot>", f"{link}</robot>"), gravity="none",
            coordinates={"mean": {"kind": "sum", "of": {"one": A, "two": B}},
                         "other": {"kind": "sum", "of": {"one": 1.0, "two": 1.0}}},
            drives={"motor": {"along": "mean", **MOTOR, **motor}},
        )  # fmt: skip

    return build


class TestAlongAWeightedSum:
    def test_efforts_and_torque(self, differential):
        """``I q'' = W^T e`` with ``e1`` less ``N^2 J w1''`` for the rotor, by hand."""
        wheels = differential()
        laws = {"one": Harmonic(amplitude=0.4, pulsation=2.0), "two": Harmonic(amplitude=0.3, pulsation=5.0)}
        run = driven(wheels, laws, samples=33, drives=["mean", "other"])
        found = Quantities(run)
        v, a = (np.array([found[f"joint.{name}.{rate}"].values for name in ("one", "two")])
                for rate in ("velocity", "acceleration"))  # fmt: skip
        link = np.linalg.solve(np.array([[A, 1.0], [B, 1.0]]), np.array([[I1], [I2]]) * a)
        inertia, dw, ddw = RATIO**2 * ROTOR, np.array([A, B]) @ v, np.array([A, B]) @ a
        assert found["coordinate.mean.effort"].values == pytest.approx(link[0] + inertia * ddw, abs=1e-12)
        assert found["coordinate.other.effort"].values == pytest.approx(link[1], abs=1e-12)
        gear = np.where(link[0] * dw > 0.0, 1.0 / EFFICIENCY, EFFICIENCY)
        moving = np.abs(dw) > 1e-6
        expected = gear * link[0] / RATIO + ROTOR * RATIO * ddw
        assert found["drive.motor.torque"].values[moving] == pytest.approx(expected[moving], abs=1e-12)
        assert found["drive.motor.speed"].values == pytest.approx(RATIO * dw, abs=1e-12)
        assert (link[0] * dw > 0.0).any() and (link[0] * dw < 0.0).any()

    def test_free_motion_under_efforts_is_that_of_the_coupled_inertias(self, differential):
        wheels = differential()
        tau = np.array([0.7, -0.2, 0.0])
        coupled = np.diag([I1, I2]) + RATIO**2 * ROTOR * np.outer([A, B], [A, B])
        expected = np.linalg.solve(coupled, tau[:2])
        q = np.array([0.3, 0.4, A * 0.3 + B * 0.4])
        assert wheels.forward(q, np.zeros(3), tau)[:2] == pytest.approx(expected, rel=1e-12)
        a = np.array([*expected, np.array([A, B]) @ expected])
        assert wheels.inverse(q, np.zeros(3), a) == pytest.approx(tau, abs=1e-12)


@pytest.mark.parametrize(
    ("motor", "message"),
    [
        ({"along": "mena"}, "no coordinate 'mena'"),
        ({"along": "one"}, "'one' is a joint"),
        ({"joint": "one"}, "one joint, or along one coordinate"),
        ({"along": ""}, "one joint, or along one coordinate"),
    ],
)
def test_mistakes_are_told(differential, motor, message):
    with pytest.raises(InputError, match=message):
        differential(**motor)
