"""Coordinates that follow laws, and whether they are as many as a mechanism needs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import LISTED, InputError, several
from pinarm.input.units import DIMENSIONLESS, Unit
from pinarm.mechanics.ball_joints import ROTATIONS
from pinarm.mechanics.coordinates import Coordinate, LinearCoordinate
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import Grid, MotionLaw
from pinarm.records import Record, ValueRecord

if TYPE_CHECKING:
    from pinarm.engine.constraints.closure import Closure
    from pinarm.engine.mechanism import Mechanism
    from pinarm.mechanics.geometry.kinematics import Kinematics


Targets = Callable[[float], tuple[Array, Array, Array]]
"""``t -> w, w', w''`` of prescribed coordinates, each of shape (k,)."""


class Assembly(Record, frozen=True):
    """A configuration in which a run begins.

    Attributes:
        q: The configuration, shape (nq,).
        notes: Which assembly it is, where it was not reached from the drawing.
    """

    q: Array
    notes: tuple[str, ...] = ()


class StateFunction(Record, frozen=True):
    """A coordinate by functions of the state: its value, its row, shape (nv,), and its drift. It carries no load."""

    wraps: ClassVar[bool] = False
    unit: ClassVar[Unit] = DIMENSIONLESS
    value: Callable[[Kinematics], float]
    row: Callable[[Kinematics], Array]
    drift: Callable[[Kinematics], float]


class PrescribedCoordinates(ValueRecord, frozen=True):
    """Coordinates with the laws that they follow."""

    names: tuple[str, ...]
    coordinates: tuple[Coordinate, ...]
    laws: tuple[MotionLaw, ...]

    @property
    def joint_laws(self) -> dict[int, MotionLaw]:
        """The laws of joints that follow one by their own coordinate, by index in v."""
        driven = zip(self.coordinates, self.laws, strict=True)
        return {
            coordinate.joint: law
            for coordinate, law in driven
            if isinstance(coordinate, LinearCoordinate) and coordinate.joint is not None
        }

    @classmethod
    def bound(cls, mechanism: Mechanism, motion: Mapping[str, MotionLaw]) -> PrescribedCoordinates:
        """Return prescribed coordinates of a mechanism, be they as many as they may."""
        return cls(tuple(motion), tuple(mechanism.coordinate(name) for name in motion), tuple(motion.values()))

    @classmethod
    def some(cls, mechanism: Mechanism, motion: Mapping[str, MotionLaw]) -> PrescribedCoordinates:
        prescribed = cls.bound(mechanism, motion)
        if len(prescribed.names) >= mechanism.model.nv:
            raise InputError("every coordinate follows a law: nothing is left to integrate", hint="kind: inverse")
        return prescribed

    def holding(
        self, names: Iterable[str], coordinates: Iterable[Coordinate], values: Iterable[float]
    ) -> PrescribedCoordinates:
        """Return these coordinates, and others after them that have constant values."""
        laws = (*self.laws, *(Constant(value=value) for value in values))
        return PrescribedCoordinates((*self.names, *names), (*self.coordinates, *coordinates), laws)

    def miscounted(self, mechanism: Mechanism, mobility: int) -> InputError:
        """Return the error of too few or too many laws for the degrees of freedom, with joints that could be added."""
        missing = mobility - len(self.names)
        if missing > 0:
            own = [*mechanism.joints, *(f"{name}.{part}" for name in mechanism.balls for part in ROTATIONS)]
            free = [name for name in own if name not in self.names]
            elastic = ", ".join(name for name, drive in mechanism.drives.items() if drive.elasticity is not None)
            hint = elastic and (
                f"the rotors of {elastic} move by themselves, which needs the derivatives of the efforts: a problem of "
                "the kind forward with a controller, or drives without elasticity"
            )
            return InputError(
                f"{mobility} coordinates have to follow a law and {len(self.names)} do",
                expected=f"laws for {missing} more, such as of the joints {several(free, LISTED)}",
                hint="base: fixed in the mechanism file, to hold the base" if mechanism.balls else hint,
            )
        return InputError(
            f"{len(self.names)} coordinates follow a law, but the mechanism has only {mobility} "
            f"{'degree' if mobility == 1 else 'degrees'} of freedom",
            expected=f"{mobility} of {', '.join(self.names)}" if mobility else "a mechanism that can move",
        )

    def linear_in(self, closure: Closure) -> bool:
        """Tell whether the positions of joints are linear in the coordinates: only couplings tie them."""
        straight = all(isinstance(coordinate, LinearCoordinate) for coordinate in self.coordinates)
        coupled = all(isinstance(constraint, Coupling) for constraint in closure.constraints)
        return straight and coupled and not closure.redundant

    def picked(self, places: Sequence[int]) -> PrescribedCoordinates:
        """Return some of the coordinates, those with laws with theirs."""
        names, coordinates = (tuple(self.names[k] for k in places), tuple(self.coordinates[k] for k in places))
        return PrescribedCoordinates(names, coordinates, tuple(self.laws[k] for k in places if self.laws))

    def linear_last(self) -> tuple[PrescribedCoordinates, int]:
        """Return the coordinates with joints and sums of joints last, and the number of the other coordinates."""
        is_linear = [isinstance(coordinate, LinearCoordinate) for coordinate in self.coordinates]
        return self.picked(sorted(range(len(is_linear)), key=is_linear.__getitem__)), is_linear.count(False)

    def on(self, start: float, end: float) -> Targets:
        """Return ``t -> w, w', w''`` of all coordinates on an interval without jumps, each of shape (k,)."""
        targets = self.along(start, end)

        def target(t: float) -> tuple[Array, Array, Array]:
            w, dw, ddw = targets(np.array([t]))
            return w[0], dw[0], ddw[0]

        return target

    def along(self, start: float, end: float) -> Callable[[Array], tuple[Array, Array, Array]]:
        """Return ``t -> w, w', w''`` at many instants, shape (n,) to (n, k) each; see ``on``."""
        functions = [law.on(start, end) for law in self.laws]

        def targets(t: Array) -> tuple[Array, Array, Array]:
            values = np.array([function(t) for function in functions]).reshape(len(functions), 3, len(t))
            w, dw, ddw = np.ascontiguousarray(values.transpose(1, 2, 0))
            return w, dw, ddw

        return targets

    def first(self, grid: Grid) -> Array:
        """Return the values of all coordinates at the first of some rows, shape (k,)."""
        begin, end, _ = grid.intervals()[0]
        return self.on(begin, end)(float(grid.t[0]))[0]
