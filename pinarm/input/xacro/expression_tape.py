"""An expansion recorded as a straight-line program over its numeric arguments, to be run again for other numbers.

While a model is recorded, an argument is a register of a tape instead of a number, and arithmetic with it adds a step.
In text a register is a mark of control characters, which no XML file can contain. Every decision by a number (a branch,
a comparison, whether a text is a number) is stored as a guard: for other numbers the program is valid only where all
guards have the same outcome. What cannot be recorded raises an error, and the model is expanded without a tape.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import repeat
from typing import Any, TypeGuard

import numpy as np
from msgspec import Struct, field

from pinarm.arrays import Array, Flags
from pinarm.errors import ModelError
from pinarm.input.xacro.arithmetic import Scalars, evaluate
from pinarm.records import Record, ValueRecord

OPEN, CLOSE = "\x01", "\x02"
_MARK = re.compile(f"{OPEN}([0-9]+){CLOSE}")
_NAMED = re.compile("__register_([0-9]+)__")
"""Name of a mark within an expression; xacro refuses properties with such names."""

UNRECORDABLE = "what the model is depends on a number in a way that is not followed"

Number = int | float
Literal = Callable[[Any], Any]


AnyColumn = Array
"""Values in the rows of a table: floats, truth values, or objects where some are others."""


def column(values: Iterable[Any]) -> AnyColumn:
    """Return values in the rows of a table."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return values
    rows = list(values)
    if {*map(type, rows)} == {float}:
        return np.array(rows)
    column = np.empty(len(rows), dtype=object)
    column[:] = rows
    return column


def is_column(value: Any) -> TypeGuard[AnyColumn]:
    """Return whether a value is a column."""
    return isinstance(value, np.ndarray)


def holds_floats(value: Any) -> bool:
    """Return whether a value is a column of floats."""
    return is_column(value) and value.dtype == np.float64


class Traced(Record, frozen=True):
    """A value computed from the arguments.

    Attributes:
        tape: The tape that computes it.
        register: Its register.
    """

    tape: Tape
    register: int

    @property
    def value(self) -> Any:
        """Its value for the arguments of the recording."""
        return self.tape.values[self.register]

    def __str__(self) -> str:
        return f"{OPEN}{self.register}{CLOSE}"

    def __bool__(self) -> bool:
        outcome = bool(self.value)
        self.tape.guards.append((self.register, outcome))
        return outcome


class Tape(Struct):
    """A straight-line program: registers hold the arguments, then the result of each step.

    Attributes:
        values: The registers, for the arguments of the recording.
        steps: Functions and the registers that they take.
        guards: Registers and their truth values for which the program holds.
    """

    values: list[Any]
    steps: list[tuple[Callable[..., Any], tuple[int, ...]]] = field(default_factory=list)
    guards: list[tuple[int, bool]] = field(default_factory=list)

    def record(self, function: Callable[..., Any], *operands: Any) -> Any:
        """Apply a function of plain values, and record that where an operand follows from the arguments.

        Returns:
            A value, a place on the tape, or, where that holds a text, its mark.
        """
        places = [self.lifted(operand) for operand in operands]
        if not any(isinstance(place, Traced) for place in places):
            return function(*operands)
        value = function(*(place.value if isinstance(place, Traced) else place for place in places))
        return self._returned(self._step(function, tuple(map(self._register, places)), value))

    def lifted(self, operand: Any) -> Any:
        """Return a place on the tape for text with marks; any other value as it is."""
        if not isinstance(operand, str) or OPEN not in operand:
            return operand
        texts = _MARK.split(operand)
        registers = tuple(map(int, texts[1::2]))
        if texts[::2] == ["", ""] and isinstance(self.values[registers[0]], str):
            return Traced(self, registers[0])
        function = partial(joined, tuple(texts[::2]))
        return self._step(function, registers, function(*(self.values[register] for register in registers)))

    def _step(self, function: Callable[..., Any], registers: tuple[int, ...], value: Any) -> Traced:
        self.steps.append((function, registers))
        self.values.append(value)
        return Traced(self, len(self.values) - 1)

    def _register(self, place: Any) -> int:
        return place.register if isinstance(place, Traced) else self._step(partial(_same, place), (), place).register

    def _returned(self, traced: Traced) -> Any:
        return str(traced) if isinstance(traced.value, str) else traced

    def evaluate(self, text: str, names: Mapping[str, Any]) -> Any:
        """Evaluate an expression of xacro, in whose text marks may stand."""
        if _NAMED.search(text):
            raise ModelError(UNRECORDABLE)
        return evaluate(_MARK.sub(self._name_of, text), _Recorder(self, Scalars(names)))

    def _name_of(self, mark: re.Match[str]) -> str:
        """Return a name in place of the digits of a number without a sign, which would bind otherwise."""
        place = Traced(self, int(mark[1]))
        if isinstance(place.value, str | bool) or not self.record(_is_unsigned, place):
            raise ModelError(UNRECORDABLE)
        return f"__register_{mark[1]}__"

    def literal(self, plain: Literal, value: Any) -> Any:
        """Turn text into the number that it is, as xacro does with properties."""
        if not isinstance(value, str) or OPEN not in value:
            return plain(value)
        texts = _MARK.split(value)
        alone = texts[::2] == ["", ""]
        number = self.record(_Read(plain), Traced(self, int(texts[1]))) if alone else self.record(plain, value)
        bool(self.record(_IsText(), number))
        return number

    def run(self, numbers: Sequence[Number | AnyColumn]) -> tuple[list[Any], Flags]:
        """Return all registers for other numbers, and for which rows of them the program holds.

        A register that follows from a column is a column: its step is taken number by number, with the same functions.

        Args:
            numbers: The arguments: columns of one length, or numbers that are the same in all rows.

        Raises:
            ExpressionError: A step is not possible in some row.
        """
        values: list[Any] = list(numbers)
        columns = [value for value in numbers if is_column(value)]
        count = len(columns[0]) if columns else 1
        for function, registers in self.steps:
            operands = [values[register] for register in registers]
            if not (columns and any(map(is_column, operands))):
                values.append(function(*operands))
            elif (whole := getattr(function, "of_columns", _unsure)(*operands)) is not None:
                values.append(whole)
            else:
                spread = (operand.tolist() if is_column(operand) else repeat(operand, count) for operand in operands)
                values.append(column(map(function, *spread)))
        holds = np.ones(count, dtype=bool)
        for register, outcome in self.guards:
            value = values[register]
            holds &= (value.astype(bool) if is_column(value) else bool(value)) == outcome
        return values, holds


def _unsure(*operands: Any) -> None:
    """Return no column: of other functions every number is computed by itself."""


class _Binary(ValueRecord, frozen=True):
    """An arithmetic operator between two values."""

    plain: Scalars
    symbol: str

    def __call__(self, left: Any, right: Any) -> Any:
        return self.plain.binary(self.symbol, left, right)

    def of_columns(self, left: Any, right: Any) -> Array | None:
        """Return a column that is computed as an array, bit by bit the same; ``None`` where that is not sure.

        The four operations of IEEE 754 are the same everywhere. Of others, of integers, which have no bounds in Python,
        and of a division by 0, which is an error, every number is computed by itself.
        """
        if self.symbol not in _EXACT or not (_are_floats(left) and _are_floats(right)):
            return None
        first, second = np.asarray(left, dtype=np.float64), np.asarray(right, dtype=np.float64)
        if self.symbol == "/" and not second.all():
            return None
        with np.errstate(all="ignore"):  # what overflows is infinite in Python, too
            return np.asarray(_EXACT[self.symbol](first, second))


class _Read(ValueRecord, frozen=True):
    """Reader of a text that is one value and nothing else."""

    plain: Literal

    def __call__(self, value: Any) -> Any:
        return self.plain(str(value))

    def of_columns(self, values: AnyColumn) -> Array | None:
        """Return the same column where it holds floats, which Python writes so that they are read as themselves."""
        return values if holds_floats(values) else None


_EXACT = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}


def _are_floats(values: Any) -> bool:
    """Return whether a value is a column of floats, or a number: beside floats Python takes integers as floats."""
    return holds_floats(values) or type(values) in (float, int)


class _Recorder(ValueRecord, frozen=True):
    """The algebra of xacro, recorded."""

    tape: Tape
    plain: Scalars

    def constant(self, value: Any) -> Any:
        if isinstance(value, str) and (OPEN in value or "__register_" in value):
            raise ModelError(UNRECORDABLE)
        return value

    def name(self, name: str) -> Any:
        if register := _NAMED.fullmatch(name):
            return Traced(self.tape, int(register[1]))
        value = self.plain.names.get(name)
        return value if isinstance(value, Traced) else self.plain.name(name)

    def unary(self, symbol: str, operand: Any) -> Any:
        return self.tape.record(partial(self.plain.unary, symbol), operand)

    def binary(self, symbol: str, left: Any, right: Any) -> Any:
        return self.tape.record(_Binary(self.plain, symbol), left, right)

    def compare(self, symbols: Sequence[str], operands: Sequence[Any]) -> Any:
        return self.tape.record(lambda *values: self.plain.compare(symbols, values), *operands)

    def logic(self, symbol: str, operands: Sequence[Callable[[], Any]]) -> Any:
        result = operands[0]()
        for operand in operands[1:]:
            if bool(self.tape.lifted(result)) == (symbol == "or"):
                break
            result = operand()
        return result

    def choose(self, test: Any, then: Callable[[], Any], otherwise: Callable[[], Any]) -> Any:
        return then() if self.tape.lifted(test) else otherwise()

    def call(self, function: str, arguments: Sequence[Any]) -> Any:
        return self.tape.record(lambda *values: self.plain.call(function, values), *arguments)


def joined(texts: Sequence[str], *values: Any) -> str:
    """Return texts with a value between each and the next."""
    parts = [texts[0]]
    for value, text in zip(values, texts[1:], strict=True):
        parts += (str(value), text)
    return "".join(parts)


def marks(text: str) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return the texts between the marks of a text, and the registers of the marks."""
    texts = _MARK.split(text)
    return tuple(texts[::2]), tuple(map(int, texts[1::2]))


def _same(value: Any) -> Any:
    return value


def _is_unsigned(value: Number) -> bool:
    return not str(value).startswith("-")


class _IsText(ValueRecord, frozen=True):
    """Whether a value is a text."""

    def __call__(self, value: Any) -> bool:
        return isinstance(value, str)

    def of_columns(self, values: AnyColumn) -> Flags | None:
        """Return that floats are none."""
        return np.zeros(len(values), dtype=bool) if holds_floats(values) else None
