"""The robots of example-robot-data, by name."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pinarm.errors import ModelError, choices
from pinarm.input.roots import example_robot_data

NAMES = {
    "alexander": "alexander_v1.lowerBodyOnly", "asr_twodof": "TwoDofs", "anymal_kinova": "anymal-kinova",
    "b1_z1": "b1-z1", "cassie": "cassie_v2", "borinot": "borinot_flying_arm_2", "g1": "g1_29dof_rev_1_0",
    "g1_with_hands": "g1_29dof_with_hand_rev_1_0", "hector": "quadrotor_base", "hextilt": "hextilt_flying_arm_5",
    "hyq": "hyq_no_sensors", "iris": "iris_simple", "solo8": "solo", "talos": "talos_reduced",
    "talos_arm": "talos_left_arm", "talos_box": "talos_reduced_box", "talos_full": "talos_full_v2",
    "talos_full_box": "talos_full_v2_box", "ur3_limited": "ur3_joint_limited_robot", "ur3": "ur3_robot",
    "ur5_limited": "ur5_joint_limited_robot", "ur10_limited": "ur10_joint_limited_robot",
}  # fmt: skip
"""Names in the package's own loaders -> file names, where these differ."""

FLOATING = frozenset({
    "a1", "alexander", "anymal_b_simple", "anymal_c_simple", "b1", "bolt", "borinot", "cassie", "centauro", "g1", "go1",
    "go2", "hector", "hextilt", "human", "hyq", "icub", "iris", "laikago", "pr2", "quadruped", "romeo",
    "simple_humanoid", "so_arm", "solo", "talos_data",
})  # fmt: skip
"""Folders, without ``_description``, whose robots have a free-flyer in the package's own loaders."""

ENDINGS = (".urdf", ".xacro", ".xml", ".mjcf", ".sdf")
"""Endings of model files; what has none of them is the name of a robot."""

HELD = frozenset({"talos_left_arm"})
"""Files in such folders whose robots are fixed to the ground."""


@cache
def robots() -> dict[str, Path]:
    """Return the model files by name: the file's, with and without ``_robot`` at its end, and the loader's."""
    folder = example_robot_data() / "robots"
    files: dict[str, Path] = {}
    places = sorted(folder.glob("*/*/*.*"))
    for file in (file for file in places if file.suffix == ".urdf"):
        files.setdefault(file.stem, file)
        files.setdefault(file.stem.removesuffix("_robot"), file)
    for file in (file for file in places if file.suffix == ".sdf"):
        files.setdefault(file.stem, file)
    files.update({name: files[stem] for name, stem in NAMES.items() if stem in files})
    if (other := folder / "anymal_c_simple_description" / "urdf" / "anymal.urdf").is_file():
        files["anymal_c"] = other  # its file has the same name as that of the older robot
    return files


def robot(name: str) -> Path:
    """Return the model file of a robot."""
    files = robots()
    if name in files:
        return files[name]
    expected, hint = choices(name, files, most=100)
    raise ModelError(
        f"there is no robot '{name}'", expected=f"a file that ends in {', '.join(ENDINGS)}, or {expected}", hint=hint
    )


def is_floating(file: Path) -> bool:
    """Return whether the robot of a model file of the package has a floating base: a legged or flying robot."""
    folder = file.parents[1].name.removesuffix("_description")
    return folder in FLOATING and file.stem not in HELD
