"""Belts that slip on their wheels: printed tensions, the capstan's law by integration, and motions by hand."""

from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.inverse import Statics
from pinarm.problems.time_grid import TimeGrid

R1, R2 = 0.1, 0.25
I1, I2 = 0.1, 0.1
LAP = np.radians(150.0)
APART = float((R2 - R1) / np.cos(0.5 * LAP))
"""Distance at which an open belt lies on the smaller wheel by 150 deg."""
MU, PRETENSION = 0.25, 1000.0


def anywhere(*path):
    return nullcontext()


@pytest.fixture
def belt(mechanism, chain):
    """Two wheels with a belt whose grip is limited; the first is the smaller one."""

    def build(course="open", friction=None, radii=(R1, R2), sense=1.0, **more):
        first = chain({"name": "one", "axis": "0 0 1"})
        second = chain({"name": "two", "axis": f"0 0 {sense}", "at": f"{APART!r} 0 0"})
        link = second[second.index('<link name="two_link"') : second.index("</robot>")]
        drive = {"kind": "belt", "joints": ["one", "two"], "radii": [f"{r!r} m" for r in radii], "course": course,
                 "pretension": f"{PRETENSION} N"}  # fmt: skip
        return mechanism(first.replace("</robot>", f"{link}</robot>"), gravity="none", couplings={"belt": drive},
                         friction={"belt": friction or {"mu": MU}}, **more)  # fmt: skip

    return build


def torque(name, value):
    return {"kind": "joint_effort", "joint": name, "effort": {"law": "constant", "value": f"{value} N*m"}}


def held(mechanism, **loads):
    problem = Statics(hold={"one": 0.0, "two": 0.0}, drives=["one", "two"])
    return Quantities(problem.solve(mechanism, Accuracy(), anywhere).rows)


def free(mechanism, end=1.0, samples=11, **velocity):
    problem = Forward(time=TimeGrid(end=end, samples=samples), initial=InitialState(velocity=velocity))
    return problem.solve(mechanism, Accuracy(tolerance=1e-10), anywhere)


def pull(mu, lap, pretension=PRETENSION):
    """Largest ``T1 - T2``, by the balance of a million pieces of the belt on the wheel: ``dT = mu T dtheta``."""
    ratio = np.prod(np.full(1_000_000, (1.0 + 0.5e-6 * mu * lap) / (1.0 - 0.5e-6 * mu * lap)))
    return 2.0 * pretension * (ratio - 1.0) / (ratio + 1.0)


def test_tensions_of_the_worked_example(belt):
    """Initial tension 1000 N, angle of embrace 150 deg, mu = 0.25: T1 = 1316 N, T2 = 684.0 N, at 500 m/min 5.27 kW.

    A worked example of flat belt drives in the collection of Scilab textbook companions (FOSSEE).
    """
    found = held(belt())
    lower, upper = (found[f"joint.one.effort.{side}"].values[0] for side in ("lower", "upper"))
    difference = upper / R1
    assert lower == pytest.approx(-upper, rel=1e-12)
    tight, slack = PRETENSION + 0.5 * difference, PRETENSION - 0.5 * difference
    assert (round(tight), round(slack, 1)) == (1316, 684.0)
    assert round(difference * 500.0 / 60.0 / 1000.0, 2) == 5.27


@pytest.mark.parametrize("course", ["open", "crossed"])
def test_tensions_of_a_belt_that_slips_have_the_ratio_of_the_capstan(belt, course):
    """``T1 / T2 = e^(mu theta)`` on the smaller wheel, about the pretension; the wheel is braked by ``(T1 - T2) r``."""
    lap = {"open": np.deg2rad(150.0), "crossed": np.pi + 2.0 * np.arcsin((R1 + R2) / APART)}[course]
    found = Quantities(free(belt(course), end=0.002, one=20.0).rows)  # it slips all the time
    tight, slack = (found[f"coupling.belt.{part}"].values for part in ("tight", "slack"))
    assert tight / slack == pytest.approx(np.full(11, np.exp(MU * lap)), rel=1e-6)
    assert tight + slack == pytest.approx(np.full(11, 2.0 * PRETENSION), rel=1e-12)
    braked = found["joint.one.acceleration"].values * 0.1
    assert np.abs(braked) == pytest.approx((tight - slack) * R1, rel=1e-9)


@pytest.mark.parametrize(("course", "sense"), [("crossed", 1.0), ("open", -1.0)])
def test_the_band_is_that_of_the_lap_on_the_wheel_that_has_less_of_it(belt, course, sense):
    lap = LAP if course == "open" else np.pi + 2.0 * np.arcsin((R1 + R2) / APART)
    found, most = held(belt(course, sense=sense)), pull(MU, lap)
    for name, radius in (("one", R1), ("two", R2)):
        assert found[f"joint.{name}.effort.upper"].values[0] == pytest.approx(most * radius, rel=1e-9)
    swapped = held(belt(course, radii=(R2, R1), sense=sense))
    assert swapped["joint.one.effort.upper"].values[0] == pytest.approx(most * R2, rel=1e-9)


def test_beyond_its_grip_the_belt_slips_with_what_it_still_pulls(belt):
    """Each wheel for itself: ``I1 w1' = M - D r1``, ``I2 w2' = D r2``; the belt then sticks when the speeds agree."""
    grip = {"mu": 0.15, "static_mu": MU}
    still, slipping = pull(MU, LAP), pull(0.15, LAP)
    effort = 1.5 * still * (R1 + I1 / I2 * R2 * R2 / R1)
    run = free(belt(friction=grip, forces={"motor": torque("one", effort)}))
    found, t = Quantities(run.rows), np.linspace(0.0, 1.0, 11)
    assert found["joint.one.velocity"].values == pytest.approx((effort - slipping * R1) / I1 * t, rel=1e-9)
    assert found["joint.two.velocity"].values == pytest.approx(slipping * R2 / I2 * t, rel=1e-9)
    slip = R2 * found["joint.two.velocity"].values - R1 * found["joint.one.velocity"].values
    assert found["power.friction"].values == pytest.approx(-slipping * np.abs(slip), rel=1e-9, abs=1e-9)


def test_a_belt_that_slips_at_the_start_brings_the_wheels_to_one_speed(belt):
    """Angular momenta over the radii are kept until both rims are equally fast, at ``I1 w1 = D r1 t`` less."""
    spin, most = 30.0, pull(MU, LAP)
    run = free(belt(), end=2.0, samples=21, one=spin)
    found = Quantities(run.rows)
    common = spin * I1 * R2 / R1 / (I1 * R2 / R1 + I2 * R1 / R2)
    stuck = (spin - common) * I1 / (most * R1)
    assert 0.0 < stuck < 1.9
    assert found["joint.one.velocity"].values[-1] == pytest.approx(common, rel=1e-9)
    assert found["joint.two.velocity"].values[-1] == pytest.approx(common * R1 / R2, rel=1e-9)
    [end] = [segment.solution.end for segment in run.motion.motion.segments[:-1]]
    assert end == pytest.approx(stuck, rel=1e-8)
    assert run.measures()["energy"] < 1e-9


@pytest.mark.parametrize(
    ("friction", "message"),
    [
        ({"mu": 0.3, "radius": "10 mm"}, "a belt has no radius"),
        ({"mu": 0.3, "static_mu": 0.2}, "below that of slip"),
    ],
)
def test_what_a_belt_does_not_have_is_refused(belt, friction, message):
    with pytest.raises(InputError, match=message):
        belt(friction=friction)
