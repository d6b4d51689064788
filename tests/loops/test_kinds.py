"""Every kind of loop joint is the same joint as in the tree, where simple joints make it, and as in Newton's equations.

The linkage: body A turns about an axis fixed to the ground; a joint of the kind holds body B, to A or to the ground. In
the tree, B hangs on that joint; or it floats, and the joint closes a loop.
"""

from typing import get_args

import numpy as np
import pinocchio as pin
import pytest
from linkage import GROUND, Linkage, random_body, random_joint
from motions import driven, free, poses, power, states, wrench
from newton_euler import newton_euler

from pinarm.engine.quantities.names import Quantities
from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import lengths as sizes_of
from pinarm.mechanics.laws import Harmonic
from pinarm.mechanics.loops.kinds import LoopJointKind

HOLONOMIC = {str(kind.__struct_config__.tag) for kind in get_args(LoopJointKind)} - {"rolling", "knife_edge"}
KINDS = [*sorted(HOLONOMIC - {"pin"}), "pin"]
"""Names of all kinds; their places here seed the linkages, so that a later one goes to the end."""
ENDS = {"A-B": ("A", "B"), "B-A": ("B", "A"), "ground-B": (GROUND, "B"), "B-ground": ("B", GROUND)}
FIXED_TO_GROUND = ("revolute", "spherical", "screw")
"""Kinds that the fast tests hold to the ground as well."""
IN_TREE, IN_LOOP = ["free"], ["joint"]


@pytest.fixture(scope="class")
def linkage(request):
    kind, ends = request.param
    generator = np.random.default_rng([KINDS.index(kind), list(ENDS).index(ends)])
    return Linkage(
        {"A": random_body(generator), "B": random_body(generator)},
        {
            "pivot": random_joint(generator, "revolute", GROUND, "A"),
            "joint": random_joint(generator, kind, *ENDS[ends]),
            "free": random_joint(generator, "free", GROUND, "B"),
        },
    )


every_kind = pytest.mark.parametrize("linkage", [(kind, "A-B") for kind in KINDS], indirect=True, ids=KINDS)
everywhere = pytest.mark.parametrize("linkage", [
    pytest.param(
        (kind, ends), id=f"{kind} {ends}",
        marks=() if ends == "A-B" or (ends == "ground-B" and kind in FIXED_TO_GROUND) else pytest.mark.slow,
    ) for kind in KINDS for ends in ENDS
], indirect=True)  # fmt: skip


@everywhere
class TestJointThatClosesALoop:
    def test_it_moves_as_the_one_in_the_tree(self, linkage, tmp_path):
        runs = [free(linkage.build(tmp_path, cut)) for cut in (IN_TREE, IN_LOOP)]
        tree, loop = (states(linkage, run) for run in runs)
        assert loop == pytest.approx(tree, abs=2e-9)  # local errors of 1e-12, velocities of 10 rad/s

    def test_its_wrench_and_accelerations_are_those_of_newton_and_euler(self, linkage, tmp_path):
        run = free(linkage.build(tmp_path, IN_LOOP))
        for row, pose in enumerate(poses(linkage, run)):
            right = newton_euler(linkage, pose)
            assert right.redundant == 0
            assert right.open < 1e-12
            assert right.speed < 1e-11
            for body in linkage.bodies:
                assert pose.acceleration[body] == pytest.approx(right.acceleration[body], rel=1e-10, abs=1e-10)
                assert pose.alpha[body] == pytest.approx(right.alpha[body], rel=1e-10, abs=1e-10)
            found = [values[row] for values in wrench(linkage, run, "joint").values()]
            assert found == pytest.approx(right.wrench["joint"], rel=1e-10, abs=1e-10)

    def test_drives_along_tasks_give_the_same_efforts(self, linkage, tmp_path):
        tasks = independent_tasks(linkage)
        efforts = []
        for cut in (IN_TREE, IN_LOOP):
            mechanism = linkage.build(tmp_path, cut, coordinates={
                **{f"at_{axis}": {"kind": "point", "point": "B_com", "along": axis} for axis in "xyz"},
                **{f"about_{axis}": {"kind": "rotation", "body": "B_com", "about": axis} for axis in "xyz"},
            })  # fmt: skip
            motion = {"pivot": Harmonic(amplitude=0.4, pulsation=3.0)}
            for k, task in enumerate(tasks):
                motion[task] = Harmonic(mean=at_rest(linkage, task), amplitude=0.1, pulsation=2.0 + k)
            run = driven(mechanism, motion, 0.6, drives=list(motion))
            asked = Quantities(run)
            found = {name: asked[f"coordinate.{name}.effort"].values for name in motion}
            given = sum(found[name] * asked[f"coordinate.{name}.velocity"].values for name in motion)
            right = [power(linkage, pose) for pose in poses(linkage, run)]
            assert given == pytest.approx(right, rel=1e-10, abs=1e-10)
            efforts.append(found)
        for name, values in efforts[0].items():
            assert efforts[1][name] == pytest.approx(values, rel=1e-9, abs=1e-9)


def at_rest(linkage, task):
    kind, axis = task.split("_")
    return float(linkage.bodies["B"].com["xyz".index(axis)]) if kind == "at" else 0.0


def independent_tasks(linkage):
    """As many coordinates of body B as the joint leaves it free, and that move most independently at the start."""
    joint = linkage.joints["joint"]
    parts = joint.simple() if joint.second == "B" else [(k, -axis, at) for k, axis, at in joint.simple()]
    com, columns = linkage.bodies["B"].com, []
    for kind, axis, at in parts:
        turning = np.concatenate([np.cross(axis, com - at), axis])
        columns.append(turning if kind == "continuous" else np.concatenate([axis, np.zeros(3)]))
    if joint.kind == "screw":
        columns = [sum(x * (1.0 if x[3:].any() else joint.lead / (2 * np.pi)) for x in columns)]
    left, names = np.array(columns).reshape(-1, 6).T, [f"{k}_{axis}" for k in ("at", "about") for axis in "xyz"]
    chosen = []
    for _ in columns:
        size = np.linalg.norm(left, axis=1)
        best = int(size.argmax())
        chosen.append(names[best])
        left = left - np.outer(left @ left[best], left[best]) / size[best] ** 2
    return chosen


@pytest.fixture(scope="class")
def loop(linkage, tmp_path_factory):
    """The mechanism with the joint in the loop, and a closed configuration that is no special one."""
    mechanism = linkage.build(tmp_path_factory.mktemp("loop"), IN_LOOP)
    return mechanism, free(mechanism).q[-1]


@every_kind
class TestRows:
    def test_they_are_the_rates_of_the_gap_where_it_is_closed(self, loop, differentiate):
        mechanism, q = loop
        closure, model = mechanism.closure, mechanism.model
        state = closure.state(q)
        rows = closure.rows(state)
        assert np.abs(closure.gap(state)).max() < 1e-12
        for v in np.random.default_rng(0).normal(size=(5, model.nv)):
            assert rows @ v == pytest.approx(differentiate(lambda t, v=v: gap(mechanism, q, t * v), 0.0), abs=1e-9)

    def test_the_drift_is_what_the_change_of_the_rows_does(self, loop, differentiate):
        mechanism, _ = loop
        closure, model = mechanism.closure, mechanism.model

        def rows(q):
            state = closure.state(q)
            return closure.rows(state)

        for q, v in np.random.default_rng(2).normal(size=(5, 2, model.nv)):
            change = differentiate(lambda t, q=q, v=v: rows(pin.integrate(model, q, t * v)), 0.0)
            assert closure.drift(closure.state(q, v)) == pytest.approx(change @ v, abs=1e-8)

    def test_multipliers_have_the_power_of_their_wrenches_also_while_the_joint_is_open(self, loop):
        mechanism, _ = loop
        closure, model, data = mechanism.closure, mechanism.model, mechanism.model.createData()
        generator = np.random.default_rng(3)
        for q, v in generator.normal(size=(2, 2, model.nv)):
            lam = generator.normal(size=closure.size)
            state = closure.state(q)
            pin.forwardKinematics(model, data, q, v)
            twists = np.array([data.oMi[i].act(data.v[i]).vector for i in range(model.njoints)])
            links = LinkPlacements.at(model, q[None])
            power = (twists * closure.wrenches(links, lam[None])[0]).sum()
            assert power == pytest.approx(lam @ closure.rows(state) @ v, abs=1e-12)
            about_origins, sizes, loads = (each[0] for each in closure.acting(links, q[None], lam[None]))
            turns = [data.oMi[i].rotation for i in range(model.njoints)]
            own = [(turn @ twist.linear, turn @ twist.angular) for turn, twist in zip(turns, data.v, strict=True)]
            power = (about_origins * np.reshape(own, (-1, 6))).sum() + loads @ v
            assert power == pytest.approx(lam @ closure.rows(state) @ v, abs=1e-12)
            assert (sizes >= (1.0 - 1e-12) * sizes_of(about_origins)).all()


def gap(mechanism, q, step):
    moved = pin.integrate(mechanism.model, q, step)
    state = mechanism.closure.state(moved)
    return mechanism.closure.gap(state)
