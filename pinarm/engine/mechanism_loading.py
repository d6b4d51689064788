"""Mechanisms from files, data and models of Pinocchio: the parts of a description, bound to the model that it names."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import pinocchio as pin

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.model_source import numeric, read_robot
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
    from pinarm.mechanics.coordinates import Constraint
    from pinarm.mechanics.friction.contact import FrictionContact
    from pinarm.mechanics.loading.model_tree import Mimic
    from pinarm.mechanics.loops.loop_joints import CableLoop
    from pinarm.mechanics.points import Payload
    from pinarm.mechanics.rotors import Drive, DriveTrain


DefinitionT = TypeVar("DefinitionT")
BoundT = TypeVar("BoundT")


def mechanism_document(file: Path) -> Document:
    """Return the document of a mechanism file; for a model's file or a robot's name, a document that names it alone."""
    if file.suffix in (".yaml", ".yml"):
        return Document.read(file)
    return Document(str(file), file, {"pinarm": 1, "robot": file.name if file.suffix else str(file)}, {})


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
    return _described(Document.of_data(data, "mechanism"), Path(), {}, model=model)


def mechanism_of_data(data: Mapping[str, Any], acted: Sequence[str] = ()) -> Mechanism:
    """Return the mechanism of plain data, such as a mechanism file has; its paths start in the current folder."""
    return _described(Document.of_data(data, "mechanism"), Path(), {}, acted=acted)


def read_mechanism(
    path: str | Path, arguments: Mapping[str, float | str] | None = None, *,
    gravity: Gravity | Literal["none"] | None = None, payloads: Mapping[str, Payload] = MappingProxyType({}),
    changes: Document | None = None, locate: Place = nowhere, acted: Sequence[str] = (),
) -> Mechanism:  # fmt: skip
    """Load a mechanism as a scenario asks for it.

    Args:
        path: As in ``Mechanism.load``.
        locate: Gives errors in ``("arguments", name)`` and ``("payloads", name)`` their place in the scenario.
        acted: Coordinates along which something acts that the mechanism file does not say.
    """
    document = mechanism_document(Path(path))
    if changes is not None:
        document = document.merged(changes)
    return _described(document, Path(path).parent, arguments or {}, gravity, payloads, locate, acted)


def _described(
    document: Document,
    folder: Path,
    arguments: Mapping[str, float | str],
    gravity: Gravity | Literal["none"] | None = None,
    payloads: Mapping[str, Payload] = MappingProxyType({}),
    locate: Place = nowhere,
    acted: Sequence[str] = (),
    model: pin.Model | None = None,
) -> Mechanism:
    """Return the mechanism that a document describes; see ``read_mechanism``.

    Args:
        model: Pinocchio's model of the mechanism; ``None`` where the document names a file or has a drawing.
    """
    here = document.locating if document.places else lambda *at: locate("mechanism")
    description, data, arguments = _validated(document, arguments, locate)
    if gravity is not None:
        description = replace(description, gravity=gravity)
    units, given = arguments_of(description, arguments, here, locate)
    key = "planar" if description.planar else "robot"
    with here(key), naming_arguments(locate, here, description.arguments):
        robot, texts, source = read_robot(description, data, folder, given, model)
        check_declared(units, texts)
    units |= {name: value.unit for name, value in description.parameters.items() if value.unit}
    resolved = {name: float(value) for name, value in description.parameters.items()} | dict(numeric(texts))
    binding = _Binding(robot, description, key, here)
    model, carried = binding.loaded(robot.model, payloads, locate)
    model.gravity.linear = gravity_vector(description.gravity, robot.tree.gravity)
    model, parts = binding.parts_with_rotors(model, acted)
    constraints = binding.constraints(model, parts)
    frictions = binding.frictions(model, parts.joints, constraints)
    slipping = [friction.coupling for friction in frictions if friction.replaces]  # belts that friction alone ties
    symbols = binding.symbols()
    binding.add_armatures(model, parts.joints)
    return Mechanism(
        description.title or model.name, model, robot.xml, parts.joints, parts.balls, parts.coordinates,
        tuple(tie for tie in constraints if tie not in slipping), dict(description.drives),
        binding.forces(model, parts), symbols, resolved,
        {name: units[name].si for name in resolved if name in units}, description, source, carried,
        (*robot.notes, *proposals(model, only_joints(parts.loops))), frictions, tuple(description.control),
        here if description.control or symbols else nowhere,
    )  # fmt: skip


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


def acted_along(forces: Iterable[Any], control: Iterable[Any]) -> list[str]:
    """Return the names of coordinates along which definitions of forces act, and of what controllers need."""
    along = [name for force in forces if (name := getattr(force, "coordinate", None)) is not None]
    return [*along, *(name for controller in control for name in controller.names)]


class NamedParts(Record, frozen=True):
    """Joints with one coordinate, ball joints, joints that close loops and cables, and coordinates, by name.

    Attributes:
        counted: Angles whose turns a joint counts, as the positions of links tell them.
    """

    joints: dict[str, Joint]
    balls: dict[str, Ball]
    loops: list[LoopJoint | CableLoop]
    coordinates: dict[str, Coordinate]
    counted: dict[str, Coordinate]


class _Binding(Record, frozen=True):
    """A mechanism file beside its model, whose drawing or file ``key`` names; ``here`` gives errors their place."""

    robot: RobotModel
    description: MechanismDescription
    key: str
    here: Place

    def loaded(
        self, model: pin.Model, payloads: Mapping[str, Payload], caller: Place
    ) -> tuple[pin.Model, dict[str, Payload]]:
        """Return the model with the points of the file and the payloads of file and caller, and these by name."""
        carried: dict[str, Payload] = {}
        if self.description.points or self.description.payloads or payloads:
            from pinarm.mechanics.points import with_payloads, with_points
        for name, point in self.description.points.items():
            with self.here("points", name):
                model = with_points(model, [(name, point)])
        for place, given in ((self.here, self.description.payloads), (caller, payloads)):
            for name, payload in given.items():
                with place("payloads", name):
                    if name in carried:
                        raise InputError(f"the mechanism has a payload '{name}' already", expected="a name of its own")
                    model, carried[name] = with_payloads(model, [payload]), payload
        return model, carried

    def parts_with_rotors(self, model: pin.Model, acted: Sequence[str]) -> tuple[pin.Model, NamedParts]:
        """Return the model with joints that count turns, and with rotors; and its parts."""
        parts = self.parts(model, ())
        if angles := self.counted_angles(model, parts, acted):
            from pinarm.mechanics.rotors import with_counters

            model = with_counters(model, angles)
            parts = self.parts(model, angles)
        self.check_drives(model, parts)
        if turning := {name: drive for name, drive in self.description.drives.items() if drive.turns_rotor}:
            from pinarm.mechanics.rotors import with_rotors

            with self.here("drives"):
                model = with_rotors(model, turning, parts.coordinates)
            parts = self.parts(model, angles)
        return model, parts

    def parts(self, model: pin.Model, angles: Sequence[str]) -> NamedParts:
        joints, balls = joints_of(model), balls_of(model)
        known = positions_of(joints, balls)
        for name, value in self.description.start.items():
            with self.here("start", Key(name)):
                measured = unit_of(name, known)
            with self.here("start", name):
                check_unit(value, measured)
        loops = self.bound("loops", self.robot.tree.loops, lambda loop, name: loop.bind(model, name))
        if self.description.closures:
            from pinarm.mechanics.loops.closing_frames import closures_of

            with self.here("closures"):
                loops += closures_of(model, self.description.closures, only_joints(loops))
        turns = ball_coordinates(model, balls)
        turns |= self.loop_coordinates(model, only_joints(loops), {*joints, *turns})
        with self.here("coordinates"):
            coordinates = {**coordinates_of(model, joints, self.description.coordinates, turns), **turns}
        counted = {angle: coordinates[angle] for angle in angles}
        for angle in angles:
            from pinarm.mechanics.rotors import counter_name

            coordinates[angle] = sum_of(model, joints, [counter_name(angle)])
        return NamedParts(joints, balls, loops, coordinates, counted)

    def bound(
        self, key: str, of_model: Mapping[str, DefinitionT], bind: Callable[[DefinitionT, str], BoundT]
    ) -> list[BoundT]:
        """Bind the definitions that the model has, and those that the mechanism file has under a key."""
        with self.here(self.key):
            bound = [bind(definition, name) for name, definition in of_model.items()]
        own: Mapping[str, DefinitionT] = getattr(self.description, key)
        for name, definition in own.items():
            with self.here(key, name):
                if name in of_model or (key == "couplings" and name in self.loop_names):
                    raise InputError(f"the model has a loop or coupling '{name}' already", expected="a name of its own")
                bound.append(bind(definition, name))
        return bound

    @property
    def loop_names(self) -> set[str]:
        return {*self.robot.tree.loops, *self.description.loops}

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

    def check_drives(self, model: pin.Model, parts: NamedParts) -> None:
        mounted: dict[str, str] = {}
        for name, drive in self.description.drives.items():
            driven, key = drive.coordinate, "joint" if drive.joint else "along"
            with self.here("drives", name), within(key):
                if drive.joint:
                    joint_of(parts.joints, driven)
                elif coordinate_of(model, parts.coordinates, driven) and driven in parts.joints:
                    raise InputError(f"'{driven}' is a joint", expected=f"joint: {driven}")
                if driven in mounted:
                    raise InputError(
                        f"the {key} '{driven}' has two drives, '{mounted[driven]}' and '{name}'",
                        expected="one drive at each joint",
                    )
            mounted[driven] = name

    def add_armatures(self, model: pin.Model, joints: Mapping[str, Joint]) -> None:
        """Add the rotors that are no joints of their own to those that they drive."""
        armature: Any = model.armature
        for drive in self.description.drives.values():
            if not drive.turns_rotor:
                armature[joints[drive.joint].v] += drive.armature

    def trains(self, coordinates: Mapping[str, Coordinate]) -> Iterator[tuple[str, Drive, DriveTrain]]:
        for name, drive in self.description.drives.items():
            if drive.turns_rotor:
                from pinarm.mechanics.rotors import DriveTrain

                yield name, drive, DriveTrain.of(name, drive, coordinates[drive.coordinate])

    def constraints(self, model: pin.Model, parts: NamedParts) -> tuple[Constraint, ...]:
        joints, coordinates, tree = parts.joints, parts.coordinates, self.robot.tree
        mimics = [_mimic_coupling(mimic, joints, model) for mimic in tree.mimics]
        couplings = self.bound("couplings", tree.couplings, lambda coupling, name: coupling.bind(joints, model, name))
        counters = [_counter(angle, angle_of_links, parts) for angle, angle_of_links in parts.counted.items()]
        geared = [tie for _, drive, train in self.trains(coordinates) for tie in train.ties(drive, joints, coordinates)]
        return (*mimics, *parts.loops, *couplings, *counters, *geared)

    def frictions(
        self, model: pin.Model, joints: Mapping[str, Joint], constraints: Sequence[Constraint]
    ) -> tuple[FrictionContact, ...]:
        robot, description = self.robot, self.description
        if description.friction == "none" or not (robot.friction or description.friction):
            return ()
        from pinarm.mechanics.friction.definition import Friction

        of_model = {name: Friction(constant=value) for name, value in robot.friction.items()}
        others = [constraint for constraint in constraints if isinstance(constraint, LoopJoint | JointRelation)]
        contacts: list[FrictionContact] = []
        for name in dict.fromkeys((*description.friction, *of_model)):
            with self.here("friction", name):
                contacts.extend((description.friction.get(name) or of_model[name]).bind(name, model, joints, others))
        return tuple(contacts)

    def symbols(self) -> dict[str, Expression]:
        symbols = {}
        for name, text in self.description.symbols.items():
            with self.here("symbols", name):
                symbols[name] = Expression.parse(text)
        return symbols

    def forces(self, model: pin.Model, parts: NamedParts) -> dict[str, ForceElement]:
        forces = dict(self.robot.forces)
        for name, definition in self.description.forces.items():
            with self.here("forces", name):
                check_new(name, forces)
                forces[name] = definition.bind(model, parts.joints, parts.coordinates)
        for name, drive, train in self.trains(parts.coordinates):
            if drive.elasticity is not None:
                from pinarm.mechanics.forces.along_coordinate import elastic_gear

                with self.here("drives", name):
                    deflection = train.deflection(drive, parts.coordinates)
                    elasticity = elastic_gear(model, deflection, drive.elasticity, drive.backlash)
                    forces[f"elasticity of {name}"] = elasticity
        return forces


def _counter(angle: str, coordinate: Coordinate, parts: NamedParts) -> Constraint:
    """Return the tie of the joint that counts the turns of an angle."""
    from pinarm.mechanics.rotors import counter_name, tied_joint

    return tied_joint(f"turns of {angle}", coordinate, parts.joints[counter_name(angle)], parts.coordinates)


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
def naming_arguments(caller: Place, here: Place = nowhere, own: Container[str] = ()) -> Iterator[None]:
    """Place arguments that the model does not have at their keys: ``own`` ones here, others in the caller's file."""
    try:
        yield
    except UnknownArgument as error:
        with (here if error.name in own else caller)("arguments", Key(error.name)):
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


def _mimic_coupling(mimic: Mimic, joints: Mapping[str, Joint], model: pin.Model) -> Coupling:
    leader, follower = joint_of(joints, mimic.of), joint_of(joints, mimic.joint)
    name = f"{follower.name} mimics {leader.name}"
    weights = {follower: 1.0, leader: -mimic.multiplier}
    coupling = coupled(model, joints, name, "mimic", weights, mimic.offset)
    return replace(coupling, follower=follower.v, missing="'mimic' in the model says nothing of the parts between them")
