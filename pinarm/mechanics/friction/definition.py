"""Dry friction with sticking, as defined in files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import msgspec
import numpy as np
import pinocchio as pin

from pinarm.arrays import Array
from pinarm.errors import InputError, choices, within
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import (
    Coefficient,
    InputStruct,
    NotNegative,
    Positive,
    ProfileAngle,
    Span,
    Tension,
    check_keys,
)
from pinarm.mechanics.ball_joints import balls_of
from pinarm.mechanics.coordinates import LinearCoordinate, PairCoordinate
from pinarm.mechanics.couplings.coupling import Coupling, JointRelation
from pinarm.mechanics.friction.contact import Bearing, CoupledSlip, FrictionContact, FrictionLaw, Slip
from pinarm.mechanics.geometry.kinematics import new_data
from pinarm.mechanics.geometry.pairs import LowerPair, TiedFrames
from pinarm.mechanics.joints import METRE, RADIAN, Joint, effort_unit
from pinarm.mechanics.loops.loop_joints import LoopJoint
from pinarm.mechanics.loops.lower_pairs import Thread

SLIPS = {"revolute": RADIAN, "pin": RADIAN, "prismatic": METRE}
"""Kinds of loop joints that have friction, and the unit of what they leave free."""

THREAD = "friction of '{}' needs the mean radius of its thread"

SIZES: dict[str, tuple[str, ...]] = {
    "a joint that turns": ("radius", "thrust_radius", "span", "preload"),
    "a joint that slides": ("radius", "span", "preload"),
    "a cylindrical joint": ("radius", "span", "preload"),
    "a ball joint": ("radius", "preload"),
    "a screw": ("radius", "flank"),
    "a worm": ("radius", "flank", "lead_angle"),
    "teeth": ("teeth",),
    "a belt": (),
    "a cam": ("radius",),
}
"""Elements with friction, and the sizes and preloads on which their load depends."""


class Friction(InputStruct, frozen=True):
    """Dry friction in a joint, which sticks: at rest it is whatever holds the joint, up to a limit.

    While the joint slips ``F = mu N + constant + viscous u`` acts against its velocity u, with the load N of its
    bearings; at rest at most ``static_mu N + static_constant``. A joint that turns needs ``radius`` for ``mu``. The
    load is made up of the parts of the reaction for which sizes are given: the force across the axis always, the force
    along it with ``thrust_radius``, the moment across it with ``span``, the moment about a sliding joint's axis with
    ``radius``.

    A cylindrical joint, which turns and slides, has forces [N] around and along the surface at ``radius``; a ball
    joint, of the tree or of a loop, a moment against its angular velocity, with ``radius`` of the ball.

    Of a screw, a loop joint or a coupling, and of a worm and its wheel, a coupling ``gear`` whose first joint is the
    worm, friction acts along the thread: forces in N, velocities in m/s, both along it. It takes ``radius``, the mean
    one of the thread, ``flank`` and, of a worm, ``lead_angle``.

    A belt, a coupling ``belt`` with a pretension, slips on its wheels where the strands' tensions differ by more than
    the factor ``exp(mu theta)``, theta being the smaller angle of wrap; until then it sticks. Its wheels are tied by
    this friction alone: each is a degree of freedom, with a law, a drive or an initial velocity of its own.

    Of a cam, a coupling ``cam`` with a face or an edge, friction acts along the tangent of the contact, in N and m/s;
    of one with a roller it is that of the roller's pin, of ``radius``, at the roller's circumference.

    Attributes:
        mu: Coefficient of friction while the joint slips.
        static_mu: Coefficient at rest; ``mu`` where it is left out.
        radius: Of the journal, at which a joint that turns slips; of a joint that slides, lever of the key that carries
            the moment about its axis.
        thrust_radius: Mean radius of the shoulder that carries the axial force of a joint that turns.
        span: Distance of two bearings that share force and moment across the axis, centred at the joint's origin, such
            as ``80 mm``.
        flank: Angle of a thread's flank in the axial section: 0 of a square thread, 30 deg of a metric one; of a worm,
            its pressure angle there.
        lead_angle: Of a worm, such as ``5 deg``.
        teeth: Number of teeth of the first wheel, or of the pinion, of a coupling ``gear`` or ``rack`` with a
            ``pressure_angle``; friction is that of the mean slip of the flanks, in N and m/s.
        preload: Normal force that is there without any reaction.
        constant: Part that does not depend on the reaction [N*m or N], such as ``0.2 N*m``.
        static_constant: The same at rest, such as ``0.3 N*m``; ``constant`` where it is left out.
        viscous: Per velocity [N*m*s/rad or N*s/m], such as ``0.01 N*m*s/rad``.
        stribeck: Velocity by which friction has fallen from its value at rest to that of slip, such as ``0.1 rad/s``;
            at once where it is left out.
        undetermined: ``refuse``, or ``minimum_norm``: what rigid bodies leave open of the load, as across a plane
            linkage, is then that of the least multipliers.
    """

    mu: Coefficient = 0.0
    static_mu: Coefficient | None = None
    radius: Span | None = None
    thrust_radius: Span | None = None
    span: Span | None = None
    flank: ProfileAngle = 0.0
    lead_angle: ProfileAngle | None = None
    teeth: Annotated[int, msgspec.Meta(ge=4)] | None = None
    preload: Tension = 0.0
    constant: NotNegative = 0.0
    static_constant: NotNegative | None = None
    viscous: NotNegative = 0.0
    stribeck: Positive | None = None
    undetermined: Literal["refuse", "minimum_norm"] = "refuse"

    def check(self) -> None:
        for key, rest, slip in (
            ("static_mu", self.static_mu, self.mu),
            ("static_constant", self.static_constant, self.constant),
        ):
            if rest is not None and rest < slip:
                with within(key):
                    raise InputError(
                        f"friction at rest, {rest:g}, is below that of slip, {slip:g}",
                        expected="at least as much at rest",
                    )

    def bind(
        self, name: str, model: pin.Model, joints: Mapping[str, Joint], constraints: Sequence[LoopJoint | JointRelation]
    ) -> tuple[FrictionContact, ...]:
        """Return the friction of a joint of the tree, a loop joint or a coupling, by its name."""
        known, balls = {constraint.name: constraint for constraint in constraints}, balls_of(model)
        if name in joints:
            joint = joints[name]
            bearing = self._bearing(_axis(model, joint), turns=joint.unit == RADIAN)
            return (self._of_joint(model, name, joint.index, joint.v, joint.unit, bearing),)
        if name in balls:
            ball, socket = balls[name], self._socket(name)
            parts = enumerate("xyz")
            return tuple(self._of_joint(model, name, ball.index, ball.v + k, RADIAN, socket, x) for k, x in parts)
        if name not in known:
            expected, hint = choices(name, [*joints, *balls, *known])
            raise InputError(f"there is no joint '{name}' with friction", expected=expected, hint=hint)
        constraint = known[name]
        return self._of_loop(constraint) if isinstance(constraint, LoopJoint) else (self._of_coupling(constraint),)

    def _contact(
        self, of: int | LoopJoint | JointRelation, name: str, measured: Unit, bearing: Bearing, slip: Slip,
        part: str = "", law: FrictionLaw | None = None,
    ) -> FrictionContact:  # fmt: skip
        law, shared = law or self._law(measured), self.undetermined == "minimum_norm"
        loading = bearing if law.loaded else Bearing.none()
        return FrictionContact(name, effort_unit(measured), law, loading, slip, of, shared, part)

    def _of_joint(
        self, model: pin.Model, name: str, index: int, v: int, measured: Unit, bearing: Bearing, part: str = ""
    ) -> FrictionContact:
        """Return the friction of a joint of the tree along one of its velocities, in the axes of the child."""
        weights = np.zeros(model.nv)
        weights[v] = 1.0
        slip = LinearCoordinate(measured, weights, np.full(model.nv, model.joints[index].idx_q, dtype=np.intp))
        return self._contact(index, f"joint.{name}", measured, bearing, slip, part)

    def _socket(self, name: str) -> Bearing:
        self._check_sizes("a ball joint")
        return Bearing.ball(self._radius(f"mu of the ball joint '{name}' needs the radius of its ball"), self.preload)

    def _of_coupling(self, relation: JointRelation) -> FrictionContact:
        """Return the friction of a screw between two joints, of a worm and its wheel, of teeth, a belt, or a cam."""
        from pinarm.mechanics.friction import coupling_friction

        name = f"coupling.{relation.name}"
        if not isinstance(relation, Coupling):
            from pinarm.mechanics.couplings.cam import CamCoupling

            assert isinstance(relation, CamCoupling)
            self._check_sizes("a cam")
            part = coupling_friction.part_of_roller(relation, float(self.radius or 0.0))
            return self._contact(relation, name, METRE, Bearing.along(part), coupling_friction.CamSlip(relation))
        if relation.kind == "belt":
            self._check_sizes("a belt")
            law, slip = coupling_friction.belt_grip(relation, self._law(METRE))
            return self._contact(relation, name, METRE, Bearing.none(), slip, law=law)
        if self.teeth is not None:
            self._check_sizes("teeth")
            return self._contact(relation, name, METRE, *coupling_friction.tooth_friction(relation, self.teeth))
        return self._contact(relation, name, METRE, *self._of_thread(relation))

    def _of_thread(self, coupling: Coupling) -> tuple[Bearing, Slip]:
        from pinarm.mechanics.friction.coupling_friction import ThreadGeometry

        self._check_sizes("a screw" if coupling.kind == "screw" else "a worm")
        weights, places = coupling.coordinate.weights, coupling.coordinate.places
        first, second = _coupled(weights, coupling.name)
        ratio, radius, wheel = -float(weights[first]), self._radius(THREAD.format(coupling.name), always=True), 1.0
        if coupling.kind != "screw":
            if self.lead_angle is None:
                raise InputError(
                    f"friction of the {coupling.kind} '{coupling.name}' is that of a worm, or of teeth",
                    expected="lead_angle, the worm being the first joint, or teeth",
                )
            wheel = radius * np.tan(self.lead_angle) / abs(ratio)
        thread = ThreadGeometry(radius, wheel * ratio, float(self.flank))
        along, (turning, sliding) = np.zeros(len(weights)), thread.along
        along[first], along[second] = turning, wheel * sliding
        if getattr(coupling.transmission, "surfaces", None):
            raise InputError(
                f"how friction loads the bearings of '{coupling.name}' is not known",
                expected="a gear without the geometry of its teeth",
            )
        slip = CoupledSlip(coupling.coordinate.unit, along, places, thread.acting(coupling.transmission))
        return Bearing.along(thread.lever / wheel), slip

    def _check_sizes(self, part: str) -> None:
        unused = sorted({key for keys in SIZES.values() for key in keys if getattr(self, key)}.difference(SIZES[part]))
        if unused:
            with within(unused[0]):
                raise InputError(
                    f"friction of {part} has no {unused[0]}", expected=", ".join(["mu", "static_mu", *SIZES[part]])
                )

    def _radius(self, need: str, *, always: bool = False) -> float:
        """Return the radius [m], which friction that depends on a load, or any, needs; 0 where it is left out."""
        if not self.radius and (always or self.mu or self.static_mu):
            raise InputError(need, expected="radius: 12 mm")
        return float(self.radius or 0.0)

    def _of_loop(self, loop: LoopJoint) -> tuple[FrictionContact, ...]:
        """Return the components of the friction of a loop joint, with their directions in the first frame."""
        pair, none = loop.pair, np.zeros(3)
        axis = pair.axis if isinstance(pair, LowerPair) else none
        if isinstance(pair, LowerPair) and isinstance(pair.rotation, Thread):
            from pinarm.mechanics.friction.coupling_friction import ThreadGeometry

            self._check_sizes("a screw")
            radius = self._radius(THREAD.format(loop.name), always=True)
            thread = ThreadGeometry(radius, pair.rotation.pitch, float(self.flank))
            turning, sliding = thread.along
            rows, measured, bearing = {"": (sliding * axis, turning * axis)}, METRE, Bearing.thread(axis, thread.lever)
        elif loop.kind == "cylindrical":
            self._check_sizes("a cylindrical joint")
            need = f"friction of the cylindrical joint '{loop.name}' needs the radius at which it slips"
            rows, measured = (
                {"tangential": (none, self._radius(need, always=True) * axis), "axial": (axis, none)},
                METRE,
            )
            bearing = Bearing.guide(axis, 0.0, float(self.span or 0.0), float(self.preload))
        elif loop.kind == "spherical":
            rows, measured = {part: (none, about) for part, about in zip("xyz", np.eye(3), strict=True)}, RADIAN
            bearing = self._socket(loop.name)
        elif loop.kind in SLIPS:
            measured = SLIPS[loop.kind]
            rows = {"": (none, axis) if measured == RADIAN else (axis, none)}
            bearing = self._bearing(axis, turns=measured == RADIAN)
        else:
            raise InputError(
                f"the loop joint '{loop.name}' is of the kind {loop.kind}",
                expected=f"one of {', '.join(SLIPS)}, cylindrical, spherical, screw",
            )
        slips = {
            part: PairCoordinate(TiedFrames(loop.first, loop.second, LowerPair.row(e, w)), measured, loop.name)
            for part, (e, w) in rows.items()
        }
        name = f"loop.{loop.name}"
        return tuple(self._contact(loop, name, measured, bearing, slip, part) for part, slip in slips.items())

    def _law(self, measured: Unit) -> FrictionLaw:
        effort, rate = effort_unit(measured), measured / unit("s")
        units = {"constant": effort, "static_constant": effort, "viscous": effort / rate, "stribeck": rate}
        check_keys(self, **units)
        static_mu = self.mu if self.static_mu is None else self.static_mu
        static = self.constant if self.static_constant is None else self.static_constant
        numbers = self.constant, static, self.viscous, self.stribeck or 0.0
        return FrictionLaw(self.mu, static_mu, *map(float, numbers))

    def _bearing(self, axis: Array, *, turns: bool) -> Bearing:
        self._check_sizes("a joint that turns" if turns else "a joint that slides")
        thrust_radius, span, preload = (float(x or 0.0) for x in (self.thrust_radius, self.span, self.preload))
        if not turns:
            return Bearing.guide(axis, float(self.radius or 0.0), span, preload)
        journal = self._radius("mu of a joint that turns needs the radius of its journal")
        return Bearing.journal(axis, journal, thrust_radius, span, preload)


def _coupled(weights: Array, name: str) -> tuple[int, int]:
    """Return the indices in v of the joints of ``q2 - ratio q1 = c`` from its weights."""
    coupled = np.flatnonzero(weights)
    second = [v for v in coupled.tolist() if weights[v] == 1.0]
    if len(coupled) != 2 or len(second) != 1:
        raise InputError(
            f"the joints of '{name}' do not tell which is the thread and which the nut",
            expected="two joints, and a ratio other than -1",
        )
    return int(coupled[coupled != second[0]][0]), second[0]


def _axis(model: pin.Model, joint: Joint) -> Array:
    data = new_data(model)
    pin.computeJointJacobians(model, data, pin.neutral(model))
    column = pin.getJointJacobian(model, data, joint.index, pin.LOCAL).reshape(6, -1)[:, joint.v]
    return np.array(column[:3] if joint.unit == METRE else column[3:])
