"""Controllers given as functions in Python: ``u(t, state)``."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import CellType, FunctionType
from typing import Any

import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, PinarmError, within
from pinarm.input.yaml.schema import Duration, Pause
from pinarm.mechanics.control.controller import Controller, Given, Plant, Reader, Sampling, rhythm


class MeasuredState:
    """A state as a function sees it: ``state["knee"]`` is a named quantity [SI].

    Names are those of coordinates (``knee``), of their rates (``joint.knee.velocity``, ``coordinate.C.velocity``), and
    of all quantities that positions and velocities determine, such as ``point.hand.position.x``.

    Attributes:
        t: Instant [s].
        q: Configuration, shape (nq,), which cannot be changed: it is the integrator's own.
        v: Velocity, shape (nv,), likewise.
    """

    __slots__ = ("_plant", "_readers", "q", "t", "v")

    def __init__(self, t: float, q: Array, v: Array, plant: Plant, readers: dict[str, Reader]) -> None:
        self.t, self.q, self.v, self._plant, self._readers = t, q.view(), v.view(), plant, readers
        self.q.flags.writeable = self.v.flags.writeable = False

    def __getitem__(self, name: str) -> float:
        """Return a quantity by name [SI]."""
        reader = self._readers.get(name)
        if reader is None:
            reader = self._readers[name] = self._plant.reader(name)
        return reader(self.t, self.q, self.v)


ControlFunction = Callable[[float, MeasuredState], Any]
"""``(t, state) -> effort``; of several drives a sequence of efforts, in their order."""


class FreshFunction:
    """A function that remembers, as it was given, at the beginning of every integration.

    A motion is integrated more than once where its error is estimated or a target of it is looked for; what a sampled
    function has seen in one integration it must not know in the next. The first integration calls the function itself,
    every later one a copy of what it was before that, by ``copy.deepcopy`` of an object that is called and of the
    variables of a function that belong to it. What cannot be copied, and global variables, stay.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.own, self.kept, self.now = function, copied(function, {}), function
        self.begun = False

    def begin(self) -> None:
        self.now = copied(self.kept, {}) if self.begun else self.own
        self.begun = True

    def __call__(self, *given: Any) -> Any:
        return self.now(*given)


def copied(thing: Any, known: dict[int, Any]) -> Any:
    """Return a copy of a function, with its variables, or of another object; the same where it cannot be copied.

    Args:
        known: Copies that were made already, by the ``id`` of the originals, as for ``copy.deepcopy``.
    """
    if isinstance(thing, FunctionType):
        return _copied_function(thing, known)
    try:
        return copy.deepcopy(thing, known)
    except Exception:  # whatever an object of the user's raises there
        return thing


def _copied_function(function: FunctionType, known: dict[int, Any]) -> FunctionType:
    held = function.__closure__, function.__defaults__, function.__kwdefaults__, function.__dict__
    if id(function) in known or not any(held):
        return known.get(id(function), function)  # type: ignore[no-any-return]
    cells = function.__closure__ or ()
    fresh = {id(cell): CellType() for cell in cells if id(cell) not in known}
    known.update(fresh)
    closure = tuple(known[id(cell)] for cell in cells)
    duplicate = FunctionType(function.__code__, function.__globals__, function.__name__, None, closure)
    known[id(function)] = duplicate
    duplicate.__defaults__, duplicate.__kwdefaults__ = (
        copied(function.__defaults__, known),
        copied(function.__kwdefaults__, known),
    )
    duplicate.__dict__.update(copied(function.__dict__, known))
    for cell in cells:
        if id(cell) in fresh and _is_filled(cell):
            known[id(cell)].cell_contents = copied(cell.cell_contents, known)
    return duplicate


def _is_filled(cell: CellType) -> bool:
    try:
        cell.cell_contents  # noqa: B018  raises where a variable has no value yet
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class FunctionControl:
    """A controller given as a function: its effort is what the function returns.

    A continuous one is called at every stage of every step, in no order of time: it must depend on its arguments only,
    and be smooth. A sampled one is called once for each sample, in order of time, and may remember: every integration
    begins with it as it was given; see ``FreshFunction``.

    Attributes:
        function: ``(t, state) -> effort``, or efforts in the order of the drives.
        period: Of a sampled one [s].
        delay: From a sample to the change of the effort [s].
    """

    drives: tuple[str, ...]
    function: ControlFunction
    period: Duration | None = None
    delay: Pause = 0.0

    @property
    def description(self) -> str:
        return f"function, {rhythm(self.period, self.delay)}"

    @property
    def names(self) -> list[str]:
        return list(self.drives)

    @cached_property
    def called(self) -> ControlFunction:
        return self.function if self.period is None else FreshFunction(self.function)

    def __reduce__(self) -> tuple[Any, ...]:
        return FunctionControl, (self.drives, self.function, self.period, self.delay)

    def bind(self, plant: Plant) -> Controller:
        with within("drive"):
            joints = tuple(plant.drive(name) for name in self.drives)
        endless, readers = np.full(len(joints), np.inf), dict[str, Reader]()
        sampling = None if self.period is None else Sampling(self.period, self.delay, np.zeros(0), "measured")
        return FunctionController(
            drives=self.drives, joints=joints, lower=-endless, upper=endless, sampling=sampling,
            function=self.called, plant=plant, readers=readers,
        )  # fmt: skip


class FunctionController(Controller, frozen=True, kw_only=True):
    """A function as controller of one mechanism.

    Attributes:
        function: ``(t, state) -> effort``.
    """

    function: ControlFunction
    plant: Plant
    readers: dict[str, Reader]

    def begin(self) -> None:
        if isinstance(self.function, FreshFunction):
            self.function.begin()

    def command(self, given: Given) -> Array:
        if np.ndim(given.t) == 0:
            return self._call(float(given.t), given.q, given.v)
        states = zip(np.asarray(given.t).tolist(), given.q, given.v, strict=True)
        return np.array([self._call(*state) for state in states]).reshape(len(given.q), len(self.drives))

    def _call(self, t: float, q: Array, v: Array) -> Array:
        words = f"the control function of {', '.join(self.drives)}"
        return returned(self.function, words, MeasuredState(t, q, v, self.plant, self.readers), len(self.drives))


def returned(function: ControlFunction, words: str, state: MeasuredState, count: int) -> Array:
    """Return the efforts that a function returns in a state [N*m or N], shape (count,)."""
    at = f"at t = {state.t:.9g} s"
    try:
        effort = function(state.t, state)
    except PinarmError:
        raise
    except Exception as error:
        raise InputError(
            f"{words} fails {at}: {type(error).__name__}: {error}", expected="a function u(t, state)"
        ) from error
    try:
        if (given := np.asarray(effort)).dtype.kind in "USc":  # a text or a complex number is no effort
            raise TypeError
        values = np.array(given, dtype=np.float64).reshape(count)
    except (TypeError, ValueError):
        raise InputError(
            f"{words} has returned {effort!r} {at}",
            expected="an effort" if count == 1 else f"{count} efforts in a sequence",
        ) from None
    if not np.isfinite(values).all():
        raise InputError(f"{words} has returned {effort!r} {at}", expected="finite efforts")
    return values


def function_controls(
    control: Mapping[str | tuple[str, ...], ControlFunction], period: float | None = None, delay: float = 0.0
) -> Sequence[FunctionControl]:
    """Return the controllers of functions by the names of their drives.

    Args:
        control: Drive, or several in a tuple -> ``u(t, state)``.
        period: Of sampled ones [s]; continuous where it is left out.
        delay: From a sample to the change of the effort [s].
    """
    if not isinstance(control, Mapping):
        raise InputError(
            f"the control is {control!r}",
            expected="drives and their functions",
            hint="control={'knee': u}, or control={('hip', 'knee'): u}",
        )
    require_times(period, delay)
    controls = []
    for name, function in control.items():
        drives = (name,) if isinstance(name, str) else name
        named = isinstance(drives, tuple) and drives and all(isinstance(drive, str) for drive in drives)
        if not named or not callable(function):
            raise InputError(
                f"the control of {name!r} is {function!r}",
                expected="the name of a drive, or several in a tuple, and a function u(t, state)",
            )
        controls.append(FunctionControl(drives, function, period, delay))
    return controls


def require_times(period: float | None, delay: float) -> None:
    """Raise where the period [s] or the delay [s] of functions is none."""
    times = (1.0 if period is None else period), delay
    numbers = (isinstance(x, int | float | np.integer | np.floating) and not isinstance(x, bool) for x in times)
    if not all(numbers) or not 0.0 < times[0] < np.inf or not 0.0 <= delay < np.inf or (delay and period is None):
        raise InputError(
            f"the period is {period!r}, the delay {delay!r}",
            expected="a positive period in seconds, and a delay of sampled functions only",
        )
