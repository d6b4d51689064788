"""From the description of a mechanism to the model that it names: which file, which text, which arguments."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
from pinarm.input.xml_text import MAX_BYTES, Element, UnknownName, location_of, read, resolve_includes, tree_of
from pinarm.mechanics.description import Gravity, MechanismDescription
from pinarm.mechanics.loading.model_tree import MeshMass
from pinarm.mechanics.loading.pinocchio_model import Base, Defects, RobotModel, build_model
from pinarm.records import ValueRecord, replace

if TYPE_CHECKING:
    from pinarm.mechanics.planar_drawing import PlanarDrawing

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


def robot_of_model(
    model: pin.Model,
    description: MechanismDescription,
    data: Mapping[str, Any],
    folder: Path,
    arguments: Mapping[str, float | str],
) -> tuple[RobotModel, Mapping[str, str], Source]:
    """Return the model of a mechanism that is made of a ``pin.Model``, by way of its URDF text; see ``read_robot``."""
    from pinarm.mechanics.loading.urdf_writer import written

    check_declared(arguments, {})
    text, defects = written(model), description.defects or "noted"
    robot = build_model(text.urdf, base=description.base, defects=defects, creep=description.slip_velocity)
    source = Source(data, folder, folder / description.robot, description.base, defects, pin.Model(model))
    return replace(robot, notes=(*robot.notes, *text.notes)), {}, source


def read_robot(
    description: MechanismDescription, data: Mapping[str, Any], folder: Path, arguments: Mapping[str, float | str]
) -> tuple[RobotModel, Mapping[str, str], Source]:
    """Return the model of a mechanism, the texts of all its arguments, and where it was read from."""
    if description.planar is not None:
        check_declared(arguments, {})
        return _drawn(description, description.planar, data, folder)
    defects: Defects
    if description.robot.endswith(ENDINGS):
        root, base, defects = root_of(folder / "mechanism.yaml"), description.base, description.defects or "refused"
        path = contained_file((folder / description.robot).absolute(), root)
        named = {
            name: contained_path((folder / place).absolute(), root) for name, place in description.packages.items()
        }
        packages: Packages = {**packages_around(path, root), **named}
    else:
        path, defects = robot_file(description.robot), description.defects or "noted"
        root, base = path.parent, description.base or ("floating" if is_floating(path) else None)
        packages = NO_PACKAGES
    with file_root(None, packages):
        expansion = expand(path, arguments, root=root)
    build = partial(build_model, base=base, defects=defects, creep=description.slip_velocity, name=description.model)
    xml = resolve_includes(expansion.xml, path, root)
    try:
        robot = _built(xml, path, root, build)
    except ModelError as error:
        raise error.at(_place(error, path)) from None
    notes = (*robot.notes, *(f"xacro: {warning}" for warning in expansion.warnings))
    return (
        replace(robot, notes=notes),
        expansion.arguments,
        Source(data, folder, path, base, defects, packages=packages),
    )


def _built(xml: str, path: Path, root: Path, build: Callable[[str], RobotModel]) -> RobotModel:
    """Return the model of a text; where masses come from meshes, with those of MuJoCo's compiler if it is installed."""
    try:
        return build(xml)
    except MeshMass:
        if find_spec("mujoco") is None:
            raise
    from pinarm.engine.mesh_inertias import with_mesh_inertias

    robot = build(with_mesh_inertias(xml, path, root))
    return replace(robot, notes=(*robot.notes, MESH_MASSES))


def _drawn(
    description: MechanismDescription, drawing: PlanarDrawing, data: Mapping[str, Any], folder: Path
) -> tuple[RobotModel, Mapping[str, str], Source]:
    """Return the model of a planar drawing, with gravity in its plane; the source is that of the expansion."""
    from pinarm.mechanics.planar_drawing import expanded  # not paid for by others

    model, defects = expanded(drawing), description.defects or "refused"
    down = Gravity(direction="-y")
    robot = build_model(model.urdf, base=description.base, defects=defects, creep=description.slip_velocity)
    loops = {**msgspec.to_builtins(model.loops), **data.get("loops", {})}
    said = {key: value for key, value in data.items() if key != "planar"}
    source = Source(
        {"gravity": {"direction": down.direction}, **said, "loops": loops},
        folder,
        folder / "mechanism.yaml",
        description.base,
        defects,
    )
    robot.tree.loops, robot.tree.gravity = model.loops, down.vector()
    return robot, {}, source


RobotReader = Callable[
    [MechanismDescription, Mapping[str, Any], Path, Mapping[str, float | str]],
    tuple[RobotModel, Mapping[str, str], Source],
]
"""Reader of the model of a mechanism; see ``read_robot``."""

_NAMED = r"(link|joint|body) '([^']+)'"


def _place(error: ModelError, path: Path) -> Location:
    """Return the line of a model's file with an unknown name, or with the link or joint which a message begins with."""
    source, named = str(path), re.match(_NAMED, error.message)
    if isinstance(error, UnknownName):
        return error.place(read(path, source, MAX_BYTES), source)
    if named:
        text = read(path, source, MAX_BYTES)
        elements = [part for part in tree_of(text, source).iter(named[1]) if part.get("name") == named[2]]
        if len(elements) == 1 and isinstance(elements[0], Element):
            return location_of(elements[0], text)
    return Location(source)


def numeric(arguments: Mapping[str, str]) -> Iterator[tuple[str, float]]:
    """Yield the arguments of a model that are numbers; those that are words choose parts of it."""
    for name, text in arguments.items():
        with suppress(ValueError):
            yield name, decimal(text)
