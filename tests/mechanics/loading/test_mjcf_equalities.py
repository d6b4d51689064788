"""Equalities of MJCF: ``ties.json`` is what MuJoCo 4.0.0 computes for ``ties.xml``, as drawn and in another pose."""

import json
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import ModelError
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.use.mechanism import Mechanism
from pinarm.use.study.restore import restore

HERE = Path(__file__).parent / "mujoco"
MUJOCO = json.loads((HERE / "ties.json").read_text())
GEOM = '<geom size="0.1"/>'


@pytest.fixture(scope="module")
def ties():
    return Mechanism.load(HERE / "ties.xml")


def frame(mechanism, name, body):
    """The placement of a tied frame in its body."""
    frames = mechanism.model.frames
    own, other = (frames[mechanism.model.getFrameId(each, pin.FrameType.BODY)] for each in (body, name))
    return own.placement.actInv(other.placement)


def test_which_ties_there_are(ties):
    kinds = {constraint.name: constraint.kind for constraint in ties.constraints}
    assert kinds == {"pin": "spherical", "ground": "spherical", "as drawn": "fixed", "placed": "fixed",
                     "points": "spherical"}  # fmt: skip
    assert {"h", "s"} & {*ties.joints} == set()


@pytest.mark.parametrize(("name", "first", "second"), [("pin", "rod", "rocker"), ("ground", "rod", "world")])
def test_anchors_of_connects_are_mujocos(ties, name, first, second):
    data = MUJOCO["eq_data"][name]
    assert frame(ties, f"{name}_1", first).translation == pytest.approx(data[:3], abs=1e-15)
    assert frame(ties, f"{name}_2", second).translation == pytest.approx(data[3:6], abs=1e-14)


@pytest.mark.parametrize(("name", "first"), [("as drawn", "rocker"), ("placed", "crank")])
def test_poses_of_welds_are_mujocos(ties, name, first):
    """MuJoCo has the anchor in the second body, then the pose in the first: position, quaternion (w, x, y, z)."""
    data = MUJOCO["eq_data"][name]
    one, two = frame(ties, f"{name}_1", first), frame(ties, f"{name}_2", "plate")
    assert two.translation == pytest.approx(data[:3], abs=1e-15)
    assert one.translation == pytest.approx(data[3:6], abs=1e-14)
    assert one.rotation == pytest.approx(pin.Quaternion(*data[6:10]).normalized().matrix(), abs=1e-14)
    assert two.rotation == pytest.approx(np.eye(3), abs=1e-15)


def test_what_is_held_is_where_mujoco_has_it(ties):
    values = {name: MUJOCO["qpos"][name] for name in "abcd"}
    placed = ties.frame("held", ties.configurations(values))
    assert placed[:3, 3] == pytest.approx(MUJOCO["held"]["pos"], abs=1e-14)
    assert placed[:3, :3] == pytest.approx(np.array(MUJOCO["held"]["mat"]).reshape(3, 3), abs=1e-14)


@pytest.mark.parametrize("name", ["pin", "ground", "points"])
def test_gaps_of_connects_are_mujocos(ties, name):
    """MuJoCo's residual in the axes of the world, this one's in those of the first frame: lengths agree."""
    q = ties.configurations({name: MUJOCO["qpos"][name] for name in "abcd"})
    rows = ties.closure.slices[name]
    gap = ties.closure.gap(ties.closure.state(q))[rows]
    assert np.linalg.norm(gap) == pytest.approx(np.linalg.norm(MUJOCO["efc_pos"][name]), rel=1e-13)


def test_a_four_bar_of_mjcf_moves_as_one_closed_in_the_mechanism_file(tmp_path):
    """The same linkage with its loop in the model's file, and in the mechanism file; saved, and read again."""
    rod = '<geom size="0.1" pos="0.5 0 0.2"/>'
    arms = (
        f'<body name="crank"><joint name="a" axis="0 1 0"/>{rod}<body name="coupler" pos="0 0 1">'
        f'<joint name="b" axis="0 1 0"/>{rod}<site name="p" pos="2 0 0.5"/></body></body>'
        f'<body name="rocker" pos="2 0 0"><joint name="c" axis="0 1 0"/>{GEOM}<site name="q" pos="0 0 1.5"/></body>'
    )
    closing = '<equality><connect name="closing" body1="coupler" body2="rocker" anchor="2 0 0.5"/></equality>'
    loops = {"closing": {"kind": "spherical", "between": ["p", "q"]}}
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "closed.xml").write_text(f"<mujoco><worldbody>{arms}</worldbody>{closing}</mujoco>")
    (tmp_path / "open.xml").write_text(f"<mujoco><worldbody>{arms}</worldbody></mujoco>")
    problem = {"kind": "forward", "time": {"end": "0.5 s", "samples": 6}}
    data = {"pinarm": 1, "problem": problem, "outputs": ["a", "energy.total"]}
    own = pinarm.run({**data, "mechanism": Mechanism.load(tmp_path / "closed.xml")})
    said = pinarm.run({**data, "mechanism": Mechanism.load(tmp_path / "open.xml", values={"loops": loops})})
    assert own["a"].values == pytest.approx(said["a"].values, abs=1e-10)
    assert np.ptp(own["a"].values) > 0.1
    again = restore(own.save(tmp_path / "out", plots=False))
    assert again.trajectory.mechanism.constraints[0].kind == "spherical"
    assert again["energy.total"].values == pytest.approx(own["energy.total"].values, rel=1e-12)


def hinged_bodies(equality, turn=""):
    """Two bodies whose ends meet as drawn, with sites 1 and 2, and others 0.1 m along z from these."""
    sites = '<site name="{0}" pos="{1}" {2}/><site name="{0}_z" pos="{3}"/>'
    ends = (sites.format("closing_x_1", "1 0 0", "", "1 0 0.1"),
            sites.format("closing_x_2", "-1 0 0", turn, "-1 0 0.1"))  # fmt: skip
    return (
        f'<mujoco><worldbody><body name="a"><joint name="a" axis="0 0 1"/>{GEOM}{ends[0]}</body><body name="b" '
        f'pos="2 0 0"><joint name="b" type="ball"/>{GEOM}{ends[1]}</body></worldbody><equality>{equality}</equality>'
        "</mujoco>"
    )


Z = '<connect name="z" site1="closing_x_{}_z" site2="closing_x_{}_z"/>'
ONSHAPE = '<connect name="x" site1="closing_x_1" site2="closing_x_2"/>'
ANCHORS = "".join(
    f'<connect name="{name}" body1="a" body2="b" anchor="1 0 {z}"/>' for name, z in (("x", 0), ("z", 0.1))
)


@pytest.mark.parametrize(("equality", "turn"), [
    (ONSHAPE + Z.format(1, 2), ""), (ONSHAPE + Z.format(2, 1), ""), (ANCHORS, ""),
    (ONSHAPE + Z.format(1, 2), 'euler="30 20 10"'),
])  # fmt: skip
def test_two_connects_of_the_same_bodies_are_a_hinge(tmp_path, equality, turn):
    """onshape-to-robot closes loops by revolute joints so: two connects, the second 0.1 m along the axis.

    The two bodies turn about parallel axes: one freedom is left, of the hinge as of the two ball joints.
    """
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "m.xml").write_text(hinged_bodies(equality, turn))
    hinged = Mechanism.load(tmp_path / "m.xml")
    (hinge,) = hinged.constraints
    assert (hinge.name, hinge.kind, hinge.size) == ("x", "revolute", 5)
    assert any("x and z tie two points of the same bodies" in note for note in hinged.notes)
    assert not any("exporter" in note for note in hinged.notes)
    (tmp_path / "m.xml").write_text(hinged_bodies(ONSHAPE, turn))  # with the second tie apart, as a check of rows
    balls = Mechanism.load(tmp_path / "m.xml", values={"loops": {"z": {
        "kind": "spherical", "between": ["closing_x_1_z", "closing_x_2_z"]}}})  # fmt: skip
    q = pin.neutral(hinged.model)
    one, six = hinge.rows(hinged.closure.state(q)), np.vstack(
        [tie.rows(balls.closure.state(q)) for tie in balls.constraints])  # fmt: skip
    assert (six.shape, np.linalg.matrix_rank(six), np.linalg.matrix_rank(one)) == ((6, 4), 3, 3)
    assert np.linalg.matrix_rank(np.vstack([one, six])) == 3
    tilted = pin.integrate(hinged.model, q, np.array([0.0, 0.1, 0.0, 0.0]))  # about x, not about the hinge
    assert np.abs(hinge.gap(hinged.closure.state(tilted))).max() == pytest.approx(0.1)
    turned = pin.integrate(hinged.model, q, np.array([0.0, 0.0, 0.0, 0.1]))  # about z: only the place moves
    assert np.linalg.norm(hinge.gap(hinged.closure.state(turned))) == pytest.approx(2 * math.sin(0.05))


@pytest.mark.parametrize(("equality", "message"), [
    ('<connect body1="x" body2="b" anchor="0 0 0"/>', "equality 'x': there is no body 'x'"),
    ('<joint joint1="j" joint2="k" polycoef="0 1 2"/>', "equality 'j': it couples by a curve, which is not read"),
    ('<joint joint1="ball"/>', "equality 'ball': 'ball' is held, and is no hinge or slide"),
    ('<joint joint1="j" polycoef="0.1"/><joint joint1="j" joint2="k"/>',
     "equality 'j': 'j' is held or coupled by another equality already"),
])  # fmt: skip
def test_mistakes_are_told(equality, message):
    bodies = (f'<body name="b"><joint name="j"/>{GEOM}</body><body name="c"><joint name="k"/>{GEOM}</body>'
              f'<body name="d"><joint name="ball" type="ball"/>{GEOM}</body>')  # fmt: skip
    with pytest.raises(ModelError) as caught:
        build_model(f"<mujoco><worldbody>{bodies}</worldbody><equality>{equality}</equality></mujoco>")
    assert caught.value.message == message
