import re

import numpy as np
import pinocchio as pin
import pytest

from pinarm.errors import ModelError
from pinarm.mechanics.loading.pinocchio_model import build_model

PENDULUM = {"name": "arm", "axis": "0 1 0", "mass": 2.0, "com": "0.5 0 0", "inertia": (0.1, 0.2, 0.2)}


def refusal(xml):
    with pytest.raises(ModelError) as caught:
        build_model(xml)
    return caught.value


@pytest.mark.parametrize(
    ("part", "broken", "message"),
    [
        ('mass value="2.0"', 'mass value="-2"', "link 'arm_link': the mass is negative (-2 kg)"),
        ('mass value="2.0"', "mass", "link 'arm_link': mass is missing"),
        ('iyz="0"', 'iyz="0.3"', "link 'arm_link': a principal moment of inertia is negative (-0.1 kg*m^2)"),
        ('axis xyz="0 1 0"', 'axis xyz="0 0 0"', "joint 'arm': its axis is 0 0 0"),
        ('parent link="base"', 'parent link="bass"', "joint 'arm': its parent link 'bass' does not exist"),
        ('type="continuous"', 'type="fixed"', "the model has no joint that moves"),
        ("</robot>", "", "this is not XML: "),
    ],
)  # fmt: skip
def test_defects_are_refused(chain, part, broken, message):
    xml = chain(PENDULUM)
    assert part in xml
    assert refusal(xml.replace(part, broken)).message.startswith(message)


def test_damping_is_read_and_applied(mechanism, chain):
    arm = mechanism(chain({**PENDULUM, "damping": 0.7}))
    q, v = np.array([0.3]), np.array([1.7])
    inertia = 0.2 + 2.0 * 0.5**2
    expected = (-0.7 * 1.7 + 2.0 * 9.81 * 0.5 * np.cos(0.3)) / inertia  # about y, x turns towards -z
    assert arm.forward(q, v)[0] == pytest.approx(expected, rel=1e-14)
    assert arm.inverse(q, v, np.array([expected]))[0] == pytest.approx(0.0, abs=1e-14)


def test_what_is_not_modelled_is_noted(chain):
    xml = chain(PENDULUM, {**PENDULUM, "name": "second"}).replace('damping="0.0"', 'damping="0" friction="0.2"', 1)
    notes = build_model(xml, creep=0.002).notes
    assert any(note.startswith("dry friction F of joint arm is regularised, F tanh(v / 0.002)") for note in notes)
    sticking = build_model(xml)
    assert (sticking.notes, sticking.friction, sticking.forces.keys()) == ((), {"arm": 0.2}, set())
    assert build_model(chain(PENDULUM)).notes == ()


@pytest.mark.parametrize("mass", ["1e-15"])
def test_bodies_whose_centres_pinocchio_would_lose_are_refused(chain, mass):
    """The sum of an inertia with nothing keeps its centre of mass down to a mass of 2.2e-16 only."""
    found = refusal(re.sub('mass value="[^"]*"', f'mass value="{mass}"', chain(PENDULUM)))
    assert found.message == f"what joint 'arm' carries has a mass of {float(mass):.3g} kg"
    assert build_model(re.sub('mass value="[^"]*"', 'mass value="1e-14"', chain(PENDULUM)), defects="noted")


CONNECTED = """<mujoco><worldbody>
<body name="a"><joint name="j" type="hinge" axis="0 0 1"/><geom size="0.1" pos="1 0 0"/></body>
<body name="b" pos="2 0 0"><joint name="k" type="hinge" axis="0 0 1"/><geom size="0.1" pos="-1 0 0"/></body></worldbody>
<equality><connect name="c" body1="a" body2="b" anchor="{place} 0 0"/></equality></mujoco>"""
CLOSED = """<sdf version="1.7"><model name="m">
<link name="a"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial></link>
<link name="b"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial></link>
<joint name="j" type="revolute"><parent>world</parent><child>a</child><axis><xyz>0 0 1</xyz></axis></joint>
<joint name="k" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz></axis></joint>
<joint name="c" type="revolute"><pose>{place} 0 0 0 0 0</pose><parent>world</parent><child>b</child>
<axis><xyz>0 0 1</xyz></axis></joint></model></sdf>"""


@pytest.mark.parametrize("text", [CONNECTED, CLOSED])
def test_places_of_loop_joints_are_not_beyond_all_lengths(text):
    assert set(build_model(text.format(place="1")).tree.loops) == {"c"}
    assert "loop 'c': its distance is 1e+60 m" in refusal(text.format(place="1e60")).message


URDF_AXIS = (
    '<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="2" izz="3"/>'
    '</inertial></link><joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="{}"/></joint>'
    "</robot>"
)
SDF_AXIS = (
    '<sdf version="1.9"><model name="m"><link name="b"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>2</iyy>'
    '<izz>3</izz></inertia></inertial></link><joint name="j" type="revolute"><parent>world</parent><child>b</child>'
    "<axis><xyz>{}</xyz></axis></joint></model></sdf>"
)
MJCF_AXIS = (
    '<mujoco><worldbody><body name="b"><inertial pos="0 0 0" mass="1" diaginertia="1 2 3"/><joint name="j" axis="{}"/>'
    "</body></worldbody></mujoco>"
)


@pytest.mark.parametrize("text", [URDF_AXIS, SDF_AXIS, MJCF_AXIS])
@pytest.mark.parametrize("axis", ["0 1e99 0", "0 1e-200 0"])
def test_axes_of_any_length_are_directions(text, axis):
    """Squares of 1e200 are beyond all numbers, and those of 1e-200 are 0: the joint would not turn the body."""

    model = build_model(text.format(axis)).model
    assert pin.crba(model, model.createData(), np.zeros(1)) == pytest.approx(2.0)
