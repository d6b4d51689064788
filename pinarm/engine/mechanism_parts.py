"""Parts of a mechanism file, bound to the model: each checks its names and units, and says where a mistake is."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pinocchio as pin

from pinarm.errors import InputError, Key, Place
from pinarm.input.formulas.expressions import Expression
from pinarm.input.numbers import argument_word
from pinarm.input.units import Unit, unit
from pinarm.input.xacro.expansion import UnknownArgument
from pinarm.input.yaml.schema import Measured, check_unit, quantity
from pinarm.mechanics.ball_joints import Ball, ball_angles, ball_coordinates, balls_of, positions_of, unit_of
from pinarm.mechanics.coordinates import Coordinate, coordinates_of
from pinarm.mechanics.description import MechanismDescription
from pinarm.mechanics.forces.force_element import ForceElement, check_new
from pinarm.mechanics.joints import Joint, joints_of
from pinarm.mechanics.loading.pinocchio_model import RobotModel
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.records import Record

if TYPE_CHECKING:
    from pinarm.engine.constraints.constraint_rows import Constraint
    from pinarm.mechanics.couplings.coupling import JointRelation
    from pinarm.mechanics.friction.contact import FrictionContact
    from pinarm.mechanics.loops.kinds import Loop
    from pinarm.mechanics.loops.loop_joints import CableLoop
    from pinarm.mechanics.points import Payload, PointDefinition


def frictions_of(
    robot: RobotModel, description: MechanismDescription, model: pin.Model, joints: Mapping[str, Joint],
    constraints: Sequence[Constraint], here: Place,
) -> tuple[FrictionContact, ...]:  # fmt: skip
    """Return the joints with friction that sticks: those of the mechanism file, and others of the model."""
    if description.friction == "none" or not (robot.friction or description.friction):
        return ()
    from pinarm.mechanics.couplings.coupling import JointRelation
    from pinarm.mechanics.friction.definition import Friction

    others = [constraint for constraint in constraints if isinstance(constraint, LoopJoint | JointRelation)]
    contacts: list[FrictionContact] = []
    for name, definition in description.friction.items():
        with here("friction", name):
            contacts.extend(definition.bind(name, model, joints, others))
    for name, friction in robot.friction.items():
        if name not in description.friction:
            contacts.extend(Friction(constant=friction).bind(name, model, joints, ()))
    return tuple(contacts)


class NamedParts(Record, frozen=True):
    """What has a name in a model and may move.

    Attributes:
        joints: Joints with one coordinate.
        balls: Ball joints.
        loops: Joints that close loops, and cables.
        coordinates: Coordinates of all of these, and those defined beside them.
    """

    joints: dict[str, Joint]
    balls: dict[str, Ball]
    loops: list[LoopJoint | CableLoop]
    coordinates: dict[str, Coordinate]


def named_parts(
    robot: RobotModel, description: MechanismDescription, model: pin.Model, key: str, here: Place
) -> NamedParts:
    """Return joints, loop joints and coordinates by name.

    Args:
        robot: What the model's file says.
        description: What the mechanism file says.
        model: Pinocchio's model.
        key: Key of the mechanism file that names the drawing or the model.
        here: Gives errors their place.

    Raises:
        InputError: One does not exist, or has the name of another one.
    """
    joints, balls = joints_of(model), balls_of(model)
    check_start(description, joints, balls, here)
    turns = {**ball_coordinates(balls), **ball_angles(balls)}
    loops = loop_joints_of(model, key, robot.loops, description.loops, here)
    if description.closures:
        from pinarm.mechanics.loops.closing_frames import closures_of

        with here("closures"):
            loops += closures_of(model, description.closures, only_joints(loops))
    turns |= loop_coordinates_of(model, only_joints(loops), {*joints, *turns}, here)
    with here("coordinates"):
        coordinates = {**coordinates_of(model, joints, description.coordinates, turns), **turns}
    return NamedParts(joints, balls, loops, coordinates)


def tying(constraints: Sequence[Constraint], frictions: Sequence[FrictionContact]) -> tuple[Constraint, ...]:
    """Return the constraints without belts that slip: friction alone ties their wheels."""
    slipping = [friction.coupling for friction in frictions if friction.replaces]
    return tuple(constraint for constraint in constraints if constraint not in slipping)


def loop_coordinates_of(
    model: pin.Model, loops: Sequence[LoopJoint], known: Container[str], here: Place
) -> dict[str, Coordinate]:
    """Return the coordinates of loop joints.

    Raises:
        InputError: One has the name of a joint's.
    """
    if not loops:
        return {}
    from pinarm.mechanics.loops.relative import loop_coordinates

    coordinates = loop_coordinates(model, loops)
    for name in coordinates:
        if name in known:
            with here("loops", name.rpartition(".")[0]):
                raise InputError(f"its coordinate '{name}' has the name of a joint", expected="a name of its own")
    return coordinates


def check_start(
    description: MechanismDescription, joints: Mapping[str, Joint], balls: Mapping[str, Ball], here: Place
) -> None:
    """Check names and units of the joint coordinates near which the loops close."""
    known = positions_of(joints, balls)
    for name, value in description.start.items():
        with here("start", Key(name)):
            measured = unit_of(name, known)
        with here("start", name):
            check_unit(value, measured)


def loop_joints_of(
    model: pin.Model, key: str, drawn: Mapping[str, Loop], said: Mapping[str, Loop], here: Place
) -> list[LoopJoint | CableLoop]:
    """Return the loop joints and cables of a drawing or a model's file, and those that the mechanism file says beside.

    Args:
        model: Pinocchio's model.
        key: Key of the mechanism file that names the drawing or the model.
        drawn: What that says.
        said: What the mechanism file says.
        here: Gives errors their place.
    """
    with here(key):
        loops: list[LoopJoint | CableLoop] = [loop.bind(model, name) for name, loop in drawn.items()]
    for name, loop in said.items():
        with here("loops", name):
            if name in drawn:
                raise InputError(f"the model has a loop joint '{name}' already", expected="a name of its own")
            loops.append(loop.bind(model, name))
    return loops


def only_joints(loops: Iterable[LoopJoint | CableLoop]) -> list[LoopJoint]:
    """Return the loop joints, without cables."""
    return [loop for loop in loops if isinstance(loop, LoopJoint)]


def arguments_of(
    description: MechanismDescription, arguments: Mapping[str, float | str], here: Place, caller: Place
) -> tuple[dict[str, Unit], dict[str, float | str]]:
    """Return the units of the model's arguments and the given values, numbers in SI.

    Raises:
        InputError: The model would have to be given numbers in another unit than that of SI, or a value cannot be read.
    """
    units, given = dict[str, Unit](), dict[str, float | str]()
    for name, text in description.arguments.items():
        with here("arguments", name):
            units[name] = _unit_of_model(unit(text))
    for name, value in arguments.items():
        with caller("arguments", name):
            given[name] = _argument(name, value, units.get(name))
    return units, given


def _unit_of_model(written: Unit) -> Unit:
    """Return the unit of an argument in the model; in a default of another unit than SI the number would be wrong."""
    if written.factor == 1.0:
        return written
    raise InputError(
        f"the model is given numbers in SI, and {written} is no unit of it", expected=str(written.si),
        hint=f"in the model the argument in {written.si}; scenarios may give it in any unit, in {written} too",
    )  # fmt: skip


@contextmanager
def naming_arguments(place: Place) -> Iterator[None]:
    """Place arguments that the model does not have at their keys."""
    try:
        yield
    except UnknownArgument as error:
        with place("arguments", Key(error.name)):
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


def couplings_of(
    robot: RobotModel, description: MechanismDescription, model: pin.Model, joints: Mapping[str, Joint], key: str,
    here: Place,
) -> list[JointRelation]:  # fmt: skip
    """Return the couplings, those of the model and those of the mechanism file; see ``named_parts``.

    Raises:
        InputError: One has the name of a loop joint, or of a coupling of the model.
    """
    with here(key):
        drawn = [definition.bind(joints, model, name) for name, definition in robot.couplings.items()]
    couplings: list[JointRelation] = [*drawn]
    for name, definition in description.couplings.items():
        with here("couplings", name):
            if name in description.loops or name in robot.loops:
                raise InputError(f"the coupling '{name}' has the name of a loop joint", expected="a name of its own")
            if name in robot.couplings:
                raise InputError(f"the model has a coupling '{name}' already", expected="a name of its own")
            couplings.append(definition.bind(joints, model, name))
    return couplings


def forces_of(
    robot: RobotModel, description: MechanismDescription, model: pin.Model, joints: Mapping[str, Joint],
    coordinates: Mapping[str, Coordinate], here: Place,
) -> dict[str, ForceElement]:  # fmt: skip
    """Return the force elements by name, those of the model and those of the mechanism file.

    Raises:
        InputError: Two have one name.
    """
    forces = dict(robot.forces)
    if description.forces:
        from pinarm.mechanics.forces.kinds import bound
    for name, definition in description.forces.items():
        with here("forces", name):
            check_new(name, forces)
            forces[name] = bound(definition, model, joints, coordinates)
    return forces


def symbols_of(description: MechanismDescription, here: Place) -> dict[str, Expression]:
    """Return the formulas of the published symbols."""
    symbols = {}
    for name, text in description.symbols.items():
        with here("symbols", name):
            symbols[name] = Expression.parse(text)
    return symbols
