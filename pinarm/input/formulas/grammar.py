"""The grammar of formulas: a checked subset of Python's expressions, evaluated by an ``Algebra``.

Numbers, names with dots, ``+ - * / // % **``, comparisons, ``and or not``, ``a if test else b``, and a fixed table of
functions; in the language of xacro also texts, lists and maps. Python parses the text, but nothing is compiled or run:
what the grammar lists becomes a tree of ``Part``, and an ``Algebra`` (of values, of units) gives each part its meaning.

A number with a unit, such as ``2e4 N/m``, stands where a term of a sum does: alone, between ``+``, ``-`` or
comparisons, as an argument of a function, or in parentheses, ``(2e4 N/m)*x``. Beside ``*``, ``/`` or ``**`` it has to
be in parentheses, so that nobody has to ask where the unit ends.
"""

from __future__ import annotations

import ast
import keyword
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any, Protocol, TypeVar

from pinarm.errors import ExpressionError, Location, PinarmError, UnitError, choices
from pinarm.input.units import Unit, read_quantity
from pinarm.records import Record, ValueRecord

MAX_LENGTH = 2000
MAX_DEPTH = 200
"""A sum of n terms is n levels deep; two Python frames a level stay well below the interpreter's 1000."""
MAX_INTEGER = 2**64
MANY = 1000
"""Largest number of arguments of a function that takes any number of them."""

CONSTANTS: Mapping[str, float] = {"pi": math.pi, "deg": math.pi / 180}
"""Names known in every formula; a name given to the formula takes precedence."""

T = TypeVar("T")

_NUMERAL = r"(?<![\w.])(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_UNIT_POWER = r"(?:(?:\^|\*\*)-?[0-9]{1,2})?"
_UNIT_NAME = r"[A-Za-z]+(?!\w|\.\w| *\()"
_WORD = re.compile(
    r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*\""""
    rf"|{_NUMERAL} +(?P<unit>{_UNIT_NAME}{_UNIT_POWER}(?: *[*/] *(?:{_UNIT_NAME}|1){_UNIT_POWER})*)"
    r"|(?P<name>(?<![\w.])[^\W\d]\w*(?:\.(?:[0-9]+(?!\w)|[^\W\d]\w*))*)"
)
"""A text in quotes, a number with a unit, or a name: words behind its first may be numbers, ``mode.1.frequency``."""

_OPERATOR_WORDS = ("if", "else", "and", "or", "not", "in", "is")
_NAMES = frozenset(keyword.kwlist) - {"and", "else", "if", "not", "or", "True", "False", "None"}
"""Python's keywords that are names in formulas."""
_KEYWORD = re.compile(rf"(?<!\w)(?:{'|'.join(keyword.kwlist)})(?!\w)")

_SYMBOLS: Mapping[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%", ast.Pow: "**",
    ast.UAdd: "+x", ast.USub: "-x", ast.Not: "not", ast.And: "and", ast.Or: "or",
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
    ast.In: "in", ast.NotIn: "not in",
}  # fmt: skip


class MeasuredNumber(ValueRecord, frozen=True):
    """A number with a unit, as a literal of a formula."""

    value: float
    unit: Unit
    text: str

    @property
    def words(self) -> frozenset[str]:
        """The names in its unit."""
        return frozenset(re.findall("[A-Za-z]+", str(self.unit)))


Words = dict[int, str | MeasuredNumber]
"""Column of a word in bytes -> name, or number with a unit."""


class Algebra(Protocol[T]):
    """Meaning of numbers, names, functions and operators; ``-x`` is the operator before one operand.

    Operands of ``and``, ``or`` and the branches of ``if`` are functions: they need not all be interpreted.
    """

    def constant(self, value: Any, /) -> T: ...
    def name(self, name: str, /) -> T: ...
    def logic(self, symbol: str, operands: Sequence[Callable[[], T]], /) -> T: ...
    def choose(self, test: T, then: Callable[[], T], otherwise: Callable[[], T], /) -> T: ...
    def call(self, function: str, arguments: Sequence[T], /) -> T: ...


class Grammar(Record, frozen=True):
    """Literals and functions of a language.

    Attributes:
        arities: Functions -> least and greatest number of arguments.
        collections: Whether it has lists and maps: ``[a, b]``, ``{a: b}``, ``dict(a=b)``, ``a[b]``, ``a in b``, and
            ``a.split(b)``. The algebra is asked for them as for functions: ``list``, ``dict`` (keys and values by
            turns), ``item``, ``split``.
    """

    literals: tuple[type, ...]
    arities: Mapping[str, tuple[int, int]]
    collections: bool = False


class Part(Record, frozen=True):
    """A part of a formula, with its place in the text.

    Attributes:
        function: Function or operator; ``constant`` or ``name`` of a part without operands, ``if`` of a choice.
        value: Constant, or name.
    """

    function: str
    value: Any
    operands: tuple[Part, ...]
    column: int
    width: int

    def leaves(self) -> Iterator[Part]:
        for operand in self.operands:
            yield from operand.leaves()
        if self.function in ("constant", "name"):
            yield self


def interpret(part: Part, algebra: Algebra[T], text: str) -> T:
    """Evaluate a part of a formula in an algebra; errors name the column and the part of ``text``."""
    try:
        return _meaning(part, algebra)
    except PinarmError as error:
        raise _in_words(error, text.strip()) from None


def _meaning(part: Part, algebra: Algebra[T]) -> T:
    try:
        match part.function:
            case "constant":
                return algebra.constant(part.value)
            case "name":
                return algebra.name(part.value)
            case "and" | "or":
                return algebra.logic(part.function, [partial(_meaning, operand, algebra) for operand in part.operands])
            case "if":
                test, *branches = part.operands
                return algebra.choose(_meaning(test, algebra), *(partial(_meaning, way, algebra) for way in branches))
        return algebra.call(part.function, [_meaning(operand, algebra) for operand in part.operands])
    except PinarmError as error:
        error.at(Location("", 1, part.column, width=part.width))  # unless a part of it has failed
        raise


@lru_cache(maxsize=4096)
def read_formula(text: str, grammar: Grammar) -> Part:
    """Parse a text, and check every part of it."""
    text = text.translate(_BLANKS).strip()
    if not text:
        raise ExpressionError("the formula is empty", expected="a number, a name, or a formula such as 2*(a + b)")
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the formula is too long: {len(text)} characters", expected=f"at most {MAX_LENGTH}")
    try:
        plain, words = _as_python(text, grammar)
        return _Reader(plain.encode(), words, grammar).part(_parsed(plain))
    except PinarmError as error:
        raise _in_words(error, text) from None
    except (ValueError, RecursionError, MemoryError, OverflowError) as error:
        raise ExpressionError(f"this is not a formula: {error or 'nested too deeply'}", expected=_LANGUAGE) from None


_BLANKS = {ord("\n"): " ", ord("\r"): " ", ord("\t"): " "}
_LANGUAGE = "numbers, names, + - * / // % **, comparisons, and, or, not, 'a if test else b', functions"


def _as_python(text: str, grammar: Grammar) -> tuple[str, Words]:
    """Return the text as Python can read it, and the words that have been replaced in it; columns stay.

    Numbers with units, names with dots, and names that are keywords of Python but not of formulas become names of as
    many letters.
    """
    words, plain = Words(), text
    for match in _WORD.finditer(text):
        known: str | MeasuredNumber = match[0]
        if match["unit"] and MeasuredNumber in grammar.literals and match["unit"] not in _OPERATOR_WORDS:
            known = _measured(match, text)
        elif not match["name"] or not ("." in match[0] or (match[0] in _NAMES and not grammar.collections)):
            continue
        words[len(plain[: match.start()].encode())] = known
        plain = f"{plain[: match.start()]}{'x' * len(match[0])}{plain[match.end() :]}"
    return plain, words


def _parsed(plain: str) -> ast.expr:
    try:
        return ast.parse(plain, mode="eval").body
    except SyntaxError as error:
        column = max(error.offset or 1, 1)
        hint = _syntax_hint(plain, column - 1)
        problem = ExpressionError(f"this is not a formula: {error.msg}", expected=_LANGUAGE, hint=hint)
        raise problem.at(Location("", 1, column)) from None


def _syntax_hint(text: str, at: int) -> str:
    words = [match for match in _KEYWORD.finditer(text) if match.start() <= at and not text[match.end() : at].strip()]
    if words:
        return f"'{words[-1][0]}' is a word of formulas: coordinate.{words[-1][0]}.position for a joint of that name"
    if "=" in text.translate({ord(c): None for c in "<>!"}).replace("==", ""):
        return "== to compare"
    return "* between factors, and a word in plain letters for each name"


def _no_arithmetic(node: ast.expr) -> ExpressionError:
    power = isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitXor)
    return ExpressionError("this is not arithmetic", expected=_LANGUAGE, hint="** for powers" if power else "")


Split = tuple[str, Sequence[ast.expr], Any]
"""Function of a node, its operands, and its value where it has none."""


class _Reader(Record, frozen=True):
    """Turns Python's tree into parts; what the grammar does not list is refused.

    Attributes:
        raw: Text that Python has parsed, whose columns are bytes.
        words: What has been replaced in it.
    """

    raw: bytes
    words: Words
    grammar: Grammar

    def part(self, node: ast.expr, depth: int = 1) -> Part:
        begin, end = (len(self.raw[:at].decode()) for at in (node.col_offset, node.end_col_offset))
        try:
            if depth > MAX_DEPTH:
                raise ExpressionError("the formula is nested too deeply", hint="smaller formulas")
            function, operands, value = self._split(node)
        except ExpressionError as error:
            raise error.at(Location("", 1, begin + 1, width=end - begin)) from None
        parts = tuple([self.part(operand, depth + 1) for operand in operands])
        return Part(function, value, parts, begin + 1, end - begin)

    def _split(self, node: ast.expr) -> Split:
        match node:
            case ast.Constant():
                return "constant", (), self._literal(node)
            case ast.Name():
                word = self.words.get(node.col_offset, node.id)
                return "name" if isinstance(word, str) else "constant", (), word
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _SYMBOLS:
                return _SYMBOLS[type(op)], [operand], None
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _SYMBOLS:
                return _SYMBOLS[type(op)], [left, right], None
            case ast.BoolOp(op=op, values=values):
                return _SYMBOLS[type(op)], values, None
            case ast.Compare() if all(type(op) in _SYMBOLS for op in node.ops):
                return self._compared(node)
            case ast.IfExp():
                return "if", [node.test, node.body, node.orelse], None
            case ast.Call():
                return self._called(node)
        if self.grammar.collections:
            return self._collected(node)
        if isinstance(node, ast.Attribute):
            expected = "a name such as joint.knee.effort"
            raise ExpressionError("a dot belongs between the words of a name", expected=expected)
        raise _no_arithmetic(node)

    def _collected(self, node: ast.expr) -> Split:
        match node:
            case ast.Attribute():
                return "item", [node.value, ast.copy_location(ast.Constant(node.attr), node)], None
            case ast.Subscript():
                return "item", [node.value, node.slice], None
            case ast.List() | ast.Tuple():
                return "list", node.elts, None
            case ast.Dict() if None not in node.keys:
                entries = zip(node.keys, node.values, strict=True)
                return "dict", [part for entry in entries for part in entry if part is not None], None
        raise _no_arithmetic(node)

    def _literal(self, node: ast.Constant) -> Any:
        value, written = node.value, self.raw[node.col_offset : node.end_col_offset].decode()
        if type(value) not in self.grammar.literals:
            raise ExpressionError(f"a {type(value).__name__} is not allowed in a formula", expected="numbers and names")
        if isinstance(value, int | float) and not abs(value) < (MAX_INTEGER if isinstance(value, int) else math.inf):
            raise ExpressionError("this number is too large", expected="integers below 2**64, others below 1e308")
        if isinstance(value, int | float) and "_" in written:
            raise ExpressionError("a number has no '_' between its digits", hint=written.replace("_", ""))
        return value

    def _compared(self, node: ast.Compare) -> Split:
        """Return a comparison of two operands; of more ``a < b and b < c``."""
        operands = [node.left, *node.comparators]
        if len(node.ops) == 1:
            return _SYMBOLS[type(node.ops[0])], operands, None
        pairs = zip(node.ops, pairwise(operands), strict=True)
        return "and", [ast.copy_location(ast.Compare(a, [op], [b]), node) for op, (a, b) in pairs], None

    def _called(self, node: ast.Call) -> Split:
        """Return a call; in languages with collections ``a.split(b)`` as ``split(a, b)``, and keys of ``dict(a=1)``."""
        called, arguments, named = node.func, node.args, node.keywords
        name: Any = self.words.get(called.col_offset, called.id) if isinstance(called, ast.Name) else None
        if self.grammar.collections and isinstance(called, ast.Attribute) and called.attr == "split":
            name, arguments = "split", [called.value, *arguments]
        elif self.grammar.collections and isinstance(name, str) and name.endswith(".split"):
            self.words[called.col_offset] = name.removesuffix(".split")
            name, arguments = "split", [called, *arguments]
        elif self.grammar.collections and name == "dict" and all(entry.arg for entry in named):
            pairs = ((ast.copy_location(ast.Constant(entry.arg), entry), entry.value) for entry in named)
            arguments, named = [*arguments, *(part for pair in pairs for part in pair)], []
        if named or not isinstance(name, str):
            raise _no_arithmetic(node)
        self._check_call(name, len(arguments))
        return name, arguments, None

    def _check_call(self, function: str, count: int) -> None:
        arities = self.grammar.arities
        if function not in arities:
            expected, hint = choices(function, arities, most=40)
            raise ExpressionError(f"there is no function '{function}'", expected=expected, hint=hint)
        least, most = arities[function]
        if not least <= count <= most:
            wanted = str(least) if least == most else f"{least} to {most}" if most < MANY else f"{least} or more"
            raise ExpressionError(f"'{function}' is given {count} arguments", expected=f"{wanted} of them")


def _in_words(error: PinarmError, text: str) -> PinarmError:
    """Move the place within the formula into the message: the location is for the file, which the caller knows."""
    place = error.location
    if place is None or place.source:
        return error
    part, whole = text[place.column - 1 :][: place.width], f"column {place.column} of '{_short(text)}'"
    error.message += f": '{_short(part)}'" + (f" at {whole}" if part != text else "") if part.strip() else f" ({whole})"
    error.location = None
    return error


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:77]}..."


def unknown_name(name: str, known: Iterable[str]) -> ExpressionError:
    """Return the error of a name that has no value."""
    expected, hint = choices(name, known, most=40)
    return ExpressionError(f"unknown name '{_short(name)}'", expected=expected, hint=hint)


def _measured(match: re.Match[str], text: str) -> MeasuredNumber:
    written, place = match[0], Location("", 1, match.start() + 1, width=len(match[0]))
    if not (_ends_term(text[: match.start()]) and _begins_term(text[match.end() :])):
        raise ExpressionError(
            "beside *, / and ** it is not clear where a unit ends",
            expected="parentheses about the number and its unit",
            hint=f"({written})",
            location=place,
        )
    try:
        value, unit = read_quantity(written)
    except UnitError as error:
        raise ExpressionError(
            f"this is no number with a unit ({error.message})",
            expected=error.expected,
            hint="parentheses about a number and its unit, or * before a name",
            location=place,
        ) from None
    assert unit is not None
    return MeasuredNumber(value, unit, written)


def _ends_term(before: str) -> bool:
    """Return whether a term of a sum can begin after a text."""
    bare = before.rstrip()
    signless = bare.rstrip("+- ")
    if signless != bare:
        return signless[-1:] not in ("*", "/", "%")
    return bare[-1:] in ("", *"(,<>=") or bare.rsplit(None, 1)[-1] in _OPERATOR_WORDS


def _begins_term(after: str) -> bool:
    """Return whether a term of a sum can end before a text."""
    bare = after.lstrip()
    return bare[:1] in ("", *"),+-<>=!") or bare.split(None, 1)[0] in _OPERATOR_WORDS
