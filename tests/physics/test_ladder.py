"""A ladder in two guides, whose friction raises its own loads: Newton's and Euler's equations by hand."""

from itertools import product

import numpy as np
import pytest

import pinarm
from pinarm.errors import PinarmError

MASS, INERTIA, HALF, G, ANGLE = 3.0, 1.0, 1.0, 10.0, np.pi / 4.0
SIZES = '<limit lower="-10" upper="10" effort="1e6" velocity="1e6"/>'
LADDER = f"""<robot name="m"><link name="base"/><link name="foot"/><link name="top"/><link name="head"/>
<link name="rod"><inertial><origin xyz="1 0 0"/><mass value="3"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link><joint name="floor" type="prismatic"><parent link="base"/><child link="foot"/><axis xyz="1 0 0"/>{SIZES}</joint>
<joint name="hinge" type="continuous"><parent link="foot"/><child link="rod"/><axis xyz="0 0 1"/></joint>
<joint name="t" type="fixed"><parent link="rod"/><child link="top"/><origin xyz="2 0 0"/></joint>
<joint name="wall" type="prismatic"><parent link="base"/><child link="head"/><axis xyz="0 1 0"/>{SIZES}</joint>
</robot>"""


def by_hand(mu, speed):
    """Return friction at floor and wall of all motions with an angular velocity that is not 0."""
    found, a, s, c, way = [], HALF, np.sin(ANGLE), np.cos(ANGLE), np.sign(speed)
    for p, q in product([1.0, -1.0], repeat=2):  # signs of the normal forces N of floor and wall
        floor, wall = -way * mu * p, -way * mu * q  # friction over N; unknown: N of both, angular acceleration
        matrix = [
            [floor, 1.0, -MASS * a * s],
            [1.0, wall, -MASS * a * c],
            [a * (s * floor - c), a * (c * wall - s), -INERTIA],
        ]
        right = [MASS * a * c * speed**2, MASS * (G - a * s * speed**2), 0.0]
        n, m, _ = np.linalg.solve(matrix, right)
        if p * n >= 0.0 and q * m >= 0.0:
            found.append((floor * n, wall * m))
    return found


@pytest.fixture
def scene(tmp_path):
    def made(mu, speed):
        (tmp_path / "m.urdf").write_text(LADDER)
        mechanism = pinarm.Mechanism.load(tmp_path / "m.urdf", values={
            "gravity": {"direction": "-y", "magnitude": f"{G} m/s^2"},
            "friction": {"floor": {"mu": mu}, "wall": {"mu": mu}},
            "loops": {"c": {"kind": "cylindrical", "between": ["top", "head"], "axis": "z"}},
        })  # fmt: skip
        start = {"floor": f"{-np.sqrt(2.0)} m", "hinge": f"{ANGLE} rad", "wall": f"{np.sqrt(2.0)} m"}
        outputs = ["hinge", "joint.floor.friction", "joint.wall.friction"]
        return {"pinarm": 1, "mechanism": mechanism, "outputs": outputs, "problem": {
            "kind": "forward", "time": {"end": "1 ms", "samples": 2},
            "initial": {"position": start, "velocity": {"hinge": f"{speed} rad/s"}},
        }}  # fmt: skip

    return made


@pytest.mark.parametrize("mu", [0.5, 1.9, 2.5])
@pytest.mark.parametrize("speed", [0.5, -0.5])
def test_a_ladder_slides_where_only_one_motion_is_possible(scene, mu, speed):
    possible = by_hand(mu, speed)
    if len(possible) == 1:
        result = pinarm.run(scene(mu, speed))
        found = [result[f"joint.{name}.friction"].values[0] for name in ("floor", "wall")]
        assert found == pytest.approx(possible[0], rel=1e-9)
        return
    with pytest.raises(PinarmError, match=r"determine|jams"):
        pinarm.run(scene(mu, speed))


def test_a_ladder_at_rest_under_much_friction_stays(scene):
    assert np.ptp(pinarm.run(scene(1.2, 0.0))["hinge"].values) == 0.0
