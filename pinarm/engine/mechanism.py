"""Mechanism: joints, links, constraints, drives and forces with their names. It never changes; a state (q, v) does.

The record that the engine computes with. ``pinarm.Mechanism``, with methods for users, is ``use.mechanism``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from msgspec import field
from msgspec.structs import replace as replace_fields

from pinarm.arrays import Array, Flags, Indices
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.equation import massive
from pinarm.errors import Place, nowhere
from pinarm.input.formulas.expressions import Expression
from pinarm.input.roots import file_root, root_of
from pinarm.input.units import Unit, decimal
from pinarm.input.xacro.expander import expand_columns
from pinarm.mechanics.ball_joints import Ball, positions_of
from pinarm.mechanics.coordinates import Coordinate, coordinate_of
from pinarm.mechanics.couplings.coupling import JointRelation
from pinarm.mechanics.description import MechanismDescription
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.model_variants import ModelVariants, VariantsDiffer
from pinarm.mechanics.joints import Joint, links_of
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.perturbation import perturbed, perturbed_numbers
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from pinarm.engine.model_source import Source
    from pinarm.mechanics.control.function import FunctionControl
    from pinarm.mechanics.control.kinds import ControlDefinition
    from pinarm.mechanics.coordinates import Constraint
    from pinarm.mechanics.friction.contact import FrictionContact
    from pinarm.mechanics.loading.pinocchio_layout import PinocchioLayout
    from pinarm.mechanics.points import Payload
    from pinarm.mechanics.rotors import Drive


class Mechanism(Record, frozen=True):
    """A mechanism with its names.

    Attributes:
        title: For headings.
        model: Pinocchio's model, gravity and armatures set.
        xml: The URDF or MJCF text behind it.
        joints: Joints with one coordinate, by name.
        balls: Ball joints, by name.
        coordinates: Coordinates of the joints and those defined beside them, by name.
        constraints: Loop joints and couplings; none of an open chain.
        drives: Motors and gears, by name.
        forces: Force elements, by name.
        symbols: Published symbols and the formulas they stand for.
        arguments: Values of the model's arguments [SI].
        argument_units: Their units in SI, as far as the mechanism file says them.
        description: What the mechanism file says.
        source: The files behind it.
        payloads: What links carry beside the model's own masses, by name.
        notes: What is not modelled as the files have it.
        frictions: Joints with dry friction that sticks.
        control: Controllers of its drives, at work in forward runs: those of the file first.
        locate: Gives mistakes of these, and of symbols, their place in the mechanism file: reading does not see them.
    """

    title: str
    model: pin.Model
    xml: str
    joints: Mapping[str, Joint]
    balls: Mapping[str, Ball]
    coordinates: Mapping[str, Coordinate]
    constraints: tuple[Constraint, ...]
    drives: Mapping[str, Drive]
    forces: Mapping[str, ForceElement]
    symbols: Mapping[str, Expression]
    arguments: Mapping[str, float]
    argument_units: Mapping[str, Unit]
    description: MechanismDescription
    source: Source
    payloads: Mapping[str, Payload] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    frictions: tuple[FrictionContact, ...] = ()
    control: tuple[ControlDefinition | FunctionControl, ...] = ()
    locate: Place = nowhere

    def __repr__(self) -> str:
        """Return its title, and how many joints, constraints and freedoms it has."""
        count = len(self.joints) + len(self.balls)
        return f"<Mechanism '{self.title}': {count} joints, {len(self.constraints)} constraints, nv {self.model.nv}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the fields for pickling; another process binds the forces, which are functions, again.

        Results computed from the fields are left out.
        """
        own = {name: getattr(self, name) for name in self.__struct_fields__}
        own["forces"] = {name: force for name, force in self.forces.items() if name not in self.description.forces}
        return _bound_again, (type(self), own)

    def perturbed(self, seed: int) -> Mechanism:
        """Return the mechanism with its numbers changed in the last digits; see ``mechanics.perturbation``."""
        forces = perturbed_numbers(self.description.forces, np.random.default_rng(seed))
        description = replace_fields(self.description, forces=forces)
        return replace(self, model=perturbed(self.model, seed), description=description)._bound()

    def with_model(self, model: pin.Model) -> Mechanism:
        """Return the mechanism with other numbers in its model."""
        return replace(self, model=model)._bound()

    def _bound(self) -> Mechanism:
        definitions = self.description.forces.items()
        forces = {name: force.bind(self.model, self.joints, self.coordinates) for name, force in definitions}
        return replace(self, forces={**self.forces, **forces})

    @cached_property
    def dynamics(self) -> Dynamics:
        """Return the equation of motion with the mechanism's own forces."""
        return Dynamics.of(self.model, self.forces)

    @cached_property
    def pinocchio_layout(self) -> PinocchioLayout:
        """Where ``pin.buildModelFromUrdf`` has the joints; see ``from_pinocchio``."""
        from pinarm.mechanics.loading.pinocchio_layout import PinocchioLayout

        if self.source.model is not None:
            return PinocchioLayout.between(self.source.model, self.model, self.joints, self.balls)
        return PinocchioLayout.of(self.xml, self.model, self.joints, self.balls)

    @cached_property
    def relations(self) -> tuple[JointRelation, ...]:
        """Couplings: relations between joint coordinates."""
        return tuple(tie for tie in self.constraints if isinstance(tie, JointRelation))

    @cached_property
    def closure(self) -> Closure:
        if not isinstance(self.model, ModelVariants):
            return Closure.of(self.model, self.constraints)
        from pinarm.engine.constraints.closure import VariantClosure  # of sweeps only

        return VariantClosure(self.model, self.constraints)

    @cached_property
    def massive(self) -> bool:
        """Whether every body has a mass and moments of inertia."""
        return massive(self.model)

    @cached_property
    def start(self) -> Mapping[str, float]:
        """Return rough joint coordinates near which the loops close [rad or m], as far as the mechanism file says."""
        known = positions_of(self.joints, self.balls)  # of a part of the mechanism there may be fewer
        return {name: float(value) for name, value in self.description.start.items() if name in known}

    def driven_joint(self, drive: str) -> Joint:
        """Return the joint that a drive moves: that of its rotor, where it has one, or its own, by name."""
        from pinarm.mechanics.rotors import rotor_name

        definition = self.drives[drive]
        return self.joints[rotor_name(drive) if definition.turns_rotor else definition.joint]

    @cached_property
    def dotted_names(self) -> frozenset[str]:
        """Names of joints, links, drives, loop joints and couplings that have dots in them, which separate words."""
        ties = (constraint.name for constraint in self.constraints)
        names = (*self.joints, *self.balls, *links_of(self.model), *self.drives, *ties)
        return frozenset(name for name in names if "." in name)

    @cached_property
    def worded(self) -> frozenset[str]:
        """Names that stand for symbols, arguments and coordinates, not only for words of quantities."""
        return frozenset((*self.symbols, *self.arguments, *self.coordinates))

    @property
    def gravity(self) -> float:
        """Magnitude of gravity [m/s^2]."""
        return math.hypot(*self.model.gravity.linear.tolist())

    def coordinate(self, name: str) -> Coordinate:
        return coordinate_of(self.model, self.coordinates, name)


def _bound_again(kind: type[Mechanism], own: Mapping[str, Any]) -> Mechanism:
    return kind(**own)._bound()


def mechanism_variants(
    mechanism: Mechanism, given: Mapping[str, float | str], columns: Mapping[str, Sequence[float] | Array]
) -> tuple[Mechanism, Flags]:
    """Return a mechanism whose model and arguments are those of k variants, and which of them are such, shape (k,).

    The others take other branches of the model, or have numbers that no body can have: they are to be read alone.

    Args:
        mechanism: The first of the variants.
        given: The arguments that it was read with [SI].
        columns: Those that vary, with their values in all variants [SI].
    """
    from pinarm.mechanics.loading.urdf_variants import model_variants

    _require_plain(mechanism)
    source = mechanism.source
    said = mechanism.description
    if source.model is not None or source.base is not None or said.planar is not None or said.parameters:
        raise VariantsDiffer("a model that is not read from a file as it is")
    arrays = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    with file_root(None, source.packages):
        expanded = expand_columns(source.robot, given, arrays, root=root_of(source.folder / "mechanism.yaml"))
    if expanded is None or not expanded.columns:
        raise VariantsDiffer("a model whose expansion is not recorded, or in which no number varies")
    variants, possible = model_variants(mechanism.model, mechanism.xml, expanded.xml, expanded.columns)
    arguments = {
        name: _numbers(argument) for name, argument in expanded.arguments.items() if name in mechanism.arguments
    }
    changed = replace(mechanism, model=variants, arguments=arguments)
    return changed, possible & expanded.holds


def alike_variants(mechanism: Mechanism, count: int) -> Mechanism:
    """Return a mechanism as variants of itself that do not differ, but may move in different ways."""
    _require_plain(mechanism)
    return replace(mechanism, model=ModelVariants.alike(mechanism.model, count))


def some_variants(mechanism: Mechanism, places: Indices) -> Mechanism:
    """Return the mechanism of some of its variants."""
    variants = mechanism.model
    assert isinstance(variants, ModelVariants)
    columns = {name: np.asarray(value) for name, value in mechanism.arguments.items()}
    arguments = {name: column[places] if column.ndim else float(column) for name, column in columns.items()}
    return replace(mechanism, model=variants.some(places), arguments=arguments)


def _require_plain(mechanism: Mechanism) -> None:
    """Raise where more depends on the model than the motion of its links; of forces see ``require_joint_forces``."""
    if mechanism.frictions or mechanism.control or mechanism.balls:
        raise VariantsDiffer("friction, controllers or ball joints")
    if not all(isinstance(constraint, LoopJoint) for constraint in mechanism.constraints):
        raise VariantsDiffer("couplings or cables")


def require_joint_forces(forces: Mapping[str, ForceElement]) -> None:
    """Raise where force elements do more than push joints evenly, or by their coordinates and velocities."""
    if not forces:
        return
    from pinarm.mechanics.forces.joint_forces import SpringDamper

    if others := [name for name, force in forces.items() if not (force.steady or isinstance(force, SpringDamper))]:
        raise VariantsDiffer(f"the force element '{others[0]}'")


def _numbers(argument: str | Array) -> float | Array:
    """Return an argument, or those of all variants, shape (k,)."""
    try:
        return decimal(argument) if isinstance(argument, str) else argument
    except ValueError:
        raise VariantsDiffer("an argument that is a word in some variants") from None
