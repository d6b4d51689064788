"""Several stops on one motion, against closed forms, linear programs and enumerated complementarity problems."""

import itertools

import numpy as np
import pytest
from scipy.optimize import linprog

import pinarm
from pinarm.errors import DynamicsError, InputError

ANGLE, G = 0.8, 9.81
TORQUE = G * np.sin(ANGLE) * (0.5 * 1.0 + 0.5 * 1.0 + 3.0)
"""Torque of the weights about the uprights that lean by the angle: two uniform ones of 1 kg and 1 m, 3 kg on top."""


def parallelogram(stops, friction=None, restitution=0.0):
    """Uprights O and C under a coupler, thrown over to the stops of some of them."""
    mechanism = {
        "pinarm": 1, "title": "parallelogram",
        "planar": {
            "points": {"O": ["-0.5 m", "0 m"], "A": ["-0.5 m", "1 m"], "B": ["0.5 m", "1 m"], "C": ["0.5 m", "0 m"]},
            "ground": ["O", "C"],
            "links": {"left": {"points": ["O", "A"], "mass": "1 kg"}, "top": {"points": ["A", "B"], "mass": "3 kg"},
                      "right": {"points": ["B", "C"], "mass": "1 kg"}},
        },
    }  # fmt: skip
    if friction:
        mechanism["friction"] = friction
    problem = {
        "kind": "forward", "time": {"end": "1.2 s", "samples": 13}, "initial": {"velocity": {"O": "-1 rad/s"}},
        "end_stops": {stop: {"lower": f"-{ANGLE} rad", "restitution": restitution} for stop in stops},
    }  # fmt: skip
    outputs = ["joint.O.effort", "joint.C.effort", "joint.A.force.norm"]
    return pinarm.run({"pinarm": 1, "title": "p", "mechanism": mechanism, "problem": problem, "outputs": outputs})


def test_of_two_stops_on_one_motion_each_may_carry_all_or_nothing():
    result = parallelogram("OC")
    alone = {stop: parallelogram(stop) for stop in "OC"}
    for stop in "OC":
        name = f"joint.{stop}.effort"
        ends = [result[f"{name}.{end}"].values[-1] for end in ("least", "greatest")]
        assert ends == pytest.approx([0.0, TORQUE], rel=1e-9, abs=1e-9)
        assert result[name].values[-1] == pytest.approx(TORQUE / 2.0, rel=1e-9)
        assert "several frictions or stops hold one motion" in result[name].doubt
    with pytest.raises(InputError, match="not determined in"):
        result.quantities.determined("joint.A.force.norm")
    ends = sorted(alone[stop]["joint.A.force.norm"].values[-1] for stop in "OC")
    assert result["joint.A.force.norm.greatest"].values[-1] == pytest.approx(ends[-1], rel=1e-9)
    total = result.quantities.determined("joint.O.effort + joint.C.effort").values[-1]
    assert total == pytest.approx(TORQUE, rel=1e-9)
    assert any("end stop 'O lower', end stop 'C lower' hold one motion together" in note for note in result.notes())


def test_friction_without_a_load_acts_beside_several_stops():
    """Friction of 0.1 N*m in a pin at rest holds as much of the load, or adds as much to it."""
    both, one = (parallelogram(stops, {"A": {"constant": "0.1 N*m"}}) for stops in ("OC", "O"))
    assert both.trajectory.q == pytest.approx(one.trajectory.q, abs=1e-9)
    low, high = (both[f"joint.O.effort.{end}"].values[-1] for end in ("least", "greatest"))
    assert (low, high) == (pytest.approx(0.0, abs=1e-9), pytest.approx(TORQUE + 0.1, rel=1e-9))


def test_friction_that_depends_on_how_stops_share_a_load_is_refused():
    with pytest.raises(DynamicsError, match=r"the friction of joint\.C depends on a reaction"):
        parallelogram("OC", {"C": {"mu": 0.1, "radius": "10 mm"}})


def slides(folder, ways, masses, efforts, sides, restitutions, rates):
    """Slides, the last ones of which are sums of the first; all touch a stop at 0.

    Returns velocities and accelerations of the first ones at the start, and the ends of what all stops push there.
    """
    n, d = ways.shape
    body = ('<link name="l{0}"><inertial><mass value="{1}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
            '</inertial></link><joint name="j{0}" type="prismatic"><parent link="base"/><child link="l{0}"/>'
            '<axis xyz="1 0 0"/><limit lower="-1e4" upper="1e4" effort="1e6" velocity="1e3"/></joint>')  # fmt: skip
    text = "".join(body.format(k, float(mass)) for k, mass in enumerate(masses))
    (folder / "slides.urdf").write_text(f'<robot name="r"><link name="base"/>{text}</robot>')
    (folder / ".pinarm-root").touch()
    sums = {f"c{k}": {"kind": "sum", "weights": {**{f"j{i}": float(ways[k, i]) for i in range(d)}, f"j{k}": -1.0}}
            for k in range(d, n)}  # fmt: skip
    problem = {
        "kind": "forward", "time": {"end": "1 ms", "samples": 2},
        "initial": {"position": {f"j{k}": "0 m" for k in range(d)},
                    "velocity": {f"j{k}": f"{float(rates[k])} m/s" for k in range(d)}},
        "end_stops": {f"j{k}": {"lower" if sides[k] > 0.0 else "upper": "0 m", "restitution": float(restitutions[k])}
                      for k in range(n)},
        "loads": {f"f{k}": {"kind": "joint_effort", "joint": f"j{k}",
                            "effort": {"law": "constant", "value": f"{float(efforts[k])} N"}} for k in range(n)},
    }  # fmt: skip
    mechanism = {"pinarm": 1, "robot": str(folder / "slides.urdf"), "gravity": "none", "couplings": sums}
    with pinarm.file_root(folder):
        run = pinarm.run({"pinarm": 1, "title": "s", "mechanism": mechanism, "problem": problem, "outputs": ["j0"]})
    rows = run.trajectory
    pushes = np.sort([sides * pushes_of(other, rows.tau[0]) for other in (rows, *rows.others)], axis=0)
    return rows.v[0, :d], rows.a[0, :d], pushes[[0, -1]]


def pushes_of(rows, told):
    """Efforts in the first row; infinite where the row only tells a direction in which they have no end."""
    tau = rows.tau[0]
    far = rows.endless is not None and rows.endless[0]
    return np.where(np.abs(tau - told) > 1e-9, np.copysign(np.inf, tau - told), tau) if far else tau


def nearest(mass, normals, v, back):
    """The velocity nearest to v, measured by the masses, with ``N v+ >= back``: all sets that push are tried."""
    inverse = np.linalg.inv(mass)
    for count in range(len(mass) + 1):
        for some in map(list, itertools.combinations(range(len(normals)), count)):
            response = normals[some] @ inverse @ normals[some].T
            if count and np.linalg.matrix_rank(response, tol=1e-9) < count:
                continue
            impulses = np.linalg.solve(response, back[some] - normals[some] @ v) if count else np.zeros(0)
            after = v + inverse @ normals[some].T @ impulses
            if (impulses >= -1e-12).all() and (normals @ after - back >= -1e-10).all():
                return after
    return None


@pytest.mark.parametrize("seed", range(8))
def test_pushes_and_impacts_solve_their_complementarity_problems(tmp_path, seed):
    rng = np.random.default_rng(seed)
    d, more = rng.integers(1, 4), rng.integers(1, 4)
    n, ways = d + more, np.round(rng.uniform(0.1, 2.0, (more, d)), 2)
    sides = np.ones(n)
    if rng.random() < 0.4:
        sides, ways = rng.choice([1.0, -1.0], n), ways * rng.choice([1.0, -1.0], ways.shape)
    ways = np.vstack([np.eye(d), ways])
    masses, efforts = np.round(rng.uniform(0.5, 3.0, n), 3), np.round(rng.normal(0.0, 5.0, n), 2)
    efforts = -np.abs(efforts) * sides if rng.random() < 0.5 else efforts
    moves = rng.random() < 0.6
    restitutions = np.round(rng.uniform(0.0, 1.0, n), 2) * (rng.random() < 0.6)
    rates = np.round(rng.normal(0.0, 1.0, d), 2) * moves
    v, a, (least, greatest) = slides(tmp_path, ways, masses, efforts, sides, restitutions, rates)
    mass, normals = ways.T @ np.diag(masses) @ ways, sides[:, None] * ways
    after, before = rates, normals @ rates
    if (before < 0.0).any():
        after = nearest(mass, normals, rates, np.where(before < 0.0, -restitutions * before, 0.0))
        after = nearest(mass, normals, rates, np.zeros(n)) if after is None else after  # no way for a rebound
    assert v == pytest.approx(after, abs=1e-10)
    touched = np.flatnonzero(np.abs(normals @ after) < 1e-11)
    load = ways.T @ efforts
    moved = nearest(mass, normals[touched], np.linalg.solve(mass, load), np.zeros(len(touched)))
    assert a == pytest.approx(moved, abs=1e-9)
    held = [k for k in touched if abs(normals[k] @ moved) < 1e-9]
    for k in held:
        for sign, told in ((1.0, least[k]), (-1.0, greatest[k])):
            found = linprog(sign * (np.array(held) == k), A_eq=normals[held].T, b_eq=mass @ moved - load)
            wanted = -sign * np.inf if found.status == 3 else sign * found.fun
            assert told == pytest.approx(wanted, abs=1e-7)
