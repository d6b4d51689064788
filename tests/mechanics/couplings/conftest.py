"""Gearboxes on a platform that swings: wheels, planets, spindles and racks, with or without masses."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pinarm.use.mechanism import Mechanism

PLACES = {  # joint: parent link, type, origin, axis
    "swing": ("base", "continuous", "0.1 0.2 0.3", "0.6 0 0.8"),
    "sun": ("swing_link", "continuous", "0.3 -0.1 0.2", "0 0 1"),
    "arm": ("swing_link", "continuous", "0.3 -0.1 0.2", "0 0 1"),
    "ring": ("swing_link", "continuous", "0.3 -0.1 0.2", "0 0 -1"),
    "wheel": ("swing_link", "continuous", "0.42 -0.01 0.2", "0 0 1"),
    "back": ("swing_link", "continuous", "0.42 0.06 0.25", "0 0 -1"),
    "cone": ("swing_link", "continuous", "0.5 -0.1 0.2", "1 0 0"),
    "skew": ("swing_link", "continuous", "0.5 0.1 0.3", "1 0 0"),
    "planet": ("arm_link", "continuous", "0.2 0.05 0", "0 0 1"),
    "nut": ("swing_link", "prismatic", "0.1 0.7 0", "0 0 1"),
    "bar": ("swing_link", "prismatic", "-0.4 0.3 0.1", "0.6 0.8 0"),
    "spindle": ("nut_link", "continuous", "0.02 0 0.1", "0 0 1"),
    "runner": ("sun_link", "prismatic", "0.01 0.02 0.3", "0 0 -1"),
}
MARKS = {"middle": ("swing_link", "0 0 0.33"), "face": ("swing_link", "0.5 -0.1 0.3"), "far": ("base", "1 1 1"),
         "tip": ("bar_link", "0.65 -0.38 0.05"), "nose": ("back_link", "-0.1 -0.1 0.02")}  # fmt: skip


def urdf(inertial: str = "") -> str:
    """The URDF of all of them; ``inertial`` is every link's."""
    parts = ['<link name="base"/>']
    for name, (parent, kind, at, axis) in PLACES.items():
        parts.append(
            f'<link name="{name}_link">{inertial}</link><joint name="{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{name}_link"/><origin xyz="{at}" rpy="0 0 0"/><axis xyz="{axis}"/>'
            '<limit lower="-9" upper="9" effort="1e6" velocity="1e6"/></joint>'
        )
    for name, (parent, at) in MARKS.items():
        parts.append(f'<link name="{name}"/><joint name="{name}_mark" type="fixed"><parent link="{parent}"/>'
                     f'<child link="{name}"/><origin xyz="{at}"/></joint>')  # fmt: skip
    return f'<robot name="gearbox">{"".join(parts)}</robot>'


@pytest.fixture
def gearbox(mechanism) -> Callable[..., Mechanism]:
    """Return a function that couples joints of the gearbox."""

    def build(**couplings) -> Mechanism:
        return mechanism(urdf(), gravity="none", couplings=couplings)

    return build
