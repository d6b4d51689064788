"""The keys that controllers share in files, and how they are bound to a mechanism."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Literal, Self, get_args

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, Key, choices, within
from pinarm.input.units import Unit
from pinarm.input.yaml.schema import (
    AnyQuantity,
    Duration,
    InputStruct,
    NotNegative,
    Pause,
    Readable,
    check_unit,
    convert,
)
from pinarm.input.yaml.validation_messages import explain, failing_path, unknown_key
from pinarm.mechanics.control.controller import Controller, Plant, Sampling, Signal
from pinarm.mechanics.joints import Joint
from pinarm.mechanics.laws import Law
from pinarm.mechanics.laws.motion_law import MotionLaw

Limits = tuple[AnyQuantity, AnyQuantity]
"""Least and largest effort."""

Wiring = tuple[
    tuple[str, ...], tuple[Joint, ...], tuple[Signal, ...], tuple[MotionLaw, ...], Array, Array, Sampling | None, str
]
"""Drives, joints, signals, references, least and largest efforts, sampling and supply of a controller."""


class ControlDefinition(InputStruct, frozen=True, kw_only=True):
    """What all controllers have in files.

    Attributes:
        drive: What it drives: a motor of the mechanism's ``drives``, or a joint; several as a list.
        period: Of a sampled controller, from one measurement to the next, such as ``1 ms``; continuous where it is left
            out.
        delay: From a measurement to the change of the effort; of sampled controllers.
        limits: Least and largest command, such as ``[-20 N*m, 20 N*m]`` at the joint, or ``[-24 V, 24 V]`` of a drive
            with a motor; one pair for all drives, or pairs by their names.
        resolution: Smallest step of the measured coordinates, such as ``0.1 deg``; of sampled controllers.
        rates: ``measured`` by a sensor of their own, or the ``difference`` of two samples over the period.
    """

    drive: str | list[str]
    period: Duration | None = None
    delay: Pause = 0.0
    limits: Limits | dict[str, Limits] | None = None
    resolution: NotNegative = 0.0
    rates: Literal["measured", "difference"] = "measured"

    @property
    def drives(self) -> list[str]:
        return [self.drive] if isinstance(self.drive, str) else self.drive

    @property
    def description(self) -> str:
        return f"{type(self).__struct_config__.tag}, {rhythm(self.period, self.delay)}"

    @property
    def names(self) -> list[str]:
        return self.drives

    def check(self) -> None:
        if not self.drives or len(set(self.drives)) < len(self.drives):
            with within("drive"):
                raise InputError("no drive is named, or one is named twice", expected="each drive once")
        for key, given in (("delay", self.delay), ("resolution", self.resolution), ("rates", self.rates != "measured")):
            if given and self.period is None:
                with within(key):
                    raise InputError(
                        f"a continuous controller has no {key}", expected="a sampled one", hint="period: 1 ms"
                    )

    @abstractmethod
    def bind(self, plant: Plant) -> Controller:
        """Return the controller of one mechanism."""

    def wired(self, plant: Plant, signals: tuple[Signal, ...], laws: tuple[MotionLaw, ...]) -> Wiring:
        """Return the fields of ``Controller``, given what is measured and the laws of the references."""
        bounds = self.bounds(self.units(plant))
        return tuple(self.drives), self.joints(plant), signals, laws, *bounds, self.sampling(signals), ""

    def joints(self, plant: Plant) -> tuple[Joint, ...]:
        with within("drive"):
            return tuple(plant.drive(name) for name in self.drives)

    def units(self, plant: Plant) -> list[Unit]:
        """Return the units of the commands of the drives: of efforts, or volts in front of a motor."""
        with within("drive"):
            return [plant.command_unit(name) for name in self.drives]

    def bounds(self, units: Sequence[Unit]) -> tuple[Array, Array]:
        """Return least and largest commands in given units, shape (k,) each."""
        if self.limits is None:
            return np.full(len(units), -np.inf), np.full(len(units), np.inf)
        with within("limits"):
            limits = self.limits if isinstance(self.limits, dict) else dict.fromkeys(self.drives, self.limits)
            for name in limits:
                if name not in self.drives:
                    expected, hint = choices(name, self.drives)
                    raise InputError(f"'{name}' is no drive of this controller", expected=expected, hint=hint)
            pairs = [limits.get(name, (-np.inf, np.inf)) for name in self.drives]
            for (low, high), measured in zip(pairs, units, strict=True):
                check_unit(low, measured)
                check_unit(high, measured)
                if not low < high:
                    raise InputError(f"the upper limit {high:g} is not above the lower one {low:g}")
            lower, upper = np.array(pairs, float).T
            return lower, upper

    def sampling(self, signals: Sequence[Signal]) -> Sampling | None:
        if self.period is None:
            return None
        with within("resolution"):
            for signal in signals:
                check_unit(self.resolution, signal.unit)
        steps = np.full(len(signals), float(self.resolution))
        return Sampling(float(self.period), float(self.delay), steps, self.rates)


class OneDriveDefinition(ControlDefinition, frozen=True, kw_only=True):
    """What controllers of one drive have in files, which measure one coordinate.

    Attributes:
        measures: Coordinate y, such as ``hand_angle``; that of the drive where it is left out.
    """

    measures: str | None = None

    @property
    def names(self) -> list[str]:
        return [*self.drives, *([self.measures] if self.measures else [])]

    def check(self) -> None:
        super().check()
        if len(self.drives) > 1:
            with within("drive"):
                raise InputError(
                    f"this kind of controller has one drive, not {len(self.drives)}",
                    expected="a controller for each drive",
                )

    def signals(self, plant: Plant) -> tuple[Signal, ...]:
        return measured(plant, [self.measures or self.drives[0]])


def rhythm(period: float | None, delay: float) -> str:
    """Return in words when a controller acts, by its period and delay [s]."""
    if period is None:
        return "continuous"
    return f"sampled every {period:g} s" + (f", with a delay of {delay:g} s" if delay else "")


def measured(plant: Plant, names: list[str]) -> tuple[Signal, ...]:
    """Return the signals of coordinates."""
    with within("measures"):
        return tuple(plant.signal(name) for name in names)


class References(Readable):
    """One law; a list of laws in the order of the coordinates; or coordinate -> law.

    Attributes:
        given: The laws.
    """

    __slots__ = ("given",)

    def __init__(self, given: Law | list[Law] | dict[str, Law]) -> None:
        self.given = given

    def __eq__(self, other: object) -> bool:
        return isinstance(other, References) and self.given == other.given

    def __hash__(self) -> int:
        return hash(repr(self.given))

    def __repr__(self) -> str:
        return repr(self.given)

    @classmethod
    def read(cls, value: object) -> Self:
        if isinstance(value, cls):
            return value
        if isinstance(value, list):
            return cls([_law(each, row) for row, each in enumerate(value)])
        if isinstance(value, dict) and all(isinstance(each, dict | MotionLaw) for each in value.values()):
            return cls({name: _law(each, name) for name, each in value.items()})
        return cls(_law(value))

    @classmethod
    def schema(cls) -> dict[str, object]:
        law = {"anyOf": [{"$ref": f"#/$defs/{kind.__name__}"} for kind in get_args(Law)]}
        listed, named = {"type": "array", "items": law}, {"type": "object", "additionalProperties": law}
        return {"anyOf": [law, listed, named]}

    def plain(self) -> object:
        return self.given

    def laws(self, names: Sequence[str], signals: Sequence[Signal], rest: Law | None = None) -> tuple[Law, ...]:
        """Return the laws that signals follow, checked.

        Args:
            rest: What coordinates follow that a map leaves out; ``None`` where it must not.
        """
        with within("follows"):
            laws = self._named(names, rest) if isinstance(self.given, dict) else self._listed(names)
            for k, (name, law, signal) in enumerate(zip(names, laws, signals, strict=True)):
                key = [name] if isinstance(self.given, dict) else [k] if isinstance(self.given, list) else []
                with within(*key):
                    law.check_units(signal.unit)
        return tuple(laws)

    def _listed(self, names: Sequence[str]) -> list[Law]:
        laws: list[Any] = self.given if isinstance(self.given, list) else [self.given]
        if len(laws) != len(names):
            raise InputError(
                f"{len(laws)} law{'s are' if len(laws) != 1 else ' is'} given, for {', '.join(names)}",
                expected=f"{len(names)}, one for each coordinate, as a list or by their names",
                hint=f"{{{', '.join(f'{name}: ...' for name in names)}}}",
            )
        return laws

    def _named(self, names: Sequence[str], rest: Law | None) -> list[Law]:
        assert isinstance(self.given, dict)
        for name in self.given:
            if name not in names:
                expected, hint = choices(name, names)
                with within(Key(name)):
                    raise InputError(
                        f"'{name}' is not what this controller moves or measures", expected=expected, hint=hint
                    )
        laws = {name: self.given.get(name, rest) for name in names}
        if missing := [name for name, law in laws.items() if law is None]:
            raise InputError(f"{', '.join(missing)} has no law to follow", expected="a law for each coordinate")
        return [law for law in laws.values() if law is not None]


def _law(value: Any, *at: str | int) -> Law:
    """Return the law that plain data say; one that was built in Python as it is."""
    if isinstance(value, MotionLaw):
        return value  # type: ignore[return-value]  # Law is the union of its kinds
    try:
        return msgspec.convert(value, Law, dec_hook=convert)  # type: ignore[no-any-return]
    except msgspec.ValidationError as error:
        path = failing_path(error, value, Law)  # type: ignore[arg-type]  # a union of structs
        mistake = explain(error, value, path, Law)  # type: ignore[arg-type]
        mistake.path = (*at, *path, *map(Key, unknown_key(error)), *mistake.path)
        raise mistake from None
