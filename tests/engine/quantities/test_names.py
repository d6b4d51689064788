from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.input.formulas.expressions import Expression
from pinarm.mechanics.laws import ConstantSpeed, Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid
from pinarm.records import replace
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[3] / "models"
L0, L1, L2, M_A, M_BA, M_B, G = 0.5, 0.25, 0.25, 0.1, 1.0, 0.5, 9.81
MOTION = {
    "O": Harmonic(amplitude=0.8, pulsation=3.0, phase=0.3),
    "phi": Harmonic(mean=0.2, amplitude=1.1, pulsation=2.0),
}


def solve(mechanism, motion, end=2.0, samples=41):
    problem = Inverse(time=TimeGrid(end=end, samples=samples), motion=motion)
    return problem.solve(mechanism, Accuracy(), lambda *path: nullcontext()).rows


@pytest.fixture(scope="module")
def run():
    return solve(Mechanism.load(MODELS / "gen411_arm" / "mechanism.yaml"), MOTION)


@pytest.fixture
def found(run):
    return Quantities(run)


@pytest.fixture(scope="module")
def tip(run):
    """Motion of the tip by trigonometry: position, velocity, acceleration, each of shape (n, 2)."""
    theta, phi = (np.array(law.on(0.0, 2.0)(run.grid.t)) for law in MOTION.values())
    parts = []
    for length, (s, ds, dds) in ((L1, theta), (L2, phi)):
        along, across = np.stack([np.cos(s), np.sin(s)]), np.stack([-np.sin(s), np.cos(s)])
        parts.append(length * np.array([along, ds * across, dds * across - ds**2 * along]))
    return sum(parts) + np.array([[[0.0], [L0]], [[0.0], [0.0]], [[0.0], [0.0]]])


def test_every_name_that_is_offered_has_finite_values(run, found):
    names = found.names()
    assert len(names) > 50
    for name in names:
        values = found[name].values
        assert values.shape == (len(run),), name
        assert np.isfinite(values).all(), name


def test_points_move_as_trigonometry_says(found, tip):
    for k, rate in enumerate(("position", "velocity", "acceleration")):
        for axis, expected in zip("xy", tip[k], strict=True):
            assert found[f"point.A.{rate}.{axis}"].values == pytest.approx(expected, abs=1e-13)
        assert found[f"point.A.{rate}.z"].values == pytest.approx(0.0, abs=1e-14)
        assert found[f"point.A.{rate}.norm"].values == pytest.approx(np.hypot(*tip[k]), abs=1e-13)


def test_pin_at_the_motor_carries_rod_and_load(run, found, tip):
    """Newton's law for all that hangs on B: rod, load and motor."""
    theta = np.array(MOTION["O"].on(0.0, 2.0)(run.grid.t))
    along, across = np.stack([np.cos(theta[0]), np.sin(theta[0])]), np.stack([-np.sin(theta[0]), np.cos(theta[0])])
    at_b = L1 * (theta[2] * across - theta[1] ** 2 * along)
    force = M_B * at_b + M_BA * 0.5 * (at_b + tip[2]) + M_A * tip[2]
    force[1] += (M_A + M_BA + M_B) * G
    assert found["joint.B.force.x"].values == pytest.approx(force[0], abs=1e-12)
    assert found["joint.B.force.y"].values == pytest.approx(force[1], abs=1e-12)
    assert found["joint.B.moment.z"].values == pytest.approx(run.tau[:, 1], abs=1e-12)
    assert np.array_equal(found["joint.B.effort"].values, run.tau[:, 1])


def test_power_of_the_drives_is_the_change_of_energy(run, found, differentiate):
    def energy(t):
        law = [np.array(law.on(0.0, 2.0)(np.array([t])))[:, 0] for law in MOTION.values()]
        q, v = (np.array([[law[0][k], law[1][k] - law[0][k]]]) for k in (0, 1))
        return sum(run.dynamics.energy(q, v))[0]

    power = found["joint.O.power"].values + found["joint.B.power"].values
    for row in (5, 18, 33):
        # differences of order 8 at h = 0.02 s
        assert differentiate(energy, run.grid.t[row]) == pytest.approx(power[row], abs=1e-9)


def test_formulas_combine_quantities_symbols_and_arguments(run, found):
    expected = G * L2 * np.cos(run.q.sum(axis=1)) * (M_A + M_BA / 2)
    assert found["g*l2*cos(phi)*(m_A + m_BA/2)"].values == pytest.approx(expected, abs=1e-14)
    own = Quantities(run, {"twice": Expression.parse("2*C_B")})
    assert np.array_equal(own["twice"].values, 2 * run.tau[:, 1])
    assert own.figure("twice + 1") == pytest.approx(2 * run.tau[:, 1] + 1)


def test_a_symbol_that_needs_itself_is_refused(run):
    symbols = {"one": Expression.parse("two + 1"), "two": Expression.parse("one - 1")}
    with pytest.raises(InputError, match="defined by itself: one -> two"):
        Quantities(run, symbols)["one"]


@pytest.mark.parametrize(
    ("name", "asked", "message"),
    [
        ("phi", "phi", "'phi' is an argument of the model and a coordinate"),
        ("t", "2*t", "'t' is an argument of the model and what runs along the rows"),
        ("energy.total", "2*energy.total", "'energy.total' is an argument of the model and a quantity"),
        ("deg", "phi/deg", "'deg' is an argument of the model and a constant"),
    ],
)
def test_a_name_of_several_things_is_refused(run, name, asked, message):
    mechanism = replace(run.mechanism, arguments={**run.mechanism.arguments, name: 1.0})
    with pytest.raises(InputError, match=message):
        Quantities(replace(run, mechanism=mechanism))[asked]


SLIDE = """<robot name="slide"><link name="base"/><link name="carriage"><inertial><mass value="2"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial></link><joint name="{0}" type="prismatic">
<parent link="base"/><child link="carriage"/><origin xyz="0.1 0 0.2"/><axis xyz="1 0 0"/>
<limit effort="0" velocity="0"/>
</joint></robot>"""


def slide(folder, joint):
    (folder / "slide.urdf").write_text(SLIDE.format(joint))
    return solve(Mechanism.load(folder / "slide.urdf"), {joint: Harmonic(mean=0.5, amplitude=0.4, pulsation=2.0)})


def test_the_moment_of_a_sliding_joint_is_about_the_child_or_at_the_parent(tmp_path):
    """The weight hangs at the carriage: about the joint's place on the parent its arm is the way slid."""
    run = slide(tmp_path, "s")
    found, way = Quantities(run), run.q[:, 0]
    assert found["joint.s.moment.y"].values == pytest.approx(0.0, abs=1e-14)
    assert found["joint.s.moment.at_parent.y"].values == pytest.approx(-2.0 * G * way, abs=1e-13)
    assert found["joint.s.moment.about.base.y"].values == pytest.approx(  # the drive's force has an arm of 0.2 m
        -2.0 * G * (way + 0.1) + 0.2 * 2.0 * run.a[:, 0], abs=1e-13
    )


@pytest.mark.parametrize(
    ("joint", "asked", "message"),
    [
        ("t", "2*t", "'t' is a coordinate and what runs along the rows"),
        ("energy.total", "energy.total", "'energy.total' is a coordinate and a quantity of the mechanism"),
        ("all", "momentum.all.linear.x", "'momentum.all.linear.x': 'all' is a joint, and the whole mechanism"),
    ],
)
def test_a_joint_with_the_name_of_something_else_is_not_taken_for_it(tmp_path, joint, asked, message):
    run = slide(tmp_path, joint)
    found = Quantities(run)
    with pytest.raises(InputError) as caught:
        found[asked]
    assert caught.value.message == message
    assert found[f"joint.{joint}.position"].values == pytest.approx(run.q[:, 0], abs=0.0)
    assert found.parameter.values == pytest.approx(run.grid.t, abs=0.0)


SPRUNG = """pinarm: 1
planar: {points: {A: [0, 0], B: [0, 1 m], C: [0, 0]}, ground: [A, B], links: {slide: {points: [C], mass: 3 kg}},
  sliders: {lift: {link: slide, along: [A, B]}}}
forces:
  spring: {kind: joint_spring, joint: lift, stiffness: 5 N/mm, damping: 30 N*s/m, rest: -50 mm}
  push: {kind: joint_effort, joint: lift, effort: {law: harmonic, amplitude: 4 N, pulsation: 3 rad/s}}
  cam: {kind: joint_effort, joint: lift, over: lift, effort: {law: harmonic, amplitude: 7 N, pulsation: 9 1/m}}
"""


def test_elements_at_a_joint_have_the_efforts_of_their_laws(tmp_path):
    (tmp_path / "m.yaml").write_text(SPRUNG)
    speed, t = 0.2, np.linspace(0.0, 1.0, 11)
    found = Quantities(solve(Mechanism.load(tmp_path / "m.yaml"), {"lift": ConstantSpeed(speed=speed)}, 1.0, 11))
    for name, effort in {
        "spring": -5000.0 * (speed * t + 0.05) - 30.0 * speed,
        "push": 4.0 * np.sin(3.0 * t),
        "cam": 7.0 * np.sin(9.0 * speed * t),
    }.items():
        assert found[f"force.{name}.effort"].values == pytest.approx(effort, rel=1e-12, abs=1e-12)
        assert str(found[f"force.{name}.effort"].unit) == "N"
        assert found[f"power.{name}"].values == pytest.approx(effort * speed, rel=1e-12, abs=1e-12)
