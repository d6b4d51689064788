"""What a free motion holds still is locked before it is solved, and the answer is that of the whole mechanism."""

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import NumericsError, PinarmError
from pinarm.records import replace
from pinarm.use.facade import Scenario
from pinarm.use.result.number_accuracy import output_scales
from pinarm.use.show.text import report
from pinarm.use.study.explain import explain
from pinarm.use.study.restore import restore

ROOT = Path(pinarm.__file__).parents[1]
FILES = [file for file in sorted((ROOT / "scenarios").glob("*.yaml")) if "kind: forward" in file.read_text("utf-8")]

ROUNDING = 1e-11
"""Relative to the largest terms of the run: the part sums the same numbers as the whole, in another order, and rows of
prescribed joints are closed to 1e-12."""

LOCKABLE = {
    "brick_thrown": {"root.x", "root.y", "root.z"},
    "gen411_arm_swing": {"O", "B"},
    "gyroscope_free": {"psi", "theta", "phi"},
    "gyroscope_precession": {"psi", "theta", "phi"},
    "machine_on_mounts_shaking": {"x", "y", "z", "roll", "pitch", "yaw", "left", "right"},
}
"""Joints of scenarios that can be held, and are then not solved for; none of a loop, or of a sum that follows a law."""

QUICK = {"brick_thrown", "gen411_arm_swing", "gyroscope_free", "crank_rocker_free"}
"""Scenarios of which something can be removed, one of each sort, and a loop of which nothing can."""


def terms(run):
    """How large the terms are that make a, tau and lam: what cancels in them leaves rounding of that size."""
    model = run.mechanism.model
    data, a = model.createData(), max(np.abs(run.a).max(), np.abs(run.v).max() ** 2, run.mechanism.gravity)
    bias = max(np.abs(pin.nonLinearEffects(model, data, q, v)).max() for q, v in zip(run.q, run.v, strict=True))
    mass = max(np.abs(pin.crba(model, data, q)).max() for q in run.q)
    return {"q": 1.0, "v": 1.0, "a": a, "tau": bias + mass * a, "lam": bias + mass * a}


def assert_same(found, wanted, within=ROUNDING):
    one, two = found.trajectory, wanted.trajectory
    sizes = terms(two)
    for name in ("q", "v", "a", "tau", "lam"):
        x, y = (np.asarray(getattr(run, name)) for run in (one, two))
        scale = max(np.abs(y).max(initial=0.0), sizes[name])
        np.testing.assert_allclose(x, y, rtol=0, atol=within * scale, err_msg=name)
    np.testing.assert_allclose(one.grid.t, two.grid.t, rtol=1e-15, atol=1e-15)  # impacts are found to rounding
    np.testing.assert_allclose(one.grid.cuts, two.grid.cuts, rtol=1e-15, atol=1e-15)
    assert one.grid.rows == two.grid.rows
    for name, scale in output_scales(wanted).items():
        np.testing.assert_allclose(found[name], wanted[name], rtol=0, atol=within * scale, err_msg=name)
    limits = [[(x.joint, x.of, x.rows) for x in result.excesses()] for result in (found, wanted)]
    assert limits[0] == limits[1]


def assert_unchanged(scenario, within=ROUNDING):
    """Compare with the whole mechanism; return the joints that were removed, and how."""
    result = scenario.run()
    assert_same(result, scenario.varied({"modelled": "whole"}).run(), within)
    return {one.joint: one.how for one in result.removals}


def held(scenario, joint, other):
    """The scenario with a joint held still and forces asked at it and another one; none where that cannot be."""
    data = {key: value for key, value in scenario.document.data.items() if key not in ("find", "variants", "expect")}
    problem = dict(data["problem"])
    motion = problem.get("motion", {})
    if problem["kind"] != "forward":
        return None
    # steps of one length: those that are chosen by the error differ where the error is rounding
    data["accuracy"] = {"method": "rk4", "step": f"{scenario.problem.time.end / 100} s"}
    given = problem.get("initial", {}).items()
    problem["initial"] = {key: {k: x for k, x in part.items() if k != joint.name} for key, part in given}
    problem["time"] = {**problem["time"], "samples": 41}
    problem["motion"] = {**motion, joint.name: {"law": "constant", "value": f"0.1 {joint.unit}"}}
    try:
        data |= {"problem": problem, "outputs": [f"joint.{x.name}.effort" for x in (joint, other)]}
        return Scenario.of(replace(scenario.document, data=data), scenario.folder)
    except PinarmError:
        return None


@pytest.mark.parametrize(
    "file",
    [pytest.param(file, marks=() if file.stem in QUICK else pytest.mark.slow) for file in FILES],
    ids=lambda file: file.stem,
)
def test_answers_are_those_of_the_whole_mechanism(file):
    scenario = pinarm.load(file)
    if scenario.simplification.part:
        assert_unchanged(scenario)
    joints, removed = list(scenario.mechanism.joints.values()), set()
    for joint, other in zip(joints, joints[-1:] + joints[:-1], strict=True):
        variant = held(scenario, joint, other) if len(joints) < 20 else None  # forty four-bars are all loops
        if variant and variant.simplification.part:
            assert assert_unchanged(variant)[joint.name] == "locked"
            removed.add(joint.name)
    assert removed == LOCKABLE.get(file.stem, set())


def body(name, mass):
    return f"""<link name="{name}"><inertial><origin xyz="0.05 0.02 0.15"/><mass value="{mass}"/>
      <inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0.001" ixz="0.002" iyz="0"/></inertial></link>"""


def joint(name, parent, child, axis, xyz, limit=2):
    return f"""<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
      <origin xyz="{xyz}" rpy="0.1 0.2 0.3"/><axis xyz="{axis}"/><dynamics damping="0.3"/>
      <limit lower="-3" upper="3" effort="{limit}" velocity="9"/></joint>"""


ARM_A = (
    body("a1", 2) + body("a2", 1)
    + joint("shoulder_a", "trunk", "a1", "0 1 0", "0 0.2 0.4") + joint("elbow_a", "a1", "a2", "1 0 0", "0 0 0.3")
    + '<link name="hand"/><joint name="grip" type="fixed"><parent link="a2"/><child link="hand"/>'
    '<origin xyz="0 0 0.25"/></joint>'
)  # fmt: skip
ARM_B = (
    body("b1", 2.5) + body("b2", 1.5)
    + joint("shoulder_b", "trunk", "b1", "0 1 0", "0 -0.2 0.4") + joint("elbow_b", "b1", "b2", "1 0 0", "0 0 0.3")
)  # fmt: skip
WAIST = body("trunk", 8) + joint("waist", "base", "trunk", "0 0 1", "0 0 0.5")
TWO_ARMS = f'<robot name="two_arms">{body("base", 9)}{WAIST}{ARM_A}{ARM_B}</robot>'
TILTED = {"direction": "-x", "magnitude": "9.81 m/s^2"}
HELD = {"law": "constant", "value": "0.3 rad"}
MOVES = {"law": "polynomial", "from": "0 rad", "to": "1 rad", "duration": "1 s"}
JERKS = {"law": "trapezoid", "from": "0 rad", "to": "1 rad", "acceleration": "6 rad/s^2", "begin": "0.23 s"}
"""The same with all axes parallel, so that angles can be summed."""
LAWS = {"waist": HELD, "elbow_a": HELD, "shoulder_b": JERKS, "elbow_b": MOVES}
STILL = {"waist": "locked", "elbow_a": "locked"}


@pytest.fixture
def scene(tmp_path):
    """Scenarios about a trunk with two arms; keys of the mechanism file and the problem are given."""

    def make(problem, *outputs, model=TWO_ARMS, accuracy=None, **told):
        (tmp_path / "model.urdf").write_text(model, encoding="utf-8")
        told = {"pinarm": 1, "robot": "model.urdf", "gravity": TILTED, **told}
        time = {} if problem["kind"] in ("statics", "state") else {"time": {"end": "1 s", "samples": 21}}
        asked = {"pinarm": 1, "mechanism": "mechanism.yaml", "problem": {**time, **problem}, "outputs": list(outputs)}
        for name, data in (
            ("mechanism", told),
            ("scenario", {**asked, **({"accuracy": accuracy} if accuracy else {})}),
        ):
            (tmp_path / f"{name}.yaml").write_text(json.dumps(data), encoding="utf-8")
        return pinarm.load(tmp_path / "scenario.yaml")

    return make


def falling(**more):
    return {"kind": "forward", "motion": LAWS, **more}


RK4 = {"method": "rk4", "step": "20 ms"}


def test_what_is_asked_of_what_is_locked_is_there(scene):
    outputs = ("joint.elbow_a.effort", "joint.waist.moment.x", "joint.elbow_a.force.y", "point.b2.position.z",
               "joint.elbow_b.velocity", "energy.total", "waist")  # fmt: skip
    asked = scene(falling(), *outputs, accuracy=RK4)
    assert assert_unchanged(asked) == STILL
    assert asked.run().trajectory.drives == asked.varied({"modelled": "whole"}).run().trajectory.drives


OTHER_ARM = {"shoulder_b": JERKS, "elbow_b": HELD}


@pytest.mark.parametrize(
    ("waist", "removed"),
    [
        ({"waist": HELD}, {"waist": "locked", "elbow_b": "locked"}),
        ({"waist": MOVES}, {"elbow_b": "locked"}),
        ({}, {"elbow_b": "locked"}),
    ],
    ids=["held", "moved", "free"],
)
def test_an_arm_that_falls_feels_the_other_only_through_a_free_trunk(scene, waist, removed):
    problem = {"kind": "forward", "motion": {**waist, **OTHER_ARM}, "initial": {"position": {"elbow_a": "1 rad"}}}
    motors = {name: {"joint": name, "ratio": 50, "rotor_inertia": "8e-5 kg*m^2"} for name in LAWS}
    asked = scene(problem, "joint.elbow_a.acceleration", drives=motors, accuracy=RK4)
    assert assert_unchanged(asked) == removed


def test_a_free_base_carries_what_is_locked(scene):
    """Integrated, with events and end stops: what happens is told of the whole mechanism."""
    motion = {"shoulder_b": HELD, "elbow_b": HELD, "elbow_a": HELD}
    events = {"passes": {"when": "shoulder_a", "reaches": "0.1 rad"}}
    problem = {
        "kind": "forward",
        "motion": motion,
        "events": events,
        "initial": {"velocity": {"shoulder_a": "2 rad/s"}},
    }
    problem["end_stops"] = {"shoulder_a": {"upper": "0.2 rad", "restitution": 0.5}}
    asked = scene(problem, "t", base="floating", accuracy=RK4)
    assert assert_unchanged(asked) == dict.fromkeys(motion, "locked")
    found, wanted = (each.run().events for each in (asked, asked.varied({"modelled": "whole"})))
    assert [one.name for one in found] == [one.name for one in wanted]
    assert {one.name for one in found} > {"passes"}
    for one, two in zip(found, wanted, strict=True):
        np.testing.assert_allclose([*one.q, *one.v], [*two.q, *two.v], rtol=0, atol=1e-11)


GEARED = {"couplings": {"gear": {"kind": "gear", "joints": ["elbow_a", "elbow_b"], "ratio": -2, "offset": "0.1 rad"}}}


def test_gears_of_joints_held_still_are_locked_with_them(scene):
    """The multiplier of the gear and the efforts of its joints come back.

    Steps of the whole keep the row of the gear at their ends, and err within them as ``h^4``, which the part does not.
    """
    motion = {"shoulder_a": MOVES, "shoulder_b": MOVES, "elbow_a": HELD}
    accuracy = {"method": "rk4", "step": "4 ms"}
    asked = scene(falling(motion=motion), "joint.shoulder_a.effort", accuracy=accuracy, **GEARED)
    found = assert_unchanged(asked, 1e-8)
    assert {"elbow_a", "elbow_b"} == {name for name, how in found.items() if how == "locked"}
    run = asked.run().trajectory
    assert np.abs(run.lam).min() > 0.0
    assert not run.tau[:, run.mechanism.joints["elbow_b"].v].any()


def test_loads_move_with_what_is_locked(scene):
    """Forces at links of locked joints, a spring from one arm to the other, springs of joints that are removed."""
    loads = {
        "push": {"kind": "wrench", "point": "b2", "force": ["3 N", "-2 N", "5 N"], "axes": "b2"},
        "band": {"kind": "point_spring", "between": ["a2", "b2"], "stiffness": "40 N/m", "damping": "2 N*s/m"},
        "coil": {"kind": "joint_spring", "joint": "elbow_b", "stiffness": "3 N*m/rad"},
        "pad": {"kind": "bushing", "between": ["b1", "a2"], "stiffness": {"rotation": ["2 N*m/rad"] * 3},
                "damping": {"translation": ["1 N*s/m"] * 3}},
    }  # fmt: skip
    problem = {"kind": "forward", "motion": {"waist": HELD, **OTHER_ARM}, "loads": loads}
    found = assert_unchanged(
        scene(problem, "joint.elbow_a.acceleration", "power.band", "force.pad.moment.x", accuracy=RK4)
    )
    assert found == {"waist": "locked", "elbow_b": "locked"}


def test_a_motion_that_is_given_up_is_that_of_the_whole_mechanism(scene):
    asked = scene(falling(), "t", accuracy={"max_steps": 9})
    assert asked.simplification.part
    with pytest.raises(NumericsError) as caught:
        asked.simplification.solve()
    assert caught.value.partial.rows.mechanism is asked.mechanism


def test_it_says_what_was_removed_and_why(scene, tmp_path):
    asked = scene(falling(), "joint.shoulder_b.effort", accuracy=RK4)
    result = asked.run()
    said = {one["joint"]: (one["how"], one["why"]) for one in result.summary()["not solved for"]}
    assert said["elbow_a"] == ("locked", "held at 0.3 rad")
    assert "locked: joints waist, elbow_a (held still)" in report(result).splitlines()
    told = str(explain(tmp_path / "scenario.yaml")).splitlines()
    assert "solved for: 3 of 5 joints" in told
    assert "  waist: locked, held at 0.3 rad" in told
    again = restore(result.save(tmp_path / "result", plots=False))
    assert again.removals == result.removals
    assert_same(again, result)
