"""Language of documents: texts of reports, pictures, torsors, isolations and lab sheets, by one gettext catalogue each.

English texts are in the code, with ``{placeholders}``. ``said`` translates a text where it is composed, ``told`` a
finished English one, such as a remark of a result that was read from its folder. Errors and the terminal stay English.
"""

from __future__ import annotations

import re
from ast import literal_eval
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, wraps
from numbers import Real
from pathlib import Path
from string import Formatter
from typing import Any, Concatenate, Literal, ParamSpec, Protocol, TypeVar, get_args

from pinarm.errors import InputError

Language = Literal["en", "fr"]

CATALOGUES = Path(__file__).parent / "locale"

LETTERS = 4
"""Letters beside its placeholders from which finished texts are compared with a text: ``at {place}`` fits too many."""

_ENTRY = re.compile(r'^msgid ((?:".*"\n)+)msgstr ((?:".*"(?:\n|\Z))+)', re.MULTILINE)
_PLACE = re.compile(r"\{(\w+)[^{}]*\}")
_POINT = re.compile(r"(?<![\w.])(\d+)\.(\d+)(?!\d|\.\d)")

_asked: ContextVar[str] = ContextVar("asked", default="")
_document: ContextVar[str] = ContextVar("document", default="")


class _Shown(Protocol):
    @property
    def lang(self) -> Language | None: ...


class _Subject(Protocol):
    """Subject of a document: a result, a sweep, a sheet."""

    @property
    def presentation(self) -> _Shown: ...


P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T", bound=_Subject)


@contextmanager
def writing(language: str) -> Iterator[None]:
    """Write documents in a language, whatever their scenarios say: ``with pinarm.writing("fr"): ...``.

    Args:
        language: ``en`` or ``fr``; empty for that of each scenario.

    Raises:
        InputError: There is no such language.
    """
    if language not in ("", *get_args(Language)):
        raise InputError(f"documents are not written in '{language}'", expected=" or ".join(get_args(Language)))
    token = _asked.set(language or _asked.get())
    try:
        yield
    finally:
        _asked.reset(token)


@contextmanager
def document(language: str | None) -> Iterator[None]:
    """Write one document in the language of its scenario; that of what it is part of where the scenario says none."""
    token = _document.set(language or _document.get())
    try:
        yield
    finally:
        _document.reset(token)


def in_language(write: Callable[Concatenate[T, P], R]) -> Callable[Concatenate[T, P], R]:
    """Decorate a function that writes a document on its first argument: it does so in the language of this."""

    @wraps(write)
    def written(of: T, /, *args: P.args, **options: P.kwargs) -> R:
        with document(of.presentation.lang):
            return write(of, *args, **options)

    return written


def spoken() -> Language:
    """Return the language that is written now."""
    return "fr" if (_asked.get() or _document.get()) == "fr" else "en"


def said(text: str, /, **values: Any) -> str:
    """Return an English text in the language of the document, filled in; numbers among the values take its comma."""
    if spoken() == "en":
        return text.format(**values) if values else text
    return _FILLED.format(catalogue(spoken()).get(text, text), **values)


def told(text: str) -> str:
    """Return a finished English text in the language of the document; the text itself where no catalogue has it."""
    if spoken() == "en" or not text:
        return text
    known = catalogue(spoken())
    if text in known:
        return known[text]
    for pattern, translation in _patterns(spoken()):
        if match := pattern.fullmatch(text):
            return decimals(_FILLED.format(translation, **match.groupdict()))
    return decimals(text)


def decimals(text: str) -> str:
    """Return a text with the decimal mark of the language in its numbers; those with two points are no numbers."""
    return text if spoken() == "en" else _POINT.sub(r"\1,\2", text)


@cache
def catalogue(language: str) -> Mapping[str, str]:
    """Return the texts of a language by the English ones."""
    source = (CATALOGUES / f"{language}.po").read_text(encoding="utf-8")
    pairs = ((_joined(entry[1]), _joined(entry[2])) for entry in _ENTRY.finditer(source))
    return {text: translation for text, translation in pairs if text and translation}


def _joined(lines: str) -> str:
    return "".join(map(literal_eval, lines.splitlines()))


@cache
def _patterns(language: str) -> list[tuple[re.Pattern[str], str]]:
    """Return texts with placeholders as patterns, those with the most letters of their own first."""
    texts = [text for text in catalogue(language) if "{" in text and _letters(text) >= LETTERS]
    return [(_pattern(text), catalogue(language)[text]) for text in sorted(texts, key=_letters, reverse=True)]


def _letters(text: str) -> int:
    return sum(map(str.isalpha, _PLACE.sub("", text)))


def _pattern(text: str) -> re.Pattern[str]:
    """Return a text as a pattern; a placeholder that it has twice is the same both times."""
    pieces, met = _PLACE.split(text), set[str]()
    for k, piece in enumerate(pieces):
        group = f"(?P={piece})" if piece in met else f"(?P<{piece}>.*?)"
        met |= {piece} if k % 2 else set()
        pieces[k] = group if k % 2 else re.escape(piece)
    return re.compile("".join(pieces), re.DOTALL)


class _Filled(Formatter):
    """Fills placeholders; ``{name!t}`` of a translation is a text that is translated too."""

    def convert_field(self, value: Any, conversion: Any) -> Any:
        return told(str(value)) if conversion == "t" else super().convert_field(value, conversion)

    def format_field(self, value: Any, format_spec: str) -> str:
        filled = str(super().format_field(value, format_spec))
        return decimals(filled) if isinstance(value, Real) else filled


_FILLED = _Filled()
