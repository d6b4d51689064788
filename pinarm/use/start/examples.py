"""The models, scenarios and examples that come with pinarm, copied to a folder of the user's own.

In a wheel they lie inside the package, in ``example_files``; in a checkout of the repository, beside the package.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pinarm.errors import InputError
from pinarm.use.output import reason, write_new_file

FOLDERS = ("models", "scenarios", "examples")
LEFT_BY_RUNS = ("results", "__pycache__")
"""Folders that running the examples makes beside them, which are not copied; nor are hidden ones."""


def examples(folder: str | Path = "pinarm-examples") -> Path:
    """Copy the models, scenarios and examples that come with pinarm to a folder, to be run there and changed.

    A file that exists is left as it is, so that nothing the user wrote is lost. The folder gets a ``.pinarm-root``:
    scenarios in it may refer to every model in it.

    Args:
        folder: Where to; it is made where it does not exist.

    Returns:
        The folder.

    Raises:
        InputError: The folder cannot be written, or pinarm was installed without these files.
    """
    target, source = Path(folder), example_files()
    try:
        target.mkdir(parents=True, exist_ok=True)
        write_new_file(target / ".pinarm-root", b"")
        for file in _files(source):
            write_new_file(target / file, (source / file).read_bytes())
    except OSError as error:
        raise InputError(
            f"the examples cannot be written to {target}: {reason(error)}",
            expected="a folder, or a path where one can be made",
            hint="another folder: -o DIR",
        ) from None
    return target


def example_files() -> Path:
    """Return the folder that holds models, scenarios and examples."""
    package = Path(__file__).parents[2]
    for folder in (package / "example_files", package.parent):
        if all((folder / name).is_dir() for name in FOLDERS):
            return folder
    raise InputError(
        "this installation of pinarm has no example files",
        expected=f"{', '.join(FOLDERS)} in {package / 'example_files'}",
        hint="install pinarm's wheel again",
    )


def _files(source: Path) -> Iterator[Path]:
    for name in FOLDERS:
        for path in sorted((source / name).rglob("*")):
            file = path.relative_to(source)
            if path.is_file() and not any(part in LEFT_BY_RUNS or part.startswith(".") for part in file.parts):
                yield file
