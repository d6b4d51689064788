"""Loads over time act as their laws say, on every row; and what a run that ends early keeps is the run until there."""

from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.engine.kernel import tree as kernel_tree
from pinarm.errors import InputError, IntegrationError, Interrupted
from pinarm.mechanics.forces.along_coordinate import EffortAlong, JointEffort
from pinarm.mechanics.forces.points import Wrench
from pinarm.mechanics.laws import (
    Constant,
    ConstantSpeed,
    Cycloidal,
    Harmonic,
    PiecewiseLinear,
    Polynomial,
    SCurve,
    Segment,
    Steps,
    Succession,
    Trapezoid,
)
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid

INERTIA, LEVER = 0.3 + 2.0 * 0.5**2, 0.7
ROD = {"name": "arm", "axis": "0 0 1", "mass": 2.0, "com": "0.5 0 0", "inertia": (0.1, 0.3, 0.3)}
TIME = TimeGrid(end=3.0, samples=31)
LAWS = {
    "trapezoid": Trapezoid(start=0.0, end=1.0, acceleration=4.0, begin=0.5),
    "cycloidal": Cycloidal(start=0.0, end=1.0, duration=1.0, begin=0.5),
    "polynomial 5": Polynomial(start=0.5, end=-1.0, duration=1.0, begin=0.5),
    "s-curve": SCurve(start=0.0, end=1.0, jerk=20.0, begin=0.5),
    "succession": Succession(segments=[
        Segment(duration=1.2, motion=Cycloidal(start=0.0, end=1.0, duration=1.0)),
        Segment(duration=1.2, motion=Cycloidal(start=0.0, end=-2.0, duration=1.0)),
    ]),
}  # fmt: skip
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


def place(*path):
    return nullcontext()


@pytest.fixture
def arm(mechanism, chain):
    """A rod that turns about a vertical axis, with a tip at the end of a lever."""
    tip = (
        '<link name="tip"/><joint name="end" type="fixed"><parent link="arm_link"/><child link="tip"/>'
        f'<origin xyz="{LEVER} 0 0"/></joint></robot>'
    )
    return mechanism(chain(ROD).replace("</robot>", tip), gravity="none")


def pushes(law):
    """A torque, and a force across the lever at its tip, that follow a law."""
    return {
        "torque": JointEffort(joint="arm", effort=law),
        "force": Wrench(point="tip", force=(0.0, 1.0, 0.0), axes="tip", factor=law),
    }


def values(law, t):
    """Return a law at every instant; what meets smoothly is the same from both sides."""
    pieces = law.pieces()
    return np.array([next(p for p in pieces if x <= p.end).function(np.array([x]))[0][0] for x in t])


@every_law
@pytest.mark.parametrize("push", ["torque", "force"])
def test_held_and_free_joints_have_the_effort_and_the_acceleration_of_the_load(arm, law, push):
    loads = {push: pushes(law)[push]}
    held = Inverse(time=TIME, motion={"arm": Constant(value=0.4)}, loads=loads).solve(arm, Accuracy(), place).rows
    free = Forward(time=TIME, loads=loads).solve(arm, Accuracy(tolerance=1e-12), place).rows
    expected, moved = (values(law, run.grid.t) * (LEVER if push == "force" else 1.0) for run in (held, free))
    assert held.tau[:, 0] == pytest.approx(-expected, abs=1e-14)
    assert free.a[:, 0] == pytest.approx(moved / INERTIA, abs=1e-13)
    assert np.ptp(expected) > 0.5


def test_a_prescribed_joint_bears_the_load_too(mechanism, chain):
    """The second joint is held by its drive; the load on it goes into the drive, and the first joint stays at rest."""
    law = LAWS["succession"]
    pair = mechanism(chain({"name": "first"}, {"name": "second", "at": "1 0 0"}), gravity="none")
    loads = {"torque": JointEffort(joint="second", effort=law)}
    run = Forward(time=TIME, motion={"second": Constant(value=0.4)}, loads=loads).solve(pair, Accuracy(), place).rows
    assert run.tau[:, 1] == pytest.approx(-values(law, run.grid.t), abs=1e-13)
    assert run.tau[:, 0] == pytest.approx(0.0, abs=1e-13)


def test_a_torque_is_switched_on_and_off(arm):
    """4 N*m from 1 s to 2 s, then -7 N*m: parabolas end to end."""
    law = Steps(points=[(0.0, 0.0), (1.0, 4.0), (2.0, -7.0)])
    outcome = Forward(time=TIME, loads={"torque": JointEffort(joint="arm", effort=law)}).solve(arm, Accuracy(), place)
    run = outcome.rows
    t = run.grid.t
    on, off = np.clip(t - 1.0, 0.0, 1.0), np.clip(t - 2.0, 0.0, 1.0)
    speed = (4.0 * on - 7.0 * off) / INERTIA
    angle = (2.0 * on**2 + 4.0 * off - 3.5 * off**2) / INERTIA
    assert run.v[:, 0] == pytest.approx(speed, abs=1e-13)
    assert run.q[:, 0] == pytest.approx(angle, abs=1e-13)
    assert run.a[t == 2.0, 0] * INERTIA == pytest.approx([4.0, -7.0], abs=1e-13)
    assert outcome.measures()["energy"] < 1e-13


@pytest.mark.parametrize("accuracy", [Accuracy(method="rk4", step=0.01), Accuracy()], ids=["rk4", "dop853"])
def test_a_load_that_ends_one_rounding_before_the_run_does(arm, accuracy):
    """0.1 s + 0.7 s is less than 0.8 s: the impulse of a smooth rise from 0 to 4 N*m is half of it over 0.7 s."""
    rise = Polynomial(start=0.0, end=4.0, duration=0.7, begin=0.1)
    loads = {"torque": JointEffort(joint="arm", effort=rise)}
    run = Forward(time=TimeGrid(end=0.8, samples=9), loads=loads).solve(arm, accuracy, place).rows
    assert run.grid.t == pytest.approx(np.linspace(0.0, 0.8, 9), abs=1e-15)
    assert run.v[-1, 0] == pytest.approx(2.0 * 0.7 / INERTIA, rel=1e-9)


def test_where_the_integration_ends_is_told_by_joints(arm):
    """A torque that grows with the angle, by so much that nothing follows it."""
    torque = JointEffort(joint="arm", effort=ConstantSpeed(speed=1e30), over="arm")
    problem = Forward(time=TIME, loads={"torque": torque}, initial=InitialState(position={"arm": 1.0}))
    with pytest.raises(IntegrationError, match=r"cannot go on at t = \S+ s: .*, with arm = \S+ deg"):
        problem.solve(arm, Accuracy(), place)


LEAP = Steps(points=[(0.0, 0.0), (1.0, 4.0)])


@pytest.mark.parametrize(
    "refused",
    [
        Inverse(time=TIME, motion={"arm": LEAP}),
        Forward(time=TIME, motion={"arm": LEAP}),
        Inverse(time=TIME, motion={"arm": PiecewiseLinear(points=[(1.0, 0.0), (2.0, 0.4)])}),
    ],
)
def test_positions_do_not_jump_and_have_no_corners(arm, refused):
    with pytest.raises(InputError, match=r"jumps at (1 s|the points, the first at 1 s)"):
        refused.solve(arm, Accuracy(), place)


@pytest.fixture
def stop_at(monkeypatch):
    """Let the user press Ctrl-C once the integration asks for a torque later than an instant."""

    def arrange(instant):
        original = EffortAlong.add_load

        def add_load(element, t, q, v, tau):
            if np.size(t) == 1 and np.max(t) > instant:
                raise KeyboardInterrupt
            original(element, t, q, v, tau)

        monkeypatch.setattr(EffortAlong, "add_load", add_load)

    return arrange


SWING = Harmonic(amplitude=0.5, pulsation=2.0)


@pytest.mark.parametrize(
    ("law", "motion"), [(Harmonic(amplitude=1.0, pulsation=3.0), {}), (LAWS["trapezoid"], {"second": SWING})],
    ids=["free", "driven"],
)  # fmt: skip
@pytest.mark.parametrize("cause", ["Ctrl-C", "max_steps"])
def test_what_a_run_that_ends_early_keeps_is_the_run_until_there(
    mechanism, chain, stop_at, law, motion, cause, monkeypatch
):
    if cause == "Ctrl-C":  # compiled steps ask for no torques
        monkeypatch.setattr(kernel_tree, "library", lambda: None)
    pair = mechanism(chain({"name": "first", "com": "0.5 0 0"}, {"name": "second", "at": "1 0 0", "com": "0.3 0 0"}))
    loads = {"torque": JointEffort(joint="first", effort=law)}
    problem = Forward(time=TIME, motion=motion, loads=loads)
    outcome = problem.solve(pair, Accuracy(), place)
    whole = outcome.rows
    instant = 1.4 if motion else 2.5  # from 1.5 s on the trapezoid is 0, and not asked for
    if cause == "Ctrl-C":
        stop_at(instant)
        with pytest.raises((Interrupted, KeyboardInterrupt), match="interrupted at t = ") as caught:
            problem.solve(pair, Accuracy(), place)
    else:
        most = int(0.85 * (outcome.figures["steps"] + outcome.figures["rejected steps"]))
        with pytest.raises(IntegrationError, match=f"has taken {most} steps") as caught:
            problem.solve(pair, Accuracy(max_steps=most), place)
    kept = caught.value.partial.rows
    assert instant - 1.0 < kept.grid.t[-1] <= instant or cause == "max_steps"
    rows = slice(0, len(kept))
    assert len(kept) > 10
    assert np.array_equal(kept.grid.t, whole.grid.t[rows])
    for name in ("q", "v", "a", "tau"):
        assert np.array_equal(getattr(kept, name), getattr(whole, name)[rows]), name
