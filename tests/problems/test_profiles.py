"""Motions and loads over a coordinate, in problems: a profile is what the law over time that it makes would be."""

from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.engine.integration.methods import METHODS
from pinarm.errors import InputError
from pinarm.input.yaml.schema import reading_from
from pinarm.mechanics.forces.along_coordinate import JointEffort, TorqueSpeed
from pinarm.mechanics.laws import Constant, ConstantSpeed, Harmonic, Over, Polynomial, Succession, Table
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward
from pinarm.problems.inverse import Inverse, KinematicMotion
from pinarm.problems.time_grid import TimeGrid

TIME = TimeGrid(end=2.0, samples=41)
TURN = ConstantSpeed(speed=3.0, start=0.2)
SWING = Harmonic(amplitude=0.5, pulsation=2.0, phase=0.1)
SAME = Harmonic(amplitude=0.5, pulsation=6.0, phase=0.5)
"""SWING over TURN, as a law over time."""
BODIES = ({"name": "crank", "com": "0.4 0 0"}, {"name": "arm", "at": "0.8 0 0", "com": "0.3 0 0"},
          {"name": "flail", "at": "0.6 0 0", "com": "0.2 0 0"})  # fmt: skip


def place(*path):
    return nullcontext()


@pytest.fixture
def arm(mechanism, chain):
    return mechanism(chain(*BODIES[:2]), gravity={"direction": "-y", "magnitude": "9.81 m/s^2"})


@pytest.mark.parametrize("kind", [Inverse, KinematicMotion])
def test_an_prescribed_motion_is_that_of_the_composed_law(arm, kind):
    profiled = kind(time=TIME, motion={"arm": Over(of="crank", profile=SWING), "crank": TURN})
    plain = kind(time=TIME, motion={"crank": TURN, "arm": SAME})
    one, other = (problem.solve(arm, Accuracy(), place).rows for problem in (profiled, plain))
    for name in ("q", "v", "a", "tau"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-11), name


def test_a_profile_is_said_to_load_nothing_of_what_it_runs_along(arm):
    """A designer of a cam would size its shaft by an effort without the load of the follower."""
    (note,) = (
        Inverse(time=TIME, motion={"arm": Over(of="crank", profile=SWING), "crank": TURN})
        .solve(arm, Accuracy(), place)
        .notes
    )
    assert "efforts, reactions, loads and sizing at 'crank' are without it" in note
    assert "joint.crank.effort + joint.arm.effort*joint.arm.velocity/joint.crank.velocity" in note
    assert not Inverse(time=TIME, motion={"crank": TURN, "arm": SAME}).solve(arm, Accuracy(), place).notes


def test_a_table_of_another_coordinate_is_refused(arm, tmp_path):
    (tmp_path / "t.csv").write_text("t [s],arm [deg]\n0,0\n2,90\n")
    with reading_from(tmp_path):
        law, named = Table(file="t.csv"), Table(file="t.csv", column="arm")
    with pytest.raises(InputError, match="has values of 'arm', another coordinate than 'crank'"):
        Inverse(time=TIME, motion={"crank": law, "arm": TURN}).solve(arm, Accuracy(), place)
    run = Inverse(time=TIME, motion={"crank": named, "arm": law}).solve(arm, Accuracy(), place).rows
    assert run.q[-1] == pytest.approx([0.5 * np.pi, 0.5 * np.pi], abs=1e-14)


def test_a_profile_may_run_along_a_task_coordinate(arm, mechanism, chain):
    """The tip's height drives the other joint: the tip is lifted and the arm turns as it says."""
    tall = mechanism(chain(*BODIES[:2]), coordinates={"height": {"kind": "point", "point": "arm_link", "along": "y"}})
    lift = Harmonic(mean=0.3, amplitude=0.2, pulsation=1.5)
    motion = {"height": lift, "arm": Over(of="height", profile=Harmonic(amplitude=0.9, pulsation=4.0))}
    run = Inverse(time=TIME, motion=motion, start={"crank": 0.3}).solve(tall, Accuracy(), place).rows
    height = 0.3 + 0.2 * np.sin(1.5 * run.grid.t)
    assert run.q[:, 0] == pytest.approx(np.arcsin(height / 0.8), abs=1e-12)
    assert run.q[:, 1] == pytest.approx(0.9 * np.sin(4.0 * height), abs=1e-12)
    rate = 0.3 * np.cos(1.5 * run.grid.t)
    assert run.v[:, 1] == pytest.approx(3.6 * np.cos(4.0 * height) * rate, abs=1e-12)


def test_a_prescribed_part_of_a_free_motion_may_follow_a_profile(mechanism, chain):
    trio = mechanism(chain(*BODIES), gravity={"direction": "-y", "magnitude": "9.81 m/s^2"})
    runs = [Forward(time=TIME, motion={"crank": TURN, "arm": law}).solve(trio, Accuracy(tolerance=1e-11), place).rows
            for law in (Over(of="crank", profile=SWING), SAME)]  # fmt: skip
    for name in ("q", "v", "a", "tau"):
        one, other = (getattr(run, name) for run in runs)
        assert one == pytest.approx(other, abs=1e-7 * np.abs(other).max()), name
    assert np.ptp(runs[0].q[:, 2]) > 1.0


REFUSED = {
    "no law": ({"arm": Over(of="crank", profile=SWING)}, "'crank' follows no law"),
    "unknown": ({"arm": Over(of="cranc", profile=SWING), "crank": TURN}, "no coordinate 'cranc'"),
    "itself": ({"arm": Over(of="arm", profile=SWING), "crank": TURN}, "run along each other: arm -> arm"),
    "in a ring": (
        {"arm": Over(of="crank", profile=SWING), "crank": Over(of="arm", profile=SWING)},
        "run along each other: arm -> crank -> arm",
    ),
    "too often": (
        {"crank": ConstantSpeed(speed=1e9), "arm": Over(of="crank", profile=Constant(value=1.0), period=1.0)},
        "the profile is passed",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(arm, case):
    motion, message = REFUSED[case]
    with pytest.raises(InputError, match=message):
        Inverse(time=TIME, motion=motion).prepare(arm, Accuracy(), place)


REST = Constant(value=0.0)
KICK = Succession(segments=[
    {"duration": 3.0, "motion": REST},
    {"duration": 0.01, "motion": Polynomial(start=0.0, end=5.0, duration=0.01)},
    {"duration": 0.01, "motion": Polynomial(start=5.0, end=0.0, duration=0.01)},
    {"duration": 2.98, "motion": REST},
])  # fmt: skip
"""A torque of 0.05 J over a hundredth of a turn."""


ADAPTIVE = [
    name for name, entry in METHODS.items()
    if entry.setting == "tolerance" and entry.make(1e-9).order >= 4
]  # fmt: skip
"""Methods that choose their steps; motors and kicks change the energy; low orders take too many steps for 1e-9."""


@pytest.fixture
def wheel(mechanism, chain):
    return mechanism(chain({"name": "wheel", "inertia": (0.1, 0.1, 0.02)}), gravity="none")


def spun(wheel, loads, speed=20.0, **accuracy):
    """Return what comes out for the wheel over a second."""
    one = Forward(time=TimeGrid(end=1.0, samples=3), initial={"velocity": {"wheel": speed}}, loads=loads)
    return one.solve(wheel, Accuracy(**accuracy), place)


@pytest.mark.parametrize("method", ADAPTIVE)
def test_a_wheel_passes_no_kick_on_its_way_unseen(wheel, method):
    """The wheel turns evenly but for kicks of 0.02 rad: steps would be as long as the run."""
    kick = JointEffort(joint="wheel", over="wheel", effort=KICK, period=6.0)
    run = spun(wheel, {"kick": kick}, method=method).rows
    assert 0.5 * 0.02 * run.v[-1, 0] ** 2 == pytest.approx(4.0 + 0.05 * 3, rel=1e-5)  # kinks of s''


@pytest.mark.parametrize("method", ADAPTIVE)
def test_a_motor_does_not_leap_over_a_notch_of_its_curve(wheel, method):
    """It gives 5 N*m but for a notch down to -20 N*m at 50 rad/s, 1 rad/s wide: it stays where it gives nothing."""
    curve = [(-100.0, 5.0), (49.5, 5.0), (50.0, -20.0), (50.5, 5.0), (900.0, 5.0)]
    run = spun(wheel, {"motor": TorqueSpeed(joint="wheel", curve=curve)}, speed=0.0, method=method).rows
    assert run.v[-1, 0] == pytest.approx(49.6, abs=1e-6)
