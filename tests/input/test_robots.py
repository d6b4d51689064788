import re

import pytest

from pinarm.errors import ModelError
from pinarm.input.roots import is_floating, robot, robots
from pinarm.use.mechanism import Mechanism

LOADERS = {
    "a1": 18, "alex_nub_hands": 19, "alex_psyonic_hands": 39, "alex_sake_hands": 23, "alexander": 19,
    "allegro_left_hand": 16, "allegro_right_hand": 16, "anymal": 18, "anymal_c": 18, "anymal_kinova": 24,
    "asr_twodof": 2, "b1": 18, "b1_z1": 25, "baxter": 19, "bolt": 12, "borinot": 8, "centauro": 45,
    "double_pendulum": 2, "double_pendulum_continuous": 2, "double_pendulum_simple": 2, "finger_edu": 3, "g1": 35,
    "g1_with_hands": 49, "go1": 18, "go2": 18, "hector": 6, "hextilt": 11, "human": 42, "hyq": 18, "icub": 38,
    "icub_reduced": 35, "iris": 6, "kinova": 6, "laikago": 18, "panda": 9, "panda_collision": 9, "pr2": 36,
    "quadruped": 14, "romeo": 61, "simple_humanoid": 35, "simple_humanoid_classical": 35, "so100": 12, "so101": 12,
    "solo12": 18, "solo8": 14, "talos": 38, "talos_arm": 7, "talos_box": 38, "talos_full": 50, "talos_full_box": 50,
    "tiago": 48, "tiago_dual": 101, "tiago_no_hand": 12, "tiago_pro": 33, "ur10": 6, "ur10_limited": 6, "ur3": 6,
    "ur3_gripper": 6, "ur3_limited": 6, "ur5": 6, "ur5_gripper": 6, "ur5_limited": 6, "xarm7": 7, "z1": 7,
}  # fmt: skip
"""Names of the package's own loaders, and the degrees of freedom: joints that move, and 6 where they float."""


FEW = ("double_pendulum", "iris", "panda", "so101", "solo12", "tiago", "ur3_gripper")
"""Fixed and floating, with continuous and coupled joints; all of them are among the slow tests."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in FEW else pytest.mark.slow) for name in LOADERS]
)
def test_a_robot_loads_by_the_name_that_its_package_gives_it(name):
    mechanism = Mechanism.load(name)
    assert mechanism.model.nv == LOADERS[name]
    floating = "root" in mechanism.balls
    assert floating == (mechanism.model.nq > mechanism.model.nv)
    assert floating == is_floating(robot(name))


@pytest.mark.slow
def test_the_other_files_of_the_package_load_but_the_one_without_a_robot():
    known = {robot(name) for name in LOADERS}
    others = {path: name for name, path in robots().items() if path not in known and path.stem != "ur3"}
    assert others
    for name in others.values():
        assert Mechanism.load(name).model.nv


def test_a_robot_that_has_no_urdf_is_read_from_its_sdf():
    mechanism = Mechanism.load("cassie")
    assert robot("cassie").name == "cassie_v2.sdf"  # as in the loader of the package
    assert len(mechanism.constraints) == 4
    masses = re.findall(r"<mass>(.*?)</mass>", robot("cassie").read_text())
    assert sum(body.mass for body in mechanism.model.inertias) == pytest.approx(sum(map(float, masses)))


def test_what_is_wrong_with_a_published_robot_is_noted_and_refused_in_a_file():
    hand = Mechanism.load("allegro_left_hand")
    assert any("link 'link_11.0': no body has principal moments" in note for note in hand.notes)
    with pytest.raises(ModelError, match="no body has principal moments"):
        Mechanism.load(robot("allegro_left_hand"))
