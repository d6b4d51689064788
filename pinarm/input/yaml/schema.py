"""Base class and quantity types of everything that is read from files: validated, immutable, strict about units."""

# Annotations are no text here (``from __future__ import annotations``): msgspec would compile each in every run.

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib import import_module
from pathlib import Path
from types import UnionType
from typing import Any, ClassVar, Self, TypeVar, Union, get_args, get_origin

import msgspec
import numpy as np

from pinarm.errors import InputError, PinarmError, UnitError, within
from pinarm.input.roots import contained_file, root_of
from pinarm.input.units import DECIMAL, DIMENSIONLESS, HERTZ, Unit, read_quantity, unit

StructT = TypeVar("StructT", bound=msgspec.Struct)

Deferred = Mapping[str, tuple[str, str]]
"""Field -> module and name of the type in place of ``Any`` in its annotation, imported where a file has the field."""

_folder: ContextVar[Path | None] = ContextVar("folder", default=None)
_parameters: ContextVar[Mapping[str, "Measured"] | None] = ContextVar("parameters", default=None)


@contextmanager
def reading_from(folder: Path) -> Iterator[None]:
    """Validate objects built in the block as content of a file in that folder: relative paths, units required."""
    token = _folder.set(folder)
    try:
        yield
    finally:
        _folder.reset(token)


def current_folder() -> Path | None:
    """Return the folder of the file being read; ``None`` for objects built in Python."""
    return _folder.get()


def named_file(name: str) -> Path:
    """Return the regular file that a key of the file being read names; see ``roots.contained_file``."""
    folder = current_folder()
    path = ((folder or Path()) / name).absolute()
    return contained_file(path, root_of(folder or path.parent))


@contextmanager
def with_parameters(parameters: Mapping[str, "Measured"]) -> Iterator[None]:
    """Read quantities of the block also as formulas of parameters, such as ``2*l1``."""
    token = _parameters.set(parameters)
    try:
        yield
    finally:
        _parameters.reset(token)


def _quantity(text: str) -> tuple[float, Unit | None, bool]:
    """Return the SI value and the unit of a quantity, or of a formula of parameters, and whether it is a formula."""
    try:
        return *read_quantity(text), False
    except InputError:
        if (known := _parameters.get()) is None:
            raise
        from pinarm.input.formulas.expressions import Expression

        try:
            formula = Expression.parse(text)
        except InputError:
            formula = None
        if formula is None:
            raise
    units = {name: value.unit if value.unit or not value else DIMENSIONLESS for name, value in known.items()}
    return (
        float(formula.evaluate({name: float(value) for name, value in known.items()})),
        formula.dimension(units),
        True,
    )


FARTHEST = 1e50
"""Largest length [m], in files of all kinds: squares and products of it stay numbers."""

HEAVIEST, LARGEST = 1e50, 1e100
"""Largest mass [kg], as ``FARTHEST``; largest quantity of any other kind [SI], as forces and ratios: its square."""


class Measured(float):
    """A float in SI with the unit that it was written in.

    Attributes:
        unit: The unit as written; ``None`` for a bare number.
        expected: Unit whose dimension it must have; ``None`` for any.
        order: For fields of a law: order of the derivative of its value.
        along: For fields of a law: power of the variable that the law runs along.
        within: Bound of its size in SI, either way.
        below: Bound of its size in SI, either way, that it must not reach.
        nonzero: Whether it must not be 0.
        forms: What may stand for it in a file, as JSON Schemas.
        examples: Values that a message shows where the unit is missing.
    """

    unit: Unit | None = None
    computed: bool = False
    expected: ClassVar[Unit | None] = None
    order: ClassVar[int | None] = None
    along: ClassVar[int | None] = None
    least: ClassVar[float | None] = None
    above: ClassVar[float | None] = None
    within: ClassVar[float] = LARGEST
    below: ClassVar[float] = math.inf
    nonzero: ClassVar[bool] = False
    forms: ClassVar[Sequence[Mapping[str, Any]]] = ({"type": "number"}, {"type": "string"})
    examples: ClassVar[str] = "30 deg; a number without a unit is 50 % or 0.5 1"

    @classmethod
    def read(cls, value: object, *, bare: bool = True) -> Self:
        """Read ``"30 deg"``, or a number in SI, of numpy too; where ``bare`` is false, only 0 needs no unit."""
        if isinstance(value, cls):
            return value
        if isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise InputError("this is not a quantity", expected="a number with a unit, such as '30 deg'")
        try:
            plain = not isinstance(value, str)
            number, written, computed = (float(value), _unit_of(value), False) if plain else _quantity(str(value))
        except OverflowError:
            number, written, computed = float("inf"), None, False
        if number - number != 0.0:
            raise InputError(f"'{value}' is not a finite number", expected="a finite number")
        if written is None and number != 0.0 and not bare and not computed:
            shown = f"{value:g}" if isinstance(value, Measured) else value
            hint = f"{shown} {cls.expected}" if cls.expected else ""
            raise UnitError(
                f"'{shown}' has no unit",
                hint=hint,
                expected=f"a number with its unit, such as {cls.examples}",
            )
        measured = cls._of(number, written)
        measured.computed = computed
        return measured

    @classmethod
    def _of(cls, number: float, written: Unit | None) -> Self:
        measured = cls(number)
        measured.unit = written
        if cls.expected is not None:
            measured.check(cls.expected)
        if (cls.least is not None and number < cls.least) or (cls.above is not None and number <= cls.above):
            bound = f"at least {cls.least:g}" if cls.above is None else f"more than {cls.above:g}"
            raise InputError(f"{number:g} is out of bounds", expected=bound)
        if cls.nonzero and not number:
            raise InputError("0 is out of bounds", expected="a number other than 0")
        if not abs(number) < cls.below:
            bound = f"less than {math.degrees(cls.below):g} deg"
            raise InputError(f"{math.degrees(number):g} deg is out of bounds", expected=bound)
        if abs(number) > cls.within:
            raise InputError(
                f"{number:g} is out of bounds",
                expected=f"a size of at most {cls.within:g}",
                hint="check the exponent and the unit",
            )
        return measured

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as number and unit: the class with its bounds has no name in another process."""
        return _plain, (float(self), self.unit)

    def check(self, expected: Unit) -> None:
        """Raise where the written unit has another dimension than the expected one."""
        if self.unit is not None and not self.unit.fits(expected):
            if self.unit.text == HERTZ.text and self.unit.dimension == expected.dimension:
                raise UnitError("Hz is ambiguous between turns and radians", hint="rpm, rev/s or rad/s")
            raise UnitError(f"'{self.unit}' is not a unit of this quantity", expected=f"a unit such as {expected}")


def _plain(number: float, written: Unit | None) -> Measured:
    """Return a number with its unit; a struct that it is a field of gives it the class of the field."""
    measured = Measured(number)
    measured.unit = written
    return measured


def _unit_of(value: object) -> Unit | None:
    return value.unit if isinstance(value, Measured) else None


def quantity(text: str = "", **expected: float | str | None) -> Any:
    """Return the annotation of a quantity: a subclass of ``Measured``.

    Args:
        text: Unit whose dimension it must have; any dimension if empty.
        expected: ``least``, ``above``, ``within``, ``below``, ``nonzero``, ``order``, ``along`` or ``examples``; see
            ``Measured``.
    """
    return type("Measured", (Measured,), {"expected": unit(text) if text else None, **expected})


AnyQuantity = quantity()
NotNegative, Positive = quantity(least=0.0), quantity(above=0.0)
Level, Rate, SecondRate, ThirdRate = quantity(order=0), quantity(order=1), quantity(order=2), quantity(order=3)
Time, Duration, Pause = quantity("s"), quantity("s", above=0.0), quantity("s", least=0.0)
Abscissa, Extent, Pulsation = quantity(along=1), quantity(along=1, above=0.0), quantity(along=-1)
Angle, Length = quantity("rad"), quantity("m", least=0.0, within=FARTHEST)
Force, Moment, Acceleration = quantity("N"), quantity("N*m"), quantity("m/s^2", least=0.0)
Inertia, Mass = quantity("kg*m^2", least=0.0), quantity("kg", least=0.0, within=HEAVIEST)
Span, Lead = quantity("m", above=0.0, within=FARTHEST), quantity("m", within=FARTHEST)
Position, Tension, Pitch = Lead, quantity("N", least=0.0), quantity("m", within=FARTHEST, nonzero=True)
ProfileAngle, HelixAngle = quantity("rad", least=0.0, below=0.5 * math.pi), quantity("rad", below=0.5 * math.pi)
LoadRating, ServiceSpeed = quantity("N", above=0.0), quantity("rad/s", above=0.0)
Stiffness, Damping = quantity("N/m", least=0.0), quantity("N*s/m", least=0.0)
MotorSpeed, MotorTorque = quantity("rad/s", least=0.0), quantity("N*m", least=0.0)
Current = quantity("A", above=0.0)
Resistance, Inductance, TorqueConstant = (
    quantity("ohm", above=0.0),
    quantity("H", least=0.0),
    quantity("N*m/A", nonzero=True),
)
RotationStiffness = quantity("N*m/rad", least=0.0)
RotationDamping = quantity("N*m*s/rad", least=0.0)
GAINS = "20 N*m{0}/rad or 1500 N{0}/m; 1500 V{0}/m where the drive takes a voltage"
Gain, IntegralGain, RateGain = (
    quantity(examples=GAINS.format("")),
    quantity(examples=GAINS.format("/s")),
    quantity(examples=GAINS.format("*s")),
)


class Frequency(Measured):
    """Cycles over time, in Hz: in rad/s or rpm it would be a pulsation."""

    expected, examples = HERTZ, "2 Hz"


class Readable:
    """A type that files may give in several forms, which it reads from plain data by itself."""

    __slots__ = ()

    @classmethod
    def read(cls, value: object) -> Self:
        """Return the object that plain data say."""
        raise NotImplementedError

    @classmethod
    def schema(cls) -> dict[str, object]:
        """Return the JSON Schema of its forms."""
        raise NotImplementedError

    def plain(self) -> object:
        """Return it as data that msgspec knows, or has ``enc_hook`` for."""
        raise NotImplementedError


class PureNumber(Measured):
    """A number without unit, such as an efficiency: ``0.4``, ``0.4 1`` or ``40 %``."""

    expected = DIMENSIONLESS

    @classmethod
    def read(cls, value: object, *, bare: bool = True) -> Self:
        """Read a number with or without the unit ``1``."""
        number = super().read(value)
        if number.unit is not None and number.unit.text not in PURE:
            raise UnitError(f"'{number.unit}' is a unit, and this number has none", expected="such as 0.4, or 40 %")
        return number


PURE = ("1", "%")
"""Units of numbers without one: those of angles have no dimension either."""


def number(**bounds: float) -> Any:
    """Return the annotation of a number without unit: a subclass of ``PureNumber``.

    Args:
        bounds: ``least``, ``above`` or ``within``; see ``Measured``.
    """
    return type("Number", (PureNumber,), bounds)


_FRACTION = rf"({DECIMAL})\s*/\s*({DECIMAL})"


class _Fraction(PureNumber):
    """A number other than 0, without unit, which may be a fraction of two, such as ``17/43`` of teeth."""

    nonzero = True

    @classmethod
    def read(cls, value: object, *, bare: bool = True) -> Self:
        """Read ``0.5``, or ``"17/43"``."""
        fraction = re.fullmatch(_FRACTION, value.strip()) if isinstance(value, str) else None
        if fraction and not float(fraction[2]):
            raise InputError(f"'{fraction[0][:40]}' divides by 0", expected="a fraction such as 17/43")
        try:
            return super().read(float(fraction[1]) / float(fraction[2]) if fraction else value)
        except UnitError:
            raise InputError(
                f"'{str(value)[:40]}' is no ratio", expected="a number, or a fraction of two such as 17/43"
            ) from None


Ratio: Any = _Fraction
Efficiency, Restitution = number(above=0.0, within=1.0), number(least=0.0, within=1.0)
Coefficient, Weight = number(least=0.0), number(nonzero=True)


class InputStruct(msgspec.Struct, frozen=True, forbid_unknown_fields=True, repr_omit_defaults=True):
    """An immutable part of an input file; unknown keys are errors.

    Attributes:
        deferred: Keys whose types are imported when a file has them; see ``with_types``.
        unoffered: Values that files may have and messages do not suggest, such as removed methods.
    """

    deferred: ClassVar[Deferred] = {}
    unoffered: ClassVar[Collection[str]] = ()

    def __post_init__(self) -> None:
        """Validate values given in Python against the annotations, as those from files are; then run ``check``."""
        if current_folder() is None:
            for field in _fields(with_types(type(self), self.deferred)):
                raw = getattr(self, field.name)
                if isinstance(raw, list | dict) and not raw and field.default_factory is not msgspec.NODEFAULT:
                    continue  # it is left out, which a list that must name something may be
                value = validated(raw, field)
                if value is not raw:
                    msgspec.structs.force_setattr(self, field.name, value)
        self.check()

    def check(self) -> None:
        """Check what annotations cannot express; raise an InputError."""


def with_types(struct: type[StructT], keys: Iterable[str]) -> type[StructT]:
    """Return a struct with the types of those of its ``deferred`` fields that are among the keys of a file."""
    deferred: Deferred = getattr(struct, "deferred", {})
    wanted = deferred.keys() & keys if deferred else ()
    return _with_types(struct, frozenset(wanted)) if wanted else struct


@cache
def _with_types(struct: type[Any], wanted: frozenset[str]) -> type[Any]:
    fields = []
    for field in msgspec.structs.fields(struct):
        if field.encode_name in wanted:
            module, name = struct.deferred[field.encode_name]
            kind = _filled(field.type, getattr(import_module(module), name))
            default: Any = {"default": field.default, "default_factory": field.default_factory}
            fields.append((field.name, kind, msgspec.field(name=field.encode_name, **default)))

    def reduced(self: msgspec.Struct) -> tuple[Any, ...]:
        return _made_again, (struct, wanted, {name: getattr(self, name) for name in self.__struct_fields__})

    namespace = {"__doc__": struct.__doc__, "__reduce__": reduced}
    return msgspec.defstruct(
        struct.__name__, fields, bases=(struct,), module=struct.__module__, namespace=namespace, frozen=True,
        kw_only=True,
    )  # fmt: skip


def _made_again(struct: type[StructT], wanted: frozenset[str], values: dict[str, Any]) -> StructT:
    """Make a struct in another process, which cannot look up its class by name."""
    return with_types(struct, wanted)(**values)


def _filled(annotation: Any, kind: Any) -> Any:
    """Return an annotation with a type in place of ``Any``."""
    if annotation is Any:
        return kind
    origin, inside = get_origin(annotation), tuple(_filled(argument, kind) for argument in get_args(annotation))
    if not inside:
        return annotation
    return Union[inside] if origin in (Union, UnionType) else origin[inside]  # noqa: UP007


def validated(value: object, field: msgspec.structs.FieldInfo) -> object:
    """Return a value converted to the type of its field."""
    plain = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    try:
        return msgspec.convert(plain, field.type, dec_hook=convert)
    except msgspec.ValidationError as error:
        cause = error.__cause__
        if isinstance(cause, PinarmError):
            message = f"{field.encode_name}: {cause.message}"
            raise type(cause)(message, expected=cause.expected, hint=cause.hint, location=cause.location) from None
        raise InputError(f"{field.encode_name}: {error}".replace("`", "")) from None


def convert(kind: type, value: object) -> object:
    """Convert plain data into types that msgspec does not know; its ``dec_hook``."""
    if issubclass(kind, Measured):
        return kind.read(value, bare=current_folder() is None)
    if issubclass(kind, Readable):
        return kind.read(value)
    raise NotImplementedError(kind)


@cache
def _fields(struct: type[InputStruct]) -> tuple[msgspec.structs.FieldInfo, ...]:
    return msgspec.structs.fields(struct)


def plain(value: Measured | Readable) -> object:
    """Return as plain data what msgspec does not know; its ``enc_hook``."""
    return value.plain() if isinstance(value, Readable) else float(value)


def without_formulas(data: Any, read: object) -> Any:
    """Return plain data of a file with quantities in place of the formulas of parameters."""
    if isinstance(read, Measured) and read.computed:
        return f"{float(read)!r} {read.unit}" if read.unit else float(read)
    if isinstance(data, dict) and isinstance(read, msgspec.Struct):
        parts = {field.encode_name: getattr(read, field.name) for field in msgspec.structs.fields(read)}
        return {key: without_formulas(value, parts.get(key)) for key, value in data.items()}
    if isinstance(data, dict) and isinstance(read, Mapping):
        return {key: without_formulas(value, read.get(key)) for key, value in data.items()}
    if isinstance(data, list) and isinstance(read, list | tuple):
        return [without_formulas(*pair) for pair in zip(data, read, strict=True)]
    return data


def check_unit(value: float, expected: Unit) -> None:
    """Check the unit of a value; plain numbers have none and pass."""
    if isinstance(value, Measured):
        value.check(expected)


def check_each(values: Sequence[float], *expected: Unit) -> None:
    """Check the units of the values of a list, each against its own."""
    for index, (value, wanted) in enumerate(zip(values, expected, strict=True)):
        with within(index):
            check_unit(value, wanted)


def check_keys(keys: InputStruct, **expected: Unit) -> None:
    """Check the units of keys, by their names; one that is left out has none."""
    for name, wanted in expected.items():
        with within(name):
            check_unit(getattr(keys, name) or 0.0, wanted)


@cache
def measured_fields(struct: type[InputStruct]) -> dict[str, type[Measured]]:
    """Return the fields of a struct that are one quantity each, with their types."""
    fields = {}
    for field in _fields(struct):
        for kind in _members(field.type):
            if isinstance(kind, type) and issubclass(kind, Measured):
                fields[field.name] = kind
    return fields


def _members(annotation: Any) -> tuple[Any, ...]:
    return get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)


def json_schema(kind: type) -> dict[str, object]:
    """Return the JSON Schema of a type that msgspec does not know.

    Of a quantity: a number, a text with a unit, and what else may stand for it.
    """
    if issubclass(kind, Readable):
        return kind.schema()
    if not issubclass(kind, Measured):
        raise NotImplementedError(kind)
    description = f"a quantity in {kind.expected}" if kind.expected else "a number with its unit"
    example = {"examples": [f"1 {kind.expected}"]} if kind.expected else {}
    if issubclass(kind, PureNumber):
        description, example = "a number without unit", {}
    return {"anyOf": [dict(form) for form in kind.forms], "description": description, **example}


def in_si(text: str | float | None, measured: Unit | None) -> float:
    """Return a written value in SI.

    Args:
        text: The value with its unit; 0 goes without.
        measured: Unit of its dimension; ``None`` where that is unknown.
    """
    number, written = read_quantity(str(text))
    value = Measured(number)
    value.unit = written
    if measured is not None:
        turned = measured.text == "rad"  # 60 would be 60 rad
        if written is None and number and (turned or measured.dimension != DIMENSIONLESS.dimension):
            raise InputError(f"'{text}' has no unit", expected=f"a value such as {text} {measured}")
        value.check(measured)
    return number
