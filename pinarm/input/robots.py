"""The robots of example-robot-data, by name."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pinarm.errors import ModelError, choices
from pinarm.input.roots import example_robot_data


@cache
def robots() -> dict[str, Path]:
    """Return the model files by name: the file's own, also without ``_robot`` at its end.

    Raises:
        ModelError: The package is not installed.
    """
    found: dict[str, Path] = {}
    for file in sorted((example_robot_data() / "robots").glob("*/*/*.urdf")):
        found.setdefault(file.stem, file)
        found.setdefault(file.stem.removesuffix("_robot"), file)
    return found


def robot(name: str) -> Path:
    """Return the model file of a robot.

    Raises:
        ModelError: There is none of that name; the message lists what there is.
    """
    known = robots()
    if name not in known:
        expected, hint = choices(name, known, most=100)
        raise ModelError(f"there is no robot '{name}'", expected=f"a file, or {expected}", hint=hint)
    return known[name]
