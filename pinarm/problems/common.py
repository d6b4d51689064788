"""What the problems share: instants, accuracy, loads, and checks of names and units against a mechanism."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Annotated

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.equation import Dynamics
from pinarm.engine.integration.integrator import Method
from pinarm.engine.integration.methods import METHODS, MethodName, described
from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.trajectory import Trajectory
from pinarm.errors import InputError, Key, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import Duration, InputStruct, Time, check_unit
from pinarm.mechanics.ball_joints import positions_of, unit_of, velocities_of
from pinarm.mechanics.forces import Force, ForceElement
from pinarm.mechanics.forces.force_element import check_new
from pinarm.mechanics.laws import Constant, Motion, Over
from pinarm.mechanics.laws.motion_law import MotionLaw

Place = Callable[..., AbstractContextManager[None]]
"""``with place("motion", "theta"):`` gives errors of the block that place of the problem in its file."""


class TimeGrid(InputStruct, frozen=True):
    """Evenly spaced instants; those at which a law or load jumps are added, twice each: just before and just after.

    Attributes:
        start: First instant [s].
        end: Last instant [s].
        samples: Number of instants.
    """

    end: Time
    start: Time = 0.0
    samples: Annotated[int, msgspec.Meta(ge=2, le=10_000_000)] = 201

    def check(self) -> None:
        """Refuse a time that does not go forward."""
        with within("end"):
            if not self.end - self.start < math.inf:
                raise InputError("the time has no finite length")
            if not self.end > self.start:
                raise InputError(f"the time ends at {self.end:g} s, not after its start at {self.start:g} s")

    def instants(self) -> Array:
        """Return the instants [s], shape (samples,)."""
        return np.linspace(self.start, self.end, self.samples)


TOLERANCE = 1e-9
"""Tolerance of an adaptive method where none is given."""


class Accuracy(InputStruct, frozen=True):
    """How accurate the result is wanted.

    Attributes:
        method: How motions are integrated over time, one of ``integration.methods.METHODS``.
        tolerance: Local error of a step of an adaptive method, relative to ``1 + |y|`` in SI; 1e-9 where it is left
            out. The global error is reported by the balances and is usually ten to a hundred times larger.
        step: Longest step of a method with steps of one length.
        target: Largest global error wanted in every output, relative to its largest absolute value over the run. The
            cheapest setting that reaches it is looked for, of the method if one is given; tolerance and step are then
            not used.
        max_steps: Number of steps after which the time integration gives up, rejected ones included.
    """

    method: Annotated[MethodName, msgspec.Meta(description=described())] = "dop853"
    tolerance: Annotated[float, msgspec.Meta(ge=1e-14, le=1e-2)] | None = None
    step: Duration | None = None
    target: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] | None = None
    max_steps: Annotated[int, msgspec.Meta(ge=1)] = 200_000

    def check(self) -> None:
        """Refuse a tolerance for steps of one length, and a step for a method that chooses its own."""
        by = METHODS[self.method].setting
        if by == "step" and self.step is None and self.target is None:
            raise InputError(f"the method {self.method} takes steps of one length and needs it", hint="step: 1 ms")
        if by == "tolerance" and self.step is not None:
            with within("step"):
                raise InputError(f"the method {self.method} chooses its steps by the tolerance",
                                 hint="tolerance alone, or method: rk4")  # fmt: skip
        if by == "step" and self.tolerance is not None:
            with within("tolerance"):
                raise InputError(f"the method {self.method} takes steps of one length, whatever their error",
                                 hint="step alone, or method: dop853")  # fmt: skip

    def integrator(self) -> Method:
        """Return the method of integration."""
        return METHODS[self.method].make(self.setting[1])

    @property
    def setting(self) -> tuple[str, float]:
        """Return the key that decides the error of the method, and its value."""
        by = METHODS[self.method].setting
        wanted = self.step if by == "step" else self.tolerance
        return by, TOLERANCE if wanted is None else float(wanted)


def laws_of(
    mechanism: Mechanism, motion: Mapping[str, Motion], place: Place, span: tuple[float, float] = (0.0, 0.0)
) -> dict[str, MotionLaw]:
    """Return the laws over time of coordinates, checked; profiles over coordinates are driven by the laws of those.

    Args:
        mechanism: The mechanism.
        motion: Coordinate -> its law.
        place: Gives errors their place.
        span: First and last instant at which the laws are wanted [s].

    Raises:
        InputError: A coordinate does not exist, or a profile's has no law.
        UnitError: A field of a law has another dimension.
    """
    found: dict[str, MotionLaw] = {}
    for name in motion:
        with place("motion", Key(name)):
            mechanism.coordinate(name)
    for name in motion:
        _settle(name, (), mechanism, motion, found, place, span)
    return {name: found[name] for name in motion}


def _settle(
    name: str, before: tuple[str, ...], mechanism: Mechanism, motion: Mapping[str, Motion],
    found: dict[str, MotionLaw], place: Place, span: tuple[float, float],
) -> None:  # fmt: skip
    """Add the law over time of a coordinate, and before it that of the coordinate that drives it."""
    law, measured = motion[name], mechanism.coordinate(name).unit
    if not isinstance(law, Over):
        with place("motion", name):
            law.check_units(measured)
            law.require_continuous()
        found[name] = law
        return
    with place("motion", name, "of"):
        along = mechanism.coordinate(law.of).unit
        if law.of not in motion:
            others = ", ".join(other for other in motion if other != name)
            raise InputError(f"'{law.of}' follows no law: the profile of '{name}' has nothing to run along",
                             expected=f"one of {others}" if others else "",
                             hint=f"a law over time for '{law.of}' too")  # fmt: skip
        if law.of in (*before, name):
            raise InputError(f"profiles run along each other: {' -> '.join([*before, name, law.of])}")
    with place("motion", name):
        law.check_units(measured, along)
        with within("profile"):
            law.profile.require_continuous(along)
    if law.of not in found:
        _settle(law.of, (*before, name), mechanism, motion, found, place, span)
    with place("motion", name):
        found[name] = law.along(found[law.of], *span)


def check_levels(mechanism: Mechanism, levels: Mapping[str, float], place: Place, *at: str) -> None:
    """Check names and units of values given for the coordinates of joints.

    Raises:
        InputError: The joint does not exist.
        UnitError: The value has another dimension.
    """
    _check_values(positions_of(mechanism.joints, mechanism.balls), levels, place, *at)


def check_rates(mechanism: Mechanism, rates: Mapping[str, float], place: Place, *at: str) -> None:
    """Check names and units of values given for the velocities of joints; errors as ``check_levels``."""
    _check_values(velocities_of(mechanism.joints, mechanism.balls), rates, place, *at)


def _check_values(known: Mapping[str, Unit], values: Mapping[str, float], place: Place, *at: str) -> None:
    for name, value in values.items():
        with place(*at, Key(name)):
            expected = unit_of(name, known)
        with place(*at, name):
            check_unit(value, expected)


def bind_constant_loads(mechanism: Mechanism, loads: Mapping[str, Force], place: Place) -> dict[str, ForceElement]:
    """Return the force elements of states without time; see ``bind_loads``.

    Raises:
        InputError: A load names something that does not exist, or changes with time.
    """
    forces = bind_loads(mechanism, loads, place)
    for name, force in forces.items():
        if not all(isinstance(law, Constant) for law in force.laws()):
            with place("loads", name):
                raise InputError(f"the force '{name}' follows a law over time and has no value at rest",
                                 hint="law: constant")  # fmt: skip
    return forces


def still(
    mechanism: Mechanism, loads: Mapping[str, Force], parameter: str, measured: Unit, closure: Closure
) -> Trajectory:
    """Return one row at the neutral configuration, under the forces of a run: enough to see which quantities there are.

    Raises:
        InputError: A load names something that does not exist.
    """
    forces = bind_loads(mechanism, loads, lambda *path: nullcontext())
    row = Trajectory.still(mechanism, parameter, measured, closure)
    return replace(row, dynamics=Dynamics.of(mechanism.model, forces))


def bind_loads(mechanism: Mechanism, loads: Mapping[str, Force], place: Place) -> dict[str, ForceElement]:
    """Return the force elements of a run by name: the mechanism's own and those of the problem.

    Raises:
        InputError: A load names something that does not exist.
    """
    forces = dict(mechanism.forces)
    for name, load in loads.items():
        with place("loads", name):
            check_new(name, forces)
            forces[name] = load.bind(mechanism.model, mechanism.joints)
    return forces
