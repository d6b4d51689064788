"""The mechanism file: the properties of a mechanism that its model file does not contain."""

# Annotations are no text here (``from __future__ import annotations``): msgspec would compile each in every run.

from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, Key, ModelError, UnitError, within
from pinarm.input.units import Unit, argument_word, unit
from pinarm.input.yaml.schema import Acceleration, AnyQuantity, Deferred, InputStruct, Level, Measured, Positive
from pinarm.mechanics.joints import AXES, Direction, unit_vector
from pinarm.mechanics.loading.pinocchio_model import Base, Defects
from pinarm.mechanics.loops.closing_frames import Closure

if TYPE_CHECKING:
    from pinarm.mechanics.control.kinds import Control
    from pinarm.mechanics.coordinates import CoordinateDefinition
    from pinarm.mechanics.couplings.kinds import CouplingDefinition
    from pinarm.mechanics.forces.kinds import Force
    from pinarm.mechanics.friction.definition import Friction
    from pinarm.mechanics.loops.kinds import Loop
    from pinarm.mechanics.planar_drawing import PlanarDrawing
    from pinarm.mechanics.points import Payload, PointDefinition
    from pinarm.mechanics.rotors import Drive
else:  # imported where a file has the key, see MechanismDescription.deferred
    Control = CoordinateDefinition = CouplingDefinition = Drive = Force = Friction = Loop = Any
    Payload = PlanarDrawing = PointDefinition = Any

STANDARD_GRAVITY = 9.81
"""Magnitude used where a file gives only a direction [m/s^2]."""


class Gravity(InputStruct, frozen=True):
    """A uniform gravity field.

    Attributes:
        direction: Direction of the field: a world axis, or components in world axes, of any length.
        magnitude: Gravitational acceleration [m/s^2].
    """

    direction: Direction = "-z"
    magnitude: Acceleration = STANDARD_GRAVITY

    def vector(self) -> Array:
        """Return the field [m/s^2], world axes, shape (3,)."""
        return unit_vector(self.direction) * float(self.magnitude)


def gravity_vector(gravity: Gravity | Literal["none"] | None, otherwise: Array | None) -> Array:
    """Return the gravity field of a mechanism [m/s^2], world axes, shape (3,)."""
    if gravity is None:
        return Gravity().vector() if otherwise is None else otherwise
    return np.zeros(3) if isinstance(gravity, str) else gravity.vector()


def gravity_words(model: pin.Model) -> dict[str, Any] | Literal["none"]:
    """Return the gravity of a ``pin.Model`` as a mechanism file says it."""
    if np.any(model.gravity.angular):
        raise ModelError("the gravity of the model has an angular part", expected="a uniform field")
    field = np.asarray(model.gravity.linear)
    if not (magnitude := float(np.linalg.norm(field))):
        return "none"
    axis = next((name for name, along in AXES.items() if np.array_equal(field, np.array(along) * magnitude)), None)
    return {"direction": axis or field.tolist(), "magnitude": f"{magnitude!r} m/s^2"}


class MechanismDescription(InputStruct, frozen=True):
    """Content of a mechanism file.

    Attributes:
        pinarm: Version of the format.
        title: For headings.
        robot: A URDF, xacro, MJCF or SDF file, relative to this one, or the name of a robot of example-robot-data.
        model: Name of the model in an SDF file with several, such as ``arm``; where it is left out the only one, or the
            only one with joints that move.
        planar: In place of ``robot``: points of a drawing, the links between them, pins and slides.
        base: ``floating`` lets the model's root move freely, by a joint ``root``; ``fixed`` holds it. As in the model
            where it is left out; of the robots known by name, those that float in their own loaders do.
        defects: What to do with inertias that no body can have, such as ``noted``: they are taken as they are written,
            and named. Where this is left out files with such inertias are refused, robots known by name are not.
        creep: Velocity below which the dry friction of the model gives way [rad/s or m/s], such as ``0.001 rad/s``: it
            is regularised, ``F tanh(v / creep)``, and never sticks. Where this is left out it sticks.
        points: Frames on links, beside those of the model; they are named, and asked about, like links.
        packages: Name of a package of ROS -> its folder, such as ``{ur_description: ../ur}``: for ``$(find NAME)`` in
            xacro, and for meshes. The package that the model lies in is known.
        parameters: Numbers by name, such as ``{l1: 100 mm, alpha: 30 deg}``: quantities of this file may be formulas of
            them (``l1*cos(alpha)``), and parameters formulas of those before. Scenarios give them other values under
            ``arguments``; sweeps, searches and sensitivities vary ``arguments.l1``.
        arguments: Of xacro arguments of the model: the unit in SI, such as ``{L: m}``, so that a scenario can give them
            with units, also with others; or a value that is no unit, such as ``{L: 300 mm, prefix: right_}``, in place
            of that of the model. The model is given numbers in SI, and its own are in SI.
        gravity: ``none`` for none; that of the model, or 9.81 m/s^2 downwards, where it is left out.
        coordinates: Coordinates beside those of the joints.
        turns: Angles of loop joints and ball joints whose turns are to be counted, such as ``[L.angle, hip.yaw]``: each
            has a joint of its own, ``L.angle.counter``, without inertia. Those along which forces or controllers act
            are counted in any case.
        loops: Joints that close loops of the tree.
        closures: Kind of joint, such as ``revolute``, between every two frames ``closing_NAME_1`` and
            ``closing_NAME_2`` of the model that no loop joint ties, as onshape-to-robot leaves them; or NAME -> its
            kind. It turns about, or slides along, z.
        start: Rough joint coordinates near which the loops close, where they do not near 0; a scenario's own ``start``
            replaces them joint by joint. Ball joints as there.
        couplings: Gears, racks and screws between joints.
        drives: Motors and gears.
        control: Controllers of the drives, at work in every forward run, such as ``[{kind: pid, drive: knee, follows:
            {law: constant, value: 1 rad}, kp: 20 N*m/rad}]``.
        forces: Springs, dampers and loads that belong to the mechanism.
        friction: Joint or loop joint -> its dry friction, which sticks; in place of that of the model. ``none`` for no
            dry friction at all, that of the model included.
        payloads: What links carry beside the model's own masses, such as ``{load: {point: hand, mass: 2 kg}}``.
        symbols: Published symbols and what they stand for: a quantity, a number with its unit, or a formula of them.
    """

    deferred: ClassVar[Deferred] = {
        "planar": ("pinarm.mechanics.planar_drawing", "PlanarDrawing"),
        "points": ("pinarm.mechanics.points", "PointDefinition"),
        "control": ("pinarm.mechanics.control.kinds", "Control"),
        "coordinates": ("pinarm.mechanics.coordinates", "CoordinateDefinition"),
        "loops": ("pinarm.mechanics.loops.kinds", "Loop"),
        "couplings": ("pinarm.mechanics.couplings.kinds", "CouplingDefinition"),
        "drives": ("pinarm.mechanics.rotors", "Drive"),
        "forces": ("pinarm.mechanics.forces.kinds", "Force"),
        "friction": ("pinarm.mechanics.friction.definition", "Friction"),
        "payloads": ("pinarm.mechanics.points", "Payload"),
    }

    pinarm: Literal[1]
    robot: str = ""
    model: str = ""
    planar: PlanarDrawing | None = None
    title: str = ""
    base: Base | None = None
    defects: Defects | None = None
    creep: Positive | None = None
    points: dict[str, PointDefinition] = {}
    packages: dict[str, str] = {}
    parameters: dict[str, AnyQuantity] = {}
    arguments: dict[str, str | bool | float] = {}
    gravity: Gravity | Literal["none"] | None = None
    coordinates: dict[str, CoordinateDefinition] = {}
    turns: list[str] = []
    loops: dict[str, Loop] = {}
    closures: Closure | dict[str, Closure] | None = None
    start: dict[str, Level] = {}
    couplings: dict[str, CouplingDefinition] = {}
    drives: dict[str, Drive] = {}
    control: list[Control] = []
    forces: dict[str, Force] = {}
    friction: dict[str, Friction] | Literal["none"] = {}
    payloads: dict[str, Payload] = {}
    symbols: dict[str, str] = {}

    @property
    def slip_velocity(self) -> float | None:
        """Velocity over which the model's dry friction is smoothed [rad/s or m/s]: infinite where there is none."""
        return np.inf if self.friction == "none" else self.creep

    def check(self) -> None:
        if not self.robot and self.planar is None:
            raise InputError(
                "the key 'robot' is missing: it names the model",
                expected="robot: a model file, or planar: points and links of a drawing",
            )
        if self.robot and self.planar is not None:
            raise InputError("the mechanism has two models, 'robot' and 'planar'", expected="one of them")
        for name in self.parameters.keys() & {*self.arguments, *self.symbols}:
            with within("parameters", Key(name)):
                raise InputError(f"'{name}' is a symbol or an argument as well", expected="a name of its own")

    def written_unit(self, argument: str) -> str:
        """Return the unit that the file has for an argument or a parameter; empty where it has none."""
        parameter = self.parameters.get(argument)
        own = parameter.unit if parameter is not None else self.argument(argument)[0]
        return str(own or "")

    def argument(self, name: str) -> tuple[Unit | None, Measured | str | None]:
        """Return the unit of an argument of the model and its value, or word, as far as the file has them."""
        text = self.arguments.get(name, "1")
        if (word := argument_word(text)) is None:
            value = Measured.read(text)
            return value.unit, value
        try:
            return unit(word), None
        except UnitError:
            return None, word
