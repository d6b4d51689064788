"""The errors of pinarm: one small hierarchy whose members carry data.

Every message says where, what was found, what was expected and what to try. The command line prints it without a
traceback and exits with ``exit_code``: 2 for input that has to be mended, 3 where the numerics failed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from os import PathLike
from os.path import basename, dirname
from typing import Any, ClassVar

from pinarm.records import ValueRecord

PACKAGE = dirname(__file__)
"""Folder of the program's own code."""
SHOWN = 160
"""Most characters of a line that an excerpt shows, and of a name in a list."""
LISTED = 24
"""Names that a list has before the others are counted, where those of usual mechanisms should all be there."""
COMPARED = 1_000_000
"""Most pairs of letters that are compared to find a similar name: at the worst they take half a second."""


class Location(ValueRecord, frozen=True):
    """A place in a file that the user wrote.

    Attributes:
        source: File name, or the command-line option that gave the text.
        line: Line, counted from 1; 0 where the place is the file as a whole.
        column: Column, counted from 1.
        text: The line itself, for the excerpt.
        width: Number of characters to underline.
    """

    source: str
    line: int = 0
    column: int = 0
    text: str = ""
    width: int = 1

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}" if self.line else self.source

    def excerpt(self) -> str:
        """Return the line, or the part of it around the place, underlined; empty where there is no line to show."""
        if not self.line or not self.text.strip():
            return ""
        margin = f"{self.line:5d} | "
        before = max(0, self.column - 1 - SHOWN // 2) if self.column + self.width > SHOWN else 0
        shown, column = self.text.expandtabs(1)[before : before + SHOWN], self.column - 1 - before
        width = max(1, min(self.width, len(shown) - column))
        return f"{margin}{shown}\n{' ' * (len(margin) - 2)}| {' ' * column}{'^' * width}"


class PinarmError(Exception):
    """Base of all errors that a user can meet.

    Args:
        message: What was found.
        expected: What was expected, or what there is to choose from.
        hint: What to try.
        location: Where; added later by whoever knows the file (see ``at``).

    Attributes:
        path: Keys and indices that lead to the mistake, from what its finder was given (see ``within``).
    """

    exit_code: ClassVar[int] = 2

    def __init__(self, message: str, *, expected: str = "", hint: str = "", location: Location | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.expected = expected
        self.hint = hint
        self.location = location
        self.path: tuple[str | int, ...] = ()

    def at(self, location: Location) -> PinarmError:
        """Return this error with a place; a place that is already known is more exact and stays."""
        if self.location is None:
            self.location = location
        return self

    def __str__(self) -> str:
        lines = [f"{self.location}: {self.message}" if self.location else self.message]
        if self.location and (excerpt := self.location.excerpt()):
            lines.append(excerpt)
        if self.expected:
            lines.append(f"  expected: {self.expected}")
        if self.hint:
            lines.append(f"  try: {self.hint}")
        return "\n".join(lines)

    def _render_traceback_(self) -> list[str]:
        """Return the message and the user's line, which IPython shows in place of a traceback."""
        from itertools import takewhile
        from pathlib import Path
        from traceback import extract_tb

        before = takewhile(lambda frame: not frame.filename.startswith(PACKAGE), extract_tb(self.__traceback__))
        *_, last = [None, *(frame for frame in before if "numpy" not in Path(frame.filename).parts)]  # of s + t
        return [f"{type(self).__name__}: {self}", *([f"  in line {last.lineno}: {last.line}"] if last else [])]


class InputError(PinarmError, ValueError):
    """A scenario, mechanism or table that is malformed, or says something impossible."""


class ModelError(PinarmError):
    """A URDF, xacro, MJCF or SDF model that cannot be used as it is."""


class UnitError(InputError):
    """A quantity without a unit, with an unknown one, or with one of the wrong dimension."""


class DrivesError(InputError):
    """More drives than a mechanism has degrees of freedom, or drives too few or too weak to carry its load."""


class MethodError(InputError):
    """A method of integration that is not for what it is to integrate."""


class ExpressionError(InputError):
    """A formula that cannot be read, or that names something unknown."""


class NumericsError(PinarmError):
    """The numerics failed; what was computed until then is kept in ``partial``.

    Args:
        message: What happened.
        partial: What had been computed; ``None`` where there is nothing.
        data: Figures that tell more, e.g. ``{"t": 0.3, "gap": 2e-3}``.
        expected: As in ``PinarmError``.
        hint: As in ``PinarmError``.
    """

    exit_code: ClassVar[int] = 3

    def __init__(self, message: str, *, partial: Any = None, expected: str = "", hint: str = "", **data: Any) -> None:
        super().__init__(message, expected=expected, hint=hint)
        self.partial = partial
        self.data = data


class AssemblyError(NumericsError):
    """No configuration takes the wanted positions; ``data`` holds the closest one and its gap."""

    exit_code: ClassVar[int] = 2


class DynamicsError(NumericsError):
    """The accelerations are not determined: a massless body is free, or a value is not finite."""


class IntegrationError(NumericsError):
    """The time integration could not go on."""


class Interrupted(NumericsError):
    """The user interrupted the computation; ``partial`` holds what there was."""

    exit_code: ClassVar[int] = 130


def of_interrupt(error: BaseException) -> bool:
    """Tell whether an error stands for an interrupt, as Python 3.11 makes one of it while a class is made."""
    return isinstance(error.__cause__, KeyboardInterrupt)


def fault(error: BaseException) -> str:
    """Return an error of the program itself in one line: its kind, its words, and the line of pinarm that raised it."""
    from traceback import extract_tb

    frames = extract_tb(error.__traceback__)
    own = [frame for frame in frames if frame.filename.startswith(PACKAGE)] or frames
    where = f" ({basename(own[-1].filename)}, line {own[-1].lineno}, in {own[-1].name})" if own else ""
    return f"{type(error).__name__}: {error}{where}"


class Key(str):
    """The last step of a path that leads to a key itself, not to what stands beside it."""

    __slots__ = ()


Place = Callable[..., AbstractContextManager[None]]
"""``with place("motion", "theta"):`` gives errors of the block that place of the problem in its file."""


def nowhere(*path: str | int) -> AbstractContextManager[None]:
    """Stand in for a ``Place`` where errors get none."""
    return nullcontext()


@contextmanager
def within(*path: str | int) -> Iterator[None]:
    """Say of errors that come out of the block by which keys and indices their mistake is found."""
    try:
        yield
    except PinarmError as error:
        error.path = (*path, *error.path)
        raise


@contextmanager
def locating_drives(place: Place, key: str = "drives") -> Iterator[None]:
    """Give errors about the number of drives that come out of the block their place at a key of the problem."""
    try:
        yield
    except DrivesError:
        with place(key):
            raise


def require_name(given: object) -> None:
    """Refuse what is no text where something is asked for by its name.

    Raises:
        InputError: It is none, such as 0: Python asks for that where it looks for a name or goes through all of them.
    """
    if not isinstance(given, str):
        raise InputError(f"a value of the type {type(given).__name__} is no name", expected="one name, as text")


def as_names(given: str | Iterable[str]) -> list[str]:
    """Return several names as a list; one alone may be given as it is."""
    return [given] if isinstance(given, str) else list(given)


def require_path(given: object, of: str) -> None:
    """Refuse what is no path where a file or a folder is asked for.

    Raises:
        InputError: It is none.
    """
    if not isinstance(given, str | PathLike):
        raise InputError(f"a value of the type {type(given).__name__} is no path", expected=f"that of {of}")


def require_map(given: object, of: str, example: str) -> None:
    """Refuse what is given in place of a map, such as the texts of the shell.

    Raises:
        InputError: It is none.
    """
    if not isinstance(given, Mapping):
        raise InputError(f"{str(given)[:SHOWN]} is no map of {of}", expected=example)


def choices(found: str, available: Iterable[str], *, most: int = 12) -> tuple[str, str]:
    """Return the ``expected`` and ``hint`` texts for a name that is not among those available.

    Args:
        found: The unknown name.
        available: The names that exist.
        most: How many of them to list.
    """
    import difflib

    names = sorted(set(available))
    close = difflib.get_close_matches(found, _few(names, COMPARED // max(len(found), 1)), n=1, cutoff=0.6)
    listed = [name if len(name) <= SHOWN else f"{name[:SHOWN]}..." for name in names[:most]]
    shown = ", ".join(listed) + (f", ... ({len(names)} in all)" if len(names) > most else "")
    return f"one of {shown}" if names else "nothing: there is none", close[0] if close else ""


def _few(names: Iterable[str], letters: int) -> list[str]:
    """Return the first names that have no more letters together, longer ones left out."""
    few = []
    for name in names:
        if len(name) <= letters:
            few.append(name)
            letters -= len(name)
    return few


def printable(text: str) -> str:
    """Return text without characters that steer a terminal."""
    return "".join(c if c.isprintable() or c in SPACES else "\N{REPLACEMENT CHARACTER}" for c in text)


SPACES = "\n\u00a0\u202f"
"""Characters that steer nothing, although Python prints them as codes: end of a line, no-break spaces of French."""


def listed(what: str, names: Sequence[str]) -> str:
    """Return a noun with names, such as ``joints a, b``."""
    return f"{what}{'s' if len(names) > 1 else ''} {several(names)}"


def several(names: Sequence[str], most: int = 6) -> str:
    """Return names separated by commas; beyond ``most`` the rest is counted."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
