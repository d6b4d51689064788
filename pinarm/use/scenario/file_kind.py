"""What is given in place of a scenario: a mechanism file, or a model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pinarm.engine.model_source import FILES
from pinarm.errors import InputError, Location


def is_mechanism(data: Any) -> bool:
    """Tell whether the content of a file is that of a mechanism file."""
    return (
        isinstance(data, dict) and ("robot" in data or "planar" in data) and not {"problem", "mechanism"} & data.keys()
    )


def refuse_model(path: Path) -> None:
    """Refuse a model file.

    Raises:
        InputError: It is one; the message says what to do with it.
    """
    if path.name.endswith(FILES):
        raise InputError(
            "this is a model, not a scenario", expected="a scenario (.yaml): a question about a mechanism",
            hint=f"python -m pinarm new {path}, which writes a scenario for it; or python -m pinarm explain {path}",
        ).at(Location(str(path)))  # fmt: skip


def refuse_mechanism(path: Path, data: Any) -> None:
    """Refuse a mechanism file.

    Raises:
        InputError: It is one; the message says what to do with it.
    """
    if is_mechanism(data):
        raise InputError(
            "this is a mechanism file, not a scenario",
            expected=f"a scenario, with 'mechanism: {path.name}' and a 'problem:'",
            hint=f"python -m pinarm explain {path}; or python -m pinarm new four_bar, for a scenario to begin with",
        ).at(Location(str(path)))  # fmt: skip
