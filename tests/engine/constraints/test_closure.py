"""The rows of constraints at many configurations, kept or not, against those of each configuration by itself."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from benchmarks.growth import written
from pinarm.engine.constraints.closure import KEPT, SEVERAL, Closure
from pinarm.engine.constraints.nullspace import MANY
from pinarm.engine.kinematics.mobility import mobility_of
from pinarm.errors import InputError
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import Revolute, Spherical
from pinarm.mechanics.loops.rod import Rod
from pinarm.mechanics.loops.universal import Universal
from pinarm.records import replace
from pinarm.use.mechanism import Mechanism

MODELS = Path(pinarm.__file__).parents[1] / "models"


@pytest.fixture
def closure():
    return Mechanism.load(MODELS / "andrews" / "mechanism.yaml").closure


@pytest.mark.parametrize("n", [SEVERAL - 1, SEVERAL, KEPT, KEPT + 1])
def test_rows_and_their_derivatives_are_those_of_each_state(closure, n):
    q, v, w = np.random.default_rng(n).uniform(-1.0, 1.0, (3, n, closure.model.nv))
    for rates in (v, w):  # of the same configurations
        gaps, rows = closure.at(q)
        drifts, splits = closure.drifts(q, rates), closure.splits(q, rows)
        assert splits.shape == rows.shape
        for k in range(n):
            state = closure.state(q[k], rates[k])
            assert gaps[k] == pytest.approx(closure.gap(state), abs=1e-14)
            assert rows[k] == pytest.approx(closure.rows(state), abs=1e-14)
            assert drifts[k] == pytest.approx(closure.drift(state), abs=1e-13)
    ((_, split),) = splits.parts  # random configurations are regular
    assert rows @ split.free == pytest.approx(np.zeros((n, rows.shape[1], split.free.shape[2])), abs=1e-14)


def test_what_is_kept_is_of_the_configurations_that_are_asked_for(closure):
    q, other = np.random.default_rng(1).uniform(-1.0, 1.0, (2, SEVERAL, closure.model.nv))
    first = closure.at(q)[1].copy()
    assert not np.array_equal(closure.at(other)[1], first)
    assert closure.at(q)[1] is closure.at(q.copy())[1] and np.array_equal(closure.at(q)[1], first)


def test_what_moves_both_links_alike_is_not_in_their_rows(tmp_path):
    """The tree is 16 joints deep, and a loop knows the last three: paths between frames leave the others out."""
    scissor = pinarm.Scenario.load(written(tmp_path, "scissor", 8)).mechanism.closure
    q = np.random.default_rng(0).uniform(-1.0, 1.0, scissor.model.nv)
    (wanted,) = scissor.constraint_rows.at(q[None]).matrices
    rows = scissor.rows(scissor.state(q))
    assert np.array_equal(rows != 0.0, wanted != 0.0)
    np.testing.assert_allclose(rows, wanted, atol=1e-13)


@pytest.mark.slow
def test_what_rigid_bodies_do_not_determine_is_told_of_many_joints_as_of_few(tmp_path):
    """Forces across the plane and moments in it, three of every loop; forces in the plane are determined."""
    run = pinarm.Scenario.load(written(tmp_path, "fourbars", 60)).run()
    own = run.trajectory.mechanism
    assert own.model.nv > MANY
    mobility = mobility_of(own, run.trajectory.q[1])
    assert mobility.degree == 180 and mobility.undetermined["top7"] == ["force z", "moment x", "moment y"]
    for given in ("force.x", "force.y", "moment.z"):
        assert np.isfinite(run[f"loop.top7.{given}"].values).all()
    for shared in ("force.z", "moment.x", "moment.y"):
        for owner in ("loop.top7", "joint.u7"):
            with pytest.raises(InputError, match=r"hyperstatic of degree 180.*top5 and 175 more carry together"):
                _ = run[f"{owner}.{shared}"]


def test_the_extent_is_that_of_the_longest_branch():
    """Rods of 2 m and 3 m one after the other, the second with a tip at 4 m, and a rod of 5 m beside them."""
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([2.0, 0.0, 0.0])), "first")
    second = model.addJoint(first, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([0.0, 3.0, 0.0])), "second")
    model.addJoint(0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([0.0, 0.0, 5.0])), "beside")
    assert Closure.of(model).extent == 5.0
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, -4.0]))
    longer = model.copy()
    longer.addFrame(pin.Frame("tip", second, 0, tip, pin.FrameType.OP_FRAME))
    assert Closure.of(longer).extent == 9.0


def test_rows_about_axes_in_space_are_those_of_each_state():
    hinges = Mechanism.load(MODELS / "bricard" / "mechanism.yaml").closure
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (8, hinges.model.nv))
    each = [hinges.rows(hinges.state(one)) for one in q]
    np.testing.assert_allclose(hinges.at(q)[1], each, atol=1e-13)  # links of 1 m: rounding over five joints


AXIS, AXES, POINT = (0.6, 0.0, 0.8), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), np.array([0.1, -0.2, 0.3])


KINDS = pytest.mark.parametrize("kind", [
    Revolute(between=("", ""), axis=AXIS), Rod(between=("", ""), length=0.4), Universal(between=("", ""), axes=AXES),
])  # fmt: skip
"""Of directions that stay in a frame, and that do not."""


def star(closure, kind):
    """Three joints that hold the same, all of one link, and another one."""
    model = closure.model.copy()
    place = pin.SE3(pin.exp3(POINT), POINT)
    frames = [model.addFrame(pin.Frame(f"f{joint}", joint, place, pin.FrameType.OP_FRAME)) for joint in (1, 3, 5, 7)]
    joints = [LoopJoint(f"loop_{k}", "any", frames[0], other, kind.pair()) for k, other in enumerate(frames[1:])]
    return Closure.of(model, [*joints, *closure.constraints[:1]])


@KINDS
def test_wrenches_about_the_origins_are_the_same_and_their_sizes_do_not_cancel(kind, closure):
    lattice = star(closure, kind)
    generator = np.random.default_rng(6)
    q, lam = generator.normal(size=(4, lattice.model.nq)), generator.normal(size=(4, lattice.size))
    links = LinkPlacements.at(lattice.model, q)
    wrenches, sizes, loads = lattice.acting(links, q, lam)
    np.testing.assert_allclose(wrenches, links.at_joints(lattice.wrenches(links, lam)), atol=1e-13)
    parts = [replace(lattice, constraints=(one,)) for one in lattice.constraints]
    each = [part.acting(links, q, lam[..., rows])[1] for part, rows in zip(parts, lattice.slices.values(), strict=True)]
    sums = np.sum(each, axis=0)
    np.testing.assert_allclose(sizes[..., 0], sums[..., 0], atol=1e-13)
    assert (sizes[..., 1] >= sums[..., 1] * (1.0 - 1e-13)).all()  # with the longest arm of each link
    assert not loads.any()


def test_joints_that_rows_tie_are_one_group():
    """Two four-bars beside each other, with a free pendulum; a gear that ties one of their joints to the pendulum."""
    points = {"O1": [0, 0], "A1": [1, 0], "B1": [1, 1], "C1": [0, 1], "O2": [3, 0], "A2": [4, 0], "B2": [4, 1],
              "C2": [3, 1], "P": [6, 0], "Q": [6, -1]}  # fmt: skip
    ends = {"a": "O1 A1", "b": "A1 B1", "c": "B1 C1", "d": "O2 A2", "e": "A2 B2", "f": "B2 C2", "g": "P Q"}
    planar = {"points": {name: [f"{x} m" for x in place] for name, place in points.items()},
              "ground": ["O1", "C1", "O2", "C2", "P"],
              "links": {name: {"points": pair.split(), "mass": "1 kg"} for name, pair in ends.items()}}  # fmt: skip
    geared = {"gear": {"kind": "gear", "joints": ["O2", "P"], "ratio": 2}}
    for couplings, count in (({}, 3), (geared, 2)):
        data = {"pinarm": 1, "planar": planar, "couplings": couplings}
        mechanism = pinarm.load(
            {
                "pinarm": 1,
                "mechanism": data,
                "problem": {"kind": "forward", "time": {"end": "1 s"}},
                "outputs": ["joint.P.position"],
            }
        ).mechanism
        groups = {name: mechanism.closure.groups[joint.v] for name, joint in mechanism.joints.items()}
        assert len(set(mechanism.closure.groups.tolist())) == count
        assert groups["O1"] == groups["A1"] == groups["C1"] != groups["O2"] == groups["A2"] == groups["C2"]
        assert (groups["P"] == groups["O2"]) == bool(couplings)


def test_what_pulls_along_a_rod_without_mass_has_a_size_about_the_axis_of_the_rod():
    """Its moment there is 0 but for rounding: compared with itself that would be an error of 100 percent."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "spin")
    end = pin.SE3(np.eye(3), np.array([0.7, 0.0, 0.0]))
    frames = [model.addFrame(pin.Frame(f"f{joint}", joint, end, pin.FrameType.OP_FRAME)) for joint in (0, 1)]
    model.addFrame(pin.Frame("far", 1, pin.SE3(np.eye(3), np.full(3, 1e6)), pin.FrameType.OP_FRAME))
    pull = np.zeros((1, 3))
    pull[0, 0] = 50.0
    loop = Closure.of(model, [LoopJoint("pin", "any", *frames, Spherical(between=("f0", "f1")).pair())])
    wrenches, sizes, _ = loop.acting(LinkPlacements.at(model, np.zeros((1, 1))), np.zeros((1, 1)), pull)
    assert np.abs(wrenches[0, 1, :3]) == pytest.approx([50.0, 0.0, 0.0]) and not wrenches[0, 1, 3:].any()
    assert sizes[0, 1] == pytest.approx([50.0, 50.0 * 0.7])  # nothing acts at the frame far away
