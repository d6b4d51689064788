"""A mechanism: what there is and how it is called. It never changes; what moves is a state (q, v)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pinocchio as pin
from msgspec import field
from msgspec.structs import replace as replace_fields

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.drive_parts import elastic_gears, geared_rotors, mount_drives, rotors_along
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.dynamics.masses import massive
from pinarm.engine.mechanism_parts import (
    Locate,
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
from pinarm.engine.model_source import RobotReader, Source, numeric, read_robot, robot_of_model
from pinarm.engine.turn_counters import counted_angles, counting
from pinarm.errors import InputError, nowhere, require_map, require_path
from pinarm.input.formulas.expressions import Expression
from pinarm.input.units import Unit
from pinarm.input.xacro.expansion import check_declared
from pinarm.input.yaml.document import Document
from pinarm.input.yaml.values import Values, varied
from pinarm.mechanics.ball_joints import Ball, positions_of
from pinarm.mechanics.coordinates import Coordinate, coordinate_of
from pinarm.mechanics.couplings.coupling import JointRelation, mimic_coupling
from pinarm.mechanics.description import Gravity, MechanismDescription, gravity_vector, gravity_words
from pinarm.mechanics.forces.force_element import ForceElement
from pinarm.mechanics.geometry.model_variants import ModelVariants
from pinarm.mechanics.joints import Joint, links_of
from pinarm.mechanics.loops.closing_frames import proposals
from pinarm.mechanics.perturbation import perturbed, perturbed_numbers
from pinarm.records import Record, replace

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from pinarm.engine.constraints.constraint import Constraint
    from pinarm.engine.quantities.catalogue import QuantityCatalogue
    from pinarm.engine.quantities.states import States
    from pinarm.mechanics.control.definition import ControlDefinition
    from pinarm.mechanics.control.function import FunctionControl
    from pinarm.mechanics.drives import Drive
    from pinarm.mechanics.friction.contact import FrictionContact
    from pinarm.mechanics.loading.pinocchio_layout import PinocchioLayout
    from pinarm.mechanics.payloads import Payload
    from pinarm.use.result.result import Result


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
    locate: Locate = nowhere

    @classmethod
    def load(
        cls, path: str | Path, arguments: Mapping[str, float | str] | None = None, *, values: Values | None = None
    ) -> Mechanism:
        """Load a mechanism file, a URDF, xacro, MJCF or SDF file, or a robot of example-robot-data by its name.

        Args:
            path: ``models/arm/mechanism.yaml``, ``arm.urdf``, ``arm.urdf.xacro``, ``arm.xml``, or a name such as
                ``panda``.
            arguments: Values for the model's arguments: numbers in SI, or text with units.
            values: Other values than those of the mechanism file, or what such a file beside a model would say:
                ``{"gravity": "none", "base": "floating", "drives.knee.ratio": 100}``, or texts
                ``["drives.knee.ratio=100"]``. Bare numbers are in SI; see ``pinarm.load``.

        Raises:
            InputError: The mechanism file has a mistake, or a path of ``values`` leads nowhere.
            ModelError: The model has one.
        """
        require_path(path, "a mechanism file or a model, or a robot's name")
        require_map(arguments or {}, "arguments", "{'m_A': '0.2 kg'}")
        document = mechanism_document(Path(path))
        return _described(varied(document, values) if values else document, Path(path).parent, arguments or {})

    @classmethod
    def of(cls, model: pin.Model, **keys: Any) -> Mechanism:
        """Return the mechanism of a ``pin.Model`` and of what a mechanism file would say beside it.

        The model is written as URDF and read again, so that a result of the mechanism can be saved. Joints keep their
        names and motions, links and frames theirs; q and v are in pinarm's convention and order, and
        ``from_pinocchio`` and ``to_pinocchio`` convert those of ``model``. Damping, dry friction, armatures, limits and
        gravity are taken; ``pinarm.explain`` lists what there is, and in its notes what is not taken.

        Args:
            model: Any number of joints, but for composite, mimicking, helical and ellipsoid ones.
            keys: Keys of a mechanism file: ``loops={"closing": {"kind": "revolute", "between": ["a", "b"]}}``,
                ``drives``, ``forces``, ``points={"tip": {"link": "hand", "at": ["0 m", "0 m", "10 cm"]}}``,
                ``gravity``, ``couplings``, ``coordinates``, ``symbols``, ``title``, ...

        Raises:
            InputError: A key has a mistake, or it is no ``pin.Model``.
            ModelError: The model has a joint that pinarm does not have, or two frames with the same name.
        """
        if not isinstance(model, pin.Model):
            raise InputError(
                f"a mechanism is made of a pin.Model, and this is {type(model).__name__}", expected="a pin.Model",
                hint="Mechanism.load(path), or pinarm.run({'mechanism': {...}, ...}) with the data of a mechanism file",
            )  # fmt: skip
        if taken := sorted(keys.keys() & {"robot", "planar"}):
            raise InputError(
                f"{', '.join(taken)}: the model is given already", expected="other keys of a mechanism file"
            )
        data = {"pinarm": 1, "robot": "model.urdf", "gravity": gravity_words(model), **keys}
        document = Document.of_data(data, "mechanism")
        description, read = document.validate(MechanismDescription), partial(robot_of_model, model)
        return _build(description, document.data, Path(), {}, {}, document.locating, nowhere, read)

    def __repr__(self) -> str:
        """Return its title, and how many joints, constraints and freedoms it has."""
        count = len(self.joints) + len(self.balls)
        return f"<Mechanism '{self.title}': {count} joints, {len(self.constraints)} constraints, nv {self.model.nv}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Say how another process makes the same mechanism: from its fields, with the forces bound anew (functions).

        What was computed of the fields stays behind.
        """
        own = {name: getattr(self, name) for name in self.__struct_fields__}
        own["forces"] = {name: force for name, force in self.forces.items() if name not in self.description.forces}
        return _bound_again, (own,)

    def perturbed(self, seed: int) -> Mechanism:
        """Return the mechanism with its numbers changed in the last digits; see ``mechanics.perturbation``."""
        forces = perturbed_numbers(self.description.forces, np.random.default_rng(seed))
        description = replace_fields(self.description, forces=forces)
        return replace(self, model=perturbed(self.model, seed), description=description)._bound()

    def _bound(self) -> Mechanism:
        """Return the mechanism with the forces of its description bound to its model."""
        from pinarm.mechanics.forces.kinds import bound

        forces = {name: bound(force, self.model, self.joints, self.coordinates)
                  for name, force in self.description.forces.items()}  # fmt: skip
        return replace(self, forces={**self.forces, **forces})

    @cached_property
    def dynamics(self) -> Dynamics:
        """Return the equation of motion with the mechanism's own forces."""
        return Dynamics.of(self.model, self.forces)

    def inverse(self, q: Array, v: Array, a: Array, *, drives: Sequence[str] = (), t: float = 0.0) -> Array:
        """Return the efforts that the drives must give, rotors included; the constraints carry the rest.

        Args:
            q: Configurations, shape (..., nq): any leading axes, or none for one state.
            v: Velocities, shape (..., nv).
            a: Accelerations, shape (..., nv).
            drives: Coordinates that drives act along, needed where there are loops; otherwise every joint that mimics
                no other has one.
            t: Instant at which forces that follow laws are taken [s].

        Returns:
            Efforts at the joints [N*m or N], shape (..., nv).

        Raises:
            InputError: The shapes do not fit, a state tears a loop or a coupling, the drives cannot carry the load, or
                a cable would have to push, or a cam to pull, which cannot.
            DynamicsError: The drives do not determine their efforts.
        """
        from pinarm.engine.quantities import states

        return states.inverse(self, q, v, a, drives, t)

    def forward(self, q: Array, v: Array, tau: Array | None = None, *, t: float = 0.0) -> Array:
        """Return the accelerations under given efforts.

        Args:
            q: Configurations, shape (..., nq): any leading axes, or none for one state.
            v: Velocities, shape (..., nv).
            tau: Efforts of the drives [N*m or N], shape (..., nv); none where it is left out.
            t: Instant at which forces that follow laws are taken [s].

        Returns:
            Accelerations of the joints, shape (..., nv).

        Raises:
            InputError: The shapes do not fit, a state tears a loop or a coupling, or a cable would have to push, or a
                cam to pull, which cannot.
            DynamicsError: Something without mass is free to move: its acceleration is undetermined.
        """
        from pinarm.engine.quantities import states

        return states.forward(self, q, v, tau, t)

    def configurations(self, positions: Mapping[str, ArrayLike]) -> Array:
        """Return configurations from joint coordinates by name.

        Args:
            positions: Joint -> coordinates [rad or m], arrays of one shape (...) or single numbers; 0 for all others.
                A ball joint J is given by ``J.roll``, ``J.pitch`` and ``J.yaw``, or by ``J.rotation.x`` and so on.

        Returns:
            q, shape (..., nq).

        Raises:
            InputError: A joint does not exist, or the shapes differ.
        """
        from pinarm.engine.quantities import states

        return states.configurations(self, positions)

    def rates(self, values: Mapping[str, ArrayLike]) -> Array:
        """Return velocities, accelerations or efforts from those of joints by name.

        Args:
            values: Joint -> velocities [rad/s or m/s], accelerations or efforts, arrays of one shape (...) or single
                numbers; what is not named is 0. Of a ball joint J they are ``J.angular_velocity.x`` and so on, in the
                axes of the link, whatever is given.

        Returns:
            v, a or tau, shape (..., nv).

        Raises:
            InputError: A joint does not exist, or the shapes differ.
        """
        from pinarm.engine.quantities import states

        return states.rates(self, values)

    def at(
        self, q: Array, v: Array | None = None, a: Array | None = None, tau: Array | None = None, *,
        drives: Sequence[str] = (), t: float = 0.0,
    ) -> States:  # fmt: skip
        """Return the quantities of states by name: ``at(q, v)["point.A.position.x"].values`` and all others.

        Every one is a state of its own; values have the leading axes of the states. Forces that follow laws have their
        values just after the instant t.

        Args:
            q: Configurations, shape (..., nq): any leading axes, or none for one state.
            v: Velocities, shape (..., nv); 0 where they are left out.
            a: Accelerations, shape (..., nv); 0 where neither they nor efforts are given.
            tau: Efforts of the drives [N*m or N], shape (..., nv), in place of accelerations, which follow from them.
            drives: Coordinates that the drives act along where accelerations are given; every joint of an open chain
                where none is named. Without any a mechanism with loops tells no forces.
            t: Instant [s].

        Raises:
            InputError: Shapes do not fit, a state tears a loop, or under efforts a cable would have to push, or a cam
                to pull.
            DynamicsError: The drives do not determine their efforts.
        """
        from pinarm.engine.quantities import states

        return states.quantities(self, q, v, a, tau, drives, t)

    def jacobian(self, name: str, q: ArrayLike) -> Array:
        """Return the matrix J(q) of ``x' = J v``, x the motion of something that quantities can name.

        =================================  ===========  ==========================================================
        name                               shape        x'
        =================================  ===========  ==========================================================
        ``hand``, a link                   (..., 6, nv)  velocity of its origin, then its angular velocity
        ``point.hand``                     (..., 3, nv)  velocity of its origin [m/s]
        ``body.hand``                      (..., 3, nv)  its angular velocity [rad/s]
        ``knee``, ``coordinate.knee``      (..., nv)     rate of a coordinate, also of one defined by the mechanism file
        ``joint.hip``, a ball joint        (..., 3, nv)  angular velocity of its link, in the link's own axes
        =================================  ===========  ==========================================================

        Axes are those of the world, as of ``pin.LOCAL_WORLD_ALIGNED``; those of link B with ``.along.B`` at the end, so
        that ``hand.along.hand`` is ``pin.LOCAL``. Loops do not change J: v has all joints, and ``closure`` says which v
        the loops allow.

        Args:
            name: What moves.
            q: Configurations in pinarm's convention, as everywhere here, shape (..., nq); see ``from_pinocchio``.

        Raises:
            InputError: There is nothing of that name, it means several things, or the shape does not fit.
        """
        from pinarm.engine.quantities import matrices

        return matrices.jacobian(self, name, q)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return the symmetric mass matrix M(q) of the tree, rotors and armatures included, loops not eliminated.

        Args:
            q: Configurations in pinarm's convention, shape (..., nq).

        Returns:
            M, shape (..., nv, nv) [kg*m^2, kg*m or kg], for v in pinarm's convention.

        Raises:
            InputError: The shape does not fit.
        """
        from pinarm.engine.quantities import matrices

        return matrices.mass_matrices(self, q)

    def frame(self, name: str, q: ArrayLike) -> Array:
        """Return the placement of a link, or of the frame of a joint J by ``joint.J``, in the world.

        Args:
            name: Of the link, or ``joint.J``.
            q: Configurations in pinarm's convention, shape (..., nq).

        Returns:
            Homogeneous matrices ``T = [[R, p], [0, 1]]``, shape (..., 4, 4): the columns of R are the frame's axes in
            those of the world, p is its origin [m]. ``pin.SE3(T)`` makes Pinocchio's type of a single one.

        Raises:
            InputError: There is no such link or joint, or the shape does not fit.
        """
        from pinarm.engine.quantities import matrices

        return matrices.placements(self, name, q)

    def pin_data(self, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None) -> pin.Data:
        """Return Pinocchio's data of one state of ``model``, filled: a copy of one's own, to be read or changed.

        ``pin.computeAllTerms``, ``pin.rnea`` and ``pin.forwardKinematics`` with the accelerations have been called, and
        all frames are placed; M is whole. These know weights and inertias only: ``data.tau`` and ``data.nle`` lack
        springs, dampers, friction and loops, which ``inverse`` and ``forward`` have.

        Args:
            q: Configuration in pinarm's convention, which is that of ``model``, shape (nq,).
            v: Velocity, shape (nv,); 0 where it is left out.
            a: Acceleration, shape (nv,); 0 where it is left out.

        Raises:
            InputError: The shapes do not fit, or several states are given.
        """
        from pinarm.engine.quantities import matrices

        return matrices.pinocchio_data(self, q, v, a)

    def quantities(self, like: str = "") -> QuantityCatalogue:
        """Return what can be asked by name of a mechanism in motion: names, units, meanings.

        Args:
            like: Part of the name or of the meaning; all where it is empty.

        Raises:
            AssemblyError: The loops cannot be closed.
        """
        from pinarm.engine.quantities.catalogue import catalogue_of

        return catalogue_of(self, like)

    def result(
        self, t: ArrayLike, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None,
        tau: ArrayLike | None = None, **keys: Any,
    ) -> Result:  # fmt: skip
        """Return the result of a motion of one's own arrays, with quantities, plots, checks, tables and replays.

        It is ``pinarm.result(mechanism, t, q, v, a, tau, **keys)``, which tells more.

        Args:
            t: Instants [s], not descending, shape (n,).
            q: Configurations in pinarm's convention, shape (n, nq).
            v: Velocities, shape (n, nv).
            a: Accelerations, shape (n, nv).
            tau: Efforts of the drives [N*m or N], shape (n, nv).
            keys: ``derivatives``, ``drives``, ``loads``, and keys of a scenario file such as ``outputs``.

        Raises:
            InputError: Shapes do not fit, a number is not finite, or instants descend.
            DynamicsError: The drives do not determine their efforts.
        """
        import pinarm  # by its public name, as users do: the engine imports nothing from the layers above it

        return pinarm.result(self, t, q, v, a, tau, **keys)

    def from_pinocchio(self, q: ArrayLike, v: ArrayLike | None = None) -> tuple[Array, Array]:
        """Return q and v of this mechanism from those of ``pin.buildModelFromUrdf`` of the same URDF.

        Of a mechanism that was made of a ``pin.Model``, see ``of``, they are those of that model.

        They differ where the base floats, and in joints of the types ``continuous``, ``floating`` and ``planar``. Of a
        floating base Pinocchio's v has the velocity of the base's origin in the base's own axes, this mechanism's v in
        those of the world; the quaternion (x, y, z, w), and the angular velocity in the base's own axes, are the same.
        Of a ``continuous`` joint Pinocchio has (cos, sin), this mechanism the angle, here from -pi to pi.

        Args:
            q: Configurations of ``pin.buildModelFromUrdf(path)``, shape (..., nq of that model); of a floating base, of
                ``pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())``.
            v: Velocities, shape (..., nv of that model); 0 where they are left out.

        Returns:
            q, shape (..., nq), and v, shape (..., nv).

        Raises:
            InputError: The shapes do not fit, as of a model that was read with ``mimic=True``; the model is MJCF; a
                quaternion or (cos, sin) has not the length 1; or a planar joint has another axis than z, of which
                Pinocchio's reader takes no notice.
        """
        from pinarm.engine.quantities import states

        return states.from_pinocchio(self, q, v)

    def to_pinocchio(self, q: ArrayLike, v: ArrayLike | None = None) -> tuple[Array, Array]:
        """Return q and v of ``pin.buildModelFromUrdf`` from those of this mechanism; see ``from_pinocchio``.

        Args:
            q: Configurations, shape (..., nq).
            v: Velocities, shape (..., nv); 0 where they are left out.

        Raises:
            InputError: As of ``from_pinocchio``.
        """
        from pinarm.engine.quantities import states

        return states.to_pinocchio(self, q, v)

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
        return tuple(one for one in self.constraints if isinstance(one, JointRelation))

    @cached_property
    def closure(self) -> Closure:
        """Return the rows of the constraints."""
        if not isinstance(self.model, ModelVariants):
            return Closure.of(self.model, self.constraints)
        from pinarm.engine.constraints.variant_closure import VariantClosure  # of sweeps only

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

    @cached_property
    def near_starts(self) -> dict[tuple[tuple[str, ...], bytes, bytes], Array]:
        """Configurations found near starts, by names and values of what is given; see ``newton.near_given``."""
        return {}

    def driven_joint(self, drive: str) -> Joint:
        """Return the joint that a drive moves: that of its rotor, where it has one, or its own, by name."""
        from pinarm.mechanics.rotors import rotor_name

        found = self.drives[drive]
        return self.joints[rotor_name(drive) if found.turns_rotor else found.joint]

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
        """Return a coordinate by name.

        Raises:
            InputError: There is none of that name; the message lists those there are.
        """
        return coordinate_of(self.model, self.coordinates, name)


def _bound_again(own: Mapping[str, Any]) -> Mechanism:
    return Mechanism(**own)._bound()


def mechanism_document(file: Path) -> Document:
    """Return what a mechanism file says; of a model's file, or a robot's name, what such a file would say at least.

    Raises:
        InputError: The file cannot be read.
    """
    if file.suffix in (".yaml", ".yml"):
        return Document.read(file)
    return Document(str(file), file, {"pinarm": 1, "robot": file.name if file.suffix else str(file)}, {}, {})


def read_mechanism(
    path: str | Path, arguments: Mapping[str, float | str] | None = None, *,
    gravity: Gravity | Literal["none"] | None = None, payloads: Mapping[str, Payload] | None = None,
    changes: Document | None = None, locate: Locate = nowhere, acted: Sequence[str] = (),
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
    locate: Locate = nowhere, acted: Sequence[str] = (),
) -> Mechanism:  # fmt: skip
    """Return the mechanism that a document describes; see ``read_mechanism``."""
    here = document.locating if document.places else lambda *at: locate("mechanism")
    description = document.validate(MechanismDescription)
    if gravity is not None:
        description = replace(description, gravity=gravity)
    return _build(description, document.data, folder, arguments, payloads, here, locate, acted=acted)


def _build(
    description: MechanismDescription, data: Mapping[str, Any], folder: Path,
    arguments: Mapping[str, float | str], payloads: Mapping[str, Payload], here: Locate, caller: Locate,
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
