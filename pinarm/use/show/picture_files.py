"""Files of pictures: their formats, resolutions and names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast, get_args

from pinarm.errors import InputError, choices

if TYPE_CHECKING:
    from pinarm.use.result.result import Result
    from pinarm.use.show.picture import Picture

PictureFormat = Literal["svg", "png", "pdf"]
"""Formats of picture files."""

RESOLUTION, COARSEST, FINEST = 200, 20, 1200
"""Pixels per inch of PNG files: usual, least and largest."""

PER_FILE = 6
"""Quantities in one file."""


def picture_format(asked: object, dpi: object = RESOLUTION) -> PictureFormat:
    """Return a format of pictures by its name, ``True`` for SVG.

    Raises:
        InputError: There is no such format, or no such resolution.
    """
    for form in get_args(PictureFormat):
        if asked == form or (asked is True and form == "svg"):
            if not isinstance(dpi, int) or not COARSEST <= dpi <= FINEST:
                raise InputError(f"{dpi!r} is no resolution", expected=f"a whole number from {COARSEST} to {FINEST}")
            return cast(PictureFormat, form)
    expected, hint = choices(str(asked), get_args(PictureFormat))
    raise InputError(f"pictures are not written as '{asked}'", expected=expected, hint=hint)


def write_pictures(
    pictures: Iterable[tuple[str, Picture]], folder: Path, form: PictureFormat | bool = "svg", dpi: int = RESOLUTION
) -> list[Path]:
    """Write pictures into a folder, made where missing, by the names of their files; return the files."""
    suffix, files = picture_format(form, dpi), list[Path]()
    folder.mkdir(exist_ok=True)
    for name, picture in pictures:
        files.append(folder / f"{name}.{suffix}")
        files[-1].write_bytes(picture.encoded(suffix, dpi))
    return files


def file_name(quantity: str) -> str:
    """Return the name of a quantity as part of the name of a file."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", quantity)[:40]


def pictures(result: Result) -> Iterator[tuple[str, Picture]]:
    """Yield the pictures of a run by the names of their files: its outputs, its sections, start and end positions."""
    from pinarm.use.show.drawings import free_body_diagrams, sketch, worst_instants
    from pinarm.use.show.picture import graph, plot

    outputs = [] if result.arrays else list(dict.fromkeys(result.content.outputs))
    for number, group in enumerate(tuple(outputs[i : i + PER_FILE]) for i in range(0, len(outputs), PER_FILE)):
        yield file_name(group[0]) if len(group) == 1 else f"outputs_{number + 1}", plot(result, group)
    for section in result.sections.values():
        for drawn in section.graphs:
            yield f"{section.key}_{drawn.name}", graph(drawn, result.presentation)
    for name, at in worst_instants(result).items():
        yield f"free_bodies_{file_name(name)}", free_body_diagrams(result, at)
    yield "positions", sketch(result)
