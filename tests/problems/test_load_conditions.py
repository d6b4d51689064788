"""Loads over coordinates that jump, act in one direction of motion or for a limited time: by their work and impulse."""

import json
from itertools import pairwise

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError

INERTIA = 0.5
WHEEL = {
    "pinarm": 1,
    "gravity": "none",
    "planar": {
        "points": {"O": ["0 m", "0 m"], "A": ["0.1 m", "0 m"]},
        "ground": ["O"],
        "links": {"wheel": {"points": ["O", "A"], "mass": "2 kg", "centre": "O", "inertia": f"{INERTIA} kg*m^2"}},
    },
}
CRANK, ROD = 0.1, 0.3
PRESS = {
    "pinarm": 1,
    "gravity": "none",
    "planar": {
        "points": {name: [f"{x} m", "0 m"] for name, x in {"O": 0, "A": CRANK, "B": CRANK + ROD, "X": 1}.items()},
        "ground": ["O", "X"],
        "links": {
            "crank": {"points": ["O", "A"], "mass": "2 kg", "centre": "O", "inertia": "5 kg*m^2"},
            "rod": {"points": ["A", "B"], "mass": "1 kg"},
            "ram": {"points": ["B"], "mass": "3 kg"},
        },
        "sliders": {"x": {"link": "ram", "along": ["O", "X"]}},
    },
    "coordinates": {"reach": {"kind": "distance", "between": ["O", "B"]}},
}  # fmt: skip


def run(mechanism, problem, outputs, **accuracy):
    time = {"end": "2 s", "samples": 101}
    accuracy = {"accuracy": accuracy} if accuracy else {}
    return pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": {"time": time, **problem}, "outputs": outputs,
                       **accuracy})  # fmt: skip


def points(*pairs, x="deg", y="N*m", **keys):
    given = [[f"{place} {x}", f"{value} {y}"] for place, value in pairs]
    return {"law": "piecewise_linear", "points": given, **keys}


DIAGRAM = (0, 0), (90, 40), (90, -10), (300, -10), (360, 5)
"""Turning moments of a turn, with a jump within it, and one from 5 N*m to 0 at its end."""
GAS = {"kind": "joint_effort", "joint": "O", "over": "O", "period": "360 deg", "effort": points(*DIAGRAM)}


def work(angle):
    """The integral of the diagram from 0 to angles, by trapezia between its corners."""
    turns, rest = np.divmod(angle, 2 * np.pi)
    total = np.zeros_like(rest)
    whole = 0.0
    for (first, low), (last, high) in pairwise((np.deg2rad(place), value) for place, value in DIAGRAM):
        width = np.clip(rest, first, last) - first
        total += low * width + (0.5 * (high - low) * width**2 / (last - first) if last > first else 0.0)
        whole += 0.5 * (low + high) * (last - first)
    return turns * whole + total


@pytest.mark.parametrize(
    ("accuracy", "error"), [({}, 2e-5), ({"method": "rk4", "step": "2 ms"}, 2e-3), ({"method": "stiff"}, 2e-5)]
)
def test_a_wheel_gains_the_work_of_its_turning_moment_diagram(accuracy, error):
    """Steps end at the jumps; those of one length go over the corner at 300 degrees."""
    problem = {"kind": "forward", "initial": {"position": {"O": "0.2 rad"}, "velocity": {"O": "20 rad/s"}}}
    result = run(
        WHEEL, {**problem, "loads": {"gas": GAS}}, ["O", "joint.O.velocity", "joint.O.acceleration"], **accuracy
    )
    angle, speed, rate = (result[name].values for name in ("O", "joint.O.velocity", "joint.O.acceleration"))
    gained = 0.5 * INERTIA * (speed**2 - 400.0)
    assert gained == pytest.approx(work(angle) - work(np.array([0.2])), abs=error)
    t, moment = result.trajectory.grid.t, INERTIA * rate
    twice = np.flatnonzero(np.diff(t) == 0.0)  # a row on either side of every jump
    sides = np.round(np.stack([moment[twice], moment[twice + 1]], axis=1), 6).tolist()
    assert sides[:4] == [[40.0, -10.0], [5.0, 0.0]] * 2


def test_a_saved_motion_has_the_loads_before_and_after_jumps(tmp_path):
    problem = {"kind": "forward", "initial": {"velocity": {"O": "20 rad/s"}}, "loads": {"gas": GAS}}
    result = run(WHEEL, problem, ["power.gas"])
    result.save(tmp_path / "result")
    read = pinarm.restore(tmp_path / "result")
    assert read["power.gas"].values == pytest.approx(result["power.gas"].values, rel=1e-12, abs=1e-9)


def test_prescribed_motions_have_rows_on_both_sides_of_a_jump():
    motion = {"O": {"law": "constant_speed", "speed": "1 rev/s"}}
    result = run(WHEEL, {"kind": "inverse", "motion": motion, "loads": {"gas": GAS}}, ["joint.O.effort", "power.gas"])
    effort = -result["joint.O.effort"].values
    assert effort[result.trajectory.grid.t == 0.25] == pytest.approx([40.0, -10.0], abs=1e-9)
    assert result.number("power.gas @ mean")[0] == pytest.approx(work(np.array([2 * np.pi]))[0], rel=1e-9)


def lever(angle):
    """How far the ram goes per angle of the crank: dx/dO."""
    rod = np.sqrt(ROD**2 - (CRANK * np.sin(angle)) ** 2)
    return -CRANK * np.sin(angle) * (1.0 + CRANK * np.cos(angle) / rod)


@pytest.mark.parametrize("samples", [2, 41])
def test_a_load_in_one_direction_acts_up_to_rest_in_a_prescribed_motion(samples, tmp_path):
    """The crank rests, turns from 60 to 420 deg, and rests: the ram goes down at both ends, 0.2 m in all."""
    motion = {"O": {"law": "polynomial", "from": "60 deg", "to": "420 deg", "begin": "0.5 s", "duration": "1 s"}}
    problem = {"kind": "inverse", "motion": motion, "drives": ["O"], "time": {"end": "2 s", "samples": samples}}
    loads = {"press": {**LOADS["effort"], "while": {"x": "decreasing"}}}
    result = run(PRESS, {**problem, "loads": loads}, ["joint.O.effort", "power.press"])
    effort, t = result["joint.O.effort"].values, result.trajectory.grid.t
    [begin, end] = (effort[t == instant] for instant in (0.5, 1.5))
    held = -800.0 * lever(np.pi / 3)
    assert (*begin, *end) == pytest.approx((0.0, held, held, 0.0), abs=1e-9)
    assert result.number("power.press @ integral")[0] == pytest.approx(-800.0 * 2.0 * CRANK, rel=1e-9)
    assert result.number("joint.O.effort @ max")[1] < 1e-6
    result.save(tmp_path / "result")
    read = pinarm.restore(tmp_path / "result")
    assert read["power.press"].values == pytest.approx(result["power.press"].values, rel=1e-12, abs=1e-9)


def test_a_prescribed_motion_has_rows_beside_jumps_over_a_joint_that_follows():
    over = {"over": "x", "effort": points((-0.1, 500), (-0.1, 0), x="m", y="N")}
    loads = {"press": {"kind": "joint_effort", "joint": "x", **over}}
    motion = {"O": {"law": "constant_speed", "speed": "1 rev/s"}}
    result = run(PRESS, {"kind": "inverse", "motion": motion, "drives": ["O"], "loads": loads}, ["joint.O.effort", "x"])
    twice = np.flatnonzero(np.diff(result.trajectory.grid.t) == 0.0)
    effort, angle = result["joint.O.effort"].values, result["joint.O.position"].values[twice]
    assert result["x"].values[twice] == pytest.approx([-0.1] * 4, abs=1e-9)
    jumps = [-500.0, 500.0] * 2 * lever(angle)
    assert effort[twice + 1] - effort[twice] == pytest.approx(jumps, abs=1e-6)


def downward(x):
    return np.minimum(np.diff(x), 0.0).sum()


LOADS = {
    "effort": {"kind": "joint_effort", "joint": "x", "effort": {"law": "constant", "value": "800 N"}},
    "coordinate": {"kind": "coordinate_effort", "coordinate": "reach", "effort": {"law": "constant", "value": "800 N"}},
    "wrench": {"kind": "wrench", "point": "B", "force": ["800 N", "0 N", "0 N"]},
}


@pytest.mark.parametrize("kind", LOADS)
def test_a_press_pushes_in_its_downward_stroke_alone(kind):
    """It takes 800 N over every stroke of twice the crank; the motion has a row at each dead point."""
    loads = {"press": {**LOADS[kind], "while": {"x": "decreasing"}}}
    problem = {"kind": "forward", "initial": {"velocity": {"O": "20 rad/s"}}, "loads": loads}
    result = run(PRESS, problem, ["x", "energy.total", "joint.O.position"])
    energy, x = result["energy.total"].values, result["x"].values
    assert (np.diff(np.sign(np.diff(x[np.diff(x, prepend=np.nan) != 0.0]))) != 0.0).sum() >= 8  # strokes
    assert energy - energy[0] == pytest.approx(
        np.array([800.0 * downward(x[: k + 1]) for k in range(len(x))]), abs=1e-4
    )

    motion = {"O": {"law": "constant_speed", "speed": "1 rev/s"}}
    result = run(PRESS, {"kind": "inverse", "motion": motion, "loads": loads, "drives": ["O"]}, ["power.press"])
    assert result.number("power.press @ mean")[0] == pytest.approx(-800.0 * 2.0 * CRANK, rel=1e-9)


def test_a_load_over_any_coordinate_jumps_where_that_passes_its_points():
    """500 N on the ram below 0.3 m from O, both ways: it gives back what it took."""
    over = {"over": "reach", "effort": points((0.3, 500), (0.3, 0), x="m", y="N")}
    loads = {"press": {"kind": "joint_effort", "joint": "x", **over}}
    problem = {"kind": "forward", "initial": {"velocity": {"O": "20 rad/s"}}, "loads": loads}
    result = run(PRESS, problem, ["x", "energy.total"])
    energy, x = result["energy.total"].values, result["x"].values
    assert energy - energy[0] == pytest.approx(500.0 * np.minimum(x + 0.1, 0.0), abs=1e-4)
    assert result.notes() == []


def test_a_load_beyond_the_points_of_its_spline_is_noted():
    spline = {"law": "spline", "points": [["0.25 m", "500 N"], ["0.3 m", "0 N"]]}
    loads = {"press": {"kind": "joint_effort", "joint": "x", "over": "reach", "effort": spline}}
    problem = {"kind": "forward", "initial": {"velocity": {"O": "20 rad/s"}}, "loads": loads}
    [note] = run(PRESS, problem, ["x"]).notes()
    assert "'press' leaves its points: its points go from 0.25 to 0.3 m, and it is used from 0.2" in note


def test_a_load_acts_from_one_instant_until_another():
    load = {"kind": "joint_effort", "joint": "O", "effort": {"law": "constant_speed", "speed": "4 N*m/s"}}
    loads = {"motor": {**load, "from": "0.5 s", "until": "1.5 s"}}
    result = run(WHEEL, {"kind": "forward", "loads": loads}, ["joint.O.velocity"])
    t = np.clip(result.trajectory.grid.t, 0.5, 1.5)
    assert result["joint.O.velocity"].values == pytest.approx(2.0 * (t**2 - 0.25) / INERTIA, abs=1e-10)


@pytest.mark.parametrize(("keys", "message"), [
    ({"from": "2 s", "until": "1 s"}, "1 s is not after 2 s"),
    ({"while": {"wheel": "increasing"}}, "no coordinate 'wheel'"),
    ({"over": "O", "period": "300 deg", "effort": points(*DIAGRAM)}, "a point at 6.28319, and repeats"),
    ({"over": "O", "effort": points((90, 1), (0, 2))}, "do not ascend"),
])  # fmt: skip
def test_mistakes_in_conditions_are_told(keys, message):
    load = {"kind": "joint_effort", "joint": "O", "effort": {"law": "constant", "value": "1 N*m"}, **keys}
    with pytest.raises(InputError, match=message):
        run(WHEEL, {"kind": "forward", "loads": {"motor": load}}, ["O"])


def test_at_rest_there_is_no_direction_of_motion():
    loads = {"press": {**LOADS["effort"], "while": {"x": "decreasing"}}}
    problem = {"kind": "statics", "hold": {"O": "1 rad"}, "loads": loads, "drives": ["O"]}
    with pytest.raises(InputError, match="'press' acts in one direction of motion, and at rest there is none"):
        pinarm.run({"pinarm": 1, "mechanism": PRESS, "problem": problem, "outputs": ["joint.O.effort"]})
    problem = {**problem, "kind": "state", "velocity": {"O": "1 rad/s"}}
    result = pinarm.run(
        {"pinarm": 1, "mechanism": PRESS, "problem": problem, "outputs": ["power.press", "joint.x.velocity"]}
    )
    assert result["power.press"].values == pytest.approx(800.0 * result["joint.x.velocity"].values)


def test_tables_of_loads_may_be_straight_between_their_rows(tmp_path):
    """Two rows at one place are a jump; a motion does not follow such lines."""
    (tmp_path / "moments.csv").write_text("angle [deg],moment [N*m]\n" + "".join(f"{x},{y}\n" for x, y in DIAGRAM))
    (tmp_path / "mechanism.yaml").write_text(json.dumps(WHEEL))
    table = {"law": "table", "file": "moments.csv", "interpolation": "linear"}
    over = {"O": {"from": "10 deg", "to": "370 deg", "samples": 7}}
    problem = {"kind": "statics", "over": over, "loads": {"gas": {**GAS, "effort": table}}}
    scenario = {"pinarm": 1, "mechanism": "mechanism.yaml", "problem": problem, "outputs": ["joint.O.effort"]}
    (tmp_path / "scenario.yaml").write_text(json.dumps(scenario))
    effort = -pinarm.run(tmp_path / "scenario.yaml")["joint.O.effort"].values
    assert effort == pytest.approx([40 / 9, 280 / 9, -10, -10, -10, -7.5, 40 / 9])
    with pytest.raises(InputError, match="the first column does not increase"):
        pinarm.run(tmp_path / "scenario.yaml", {"problem.loads.gas.effort.interpolation": "spline"})
