"""What files say of friction: sizes, units, joints, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError, UnitError
from pinarm.input.units import unit
from pinarm.input.yaml.schema import Measured
from pinarm.mechanics.friction.definition import Friction

CHAIN = ({"name": "turn", "axis": "0 1 0"}, {"name": "slide", "kind": "prismatic", "axis": "0.6 0 0.8"},
         {"name": "end", "axis": "0 1 0", "at": "1 0 0"})  # fmt: skip


@pytest.mark.parametrize(("given", "said"), [
    ({"mu": 0.2, "static_mu": 0.1}, "friction at rest, 0.1, is below that of slip, 0.2"),
    ({"constant": 2.0, "static_constant": 1.0}, "friction at rest, 1, is below"),
    ({"preload": -1.0}, "-1 is out of bounds"),
])  # fmt: skip
def test_impossible_friction_is_refused(given, said):
    with pytest.raises(InputError, match=said):
        Friction(**given)


def test_what_a_joint_needs_is_asked_for(chain, mechanism):
    built = mechanism(chain(*CHAIN))
    with pytest.raises(InputError, match="mu of a joint that turns needs the radius"):
        Friction(mu=0.1).bind("turn", built.model, built.joints, ())
    with pytest.raises(InputError, match="a joint that slides has no thrust_radius"):
        Friction(mu=0.1, thrust_radius=0.1).bind("slide", built.model, built.joints, ())
    with pytest.raises(InputError, match="there is no joint 'tunr'"):
        Friction(constant=1.0).bind("tunr", built.model, built.joints, ())
    newton = Measured(3.0)
    newton.unit = unit("N")
    Friction(constant=newton).bind("slide", built.model, built.joints, ())
    with pytest.raises(UnitError, match="not a unit of this quantity"):
        Friction(constant=newton).bind("turn", built.model, built.joints, ())


def test_friction_of_the_file_takes_the_place_of_that_of_the_model(chain, mechanism):
    text = chain(*CHAIN).replace('damping="0.0"', 'damping="0" friction="3"')
    built = mechanism(text, friction={"slide": {"constant": "5 N", "mu": 0.1}})
    laws = {one.name: (one.law.constant, one.law.mu) for one in built.frictions}
    assert laws == {"joint.slide": (5.0, 0.1), "joint.turn": (3.0, 0.0), "joint.end": (3.0, 0.0)}
    assert "joint friction" not in built.forces
    regularised = mechanism(text, creep="0.01 rad/s")
    assert regularised.frictions == ()
    assert "joint friction" in regularised.forces


def test_a_ball_and_a_sleeve_say_their_sizes(chain, mechanism):
    loops = {"ball": {"kind": "spherical", "between": ["base", "end_link"]}}
    with pytest.raises(InputError, match="needs the radius of its ball"):
        mechanism(chain(*CHAIN), loops=loops, friction={"ball": {"mu": 0.1}})
    with pytest.raises(InputError, match="a ball joint has no span"):
        mechanism(chain(*CHAIN), loops=loops, friction={"ball": {"mu": 0.1, "radius": "1 m", "span": "1 m"}})
    loops = {"sleeve": {"kind": "cylindrical", "between": ["base", "end_link"]}}
    with pytest.raises(InputError, match="needs the radius at which it slips"):
        mechanism(chain(*CHAIN), loops=loops, friction={"sleeve": {"mu": 0.1}})
    given = mechanism(chain(*CHAIN), loops=loops, friction={"sleeve": {"mu": 0.1, "radius": "20 mm"}}).frictions
    assert [one.quantity for one in given] == ["loop.sleeve.friction.tangential", "loop.sleeve.friction.axial"]


def test_none_takes_the_friction_of_the_model_away(tmp_path: Path) -> None:
    """A slide of 2 kg under 10 N, with 4 N of friction and without, by Newton's law; smoothed friction likewise."""
    (tmp_path / "slide.urdf").write_text(
        '<robot name="slide"><link name="base"/><link name="block"><inertial><mass value="2"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="x" type="prismatic">'
        '<parent link="base"/><child link="block"/><axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="9" '
        'velocity="9"/><dynamics friction="4"/></joint></robot>'
    )
    for keys, wanted in (({}, 3.0), ({"friction": "none"}, 5.0), ({"friction": "none", "creep": "1 mm/s"}, 5.0)):
        slide = pinarm.Mechanism.load(tmp_path / "slide.urdf", values=keys)
        assert slide.forward(np.zeros(1), np.ones(1), np.full(1, 10.0)) == pytest.approx(wanted, rel=1e-12)
        assert not slide.notes
