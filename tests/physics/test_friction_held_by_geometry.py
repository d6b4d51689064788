"""Friction of a joint that geometry holds still: anything up to its limit, whatever rounding says of its motion.

A hinge is held by a rod that turns freely in two ball joints: the hinge cannot move, and only the rod spins. What the
hinge has of accelerations is rounding, of either sign.
"""

from pathlib import Path

import numpy as np
import pytest

import pinarm

INERTIA = '<inertia ixx="0.01" iyy="0.01" izz="0.02" ixy="0" ixz="0" iyz="0"/>'


def held_hinge(folder: Path, seed: int) -> pinarm.Result:
    """Return 0.1 s of a random hinge: its joint a, the ball b, c, d of the rod, and the loop at the rod's tip."""
    rng = np.random.default_rng(seed)

    def text(low: float) -> str:
        return " ".join(map(repr, rng.uniform(-low, low, 3).tolist()))

    def joint(name: str, parent: str, child: str, at: str, axis: str) -> str:
        kind, turned = ("continuous", f'<axis xyz="{axis}"/>') if axis else ("fixed", "")
        ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        return f'<joint name="{name}" type="{kind}">{ends}{turned}</joint>'

    body = '<link name="{}"><inertial><origin xyz="{}"/><mass value="1"/>' + INERTIA + "</inertial></link>"
    arms = [("j_a", "w", "a", text(0.5), text(1.0)), ("j_b", "a", "b", text(0.5), "1 0 0"),
            ("j_c", "b", "c", "0 0 0", "0 1 0"), ("j_d", "c", "d", "0 0 0", "0 0 1"),
            ("fixed_tip", "d", "tip", text(0.4), "")]  # fmt: skip
    links = body.format("a", text(0.3)) + body.format("d", text(0.3))
    links += "".join(f'<link name="{name}"/>' for name in ("w", "b", "c", "tip"))
    free = f'<robot name="hinge">{links}{"".join(joint(*each) for each in arms)}'
    (folder / "free.urdf").write_text(free + "</robot>")
    bare = pinarm.Mechanism.load(folder / "free.urdf")
    angles = dict(zip(("j_a", "j_b", "j_c", "j_d"), rng.uniform(-1.0, 1.0, 4), strict=True))
    spot = " ".join(map(repr, bare.frame("tip", bare.configurations(angles))[:3, 3].tolist()))
    (folder / "hinge.urdf").write_text(
        free + f'<link name="spot"/>{joint("fixed_spot", "w", "spot", spot, "")}</robot>'
    )
    mechanism = {"pinarm": 1, "robot": str(folder / "hinge.urdf"), "friction": {"j_a": {"mu": 0.2, "radius": "20 mm"}},
                 "loops": {"L": {"kind": "spherical", "between": ["spot", "tip"]}}}  # fmt: skip
    problem = {"kind": "forward", "time": {"end": "0.1 s", "samples": 3}}
    return pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": problem, "outputs": ["joint.j_a.friction"]})


@pytest.mark.parametrize("seed", range(2))
def test_friction_of_a_hinge_that_cannot_move_is_not_determined(tmp_path: Path, seed: int) -> None:
    with pinarm.file_root(tmp_path):
        result = held_hinge(tmp_path, seed)
    assert np.abs(result["joint.j_a.velocity"].values).max() < 1e-12
    least, greatest = (result[f"joint.j_a.friction.{end}"].values for end in ("least", "greatest"))
    assert (least < -1e-3).all()
    assert (greatest > 1e-3).all()
    assert any("joint.j_a.friction: not determined" in note for note in result.notes())
