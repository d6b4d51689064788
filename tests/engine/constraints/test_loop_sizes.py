"""Sizes of loops against sums of the lengths of their bars, and units of length that follow from them."""

from pathlib import Path

import numpy as np
import pytest

from pinarm import Mechanism, Result, Scenario
from pinarm.errors import AssemblyError

MODELS = Path(__file__).parents[3] / "models"


def two_slider_cranks(folder: Path, away: float, rod: float = 0.35, small: float = 1.0) -> Path:
    """Return the mechanism file of two slider-cranks, crank 0.1 m, rod 0.35 m; the second one lies ``away`` [m] beside.

    Args:
        folder: Where to write.
        away: Distance of their planes [m].
        rod: Length of the first one's rod [m].
        small: Factor of the lengths of the first.
    """
    parts, loops = [], ""
    for k, crank, length in ((1, 0.1 * small, rod * small), (2, 0.1, 0.35)):
        at = f"xyz='0 {away * (k - 1)} 0'"
        slide = f"xyz='{crank + length!r} {away * (k - 1)} 0'"
        mass = "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>"
        parts += [f"<link name='{name} {k}'>{mass}</link>" for name in ("crank", "rod", "piston")]
        parts += [
            f"<joint name='{name} {k}' type='{kind}'><parent link='{of}'/><child link='{child} {k}'/><origin {place}/>"
            f"<axis xyz='{axis}'/></joint>"
            for name, kind, of, child, place, axis in (
                ("theta", "continuous", "base", "crank", at, "0 0 1"),
                ("pin", "continuous", f"crank {k}", "rod", f"xyz='{crank!r} 0 0'", "0 0 1"),
            )
        ]
        parts += [
            f"<joint name='x {k}' type='prismatic'><parent link='base'/><child link='piston {k}'/><origin {slide}/>"
            "<axis xyz='1 0 0'/><limit lower='-9' upper='9' effort='9' velocity='9'/></joint>",
            f"<link name='end {k}'/><joint name='at end {k}' type='fixed'><parent link='rod {k}'/>"
            f"<child link='end {k}'/><origin xyz='{length!r} 0 0'/></joint>",
        ]
        loops += f"  wrist {k}: {{kind: revolute, between: [end {k}, piston {k}], axis: z}}\n"
    (folder / "model.urdf").write_text(f"<robot name='r'><link name='base'/>{''.join(parts)}</robot>")
    path = folder / "mechanism.yaml"
    path.write_text(f"pinarm: 1\nrobot: model.urdf\nloops:\n{loops}")
    return path


def turned(folder: Path, samples: int, *laws: str) -> Result:
    """Return how they move in a second while their cranks follow two laws."""
    path = folder / "scenario.yaml"
    path.write_text(f"""\
pinarm: 1
title: Two slider-cranks
mechanism: mechanism.yaml
problem:
  kind: kinematics
  time: {{end: 1 s, samples: {samples}}}
  motion: {{theta 1: {laws[0]}, theta 2: {laws[1]}}}
outputs: [joint.x 1.position, joint.x 2.position]
""")
    return Scenario.load(path).run()


def test_a_loop_is_half_as_large_as_the_way_around_it() -> None:
    lengths = {"a": 0.1, "b": 0.35, "c": 0.25, "d": 0.4}
    closure = Mechanism.load(MODELS / "crank_rocker" / "mechanism.yaml", lengths).closure
    assert closure.loop_sizes.sizes == pytest.approx([0.55], rel=1e-14)


@pytest.mark.parametrize("away", [31.0, 1e4])
def test_a_rod_that_is_a_little_too_short_lets_no_crank_pass_wherever_another_loop_stands(
    away: float, tmp_path: Path
) -> None:
    """It ends at 89.74 deg; the branches behind all but meet those before."""
    two_slider_cranks(tmp_path, away, rod=0.1 * (1.0 - 1e-5))
    law = "{{law: polynomial, from: 0 deg, to: {} deg, duration: 1 s}}"
    with pytest.raises(AssemblyError, match=r"singular at t = 0\.35[89]"):
        turned(tmp_path, 21, law.format(360), law.format(40))


@pytest.mark.parametrize("small", [1e-2, 1e-7, 1e3])
def test_a_loop_moves_by_its_closed_form_beside_one_of_another_size(small: float, tmp_path: Path) -> None:
    """``x = r cos(theta) + (l^2 - r^2 sin^2(theta))^(1/2)``, less where it begins, of a crank r and a rod l."""
    two_slider_cranks(tmp_path, 1.0, small=small)
    result = turned(tmp_path, 11, *(f"{{law: constant_speed, speed: {speed} rad/s}}" for speed in (9, 4)))
    for name, size in (("1", small), ("2", 1.0)):
        theta, x = (result[f"joint.{kind} {name}.position"].values for kind in ("theta", "x"))
        wanted = size * (0.1 * np.cos(theta) + np.sqrt(0.35**2 - (0.1 * np.sin(theta)) ** 2) - 0.45)
        assert np.abs(x - wanted).max() < 1e-14 + 1e-13 * size  # rounding of places 1 m from the origin
