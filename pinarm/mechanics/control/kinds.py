"""Controllers in files, and their commands: PID, state feedback, computed torque, and relays."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Literal, Self, get_args

import msgspec
import numpy as np

from pinarm.arrays import Array
from pinarm.errors import InputError, Key, choices, within
from pinarm.input.units import Unit, unit
from pinarm.input.yaml.schema import (
    AnyQuantity,
    Duration,
    Gain,
    InputStruct,
    IntegralGain,
    NotNegative,
    Pause,
    RateGain,
    Readable,
    check_keys,
    check_unit,
    convert,
)
from pinarm.input.yaml.validation_messages import explain, failing_path, unknown_key
from pinarm.mechanics.control.controller import Controller, Given, Plant, Sampling, Signal, rhythm
from pinarm.mechanics.joints import Joint
from pinarm.mechanics.laws import Constant, Law
from pinarm.mechanics.laws.motion_law import MotionLaw
from pinarm.mechanics.limited_states import FREE, StateLimits, Switch

Limits = tuple[AnyQuantity, AnyQuantity]
"""Least and largest effort."""


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

    def wired(self, plant: Plant, signals: tuple[Signal, ...], laws: tuple[MotionLaw, ...]) -> dict[str, Any]:
        """Return the fields of ``Controller``, given what is measured and the laws of the references."""
        lower, upper = self.bounds(self.units(plant))
        return {
            "drives": tuple(self.drives), "joints": self.joints(plant), "signals": signals, "references": laws,
            "lower": lower, "upper": upper, "sampling": self.sampling(signals),
        }  # fmt: skip

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
            if isinstance(self.given, dict):
                keys: list[list[str | int]] = [[name] for name in names]
                given = {**({} if rest is None else dict.fromkeys(names, rest)), **self.given}
                laws = [given.pop(name) for name in names if name in given]
                fits = not given and len(laws) == len(names)
            else:
                laws = self.given if isinstance(self.given, list) else [self.given]
                keys = [[k] for k in range(len(laws))] if isinstance(self.given, list) else [[]]
                fits = len(laws) == len(names)
            if not fits:
                raise InputError(
                    f"the laws are not those of {', '.join(names)}",
                    expected="one for each coordinate, as a list or by their names",
                    hint=f"{{{', '.join(f'{name}: ...' for name in names)}}}",
                )
            for key, law, signal in zip(keys, laws, signals, strict=True):
                with within(*key):
                    law.check_units(signal.unit)
        return tuple(laws)


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


class Pid(OneDriveDefinition, frozen=True, kw_only=True, tag_field="kind", tag="pid"):
    """``u = kp e + ki integral of e + kd e'``, with the error ``e = r - y`` of a coordinate y that follows r(t).

    The derivative is that of the error, so that a moving reference is followed without lag of the damping. The part of
    the integral, ``ki integral of e``, is kept within the limits of the effort (clamp): it does not wind up. Sampled,
    the integral is the sum of the errors times the period, the present one included.

    Where a limit of the drive's motor, its peak torque or its largest current, keeps a part of the command from its
    effect, the integral follows what is given (back-calculation): ``x' = e - (u - u_given) / (ki T_t)`` with the
    tracking time T_t. With T_t = kp/ki the integral's part tends to ``u_given - kd e'`` as ``exp(-t / T_t)``, and does
    not wind up. Source: Åström, Hägglund, PID Controllers, 1995, section 3.5.

    Good values for an inertia J: ``kp = J w^2``, ``kd = 2 d J w``, with the pulsation w of the closed loop and its
    damping ratio d, 0.7 to 1; ``ki`` at most ``0.1 kp w``; a period below ``0.1 / w``.

    Attributes:
        follows: The law of the reference r.
        kp: Effort per error.
        ki: Effort per error and second.
        kd: Effort per rate of the error.
        tracking_time: Time T_t in which the integral follows a command that is cut off at its limit, such as ``50 ms``;
            kp/ki where it is left out.
    """

    follows: References
    kp: Gain
    ki: IntegralGain = 0.0
    kd: RateGain = 0.0
    tracking_time: Duration | None = None

    def bind(self, plant: Plant) -> Controller:
        (commanded,), signals = self.units(plant), self.signals(plant)
        laws = self.follows.laws([self.measures or self.drives[0]], signals)
        per = {"kp": "", "ki": "/s", "kd": "*s"}
        check_keys(self, **{key: unit(f"{commanded}{time}/{signals[0].unit}") for key, time in per.items()})
        return PidController(**self.wired(plant, signals, laws), law=self)

    @property
    def tracking(self) -> float:
        """Return T_t [s]; infinite where it is not given and kp is 0."""
        if self.tracking_time is None:
            kp, ki = float(self.kp), float(self.ki)
            return abs(kp / ki) if kp and ki else np.inf
        if self.period and not float(self.tracking_time) > float(self.period) / 2:  # the integral would not settle
            with within("tracking_time"):
                raise InputError(
                    f"a tracking time of {float(self.tracking_time):g} s and a period of {float(self.period):g} s",
                    expected="more than half of the period",
                )
        return float(self.tracking_time)


class PidController(Controller, frozen=True, kw_only=True):
    """A PID controller of one mechanism."""

    law: Pid

    def command(self, given: Given) -> Array:
        """Return ``kp e + ki x + kd e'``."""
        error = given.error
        u = self.law.kp * error[..., 0] + self.law.kd * error[..., 1]
        return np.asarray(u + self.law.ki * given.integral if self.law.ki else u)

    @property
    def integrals(self) -> int:
        return 1 if self.law.ki else 0

    def rates(self, given: Given) -> Array:
        if not self.law.ki:
            return super().rates(given)
        return np.where(np.equal(given.mode, FREE)[..., None], self._free_rates(given), 0.0)

    def _free_rates(self, given: Given) -> Array:
        """Return the rate of an integral that is within its limits, shape (..., 1)."""
        error = given.error[..., 0]
        return error - given.excess / (self.law.ki * self.law.tracking) if given.excess.size else error

    def clamped(self, integral: Array) -> Array:
        ends = np.array([self.lower, self.upper]) / self.law.ki
        return np.asarray(np.clip(integral, ends.min(axis=0), ends.max(axis=0)))

    @property
    def _limits(self) -> StateLimits:
        """Limits of the integral's part of the command."""
        return StateLimits(float(self.lower[0]), float(self.upper[0]))

    def mode(self, given: Given, before: int | None) -> int:
        if not self.law.ki:
            return FREE
        terms = abs(self.law.ki) * (abs(given.reference[0, 0]) + abs(given.measured[0, 0]))
        part, rate = float(self._part(given)), float(self._rate_of_part(given))
        return self._limits.mode(part, rate, float(terms), before or FREE)

    def switches(self, mode: int) -> list[Switch[Given]]:
        own = self._limits.switches(mode, self._part, self._rate_of_part) if self.law.ki else []
        return [*super().switches(mode), *own]

    def _part(self, given: Given) -> Array:
        return np.asarray(self.law.ki * given.integral[..., 0])

    def _rate_of_part(self, given: Given) -> Array:
        return np.asarray(self.law.ki * self._free_rates(given)[..., 0])


LOW, HIGH = 0, 1
"""States of the relay: the effort below and above."""


class ComputedTorque(ControlDefinition, frozen=True, kw_only=True, tag_field="kind", tag="computed_torque"):
    """The efforts that inverse dynamics asks for the accelerations ``r'' + kd e' + kp e`` of the drives.

    Inverse dynamics is that of the mechanism with all its forces at the measured state: the errors obey
    ``e'' + kd e' + kp e = 0`` and vanish. What the drives do not move directly, such as free joints, follows from the
    equation of motion. Source: Siciliano et al., Robotics (2009), section 8.5.2.

    Good values: ``kp = w^2``, ``kd = 2 w`` with the pulsation w at which errors are to vanish.

    Attributes:
        follows: Laws of the drives' coordinates: one for each drive in their order, or drive -> law.
        kp: Acceleration per error [1/s^2].
        kd: Acceleration per rate of the error [1/s].
    """

    follows: References
    kp: AnyQuantity = 0.0
    kd: AnyQuantity = 0.0

    def bind(self, plant: Plant) -> Controller:
        joints = self.joints(plant)
        signals = measured(plant, self.drives)
        laws = self.follows.laws(self.drives, signals)
        check_keys(self, kp=unit("1/s^2"), kd=unit("1/s"))
        with within("drive"):
            inverses = [plant.motor_inverse(name) for name in self.drives]
            motors = [motor for motor in inverses if motor is not None]
            if len(motors) < len(inverses):
                raise InputError(
                    "the current of a motor with inductance follows its voltage late: no voltage gives an "
                    "effort at once",
                    expected="a motor without inductance, or an ideal one",
                    hint="kind: pid, or the joint's name in place of the drive's",
                )
            inverse = plant.inverse(joints)
        wired = self.wired(plant, signals, laws)
        return ComputedTorqueController(**wired, law=self, motors=np.array(motors).T, inverse=inverse)


class ComputedTorqueController(Controller, frozen=True, kw_only=True):
    """Computed torque of one mechanism.

    Attributes:
        motors: Command of each drive per effort and per velocity of its joint, shape (2, k); see ``CommandOfEffort``.
        inverse: ``(t, q, v, a) -> efforts`` of the drives; see ``Plant.inverse``.
    """

    law: ComputedTorque
    motors: Array
    inverse: Callable[[Array | float, Array, Array, Array], Array]

    def command(self, given: Given) -> Array:
        """Return the efforts of the accelerations ``r'' + kd e' + kp e``, or the commands of motors that give them."""
        error = given.error
        wanted = given.reference[..., 2] + self.law.kd * error[..., 1] + self.law.kp * error[..., 0]
        per_effort, per_velocity = self.motors
        velocities = given.v[..., [joint.v for joint in self.joints]]
        efforts = self.inverse(given.t, given.q, given.v, wanted)
        return np.asarray(per_effort * efforts + per_velocity * velocities)


class StateFeedback(ControlDefinition, frozen=True, kw_only=True, tag_field="kind", tag="state_feedback"):
    """``u = u_0 + K (x_r - x)``, x being coordinates and their rates, x_r what they should be.

    Gains as of a linear-quadratic regulator, or of placed poles: K is designed elsewhere, for the linearised mechanism.

    Attributes:
        states: The coordinates in x; their rates follow all of them: ``x = [y_1 .. y_s, y_1' .. y_s']``.
        gains: K, a row for each drive with 2 s columns: efforts per coordinate, then efforts per rate.
        follows: Laws of the references, whose derivatives are those of the rates, such as ``{x: {law: constant, value:
            0.2 m}}``: coordinate -> law, 0 where one is left out; or a list of laws, one for each state.
        bias: u_0, an effort for each drive, such as the one that holds the mechanism at the reference.
    """

    states: Annotated[list[str], msgspec.Meta(min_length=1)]
    gains: list[list[AnyQuantity]]
    follows: References | None = None
    bias: list[AnyQuantity] = []

    @property
    def names(self) -> list[str]:
        return [*self.drives, *self.states]

    def bind(self, plant: Plant) -> Controller:
        joints, units = self.joints(plant), self.units(plant)
        with within("states"):
            if len(set(self.states)) < len(self.states):
                raise InputError("a state is named twice", expected="each coordinate once")
            signals = measured(plant, self.states)
        rest = Constant(value=0.0)
        laws = (self.follows or References({})).laws(self.states, signals, rest)
        shape = len(joints), 2 * len(signals)
        with within("gains"):
            if len(self.gains) != shape[0] or any(len(row) != shape[1] for row in self.gains):
                raise InputError(
                    f"the matrix has not {shape[0]} rows of {shape[1]} gains",
                    expected="a row for each drive: gains of the states, then of their rates",
                )
            for k, (row, commanded) in enumerate(zip(self.gains, units, strict=True)):
                for i, gain in enumerate(row):
                    rated = unit("1/s") if i >= len(signals) else unit("1")
                    with within(k, i):
                        check_unit(gain, commanded / signals[i % len(signals)].unit / rated)
        with within("bias"):
            if len(self.bias) not in (0, len(joints)):
                raise InputError(f"there are {len(self.bias)} efforts", expected=f"{len(joints)}, one for each drive")
            for command, commanded in zip(self.bias, units, strict=False):
                check_unit(command, commanded)
        gains, bias = np.array(self.gains, float), np.array(self.bias or [0.0] * len(joints), float)
        return StateFeedbackController(**self.wired(plant, signals, laws), gains=gains, bias=bias)


class StateFeedbackController(Controller, frozen=True, kw_only=True):
    """State feedback of one mechanism.

    Attributes:
        gains: K, shape (k, 2 s).
        bias: u_0, shape (k,).
    """

    gains: Array
    bias: Array

    def command(self, given: Given) -> Array:
        """Return ``u_0 + K (x_r - x)``."""
        error = given.error
        x = np.concatenate([error[..., 0], error[..., 1]], axis=-1)
        return np.asarray(self.bias + x @ self.gains.T)


class Switching(OneDriveDefinition, frozen=True, kw_only=True, tag_field="kind", tag="switching"):
    """A relay on ``s = e + lead e'``: the effort ``above`` once s reaches the hysteresis, ``below`` once its negative.

    In between it keeps the effort that it has; at the start it takes the one of the sign of s. ``lead`` makes it switch
    before the error vanishes (bang-bang control along a line in the phase plane). A continuous relay switches at
    events and needs a hysteresis: without one it would switch without end.

    Attributes:
        follows: Law of the reference r of the measured coordinate y, such as ``{law: constant, value: 20 deg}``, ``e =
            r - y``; 0 where it is left out.
        above: Effort while s is above, mostly positive.
        below: Effort while s is below.
        hysteresis: Half the width within which the relay keeps its effort, in the unit of y.
        lead: Time by which rates count [s].
    """

    follows: References | None = None
    above: AnyQuantity
    below: AnyQuantity
    hysteresis: AnyQuantity = 0.0
    lead: Pause = 0.0

    def check(self) -> None:
        super().check()
        if self.hysteresis < 0.0 or (self.period is None and not self.hysteresis):
            with within("hysteresis"):
                raise InputError(
                    f"the hysteresis is {self.hysteresis:g}: a continuous relay would switch without end",
                    expected="a positive one",
                    hint="period: 1 ms for a sampled relay",
                )

    def bind(self, plant: Plant) -> Controller:
        (commanded,), signals = self.units(plant), self.signals(plant)
        laws = (self.follows or References(Constant(value=0.0))).laws([self.measures or self.drives[0]], signals)
        check_keys(self, above=commanded, below=commanded, hysteresis=signals[0].unit)
        return Relay(**self.wired(plant, signals, laws), law=self)


class Relay(Controller, frozen=True, kw_only=True):
    """A relay of one mechanism."""

    law: Switching

    def command(self, given: Given) -> Array:
        efforts = np.where(np.equal(given.mode, HIGH), self.law.above, self.law.below)
        return np.broadcast_to(efforts, np.shape(given.t))[..., None]

    def deviation(self, given: Given) -> Array:
        """Return ``s = e + lead e'``, shape (...)."""
        error = given.error[..., 0, :]
        return np.asarray(error[..., 0] + self.law.lead * error[..., 1])

    def mode(self, given: Given, before: int | None) -> int:
        s = float(self.deviation(given))
        if before is None:
            return HIGH if s >= 0.0 else LOW
        if s >= self.law.hysteresis:
            return HIGH
        return LOW if s <= -self.law.hysteresis else before

    def switches(self, mode: int) -> list[Switch[Given]]:
        if mode == HIGH:
            return [Switch(lambda given: self.deviation(given) + self.law.hysteresis, -1, LOW, leaps=True)]
        return [Switch(lambda given: self.deviation(given) - self.law.hysteresis, 1, HIGH, leaps=True)]


Control = Pid | StateFeedback | ComputedTorque | Switching
"""Any controller. A new one is a class here or in a module beside this one, and one entry here."""
