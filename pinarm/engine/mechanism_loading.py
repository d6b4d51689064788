"""Mechanisms from files, data and models of Pinocchio: the parts of a description, bound to the model that it names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import pinocchio as pin

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.mechanism_parts import (
    NamedParts,
    arguments_of,
    couplings_of,
    forces_of,
    frictions_of,
    loaded,
    marked,
    named_parts,
    naming_arguments,
    only_joints,
    symbols_of,
    tying,
)
from pinarm.engine.model_source import RobotReader, numeric, read_robot, robot_of_model
from pinarm.errors import InputError, Place, nowhere, within
from pinarm.input.xacro.expansion import check_declared
from pinarm.input.yaml.document import Document, Values, varied
from pinarm.mechanics.coordinates import Coordinate, coordinate_of, sum_of
from pinarm.mechanics.couplings.coupling import mimic_coupling
from pinarm.mechanics.description import Gravity, MechanismDescription, gravity_vector, gravity_words
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.joints import Joint, joint_of, joints_of
from pinarm.mechanics.loops.closing_frames import proposals
from pinarm.records import replace

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint_rows import Constraint
    from pinarm.mechanics.points import Payload


def mechanism_document(file: Path) -> Document:
    """Return what a mechanism file says; of a model's file, or a robot's name, what such a file would say at least.

    Raises:
        InputError: The file cannot be read.
    """
    if file.suffix in (".yaml", ".yml"):
        return Document.read(file)
    return Document(str(file), file, {"pinarm": 1, "robot": file.name if file.suffix else str(file)}, {}, {})


def load_mechanism(
    path: str | Path, arguments: Mapping[str, float | str] | None = None, values: Values | None = None
) -> Mechanism:
    """Return the mechanism of a file, or of a robot's name; see ``pinarm.Mechanism.load``."""
    document = mechanism_document(Path(path))
    return _described(varied(document, values) if values else document, Path(path).parent, arguments or {})


def mechanism_of_model(model: pin.Model, keys: Mapping[str, Any]) -> Mechanism:
    """Return the mechanism of a ``pin.Model``, with keys of a mechanism file; see ``pinarm.Mechanism.of``."""
    if not isinstance(model, pin.Model):
        raise InputError(
            f"a mechanism is made of a pin.Model, and this is {type(model).__name__}",
            expected="a pin.Model",
            hint="Mechanism.load(path), or pinarm.run({'mechanism': {...}, ...}) with the data of a mechanism file",
        )
    if taken := sorted(keys.keys() & {"robot", "planar"}):
        raise InputError(f"{', '.join(taken)}: the model is given already", expected="other keys of a mechanism file")
    data = {"pinarm": 1, "robot": "model.urdf", "gravity": gravity_words(model), **keys}
    document = Document.of_data(data, "mechanism")
    description, read = document.validate(MechanismDescription), partial(robot_of_model, model)
    return _build(description, document.data, Path(), {}, {}, document.locating, nowhere, read)


def read_mechanism(
    path: str | Path, arguments: Mapping[str, float | str] | None = None, *,
    gravity: Gravity | Literal["none"] | None = None, payloads: Mapping[str, Payload] | None = None,
    changes: Document | None = None, locate: Place = nowhere, acted: Sequence[str] = (),
) -> Mechanism:  # fmt: skip
    """Load a mechanism as a scenario asks for it.

    Args:
        path: As in ``Mechanism.load``.
        arguments: Likewise.
        gravity: Replaces that of the file.
        payloads: Carried beside those of the file, by name.
        changes: Values that replace those of the mechanism file at the same paths.
        locate: Gives errors in ``("arguments", name)`` and ``("payloads", name)`` their place in the scenario.
        acted: Coordinates along which something of the scenario acts.

    Raises:
        InputError: The mechanism file has a mistake.
        ModelError: The model has one.
    """
    document = mechanism_document(Path(path))
    if changes is not None:
        document = document.merged(changes)
    return _described(document, Path(path).parent, arguments or {}, gravity, payloads or {}, locate, acted)


def mechanism_of_data(data: Mapping[str, Any], acted: Sequence[str] = ()) -> Mechanism:
    """Return the mechanism of plain data, such as a mechanism file would hold; its paths start in the current folder.

    ``acted`` are coordinates along which something acts that these data do not say.

    Raises:
        InputError: It has a mistake.
        ModelError: The model has one.
    """
    return _described(Document.of_data(data, "mechanism"), Path(), {}, acted=acted)


def _described(
    document: Document, folder: Path, arguments: Mapping[str, float | str],
    gravity: Gravity | Literal["none"] | None = None, payloads: Mapping[str, Payload] = MappingProxyType({}),
    locate: Place = nowhere, acted: Sequence[str] = (),
) -> Mechanism:  # fmt: skip
    """Return the mechanism that a document describes; see ``read_mechanism``."""
    here = document.locating if document.places else lambda *at: locate("mechanism")
    description = document.validate(MechanismDescription)
    if gravity is not None:
        description = replace(description, gravity=gravity)
    return _build(description, document.data, folder, arguments, payloads, here, locate, acted=acted)


def _build(
    description: MechanismDescription, data: Mapping[str, Any], folder: Path,
    arguments: Mapping[str, float | str], payloads: Mapping[str, Payload], here: Place, caller: Place,
    read: RobotReader = read_robot, acted: Sequence[str] = (),
) -> Mechanism:  # fmt: skip
    """Build a mechanism from its description; ``here`` locates its own mistakes, ``caller`` the caller's.

    ``acted`` are coordinates along which something of the caller acts.
    """
    units, given = arguments_of(description, arguments, here, caller)
    key = "planar" if description.planar else "robot"
    with here(key), naming_arguments(caller):
        robot, texts, source = read(description, data, folder, given)
    resolved = dict(numeric(texts))
    with naming_arguments(here):
        check_declared(units, texts)
    model, carried = loaded(marked(robot.model, description.points, here), description.payloads, payloads, here, caller)
    model.gravity.linear = gravity_vector(description.gravity, robot.gravity)
    parts = named_parts(robot, description, model, key, here)
    if angles := counted_angles(description, model, parts, acted, here):
        from pinarm.mechanics.rotors import with_counters

        model = with_counters(model, angles)
        parts = named_parts(robot, description, model, key, here)
    parts, counters = counting(model, parts, angles)
    if (geared := rotors_along(model, description, parts.coordinates, here)) is not model:
        model = geared
        parts, counters = counting(model, named_parts(robot, description, model, key, here), angles)
    joints, balls, loops, coordinates = parts.joints, parts.balls, parts.loops, parts.coordinates
    mimics = [mimic_coupling(mimic, joints, model) for mimic in robot.mimics]
    constraints: tuple[Constraint, ...] = (
        *mimics, *loops, *couplings_of(robot, description, model, joints, key, here),
        *counters, *geared_rotors(joints, description, coordinates),
    )  # fmt: skip
    frictions = frictions_of(robot, description, model, joints, constraints, here)
    symbols = symbols_of(description, here)
    mount_drives(model, joints, description, here)
    forces = forces_of(robot, description, model, joints, coordinates, here)
    forces |= elastic_gears(model, description, coordinates, here)
    return Mechanism(
        description.title or model.name, model, robot.xml, joints, balls, coordinates, tying(constraints, frictions),
        dict(description.drives), forces, symbols, resolved,
        {name: units[name].si for name in resolved if name in units}, description, source, carried,
        (*robot.notes, *proposals(model, only_joints(loops))), frictions, tuple(description.control),
        here if description.control or symbols else nowhere,
    )  # fmt: skip


def acted_along(forces: Iterable[Any], control: Iterable[Any]) -> list[str]:
    """Return the names of coordinates along which definitions of forces act, and of what controllers need."""
    along = [name for force in forces if (name := getattr(force, "coordinate", None)) is not None]
    return [*along, *(name for one in control for name in one.names)]


def counted_angles(
    description: MechanismDescription, model: pin.Model, parts: NamedParts, acted: Sequence[str], here: Place
) -> list[str]:
    """Return the angles whose turns are to be counted: those that are told up to whole turns, and matter beyond these.

    Args:
        description: The mechanism file.
        model: Pinocchio's model.
        parts: What has a name in it.
        acted: Coordinates along which something acts that the mechanism file does not say.
        here: Gives errors their place.

    Raises:
        InputError: There is no angle of a name under ``turns``.
    """
    for k, name in enumerate(description.turns):
        with here("turns", k):
            if not coordinate_of(model, parts.coordinates, name).wraps:
                raise InputError(f"'{name}' counts its turns, or has none",
                                 expected="L.angle of a loop joint, or J.yaw or J.roll of a ball joint")  # fmt: skip
    names = [*description.turns, *acted_along(description.forces.values(), description.control), *acted]
    known = parts.coordinates
    return [name for name in dict.fromkeys(names) if name in known and known[name].wraps]


def counting(model: pin.Model, parts: NamedParts, angles: Sequence[str]) -> tuple[NamedParts, list[Constraint]]:
    """Return parts of a model with counters whose coordinates are those of the counters, and what ties these to angles.

    Args:
        model: With the joints of ``with_counters``.
        parts: What has a name in it.
        angles: Names of the angles.
    """
    if not angles:
        return parts, []
    from pinarm.mechanics.rotors import GearedRotor, counter_name

    ties: list[Constraint] = [
        GearedRotor(f"turns of {angle}", parts.coordinates[angle], rotor=parts.joints[counter_name(angle)])
        for angle in angles
    ]
    counted: dict[str, Coordinate] = {angle: sum_of(model, parts.joints, [counter_name(angle)]) for angle in angles}
    return replace(parts, coordinates={**parts.coordinates, **counted}), ties


def mount_drives(model: pin.Model, joints: Mapping[str, Joint], description: MechanismDescription, here: Place) -> None:
    """Give the inertias of rotors to the joints of their drives.

    Raises:
        InputError: A joint does not exist, or has a drive already.
    """
    mounted: dict[str, str] = {}
    armature: Any = model.armature
    for name, drive in description.drives.items():
        driven, key = drive.coordinate, "joint" if drive.joint else "along"
        with here("drives", name), within(key):
            joint = joint_of(joints, driven) if drive.joint else None
            if driven in mounted:
                raise InputError(f"the {key} '{driven}' has two drives, '{mounted[driven]}' and '{name}'",
                                 expected="one drive at each joint")  # fmt: skip
        mounted[driven] = name
        if joint is not None and not drive.turns_rotor:
            armature[joint.v] += drive.armature


def rotors_along(
    model: pin.Model, description: MechanismDescription, coordinates: Mapping[str, Coordinate], here: Place
) -> pin.Model:
    """Return the model with a joint for the rotor of every drive that turns one of its own; itself without any.

    Raises:
        InputError: A coordinate does not exist, or is a joint's own.
    """
    turning = {name: drive for name, drive in description.drives.items() if drive.turns_rotor}
    if not turning:
        return model
    from pinarm.mechanics.rotors import with_rotors

    for name, drive in turning.items():
        if drive.joint:
            with here("drives", name), within("joint"):
                joint_of(joints_of(model), drive.joint)
            continue
        with here("drives", name), within("along"):
            coordinate_of(model, coordinates, drive.along)
            if drive.along in joints_of(model):
                raise InputError(f"'{drive.along}' is a joint", expected=f"joint: {drive.along}")
    with here("drives"):
        return with_rotors(model, turning, coordinates)


def geared_rotors(
    joints: Mapping[str, Joint], description: MechanismDescription, coordinates: Mapping[str, Coordinate]
) -> list[Constraint]:
    """Return what ties the joints of drives to each other, and to what the drives act along."""
    turning = {name: drive for name, drive in description.drives.items() if drive.turns_rotor}
    if not turning:
        return []
    from pinarm.mechanics.rotors import DriveTrain

    return [
        tie
        for name, drive in turning.items()
        for tie in DriveTrain.of(name, drive, coordinates[drive.coordinate]).ties(drive, joints, coordinates)
    ]


def elastic_gears(
    model: pin.Model, description: MechanismDescription, coordinates: Mapping[str, Coordinate], here: Place
) -> dict[str, ForceElement]:
    """Return the elasticities between rotors and what their drives act along, by name.

    Raises:
        InputError: A unit is another.
    """
    elastic = {name: drive for name, drive in description.drives.items() if drive.elasticity is not None}
    if not elastic:
        return {}
    from pinarm.mechanics.forces.along_coordinate import elastic_gear
    from pinarm.mechanics.rotors import DriveTrain

    found = dict[str, ForceElement]()
    for name, drive in elastic.items():
        assert drive.elasticity is not None
        with here("drives", name):
            train = DriveTrain.of(name, drive, coordinates[drive.coordinate])
            deflection = train.deflection(drive, coordinates)
            found[f"elasticity of {name}"] = elastic_gear(model, deflection, drive.elasticity, drive.backlash)
    return found
