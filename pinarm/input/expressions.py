"""Formulas: arithmetic over named quantities, for values and for units.

The language is a small part of Python's: numbers, names with dots, ``+ - * / // % **``, comparisons, ``and or not``,
``a if test else b``, and a fixed table of functions. Python parses the text, but nothing is ever compiled or run: the
tree is checked node by node when it is read, and an ``Algebra`` says afterwards what the nodes mean.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache, partial, reduce
from typing import Any, Protocol, TypeVar

import numpy as np

from pinarm.errors import ExpressionError, Location, PinarmError, UnitError, choices
from pinarm.input.units import DIMENSIONLESS, Unit

MAX_LENGTH = 2000
MAX_DEPTH = 200
"""A sum of n terms is n levels deep; two Python frames a level stay well below the interpreter's 1000."""
MAX_NODES = 1000
MAX_INTEGER = 2**64
MANY = 1000
"""Most arguments of a function that takes any number of them."""

CONSTANTS: Mapping[str, float] = {"pi": math.pi, "deg": math.pi / 180}
"""Names that every formula knows; a name that is given to it wins."""

T = TypeVar("T")
Measures = Sequence["_Measure"]

_SYMBOLS: Mapping[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%", ast.Pow: "**",
    ast.UAdd: "+", ast.USub: "-", ast.Not: "not", ast.And: "and", ast.Or: "or",
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
}  # fmt: skip


class Algebra(Protocol[T]):
    """What numbers, names and operations mean. Operations are named by their symbols."""

    def constant(self, value: Any, /) -> T:
        """Return what a literal means."""
        ...

    def name(self, name: str, /) -> T:
        """Return what a name means."""
        ...

    def unary(self, symbol: str, operand: T, /) -> T:
        """Apply ``+``, ``-`` or ``not``."""
        ...

    def binary(self, symbol: str, left: T, right: T, /) -> T:
        """Apply an arithmetic operator."""
        ...

    def compare(self, symbols: Sequence[str], operands: Sequence[T], /) -> T:
        """Compare neighbours, as in ``0 < x <= 1``."""
        ...

    def logic(self, symbol: str, operands: Sequence[Callable[[], T]], /) -> T:
        """Apply ``and`` or ``or`` to operands that need not all be interpreted."""
        ...

    def choose(self, test: T, then: Callable[[], T], otherwise: Callable[[], T], /) -> T:
        """Return one of two; the other need not be interpreted."""
        ...

    def call(self, function: str, arguments: Sequence[T], /) -> T:
        """Apply a function."""
        ...


@dataclass(frozen=True, eq=False)
class Grammar:
    """What a language allows beyond operators.

    Attributes:
        literals: Types of its literals.
        arities: Functions -> least and greatest number of arguments.
    """

    literals: tuple[type, ...]
    arities: Mapping[str, tuple[int, int]]


@dataclass(frozen=True)
class Expression:
    """A formula that has been read and found harmless.

    Attributes:
        text: As it was written.
        tree: Its syntax tree.
        names: The names in it, constants such as ``pi`` included because a name that is given wins over them.
    """

    text: str
    tree: ast.expr = field(repr=False, compare=False)
    names: frozenset[str] = field(repr=False, compare=False)

    @classmethod
    def parse(cls, text: str) -> Expression:
        """Read a formula.

        Raises:
            ExpressionError: The text is no formula, or one that is too long.
        """
        tree = read_tree(text, FORMULA)
        return cls(text.strip(), tree, frozenset(_names(tree)))

    def evaluate(self, names: Mapping[str, Any]) -> Any:
        """Return the value: a float or bool where all the names are numbers, else an array.

        Args:
            names: Numbers and arrays whose shapes broadcast.

        Raises:
            ExpressionError: A name is unknown, the shapes do not fit, or a number is divided by zero, overflows or is
                otherwise not finite. Arrays take ``inf`` and ``nan`` instead.
        """
        with np.errstate(all="ignore"):
            result = interpret(self.tree, _Values(names), self.text)
        return result.item() if np.ndim(result) == 0 else result

    def dimension(self, names: Mapping[str, Unit | None]) -> Unit | None:
        """Return the SI unit of the value; ``None`` where it cannot be known.

        Args:
            names: Units of the names; ``None`` is unknown and fits everything, as a literal 0 does.

        Raises:
            UnitError: Quantities of different dimensions are added or compared, or one goes into a function of numbers.
            ExpressionError: A name is unknown.
        """
        measure = interpret(self.tree, _Units(names), self.text)
        return None if measure.value == 0 else measure.unit


def interpret(tree: ast.expr, algebra: Algebra[T], text: str) -> T:
    """Return what a tree means in an algebra; errors name the column and the part of ``text``."""
    try:
        return _walk(tree, algebra)
    except PinarmError as error:
        raise _in_words(error, text.strip()) from None


def _walk(node: ast.expr, algebra: Algebra[T]) -> T:
    try:
        return _meaning(node, algebra)
    except PinarmError as error:
        error.at(_place(node))
        raise


def _meaning(node: ast.expr, algebra: Algebra[T]) -> T:
    match node:
        case ast.Constant():
            return algebra.constant(node.value)
        case ast.Name() | ast.Attribute():
            return algebra.name(_dotted(node))
        case ast.UnaryOp():
            return algebra.unary(_SYMBOLS[type(node.op)], _walk(node.operand, algebra))
        case ast.BinOp():
            return algebra.binary(_SYMBOLS[type(node.op)], _walk(node.left, algebra), _walk(node.right, algebra))
        case ast.Compare():
            operands = [_walk(operand, algebra) for operand in (node.left, *node.comparators)]
            return algebra.compare([_SYMBOLS[type(operation)] for operation in node.ops], operands)
        case ast.BoolOp():
            return algebra.logic(_SYMBOLS[type(node.op)], [partial(_walk, value, algebra) for value in node.values])
        case ast.IfExp():
            then, otherwise = partial(_walk, node.body, algebra), partial(_walk, node.orelse, algebra)
            return algebra.choose(_walk(node.test, algebra), then, otherwise)
        case ast.Call():
            return algebra.call(_dotted(node.func), [_walk(argument, algebra) for argument in node.args])
    raise ExpressionError("this is not arithmetic")


@lru_cache(maxsize=4096)
def read_tree(text: str, grammar: Grammar) -> ast.expr:
    """Parse a text and check every node of it.

    Raises:
        ExpressionError: With the column and a hint.
    """
    text = text.translate(_BLANKS).strip()
    if not text:
        raise ExpressionError("the formula is empty")
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the formula is too long: {len(text)} characters", expected=f"at most {MAX_LENGTH}")
    try:
        tree = ast.parse(text, mode="eval").body
    except SyntaxError as error:
        place = Location("", 1, max(error.offset or 1, 1), width=1)
        problem = ExpressionError(f"this is no formula: {error.msg}", expected=_LANGUAGE, hint=_syntax_hint(text))
        raise _in_words(problem.at(place), text) from None
    except (ValueError, RecursionError, MemoryError, OverflowError) as error:
        raise ExpressionError(f"this is no formula: {error or 'it is nested too deeply'}", expected=_LANGUAGE) from None
    _check(tree, grammar, text)
    return tree


_BLANKS = {ord("\n"): " ", ord("\r"): " ", ord("\t"): " "}
_LANGUAGE = "numbers, names, + - * / // % **, comparisons, and, or, not, 'a if test else b', functions"


def _syntax_hint(text: str) -> str:
    if "=" in text.translate({ord(c): None for c in "<>!"}).replace("==", ""):
        return "== to compare"
    return "* between factors, and a word in plain letters for each name"


def _check(tree: ast.expr, grammar: Grammar, text: str) -> None:
    """Refuse what the grammar does not list, without recursion."""
    pending, count = [(tree, 1)], 0
    while pending:
        node, depth = pending.pop()
        count += 1
        try:
            if depth > MAX_DEPTH or count > MAX_NODES:
                raise ExpressionError("the formula is nested too deeply or has too many parts", hint="smaller formulas")
            pending += [(part, depth + 1) for part in _parts(node, grammar)]
        except ExpressionError as error:
            raise _in_words(error.at(_place(node)), text) from None


def _parts(node: ast.expr, grammar: Grammar) -> list[ast.expr]:
    """Return what a node is made of; a node that is not allowed is an error."""
    match node:
        case ast.Constant():
            _check_literal(node.value, grammar)
            return []
        case ast.Name() | ast.Attribute():
            _dotted(node)
            return []
        case ast.UnaryOp() if type(node.op) in _SYMBOLS:
            return [node.operand]
        case ast.BinOp() if type(node.op) in _SYMBOLS:
            return [node.left, node.right]
        case ast.Compare() if all(type(operation) in _SYMBOLS for operation in node.ops):
            return [node.left, *node.comparators]
        case ast.BoolOp():
            return node.values
        case ast.IfExp():
            return [node.test, node.body, node.orelse]
        case ast.Call(keywords=[]):
            _check_call(_dotted(node.func), len(node.args), grammar)
            return node.args
    power = isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitXor)
    raise ExpressionError("this is not arithmetic", expected=_LANGUAGE, hint="** for powers" if power else "")


def _check_literal(value: Any, grammar: Grammar) -> None:
    if type(value) not in grammar.literals:
        raise ExpressionError(f"a {type(value).__name__} has no place in a formula", expected="numbers and names")
    if isinstance(value, int | float) and not abs(value) < (MAX_INTEGER if isinstance(value, int) else math.inf):
        raise ExpressionError("this number is too large", expected="integers below 2**64, others below 1e308")


def _check_call(function: str, count: int, grammar: Grammar) -> None:
    if function not in grammar.arities:
        expected, hint = choices(function, grammar.arities, most=40)
        raise ExpressionError(f"there is no function '{function}'", expected=expected, hint=hint)
    least, most = grammar.arities[function]
    if not least <= count <= most:
        wanted = str(least) if least == most else f"{least} to {most}" if most < MANY else f"{least} or more"
        raise ExpressionError(f"'{function}' is given {count} arguments", expected=f"{wanted} of them")


def _dotted(node: ast.expr) -> str:
    """Flatten ``joint.knee.effort``; the dots are part of the name, nothing is looked up on the way."""
    words: list[str] = []
    while isinstance(node, ast.Attribute):
        words.append(node.attr)
        node = node.value
    if not isinstance(node, ast.Name):
        raise ExpressionError("a dot belongs between the words of a name", expected="a name such as joint.knee.effort")
    return ".".join([node.id, *reversed(words)])


def _names(tree: ast.expr) -> Iterable[str]:
    pending = [tree]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Name | ast.Attribute):
            yield _dotted(node)
        else:
            pending += _parts(node, FORMULA)


def _place(node: ast.expr) -> Location:
    """Return the place of a node within its formula, in bytes; no source, so that ``_in_words`` knows it."""
    end = node.end_col_offset or node.col_offset + 1
    return Location("", 1, node.col_offset + 1, width=end - node.col_offset)


def _in_words(error: PinarmError, text: str) -> PinarmError:
    """Move the place within the formula into the message: the location is for the file, which the caller knows."""
    place = error.location
    if place is None or place.source:
        return error
    raw = text.encode()
    column = len(raw[: place.column - 1].decode(errors="ignore")) + 1
    part = raw[place.column - 1 : place.column - 1 + place.width].decode(errors="ignore")
    whole = f"column {column} of '{_short(text)}'"
    error.message += f": '{_short(part)}'" + (f" at {whole}" if part != text else "") if part.strip() else f" ({whole})"
    error.location = None
    return error


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:77]}..."


def look_up(name: str, *tables: Mapping[str, Any]) -> Any:
    """Return the value of a name in the first table that has it.

    Raises:
        ExpressionError: None has; lists the names there are.
    """
    for table in tables:
        if name in table:
            return table[name]
    expected, hint = choices(name, [known for table in tables for known in table], most=40)
    raise ExpressionError(f"unknown name '{_short(name)}'", expected=expected, hint=hint)


@dataclass(frozen=True)
class _Values:
    """The algebra of numbers and arrays, elementwise, in double precision."""

    names: Mapping[str, Any]

    def constant(self, value: Any) -> Any:
        return np.float64(value)

    def name(self, name: str) -> Any:
        value = np.asarray(look_up(name, self.names, CONSTANTS))
        if value.dtype.kind not in "biuf":
            raise ExpressionError(f"'{name}' is not a number")
        return value[()] if value.dtype.kind in "bf" else value.astype(float)[()]

    def unary(self, symbol: str, operand: Any) -> Any:
        return _applied({"+": np.positive, "-": np.negative, "not": np.logical_not}[symbol], operand)

    def binary(self, symbol: str, left: Any, right: Any) -> Any:
        return _applied(_OPERATIONS[symbol], left, right)

    def compare(self, symbols: Sequence[str], operands: Sequence[Any]) -> Any:
        pairs = zip(symbols, operands, operands[1:], strict=False)
        return reduce(np.logical_and, [_applied(_OPERATIONS[symbol], left, right) for symbol, left, right in pairs])

    def logic(self, symbol: str, operands: Sequence[Callable[[], Any]]) -> Any:
        result = operands[0]()
        for operand in operands[1:]:
            if np.ndim(result) == 0 and bool(result) == (symbol == "or"):
                break
            result = _applied(np.logical_and if symbol == "and" else np.logical_or, result, operand())
        return np.asarray(result, dtype=bool)[()]

    def choose(self, test: Any, then: Callable[[], Any], otherwise: Callable[[], Any]) -> Any:
        if np.ndim(test) == 0:
            return then() if test else otherwise()
        return _applied(np.where, test, then(), otherwise())

    def call(self, function: str, arguments: Sequence[Any]) -> Any:
        return _applied(_FUNCTIONS[function].apply, *arguments)


def _applied(function: Callable[..., Any], *operands: Any) -> Any:
    try:
        result = function(*operands)
    except (TypeError, ValueError) as error:
        raise ExpressionError(f"these cannot be combined ({error})") from None
    if np.ndim(result) == 0 and not np.isfinite(result) and all(np.isfinite(operand) for operand in operands):
        raise ExpressionError("the value is not finite: a division by zero, an overflow, or outside the domain")
    return result


@dataclass(frozen=True)
class _Measure:
    """What dimensional analysis knows of a value.

    Attributes:
        unit: SI unit; ``None`` where unknown.
        value: The number itself where only literals made it: exponents need it, and 0 fits every dimension.
    """

    unit: Unit | None
    value: Fraction | None = None


_PURE = _Measure(DIMENSIONLESS)
_UNKNOWN = _Measure(None)


@dataclass(frozen=True)
class _Units:
    """The algebra of units."""

    names: Mapping[str, Unit | None]

    def constant(self, value: Any) -> _Measure:
        return _Measure(DIMENSIONLESS, Fraction(repr(value)))

    def name(self, name: str) -> _Measure:
        unit = look_up(name, self.names, dict.fromkeys(CONSTANTS, DIMENSIONLESS))
        return _Measure(None if unit is None else Unit(1.0, unit.dimension))

    def unary(self, symbol: str, operand: _Measure) -> _Measure:
        if symbol == "-" and operand.value is not None:
            return _Measure(operand.unit, -operand.value)
        return _PURE if symbol == "not" else operand

    def binary(self, symbol: str, left: _Measure, right: _Measure) -> _Measure:
        if left.value is not None and right.value is not None and (folded := _folded(symbol, left.value, right.value)):
            return _Measure(DIMENSIONLESS, folded[0])
        if symbol in "+-%":
            return _same([left, right])
        if symbol == "//":
            return _ratio([left, right])
        if symbol == "**":
            return _power(left, right)
        if left.unit is None or right.unit is None:
            return _UNKNOWN
        return _Measure(left.unit * right.unit if symbol == "*" else left.unit / right.unit)

    def compare(self, symbols: Sequence[str], operands: Measures) -> _Measure:
        return _ratio(operands)

    def logic(self, symbol: str, operands: Sequence[Callable[[], _Measure]]) -> _Measure:
        for operand in operands:
            operand()
        return _PURE

    def choose(self, test: _Measure, then: Callable[[], _Measure], otherwise: Callable[[], _Measure]) -> _Measure:
        return _same([then(), otherwise()])

    def call(self, function: str, arguments: Measures) -> _Measure:
        return _FUNCTIONS[function].rule(arguments)


def _folded(symbol: str, left: Fraction, right: Fraction) -> tuple[Fraction] | None:
    """Return the value of an operation on literals in a tuple, for 0 is a value too."""
    if symbol == "/" and right != 0:
        return (left / right,)
    folds = {"+": left + right, "-": left - right, "*": left * right}
    return (folds[symbol],) if symbol in folds else None


def _same(measures: Measures) -> _Measure:
    """Return the measure that all share: of sums, minima, ..."""
    known = [measure.unit for measure in measures if measure.unit is not None and measure.value != 0]
    for unit in known[1:]:
        if unit.dimension != known[0].dimension:
            raise UnitError(f"[{known[0]}] and [{unit}] do not go together", expected="quantities of one dimension")
    unknown = any(measure.unit is None for measure in measures)
    return _Measure(known[0]) if known else _UNKNOWN if unknown else _Measure(DIMENSIONLESS, Fraction(0))


def _ratio(measures: Measures) -> _Measure:
    _same(measures)
    return _PURE


def _pure(measures: Measures) -> _Measure:
    for measure in measures:
        if measure.unit is not None and measure.value != 0 and measure.unit.dimension != DIMENSIONLESS.dimension:
            raise UnitError(
                f"a quantity in [{measure.unit}] where a number is wanted", hint="a ratio of two quantities"
            )
    return _PURE


def _power(base: _Measure, exponent: _Measure) -> _Measure:
    _pure([exponent])
    if base.unit is None:
        return _UNKNOWN
    if exponent.value is not None:
        return _Measure(base.unit**exponent.value)
    if base.unit.dimension != DIMENSIONLESS.dimension:
        raise UnitError(f"the unit of [{base.unit}] to a power that varies is not determined", expected="x**2, x**0.5")
    return _PURE


def _root(measures: Measures) -> _Measure:
    return _power(measures[0], _Measure(DIMENSIONLESS, Fraction(1, 2)))


def _sign(measures: Measures) -> _Measure:
    return _PURE


@dataclass(frozen=True)
class _Function:
    """A function of formulas: how it is computed, the rule for its unit, the number of its arguments."""

    apply: Callable[..., Any]
    rule: Callable[[Measures], _Measure] = _pure
    least: int = 1
    most: int = 1


_OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "//": np.floor_divide, "%": np.mod,
    "**": np.power, "==": np.equal, "!=": np.not_equal, "<": np.less, "<=": np.less_equal, ">": np.greater,
    ">=": np.greater_equal,
}  # fmt: skip


def _least(*arguments: Any) -> Any:
    return reduce(np.minimum, arguments)


def _greatest(*arguments: Any) -> Any:
    return reduce(np.maximum, arguments)


_FUNCTIONS: Mapping[str, _Function] = {
    "sin": _Function(np.sin), "cos": _Function(np.cos), "tan": _Function(np.tan),
    "asin": _Function(np.arcsin), "acos": _Function(np.arccos), "atan": _Function(np.arctan),
    "atan2": _Function(np.arctan2, _ratio, 2, 2), "hypot": _Function(np.hypot, _same, 2, 2),
    "sinh": _Function(np.sinh), "cosh": _Function(np.cosh), "tanh": _Function(np.tanh),
    "sqrt": _Function(np.sqrt, _root), "exp": _Function(np.exp), "log": _Function(np.log), "log10": _Function(np.log10),
    "abs": _Function(np.abs, _same), "sign": _Function(np.sign, _sign),
    "min": _Function(_least, _same, 2, MANY), "max": _Function(_greatest, _same, 2, MANY),
    "floor": _Function(np.floor), "ceil": _Function(np.ceil),
    "radians": _Function(np.radians), "degrees": _Function(np.degrees),
}  # fmt: skip

FORMULA = Grammar((int, float), {name: (entry.least, entry.most) for name, entry in _FUNCTIONS.items()})
"""The language of scenario files."""
