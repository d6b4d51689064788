"""From the description of a mechanism to the model that it names: which file, which text, which arguments."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgspec
import pinocchio as pin

from pinarm.errors import Location, ModelError
from pinarm.input.roots import (
    ENDINGS,
    NO_PACKAGES,
    Packages,
    contained_file,
    contained_path,
    file_root,
    is_floating,
    packages_around,
    root_of,
)
from pinarm.input.roots import robot as robot_file
from pinarm.input.units import decimal
from pinarm.input.xacro.expander import check_declared, expand
from pinarm.input.xml_text import MAX_BYTES, UnknownName, first_place, read, resolve_includes
from pinarm.mechanics.description import Gravity, MechanismDescription
from pinarm.mechanics.loading.model_tree import MeshMass
from pinarm.mechanics.loading.pinocchio_model import Base, Defects, RobotModel, build_model
from pinarm.records import ValueRecord, replace

MESH_MASSES = "masses of meshes are those of MuJoCo's compiler"
"""Note on a model with masses from meshes."""


class Source(ValueRecord, frozen=True):
    """Where a mechanism was read from.

    Attributes:
        base: Whether the model's root was held or floats; ``None`` where the model says it.
        defects: What was done about inertias that no body can have.
        model: Pinocchio's model that it was made of; ``None`` where it was read from a file.
        packages: Packages whose files the model may refer to, beside those of ``file_root``.
    """

    data: Mapping[str, Any]
    folder: Path
    robot: Path
    base: Base | None
    defects: Defects
    model: pin.Model | None = None
    packages: Packages = NO_PACKAGES


def read_robot(
    description: MechanismDescription,
    data: Mapping[str, Any],
    folder: Path,
    arguments: Mapping[str, float | str],
    model: pin.Model | None = None,
) -> tuple[RobotModel, Mapping[str, str], Source]:
    """Return the model of a mechanism, the texts of all its arguments, and where it was read from.

    Args:
        model: Pinocchio's model, which is read by way of its URDF text, in place of a file or a drawing.
    """
    build = partial(build_model, base=description.base, creep=description.slip_velocity, name=description.model)
    if model is None and description.planar is None:
        return _of_file(description, data, folder, arguments, build)
    check_declared(arguments, {})
    if description.planar is None:
        from pinarm.mechanics.loading.urdf_writer import written

        (text, notes), defects = written(model), description.defects or "noted"
        robot = build(text, defects=defects)
        source = Source(data, folder, folder / description.robot, description.base, defects, pin.Model(model))
        return replace(robot, notes=(*robot.notes, *notes)), {}, source
    from pinarm.mechanics.planar_drawing import expanded  # not paid for by others

    drawing, defects = expanded(description.planar), description.defects or "refused"
    robot, down = build(drawing.urdf, defects=defects), Gravity(direction="-y")
    robot.tree.loops, robot.tree.gravity = drawing.loops, down.vector()
    said = {key: value for key, value in data.items() if key != "planar"}
    loops = {**msgspec.to_builtins(drawing.loops), **data.get("loops", {})}
    plain = {"gravity": {"direction": down.direction}, **said, "loops": loops}
    return robot, {}, Source(plain, folder, folder / "mechanism.yaml", description.base, defects)


def _of_file(
    description: MechanismDescription,
    data: Mapping[str, Any],
    folder: Path,
    arguments: Mapping[str, float | str],
    build: Callable[..., RobotModel],
) -> tuple[RobotModel, Mapping[str, str], Source]:
    defects, base, packages = description.defects or "noted", description.base, NO_PACKAGES
    if description.robot.endswith(ENDINGS):
        root, defects = root_of(folder / "mechanism.yaml"), description.defects or "refused"
        path = contained_file((folder / description.robot).absolute(), root)
        named = {
            name: contained_path((folder / place).absolute(), root) for name, place in description.packages.items()
        }
        packages = {**packages_around(path, root), **named}
    else:
        path = robot_file(description.robot)
        root, base = path.parent, base or ("floating" if is_floating(path) else None)
    with file_root(None, packages):
        expansion = expand(path, arguments, root=root)
    notes, build = [f"xacro: {warning}" for warning in expansion.warnings], partial(build, base=base, defects=defects)
    xml = resolve_includes(expansion.xml, path, root)
    try:
        try:
            robot = build(xml)
        except MeshMass:
            if find_spec("mujoco") is None:
                raise
            from pinarm.engine.mesh_inertias import with_mesh_inertias

            robot = build(with_mesh_inertias(xml, path, root))
            notes.insert(0, MESH_MASSES)
    except ModelError as error:
        raise error.at(_place(error, path)) from None
    source = Source(data, folder, path, base, defects, packages=packages)
    return replace(robot, notes=(*robot.notes, *notes)), expansion.arguments, source


def _place(error: ModelError, path: Path) -> Location:
    """Return the line of a model's file with an unknown name, or with the link or joint which a message begins with."""
    pattern = error.pattern if isinstance(error, UnknownName) else ""
    if named := re.match(r"(link|joint|body) '([^']+)'", error.message):
        pattern = rf"<{named[1]}\s[^>]*\bname\s*=\s*[\"']{re.escape(named[2])}[\"']"
    source = str(path)
    return first_place(pattern, read(path, source, MAX_BYTES), source) if pattern else Location(source)


def numeric(arguments: Mapping[str, str]) -> Iterator[tuple[str, float]]:
    """Yield the arguments of a model that are numbers; those that are words choose parts of it."""
    for name, text in arguments.items():
        with suppress(ValueError):
            yield name, decimal(text)
