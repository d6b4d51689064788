"""The grammar of formulas: a checked subset of Python's expressions, evaluated by an ``Algebra``.

Numbers, names with dots, ``+ - * / // % **``, comparisons, ``and or not``, ``a if test else b``, and a fixed table of
functions; in the language of xacro also texts, lists and maps. Python parses the text, but nothing is compiled or run:
the tree is checked node by node, and an ``Algebra`` (of values, of units) then gives each node its meaning.

A number with a unit, such as ``2e4 N/m``, stands where a term of a sum does: alone, between ``+``, ``-`` or
comparisons, as an argument of a function, or in parentheses, ``(2e4 N/m)*x``. Beside ``*``, ``/`` or ``**`` it has to
be in parentheses, so that nobody has to ask where the unit ends.
"""

from __future__ import annotations

import ast
import keyword
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any, Protocol, TypeVar

from pinarm.errors import ExpressionError, Location, PinarmError, UnitError, choices
from pinarm.input.units import Unit, read_quantity
from pinarm.records import Record, ValueRecord

MAX_LENGTH = 2000
MAX_DEPTH = 200
"""A sum of n terms is n levels deep; two Python frames a level stay well below the interpreter's 1000."""
MAX_NODES = 1000
MAX_INTEGER = 2**64
MANY = 1000
"""Largest number of arguments of a function that takes any number of them."""

CONSTANTS: Mapping[str, float] = {"pi": math.pi, "deg": math.pi / 180}
"""Names known in every formula; a name given to the formula takes precedence."""

T = TypeVar("T")

_NUMERAL = r"(?<![\w.])(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_UNIT_POWER = r"(?:(?:\^|\*\*)-?[0-9]{1,2})?"
_UNIT_NAME = r"[A-Za-z]+(?!\w|\.\w| *\()"
_MEASURED = rf"{_NUMERAL} +({_UNIT_NAME}{_UNIT_POWER}(?: *[*/] *(?:{_UNIT_NAME}|1){_UNIT_POWER})*)"
_OPERATOR_WORDS = ("if", "else", "and", "or", "not", "in", "is")

_SYMBOLS: Mapping[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%", ast.Pow: "**",
    ast.UAdd: "+", ast.USub: "-", ast.Not: "not", ast.And: "and", ast.Or: "or",
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


class Algebra(Protocol[T]):
    """Meaning of numbers, names and operations; operations are named by their symbols.

    Operands of ``and``, ``or`` and the branches of ``if`` are functions: they need not all be interpreted.
    """

    def constant(self, value: Any, /) -> T: ...
    def name(self, name: str, /) -> T: ...
    def unary(self, symbol: str, operand: T, /) -> T: ...
    def binary(self, symbol: str, left: T, right: T, /) -> T: ...
    def compare(self, symbols: Sequence[str], operands: Sequence[T], /) -> T: ...
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


def interpret(tree: ast.expr, algebra: Algebra[T], text: str) -> T:
    """Evaluate a tree in an algebra; errors name the column and the part of ``text``."""
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
        case ast.Attribute() if not _is_name(node):
            return algebra.call("item", [_walk(node.value, algebra), algebra.constant(node.attr)])
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
        case ast.Subscript():
            return algebra.call("item", [_walk(node.value, algebra), _walk(node.slice, algebra)])
        case ast.List() | ast.Tuple():
            return algebra.call("list", [_walk(value, algebra) for value in node.elts])
        case ast.Dict():
            return algebra.call("dict", [_walk(part, algebra) for part in _entries(node)])
    raise ExpressionError("this is not arithmetic")


@lru_cache(maxsize=4096)
def read_tree(text: str, grammar: Grammar) -> ast.expr:
    """Parse a text and check every node of it."""
    text = text.translate(_BLANKS).strip()
    if not text:
        raise ExpressionError("the formula is empty", expected="a number, a name, or a formula such as 2*(a + b)")
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the formula is too long: {len(text)} characters", expected=f"at most {MAX_LENGTH}")
    try:
        measured = find_measured(text) if MeasuredNumber in grammar.literals else []
    except ExpressionError as error:
        raise _in_words(error, text) from None
    plain, replaced = _replaced(text, measured, grammar)
    try:
        tree = ast.parse(plain, mode="eval").body
    except SyntaxError as error:
        place = Location("", 1, max(error.offset or 1, 1), width=1)
        hint = _syntax_hint(plain, place.column - 1)
        problem = ExpressionError(f"this is not a formula: {error.msg}", expected=_LANGUAGE, hint=hint)
        raise _in_words(problem.at(place), text) from None
    except (ValueError, RecursionError, MemoryError, OverflowError) as error:
        raise ExpressionError(f"this is not a formula: {error or 'nested too deeply'}", expected=_LANGUAGE) from None
    _put_back(tree, replaced)
    _check(tree, grammar, text)
    return tree


_OF_THE_LANGUAGE = ("and", "else", "if", "not", "or", "True", "False", "None")
_KEYWORD = re.compile(rf"(?<!\w)(?:{'|'.join(keyword.kwlist)})(?!\w)")
_CHAIN, _NUMBER_WORD = re.compile(r"(?<![\w.])[^\W\d]\w*(?:\.\w+)+"), re.compile(r"(?<=\.)[0-9]+(?!\w)")
"""A name with dots, and a number in it."""


def _replaced(
    text: str, measured: Sequence[tuple[int, MeasuredNumber]], grammar: Grammar
) -> tuple[str, dict[int, str | MeasuredNumber]]:
    """Return the text as Python can read it, and what was replaced in it by place in bytes; columns stay.

    Numbers with units become ``0`` and blanks, Python's keywords and numbers in names other letters. A keyword is a
    name, or part of one beside a dot, unless formulas use the word. Words of a name behind its first may be whole
    numbers: ``mode.1.frequency``.
    """
    replaced = dict[int, str | MeasuredNumber]()
    for start, number in measured:
        replaced[len(text[:start].encode())] = number
        text = f"{text[:start]}{'0'.ljust(len(number.text))}{text[start + len(number.text) :]}"
    for chain in _CHAIN.finditer(text):
        for digits in _NUMBER_WORD.finditer(chain[0]):
            start, end = (chain.start() + place for place in digits.span())
            replaced[len(text[:start].encode())] = digits[0]
            text = f"{text[:start]}{'x' * len(digits[0])}{text[end:]}"
    for match in _KEYWORD.finditer(text):
        word, (start, end) = match[0], match.span()
        dotted = text[start - 1 : start] == "." or text[end : end + 1] == "."
        if dotted or not (grammar.collections or word in _OF_THE_LANGUAGE):
            replaced[len(text[:start].encode())] = word
            text = f"{text[:start]}{'x' * len(word)}{text[end:]}"
    return text, replaced


def _put_back(tree: ast.expr, replaced: Mapping[int, Any]) -> None:
    """Put numbers with units and keywords into a tree, at the columns from which they were taken."""
    for node in ast.walk(tree) if replaced else ():
        if isinstance(node, ast.Constant) and isinstance(number := replaced.get(node.col_offset), MeasuredNumber):
            node.value, node.end_col_offset = number, node.col_offset + len(number.text)  # type: ignore[assignment]
        elif isinstance(node, ast.Name):
            node.id = replaced.get(node.col_offset, node.id)
        elif isinstance(node, ast.Attribute):
            node.attr = replaced.get((node.end_col_offset or 0) - len(node.attr.encode()), node.attr)


_BLANKS = {ord("\n"): " ", ord("\r"): " ", ord("\t"): " "}
_LANGUAGE = "numbers, names, + - * / // % **, comparisons, and, or, not, 'a if test else b', functions"


def _syntax_hint(text: str, at: int) -> str:
    words = [match for match in _KEYWORD.finditer(text) if match.start() <= at and not text[match.end() : at].strip()]
    if words:
        return f"'{words[-1][0]}' is a word of formulas: coordinate.{words[-1][0]}.position for a joint of that name"
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
            if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
                number = text.encode()[node.col_offset : node.end_col_offset].decode()
                if "_" in number:
                    raise ExpressionError("a number has no '_' between its digits", hint=number.replace("_", ""))
            pending += [(part, depth + 1) for part in _parts(node, grammar)]
        except ExpressionError as error:
            raise _in_words(error.at(_place(node)), text) from None


def _parts(node: ast.expr, grammar: Grammar) -> list[ast.expr]:
    """Return the operands of a node; a node that is not allowed is an error."""
    match node:
        case ast.Constant():
            _check_literal(node.value, grammar)
            return []
        case ast.Attribute() if grammar.collections and not _is_name(node):
            return [node.value]
        case ast.Name() | ast.Attribute():
            _dotted(node)
            return []
        case ast.UnaryOp() if type(node.op) in _SYMBOLS:
            return [node.operand]
        case ast.BinOp() if type(node.op) in _SYMBOLS:
            return [node.left, node.right]
        case ast.Compare() if all(
            type(operation) in _SYMBOLS and (grammar.collections or not isinstance(operation, ast.In | ast.NotIn))
            for operation in node.ops
        ):
            return [node.left, *node.comparators]
        case ast.BoolOp():
            return node.values
        case ast.IfExp():
            return [node.test, node.body, node.orelse]
        case ast.Call() if not _as_function(node, grammar).keywords and _is_name(node.func):
            _check_call(_dotted(node.func), len(node.args), grammar)
            return node.args
        case ast.Subscript() if grammar.collections:
            return [node.value, node.slice]
        case ast.List() | ast.Tuple() if grammar.collections:
            return node.elts
        case ast.Dict() if grammar.collections:
            return _entries(node)
    power = isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitXor)
    raise ExpressionError("this is not arithmetic", expected=_LANGUAGE, hint="** for powers" if power else "")


def _as_function(call: ast.Call, grammar: Grammar) -> ast.Call:
    """Write ``a.split(b)`` as ``split(a, b)``, and ``dict(a=b)`` as ``dict("a", b)``, in languages with collections."""
    method = call.func
    if grammar.collections and isinstance(method, ast.Attribute) and method.attr == "split":
        call.func, call.args = ast.copy_location(ast.Name(method.attr), method), [method.value, *call.args]
    if grammar.collections and isinstance(call.func, ast.Name) and call.func.id == "dict":
        named = [entry for entry in call.keywords if entry.arg]
        keys = [ast.copy_location(ast.Constant(entry.arg), entry) for entry in named]
        call.args += [part for key, entry in zip(keys, named, strict=True) for part in (key, entry.value)]
        call.keywords = [entry for entry in call.keywords if not entry.arg]
    return call


def _entries(node: ast.Dict) -> list[ast.expr]:
    """Return keys and values by turns; ``**`` before a map in a map is refused."""
    if None in node.keys:
        raise ExpressionError("this is not arithmetic", expected=_LANGUAGE)
    return [part for entry in zip(node.keys, node.values, strict=True) for part in entry if part is not None]


def _check_literal(value: Any, grammar: Grammar) -> None:
    if type(value) not in grammar.literals:
        raise ExpressionError(f"a {type(value).__name__} is not allowed in a formula", expected="numbers and names")
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


def _is_name(node: ast.expr) -> bool:
    while isinstance(node, ast.Attribute):
        node = node.value
    return isinstance(node, ast.Name)


def _dotted(node: ast.expr) -> str:
    """Flatten ``joint.knee.effort``; the dots are part of the name, nothing is looked up on the way."""
    words: list[str] = []
    while isinstance(node, ast.Attribute):
        words.append(node.attr)
        node = node.value
    if not isinstance(node, ast.Name):
        raise ExpressionError("a dot belongs between the words of a name", expected="a name such as joint.knee.effort")
    return ".".join([node.id, *reversed(words)])


def names_in(tree: ast.expr, grammar: Grammar) -> Iterable[str]:
    """Yield the names in a tree that has been checked."""
    pending = [tree]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Name | ast.Attribute):
            yield _dotted(node)
        else:
            pending += _parts(node, grammar)


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
    """Return the value of a name in the first table that has it."""
    for table in tables:
        if name in table:
            return table[name]
    expected, hint = choices(name, [known for table in tables for known in table], most=40)
    raise ExpressionError(f"unknown name '{_short(name)}'", expected=expected, hint=hint)


def find_measured(text: str) -> list[tuple[int, MeasuredNumber]]:
    """Return the numbers with a unit in a formula, each with its place, in time that grows as its length."""
    numbers = []
    for match in re.finditer(_MEASURED, text):
        if match[1] in _OPERATOR_WORDS:
            continue
        try:
            numbers.append((match.start(), _measured(match, text)))
        except ExpressionError as error:
            place = Location("", 1, len(text[: match.start()].encode()) + 1, width=len(match[0]))
            raise error.at(place) from None
    return numbers


def _measured(match: re.Match[str], text: str) -> MeasuredNumber:
    written = match[0]
    if not (_ends_term(text[: match.start()]) and _begins_term(text[match.end() :])):
        raise ExpressionError(
            "beside *, / and ** it is not clear where a unit ends",
            expected="parentheses about the number and its unit",
            hint=f"({written})",
        )
    try:
        value, unit = read_quantity(written)
    except UnitError as error:
        raise ExpressionError(
            f"this is no number with a unit ({error.message})",
            expected=error.expected,
            hint="parentheses about a number and its unit, or * before a name",
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
