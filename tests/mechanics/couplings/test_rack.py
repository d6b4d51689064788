"""A rack and its pinion in closed form."""

import numpy as np
import pytest
from catalogue import disc
from motions import anywhere, free

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError
from pinarm.mechanics.forces.along_coordinate import JointEffort
from pinarm.mechanics.laws import Constant
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Statics

ALPHA, RADIUS, MASS, G = np.deg2rad(20.0), 0.04, 5.0, 9.81
SLIDER = f"""<link name="bar_link"><inertial><mass value="{MASS}"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="bar" type="prismatic"><parent link="base"/><child link="bar_link"/><origin xyz="0.3 0.5 0"/>
  <axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="1e6" velocity="1e6"/></joint>"""


def rack(mechanism, gravity="none", **more):
    xml = f'<robot name="rack"><link name="base"/>{disc("pinion", 0.3)}{SLIDER}</robot>'
    coupling = {"kind": "rack", "joints": ["pinion", "bar"], "radius": f"{RADIUS} m", **more}
    return mechanism(xml, gravity=gravity, couplings={"mesh": coupling})


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("push", [1.0, -1.0])
def test_a_push_on_the_rack_is_felt_by_the_pinion_and_both_are_pressed_apart(mechanism, side, push):
    """A rack along x that goes forwards while the pinion turns forwards, about z, touches it from below."""
    mesh = rack(mechanism, radius=f"{side * RADIUS} m", pressure_angle="20 deg")
    loads = {"push": JointEffort(joint="bar", effort=Constant(value=push * 50.0))}
    run = Statics(hold={"pinion": 0.0}, drives=["pinion"], loads=loads).solve(mesh, Accuracy(), anywhere).rows
    found = Quantities(run)
    assert found["joint.pinion.effort"].values == pytest.approx(-side * push * 50.0 * RADIUS, rel=1e-14)
    assert found["coupling.mesh.tangential"].values == pytest.approx(-push * 50.0, rel=1e-14)
    radial = 50.0 * np.tan(ALPHA)
    for joint, along, across in (("pinion", -push * 50.0, -side * radial), ("bar", push * 50.0, side * radial)):
        force = [found[f"joint.{joint}.force.{axis}"].values[0] for axis in "xyz"]
        assert force == pytest.approx([along, across, 0.0], rel=1e-12, abs=1e-12)
    # the rack's guide holds the moment of the teeth, at (0, -side r), about its own origin, at (0.3, 0.5): r x F
    moment = (-0.3) * (-side * radial) - (-side * RADIUS - 0.5) * (-push * 50.0)
    assert found["joint.bar.moment.z"].values == pytest.approx(-moment, rel=1e-12)


def test_teeth_at_a_helix_angle_push_along_the_pinion(mechanism):
    mesh = rack(mechanism, pressure_angle="20 deg", helix_angle="15 deg")
    loads = {"drive": JointEffort(joint="pinion", effort=Constant(value=50.0 * RADIUS))}
    found = Quantities(Statics(hold={"bar": 0.0}, loads=loads, drives=["bar"]).solve(mesh, Accuracy(), anywhere).rows)
    # the right-handed pinion drives forwards, about z, and is thrust along z: its bearing pushes back
    assert found["joint.pinion.force.z"].values == pytest.approx(-50.0 * np.tan(np.deg2rad(15.0)), rel=1e-12)
    apart = 50.0 * np.tan(ALPHA) / np.cos(np.deg2rad(15.0))
    assert found["coupling.mesh.radial"].values == pytest.approx(apart, rel=1e-12)


def test_a_falling_rack_turns_its_pinion(mechanism):
    mesh = rack(mechanism, {"direction": "x", "magnitude": f"{G} m/s^2"}, pressure_angle="20 deg")
    run = free(mesh)
    a = MASS * G / (MASS + 0.3 / RADIUS**2)
    assert run.a[:, mesh.joints["bar"].v] == pytest.approx(a, rel=1e-12)
    assert Quantities(run)["coupling.mesh.tangential"].values == pytest.approx(-0.3 * a / RADIUS**2, rel=1e-11)


def test_what_is_no_rack_is_refused(mechanism, gearbox):
    angled = {"kind": "rack", "joints": ["sun", "nut"], "radius": "4 cm", "pressure_angle": "20 deg"}
    with pytest.raises(InputError, match="nut does not slide across the axis of sun"):
        gearbox(it=angled)
    with pytest.raises(InputError, match="0 is out of bounds"):
        rack(mechanism, radius=0)
    with pytest.raises(InputError, match="a rack couples a revolute to a prismatic joint"):
        gearbox(it={"kind": "rack", "joints": ["sun", "wheel"], "radius": "4 cm"})
    with pytest.raises(InputError, match="no pressure_angle"):
        rack(mechanism, helix_angle="4 deg")
