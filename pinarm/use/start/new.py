"""The files that a user begins with: of a template, a model file, a robot or a drawing; or all examples, copied.

Models, scenarios and examples lie in ``example_files`` inside the package in a wheel, and beside the package in a
checkout of the repository.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from pinarm.errors import InputError, choices
from pinarm.use.output import reason, write_new_file

TEMPLATES = Path(__file__).parent / "templates"


def templates() -> list[str]:
    """Return the names of the templates."""
    return sorted(folder.name for folder in TEMPLATES.iterdir() if folder.is_dir())


def new(source: str | Path, folder: str | Path | None = None) -> Path:
    """Write the files to begin with, each with comments: a mechanism and a scenario that runs.

    A template (``four_bar``, ``slider_crank``, ``scissor_lift``, ``cam``, ``arm``) is copied. For a URDF, xacro, MJCF
    or SDF file, or a robot of example-robot-data, ``mechanism.yaml`` lists its joints, and ``scenario.yaml`` moves each
    of them from rest to rest. Of a mechanism file with a drawing (``planar:``) the URDF is written, with a mechanism
    file that has its loops.

    Args:
        source: Name of a template or a robot, a model file, or a mechanism file with a drawing.
        folder: Where to; by default a folder named after the template or robot, the folder of the model file, or for a
            drawing ``NAME_urdf``.

    Returns:
        The folder.

    Raises:
        InputError: There is nothing of that name, or a file to be written exists already; then nothing is written.
        ModelError: The model has a mistake.
    """
    from pinarm.input.robots import ENDINGS

    name, file = str(source), Path(source)
    if name in templates():
        return _written(Path(folder or name), _template(name))
    if file.suffix in (".yaml", ".yml"):
        target = Path(folder or f"{file.stem}_urdf")
        return _written(target, _drawing(file, target))
    if name.endswith(ENDINGS):
        target = Path(folder or file.parent)
        return _written(target, _model(file, target))
    return _written(Path(folder or name), _robot(name))


def _template(name: str) -> dict[str, str]:
    files = sorted(file for file in (TEMPLATES / name).iterdir() if file.is_file())
    return {file.name: file.read_text(encoding="utf-8") for file in files}


def _model(file: Path, folder: Path) -> dict[str, str]:
    """Return the files for a model file, which they must be allowed to refer to."""
    from pinarm.input.roots import contained_file, root_of

    files = _first_files(file, Path(os.path.relpath(file, folder)).as_posix())
    contained_file(file.absolute(), root_of(folder / "mechanism.yaml"))
    return files


def _first_files(source: str | Path, robot: str) -> dict[str, str]:
    from pinarm.engine.mechanism_loading import load_mechanism
    from pinarm.use.start.first_files import mechanism_text, scenario_text

    mechanism = load_mechanism(source)
    return {"mechanism.yaml": mechanism_text(mechanism, robot), "scenario.yaml": scenario_text(mechanism)}


def _robot(name: str) -> dict[str, str]:
    from pinarm.input.robots import robots

    if name not in robots():
        hint = choices(name, [*templates(), *robots()])[1]
        raise InputError(
            f"there is no template '{name}'",
            expected=f"one of {', '.join(templates())}; a URDF, xacro, MJCF or SDF file; a mechanism file with "
            "'planar:'; or the name of a robot",
            hint=hint,
        )
    return _first_files(name, name)


def _drawing(file: Path, folder: Path) -> dict[str, str]:
    from pinarm.engine.mechanism_loading import load_mechanism
    from pinarm.input.yaml.document import Document
    from pinarm.use.store.save import LawTables, mechanism_text

    data = Document.read(file).data
    if not isinstance(data, dict) or "planar" not in data:
        raise InputError(f"{file} has no drawing to make a URDF of", expected="a mechanism file with 'planar:'")
    mechanism, laws = load_mechanism(file), LawTables()
    model = f"{file.stem}.urdf"
    text = mechanism_text(mechanism.source, model, laws)
    tables = {name: source.read_text(encoding="utf-8") for name, source in laws.kept}
    return {model: mechanism.xml, "mechanism.yaml": text, **tables}


def _written(folder: Path, files: Mapping[str, str]) -> Path:
    """Write all files to a folder, which is made where it does not exist, or none where one exists already."""
    paths = [folder / name for name in files]
    for path in filter(os.path.lexists, paths):
        raise InputError(
            f"{path} exists already: nothing is written",
            expected="a folder without files of these names",
            hint="another folder: -o DIR",
        )
    try:
        for path in paths:
            write_new_file(path, files[path.name].encode())
    except OSError as error:
        raise InputError(
            f"the files cannot be written to {folder}: {reason(error)}",
            expected="a folder, or a path where one can be made",
            hint="another folder: -o DIR",
        ) from None
    return folder


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
        files = [*_files(source)]
        for home in sorted({file.parent for file in files}):
            _require_inside(target, home)
        for file in files:
            write_new_file(target / file, (source / file).read_bytes())
    except OSError as error:
        raise InputError(
            f"the examples cannot be written to {target}: {reason(error)}",
            expected="a folder, or a path where one can be made",
            hint="another folder: -o DIR",
        ) from None
    return target


def _require_inside(target: Path, folder: Path) -> None:
    """Raise where a folder below the target is reached by a symbolic link: files would be written elsewhere."""
    if (target / folder).resolve() != target.resolve() / folder:
        raise InputError(
            f"{target / folder} leads to {(target / folder).resolve()}, by a symbolic link",
            expected="folders of their own in the folder of the examples",
            hint="another folder: -o DIR",
        )


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
