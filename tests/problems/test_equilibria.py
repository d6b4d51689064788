"""Equilibria and their stability against closed forms; starts that lead nowhere and input that is refused."""

import math
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import pinarm
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.linear.force_balance import Driven, ForceBalance
from pinarm.errors import AssemblyError, DynamicsError, InputError
from pinarm.mechanics.forces.along_coordinate import JointEffort, JointSpring
from pinarm.mechanics.forces.points import PointSpring, Wrench
from pinarm.mechanics.laws import Constant
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.equilibria import Equilibria
from pinarm.use.mechanism import Mechanism

ROOT = Path(pinarm.__file__).parents[1]
G = 9.81
MASS, LENGTH = 0.7, 0.83
BOB = {"name": "bob", "axis": "0 1 0", "mass": MASS, "com": f"0 0 {-LENGTH}", "inertia": (0.0, 0.0, 0.0)}
UPRIGHT = {**BOB, "com": f"0 0 {LENGTH}"}


def place(*path):
    return nullcontext()


def outcome(mechanism, starts, **given):
    return Equilibria(starts=starts, **given).solve(mechanism, Accuracy(), place)


def solve(mechanism, starts, **given):
    return outcome(mechanism, starts, **given).rows


def column(run, name, row):
    return float(run.columns[f"equilibrium.{name}"].values[row - 1])


def squares(run, row):
    """Return w^2 of a row, in ascending order."""
    return np.array([column(run, f"frequency2_{k}", row) for k in range(1, run.mechanism.model.nv + 1)
                     if f"equilibrium.frequency2_{k}" in run.columns])  # fmt: skip


def stability(run, row):
    return column(run, "stability", row)


def balance_of(mechanism, loads):
    forces = {name: load.bind(mechanism.model, mechanism.joints) for name, load in loads.items()}
    return ForceBalance(mechanism, Dynamics.of(mechanism.model, forces).on(0.0, 1.0), Driven.of(mechanism, {}, {}))


@pytest.fixture
def arm():
    return Mechanism.load(ROOT / "models" / "gen411_arm" / "mechanism.yaml")


# --- pendulums


def test_a_pendulum_hangs_stably_and_stands_unstably(mechanism, chain):
    found = outcome(mechanism(chain(BOB)), [{"bob": 0.4}, {"bob": 2.9}])
    run = found.rows
    assert run.q[:, 0] == pytest.approx([0.0, math.pi], abs=1e-15)
    assert squares(run, 1) == pytest.approx([G / LENGTH], rel=1e-14)
    assert squares(run, 2) == pytest.approx([-G / LENGTH], rel=1e-14)
    assert (stability(run, 1), stability(run, 2), found.figures["stable"]) == (1.0, -1.0, 1.0)
    assert run.parameter == "row"
    assert run.grid.t.tolist() == [1.0, 2.0]
    assert not run.tau.any()


def quadratic(mass, stiffness):
    """Solve ``det(K - w^2 M) = 0`` of two coordinates by the formula of a quadratic equation."""
    a = np.linalg.det(mass)
    b = -(mass[0, 0] * stiffness[1, 1] + mass[1, 1] * stiffness[0, 0] - 2 * mass[0, 1] * stiffness[0, 1])
    root = math.sqrt(b * b - 4 * a * np.linalg.det(stiffness))
    return sorted(((-b - root) / (2 * a), (-b + root) / (2 * a)))


def test_the_four_equilibria_of_a_double_pendulum(mechanism, chain):
    """Bars with their own inertia; absolute angles p1, p2 from the downward vertical: M and K by Lagrange."""
    m1, m2, c1, c2, length, i1, i2 = 1.3, 0.6, 0.35, 0.5, 0.8, 0.11, 0.07
    bars = chain(
        {"name": "a", "axis": "0 1 0", "mass": m1, "com": f"0 0 {-c1}", "inertia": (1.0, i1, 1.0)},
        {"name": "b", "axis": "0 1 0", "mass": m2, "com": f"0 0 {-c2}", "inertia": (1.0, i2, 1.0),
         "at": f"0 0 {-length}"},
    )  # fmt: skip
    starts = [{"a": 0.2, "b": -0.3}, {"a": -0.1, "b": 3.0}, {"a": 3.1, "b": 3.0}, {"a": 3.3, "b": 0.2}]
    run = solve(mechanism(bars), starts)
    up = [(1, 1), (1, -1), (-1, 1), (-1, -1)]  # cosines of p1 and p2
    assert len(run) == 4
    for row, (s1, s2) in enumerate(up, 1):
        p1, p2 = run.q[row - 1, 0], run.q[row - 1].sum()
        assert [math.cos(p1), math.cos(p2)] == pytest.approx([s1, s2], abs=1e-15)
        assert [math.sin(p1), math.sin(p2)] == pytest.approx([0.0, 0.0], abs=1e-14)
        cross = m2 * length * c2 * s1 * s2
        mass = np.array([[i1 + m1 * c1**2 + m2 * length**2, cross], [cross, i2 + m2 * c2**2]])
        stiffness = np.diag([G * (m1 * c1 + m2 * length) * s1, G * m2 * c2 * s2])
        assert squares(run, row) == pytest.approx(quadratic(mass, stiffness), rel=1e-12)
        assert stability(run, row) == (1 if s1 == s2 == 1 else -1)


# --- springs


@pytest.mark.parametrize("ratio", [0.3, 1.0 - 1e-6, 1.0 + 1e-6])
def test_a_spring_holds_a_pendulum_upright_if_it_is_stiffer_than_its_weight(mechanism, chain, ratio):
    stiffness = ratio * MASS * G * LENGTH
    spring = {"hold": JointSpring(joint="bob", stiffness=stiffness)}
    run = solve(mechanism(chain(UPRIGHT)), [{}], loads=spring)
    assert run.q[0, 0] == 0.0
    assert squares(run, 1) == pytest.approx([(stiffness - MASS * G * LENGTH) / (MASS * LENGTH**2)], rel=1e-9)
    assert stability(run, 1) == (1.0 if ratio > 1.0 else -1.0)


@pytest.mark.parametrize("ratio", [0.3, 0.999])
def test_beside_the_unstable_position_there_are_two_stable_ones(mechanism, chain, ratio):
    """The pitchfork: ``sin q / q = k / (m g L)``, by bisection, and ``w^2 = (k - m g L cos q) / (m L^2)``."""
    weight = MASS * G * LENGTH
    spring = {"hold": JointSpring(joint="bob", stiffness=ratio * weight)}
    low, high = 1e-9, math.pi
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if math.sin(middle) / middle > ratio else (low, middle)
    found = outcome(
        mechanism(chain(UPRIGHT)), [{"bob": 1.3 * low}, {"bob": -1.3 * low}, {"bob": 0.9 * low}], loads=spring
    )
    run = found.rows
    assert run.q[:, 0] == pytest.approx([low, -low], rel=1e-11)
    assert column(run, "starts", 1) == 2.0
    expected = (ratio - math.cos(low)) * weight / (MASS * LENGTH**2)
    assert squares(run, 1) == pytest.approx([expected], rel=1e-9)
    assert found.figures["stable"] == 2.0


def test_at_the_fork_itself_the_upright_position_is_indifferent(mechanism, chain):
    spring = {"hold": JointSpring(joint="bob", stiffness=MASS * G * LENGTH)}
    found = outcome(mechanism(chain(UPRIGHT)), [{}, {"bob": 0.3}, {"bob": -0.2}], loads=spring)
    run = found.rows
    assert len(run) == 1
    assert stability(run, 1) == 0.0
    assert found.figures["stable"] == 0.0


ANCHOR = '<link name="anchor"/><joint name="wall" type="fixed"><parent link="base"/><child link="anchor"/>'


def truss(mechanism, chain, beside):
    """A slider along x, and a point ``beside`` its line from which a spring reaches it."""
    xml = chain({"name": "x", "kind": "prismatic", "axis": "1 0 0", "mass": 1.7})
    return mechanism(xml.replace("</robot>", f'{ANCHOR}<origin xyz="0 0 {beside}"/></joint></robot>'), gravity="none")


@pytest.mark.parametrize("size", [1.0, 1e-2, 1e-5])
def test_a_spring_across_a_slide_snaps_through(mechanism, chain, size):
    """Free length L > distance a: ``x = +-sqrt(L^2 - a^2)`` with ``k x^2 / L^2``, and 0 with ``-k (L/a - 1)``."""
    k, a, free = 450.0, 0.3 * size, 0.5 * size
    spring = PointSpring(between=("anchor", "x_link"), stiffness=k, free_length=free)
    run = solve(truss(mechanism, chain, a), [{"x": 0.35 * size}, {"x": 1e-4 * size}, {"x": -0.35 * size}],
                loads={"s": spring})  # fmt: skip
    assert run.q[:, 0] == pytest.approx([0.4 * size, 0.0, -0.4 * size], abs=1e-14 * size)
    assert squares(run, 1) == pytest.approx([k * 0.64 / 1.7], rel=1e-12)
    assert squares(run, 2) == pytest.approx([-k * (free / a - 1.0) / 1.7], rel=1e-12)
    assert [stability(run, row) for row in (1, 2, 3)] == [1.0, -1.0, 1.0]


def test_the_stiffness_is_the_second_derivative_of_the_potential_energy(mechanism, chain, differentiate):
    bodies = [{"name": n, "axis": axis, "com": "0.1 0.2 -0.4", "at": "0.1 0.1 -0.3"}
              for n, axis in (("a", "0 1 0"), ("b", "1 0 0"), ("c", "0 0.6 0.8"))]  # fmt: skip
    model = mechanism(chain(*bodies).replace("</robot>", f'{ANCHOR}<origin xyz="0.7 0.2 0.5"/></joint></robot>'))
    line = PointSpring(between=("anchor", "c_link"), stiffness=30.0, free_length=0.4, force=2.0)
    coil = JointSpring(joint="b", stiffness=8.0, rest=0.3)
    balance = balance_of(model, {"line": line, "coil": coil})
    q, still = np.array([0.4, -0.9, 0.7]), np.zeros((1, 3))
    stiffness = balance.slopes(q, balance.at(q)).force_q
    for i in range(3):
        row = differentiate(lambda t, i=i: -balance.at(q + t * np.eye(3)[i]).demand, 0.0)
        assert stiffness[:, i] == pytest.approx(-row, abs=1e-9)
        energy = differentiate(lambda t, i=i: balance.dynamics.energy(q[None] + t * np.eye(3)[i], still)[1], 0.0)
        assert -balance.at(q).demand[i] == pytest.approx(-energy[0], abs=1e-9)
    assert stiffness == pytest.approx(stiffness.T, abs=1e-11)


# --- what is held, what has no mass, what has no potential


def test_a_held_absolute_angle_leaves_a_pendulum_and_tells_the_torque_that_holds_it(arm):
    """With phi held BA only moves along a circle: all mass at B, ``w^2 = g / l1``; the motor at B carries BA."""
    phi = 0.4
    run = solve(arm, [{"O": -1.2}, {"O": 1.4}], hold={"phi": phi})
    assert run.q[:, 0] == pytest.approx([-math.pi / 2, math.pi / 2], abs=1e-14)
    assert run.q.sum(axis=1) == pytest.approx(phi, abs=1e-15)
    assert squares(run, 1) == pytest.approx([G / 0.25], rel=1e-13)
    assert squares(run, 2) == pytest.approx([-G / 0.25], rel=1e-13)
    assert run.tau[0] == pytest.approx(G * 0.25 * math.cos(phi) * (0.1 + 0.5) * np.ones(2), rel=1e-13)


def test_a_held_height_leaves_the_ways_along_which_it_does_not_change(arm):
    """The arm balances on the horizontal line through A where its weights do not move: dU/dtheta / dh/dtheta agree."""
    run = solve(arm, [{"O": 0.3, "B": 0.6}], hold={"A_height": 0.75})
    theta, phi = run.q[0, 0], run.q[0].sum()
    m_a, m_ba, m_b, length = 0.1, 1.0, 0.5, 0.25
    by_theta, by_phi = (m_a + m_ba + m_b) * length * math.cos(theta), (m_a + m_ba / 2) * length * math.cos(phi)
    assert 0.5 + length * (math.sin(theta) + math.sin(phi)) == pytest.approx(0.75, abs=1e-12)
    assert by_theta * math.cos(phi) == pytest.approx(by_phi * math.cos(theta), abs=1e-10)


def test_a_parallelogram_of_rods_swings_like_a_pendulum():
    """((N+1)/3 + N) theta'' = ((N+1)/2 + N) g sin theta for rods of 1 m and 1 kg, theta from upright, N = 1."""
    bars = Mechanism.load(ROOT / "models" / "four_bar" / "mechanism.yaml")
    upright, hanging = ({"upright_0": x, "coupler_0": -x, "upright_1": x} for x in (0.1, 3.0))
    run = solve(bars, [upright, hanging])
    square = 2.0 * G / (5.0 / 3.0)
    assert run.q[:, bars.joints["upright_0"].q] == pytest.approx([0.0, math.pi], abs=1e-10)
    assert [column(run, "frequency2_1", row) for row in (1, 2)] == pytest.approx([-square, square], rel=1e-9)
    assert [column(run, "stability", row) for row in (1, 2)] == [-1, 1]


def test_the_counterweight_balances_the_empty_manipulator_anywhere():
    arm = Mechanism.load(ROOT / "models" / "manipulator" / "mechanism.yaml", {"m": "0 kg"})
    start = {"alpha": 0.4, "B": -0.4, "E": 0.4, "x": -0.75 * math.cos(0.4), "y": 2.0 - 0.75 * math.sin(0.4)}
    run = solve(arm, [start])
    assert run.q[0, arm.joints["alpha"].q] == pytest.approx(0.4, abs=1e-9)
    assert column(run, "stability", 1) == 0


TIP = {"axis": "0 1 0", "inertia": (0.0, 0.0, 0.0)}


def test_without_mass_in_a_direction_the_stiffness_decides_and_a_note_says_so(mechanism, chain):
    """One point mass at the end of two bars: stretched, it cannot move along them, and M is singular."""
    l1, l2 = 0.5, 0.3
    bars = chain({**TIP, "name": "a", "mass": 0.0},
                 {**TIP, "name": "b", "mass": MASS, "at": f"0 0 {-l1}", "com": f"0 0 {-l2}"})  # fmt: skip
    found = outcome(mechanism(bars), [{"a": 0.1, "b": -0.2}, {"a": 3.0, "b": 0.1}])
    run = found.rows
    weight = MASS * G
    middle, apart = 0.5 * (l1 + 2 * l2), 0.5 * math.hypot(l1, 2 * l2)  # of K = m g [[l1 + l2, l2], [l2, l2]]
    springs = [column(run, "stiffness_1", 1), column(run, "stiffness_2", 1)]
    assert springs == pytest.approx([weight * (middle - apart), weight * (middle + apart)], rel=1e-12)
    assert np.isnan(squares(run, 1)).all()
    assert [stability(run, 1), stability(run, 2)] == [1.0, -1.0]
    assert any("row 1" in note and "no mass" in note for note in found.notes)


def test_without_weight_every_position_is_indifferent_and_stays_where_it_starts(mechanism, chain):
    run = solve(mechanism(chain(BOB), gravity="none"), [{"bob": 0.4}, {"bob": 1.1}])
    assert run.q[:, 0].tolist() == [0.4, 1.1]
    assert [stability(run, 1), stability(run, 2)] == [0.0, 0.0]


@pytest.mark.parametrize(("load", "stable"), [(2.08, 1.0), (2.09, -1.0)])
def test_a_column_under_a_force_that_follows_it_flutters_beyond_its_critical_load(mechanism, chain, load, stable):
    """Ziegler's column, masses 2m and m: ``P = (7/2 - sqrt(2)) k / L = 2.0858 k / L``; K is not symmetric."""
    length, k = 0.4, 5.0
    column = chain({**TIP, "name": "a", "mass": 2.0, "com": f"0 0 {length}"},
                   {**TIP, "name": "b", "mass": 1.0, "at": f"0 0 {length}", "com": f"0 0 {length}"})  # fmt: skip
    loads = {
        "a": JointSpring(joint="a", stiffness=k),
        "b": JointSpring(joint="b", stiffness=k),
        "push": Wrench(point="b_link", axes="b_link", force=(0.0, 0.0, -load * k / length)),
    }
    run = solve(mechanism(column, gravity="none"), [{}], loads=loads)
    assert stability(run, 1) == stable


def test_a_constant_torque_leans_a_pendulum(mechanism, chain):
    torque = 0.6 * MASS * G * LENGTH
    push = {"t": JointEffort(joint="bob", effort=Constant(value=torque))}
    run = solve(mechanism(chain(BOB)), [{"bob": 0.3}, {"bob": 2.2}], loads=push)
    lean = math.asin(0.6)  # a positive turn about y swings the bob to -x
    assert np.sort(run.q[:, 0]) == pytest.approx([lean, math.pi - lean], abs=1e-14)
    assert squares(run, 1) == pytest.approx([0.8 * G / LENGTH], rel=1e-12)


@pytest.mark.parametrize(("softer", "start"), [(0.0, 0.3), (1e-10, 0.01), (-1e-10, 0.3)])
def test_a_pendulum_that_its_spring_all_but_holds_upright_is_as_far_off_as_is_told(mechanism, chain, softer, start):
    """``k q = m g l sin(q)`` with ``k = m g l (1 - s)``: 0 and, for s > 0, ``q^2 = 6 s`` but for terms in s^2."""
    spring = JointSpring(joint="bob", stiffness=MASS * G * LENGTH * (1.0 - softer))
    found = outcome(mechanism(chain(UPRIGHT)), [{"bob": start}], loads={"s": spring})
    (note,) = found.notes
    assert note.startswith("row 1: a stiffness is 0 but for rounding: ")
    assert abs(found.rows.q[0, 0] - math.sqrt(max(6.0 * softer, 0.0))) < 1e-3


# --- what goes wrong


def test_a_start_that_leads_nowhere_leaves_the_equilibria_that_others_lead_to(mechanism, chain):
    """A spring across a slide that is pushed: on the far side the force has a smallest value, but no zero."""
    k, beside, free = 100.0, 2.0, 2.4
    spring = PointSpring(between=("anchor", "x_link"), stiffness=k, free_length=free)
    push = JointEffort(joint="x", effort=Constant(value=12.0))
    model = truss(mechanism, chain, beside)
    balanced = brentq(lambda x: k * x * (1.0 - free / math.hypot(x, beside)) - 12.0, 1.3, 3.0, xtol=1e-15)
    flat = -math.sqrt((free * beside**2) ** (2 / 3) - beside**2)  # where the slope of the force vanishes
    found = outcome(model, [{"x": -2.0}, {"x": 1.6}], loads={"s": spring, "p": push})
    assert found.rows.q[:, 0] == pytest.approx([balanced], rel=1e-12)
    (note,) = [note for note in found.notes if note.startswith("starts[0] leads to no equilibrium: a force of")]
    assert float(note.split("x = ")[1].split()[0]) == pytest.approx(flat, abs=1e-2)
    with pytest.raises(AssemblyError, match=r"starts\[0\]") as caught:
        outcome(model, [{"x": -2.0}], loads={"s": spring, "p": push})
    assert caught.value.data["q"] == pytest.approx([flat], abs=1e-2)


REFUSED = {
    "unknown hold": ({"starts": [{}], "hold": {"psi": 0.1}}, "no coordinate 'psi'"),
    "start held": ({"starts": [{"O": 0.1}], "hold": {"O": 0.1}}, "'O' is held"),
    "all held": ({"starts": [{}], "hold": {"O": 0.1, "B": 0.0}}, "nothing is left to balance"),
    "law": (
        {"starts": [{}], "loads": {"t": {"kind": "joint_effort", "joint": "O",
         "effort": {"law": "harmonic", "amplitude": 1.0, "pulsation": 2.0}}}},
        "no value at rest",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(arm, case):
    given, message = REFUSED[case]
    with pytest.raises(InputError, match=message):
        Equilibria(**given).prepare(arm, Accuracy(), place)


def test_joints_with_several_coordinates_are_refused(mechanism, chain):
    free = mechanism(chain({**BOB, "kind": "floating"}))
    with pytest.raises(InputError, match="joints with one coordinate only"):
        solve(free, [{}])


@pytest.mark.parametrize("start", ["50 mm", "10 mm"])
def test_where_a_cable_becomes_taut_no_stiffness_is_told(start):
    """To one side it has that of the cable, to the other none: half of it would be that of nothing."""
    slide = {
        "pinarm": 1, "gravity": "none",
        "planar": {
            "points": {"O": [0, 0], "P": ["100 mm", 0]}, "ground": ["O"],
            "links": {"carriage": {"points": ["P"], "mass": "2 kg"}},
            "sliders": {"x": {"link": "carriage", "along": ["O", "P"]}},
        },
    }  # fmt: skip
    cable = {"kind": "cable", "through": ["O", "P"], "stiffness": "1000 N/m", "free_length": "110 mm"}
    question = {
        "pinarm": 1, "mechanism": slide, "outputs": ["x"],
        "problem": {"kind": "equilibria", "starts": [{"x": start}], "loads": {"rope": cable}},
    }  # fmt: skip
    found = pinarm.run(question)
    assert np.isnan(found["equilibrium.stability"].values).all()
    assert any("'rope' has an edge here" in note for note in found.notes())
    with pytest.raises(DynamicsError, match="'rope' has an edge here"):
        pinarm.run({**question, "outputs": ["equilibrium.stability"]})


def test_a_band_ends_at_a_narrow_catch():
    """A lever on a dry pin, held by a soft spring, whose friction of 1 N m does not hold it in a catch 1 deg wide."""
    place = 17.0
    lever = {
        "pinarm": 1, "gravity": "none", "friction": {"O": {"constant": "1 N*m"}},
        "planar": {"points": {"O": [0, 0], "P": ["400 mm", 0]}, "ground": ["O"],
                   "links": {"lever": {"points": ["O", "P"], "mass": "2 kg"}}},
    }  # fmt: skip
    offsets = (-4.0, -3.0, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
    heights = (0.0, 0.0, 0.0, 0.0, 0.0, -1.0, -3.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    points = [["-90 deg", "0 N*m"], ["-40 deg", "0 N*m"], ["-10 deg", "0 N*m"], ["0 deg", "0 N*m"],
              *([f"{place + x} deg", f"{y} N*m"] for x, y in zip(offsets, heights, strict=True)),
              ["40 deg", "0 N*m"], ["90 deg", "0 N*m"]]  # fmt: skip
    loads = {
        "spring": {"kind": "joint_spring", "joint": "O", "stiffness": "2 N*m/rad"},
        "catch": {"kind": "joint_effort", "joint": "O", "over": "O", "effort": {"law": "spline", "points": points}},
    }
    found = pinarm.run({
        "pinarm": 1, "mechanism": lever, "outputs": ["O", "equilibrium.end_1.O", "equilibrium.end_2.O"],
        "problem": {"kind": "equilibria", "starts": [{"O": "0 deg"}], "loads": loads},
    })  # fmt: skip
    end = float(found["equilibrium.end_2.O"].values[0])
    assert np.radians(place - 1.0) < end < np.radians(place - 0.4)
