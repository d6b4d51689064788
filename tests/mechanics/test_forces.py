import typing

import numpy as np
import pytest

from pinarm.errors import InputError, UnitError
from pinarm.input.schema import Measured
from pinarm.input.units import unit
from pinarm.mechanics.coordinates import joints_of
from pinarm.mechanics.forces import Force
from pinarm.mechanics.forces.joint import JointEffort, JointSpring
from pinarm.mechanics.laws import Harmonic, Trapezoid
from pinarm.mechanics.model import build_model

MEMBERS = typing.get_args(typing.get_args(Force)[0])
SAMPLES = {
    JointSpring: [
        JointSpring(kind="joint_spring", joint="turn", stiffness=30.0, damping=0.7, rest=0.2),
        JointSpring(kind="joint_spring", joint="slide", stiffness=200.0, rest=-0.1),
        JointSpring(kind="joint_spring", joint="slide", damping=4.0),
    ],
    JointEffort: [
        JointEffort(kind="joint_effort", joint="turn", effort=Harmonic(mean=1.0, amplitude=3.0, pulsation=2.0)),
        JointEffort(kind="joint_effort", joint="slide", effort=Trapezoid(start=-2.0, end=5.0, acceleration=4.0)),
    ],
}
every_force = pytest.mark.parametrize(
    "force",
    [pytest.param(force, id=f"{member.__name__} {k}") for member in SAMPLES for k, force in enumerate(SAMPLES[member])],
)


@pytest.fixture
def model(chain):
    bodies = ({"name": "turn"}, {"name": "slide", "kind": "prismatic", "axis": "1 0 0"})
    return build_model(chain(*bodies)).model


@pytest.fixture
def joints(model):
    return joints_of(model)


def motion(t):
    """A smooth motion of both joints: q and v, each of shape (..., 2)."""
    x = np.asarray(t)[..., None] * np.array([1.3, 2.1]) + np.array([0.4, 1.0])
    return np.sin(x), np.array([1.3, 2.1]) * np.cos(x)


def load(element, t, q, v):
    tau = np.zeros_like(v)
    element.add_load(t, q, v, tau)
    return tau


def bound(force, model, joints):
    """Return the element of a force on a stretch between two breakpoints of every sample."""
    return force.bind(model, joints).on(0.1, 0.9)


def test_every_force_of_the_union_has_a_sample():
    assert set(SAMPLES) == set(MEMBERS)
    assert all(type(force) is member for member, forces in SAMPLES.items() for force in forces)


@every_force
def test_power_of_the_load_is_what_leaves_the_potential_and_is_not_dissipated(force, model, joints, differentiate):
    element = bound(force, model, joints)
    worked = 0.0
    for t in np.linspace(0.2, 0.8, 9):
        q, v = motion(t)
        power = float(load(element, t, q, v) @ v)
        change = differentiate(lambda x: element.potential_energy(motion(x)[0]), t)
        # differences of order 8 at h = 0.02, of energies up to 100 J
        assert power == pytest.approx(-change - element.dissipated_power(t, q, v), abs=1e-9)
        worked = max(worked, abs(power))
    assert worked > 1.0, "the motion must make the element work"


@every_force
def test_many_states_at_once_are_the_same_as_one_by_one(force, model, joints):
    element = bound(force, model, joints)
    t = np.linspace(0.2, 0.8, 6)
    q, v = motion(t)
    many = load(element, t, q, v), element.potential_energy(q), element.dissipated_power(t, q, v)
    for k in range(len(t)):
        one = (
            load(element, t[k], q[k], v[k]),
            element.potential_energy(q[k]),
            element.dissipated_power(t[k], q[k], v[k]),
        )
        for together, alone in zip(many, one, strict=True):
            assert np.array_equal(together[k], alone)
    assert [x.shape for x in many] == [(6, 2), (6,), (6,)]


@every_force
def test_load_is_added_to_what_is_there(force, model, joints):
    element, (q, v) = bound(force, model, joints), motion(0.5)
    tau = np.array([10.0, 20.0])
    element.add_load(0.5, q, v, tau)
    assert tau == pytest.approx(np.array([10.0, 20.0]) + load(element, 0.5, q, v), abs=1e-14)


@every_force
def test_load_acts_at_the_named_joint_only(force, model, joints):
    q, v = motion(0.5)
    other = 1 - joints[force.joint].v
    assert load(bound(force, model, joints), 0.5, q, v)[other] == 0.0


@every_force
def test_unknown_joints_are_refused(force, model, joints):
    with pytest.raises(InputError, match="no joint 'trun'"):
        force.model_copy(update={"joint": "trun"}).bind(model, joints)


def test_spring_and_damper_by_hand(model, joints):
    element = SAMPLES[JointSpring][0].bind(model, joints)
    q, v = np.array([0.5, 9.0]), np.array([-2.0, 9.0])
    assert load(element, 0.0, q, v) == pytest.approx([-30.0 * 0.3 + 0.7 * 2.0, 0.0])
    assert element.potential_energy(q) == pytest.approx(0.5 * 30.0 * 0.3**2)
    assert element.dissipated_power(0.0, q, v) == pytest.approx(0.7 * 4.0)
    assert element.laws() == []


def test_effort_is_its_law_on_each_side_of_a_jump(model, joints):
    law = Trapezoid(start=0.0, end=1.0, acceleration=1.0, begin=0.5)
    element = JointEffort(kind="joint_effort", joint="turn", effort=law).bind(model, joints)
    q, v = motion(0.0)
    assert element.laws() == [law]
    assert load(element.on(1.5, 2.5), 1.0, q, v)[0] == pytest.approx(1.0 - 0.5 * 1.5**2)
    assert load(element.on(0.5, 1.5), 1.0, q, v)[0] == pytest.approx(0.125)
    with pytest.raises(ValueError, match="on a stretch of time"):
        load(element, 1.0, q, v)


def measured(value, text):
    number = Measured(value)
    number.unit = unit(text)
    return number


UNITS = {
    "turn": {"stiffness": "N*m/rad", "damping": "N*m*s/rad", "rest": "deg"},
    "slide": {"stiffness": "N/mm", "damping": "N*s/m", "rest": "mm"},
}


@pytest.mark.parametrize("field", ["stiffness", "damping", "rest"])
@pytest.mark.parametrize(("joint", "other"), [("turn", "slide"), ("slide", "turn")])
def test_springs_check_their_units_against_the_joint(model, joints, joint, other, field):
    JointSpring(kind="joint_spring", joint=joint, **{field: measured(1.0, UNITS[joint][field])}).bind(model, joints)
    with pytest.raises(UnitError, match="not a unit of this quantity"):
        JointSpring(kind="joint_spring", joint=joint, **{field: measured(1.0, UNITS[other][field])}).bind(model, joints)


@pytest.mark.parametrize(("joint", "right", "wrong"), [("turn", "N*m", "N"), ("slide", "kN", "N*m")])
def test_efforts_check_their_units_against_the_joint(model, joints, joint, right, wrong):
    def effort(text):
        return JointEffort(
            kind="joint_effort", joint=joint, effort=Harmonic(amplitude=measured(1.0, text), pulsation=1.0)
        )

    effort(right).bind(model, joints)
    with pytest.raises(UnitError, match="not a unit of this quantity"):
        effort(wrong).bind(model, joints)


@pytest.mark.parametrize("field", ["stiffness", "damping"])
def test_springs_and_dampers_that_give_energy_away_are_refused(field):
    with pytest.raises(ValueError, match="greater than or equal to 0"):
        JointSpring(kind="joint_spring", joint="turn", **{field: -1.0})
