"""Interface of controllers: commands for drives from references and measurements.

The effort of a drive is its command within its limits. A continuous controller acts at every instant. A sampled one
measures at ``t_k = t_0 + k T``; its effort changes at ``t_k + delay`` and is held until the next change (zero-order
hold). Before the first one it is 0.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from pinarm.arrays import Array, Indices
from pinarm.input.units import Unit
from pinarm.mechanics.coordinates import LinearCoordinate, MeasuredCoordinate
from pinarm.mechanics.joints import Joint
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.mechanics.limited_states import Switch
from pinarm.mechanics.motors import CommandOfEffort
from pinarm.records import AbstractRecord, Record

Reader = Callable[[float, Array, Array], float]
"""``(t, q, v) -> `` a named quantity of one state [SI]."""


class Signal(MeasuredCoordinate, frozen=True, kw_only=True):
    """A coordinate that a controller measures."""

    name: str

    @property
    def unit(self) -> Unit:
        return self.coordinate.unit

    def measure(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return value and rate in states of shapes (..., nq) and (..., nv), both of shape (...)."""
        if isinstance(self.coordinate, LinearCoordinate):
            return self.coordinate.at(q), self.coordinate.rate(v)
        return self.moving(q, v)[:2]


class Plant(Protocol):
    """The mechanism as controllers see it; names that it does not know raise ``InputError``."""

    def drive(self, name: str) -> Joint:
        """Return the joint that a drive moves, by the name of the drive or of the joint."""
        ...

    def command_unit(self, name: str) -> Unit:
        """Return the unit of the command of a drive: that of its motor, else that of efforts at its joint."""
        ...

    def motor_inverse(self, name: str) -> CommandOfEffort | None:
        """Return the command of a drive for an effort at its joint; ``None`` where commands do not fix the effort."""
        ...

    def signal(self, name: str) -> Signal:
        """Return a coordinate that can be measured, by the name of the coordinate or of the drive that moves it."""
        ...

    def reader(self, name: str) -> Reader:
        """Return a quantity of the state by name; it must be determined by positions and velocities."""
        ...

    def inverse(self, joints: Sequence[Joint]) -> Callable[[Array | float, Array, Array, Array], Array]:
        """Return ``(t, q, v, a) -> efforts``: those that give joints the accelerations a, shapes (..., k)."""
        ...


NOTHING = np.zeros(0)


class Given(NamedTuple):
    """Inputs of a controller, at one instant or at many; k drives, s signals, m integrals.

    Attributes:
        t: Instants [s], shape (...).
        q: Configurations, shape (..., nq).
        v: Velocities, shape (..., nv).
        measured: Values and rates of the signals, shape (..., s, 2).
        reference: Set points of the signals, with first and second derivative, shape (..., s, 3).
        integral: Integrals of the errors, shape (..., m).
        mode: State of a controller that switches, shape (...).
        commands: Of motors: what their controller commands, within its limits, shape (..., k).
        excess: Part of the commands of this controller that limits of motors cut off, shape (..., k); empty where its
            drives have no motors.
    """

    t: Array | float
    q: Array
    v: Array
    measured: Array
    reference: Array
    integral: Array
    mode: Indices | int = 0
    commands: Array = NOTHING
    excess: Array = NOTHING

    @property
    def error(self) -> Array:
        """Errors of the signals and their rates, reference less measured, shape (..., s, 2)."""
        return self.reference[..., :2] - self.measured


class Sampling(Record, frozen=True):
    """When a controller acts, and what its sensors see.

    Attributes:
        period: T [s].
        delay: From a measurement to the change of the effort [s].
        resolution: Steps of the measured coordinates, 0 for none, shape (s,).
        rates: Whether rates are ``measured``, or the ``difference`` of two measured values over the period.
    """

    period: float
    delay: float
    resolution: Array
    rates: str


def rhythm(period: float | None, delay: float) -> str:
    """Return in words when a controller acts, by its period and delay [s]."""
    if period is None:
        return "continuous"
    return f"sampled every {period:g} s" + (f", with a delay of {delay:g} s" if delay else "")


class Controller(AbstractRecord, frozen=True, kw_only=True):
    """A controller of one mechanism.

    Attributes:
        lower: Least efforts [N*m or N], shape (k,).
        upper: Largest efforts, shape (k,).
        sampling: When it acts; ``None`` for a continuous one.
        supply: What it commands in place of efforts: ``voltage`` or ``torque`` of motors; see ``mechanics.motors``.
    """

    drives: tuple[str, ...]
    joints: tuple[Joint, ...]
    lower: Array
    upper: Array
    signals: tuple[Signal, ...] = ()
    references: tuple[MotionLaw, ...] = ()
    sampling: Sampling | None = None
    supply: str = ""

    def begin(self) -> None:
        """Begin an integration, of which nothing is known: where a controller remembers by itself."""

    def parts(self, given: Given) -> dict[str, Array]:
        """Return quantities of a continuous controller by name, with ``effort`` of its drives, shape (..., k) each."""
        command = self.command(given)
        return {"command": command} | ({} if self.supply else {"effort": self.limited(command)})

    @abstractmethod
    def command(self, given: Given) -> Array:
        """Return the commanded efforts before their limits [N*m or N], shape (..., k)."""

    @property
    def integrals(self) -> int:
        return 0

    def rates(self, given: Given) -> Array:
        """Return the rates of the integrals, shape (..., m)."""
        return np.zeros((*np.shape(given.t), 0))

    def clamped(self, integral: Array) -> Array:
        """Return integrals within their limits, shape (..., m); see ``rates`` for continuous ones."""
        return integral

    def mode(self, given: Given, before: int | None) -> int:
        """Return the state of a controller that switches, at an instant; ``before`` is the one until then."""
        return 0

    def switches(self, mode: int) -> list[Switch[Given]]:
        switches = []
        for limits in (self.lower, self.upper):
            for k in np.flatnonzero(np.isfinite(limits)).tolist():
                switches.append(Switch(lambda given, k=k, at=limits[k]: self.command(given)[..., k] - at, 0))  # type: ignore[misc]
        return switches

    def limited(self, command: Array) -> Array:
        """Return efforts within the limits, shape (..., k)."""
        return command if self._endless else np.minimum(np.maximum(command, self.lower), self.upper)

    @cached_property
    def _endless(self) -> bool:
        return not np.isfinite([*self.lower, *self.upper]).any()

    def measure(self, q: Array, v: Array) -> Array:
        """Return values and rates of the signals, shape (..., s, 2)."""
        measured = np.empty((*q.shape[:-1], len(self.signals), 2))
        for k, signal in enumerate(self.signals):
            measured[..., k, 0], measured[..., k, 1] = signal.measure(q, v)
        return measured

    def followed(self, drive: str) -> int | None:
        """Return the signal whose error is that of a drive; ``None`` where it follows nothing."""
        if not self.references:
            return None
        if len(self.signals) == len(self.drives):
            return self.drives.index(drive)
        names, joint = [signal.name for signal in self.signals], self.joints[self.drives.index(drive)].name
        return names.index(joint) if joint in names else None
