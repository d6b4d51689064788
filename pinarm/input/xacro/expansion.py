"""From a URDF or xacro file to plain URDF text, safe for untrusted files; the next variant takes a tenth of the time.

At the first expansion of a model only its key is stored. The second expansion is recorded as a template and compared
with xacro's result; from then on other numbers are filled in, as long as every file has the same text and may still be
read. Columns of numbers are filled in at once.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct, field

from pinarm.arrays import Array, Flags
from pinarm.errors import ExpressionError, InputError, ModelError, PinarmError, choices
from pinarm.input.roots import contained_file, contained_path
from pinarm.input.xacro.expander import Expander, Expansion
from pinarm.input.xacro.expression_tape import (
    CLOSE,
    OPEN,
    UNRECORDABLE,
    AnyColumn,
    Number,
    Tape,
    Traced,
    column,
    holds_floats,
    is_column,
    joined,
    marks,
)
from pinarm.input.xml_text import MAX_BYTES, MAX_TEXT, Survey, bound, read
from pinarm.records import ValueRecord

WAYS = 8
"""Largest number of templates of one model: each path through branches that depend on numbers has its own."""
RECORDED = 2
"""Number of the expansion at which a model is recorded."""
MODELS = 32
"""Largest number of models in the cache; the least recently used ones are dropped."""

Text = tuple[tuple[str, ...], tuple[int, ...]]
"""Texts, and the registers whose values go between them."""


class UnknownArgument(InputError):
    """An argument ``name`` that a model does not have."""

    def __init__(self, name: str, declared: Iterable[str]) -> None:
        expected, hint = choices(name, declared, most=40)
        super().__init__(f"the model has no argument '{name}'", expected=expected, hint=hint)
        self.name = name


class ExpandedColumns(ValueRecord, frozen=True):
    """An expansion for columns of numbers.

    Attributes:
        xml: The model, with words for the numbers that vary.
        columns: These words, with the numbers or texts in their place.
        arguments: Every ``xacro:arg``: its text, or its texts, floats in the place of what Python writes for them.
        holds: The rows for which the model is this one.
    """

    xml: str
    columns: Mapping[str, AnyColumn]
    arguments: Mapping[str, str | AnyColumn]
    holds: Flags


def expand(path: Path, arguments: Mapping[str, float | str], *, root: Path) -> Expansion:
    """Expand a xacro file; a plain URDF file is checked and comes back as it is.

    Args:
        path: The file.
        arguments: Values of its ``xacro:arg``, in place of the defaults.
        root: Folder under which the file and what it includes must lie.

    Raises:
        ModelError: The model is malformed, does something that is not allowed, or is too large.
        UnknownArgument: It has no argument of a given name.
        InputError: A file is missing or lies elsewhere, or an expression is wrong.
    """
    request = _Request.of(path, arguments, root)
    if request.path.suffix != ".xacro":
        text = read(request.path, request.source, MAX_BYTES)
        if not Survey.of(text, request.source).is_xacro:
            check_declared(arguments, {})
            return Expansion(text, {})
    expansion = _expanded(request)
    check_declared(arguments, expansion.arguments)
    return expansion


def expand_columns(
    path: Path, arguments: Mapping[str, float | str], columns: Mapping[str, Sequence[float] | Array], *, root: Path
) -> ExpandedColumns | None:
    """Expand a xacro file for columns of arguments; ``None`` where its expansion cannot be recorded.

    Args:
        path: The file.
        arguments: Values of its ``xacro:arg`` in one row.
        columns: Those that vary, with their values in all rows.
        root: Folder under which the file and what it includes must lie.

    Raises:
        PinarmError: A file may not be read any more, or a number follows that cannot be computed.
    """
    request = _Request.of(path, arguments, root)
    checked = {name: _column(name, values) for name, values in columns.items()}
    for _ in range(RECORDED + 1):
        memory = _remembered.get(request.key())
        for template in memory.templates if memory else ():
            if template.is_current(request) and template.fill(request) is not None:
                return template.fill_columns(request, checked)
        _expanded(request)
    return None


def check_declared(names: Iterable[str], declared: Mapping[str, object]) -> None:
    """Refuse names that are not among the arguments of a model."""
    for name in sorted(names):
        if name not in declared:
            raise UnknownArgument(name, declared)


def _argument(name: str, value: float | str) -> Number | str:
    plain = value if isinstance(value, str) else int(value) if isinstance(value, int) else float(value)
    text = str(plain)
    if text in ("nan", "inf", "-inf") or len(text) > MAX_TEXT or OPEN in text or CLOSE in text:
        raise InputError(f"the argument '{name}' is {text[:20]!r}", expected="a finite number or a short text")
    return plain


def _column(name: str, values: Sequence[float] | Array) -> AnyColumn:
    numbers = column(values)
    if holds_floats(numbers) and np.isfinite(numbers).all():
        return numbers
    return column(_argument(name, value) for value in numbers.tolist())


class _Request(ValueRecord, frozen=True):
    """A model that is to be expanded: its file, the name of that in messages, and the values of its arguments."""

    path: Path
    source: str
    root: Path
    arguments: Mapping[str, Number | str]

    @classmethod
    def of(cls, path: Path, arguments: Mapping[str, float | str], root: Path) -> _Request:
        file = contained_file(path.absolute(), root)
        return cls(file, str(path), root, {name: _argument(name, value) for name, value in arguments.items()})

    def key(self) -> tuple[object, ...]:
        """Return the cache key: everything but the values of numbers, of which only the types matter."""
        shapes = [(name, value if isinstance(value, str) else type(value)) for name, value in self.arguments.items()]
        return self.path, self.root, *shapes

    def numbers(self) -> dict[str, Number]:
        return {name: value for name, value in self.arguments.items() if not isinstance(value, str)}

    def expand(self, tape: Tape | None = None, marked: Mapping[str, str] | None = None) -> tuple[Expander, Expansion]:
        """Expand the model by xacro, with marks of a tape in place of the numbers where it is to be recorded."""
        values = {name: value if isinstance(value, str) else repr(value) for name, value in self.arguments.items()}
        values |= marked or {}
        expander = Expander(self.root, values, {str(self.path): self.source}, tape)
        return expander, expander.run(self.path)


class Template(ValueRecord, frozen=True):
    """An expansion into which other numbers can be filled.

    Attributes:
        tape: Computes what is filled in.
        xml: The model.
        arguments: Every ``xacro:arg``.
        warnings: As in ``Expansion``.
        texts: File -> its text; ``None`` for an included file that was not there.
        includes: What an included file was called -> where it lay.
    """

    tape: Tape
    xml: Text
    arguments: Mapping[str, Text]
    warnings: tuple[str, ...]
    texts: Mapping[str, str | None]
    includes: Mapping[str, str]

    @classmethod
    def record(cls, request: _Request) -> Template:
        """Expand a model and record how.

        Raises:
            PinarmError: It cannot be expanded, or not be recorded.
        """
        numbers = request.numbers()
        tape = Tape(list(numbers.values()))
        marked = {name: str(Traced(tape, register)) for register, name in enumerate(numbers)}
        expander, expansion = request.expand(tape, marked)
        xml = marks(expansion.xml)
        Survey.of(",".join(xml[0]), request.source)  # which is no XML where a name of an element has a mark in it
        if any(OPEN in text for text in (*expansion.warnings, *_comments(expansion.xml))):
            raise ModelError(UNRECORDABLE)
        texts = dict.fromkeys(expander.includes.values()) | expander.texts
        arguments = {name: marks(text) for name, text in expansion.arguments.items()}
        return cls(tape, xml, arguments, expansion.warnings, texts, expander.includes)

    def is_current(self, request: _Request) -> bool:
        """Return whether every included file lies where it lay, and every file has the text that it had.

        Raises:
            PinarmError: A file may not be read any more.
        """
        for name, path in self.includes.items():
            if str(contained_path(name, request.root)) != path:
                return False
        return all(_text(Path(path)) == text for path, text in self.texts.items())

    def fill(self, request: _Request) -> Expansion | None:
        """Return the expansion for other numbers; ``None`` where they take other branches."""
        try:
            values, holds = self.tape.run(list(request.numbers().values()))
        except ExpressionError:
            return None
        if not holds.all():
            return None
        xml, *arguments = (
            joined(texts, *(values[register] for register in registers))
            for texts, registers in (self.xml, *self.arguments.values())
        )
        bound("characters", len(xml), MAX_BYTES)
        return Expansion(xml, dict(zip(self.arguments, arguments, strict=True)), self.warnings)

    def fill_columns(self, request: _Request, columns: Mapping[str, AnyColumn]) -> ExpandedColumns:
        """Return the expansion for columns of numbers; see ``expand_columns``."""
        values, holds = self.tape.run([columns.get(name, number) for name, number in request.numbers().items()])
        texts, registers = self.xml
        used = {register for register in registers if is_column(values[register])}
        words = {register: f"column_{register}_of_{len(values)}" for register in used}
        xml = joined(texts, *(words.get(register, values[register]) for register in registers))
        arguments = {name: _text_column(text, values) for name, text in self.arguments.items()}
        return ExpandedColumns(xml, {word: values[register] for register, word in words.items()}, arguments, holds)


def _text_column(text: Text, values: Sequence[Any]) -> str | AnyColumn:
    """Return a text with marks filled in, or the texts of all rows."""
    texts, registers = text
    filled = [values[register] for register in registers]
    if not any(map(is_column, filled)):
        return joined(texts, *filled)
    if texts == ("", ""):
        return filled[0] if holds_floats(filled[0]) else column(map(str, filled[0].tolist()))
    count = next(len(value) for value in filled if is_column(value))
    spread = (value.tolist() if is_column(value) else [value] * count for value in filled)
    return column(joined(texts, *row) for row in zip(*spread, strict=True))


def _comments(xml: str) -> Iterator[str]:
    begin = xml.find("<!--")
    while begin >= 0:
        end = xml.find("-->", begin)
        yield xml[begin : end if end >= 0 else len(xml)]
        begin = xml.find("<!--", end) if end >= 0 else -1


def _text(path: Path) -> str | None:
    return read(path, str(path), MAX_BYTES) if path.is_file() else None


class _Memory(Struct):
    """The templates of a model, and how many more may be recorded."""

    templates: list[Template] = field(default_factory=list)
    left: int = WAYS

    def learn(self, request: _Request, expansion: Expansion) -> None:
        """Record a request, whose expansion is known."""
        self.left -= 1
        try:
            template = Template.record(request)
            if template.fill(request) == expansion:
                self.templates.append(template)
        except PinarmError:
            self.left = 0


_remembered: OrderedDict[tuple[object, ...], _Memory] = OrderedDict()


def _expanded(request: _Request) -> Expansion:
    """Expand a xacro file, by a template of it where there is one."""
    key = request.key()
    memory = _remembered.get(key)
    if memory and not all(template.is_current(request) for template in memory.templates):
        memory = None
    for template in memory.templates if memory else ():
        if (expansion := template.fill(request)) is not None:
            return expansion
    expansion = request.expand()[1]
    Survey.of(expansion.xml, f"the expansion of {request.source}")
    if memory is None:
        memory = _remembered[key] = _Memory()
    elif memory.left:
        memory.learn(request, expansion)
    _remembered.move_to_end(key)
    while len(_remembered) > MODELS:
        _remembered.popitem(last=False)
    return expansion
