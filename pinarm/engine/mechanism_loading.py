"""Mechanisms from files, data and models of Pinocchio: the parts of a description, bound to the model that it names."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import pinocchio as pin

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.model_source import RobotReader, numeric, read_robot, robot_of_model
from pinarm.errors import InputError, Key, Place, nowhere, within
from pinarm.input.formulas.expressions import Expression
from pinarm.input.formulas.grammar import CONSTANTS
from pinarm.input.units import Unit, argument_word
from pinarm.input.xacro.expander import UnknownArgument, check_declared
from pinarm.input.yaml.document import Document, Values, varied
from pinarm.input.yaml.schema import (
    AnyQuantity,
    Measured,
    check_unit,
    quantity,
    with_parameters,
    without_formulas,
)
from pinarm.mechanics.ball_joints import Ball, ball_coordinates, balls_of, positions_of, unit_of
from pinarm.mechanics.coordinates import Coordinate, coordinate_of, coordinates_of, sum_of
from pinarm.mechanics.couplings.coupling import Coupling, JointRelation, coupled
from pinarm.mechanics.description import Gravity, MechanismDescription, gravity_vector, gravity_words
from pinarm.mechanics.forces.force_element import ForceElement, check_new
from pinarm.mechanics.joints import Joint, joint_of, joints_of
from pinarm.mechanics.loading.pinocchio_model import RobotModel
from pinarm.mechanics.loops.closing_frames import proposals
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint_rows import Constraint
    from pinarm.mechanics.friction.contact import FrictionContact
    from pinarm.mechanics.loading.model_tree import Mimic
    from pinarm.mechanics.loops.loop_joints import CableLoop
    from pinarm.mechanics.points import Payload, PointDefinition
    from pinarm.mechanics.rotors import Drive, DriveTrain


def mechanism_document(file: Path) -> Document:
    """Return the document of a mechanism file; for a model's file or a robot's name, a document that names it alone."""
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
    (description, plain, _), read = _validated(document, {}, nowhere), partial(robot_of_model, model)
    return _build(description, plain, Path(), {}, {}, document.locating, nowhere, read)


def read_mechanism(
    path: str | Path, arguments: Mapping[str, float | str] | None = None, *,
    gravity: Gravity | Literal["none"] | None = None, payloads: Mapping[str, Payload] | None = None,
    changes: Document | None = None, locate: Place = nowhere, acted: Sequence[str] = (),
) -> Mechanism:  # fmt: skip
    """Load a mechanism as a scenario asks for it.

    Args:
        path: As in ``Mechanism.load``.
        locate: Gives errors in ``("arguments", name)`` and ``("payloads", name)`` their place in the scenario.
    """
    document = mechanism_document(Path(path))
    if changes is not None:
        document = document.merged(changes)
    return _described(document, Path(path).parent, arguments or {}, gravity, payloads or {}, locate, acted)


def mechanism_of_data(data: Mapping[str, Any], acted: Sequence[str] = ()) -> Mechanism:
    """Return the mechanism of plain data, such as a mechanism file has; its paths start in the current folder."""
    return _described(Document.of_data(data, "mechanism"), Path(), {}, acted=acted)


def _described(
    document: Document,
    folder: Path,
    arguments: Mapping[str, float | str],
    gravity: Gravity | Literal["none"] | None = None,
    payloads: Mapping[str, Payload] = MappingProxyType({}),
    locate: Place = nowhere,
    acted: Sequence[str] = (),
) -> Mechanism:
    """Return the mechanism that a document describes; see ``read_mechanism``."""
    here = document.locating if document.places else lambda *at: locate("mechanism")
    description, data, arguments = _validated(document, arguments, locate)
    if gravity is not None:
        description = replace(description, gravity=gravity)
    return _build(description, data, folder, arguments, payloads, here, locate, acted=acted)


def _validated(
    document: Document, arguments: Mapping[str, float | str], caller: Place
) -> tuple[MechanismDescription, Mapping[str, Any], Mapping[str, float | str]]:
    """Return the description of a file, its plain data without parameters, and the arguments that are no parameters."""
    parameters = parameters_of(document, arguments, caller)
    if not parameters:
        return document.validate(MechanismDescription), document.data, arguments
    with with_parameters(parameters):
        description = document.validate(MechanismDescription)
    others = {name: value for name, value in arguments.items() if name not in parameters}
    if description.planar:
        with naming_arguments(caller):
            check_declared(others, parameters)
    own = {name: value for name, value in parameters.items() if not value.computed}
    formulas = {name: document.data["parameters"][name] for name in parameters.keys() - own.keys()}
    symbols, plain = {**formulas, **description.symbols}, without_formulas(document.data, description)
    data = {**{key: value for key, value in plain.items() if key != "parameters"}, "symbols": symbols}
    return replace(description, parameters=own, symbols=symbols), data, others


def _build(
    description: MechanismDescription, data: Mapping[str, Any], folder: Path,
    arguments: Mapping[str, float | str], payloads: Mapping[str, Payload], here: Place, caller: Place,
    read: RobotReader = read_robot, acted: Sequence[str] = (),
) -> Mechanism:  # fmt: skip
    """Build a mechanism from its description; ``here`` locates its own mistakes, ``caller`` the caller's."""
    units, given = arguments_of(description, arguments, here, caller)
    key = "planar" if description.planar else "robot"
    with here(key), naming_arguments(caller), naming_arguments(here, description.arguments):
        robot, texts, source = read(description, data, folder, given)
    parameters = description.parameters
    resolved = {**{name: float(value) for name, value in parameters.items()}, **dict(numeric(texts))}
    with naming_arguments(here):
        check_declared(units, texts)
    units |= {name: value.unit for name, value in parameters.items() if value.unit}
    model, carried = loaded(marked(robot.model, description.points, here), description.payloads, payloads, here, caller)
    model.gravity.linear = gravity_vector(description.gravity, robot.tree.gravity)
    reading = _Reading(robot, description, key, here)
    model, parts, counters = reading.movable(model, acted)
    constraints = reading.constraints(model, parts, counters)
    frictions = reading.frictions(model, parts.joints, constraints)
    slipping = [friction.coupling for friction in frictions if friction.replaces]  # belts that friction alone ties
    symbols = reading.symbols()
    reading.mount_drives(model, parts.joints)
    return Mechanism(
        description.title or model.name, model, robot.xml, parts.joints, parts.balls, parts.coordinates,
        tuple(tie for tie in constraints if tie not in slipping), dict(description.drives),
        reading.forces(model, parts), symbols, resolved,
        {name: units[name].si for name in resolved if name in units}, description, source, carried,
        (*robot.notes, *proposals(model, only_joints(parts.loops))), frictions, tuple(description.control),
        here if description.control or symbols else nowhere,
    )  # fmt: skip


def acted_along(forces: Iterable[Any], control: Iterable[Any]) -> list[str]:
    """Return the names of coordinates along which definitions of forces act, and of what controllers need."""
    along = [name for force in forces if (name := getattr(force, "coordinate", None)) is not None]
    return [*along, *(name for controller in control for name in controller.names)]


class NamedParts(Record, frozen=True):
    """Joints with one coordinate, ball joints, joints that close loops and cables, and coordinates, by name."""

    joints: dict[str, Joint]
    balls: dict[str, Ball]
    loops: list[LoopJoint | CableLoop]
    coordinates: dict[str, Coordinate]


class _Reading(Record, frozen=True):
    """A mechanism file beside its model, whose drawing or file ``key`` names; ``here`` gives errors their place."""

    robot: RobotModel
    description: MechanismDescription
    key: str
    here: Place

    def movable(self, model: pin.Model, acted: Sequence[str]) -> tuple[pin.Model, NamedParts, list[Constraint]]:
        """Return the model with joints that count turns, and with rotors; its parts, and what ties the counters.

        ``acted`` are coordinates along which something acts that the mechanism file does not say.
        """
        parts = self.parts(model)
        if angles := self.counted_angles(model, parts, acted):
            from pinarm.mechanics.rotors import with_counters

            model = with_counters(model, angles)
            parts = self.parts(model)
        parts, counters = _counting(model, parts, angles)
        if (geared := self.with_rotors(model, parts.coordinates)) is not model:
            model = geared
            parts, counters = _counting(model, self.parts(model), angles)
        return model, parts, counters

    def parts(self, model: pin.Model) -> NamedParts:
        joints, balls = joints_of(model), balls_of(model)
        self.check_start(joints, balls)
        turns = ball_coordinates(model, balls)
        loops = self.loops(model)
        if self.description.closures:
            from pinarm.mechanics.loops.closing_frames import closures_of

            with self.here("closures"):
                loops += closures_of(model, self.description.closures, only_joints(loops))
        turns |= self.loop_coordinates(model, only_joints(loops), {*joints, *turns})
        with self.here("coordinates"):
            coordinates = {**coordinates_of(model, joints, self.description.coordinates, turns), **turns}
        return NamedParts(joints, balls, loops, coordinates)

    def check_start(self, joints: Mapping[str, Joint], balls: Mapping[str, Ball]) -> None:
        known = positions_of(joints, balls)
        for name, value in self.description.start.items():
            with self.here("start", Key(name)):
                measured = unit_of(name, known)
            with self.here("start", name):
                check_unit(value, measured)

    def loops(self, model: pin.Model) -> list[LoopJoint | CableLoop]:
        drawn = self.robot.tree.loops
        with self.here(self.key):
            loops: list[LoopJoint | CableLoop] = [loop.bind(model, name) for name, loop in drawn.items()]
        for name, loop in self.description.loops.items():
            with self.here("loops", name):
                if name in drawn:
                    raise InputError(f"the model has a loop joint '{name}' already", expected="a name of its own")
                loops.append(loop.bind(model, name))
        return loops

    def loop_coordinates(
        self, model: pin.Model, loops: Sequence[LoopJoint], known: Container[str]
    ) -> dict[str, Coordinate]:
        if not loops:
            return {}
        from pinarm.mechanics.loops.lower_pairs import loop_coordinates

        coordinates = loop_coordinates(model, loops)
        for name in coordinates:
            if name in known:
                with self.here("loops", name.rpartition(".")[0]):
                    raise InputError(f"its coordinate '{name}' has the name of a joint", expected="a name of its own")
        return coordinates

    def counted_angles(self, model: pin.Model, parts: NamedParts, acted: Sequence[str]) -> list[str]:
        """Return the angles whose turns are counted: those known up to whole turns, and that matter beyond these."""
        description, known = self.description, parts.coordinates
        for k, name in enumerate(description.turns):
            with self.here("turns", k):
                if not coordinate_of(model, known, name).wraps:
                    raise InputError(
                        f"'{name}' counts its turns, or has none",
                        expected="L.angle of a loop joint, or J.yaw or J.roll of a ball joint",
                    )
        names = [*description.turns, *acted_along(description.forces.values(), description.control), *acted]
        return [name for name in dict.fromkeys(names) if name in known and known[name].wraps]

    def with_rotors(self, model: pin.Model, coordinates: Mapping[str, Coordinate]) -> pin.Model:
        """Return the model with a joint for the rotor of every drive that turns one of its own; itself without any."""
        turning = {name: drive for name, drive in self.description.drives.items() if drive.turns_rotor}
        if not turning:
            return model
        from pinarm.mechanics.rotors import with_rotors

        for name, drive in turning.items():
            if drive.joint:
                with self.here("drives", name), within("joint"):
                    joint_of(joints_of(model), drive.joint)
                continue
            with self.here("drives", name), within("along"):
                coordinate_of(model, coordinates, drive.along)
                if drive.along in joints_of(model):
                    raise InputError(f"'{drive.along}' is a joint", expected=f"joint: {drive.along}")
        with self.here("drives"):
            return with_rotors(model, turning, coordinates)

    def trains(self, coordinates: Mapping[str, Coordinate]) -> Iterator[tuple[str, Drive, DriveTrain]]:
        for name, drive in self.description.drives.items():
            if drive.turns_rotor:
                from pinarm.mechanics.rotors import DriveTrain

                yield name, drive, DriveTrain.of(name, drive, coordinates[drive.coordinate])

    def constraints(
        self, model: pin.Model, parts: NamedParts, counters: Sequence[Constraint]
    ) -> tuple[Constraint, ...]:
        joints, coordinates = parts.joints, parts.coordinates
        mimics = [_mimic_coupling(mimic, joints, model) for mimic in self.robot.tree.mimics]
        trains = self.trains(coordinates)
        geared = [tie for _, drive, train in trains for tie in train.ties(drive, joints, coordinates)]
        return (*mimics, *parts.loops, *self.couplings(model, joints), *counters, *geared)

    def couplings(self, model: pin.Model, joints: Mapping[str, Joint]) -> list[JointRelation]:
        robot = self.robot
        with self.here(self.key):
            couplings: list[JointRelation] = [
                definition.bind(joints, model, name) for name, definition in robot.tree.couplings.items()
            ]
        for name, definition in self.description.couplings.items():
            with self.here("couplings", name):
                if name in self.description.loops or name in robot.tree.loops:
                    said = f"the coupling '{name}' has the name of a loop joint"
                    raise InputError(said, expected="a name of its own")
                if name in robot.tree.couplings:
                    raise InputError(f"the model has a coupling '{name}' already", expected="a name of its own")
                couplings.append(definition.bind(joints, model, name))
        return couplings

    def frictions(
        self, model: pin.Model, joints: Mapping[str, Joint], constraints: Sequence[Constraint]
    ) -> tuple[FrictionContact, ...]:
        robot, description = self.robot, self.description
        if description.friction == "none" or not (robot.friction or description.friction):
            return ()
        from pinarm.mechanics.friction.definition import Friction

        others = [constraint for constraint in constraints if isinstance(constraint, LoopJoint | JointRelation)]
        contacts: list[FrictionContact] = []
        for name, definition in description.friction.items():
            with self.here("friction", name):
                contacts.extend(definition.bind(name, model, joints, others))
        for name, friction in robot.friction.items():
            if name not in description.friction:
                contacts.extend(Friction(constant=friction).bind(name, model, joints, ()))
        return tuple(contacts)

    def symbols(self) -> dict[str, Expression]:
        symbols = {}
        for name, text in self.description.symbols.items():
            with self.here("symbols", name):
                symbols[name] = Expression.parse(text)
        return symbols

    def mount_drives(self, model: pin.Model, joints: Mapping[str, Joint]) -> None:
        mounted: dict[str, str] = {}
        armature: Any = model.armature
        for name, drive in self.description.drives.items():
            driven, key = drive.coordinate, "joint" if drive.joint else "along"
            with self.here("drives", name), within(key):
                joint = joint_of(joints, driven) if drive.joint else None
                if driven in mounted:
                    raise InputError(
                        f"the {key} '{driven}' has two drives, '{mounted[driven]}' and '{name}'",
                        expected="one drive at each joint",
                    )
            mounted[driven] = name
            if joint is not None and not drive.turns_rotor:
                armature[joint.v] += drive.armature

    def forces(self, model: pin.Model, parts: NamedParts) -> dict[str, ForceElement]:
        forces = dict(self.robot.forces)
        if self.description.forces:
            from pinarm.mechanics.forces.kinds import bound
        for name, definition in self.description.forces.items():
            with self.here("forces", name):
                check_new(name, forces)
                forces[name] = bound(definition, model, parts.joints, parts.coordinates)
        for name, drive, train in self.trains(parts.coordinates):
            if drive.elasticity is not None:
                from pinarm.mechanics.forces.along_coordinate import elastic_gear

                with self.here("drives", name):
                    deflection = train.deflection(drive, parts.coordinates)
                    elasticity = elastic_gear(model, deflection, drive.elasticity, drive.backlash)
                    forces[f"elasticity of {name}"] = elasticity
        return forces


def _counting(model: pin.Model, parts: NamedParts, angles: Sequence[str]) -> tuple[NamedParts, list[Constraint]]:
    """Return parts of a model with counters whose coordinates are those of the counters, and what ties these."""
    if not angles:
        return parts, []
    from pinarm.mechanics.rotors import GearedRotor, counter_name

    ties: list[Constraint] = [
        GearedRotor(f"turns of {angle}", parts.coordinates[angle], rotor=parts.joints[counter_name(angle)])
        for angle in angles
    ]
    counted: dict[str, Coordinate] = {angle: sum_of(model, parts.joints, [counter_name(angle)]) for angle in angles}
    return replace(parts, coordinates={**parts.coordinates, **counted}), ties


def only_joints(loops: Iterable[LoopJoint | CableLoop]) -> list[LoopJoint]:
    """Return the loop joints, without cables."""
    return [loop for loop in loops if isinstance(loop, LoopJoint)]


def parameters_of(document: Document, arguments: Mapping[str, float | str], caller: Place) -> dict[str, Measured]:
    """Return the parameters of a mechanism file, with other values for those that are given as arguments.

    Args:
        arguments: Values by name: numbers in SI, or text with units.
    """
    known, given = dict[str, Measured](), document.data.get("parameters") if isinstance(document.data, dict) else None
    for name, text in given.items() if isinstance(given, dict) else ():
        with document.locating("parameters", Key(name)):
            if not name.isidentifier() or name in CONSTANTS:
                raise InputError(f"'{name}' cannot be in a formula", expected="a name of letters, digits and _")
        with document.locating("parameters", name), with_parameters(known):
            known[name] = AnyQuantity.read(text, bare=False)
        if name in arguments:
            with caller("arguments", name):
                own = known[name].unit
                known[name] = Measured(_argument(name, arguments[name], own.si if own else None))
                known[name].unit = own
    return known


def arguments_of(
    description: MechanismDescription, arguments: Mapping[str, float | str], here: Place, caller: Place
) -> tuple[dict[str, Unit], dict[str, float | str]]:
    """Return units of the model's arguments, and the values given by the file or by the caller, numbers in SI."""
    units, given = dict[str, Unit](), dict[str, float | str]()
    for name in description.arguments:
        with here("arguments", name):
            written, value = description.argument(name)
            if value is not None:
                given[name] = value if isinstance(value, str) else float(value)
            elif written and written.factor != 1.0:  # the model's own number is in SI
                raise InputError(
                    f"the model is given numbers in SI, and {written} is no unit of it",
                    expected=str(written.si),
                    hint=f"in the model the argument in {written.si}; scenarios may give it in any unit, in {written} "
                    "too",
                )
            if written is not None:
                units[name] = written.si
    for name, text in arguments.items():
        with caller("arguments", name):
            given[name] = _argument(name, text, units.get(name))
    return units, given


@contextmanager
def naming_arguments(place: Place, only: Container[str] | None = None) -> Iterator[None]:
    """Place arguments that the model does not have, of these only, at their keys."""
    try:
        yield
    except UnknownArgument as error:
        with place("arguments", Key(error.name)) if only is None or error.name in only else nullcontext():
            raise


def _argument(name: str, value: float | str, expected: Unit | None) -> float | str:
    """Return an argument: a word, or a number in SI, its dimension checked where the mechanism file gives its unit."""
    if expected is None and (word := argument_word(value)) is not None:
        return word
    unitless = expected is None or str(expected) == "1" or not isinstance(value, str | Measured)
    kind = quantity(str(expected)) if expected else Measured
    try:
        return float(kind.read(value, bare=unitless))
    except InputError as error:
        raise type(error)(f"the argument {name}: {error.message}", expected=error.expected, hint=error.hint) from None


def loaded(
    model: pin.Model, own: Mapping[str, Payload], given: Mapping[str, Payload], here: Place, caller: Place
) -> tuple[pin.Model, dict[str, Payload]]:
    """Return the model with the payloads of its file and of the caller, and all of them by name."""
    carried: dict[str, Payload] = {}
    if not own and not given:
        return model, carried
    from pinarm.mechanics.points import with_payloads

    for place, payloads in ((here, own), (caller, given)):
        for name, payload in payloads.items():
            with place("payloads", name):
                if name in carried:
                    raise InputError(f"the mechanism has a payload '{name}' already", expected="a name of its own")
                model, carried[name] = with_payloads(model, [payload]), payload
    return model, carried


def marked(model: pin.Model, points: Mapping[str, PointDefinition], here: Place) -> pin.Model:
    """Return the model with the points of its mechanism file."""
    if not points:
        return model
    from pinarm.mechanics.points import with_points

    for name, point in points.items():
        with here("points", name):
            model = with_points(model, [(name, point)])
    return model


def _mimic_coupling(mimic: Mimic, joints: Mapping[str, Joint], model: pin.Model) -> Coupling:
    leader, follower = joint_of(joints, mimic.of), joint_of(joints, mimic.joint)
    name = f"{follower.name} mimics {leader.name}"
    weights = {follower: 1.0, leader: -mimic.multiplier}
    coupling = coupled(model, joints, name, "mimic", weights, mimic.offset)
    return replace(coupling, follower=follower.v, missing="'mimic' in the model says nothing of the parts between them")
