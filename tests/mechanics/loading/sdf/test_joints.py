"""Universal joints, screws, gearboxes of SDF: against rotations, closed forms, and loops of a mechanism file."""

import math

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.errors import ModelError
from pinarm.mechanics.loading.pinocchio_model import build_model
from pinarm.use.mechanism import Mechanism

MOMENTS = "<ixx>0.02</ixx><iyy>0.03</iyy><izz>0.04</izz>"


def link(name, pose="0 0 0 0 0 0", mass=1.5, com="0 0 0 0 0 0"):
    inertia = f"<pose>{com}</pose><mass>{mass}</mass><inertia>{MOMENTS}</inertia>"
    return f'<link name="{name}"><pose>{pose}</pose><inertial>{inertia}</inertial></link>'


def joint(name, parent, child, kind="revolute", axis="0 0 1", inside="", pose=""):
    return (
        f'<joint name="{name}" type="{kind}"><pose>{pose}</pose><parent>{parent}</parent><child>{child}</child>'
        f"<axis><xyz>{axis}</xyz></axis>{inside}</joint>"
    )


def sdf(*parts, gravity="0 0 -9.81"):
    return (f'<sdf version="1.10"><world name="w"><gravity>{gravity}</gravity><model name="m">{"".join(parts)}</model>'
            "</world></sdf>")  # fmt: skip


def loaded(folder, xml, **values):
    (folder / ".pinarm-root").touch()
    (folder / "m.sdf").write_text(xml)
    return Mechanism.load(folder / "m.sdf", values=values or None)


AXIS2 = "<axis2><xyz>0 1 0</xyz><limit><lower>-0.5</lower><upper>0.7</upper></limit>\
<dynamics><damping>0.2</damping></dynamics></axis2>"


@pytest.mark.parametrize("kind", ["universal"])
def test_a_universal_joint_is_two_revolute_ones(kind):
    """Placements of the child by rotations about x, then y, written out here."""
    model = build_model(sdf(link("a", "0.1 0.2 0.3 0 0 0.4"), joint("u", "world", "a", kind, "1 0 0", AXIS2))).model
    assert [*model.names][1:] == ["u.axis", "u.axis2"]
    assert model.damping.tolist() == [0.0, 0.2]
    assert (model.lowerPositionLimit[1], model.upperPositionLimit[1]) == (-0.5, 0.7)
    data, q = model.createData(), np.array([0.6, -0.3])
    pin.framesForwardKinematics(model, data, q)
    drawn = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.4), np.array([0.1, 0.2, 0.3]))
    turned = drawn.rotation @ pin.rpy.rpyToMatrix(0.6, 0.0, 0.0) @ pin.rpy.rpyToMatrix(0.0, -0.3, 0.0)
    placed = data.oMf[model.getFrameId("a")]
    assert placed.rotation == pytest.approx(turned, abs=1e-15)
    assert placed.translation == pytest.approx(drawn.translation, abs=1e-15)


@pytest.mark.parametrize(("kind", "inside", "q"), [
    ("universal", AXIS2, {"u.axis": 0.6, "u.axis2": -0.3}),
    ("screw", "<screw_thread_pitch>0.5</screw_thread_pitch>", {"u": 0.6, "u.slide": 0.6 * 0.5 / (2 * math.pi)}),
])  # fmt: skip
def test_a_joint_that_leads_inwards_keeps_its_coordinates(kind, inside, q):
    """From a to b, where b hangs in the world: b against a is what it is where a hangs in the world."""
    parts = link("a", "0 0 0.2 0.1 0 0"), link("b", "0.4 0 0 0 0.2 0"), joint("u", "a", "b", kind, "1 0 0", inside)
    between = []
    for held in "ab":
        model = build_model(sdf(*parts, joint("w", "world", held))).model
        values = np.zeros(model.nq)
        for name, value in q.items():
            values[model.joints[model.getJointId(name)].idx_q] = value
        data = model.createData()
        pin.framesForwardKinematics(model, data, values)
        a, b = (data.oMf[model.getFrameId(name)] for name in "ab")
        between.append(a.actInv(b).homogeneous)
    assert between[0] == pytest.approx(between[1], abs=1e-14)


@pytest.mark.parametrize(("inside", "lead"), [
    ("<screw_thread_pitch>-0.5</screw_thread_pitch>", -0.5), (f"<thread_pitch>{-4 * math.pi!r}</thread_pitch>", 0.5),
])  # fmt: skip
def test_a_nut_falls_on_its_thread(tmp_path, inside, lead):
    """h = lead / (2 pi): (I + m h^2) theta'' = -m g h, from the power of the weight."""
    mechanism = loaded(tmp_path, sdf(link("nut"), joint("s", "world", "nut", "screw", "0 0 1", inside)))
    problem = {"kind": "forward", "time": {"end": "1 s", "samples": 3}}
    run = pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem,
                      "outputs": ["s", "s.slide", "coupling.s.axial"]})  # fmt: skip
    h = lead / (2 * math.pi)
    fall = -1.5 * 9.81 * h / (0.04 + 1.5 * h**2)
    assert run["s"].values == pytest.approx(fall * np.array([0.0, 0.5, 1.0]) ** 2 / 2, abs=1e-9)
    assert run["s.slide"].values == pytest.approx(h * run["s"].values, abs=1e-12)
    held = 1.5 * (9.81 + h * fall)  # what the thread holds of the weight
    assert np.abs(run["coupling.s.axial"].values) == pytest.approx(np.full(3, held), abs=1e-8)
    assert any("rad/m" in note for note in run.notes()) == ("<thread_pitch>" in inside)


@pytest.mark.parametrize(("kind", "inside", "loop"), [
    ("screw", "<screw_thread_pitch>0.1</screw_thread_pitch>", {"kind": "screw", "axis": "x", "lead": "0.1 m"}),
    ("universal", "<axis2><xyz>0 1 0</xyz></axis2>", {"kind": "universal", "axes": ["x", "y"]}),
])  # fmt: skip
def test_joints_that_close_loops_hold_what_those_of_a_mechanism_file_do(tmp_path, kind, inside, loop):
    """Rows at random configurations; the frames of the joint are those of the file."""
    tree = (link("a"), link("b", "0.3 0 0 0 0 0"), link("c", "0.3 0.2 0 0 0 0"), joint("A", "world", "a", "ball"),
            joint("B", "a", "b", "ball"), joint("C", "world", "c", "ball"))  # fmt: skip
    at = '<frame name="p" attached_to="c"><pose relative_to="b">0.1 0 0 0.2 0 0</pose></frame>'
    closing = joint("L", "c", "b", kind, "1 0 0", inside, pose="0.1 0 0 0.2 0 0")
    closed = loaded(tmp_path, sdf(*tree, at, closing))
    (tmp_path / "m.yaml").write_text("pinarm: 1\nrobot: m.sdf\n")
    between = [closed.model.frames[frame].name for frame in (closed.constraints[0].first, closed.constraints[0].second)]
    assert between == ["L_1", "L_2"]
    own = closed.constraints[0]
    said = pinarm.Mechanism.load(tmp_path / "m.yaml", values={"loops": {"M": {**loop, "between": between}}})
    other = next(one for one in said.constraints if one.name == "M")
    rng = np.random.default_rng(5)
    for _ in range(3):
        q = pin.integrate(closed.model, pin.neutral(closed.model), rng.normal(size=closed.model.nv) / 3)
        state = closed.closure.state(q)
        assert own.gap(state) == pytest.approx(other.gap(said.closure.state(q)), abs=1e-14)
        assert own.rows(state) == pytest.approx(other.rows(said.closure.state(q)), abs=1e-14)
    assert np.abs(own.gap(closed.closure.state(pin.neutral(closed.model)))).max() < 1e-15  # closed as drawn


BOX = (
    "<gearbox_ratio>{ratio}</gearbox_ratio><gearbox_reference_body>{body}</gearbox_reference_body>"
    "<axis2><xyz>{second}</xyz></axis2>"
)


@pytest.mark.parametrize(("ratio", "second", "turned", "expected"), [
    (4.0, "0 0 -1", False, 4.0), (-4.0, "0 0 1", False, 4.0), (4.0, "0 0 1", True, 4.0),
])  # fmt: skip
def test_a_gearbox_turns_two_wheels(tmp_path, ratio, second, turned, expected):
    """theta_2 = -ratio theta_1; the effort at the first wheel for theta_1'' = a is (I + I ratio^2) a.

    ``turned``: the second joint leads from its wheel to the base, so that its coordinate is -theta_2.
    """
    ends = ("two", "base") if turned else ("base", "two")
    xml = sdf(
        link("base"), link("one"), link("two", "0.5 0 0 0 0 0"), joint("W", "world", "base", "fixed"),
        joint("A", "base", "one"), joint("B", *ends, pose="-0.5 0 0 0 0 0" if turned else ""),
        joint("box", "one", "two", "gearbox", inside=BOX.format(ratio=ratio, body="base", second=second)),
    )  # fmt: skip
    if turned:  # about the middle of the wheel
        xml = xml.replace("-0.5 0 0 0 0 0</pose>", "0.5 0 0 0 0 0</pose>")
    law = {"law": "constant_acceleration", "acceleration": "3 rad/s^2"}
    problem = {"kind": "inverse", "time": {"end": "1 s", "samples": 3}, "motion": {"A": law}, "drives": ["A"]}
    run = pinarm.run({"pinarm": 1, "mechanism": loaded(tmp_path, xml), "problem": problem,
                      "outputs": ["A", "B", "joint.A.effort"]})  # fmt: skip
    assert run["B"].values == pytest.approx(expected * run["A"].values, abs=1e-13)
    assert run["A"].values[-1] == pytest.approx(1.5)
    assert run["joint.A.effort"].values == pytest.approx(np.full(3, 3 * 0.04 * (1 + ratio**2)), abs=1e-12)


WHEELS = link("base"), link("one"), link("two"), joint("A", "base", "one"), joint("B", "base", "two", axis="0 1 0")
SKEW = "<axis2><xyz>1 1 0</xyz></axis2>"


@pytest.mark.parametrize(("parts", "message"), [
    ((link("a"), joint("s", "world", "a", "screw")), "joint 's': a screw without a pitch"),
    ((*WHEELS, joint("K", "one", "two", "gearbox", inside=BOX.format(ratio=2, body="base", second="0 0 1"))),
     "joint 'K': no revolute joint of the tree turns 'two' against 'base'"),
    ((*WHEELS, joint("u", "one", "two", "universal", "1 0 0", SKEW)), "its axes are not at right angles"),
])  # fmt: skip
def test_mistakes_are_told(parts, message):
    with pytest.raises(ModelError, match=message):
        build_model(sdf(*parts))
