"""Values in xacro files: texts with expressions and substitutions, properties, tables of YAML files.

Nothing of a file is run: expressions are the checked arithmetic of ``arithmetic``, only ``$(arg NAME)`` and
``$(find PACKAGE)`` are substituted, files lie under the root or in a package that the user names, and every step counts
against a budget.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from msgspec import Struct

from pinarm.errors import InputError, Location, ModelError, PinarmError, choices
from pinarm.input.formulas.grammar import MANY
from pinarm.input.roots import contained_file
from pinarm.input.xacro.arithmetic import Expressions, Rows, entry, require_unmarked
from pinarm.input.xml_text import MAX_BYTES, MAX_DEPTH, MAX_TEXT, Element, bound, location_of, read, tree_of

MAX_STEPS = 200_000
"""Largest number of steps: evaluations, elements made, a hundred characters of text; about 2 s."""

_TOKEN = re.compile(r"\$(\$+[{(])|\$\{([^}]*)\}|\$\(([^)]*)\)|([^$]+|\$[^{($]+|\$$)")
"""As in xacro: an escaped brace, an expression, a substitution, other text."""

UNITS = {"radians": 1.0, "degrees": math.pi / 180, "meters": 1.0, "millimeters": 1e-3, "foot": 0.3048, "inches": 0.0254}
"""Tags of numbers in YAML files -> factor."""

OF_XACRO = ("this is not arithmetic", "there is no function", "a dot belongs")
"""Beginnings of messages on expressions that the program xacro may know."""


class Scope:
    """Properties, blocks and macros of a file, a namespace or a macro; others are those of the scope around it."""

    def __init__(self, around: Scope | None = None, *, is_namespace: bool = False) -> None:
        self.own: dict[str, Any] = {}
        self.macros: dict[str, Any] = {}
        self.around, self.is_namespace = around, is_namespace

    def chain(self) -> Iterator[Scope]:
        scope: Scope | None = self
        while scope is not None:
            yield scope
            scope = scope.around

    def home(self, name: str) -> Scope | None:
        return next((scope for scope in self.chain() if name in scope.own), None)

    def macro(self, name: str) -> Any:
        return next((scope.macros[name] for scope in self.chain() if name in scope.macros), None)

    def names(self) -> list[str]:
        return [name for scope in self.chain() for name in scope.own if name.isidentifier()]


class Unevaluated(Struct):
    """The text of a property that is evaluated when it is asked for, and the element that gives it."""

    text: str
    element: Element


@lru_cache(maxsize=32)
def _tree(text: str, source: str) -> Element:
    return tree_of(text, source)


class Evaluator:
    """The values of one expansion: its arguments, the files that it reads, its place in them, and its budget."""

    def __init__(self, root: Path, arguments: dict[str, str], rows: Rows | None = None) -> None:
        self.root, self.arguments, self.rows = root, arguments, rows
        self.declared: dict[str, None] = {}
        self.warnings: list[str] = []
        self.files: list[Path] = []
        self.texts: dict[str, str] = {}
        self.macros: list[str] = []
        self.resolving: list[tuple[Scope, str]] = []
        self.element: Element | None = None
        self.snippet = ""
        self.depth = self.steps = self.size = 0

    def read(self, path: Path, source: str) -> str:
        text = read(path, source, MAX_BYTES - self.size)
        self.size += len(text)
        return text if self.rows is None else require_unmarked(text)

    def parsed(self, path: Path, source: str) -> Element:
        self.texts[source] = self.read(path, source)
        return _tree(self.texts[source], source)

    def here(self) -> Location:
        """Return the place of the evaluation: of the text that failed, otherwise of the element."""
        assert self.element is not None
        return location_of(self.element, self.texts[self.element.source], self.snippet)

    def error(self, message: str, expected: str = "", hint: str = "") -> ModelError:
        within = f" (in macro {' > '.join(self.macros[-5:])})" if self.macros else ""
        return ModelError(message + within, expected=expected, hint=hint)

    def spend(self, steps: int = 1) -> None:
        self.steps += steps
        if self.steps > MAX_STEPS:
            raise ModelError("the expansion does not come to an end", hint="fewer macros, properties and elements")

    def descend(self, levels: int = 1) -> None:
        self.depth += levels
        if self.depth > MAX_DEPTH:
            hint = "a macro, an include or a property that does not use itself"
            raise self.error(f"the model is nested more than {MAX_DEPTH} levels deep", hint=hint)

    @property
    def beyond(self) -> str:
        """Hint where a file needs more of xacro than is read here."""
        return f"the model as xacro expands it: xacro {self.files[0].name} > model.urdf"

    def warn(self, *texts: Any) -> str:
        if len(self.warnings) < MANY:
            self.warnings.append(" ".join(map(str, texts))[:200])
        return ""

    def file(self, name: str, *, needed: bool = True) -> Path | None:
        """Return the path of a file from the current one; ``None`` where it need not exist and does not."""
        wanted = name if "://" in name else self.files[-1].parent / name
        try:
            return contained_file(wanted, self.root)
        except InputError as error:
            if "does not exist" not in error.message:
                raise
        if needed:
            raise self.error(f"there is no file {wanted}")
        return None

    def property_of(self, scope: Scope, name: str) -> Any:
        """Return the value of a property, which is evaluated at its first use; ``None`` where there is none."""
        home = scope.home(name)
        value = home.own[name] if home else None
        if home is None or not isinstance(value, Unevaluated):
            return value
        if (home, name) in self.resolving:
            names = " -> ".join([*(known for _, known in self.resolving), name])
            raise self.error(f"circular variable definition: {names[:200]}")
        self.resolving.append((home, name))
        outer, self.element = self.element, value.element
        home.own[name] = result = self.literal(self.value(value.text, home))
        self.element = outer
        self.resolving.pop()
        return result

    def named(self, scope: Scope, name: str) -> Any:
        """Return the value of a name in an expression; ``None`` for nothing.

        ``a.b`` is property ``b`` of namespace ``a``, or what a map ``a`` has under ``b``.
        """
        if self.rows is not None and (column := self.rows.named(name)) is not None:
            return column
        first, *words = name.split(".")
        value = self.property_of(scope, first)
        for word in words:
            if isinstance(value, Scope):
                value = self.property_of(value, word) if word in value.own else None
            else:
                value = entry(value, word) if isinstance(value, dict) else None
        return None if isinstance(value, Scope | Element) else value

    def literal(self, value: Any) -> Any:
        """Return the number or truth value that a text is; other values, and other texts, as they are."""
        if not isinstance(value, str):
            return value
        return _literal(value) if self.rows is None else self.rows.literal(_literal, value)

    def plain(self, text: str, scope: Scope) -> str:
        return require_unmarked(str(self.value(text, scope)))

    def truth(self, text: str, scope: Scope) -> bool:
        value = self.literal(self.value(text, scope))
        if isinstance(value, str):
            raise self.error(f'the condition "{text[:60]}" is "{value[:60]}", which is neither true nor false')
        return bool(value)

    def value(self, text: str, scope: Scope) -> Any:
        """Return the value of a text: of a single expression its own value, of all others text."""
        if "$" not in text:
            return text
        self.descend(2)  # a property in a property takes the frames of two macros
        try:
            parts = list(self._evaluated(text, scope))
        except PinarmError as error:
            self.snippet = self.snippet or text.strip().splitlines()[0]
            if error.message.startswith(OF_XACRO):
                error.hint = error.hint or self.beyond
            raise error.at(self.here()) from None  # at once: what uses this text is not where the mistake is
        self.depth -= 2
        result = parts[0] if len(parts) == 1 else "".join(map(str, parts))
        if isinstance(result, str | list | dict):
            length = len(str(result))
            bound("characters in one evaluated text", 0 if not isinstance(result, str) else length, MAX_TEXT)
            self.spend(length // 100)
        return result

    def _evaluated(self, text: str, scope: Scope) -> Iterator[Any]:
        position = 0
        while position < len(text):
            self.spend()
            match = _TOKEN.match(text, position)
            if match is None:
                raise ModelError(f"a brace is not closed: '{text[position : position + 40]}'")
            escaped, expression, substitution, other = match.groups()
            if expression is not None:
                yield self._expressions(scope).evaluate(str(self.value(expression, scope)))
            elif substitution is not None:
                yield self._substituted(str(self.value(substitution, scope)))
            else:
                yield escaped or other
            position = match.end()

    def _expressions(self, scope: Scope) -> Expressions:
        functions = {
            "xacro.load_yaml": self._load_yaml, "load_yaml": self._load_yaml, "xacro.warning": self.warn,
            "xacro.arg": self._argument,
        }  # fmt: skip
        return Expressions(partial(self.named, scope), scope.names, functions)

    def _substituted(self, text: str) -> str:
        """Return the value of ``$(arg NAME)``, or for ``$(find PACKAGE)`` the URI of the package."""
        command, _, name = text.strip().partition(" ")
        name = name.strip()
        if command == "find" and name:
            return f"package://{name}"
        if command != "arg":
            expected = "$(arg NAME) or $(find PACKAGE)"
            raise ModelError(f"'$({text[:60]})' is not allowed", expected=expected, hint=self.beyond)
        return self._argument(name)

    def _argument(self, name: Any) -> str:
        if name not in self.arguments:
            expected, hint = choices(str(name), self.arguments, most=40)
            raise ModelError(f"unknown argument '{str(name)[:60]}'", expected=expected, hint=hint)
        self.declared[name] = None
        return self.arguments[name]

    def _load_yaml(self, name: Any) -> Any:
        """Return the lists and maps of a YAML file, whose numbers may have tags such as ``!degrees``."""
        from pinarm.input.yaml.document import Builder

        path = self.file(require_unmarked(str(name)))
        assert path is not None
        text = self.read(path, str(path))
        self.spend(50 + len(text) // 20)
        table = Builder(text, str(path), _tagged).build()
        if not isinstance(table, list | dict):
            raise ModelError(f"the file '{name}' has no list or map", expected="a table of YAML")
        return table


def _tagged(tag: str, text: str) -> float | None:
    """Return the number that a scalar of YAML with a tag is; ``None`` for another tag."""
    if tag.removeprefix("!") not in UNITS:
        return None
    value = Expressions().evaluate(text)
    return float(value) * UNITS[tag.removeprefix("!")] if isinstance(value, int | float) else None


def _literal(value: str) -> Any:
    """Return the number or truth value that a text is, as xacro finds it; digits of other scripts are text."""
    if len(value) >= 2 and value[0] == value[-1] == "'":
        return value[1:-1]
    if "_" in value or not value.isascii():
        return value
    for kind in (int, float, _TRUTH.__getitem__):
        try:
            return kind(value)
        except (ValueError, KeyError):
            pass
    return value


_TRUTH = {"true": True, "True": True, "false": False, "False": False}
