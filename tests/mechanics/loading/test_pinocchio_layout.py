"""States of ``pin.buildModelFromUrdf`` and of pinarm are the same motion of the same robot."""

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import InputError
from pinarm.use.mechanism import Mechanism

LINK = '<inertial><origin xyz="0.1 0.2 -0.1"/><mass value="{mass}"/>' + (
    '<inertia ixx="0.3" iyy="0.4" izz="0.5" ixy="0.01" ixz="0.02" iyz="-0.03"/></inertial>'
)
ORIGIN = '<origin xyz="0.3 -0.2 0.5" rpy="0.4 -0.7 1.1"/>'


def urdf(*joints: tuple[str, str]) -> str:
    """A chain of links, each on a joint of a type and an axis."""
    links = "".join(f'<link name="l{k}">{LINK.format(mass=k)}</link>' for k in range(1, len(joints) + 1))
    tied = "".join(
        f'<joint name="j{k}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/>{ORIGIN}<axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        for k, (kind, axis) in enumerate(joints)
    )
    return f'<robot name="chain"><link name="l0"/>{links}{tied}</robot>'


CHAIN = urdf(("planar", "0 0 1"), ("continuous", "1 2 3"), ("floating", "1 0 0"), ("prismatic", "0 1 0"),
             ("continuous", "0 0 1"), ("planar", "0 0 1"), ("floating", "1 0 0"), ("revolute", "1 0 1"))  # fmt: skip


def random_states(theirs: pin.Model, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """States of Pinocchio's model; positions within 3 m or the limits of the joints."""
    generator = np.random.default_rng(5)
    count = int(np.prod(shape))
    low, high = np.maximum(theirs.lowerPositionLimit, -3.0), np.minimum(theirs.upperPositionLimit, 3.0)
    q = generator.uniform(low, high, (count, theirs.nq))
    for joint in theirs.joints[1:]:
        unit = {7: slice(3, 7), 4: slice(2, 4), 2: slice(0, 2)}.get(joint.nq)
        if unit is not None:
            part = generator.normal(size=(count, unit.stop - unit.start))
            q[:, joint.idx_q :][:, unit] = part / np.linalg.norm(part, axis=1, keepdims=True)
    return q.reshape(*shape, -1), generator.normal(size=(*shape, theirs.nv))


@pytest.fixture
def pair(tmp_path, request):
    """A mechanism, and the model that Pinocchio's own reader makes of the same file."""
    name, floating = request.param
    values = {"base": "floating" if floating else "fixed"} if floating is not None else None
    if name == "chain":
        (tmp_path / "chain.urdf").write_text(CHAIN)
        name = tmp_path / "chain.urdf"
    mechanism = Mechanism.load(name, values=values)
    path = str(mechanism.source.robot)
    root = [pin.JointModelFreeFlyer()] if floating else []
    return mechanism, pin.buildModelFromUrdf(path, *root)


BOTH = [("talos", True), ("kinova", False), ("chain", None)]


@pytest.mark.parametrize("pair", BOTH, ids=str, indirect=True)
def test_links_are_and_move_where_pinocchio_has_them(pair):
    mechanism, theirs = pair
    p_q, p_v = random_states(theirs, (2, 3))
    q, v = mechanism.from_pinocchio(p_q, p_v)
    assert q.shape == (2, 3, mechanism.model.nq)
    assert v.shape == (2, 3, mechanism.model.nv)
    links = [frame.name for frame in theirs.frames if frame.type == pin.FrameType.BODY and frame.name != "universe"]
    assert len(links) > 4
    for k in np.ndindex(2, 3):
        ours, expected = moving(mechanism.model, links, q[k], v[k]), moving(theirs, links, p_q[k], p_v[k])
        assert ours == pytest.approx(expected, abs=1e-11)  # sums of some 30 products of numbers up to 10
        energy = pin.computeKineticEnergy(mechanism.model, mechanism.model.createData(), q[k], v[k])
        assert energy == pytest.approx(0.5 * p_v[k] @ masses(theirs, p_q[k]) @ p_v[k], rel=1e-11)


def moving(model: pin.Model, links: list[str], q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Placements and velocities of links, the latter in their own axes."""
    data = model.createData()
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    frames = [model.getFrameId(link, pin.FrameType.BODY) for link in links]
    velocities = [pin.getFrameVelocity(model, data, frame).vector for frame in frames]
    return np.concatenate([*(data.oMf[frame].homogeneous.ravel() for frame in frames), *velocities])


def masses(model: pin.Model, q: np.ndarray) -> np.ndarray:
    upper = np.triu(pin.crba(model, model.createData(), q))
    return upper + np.triu(upper, 1).T


class TestWhatCannotBeConverted:
    def test_what_is_no_direction(self, tmp_path):
        (tmp_path / "wheel.urdf").write_text(urdf(("continuous", "0 0 1")))
        with pytest.raises(InputError, match=r"\(cos, sin\) of 'j0' has the length 1\.1"):
            Mechanism.load(tmp_path / "wheel.urdf").from_pinocchio([1.1, 0.0])


@pytest.mark.parametrize("pair", [("chain", None)], indirect=True)
def test_configurations_in_the_shape_of_pinocchio_are_refused_with_what_converts_them(pair):
    mechanism, theirs = pair
    q, v = pin.neutral(theirs), np.zeros(theirs.nv)
    for use in (mechanism.mass_matrix, mechanism.at, mechanism.pin_data, lambda q: mechanism.forward(q, v),
                lambda q: mechanism.inverse(q, v, v)):  # fmt: skip
        with pytest.raises(InputError, match="the shape") as refused:
            use(q)
        assert "mechanism.from_pinocchio(q, v)" in refused.value.hint


def test_a_joint_without_limits_and_a_colour_beyond_one(tmp_path, capfd):
    """Pinocchio's reader refuses the one, which was a traceback of ``explain``, and writes about the other."""
    text = urdf(("revolute", "0 1 0"), ("continuous", "0 1 0"))
    limit = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'
    colour = '<visual><geometry><sphere radius="1"/></geometry><material name="m"><color rgba="255 0 0 1"/></material>'
    text = text.replace(limit, "").replace('<link name="l0"/>', f'<link name="l0">{colour}</visual></link>')
    (tmp_path / "chain.urdf").write_text(text)
    with pytest.raises(ValueError, match="does not contain a valid URDF model"):
        pin.buildModelFromXML(text)
    capfd.readouterr()
    assert "q and v: of j1 q has the angle" in str(pinarm.explain(tmp_path / "chain.urdf"))
    assert capfd.readouterr().err == ""


@pytest.mark.slow
def test_chains_that_would_fill_the_stack_of_pinocchios_reader_have_a_layout(tmp_path):
    """Of 3,700 links it ends the process."""
    (tmp_path / "deep.urdf").write_text(urdf(*[("continuous", "0 1 0")] * 1100))
    deep = Mechanism.load(tmp_path / "deep.urdf")
    q = deep.from_pinocchio(np.tile([0.0, 1.0], 1100), np.zeros(1100))[0]
    assert q == pytest.approx(np.full(1100, np.pi / 2), abs=1e-15)
