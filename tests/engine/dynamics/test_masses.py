from contextlib import nullcontext

import pytest

from pinarm.errors import DynamicsError
from pinarm.mechanics.laws import Constant
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

ARM = {"name": "arm", "axis": "0 1 0", "com": "0.5 0 0", "inertia": (0.1, 0.2, 0.2)}
TOOL = {"name": "tool", "mass": 0.0, "inertia": (0.0, 0.0, 0.0)}


def run(mechanism, **content):
    return (
        Forward(time=TimeGrid(end=0.1, samples=3), **content)
        .solve(mechanism, Accuracy(), lambda *path: nullcontext())
        .rows
    )


def refusal(mechanism, **content):
    with pytest.raises(DynamicsError) as caught:
        run(mechanism, **content)
    return caught.value


def test_a_link_without_mass_at_the_end_is_named(mechanism, chain):
    error = refusal(mechanism(chain(ARM, TOOL)))
    assert error.message == "at t = 0 s joint tool can move without mass: accelerations are undetermined"


def test_a_point_on_the_axis_of_its_joint_is_found(mechanism, chain):
    error = refusal(mechanism(chain(ARM, {**TOOL, "mass": 3.0, "com": "0 0 0.3"})))
    assert error.message.startswith("at t = 0 s joint tool can move without mass")


def test_a_point_on_a_ball_joint_may_spin_about_its_own_line(tmp_path):
    (tmp_path / "bob.xml").write_text(
        '<mujoco><worldbody><body name="bob"><joint name="tip" type="ball"/>'
        '<inertial pos="0 0 -1" mass="1" diaginertia="0 0 0"/></body></worldbody></mujoco>')  # fmt: skip
    assert "joint tip.rotation.z can move without mass" in refusal(Mechanism.load(tmp_path / "bob.xml")).message


def test_an_inertia_that_no_body_has_may_be_negative_as_a_whole(mechanism, chain):
    bad = mechanism(chain({**ARM, "mass": 0.0, "inertia": (0.1, -0.2, 0.2)}), defects="noted")
    assert "joint arm can move against a negative mass" in refusal(bad).message


def test_intermediate_links_need_no_mass(mechanism, chain):
    run(mechanism(chain({**TOOL, "axis": "1 0 0"}, ARM)))


def test_rotors_are_masses_and_laws_need_none(mechanism, chain):
    drives = {"motor": {"joint": "tool", "ratio": 10, "rotor_inertia": "1e-6 kg*m^2"}}
    run(mechanism(chain(ARM, TOOL), drives=drives))
    run(mechanism(chain(ARM, TOOL)), motion={"tool": Constant(value=0.3)})


@pytest.mark.parametrize("ratio", [1e-8, 1e8])
def test_large_ratios_of_masses_are_no_lack_of_mass(mechanism, chain, ratio):
    inertia = (0.1 * ratio, 0.2 * ratio, 0.2 * ratio)
    run(mechanism(chain(ARM, {**ARM, "name": "tip", "at": "1 0 0", "mass": ratio, "inertia": inertia}), gravity="none"))
