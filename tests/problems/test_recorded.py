"""Recorded motions: rows of solved motions, of closed forms, and of rows that are wrong by a known amount."""

import pickle
from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.cli.main import main
from pinarm.errors import PinarmError
from pinarm.use.show.text import report
from pinarm.use.study.restore import restore

ROOT = Path(pinarm.__file__).parents[1]


@pytest.fixture(scope="module")
def arm():
    return pinarm.Mechanism.load(ROOT / "models" / "gen411_arm" / "mechanism.yaml")


def motion(t):
    """O moves as 0.8 sin(2t), B as 0.5 cos(3t): q, v, a."""
    s, c = np.sin(2 * t), np.cos(2 * t)
    s3, c3 = np.sin(3 * t), np.cos(3 * t)
    return (np.stack(x, axis=1) for x in ((0.8 * s, 0.5 * c3), (1.6 * c, -1.5 * s3), (-3.2 * s, -4.5 * c3)))


def torque(t):
    """Moment about B of rod and load, by hand."""
    (theta, b), (rate, _), (growth, bend) = (x.T for x in motion(t))
    phi = theta + b
    static = 9.81 * 0.25 * np.cos(phi) * 0.6
    return static + 0.0625 * ((0.1 + 1 / 3) * (growth + bend) + 0.6 * (growth * np.cos(b) + rate**2 * np.sin(b)))


def test_everything_given_is_as_of_separate_states(arm):
    t = np.linspace(0, 2, 201)
    q, v, a = motion(t)
    result = arm.result(t, q, v, a, outputs=["C_B"])
    assert result["C_B"].values == pytest.approx(torque(t), abs=1e-14)
    states = arm.at(q, v, a)
    for name in ("joint.O.force.x", "energy.total", "point.A.acceleration.y", "momentum.all.linear.x"):
        assert result[name].values == pytest.approx(states[name].values, rel=1e-12, abs=1e-12)
    assert result.figures["equilibrium"] < 1e-14


def test_consistency_falls_with_the_rules_orders_and_tells_wrong_rates(arm):
    """h^4 for positions and h^2 for velocities, until an error of one percent of the rates is seen as such."""
    coarse, fine = (pinarm.result(arm, t, *motion(t)).figures for t in (np.linspace(0, 2, 51), np.linspace(0, 2, 101)))
    assert coarse["velocity consistency"] / fine["velocity consistency"] == pytest.approx(16, rel=0.1)
    assert coarse["acceleration consistency"] / fine["acceleration consistency"] == pytest.approx(4, rel=0.1)
    t = np.linspace(0, 2, 401)
    q, v, a = motion(t)
    wrong = pinarm.result(arm, t, q, 1.01 * v, a).figures
    assert wrong["velocity consistency"] == pytest.approx(0.01, rel=0.02)
    assert wrong["acceleration consistency"] == pytest.approx(0.01, rel=0.02)


def test_what_is_not_given_is_refused_and_the_rest_is_told(arm):
    t = np.linspace(0, 2, 21)
    q, v, _ = motion(t)
    positions, rates = pinarm.result(arm, t, q), pinarm.result(arm, t, q, v)
    assert positions["A_x"].values == pytest.approx(0.25 * np.cos(q[:, 0]) + 0.25 * np.cos(q.sum(axis=1)), abs=1e-15)
    assert positions["energy.potential"].values == pytest.approx(arm.at(q)["energy.potential"].values)
    for name in (
        "joint.O.velocity",
        "energy.kinetic",
        "point.A.velocity.x",
        "2*joint.O.velocity",
        "momentum.O.linear.x",
    ):
        with pytest.raises(PinarmError, match="the velocities of this motion are not given"):
            positions[name]
    assert rates["energy.kinetic"].values == pytest.approx(arm.at(q, v)["energy.kinetic"].values)
    for name in ("joint.O.acceleration", "joint.O.effort", "joint.B.force.x"):
        with pytest.raises(PinarmError, match="the accelerations of this motion are not given"):
            rates[name]
    with pytest.raises(PinarmError, match=r"taken over a motion, and these rows stand alone"):
        positions.number("A_x @ mean")
    assert set(positions.figures) == set()


def test_a_spline_gives_derivatives_within_what_it_tells(arm):
    """Its figures are changes without every second row: 16 times and more what is left with all of them."""
    t = np.linspace(0, 2, 101)
    q, v, a = motion(t)
    result = pinarm.result(arm, t, q, derivatives="spline", numbers=["C_B @ rms"])
    run = result.trajectory
    errors = np.abs(run.v - v).max() / np.abs(v).max(), np.abs(run.a - a).max() / np.abs(a).max()
    for error, name in zip(errors, ("spline velocity", "spline acceleration"), strict=True):
        assert 1e-12 < error < result.figures[name] < 1e-3
    assert result["C_B"].values == pytest.approx(torque(t), abs=2 * result.figures["spline acceleration"])
    instants = np.linspace(0, 2, 20001)
    rms = np.sqrt(np.mean(torque(instants) ** 2))
    assert result.number("C_B @ rms")[0] == pytest.approx(rms, rel=1e-4)  # of the mean of samples: 1 / 20000
    assert result.number("C_B @ t=0.123 s")[0] == pytest.approx(torque(np.array([0.123]))[0], abs=1e-5)


def test_ball_joints_have_the_spline_of_their_quaternions():
    """A tumbling body, solved: position, quaternion with both signs, and the solver's own v and a."""
    solved = pinarm.load(ROOT / "scenarios" / "brick_thrown.yaml", {"problem.time.samples": 4001}).run().trajectory
    part = slice(0, 400)
    t, q, v, a = (x[part] for x in (solved.grid.t, solved.q, solved.v, solved.a))
    ball = next(iter(solved.mechanism.balls.values()))
    turned = q.copy()
    ball.quaternion(turned)[::3] *= -1
    result = pinarm.result(solved.mechanism, t, turned, derivatives="spline")
    speed, growth = np.abs(v).max(), np.abs(a).max()
    assert np.abs(result.trajectory.v - v).max() < max(result.figures["spline velocity"], 1e-7) * speed
    assert np.abs(result.trajectory.a - a).max() < max(result.figures["spline acceleration"], 1e-6) * growth
    given = pinarm.result(solved.mechanism, t, q, v, a)
    assert given.figures["velocity consistency"] < 1e-3
    assert given["energy.total"].values == pytest.approx(
        np.full(len(t), float(given["energy.total"].values[0])), rel=1e-6
    )


def test_efforts_that_are_given_are_compared_with_the_equation_of_motion(arm):
    t = np.linspace(0, 2, 101)
    q, v, a = motion(t)
    tau = arm.inverse(q, v, a)
    right, wrong = (pinarm.result(arm, t, q, v, a, each) for each in (tau, 1.02 * tau))
    assert right.figures["equilibrium"] < 1e-14
    assert wrong["joint.O.effort"].values == pytest.approx(1.02 * tau[:, 0])
    assert 0.002 < wrong.figures["equilibrium"] < 0.02  # two percent of one of several terms


def test_open_loops_are_told_and_drives_carry_the_load():
    solved = pinarm.load(ROOT / "scenarios" / "crank_rocker_turning.yaml").run()
    run, mechanism = solved.trajectory, solved.trajectory.mechanism
    drive = run.drives[0]
    again = pinarm.result(mechanism, run.grid.t, run.q, run.v, run.a, drives=[drive])
    given = pinarm.result(mechanism, run.grid.t, run.q, run.v, run.a, run.tau)
    assert again[f"joint.{drive}.effort"].values == pytest.approx(solved[f"joint.{drive}.effort"].values, abs=1e-9)
    loop = mechanism.constraints[0].name
    for each in (again, given):
        assert each[f"loop.{loop}.force.x"].values == pytest.approx(solved[f"loop.{loop}.force.x"].values, abs=1e-9)
    q = run.q.copy()
    q[:, 0] += 1e-3
    torn = pinarm.result(mechanism, run.grid.t, q)
    gaps = [np.abs(mechanism.closure.gap(mechanism.closure.state(each))).max() for each in q]
    assert torn.figures["closure"] == pytest.approx(max(gaps[:: max(1, len(q) // 64)]), rel=0.2)
    assert torn.figures["closure"] > 1e-5
    assert "closure rate" not in torn.figures
    with pytest.raises(PinarmError, match="neither efforts nor drives are given"):
        pinarm.result(mechanism, run.grid.t, run.q, run.v, run.a)[f"joint.{drive}.effort"]


def test_friction_that_sticks_follows_from_the_motion_but_not_from_efforts():
    solved = pinarm.load(ROOT / "scenarios" / "screw_jack_lifting.yaml").run()
    run = solved.trajectory
    again = pinarm.result(run.mechanism, run.grid.t, run.q, run.v, run.a, drives=list(run.drives),
                          loads=solved.data["problem"]["loads"])  # fmt: skip
    contact = run.mechanism.frictions[0].quantity
    moving = slice(5, 40)
    assert again[contact].values[moving] == pytest.approx(solved[contact].values[moving], rel=1e-9)
    with pytest.raises(PinarmError, match="turn has friction of its own"):
        pinarm.result(run.mechanism, run.grid.t, run.q, run.v, run.a, run.tau)


@pytest.mark.parametrize(("derivatives", "efforts"), [("given", False), ("spline", True)])
def test_a_result_comes_back_from_its_folder_and_runs_again(arm, tmp_path, derivatives, efforts):
    t = np.linspace(0, 2, 51)
    q, v, a = motion(t)
    tau = arm.inverse(q, v, a) if efforts else None
    given = (q, v, a, tau) if derivatives == "given" else (q, None, None, tau)
    result = pinarm.result(arm, t, *given, derivatives=derivatives, outputs=["C_B", "A_x"], title="Measured")
    folder = result.save(tmp_path / "out")
    again, anew = restore(folder), pinarm.run(folder / "scenario.yaml")
    assert report(again) == report(result)
    assert np.array_equal(again["C_B"].values, result["C_B"].values)
    assert anew["C_B"].values == pytest.approx(result["C_B"].values, abs=1e-15)
    assert main(["replay", str(folder)]) == 0
    pickled = pickle.loads(pickle.dumps(result))
    assert np.array_equal(pickled["C_B"].values, result["C_B"].values)


@pytest.mark.parametrize(("columns", "message"), [
    ({"O [rad]": [0, 1], "B [rad]": [0, 1]}, "there is no column 't'"),
    ({"t [s]": [0, 1], "O [rad]": [0, 1]}, "the columns joint.B.position are missing"),
    ({"t [s]": [0, 1], "O [rad]": [0, 1], "B [rad]": [0]}, "has 1 rows, 't' has 2"),
    ({"t [s]": [0, 1], "O [rad]": [0, 1], "B [m]": [0, 1]}, "the column 'joint.B.position' is in m"),
    ({"t [s]": [1, 0], "O [rad]": [0, 1], "B [rad]": "0 1"}, "the instants descend: 1 s, then 0 s"),
    ({"t [s]": [0, 5e-324], "O [rad]": [0, 1], "B [rad]": "0 1"}, r"0 s and 4.94065646e-324 s \(row 1\) are too close"),
    ({"t [s]": [0, 1], "O [rad]": [0, 1], "B [rad]": "0 nan"}, "q is not finite in row 1"),
    ({"t [s]": [0, 1], "O [rad]": "0 1", "joint.O.position [rad]": "0 1", "B [rad]": "0 1"}, "two columns are"),
    ({}, "there is no motion"),
])  # fmt: skip
def test_wrong_columns_are_refused(columns, message):
    path = ROOT / "scenarios" / "gen411_arm_recorded.yaml"
    data = {"pinarm": 1, "mechanism": str(ROOT / "models/gen411_arm/mechanism.yaml"), "outputs": ["A_x"],
            "problem": {"kind": "recorded", "columns": columns}}  # fmt: skip
    assert path.is_file()
    with pytest.raises(PinarmError, match=message):
        pinarm.Scenario.of_data({**data, "mechanism": pinarm.Mechanism.load(data["mechanism"])}).run()


@pytest.fixture
def scenario_beside(tmp_path):
    """A folder with the arm, and a scenario of the rows in ``rows.csv``."""
    (tmp_path / ".pinarm-root").touch()
    for file in (ROOT / "models" / "gen411_arm").iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    text = "pinarm: 1\nmechanism: mechanism.yaml\noutputs: [O]\nproblem: {kind: recorded, file: rows.csv}\n"
    (tmp_path / "scenario.yaml").write_text(text)
    return tmp_path


def test_a_wrong_cell_of_a_file_is_told_with_its_line(scenario_beside):
    (scenario_beside / "rows.csv").write_text("t [s],O [deg],B [deg]\n0,1,2\n1,x,2\n")
    with pytest.raises(PinarmError, match=r"rows\.csv:3"):
        pinarm.run(scenario_beside / "scenario.yaml")


@pytest.mark.parametrize(("change", "message"), [
    (lambda t, q: (t, np.where(t[:, None] > 1, q - 2 * np.pi, q)), "jumps by .* rad from row"),
    (lambda t, q: (t[:8], q[:8]), "8 rows are too few"),
    (lambda t, q: (np.where(t == t[5], t[4], t), q), "the rows 4 and 5 have the same instant"),
])  # fmt: skip
def test_rows_without_a_spline_are_refused(arm, change, message):
    t = np.linspace(0, 2, 51)
    with pytest.raises(PinarmError, match=message):
        pinarm.result(arm, *change(t, next(motion(t))), derivatives="spline")
