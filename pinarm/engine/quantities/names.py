"""Quantities by name: what can be asked of a trajectory.

=============================================  ==================================================================
``t``                                          the parameter that runs along the rows
``joint.J.position .velocity .acceleration``   of a joint with one coordinate
``joint.J.effort .power``                      of its drive, its rotor's share included: ``Mechanism.inverse``; of the
                                               couplings that move a joint without one
``joint.J.link_effort``                        what of it reaches the links: without ``armature * acceleration``
``joint.J.force.x``, ``joint.J.moment.x``      action of the parent on the child, at the child's origin, which slides
``joint.J.moment.at_parent.x``                 the same moment about the joint's place on the parent (its marker)
``joint.J.moment.about.P.x``                   the same moment about the origin of link P
``joint.J.force.axial .radial``                the part along the joint's axis, and the size of that at right angles to
                                               it; of moments too (``radial``: overturning), and of loop joints
``joint.J.quaternion.x``, ``joint.J.roll``     of a ball joint; likewise ``pitch``, ``yaw``
``joint.J.angular_velocity.x``                 of a ball joint, in the link's own axes; likewise ``effort.x``
``loop.L.force.x``, ``loop.L.moment.x``        action of the first link on the second, at the second one's frame
``loop.L.angle``, ``loop.L.position``          of a loop joint with an axis: how far frame 2 has turned, or slid
``coupling.C.effort``                          multiplier of a coupling: effort at its second joint
``coupling.C.force.x``, ``.moment.x``          action of its first member on the second, where they touch
``coupling.C.tangential .radial .axial``       of the force of teeth; ``.separating`` along the normal of bevel wheels
``coupling.C.axial .torque``, ``.tight .slack``  of a thread; tensions of the strands of a belt
``coordinate.C.position`` (and so on)          of any coordinate
``coordinate.C.effort``                        of a drive along a coordinate, as along a sum of joints
``point.P.position.x`` (and so on)             of the origin of link P
``body.B.angular_velocity.x``                  of link B; likewise ``angular_acceleration``
``drive.D.torque .speed .power``               at the motor
``energy.kinetic .potential .total``           of the whole mechanism, springs and rotors included
``energy.J.kinetic .potential``                of the bodies that joint J moves by itself
``momentum.S.linear.x``                        of S: ``all``, or a joint and everything beyond it
``momentum.S.angular.about.P.x``               about the origin of link P
``dynamic.S.force.x``, ``.moment.about.P.x``   rates of the momenta of the bodies, summed likewise
``joint.J.friction``, ``loop.L.friction``       friction that sticks, along the coordinate, on the child; of ball joints
                                               ``.x``, ``.y``, ``.z``, of cylindrical ones ``.tangential``, ``.axial``
``joint.J.effort.lower .upper``                at rest, between which friction holds: less moves it down, more up
``power.gravity``, ``power.F``                 of the weights, and of the force element F
``power.friction``                             of all friction that sticks
``force.F.length .tension``                    of a point spring
``force.F.displacement.x``, ``.rotation.x``    of a bushing: of its second frame from the first
``force.F.force.x``, ``force.F.moment.x``      action of its first link on the second, at the second one's frame
``equilibrium.stability .starts``              of ``kind: equilibria``: 1 stable, 0 indifferent, -1 unstable
``equilibrium.frequency2_K .stiffness_K``      and the K-th smallest w^2 and eigenvalue of the stiffness
=============================================  ==================================================================

Vectors are in world axes; ``.along.B`` before the component gives them in the axes of link B:
``point.P.velocity.along.arm_2.x``. The component ``norm`` is the length. Formulas combine quantities with the published
symbols, the model's arguments, ``g``, the magnitude of gravity, and numbers with units, ``(2e4 N/m)*Y``. A name with
several meanings is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.engine.constraints.nullspace import ACTS
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.engine.quantities.ball_quantities import PARTS as BALL_PARTS
from pinarm.engine.quantities.ball_quantities import ball_quantity
from pinarm.engine.quantities.joint_axes import ALONG_AXIS, loop_axis, split, tree_axis
from pinarm.engine.quantities.reactions import SAMPLE, Reactions
from pinarm.engine.quantities.row_kinematics import RowKinematics
from pinarm.engine.series import Series
from pinarm.errors import InputError, choices
from pinarm.input.formulas.expressions import Expression
from pinarm.input.formulas.grammar import CONSTANTS
from pinarm.input.units import Unit, unit
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.forces.force_element import power
from pinarm.mechanics.forces.joint_definitions import effort_unit
from pinarm.mechanics.joints import METRE

AXES = ("x", "y", "z", "norm")
SECOND, JOULE, WATT, NEWTON, NEWTON_METRE = unit("s"), unit("J"), unit("W"), unit("N"), unit("N*m")
MAX_DEPTH = 50
"""Symbols may stand for symbols; deeper nesting would exhaust the interpreter's stack."""
TURNS = ("angular_velocity", "angular_acceleration")
OPERATORS = set("+-*/(), ")
WRENCH = ("force", "moment")
AT_PARENT = "at_parent"
"""Asks for the moment of a joint about its place on the parent: where a joint slides, the child's origin moves."""
TRANSMITTED = tuple(f"{kind}.{axis}" for kind in (*WRENCH, f"moment.{AT_PARENT}") for axis in AXES)
RATES = ("position", "velocity", "acceleration")
EFFORTS = ("effort", "link_effort")
ENERGIES = ("kinetic", "potential", "total")


@dataclass
class Quantities:
    """The quantities of one trajectory; what needs a pass over the rows is computed once, when first asked.

    Attributes:
        trajectory: The motion.
        symbols: Formulas by name, beside those of the mechanism.
        undetermined: ``refuse``, or ``minimum_norm`` for reactions that rigid bodies do not determine.
        whole: Those of the whole run where these are of some of its states: it tells what is determined, which a single
            state may seem to.
    """

    trajectory: Trajectory
    symbols: Mapping[str, Expression] = field(default_factory=dict)
    undetermined: str = "refuse"
    whole: Quantities | None = field(default=None, repr=False)
    _known: dict[str, Series] = field(default_factory=dict, repr=False)
    _open: list[str] = field(default_factory=list, repr=False)

    def of(self, rows: Trajectory) -> Quantities:
        """Return the quantities of other states of the same motion."""
        return Quantities(rows, self.symbols, self.undetermined, self.whole or self)

    @cached_property
    def reactions(self) -> Reactions:
        """What the joints transmit."""
        return Reactions(self.trajectory, 0 if self.whole else SAMPLE)

    def figures(self) -> dict[str, float]:
        """Return what the quantities that have been asked are worth, beside what is told of the motion."""
        return self.reactions.figures() if "reactions" in vars(self) else {}

    @cached_property
    def passes(self) -> RowKinematics:
        """What is computed row by row, kept once computed."""
        return RowKinematics(self.trajectory)

    @property
    def parameter(self) -> Series:
        """What runs along the rows, whatever else has its name."""
        return Series(self.trajectory.parameter, self.trajectory.unit, self.trajectory.grid.t)

    def __getitem__(self, name: str) -> Series:
        """Return a quantity by its name, a symbol, or a formula of them.

        Raises:
            InputError: There is no such quantity, or a name means several; the message lists what there is.
        """
        if name not in self._known:
            self._known[name] = self._find(name)
        return self._known[name]

    def names(self) -> list[str]:
        """Return the names of all quantities, for messages and completion."""
        mechanism = self.trajectory.mechanism
        links = [frame.name for frame in mechanism.model.frames if frame.type == pin.FrameType.BODY]
        sets = ["all", *mechanism.joints, *mechanism.balls]
        return [
            self.trajectory.parameter, "g", *self.symbols, *mechanism.symbols,
            *mechanism.arguments, *mechanism.coordinates, *self.trajectory.columns,
            *(f"joint.{name}.{part}" for name in mechanism.joints
              for part in (*RATES, *EFFORTS, "power", *TRANSMITTED)),
            *(f"joint.{name}.{kind}.{part}" for name, joint in mechanism.joints.items()
              if tree_axis(mechanism.model, joint.index) is not None for kind in WRENCH for part in ALONG_AXIS),
            *(f"joint.{name}.{part}" for name in mechanism.balls
              for part in (*BALL_PARTS, *TRANSMITTED)),
            *(f"loop.{name}.{kind}.{axis}" for name in self.reactions.loops for kind in WRENCH for axis in AXES),
            *(f"loop.{name}.{kind}.{part}" for name, loop in self.reactions.loops.items()
              if loop_axis(loop) is not None for kind in WRENCH for part in ALONG_AXIS),
            *(f"loop.{name}.{part}" for name in self.reactions.loops for part in ("angle", "position")
              if f"{name}.{part}" in mechanism.coordinates),
            *(f"coupling.{name}.{part}" for name, one in self.reactions.couplings.items()
              for part in coupling_parts(one)),
            *(f"coordinate.{name}.{rate}" for name in mechanism.coordinates for rate in RATES),
            *(f"point.{name}.{rate}.{axis}" for name in links for rate in RATES for axis in AXES),
            *(f"body.{name}.{rate}.{axis}" for name in links for rate in TURNS for axis in AXES),
            *(f"drive.{name}.{part}" for name in mechanism.drives for part in ("torque", "speed", "power")),
            *(f"energy.{part}" for part in ENERGIES),
            *(f"energy.{name}.{part}" for name in sets[1:] for part in ENERGIES[:2]),
            *(f"momentum.{name}.{part}.{axis}" for name in sets for part in ("linear", "angular") for axis in AXES),
            *(f"dynamic.{name}.{part}.{axis}" for name in sets for part in WRENCH for axis in AXES),
            "power.gravity", *(["power.friction"] if mechanism.frictions else []),
            *(f"power.{name}" for name in self.trajectory.dynamics.forces),
            *(f"force.{name}.{part}{axis}" for name, force in self.trajectory.dynamics.forces.items()
              for part, one in force.measures().items() for axis in ([f".{x}" for x in AXES] if one.vector else [""])),
        ]  # fmt: skip

    def _find(self, name: str) -> Series:
        mechanism, rows = self.trajectory.mechanism, len(self.trajectory)
        self._require_one_meaning(name)
        if name == self.trajectory.parameter:
            return self.parameter
        for symbols in (self.symbols, mechanism.symbols):
            if name in symbols:
                return self._evaluate(name, symbols[name])
        if name in mechanism.arguments:
            return Series(name, mechanism.argument_units.get(name), np.full(rows, mechanism.arguments[name]))
        if name == "g":
            return Series(name, unit("m/s^2"), np.full(rows, mechanism.gravity))
        if name in mechanism.coordinates:
            return self._rate_of(name, name, "position")
        if name in self.trajectory.columns:
            return self.trajectory.columns[name]
        kind, _, rest = name.partition(".")
        finder = _KINDS.get(kind)
        if finder is None or not rest:
            return self._evaluate(name, Expression.parse(name), formula=True)
        try:
            return finder(self, name, self._words(rest))
        except InputError:
            if not set(name) & OPERATORS:  # names from models may hold such marks too, so they are tried first
                raise
        return self._evaluate(name, Expression.parse(name), formula=True)

    def _require_one_meaning(self, name: str) -> None:
        """Raise where a name stands for several things; symbols and arguments may take those of constants and ``g``.

        Raises:
            InputError: Says for which.
        """
        run, mechanism = self.trajectory, self.trajectory.mechanism
        known, arguments = {*self.symbols, *mechanism.symbols}, mechanism.arguments
        coordinate = mechanism.coordinates.get(name)
        swept = coordinate is not None and coordinate.unit == run.unit  # that coordinate itself runs along the rows
        named = {
            "a symbol": name in known,
            "an argument of the model": name in arguments,
            "a coordinate": coordinate is not None,
            "what runs along the rows": name == run.parameter and not swept,
            "a quantity of the mechanism": (coordinate is not None or name in known) and self._is_quantity(name),
            "a constant": name in ("g", *CONSTANTS) and name not in known and name not in arguments,
        }
        meanings = [meaning for meaning, holds in named.items() if holds]
        if len(meanings) > 1:
            hint = f"coordinate.{name}.position, or another name" if named["a coordinate"] else "another name"
            raise InputError(f"'{name}' is {' and '.join(meanings)}", expected="one meaning for each name", hint=hint)

    def _is_quantity(self, name: str) -> bool:
        """Tell whether a name is that of a quantity, whatever else is called so."""
        kind, _, rest = name.partition(".")
        if kind not in _KINDS or not rest:
            return False
        try:
            _KINDS[kind](self, name, self._words(rest))
        except InputError:
            return False
        return True

    @cached_property
    def _dotted(self) -> set[str]:
        """Names of joints, links, drives, loop joints, couplings and force elements that have dots in them."""
        mechanism = self.trajectory.mechanism
        links = (frame.name for frame in mechanism.model.frames if frame.type == pin.FrameType.BODY)
        names = (*mechanism.joints, *mechanism.balls, *links, *mechanism.drives, *self.reactions.loops,
                 *self.reactions.couplings, *self.trajectory.dynamics.forces)  # fmt: skip
        return {name for name in names if "." in name}

    def _words(self, text: str) -> list[str]:
        """Return the words of a name between its dots, those of a joint's or link's own name together."""
        words, found = text.split("."), []
        while words:
            ends = range(len(words), 1, -1)
            size = next((end for end in ends if ".".join(words[:end]) in self._dotted), 1)
            found.append(".".join(words[:size]))
            words = words[size:]
        return found

    def _evaluate(self, name: str, expression: Expression, *, formula: bool = False) -> Series:
        """Evaluate a symbol, or a formula that a user wrote where a name could stand."""
        if name in self._open:
            raise InputError(f"the symbol '{name}' is defined by itself: {' -> '.join([*self._open, name])}")
        if len(self._open) >= MAX_DEPTH:
            raise InputError(f"the symbol '{self._open[0]}' stands for symbols nested more than {MAX_DEPTH} deep")
        if formula and expression.names == {name}:
            raise self._unknown(name)
        self._open.append(name)
        try:
            found = self._operands(expression)
        finally:
            self._open.pop()
        values = expression.evaluate({inner: series.values for inner, series in found.items()})
        dimension = expression.dimension({inner: series.unit for inner, series in found.items()})
        alone = found.get(expression.text.strip())
        measured = alone.unit if alone is not None else Unit(1.0, dimension.dimension) if dimension else None
        doubt = next((series.doubt for series in found.values() if series.doubt), "")
        return Series(name, measured, np.broadcast_to(np.asarray(values, float), len(self.trajectory)), doubt)

    def figure(self, text: str) -> Array:
        """Return the value of a formula that holds printed figures, which come without units; shape () or (n,)."""
        expression = Expression.parse(text)
        found = self._operands(expression)
        return np.asarray(expression.evaluate({inner: series.values for inner, series in found.items()}), float)

    def _operands(self, expression: Expression) -> dict[str, Series]:
        self._require_units(expression)
        for inner in expression.names:
            self._require_one_meaning(inner)
        return {inner: self[inner] for inner in expression.names if not _is_constant(inner, self)}

    def _require_units(self, expression: Expression) -> None:
        """Raise where what reads as a number with a unit may be a product of names whose ``*`` was forgotten.

        Raises:
            InputError: All the words of the unit are names here.
        """
        mechanism = self.trajectory.mechanism
        names = {"g", *self.symbols, *mechanism.symbols, *mechanism.arguments, *mechanism.coordinates}
        for number in expression.measured:
            if number.words <= names:
                said = " and ".join(f"'{word}'" for word in sorted(number.words))
                raise InputError(f"'{number.text}' is a number with a unit, and {said} a name here too",
                                 expected="a * before the name, or a unit that is none, such as mm for m")  # fmt: skip

    def _unknown(self, name: str) -> InputError:
        available = self.names()
        kind = name.partition(".")[0]
        near = [other for other in available if other.startswith(f"{kind}.")] or available
        expected, hint = choices(name, near, most=16)
        return InputError(f"there is no quantity '{name}'", expected=expected, hint=hint)

    def _of_joint(self, name: str, words: list[str]) -> Series:
        mechanism, part = self.trajectory.mechanism, ".".join(words[1:2])
        ball = mechanism.balls.get(words[0])
        if ball is not None:
            series = ball_quantity(self.trajectory, ball, name, ".".join(words[1:]))
            return self._transmitted(name, words, ball.index) if series is None else series
        joint = mechanism.joints.get(words[0])
        if joint is None or len(words) < 2:
            raise self._unknown(name)
        if part in RATES and len(words) == 2:
            return self._rate_of(name, words[0], part)
        self._require_efforts(name)
        if part in EFFORTS and len(words) == 2:
            armature = float(mechanism.model.armature[joint.v]) if part == "link_effort" else 0.0
            effort = self.trajectory.effort(joint.v) - armature * self.trajectory.a[:, joint.v]
            return Series(name, effort_unit(joint), effort, self._effort_doubt(name, joint.v))
        if part == "power" and len(words) == 2:
            values = self.trajectory.effort(joint.v) * self.trajectory.v[:, joint.v]
            return Series(name, WATT, values, self._effort_doubt(name, joint.v))
        return self._transmitted(name, words, joint.index)

    def _transmitted(self, name: str, words: list[str], index: int) -> Series:
        """Return a component of the wrench that a joint of the tree transmits."""
        self._require_efforts(name)
        if len(words) < 3 or words[1] not in WRENCH:
            raise self._unknown(name)
        found = self.reactions
        added, about = [stressed[:, index] for stressed in found.stressed_joints], found.origins[:, index]
        if words[1:3] == ["moment", AT_PARENT]:
            about, words = found.markers(index), [*words[:2], *words[3:]]
        for wrench in [] if self.whole else found.open_wrenches(index):
            if self._acts(self._wrench_component(name, words, found.origins[:, index], wrench, about)):
                raise InputError(f"'{name}': {found.left_open[index]}", expected="a joint before or beyond them",
                                 hint=SAY_HOW)  # fmt: skip
        return self._wrench(name, words, found.origins[:, index], found.joints[:, index], added, about)

    def _of_loop(self, name: str, words: list[str]) -> Series:
        found = self.reactions
        if words[0] in found.loops and words[1:] in (["angle"], ["position"]):
            return self._rate_of(name, ".".join(words), "position")
        if words[0] not in found.loops or len(words) < 3 or words[1] not in WRENCH:
            raise self._unknown(name)
        self._require_efforts(name)
        origins, wrench = found.loop_origins(words[0]), found.loop(words[0])
        return self._wrench(name, words, origins, wrench, found.stressed_loop(words[0]), origins)

    def _of_coupling(self, name: str, words: list[str]) -> Series:
        found, part = self.reactions, ".".join(words[1:2])
        coupling = found.couplings.get(words[0])
        if coupling is None or (len(words) > 2) != (part in WRENCH):
            raise self._unknown(name)
        self._require_efforts(name)
        known, (lam, added) = coupling.transmission, found.multiplier(words[0])
        if part == "effort":
            measured = NEWTON if coupling.coordinate.unit == METRE else NEWTON_METRE
            return Series(name, measured, lam, self._doubt(name, added))
        if known is None:
            raise InputError(f"'{name}' is not known: {coupling.missing}", expected=f"coupling.{words[0]}.effort",
                             hint=SAY_HOW)  # fmt: skip
        if part in WRENCH:
            points, wrench, stressed = found.transmitted(words[0])
            return self._wrench(name, words, points, wrench, stressed, points)
        if part not in known.parts():
            raise self._unknown(name)
        return Series(name, known.parts()[part], known.part(part, lam), self._doubt(name, added))

    def _wrench(
        self, name: str, words: list[str], origins: Array, wrench: Array, added: list[Array], about: Array
    ) -> Series:
        """Return a component of a wrench at ``origins``, unless self-stresses can add anything to it.

        Moments are about the points ``about``, shape (n, 3), where the name gives none.
        """
        values, *stressed = (self._wrench_component(name, words, origins, each, about) for each in (wrench, *added))
        return Series(name, NEWTON if words[1] == "force" else NEWTON_METRE, values, self._doubt(name, stressed))

    def _wrench_component(self, name: str, words: list[str], origins: Array, wrench: Array, about: Array) -> Array:
        """Return the component of wrenches at origins that a name asks for, shape (n,)."""
        if words[1] == "force":
            return self._component(name, words, wrench[:, :3])
        arm = origins - self._about(name, words, about)
        return self._component(name, words, wrench[:, 3:] + np.cross(arm, wrench[:, :3]))

    @staticmethod
    def _acts(component: Array) -> bool:
        """Tell whether wrenches of length 1 act on a component, given what they add to it, shape (n,)."""
        return bool(np.abs(component).max(initial=0.0) > ACTS)

    def _doubt(self, name: str, added: list[Array]) -> str:
        """Return what is in doubt about a component: nothing where self-stresses add nothing to it.

        Raises:
            InputError: They do, and the scenario does not ask for the least values.
        """
        if self.whole:
            return self.whole[name].doubt
        doubt = ""
        if any(self._acts(part) for part in added):
            doubt = f"hyperstatic of degree {len(added)}: rigid bodies do not determine it"
            if self.undetermined != "minimum_norm":
                raise self._hyperstatic(name, doubt)
        return doubt

    def _hyperstatic(self, name: str, doubt: str) -> InputError:
        """Return the refusal of a component that is not determined, with the joints that share it."""
        from pinarm.engine.kinematics.mobility import mobility_of

        found = mobility_of(self.trajectory.mechanism, self.trajectory.q[0])
        shared = f", only what {', '.join(found.undetermined)} carry together" if found.undetermined else ""
        looser = f": {found.loosenings[0]}" if found.loosenings else ""
        return InputError(
            f"'{name}': {doubt}{shared}", expected=f"a component that is determined, or looser joints{looser}",
            hint="undetermined: minimum_norm, for the least multipliers",
        )  # fmt: skip

    def _require_efforts(self, name: str) -> None:
        if self.trajectory.no_efforts:
            raise InputError(f"'{name}': {self.trajectory.no_efforts}", hint="kind: inverse")

    def _effort_doubt(self, name: str, v: int) -> str:
        """Return what is in doubt about the effort of a joint that couplings move; nothing where it has a drive."""
        acting = self.trajectory.couplings_at(v).items()
        shares = [[weight * added for added in self.reactions.multiplier(one)[1]] for one, weight in acting]
        return self._doubt(name, [np.sum(parts, axis=0) for parts in zip(*shares, strict=True)])

    def _rate_of(self, name: str, coordinate_name: str, rate: str) -> Series:
        coordinate = self.trajectory.mechanism.coordinates.get(coordinate_name)
        if coordinate is None or rate not in RATES:
            raise self._unknown(name)
        order = RATES.index(rate)
        measured = coordinate.unit / SECOND**order if order else coordinate.unit
        values = self.passes.coordinate(coordinate_name, coordinate)[:, order]
        return Series(name, _turning(measured, coordinate.unit, order), values)

    def _of_coordinate(self, name: str, words: list[str]) -> Series:
        run, along = self.trajectory, ".".join(words[:-1])
        if words[-1] == "effort" and along in run.mechanism.coordinates:
            return self._along(name, along)
        return self._rate_of(name, ".".join(words[:-1]), words[-1])

    def _along(self, name: str, along: str) -> Series:
        """Return the effort of a drive along a coordinate: a joint's, or one that has a multiplier of its own."""
        run = self.trajectory
        self._require_efforts(name)
        measured = NEWTON if run.mechanism.coordinates[along].unit == METRE else NEWTON_METRE
        if (effort := run.effort_along(along)) is not None:
            return Series(name, measured, effort)
        if along in run.mechanism.joints:
            return self._of_joint(name, [along, "effort"])
        rows = run.closure.slices().get(along)
        if rows is None or along in run.mechanism.closure.slices():
            raise InputError(f"no drive acts along '{along}'", expected="a coordinate named in drives:")
        return Series(name, measured, run.lam.along[:, rows.start - run.mechanism.closure.size])

    def _of_point(self, name: str, words: list[str]) -> Series:
        if len(words) < 3 or words[1] not in RATES:
            raise self._unknown(name)
        order = RATES.index(words[1])
        measured = METRE / SECOND**order if order else METRE
        return Series(name, measured, self._component(name, words, self.passes.frame(words[0])[:, order]))

    def _of_body(self, name: str, words: list[str]) -> Series:
        if len(words) < 3 or words[1] not in TURNS:
            raise self._unknown(name)
        order = TURNS.index(words[1])
        vectors = self.passes.frame(words[0])[:, 3 + order]
        return Series(name, unit("rad/s^2" if order else "rad/s"), self._component(name, words, vectors))

    def _of_drive(self, name: str, words: list[str]) -> Series:
        drive = self.trajectory.mechanism.drives.get(words[0])
        if drive is None or words[1:] not in (["torque"], ["speed"], ["power"]):
            raise self._unknown(name)
        index = self.trajectory.mechanism.joints[drive.joint].v
        speed = drive.speed(self.trajectory.v[:, index])
        if words[1] == "speed":
            return Series(name, unit("rad/s"), speed)
        self._require_efforts(name)
        a, effort = self.trajectory.a[:, index], self.trajectory.tau[:, index]
        torque = drive.torque(effort - drive.armature * a, self.trajectory.direction(index), a)
        torque = np.where(effort == 0.0, 0.0, torque)  # off: what moves its rotor loses nothing
        return Series(name, NEWTON_METRE, torque) if words[1] == "torque" else Series(name, WATT, torque * speed)

    def _of_energy(self, name: str, words: list[str]) -> Series:
        if len(words) == 1 and words[0] in ENERGIES:
            return Series(name, JOULE, self.passes.energies[ENERGIES.index(words[0])])
        if words[1:] not in (["kinetic"], ["potential"]):
            raise self._unknown(name)
        return Series(name, JOULE, self.passes.body_energies[:, self._index(name, words[0]), ENERGIES.index(words[1])])

    def _of_momentum(self, name: str, words: list[str]) -> Series:
        return self._momentum(name, words, ("linear", "angular"), 0)

    def _of_dynamic(self, name: str, words: list[str]) -> Series:
        return self._momentum(name, words, WRENCH, 1)

    def _momentum(self, name: str, words: list[str], parts: tuple[str, str], order: int) -> Series:
        """Return a component of a momentum (order 0) or of its rate (order 1)."""
        if len(words) < 3 or words[1] not in parts:
            raise self._unknown(name)
        total = self.passes.momenta[:, self._beyond(name, words[0]), order].sum(axis=1)
        vectors, measured = total[:, :3], unit("kg*m/s") / SECOND if order else unit("kg*m/s")
        if words[1] == parts[1]:
            about = self._about(name, words, np.zeros((len(total), 3)))
            vectors, measured = total[:, 3:] - np.cross(about, total[:, :3]), METRE * measured
        return Series(name, Unit(1.0, measured.dimension), self._component(name, words, vectors))

    def _beyond(self, name: str, of: str) -> list[int]:
        """Return the joints of ``all``, or a joint and those beyond it."""
        mechanism, model = self.trajectory.mechanism, self.trajectory.mechanism.model
        if of == "all":
            if of in mechanism.joints or of in mechanism.balls:
                raise InputError(f"'{name}': 'all' is a joint, and the whole mechanism", expected="one meaning",
                                 hint="another name of the joint")  # fmt: skip
            return list(range(1, model.njoints))
        return [int(joint) for joint in model.subtrees[self._index(name, of)]]

    def _index(self, name: str, of: str) -> int:
        """Return Pinocchio's index of a joint."""
        mechanism = self.trajectory.mechanism
        joint = mechanism.joints.get(of) or mechanism.balls.get(of)
        if joint is None:
            raise self._unknown(name)
        return joint.index

    def _of_power(self, name: str, words: list[str]) -> Series:
        if words == ["gravity"]:
            return Series(name, WATT, self.passes.gravity_power)
        run, wanted = self.trajectory, ".".join(words)
        if words == ["friction"] and run.mechanism.frictions:
            self._require_efforts(name)
            return Series(name, WATT, (run.friction_loads * run.v).sum(axis=1))
        if wanted not in run.dynamics.forces:
            raise self._unknown(name)
        values = run.gather(
            lambda dynamics, rows: power(dynamics.forces[wanted], run.grid.t[rows], run.q[rows], run.v[rows])
        )
        return Series(name, WATT, values)

    def _of_force(self, name: str, words: list[str]) -> Series:
        run, force = self.trajectory, self.trajectory.dynamics.forces.get(words[0])
        measure = force.measures().get(".".join(words[1:2])) if force else None
        if measure is None or (len(words) > 2) != measure.vector or "about" in words[2:]:
            raise self._unknown(name)

        def values(dynamics: Dynamics, rows: slice) -> Array:
            here = dynamics.forces[words[0]].measures()[words[1]]
            return here.values(run.grid.t[rows], run.q[rows], run.v[rows])

        found = run.gather(values)
        return Series(name, measure.unit, self._component(name, words, found) if measure.vector else found)

    def _about(self, name: str, words: list[str], otherwise: Array) -> Array:
        """Return the points that a moment is asked about, shape (n, 3)."""
        if "about" not in words[2:-2]:
            return otherwise
        return self.passes.frame(words[words.index("about", 2) + 1])[:, 0]

    def _component(self, name: str, words: list[str], vectors: Array) -> Array:
        """Return the component of vectors that the last word names, in the axes that ``along`` names."""
        axis = words[-1]
        extra = words[2:-1]
        if axis in ALONG_AXIS and extra[::2] in ([], ["about"]):
            return split(vectors, self._axes(name, words[0]), axis)
        if axis not in AXES or len(extra) % 2 or not set(extra[::2]) <= {"about", "along"}:
            raise self._unknown(name)
        if axis == "norm":
            return np.asarray(np.linalg.norm(vectors, axis=1))
        if "along" in extra[::2]:
            turns = self.passes.turn(extra[extra.index("along") + 1])
            return np.asarray((turns[:, :, AXES.index(axis)] * vectors).sum(axis=1))
        return vectors[:, AXES.index(axis)]

    def _axes(self, name: str, joint: str) -> Array:
        """Return the axis of a joint of the tree or of a loop joint, world axes, shape (n, 3)."""
        found, kind = self.reactions, name.partition(".")[0]
        if kind == "joint" and joint in self.trajectory.mechanism.joints:
            axes = found.tree_axes(self.trajectory.mechanism.joints[joint].index)
        elif kind == "loop":
            axes = found.loop_axes(joint)
        else:
            axes = None
        if axes is None:
            raise self._unknown(name)
        return axes


_KINDS: dict[str, Callable[[Quantities, str, list[str]], Series]] = {
    "joint": Quantities._of_joint,
    "loop": Quantities._of_loop,
    "coupling": Quantities._of_coupling,
    "coordinate": Quantities._of_coordinate,
    "point": Quantities._of_point,
    "body": Quantities._of_body,
    "drive": Quantities._of_drive,
    "energy": Quantities._of_energy,
    "momentum": Quantities._of_momentum,
    "dynamic": Quantities._of_dynamic,
    "power": Quantities._of_power,
    "force": Quantities._of_force,
}


SAY_HOW = "in couplings: a gear or rack with its pressure_angle, a belt with its pretension, gears with planets"
"""What makes the forces of a coupling known."""


def coupling_parts(coupling: Coupling) -> list[str]:
    """Return what is known of a coupling, such as ``effort``, ``force.x``, ``tangential``."""
    if coupling.transmission is None:
        return ["effort"]
    return ["effort", *coupling.transmission.parts(), *(f"{kind}.{axis}" for kind in WRENCH for axis in AXES)]


def _turning(measured: Unit, base: Unit, order: int) -> Unit:
    """Name the unit of an angle's derivative rad/s, not 1/s."""
    if base == METRE:
        return measured
    return (unit("rad"), unit("rad/s"), unit("rad/s^2"))[order]


def _is_constant(name: str, quantities: Quantities) -> bool:
    """Tell whether a name is one of the language's own constants, which symbols and arguments override."""
    if name not in CONSTANTS:
        return False
    mechanism = quantities.trajectory.mechanism
    return not any(name in names for names in (quantities.symbols, mechanism.symbols, mechanism.arguments))
