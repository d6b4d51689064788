"""What is wrong with a drawing is said with its line; slides are part of the tree."""

from pathlib import Path

import pytest

import pinarm
from pinarm.errors import InputError

SOUND = """\
pinarm: 1
planar:
  points:
    O: [0, 0]
    A: [1 m, 0]
    B: [1 m, 1 m]
    C: [0, 1 m]
  ground: [O, C]
  links:
    crank: {points: [O, A], mass: 1 kg}
    coupler: {points: [A, B], mass: 1 kg}
    rocker: {points: [B, C], mass: 1 kg}
"""


def refused(folder: Path, old: str, new: str) -> str:
    """Return what is said of a drawing in which something is replaced."""
    assert old in SOUND
    (folder / "m.yaml").write_text(SOUND.replace(old, new))
    with pytest.raises(InputError) as caught:
        pinarm.Mechanism.load(folder / "m.yaml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("points: [A, B]", "points: [A, D]", 11, "the drawing has no point 'D'"),

        ("points: [B, C], mass", "points: [B], mass", 12, "no moment of inertia"),
        ("points: [B, C], mass: 1 kg", "points: [B, A], inertia: 1 kg*m^2", 12,
         "coupler and rocker are joined twice, by A and B"),
        ("A: [1 m, 0]", "A: [0, 0]", 10, "are at one place"),
        ("A: [1 m, 0]", "A: [1, 0]", 5, "'1' has no unit"),
        ("    crank:", "    A:", 10, "the name of a point"),
        ("pinarm: 1\n", "pinarm: 1\nrobot: panda\n", 1, "two models"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_its_line(tmp_path: Path, old: str, new: str, line: int, said: str) -> None:
    message = refused(tmp_path, old, new)
    assert said in message
    assert f"m.yaml:{line}:" in message, message


def test_a_plate_needs_its_centre_of_mass(tmp_path: Path) -> None:
    plate = SOUND.replace("    A: [1 m, 0]", "    A: [1 m, 0]\n    P: [2 m, 0]").replace("[A, B]", "[A, B, P]")
    (tmp_path / "m.yaml").write_text(plate)
    with pytest.raises(InputError, match=r"m.yaml:12:(.|\n)*3 points, but no centre of mass"):
        pinarm.Mechanism.load(tmp_path / "m.yaml")
