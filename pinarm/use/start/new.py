"""The files that a user begins with: of a template, a model file, a robot or a drawing; or all examples, copied.

The first scenario of a model asks for the efforts of all joints while each moves from rest to rest, within its
limits: 30 degrees or 0.1 m, slowly enough for its limit of velocity. With loops and couplings it is as many of them as
there are degrees of freedom.

Models, scenarios and examples lie in ``example_files`` inside the package in a wheel, and beside the package in a
checkout of the repository.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kinematics.assembly import closed_generic
from pinarm.engine.kinematics.newton import start_configuration
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.mechanism_loading import load_mechanism
from pinarm.errors import InputError, PinarmError, choices
from pinarm.input.roots import ENDINGS, contained_file, robots, root_of
from pinarm.input.yaml.document import Document
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.joints import METRE, Joint
from pinarm.use.facade import Scenario
from pinarm.use.output import reason, write_new_file
from pinarm.use.store.save import LawTables
from pinarm.use.store.save import mechanism_text as saved_mechanism

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
    files = _first_files(file, Path(os.path.relpath(file, folder)).as_posix())
    contained_file(file.absolute(), root_of(folder / "mechanism.yaml"))
    return files


def _first_files(source: str | Path, robot: str) -> dict[str, str]:
    mechanism = load_mechanism(source)
    return {"mechanism.yaml": mechanism_text(mechanism, robot), "scenario.yaml": scenario_text(mechanism)}


def _robot(name: str) -> dict[str, str]:
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
    data = Document.read(file).data
    if not isinstance(data, dict) or "planar" not in data:
        raise InputError(f"{file} has no drawing to make a URDF of", expected="a mechanism file with 'planar:'")
    mechanism, laws = load_mechanism(file), LawTables()
    model = f"{file.stem}.urdf"
    text = saved_mechanism(mechanism.source, model, laws)
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
    with _writing(folder, "files"):
        for path in paths:
            write_new_file(path, files[path.name].encode())
    return folder


@contextmanager
def _writing(folder: Path, what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(
            f"the {what} cannot be written to {folder}: {reason(error)}",
            expected="a folder, or a path where one can be made",
            hint="another folder: -o DIR",
        ) from None


FOLDERS = ("models", "scenarios", "examples")
LEFT_BY_RUNS = shutil.ignore_patterns("results", "__pycache__", ".*")
"""Folders that running the examples makes beside them, and hidden ones, which are not copied."""


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
    with _writing(target, "examples"):
        target.mkdir(parents=True, exist_ok=True)
        for name in FOLDERS:
            for path in (target / name, *(target / name).rglob("*")):
                if path.is_symlink() and path.is_dir():
                    message = f"{path} leads to {path.resolve()}, by a symbolic link"
                    raise InputError(message, expected="folders of their own in the folder of the examples")
            shutil.copytree(source / name, target / name, False, LEFT_BY_RUNS, _copy_new, dirs_exist_ok=True)
        write_new_file(target / ".pinarm-root", b"")
    return target


def _copy_new(source: str, target: str) -> None:
    write_new_file(Path(target), Path(source).read_bytes())


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


STEP = {"deg": 30.0, "mm": 100.0}
"""Displacement of a joint, in the unit of the file."""

PARTS = (1.0, -1.0, 0.1, -0.1)
"""Parts of ``STEP`` that are tried where loops or couplings limit the motion, forward and backward."""

DRIVING = 0.3
"""Least motion of a coordinate that is driven, relative to the most that one makes: others would take large efforts."""

NEAR = 1e-9
"""Largest coordinate that is 0 but for rounding [rad or m]."""

PEAK = 15 / 8
"""Largest speed of a polynomial of degree 5 from rest to rest, relative to the mean one."""

PLAIN = re.compile(r"(?!(?:true|false|null|yes|no|on|off|y|n)$)[A-Za-z_][A-Za-z0-9_]*", re.IGNORECASE)
"""Names that YAML takes for text without quotes."""


def mechanism_text(mechanism: Mechanism, robot: str) -> str:
    """Return a mechanism file for a model; ``robot`` is the model's file relative to it, or the name of a robot."""
    gravity = ", ".join(f"{part:g}" for part in mechanism.model.gravity.linear)
    units, first = ", ".join(f"{name}: UNIT" for name in mechanism.arguments), [*map(_name, mechanism.joints)][:1]
    lines = [
        "# What the model file does not say. All keys: python -m pinarm schema mechanism",
        "pinarm: 1", f"title: {_quoted(mechanism.title or 'Mechanism')}", f"robot: {_quoted(robot)}",
        *[f"# arguments: {{{units}}}     # their units: m, kg ...; then scenarios can change them"][: len(units)],
        "# Joints with one coordinate:", *(f"#   {line}" for line in _described(mechanism)),
        f"# gravity: none               # or {{direction: -z, magnitude: 9.81 m/s^2}}; it is {gravity} m/s^2 now",
        *["# drives:                     # motors with gears, each at its joint"][: len(first)],
        *(f"#   motor: {{joint: {joint}, ratio: 100, efficiency: 0.8, rotor_inertia: 20 kg*mm^2}}" for joint in first),
        "# symbols: {}                 # names of your own, for quantities and formulas",
    ]  # fmt: skip
    return _text(lines)


def _text(lines: Iterable[str]) -> str:
    """Return lines as text; what in names would end a line, or is no character of YAML, is escaped."""
    return "".join(
        "".join(char if char.isprintable() else rf"\U{ord(char):08x}" for char in line) + "\n" for line in lines
    )


def scenario_text(mechanism: Mechanism) -> str:
    """Return a scenario of the mechanism file beside it: inverse dynamics of a motion from rest to rest.

    Of loops and couplings as many coordinates move as there are degrees of freedom, along the first of some ranges that
    they can follow; where they can follow none, a comment says why.
    """
    try:
        return _solvable(mechanism)
    except PinarmError as error:
        q = start_configuration(mechanism, {})
        text = _scenario(mechanism, q, _independent(mechanism, q), 1.0, {})
        return _text([f"# This does not run as it is: {error.message}."]) + text


def _solvable(mechanism: Mechanism) -> str:
    """Return the first scenario that can be solved, of trees the first one."""
    q = closed_generic(mechanism, {})
    names = _independent(mechanism, q)
    if not mechanism.closure.size:
        return _scenario(mechanism, q, names, 1.0, {})
    others = {name: float(q[joint.q]) for name, joint in mechanism.joints.items() if name not in names}
    start = {name: value for name, value in others.items() if abs(value) > NEAR}
    reason: PinarmError = InputError("it has no degree of freedom")
    for part in PARTS if names else ():
        text = _scenario(mechanism, q, names, part, start)
        try:
            Scenario.of_data({**Document.parse(text).data, "mechanism": mechanism}).run()
        except PinarmError as error:
            reason = error
        else:
            return text
    raise reason


def _independent(mechanism: Mechanism, q: Array) -> list[str]:
    """Return as many coordinates as there are degrees of freedom, which determine the motion from a configuration.

    One after the other in the order of the file, each that moves while those before it rest; those that hardly do, such
    as the slide of a screw, only where nothing else is left.
    """
    closure, carried = mechanism.closure, _carried(mechanism)
    names = [*(name for name in mechanism.joints if name not in carried), *_held(mechanism)]
    if not closure.size:
        return names
    state = closure.state(q)
    coordinates = [mechanism.coordinate(name) for name in names]
    units = closure.with_guides(names, coordinates).measure[closure.size :]
    rows = np.array([coordinate.row(state) for coordinate in coordinates]) * closure.scale / units[:, None]
    left = np.linalg.qr(closure.split(closure.rows(state)).free / closure.scale[:, None])[0]
    chosen: list[int] = []
    while left.shape[1]:
        moved = np.linalg.norm(rows @ left, axis=1)
        chosen.append(int(np.argmax(moved >= DRIVING * moved.max())))
        left = left @ np.linalg.svd((rows[chosen[-1]] @ left)[None])[2][1:].T
    return [names[k] for k in sorted(chosen)]


def _scenario(mechanism: Mechanism, q: Array, names: Sequence[str], part: float, start: Mapping[str, float]) -> str:
    """Return a scenario in which coordinates move from a configuration, shape (nq,), by a part of their usual range."""
    held = {name: unit for name, unit in _held(mechanism).items() if name in names}
    ways = {name: _way(mechanism, mechanism.joints[name], q, part) for name in names if name not in held}
    duration = max([1.0, *(_duration(mechanism, mechanism.joints[name], way) for name, way in ways.items())])
    rough = ", ".join(_level(mechanism.joints[name], value) for name, value in start.items())
    title = mechanism.title or "Mechanism"
    lines = [
        "# Which efforts does a motion from rest to rest take?",
        "# Solve: python -m pinarm run scenario.yaml     Look: python -m pinarm replay RESULT, the folder it names",
        "pinarm: 1",
        f"title: {_quoted(f'{title}, a motion from rest to rest')}",
        "mechanism: mechanism.yaml",
        "problem:",
        "  kind: inverse                  # the motion is known, the efforts are wanted",
        f"  time: {{end: {duration:g} s, samples: 201}}",
        *([f"  start: {{{rough}}}"] if start else []),
        "  motion:",
    ]
    for name, (first, last, unit) in ways.items():
        begin, end = (f"{round(value, 12) + 0.0:.9g} {unit}" for value in (first, last))
        law = f"law: polynomial, from: {begin}, to: {end}, duration: {duration:g} s"
        lines.append(f"    {_name(name)}: {{{law}}}")
    state = mechanism.closure.state(q)
    for name, unit in held.items():
        value = mechanism.coordinate(name).value(state) * (1.0 if unit == "m" else math.degrees(1.0))
        lines.append(f"    {_name(name)}: {{law: constant, value: {value + 0.0:.9g} {unit}}}")
    turns = (f"{ball}.moment.{axis}" for ball in mechanism.balls for axis in "xyz" if f"{ball}.rotation.{axis}" in held)
    outputs = [*(f"joint.{name}.effort" for name in ways), *(f"joint.{turn}" for turn in turns)]
    return _text([*lines, "outputs:", *(f"  - {_name(output)}" for output in outputs)])


def _level(joint: Joint, value: float) -> str:
    unit, factor = _unit(joint)
    return f"{_name(joint.name)}: {value * factor:.6g} {unit}"


def _name(text: str) -> str:
    """Return a name as YAML, in quotes where these are needed."""
    return text if all(PLAIN.fullmatch(part) for part in text.split(".")) else _quoted(text)


def _quoted(text: str) -> str:
    """Return a text in quotes; ``_text`` escapes what is left in it as YAML has it."""
    return json.dumps(text, ensure_ascii=False)


def _described(mechanism: Mechanism) -> Iterator[str]:
    model = mechanism.model
    for joint in mechanism.joints.values():
        unit, factor = _unit(joint)
        low, high = (float(limit[joint.q]) for limit in (model.lowerPositionLimit, model.upperPositionLimit))
        effort = float(model.effortLimit[joint.v])
        limits = f", {low * factor:.6g} to {high * factor:.6g} {unit}" if low > -math.inf or high < math.inf else ""
        most = f", at most {effort:.6g} {'N' if joint.unit == METRE else 'N*m'}" if effort < math.inf else ""
        yield f"{joint.name}: {'slides' if joint.unit == METRE else 'turns'}{limits}{most}"


def _unit(joint: Joint) -> tuple[str, float]:
    """Return the unit in which a file gives a joint's coordinate, and how many there are in one of SI."""
    return ("mm", 1e3) if joint.unit == METRE else ("deg", math.degrees(1.0))


def _carried(mechanism: Mechanism) -> set[str]:
    """Return the joints that are not given a way: those that mimic others, and the slides of floating bases."""
    followers = {constraint.follower for constraint in mechanism.constraints if isinstance(constraint, Coupling)}
    mimics = {joint.name for joint in mechanism.joints.values() if joint.v in followers}
    return mimics | {f"{ball}.{axis}" for ball in mechanism.balls for axis in "xyz"}


def _held(mechanism: Mechanism) -> dict[str, str]:
    """Return the coordinates that stay where they are, with their units: of floating bases and ball joints."""
    held: dict[str, str] = {}
    for ball in mechanism.balls:
        held |= {f"{ball}.{axis}": "m" for axis in "xyz" if f"{ball}.{axis}" in mechanism.joints}
        held |= {f"{ball}.rotation.{axis}": "deg" for axis in "xyz"}
    return held


def _way(mechanism: Mechanism, joint: Joint, q: Array, part: float) -> tuple[float, float, str]:
    """Return where a joint's motion begins and ends, within its limits, and the unit.

    It begins where it is in a configuration, shape (nq,), and goes by a part of its step, which may be negative, or as
    far to the other side where limits are in the way.
    """
    unit, factor = _unit(joint)
    model = mechanism.model
    low = math.ceil(1e3 * factor * max(model.lowerPositionLimit[joint.q], -1e6)) / 1e3
    high = math.floor(1e3 * factor * min(model.upperPositionLimit[joint.q], 1e6)) / 1e3
    start, step = float(np.clip(factor * q[joint.q], low, high)) + 0.0, part * STEP[unit]
    end = next((end for end in (start + step, start - step) if low <= end <= high), None)
    return (low, high, unit) if end is None else (start, end, unit)


def _duration(mechanism: Mechanism, joint: Joint, way: tuple[float, float, str]) -> float:
    """Return the least time [s], in tenths, in which a way keeps to the joint's limit of velocity."""
    fastest = float(mechanism.model.velocityLimit[joint.v]) * _unit(joint)[1]
    return math.ceil(10 * PEAK * abs(way[1] - way[0]) / fastest) / 10 if 0.0 < fastest < math.inf else 0.0
