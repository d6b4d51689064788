"""Expansions cached as templates: the next variant of a model takes a tenth of the time of the first.

At the first expansion of a model only its key is stored. The second expansion is recorded and compared with xacro's
result; from then on other numbers are filled in, as long as every file has the same text and may still be read.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct, field

from pinarm.arrays import Flags
from pinarm.errors import ModelError, PinarmError
from pinarm.input.roots import contained_path
from pinarm.input.xacro.expander import Expander, Expansion
from pinarm.input.xacro.expression_tape import (
    OPEN,
    UNRECORDABLE,
    AnyColumn,
    ArgumentColumn,
    Number,
    Tape,
    Traced,
    is_column,
    joined,
    marks,
    rows_of,
)
from pinarm.input.xml_text import MAX_BYTES, Survey, bound, read
from pinarm.records import ValueRecord

WAYS = 8
"""Largest number of templates of one model: each path through branches that depend on numbers has its own."""
RECORDED = 2
"""Number of the expansion at which a model is recorded."""
MODELS = 32
"""Largest number of models in the cache; the least recently used ones are dropped."""

Text = tuple[tuple[str, ...], tuple[int, ...]]
"""Texts, and the registers whose values go between them."""


class Request(ValueRecord, frozen=True):
    """A model that is to be expanded.

    Attributes:
        path: The file.
        source: Its name in messages.
        root: Folder of the files that may be read.
        packages: Packages whose files may be read too.
        arguments: Values of its arguments, numbers or text.
    """

    path: Path
    source: str
    root: Path
    packages: Mapping[str, Path]
    arguments: Mapping[str, Number | str]

    def key(self) -> tuple[object, ...]:
        """Return the cache key: everything but the values of numbers, of which only the types matter."""
        shapes = [(name, value if isinstance(value, str) else type(value)) for name, value in self.arguments.items()]
        return self.path, self.root, *self.packages.items(), *shapes

    def numbers(self) -> dict[str, Number]:
        """Return the arguments that are numbers."""
        return {name: value for name, value in self.arguments.items() if not isinstance(value, str)}

    def expand(self, tape: Tape | None = None, marked: Mapping[str, str] | None = None) -> tuple[Expander, Expansion]:
        """Expand the model by xacro, with marks of a tape in place of the numbers where it is to be recorded.

        Raises:
            PinarmError: It cannot be expanded.
        """
        given = {name: value if isinstance(value, str) else repr(value) for name, value in self.arguments.items()}
        given |= marked or {}
        expander = Expander(self.root, self.packages, given, {str(self.path): self.source}, tape)
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
    def record(cls, request: Request) -> Template:
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

    def is_current(self, request: Request) -> bool:
        """Tell whether every included file lies where it lay, and every file has the text that it had.

        Raises:
            PinarmError: A file may not be read any more.
        """
        for name, path in self.includes.items():
            if str(contained_path(name, request.root, request.packages)) != path:
                return False
        return all(_text(Path(path)) == text for path, text in self.texts.items())

    def fill(self, request: Request) -> Expansion | None:
        """Return the expansion for other numbers; ``None`` where they take other branches."""
        values = self.tape.run(list(request.numbers().values()))
        if values is None:
            return None
        xml, *arguments = (
            joined(texts, *(values[register] for register in registers))
            for texts, registers in (self.xml, *self.arguments.values())
        )
        bound("characters", len(xml), MAX_BYTES)
        return Expansion(xml, dict(zip(self.arguments, arguments, strict=True)), self.warnings)

    def fill_columns(self, request: Request, columns: Mapping[str, AnyColumn]) -> ExpandedColumns:
        """Return the expansion for columns of numbers.

        Raises:
            ExpressionError: A step is not possible in some row.
        """
        values, holds = self.tape.run_columns([columns.get(name, number) for name, number in request.numbers().items()])
        texts, registers = self.xml
        used = {register for register in registers if is_column(values[register])}
        words = {register: f"column_{register}_of_{len(values)}" for register in used}
        xml = joined(texts, *(words.get(register, values[register]) for register in registers))
        arguments = {name: _text_column(text, values) for name, text in self.arguments.items()}
        return ExpandedColumns(xml, {word: values[register] for register, word in words.items()}, arguments, holds)


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


def expanded_columns(request: Request, columns: Mapping[str, AnyColumn]) -> ExpandedColumns | None:
    """Expand a xacro file for columns of arguments; ``None`` where it cannot be recorded.

    Args:
        request: The model, with the numbers of one row.
        columns: Argument -> its numbers.

    Raises:
        PinarmError: A file may not be read any more, or a number follows that cannot be computed.
    """
    for _ in range(RECORDED + 1):
        memory = _remembered.get(request.key())
        for template in memory.templates if memory else ():
            if template.is_current(request) and template.fill(request) is not None:
                return template.fill_columns(request, columns)
        expanded(request)
    return None


def _text_column(text: Text, values: Sequence[Any]) -> str | AnyColumn:
    """Return a text with marks filled in, or the texts of all rows."""
    texts, registers = text
    filled = [values[register] for register in registers]
    if not any(map(is_column, filled)):
        return joined(texts, *filled)
    if texts == ("", ""):
        return filled[0] if isinstance(filled[0], np.ndarray) else ArgumentColumn(map(str, filled[0]))
    count = next(len(value) for value in filled if is_column(value))
    spread = (rows_of(value) if is_column(value) else [value] * count for value in filled)
    return ArgumentColumn(joined(texts, *row) for row in zip(*spread, strict=True))


def _comments(xml: str) -> Iterator[str]:
    """Yield the comments of a text."""
    begin = xml.find("<!--")
    while begin >= 0:
        end = xml.find("-->", begin)
        yield xml[begin : end if end >= 0 else len(xml)]
        begin = xml.find("<!--", end) if end >= 0 else -1


def _text(path: Path) -> str | None:
    return read(path, str(path), MAX_BYTES) if path.is_file() else None


class _Remembered(Struct):
    """The templates of a model, and how many more may be recorded."""

    templates: list[Template] = field(default_factory=list)
    left: int = WAYS

    def filled(self, request: Request) -> Iterator[Expansion]:
        """Yield the expansions of a request by those templates that apply."""
        for template in self.templates:
            expansion = template.fill(request)
            if expansion is not None:
                yield expansion

    def learn(self, request: Request, expansion: Expansion) -> None:
        """Record a request, whose expansion is known."""
        self.left -= 1
        try:
            template = Template.record(request)
            if template.fill(request) == expansion:
                self.templates.append(template)
        except PinarmError:
            self.left = 0


_remembered: OrderedDict[tuple[object, ...], _Remembered] = OrderedDict()


def expanded(request: Request) -> Expansion:
    """Expand a xacro file, by a template of it where there is one.

    Raises:
        PinarmError: It cannot be expanded; the message says where.
    """
    key = request.key()
    memory = _remembered.get(key)
    if memory and not all(template.is_current(request) for template in memory.templates):
        memory = None
    for expansion in memory.filled(request) if memory else ():
        return expansion
    expansion = request.expand()[1]
    Survey.of(expansion.xml, f"the expansion of {request.source}")
    if memory is None:
        memory = _remembered[key] = _Remembered()
    elif memory.left:
        memory.learn(request, expansion)
    _remembered.move_to_end(key)
    while len(_remembered) > MODELS:
        _remembered.popitem(last=False)
    return expansion
