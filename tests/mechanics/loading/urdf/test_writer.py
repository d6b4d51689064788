"""Mechanisms of a ``pin.Model``: Pinocchio's own accelerations and efforts of the same model, and files of the same."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import InputError, ModelError
from pinarm.input.roots import robots
from pinarm.use.mechanism import Mechanism
from pinarm.use.study.restore import restore

MODELS = Path(pinarm.__file__).parents[1] / "models"


def undamped(name, floating):
    model = pin.buildModelFromUrdf(str(robots()[name]), *([pin.JointModelFreeFlyer()] if floating else []))
    for values in (model.damping, model.upperDryFrictionLimit, model.lowerDryFrictionLimit):
        values[:] = 0.0  # Pinocchio's dynamics leaves them out, pinarm's has them
    return model


def every_joint():
    """A tree with every kind of joint that is taken, bodies of no symmetry, oblique gravity, and an armature.

    It is not in depth-first order, which ``pin.crba`` would need; ``pin.aba`` does not.
    """
    generator, model = np.random.default_rng(3), pin.Model()
    model.name = "every"
    kinds = [
        pin.JointModelFreeFlyer(), pin.JointModelRevoluteUnaligned(np.array([0.36, 0.48, 0.8])),
        pin.JointModelSpherical(), pin.JointModelPrismaticUnaligned(np.array([0.6, 0.0, -0.8])),
        pin.JointModelSphericalZYX(), pin.JointModelRUBY(), pin.JointModelTranslation(), pin.JointModelPlanar(),
        pin.JointModelUniversal(np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.0, 1.0])), pin.JointModelPX(),
        pin.JointModelRZ(),
    ]  # fmt: skip
    parents = [0, 1, 1, 2, 3, 4, 5, 6, 7, 8, 5]
    for k, (kind, parent) in enumerate(zip(kinds, parents, strict=True)):
        place = pin.SE3(pin.exp3(generator.normal(size=3)), generator.normal(size=3))
        joint = model.addJoint(parent, kind, place, f"j{len(kinds) - k:02d}")  # names descend: other orders of v
        model.addJointFrame(joint)
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Random())
        model.addBodyFrame(f"b{k}", joint, pin.SE3.Random(), -1)
    model.gravity.linear = np.array([1.0, -2.0, 9.0])
    model.armature[model.joints[2].idx_v] = 0.7
    return model


def accelerations(model, q, v, a):
    """Linear accelerations of all frames of bodies, world axes, by Pinocchio."""
    data = model.createData()
    pin.forwardKinematics(model, data, q, v, a)
    pin.updateFramePlacements(model, data)
    return {frame.name: pin.getFrameClassicalAcceleration(model, data, k, pin.LOCAL_WORLD_ALIGNED).linear
            for k, frame in enumerate(model.frames) if k and frame.type == pin.FrameType.BODY}  # fmt: skip


def compare(model, seed=0):
    """Compare the free motion of all frames, placements and energies: none depends on the coordinates.

    Rounding grows with the condition of M, up to 1e4 for light fingers, and with the accelerations.
    """
    pin.seed(seed)
    mechanism, data = Mechanism.of(model), model.createData()
    q = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    v = np.random.default_rng(seed).normal(size=model.nv)
    expected = accelerations(model, q, v, pin.aba(model, data, q, v, np.zeros(model.nv)))
    own = mechanism.from_pinocchio(q, v)
    back = mechanism.to_pinocchio(*own)
    assert back[0] == pytest.approx(q, abs=1e-14)
    assert back[1] == pytest.approx(v, abs=1e-13)
    states = mechanism.at(*own, mechanism.forward(*own))
    size = max(np.abs(x).max() for x in expected.values())
    for name, acceleration in expected.items():
        values = [float(states[f"point.{name}.acceleration.{axis}"].values) for axis in "xyz"]
        assert values == pytest.approx(acceleration, abs=1e-12 * size), name
    kinetic = pin.computeKineticEnergy(model, data, q, v) + model.armature @ v**2 / 2
    assert float(states["energy.kinetic"].values) == pytest.approx(kinetic, rel=1e-12)
    potential = pin.computePotentialEnergy(model, data, q)
    assert float(states["energy.potential"].values) == pytest.approx(potential, rel=1e-12, abs=1e-10)
    return mechanism


@pytest.mark.parametrize(("name", "floating"), [
    ("panda", False), ("kinova", False), ("talos", True), ("tiago", False),
])  # fmt: skip
def test_robots_move_as_in_pinocchio(name, floating):
    compare(undamped(name, floating))


@pytest.mark.parametrize("seed", [0])
def test_every_kind_of_joint_moves_as_in_pinocchio(seed):
    mechanism = compare(every_joint(), seed)
    assert len(mechanism.balls) == 2
    kinds = {name: joint.shortname() for name, joint in zip(mechanism.model.names, mechanism.model.joints, strict=True)}
    assert [kinds[f"j07.{axis}"] for axis in "xyz"] == [f"JointModelR{axis}" for axis in "XYZ"]
    assert [kinds[f"j05.{axis}"] for axis in "xyz"] == [f"JointModelP{axis}" for axis in "XYZ"]


def test_loops_and_what_else_a_file_says_are_as_in_the_file():
    """The same mechanism from its file, and from the pin.Model of that with the file's plain data."""
    file = Mechanism.load(MODELS / "crank_rocker" / "mechanism.yaml")
    keys = {key: value for key, value in file.source.data.items() if key not in ("robot", "arguments", "pinarm")}
    made = Mechanism.of(file.model, **keys)
    q = pinarm.load(MODELS.parent / "scenarios" / "crank_rocker_turning.yaml").run().trajectory.q[::50]
    v = np.zeros((len(q), file.model.nv))
    assert [constraint.name for constraint in made.constraints] == [constraint.name for constraint in file.constraints]
    assert made.forward(*made.from_pinocchio(q, v)) == pytest.approx(file.forward(q, v), abs=1e-10)


def test_points_are_named_like_links_in_files_and_in_python():
    model = undamped("ur5", False)
    points = {"tip": {"link": "tool0", "at": ["0 m", "10 cm", "0.2 m"], "rpy": [0, "90 deg", 0]},
              "end": {"link": "tip", "at": ["0.1 m", 0, 0]}}  # fmt: skip
    made = Mechanism.of(model, points=points)
    q = np.random.default_rng(2).normal(size=6)
    offset = pin.SE3(pin.rpy.rpyToMatrix(0.0, np.pi / 2, 0.0), np.array([0.0, 0.1, 0.2]))
    tip = pin.SE3(made.frame("tool0", q)) * offset
    assert made.frame("tip", q) == pytest.approx(tip.homogeneous, abs=1e-15)
    assert made.frame("end", q)[:3, 3] == pytest.approx(tip.act(np.array([0.1, 0.0, 0.0])), abs=1e-15)
    assert made.at(q)["point.end.position.x"].values == pytest.approx(made.frame("end", q)[0, 3])
    loaded = Mechanism.load("ur5", values={"points": {"tip": {"link": "tool0", "at": ["0 m", "10 cm", "0.2 m"]}}})
    assert loaded.frame("tip", q)[:3, 3] == pytest.approx(tip.translation, abs=1e-15)


def test_limits_damping_armature_and_gravity_are_taken():
    model = pin.buildModelFromUrdf(str(robots()["ur5"]))
    model.damping[:] = 0.3
    model.armature[:] = 0.2
    model.gravity.linear = np.array([0.0, 0.0, -1.62])
    made = Mechanism.of(model)
    assert made.model.upperPositionLimit == pytest.approx(model.upperPositionLimit, abs=0.0)
    assert made.model.upperEffortLimit == pytest.approx(model.upperEffortLimit, abs=0.0)
    assert made.model.upperVelocityLimit == pytest.approx(model.upperVelocityLimit, abs=0.0)
    assert made.model.gravity.linear.tolist() == [0.0, 0.0, -1.62]
    q, v, a = np.random.default_rng(4).normal(size=(3, 6))
    assert made.inverse(q, v, a) == pytest.approx(pin.rnea(model, model.createData(), q, v, a) + 0.3 * v, abs=1e-12)
    assert Mechanism.of(model, gravity="none").gravity == 0.0


def test_a_result_of_it_is_saved_and_read(tmp_path):
    model = every_joint()
    made = Mechanism.of(model)
    data = {"pinarm": 1, "mechanism": made, "problem": {"kind": "forward", "time": {"end": "0.1 s", "samples": 3}},
            "outputs": ["energy.total", "point.b3.position.x"]}  # fmt: skip
    result = pinarm.run(data)
    again = restore(result.save(tmp_path / "out", plots=False))
    for name in result.content.outputs:
        assert again[name].values == pytest.approx(result[name].values, rel=1e-12)
    assert np.ptp(result["energy.total"].values) < 1e-6 * np.abs(result["energy.kinetic"].values).max()


@pytest.mark.parametrize(("kind", "message"), [
    (pin.JointModelHX(0.1), "JointModelHX, which is not taken over"),
    (pin.JointModelComposite(pin.JointModelRX()), "JointModelComposite, which is not taken over"),
])  # fmt: skip
def test_joints_that_are_not_taken_are_refused(kind, message):
    model = pin.Model()
    model.appendBodyToJoint(model.addJoint(0, kind, pin.SE3.Identity(), "odd"), pin.Inertia.Random(), pin.SE3.Random())
    with pytest.raises(ModelError, match=f"the joint 'odd' is a {message}"):
        Mechanism.of(model)


def test_mistakes_are_told():
    model = undamped("ur5", False)
    with pytest.raises(InputError, match=r"mechanism: loops\.a\.between"):
        Mechanism.of(model, loops={"a": {"kind": "revolute", "between": ["tool0"], "axis": "z"}})
    with pytest.raises(InputError, match="no link 'tool1'"):
        Mechanism.of(model, points={"tip": {"link": "tool1", "at": [0, 0, 0]}})
    with pytest.raises(InputError, match="has a link 'tool0' already"):
        Mechanism.of(model, points={"tool0": {"link": "tool0", "at": [0, 0, 0]}})
    with pytest.raises(ModelError, match="the model has no joint"):
        Mechanism.of(pin.Model())
    model.gravity.angular = np.array([1.0, 0.0, 0.0])
    with pytest.raises(ModelError, match="angular part"):
        Mechanism.of(model)
