"""Expansion of xacro: macros, conditions, includes and blocks, evaluated into a new tree.

Honest files expand as with the program xacro, version 2; comments are left out.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from pinarm.arrays import Array, Flags
from pinarm.errors import InputError, ModelError, PinarmError, choices
from pinarm.input.roots import contained_file
from pinarm.input.xacro.arithmetic import MARK, MARKS, Column, NotByRows, Rows
from pinarm.input.xacro.evaluation import Evaluator, Scope, Unevaluated
from pinarm.input.xml_text import MAX_BYTES, MAX_ELEMENTS, MAX_LINKS, MAX_TEXT, Element, bound, read, tree_of
from pinarm.records import ValueRecord

_PARAMETER = re.compile(
    r"^\s*([^\s:=]+?)\s*:?=\s*(\^\|?)?(\$\{.*?\}|\$\(.*?\)|(?:'.*?'|\".*?\"|[^\s'\"]++)++|)(?:\s+|$)(.*)"
)
"""Pattern of xacro, with possessive repetitions: in xacro an unbalanced quote takes exponential time."""

_NAME = re.compile(r"[^\W\d][\w.:-]*")
"""Name of an element or attribute."""


class Expansion(ValueRecord, frozen=True):
    """A model as plain URDF.

    Attributes:
        arguments: Every ``xacro:arg`` with its value, given or default.
    """

    xml: str
    arguments: dict[str, str]
    warnings: tuple[str, ...] = ()


class Macro(ValueRecord, frozen=True):
    """A macro: its element, and its parameters with their defaults, each with the property that goes before it."""

    body: Element
    parameters: dict[str, tuple[str, str | None] | None]


class Expander(Evaluator):
    """One expansion: the elements that it makes of values."""

    made = elements = 0

    def run(self, path: Path, source: str) -> Expansion:
        """Return the expansion of a file, which messages call ``source``; every failure is located."""
        root = self.parsed(path, source)
        self.files.append(path)
        self.element = root
        try:
            robot = self._robot(root)
        except PinarmError as error:
            raise error.at(self.here()) from None
        except RecursionError:
            raise self.error("the model is nested too deeply").at(self.here()) from None
        for kind in ("link", "joint"):
            bound(f"{kind}s", len(robot.findall(kind)), MAX_LINKS)
        ElementTree.indent(robot)
        xml = ElementTree.tostring(robot, encoding="unicode") + "\n"
        return Expansion(xml, {name: self.arguments[name] for name in self.declared}, tuple(self.warnings))

    def _robot(self, root: Element) -> Element:
        """Return the outermost element, whose attributes may use the defaults of arguments that are in it."""
        made, scope = Element(root.tag), Scope()
        self._fill(root, made, scope)
        self.element = root
        self._evaluate_attributes(root, made, scope)
        return made

    def _copy(self, source: Element, scope: Scope) -> Element:
        self.elements += 1
        bound("elements", self.elements, MAX_ELEMENTS)
        element = Element(source.tag)
        element.source, element.line = source.source, source.line
        self._evaluate_attributes(source, element, scope)
        self._fill(source, element, scope)
        return element

    def _evaluate_attributes(self, source: Element, made: Element, scope: Scope) -> None:
        for name, text in source.attrib.items():
            if not name.startswith(("xacro:", "xmlns")):
                made.set(name, str(self.value(text, scope)))
        self._write(len(source.tag) + sum(map(len, made.attrib.values())))

    def _fill(self, source: Element, made: Element, scope: Scope) -> None:
        self._add_text(made, source.text, scope)
        for child in source:
            assert isinstance(child, Element)
            self.spend()
            outer, self.element = self.element, child
            self.descend()
            self._expand(child, made, scope)
            self.depth -= 1
            self.element = outer  # only now: where it fails, the place is that of the failure
            self._add_text(made, child.tail, scope)

    def _add_text(self, made: Element, text: str | None, scope: Scope) -> None:
        if not text or not text.strip():
            return
        written = str(self.value(text, scope))
        self._write(len(written))
        if len(made):
            made[-1].tail = (made[-1].tail or "") + written
        else:
            made.text = (made.text or "") + written

    def _write(self, characters: int) -> None:
        self.made += characters
        bound("characters", self.made, MAX_BYTES)

    def _expand(self, element: Element, made: Element, scope: Scope) -> None:
        kind = element.tag.removeprefix("xacro:")
        if kind == element.tag:
            made.append(self._copy(element, scope))
        elif (handle := _HANDLERS.get(kind)) is not None:
            handle(self, element, made, scope)
        else:
            self._call_macro(kind, element, made, scope)

    def _attributes(self, element: Element, *required: str, optional: tuple[str, ...] = ()) -> list[str | None]:
        """Return the attributes of an element of xacro as they are written; unknown ones are warned of."""
        for name in required:
            if name not in element.attrib:
                raise self.error(f"{element.tag}: missing attribute '{name}'")
        known = (*required, *optional)
        if extra := [name for name in element.attrib if name not in known and not name.startswith("xmlns:")]:
            self.warn(f"{element.tag}: unknown attribute(s): {', '.join(extra)}")
        return [element.get(name) for name in known]

    def _declare(self, element: Element, made: Element, scope: Scope) -> None:
        name, default = map(str, self._attributes(element, "name", "default"))
        if name not in self.arguments:
            self.arguments[name] = str(self.value(default, scope))
        self.declared[name] = None

    def _define_property(self, element: Element, made: Element, scope: Scope) -> None:
        if "remove" in element.attrib:
            raise self.error("properties are not removed here", hint=self.beyond)
        options = ("value", "default", "scope", "lazy_eval")
        written, value, default, where, lazy = self._attributes(element, "name", optional=options)
        name = self.plain(str(written), scope)
        if not name.isidentifier() or name.startswith("__"):
            raise self.error(f"Property names must be valid identifiers, without '__' before them: {name[:60]}")
        if value is not None and default is not None:
            raise self.error(f"of default and value a property has one: {name}")
        if default is not None:
            if scope.home(name):
                return
            value = default
        if value is None:
            scope.own[f"**{name}"] = element
            return
        target = self._target(where, scope)
        if target is scope and self.truth(lazy or "true", scope):
            self._set(target, name, value, element)
        else:
            target.own[name] = self.literal(self.value(value, scope))

    def _target(self, where: str | None, scope: Scope) -> Scope:
        *inner, outermost = scope.chain()
        if where == "global":
            return outermost
        if where != "parent":
            return scope
        around = [outer for outer in (*inner, outermost)[1:] if scope.is_namespace or not outer.is_namespace]
        return around[0] if around else scope

    def _set(self, scope: Scope, name: str, value: str, element: Element) -> None:
        read = self.literal(value)
        scope.own[name] = Unevaluated(read, element) if isinstance(read, str) else read

    def _define_macro(self, element: Element, made: Element, scope: Scope) -> None:
        name, text = self._attributes(element, "name", optional=("params",))
        name = str(name).removeprefix("xacro:")
        if name == "call" or "." in name:
            raise self.error(f"'{name[:60]}' is no name for a macro")
        parameters: dict[str, tuple[str, str | None] | None] = {}
        while text and text.strip():
            self.spend()
            if match := _PARAMETER.match(text):
                parameters[match[1]] = (match[1] if match[2] else "", match[3] or None)
                text = match[4]
            else:
                word, *rest = text.split(None, 1)
                parameters[word], text = None, "".join(rest)
        scope.macros[name] = Macro(element, parameters)

    def _insert_block(self, element: Element, made: Element, scope: Scope) -> None:
        name = self._attributes(element, "name")[0]
        for mark in ("**", "*"):
            if (home := scope.home(f"{mark}{name}")) is not None:
                block = home.own[f"{mark}{name}"]
                if mark == "**":
                    self._fill(block, made, scope)
                else:
                    self._expand(block, made, scope)
                return
        raise self.error(f'Undefined block "{name}"')

    def _include(self, element: Element, made: Element, scope: Scope) -> None:
        file, space, optional = self._attributes(element, "filename", optional=("ns", "optional"))
        if space is not None:
            name = self.plain(space, scope)
            scope.own[name] = scope = Scope(scope, is_namespace=True)
        needed = not self.truth(optional or "false", scope)
        path = self.file(self.plain(str(file), scope), needed=needed)
        if path is None:
            return
        if path in self.files:
            raise self.error(f"the file '{file}' includes itself")
        root = self.parsed(path, str(path))
        self.files.append(path)
        self._fill(root, made, scope)
        self.files.pop()

    def _make_element(self, element: Element, made: Element, scope: Scope) -> None:
        text = element.get("xacro:name")
        if text is None:
            raise self.error("xacro:element: missing attribute 'xacro:name'")
        copy = Element(_name(self.plain(text, scope)), element.attrib)
        copy.text, copy.source, copy.line = element.text, element.source, element.line
        copy[:] = element
        self._expand(copy, made, scope)

    def _set_attribute(self, element: Element, made: Element, scope: Scope) -> None:
        name, value = map(str, self._attributes(element, "name", "value"))
        made.set(_name(self.plain(name, scope)), str(self.value(value, scope)))

    def _choose(self, element: Element, made: Element, scope: Scope) -> None:
        holds = self.truth(str(self._attributes(element, "value")[0]), scope)
        if holds == (element.tag == "xacro:if"):
            self._fill(element, made, scope)

    def _call(self, element: Element, made: Element, scope: Scope) -> None:
        name = self.plain(str(self._attributes(element, "macro", optional=(*element.attrib,))[0]), scope)
        self._call_macro(name, element, made, scope, but=("macro",))

    def _call_macro(self, name: str, element: Element, made: Element, scope: Scope, but: tuple[str, ...] = ()) -> None:
        *spaces, last = [name] if scope.macro(name) else name.split(".")
        home = scope
        for space in spaces:
            inner = self.property_of(home, space)
            home = inner if isinstance(inner, Scope) else Scope()
        macro = home.macro(last)
        if macro is None:
            self._miss_macro(name, home)
            return
        self.macros.append(name)
        self._fill(macro.body, made, self._called(macro, element, scope, Scope(home), but))
        self.macros.pop()

    def _miss_macro(self, name: str, scope: Scope) -> None:
        """Refuse the call of an unknown macro; in a URDF file, which is expanded already, it is left out and noted."""
        if self.files[0].suffix != ".xacro":
            self.warn(f"<xacro:{name}> is left out: the file has no such macro")
            return
        expected, hint = choices(name, [known for around in scope.chain() for known in around.macros], most=40)
        raise self.error(f"unknown macro name: xacro:{name}", expected, hint)

    def _called(self, macro: Macro, element: Element, scope: Scope, inner: Scope, but: tuple[str, ...]) -> Scope:
        missing = dict(macro.parameters)
        for key, text in element.attrib.items():
            if key in but or key.startswith("xmlns:"):
                continue
            if key not in missing:
                expected, hint = choices(key, missing, most=40)
                raise self.error(f'Invalid parameter "{key}"', expected, hint)
            del missing[key]
            inner.own[key] = self.literal(self.value(text, scope))
        self._take_blocks(element, missing, inner, scope)
        for key, default in [*missing.items()]:
            if default is not None:
                inner.own[key] = self.literal(self._default(*default, scope))
                del missing[key]
        if missing:
            raise self.error(f"Undefined parameters [{','.join(missing)}]")
        return inner

    def _take_blocks(self, element: Element, missing: dict[str, Any], inner: Scope, scope: Scope) -> None:
        blocks = Element("blocks")
        self._fill(element, blocks, scope)
        waiting = list(blocks)
        for key in [key for key in missing if key[0] == "*"]:
            if not waiting:
                raise self.error("Not enough blocks")
            inner.own[key] = waiting.pop(0)
            del missing[key]
        if waiting:
            raise self.error(f'Unused block "{waiting[0].tag}"')

    def _default(self, forwarded: str, text: str | None, scope: Scope) -> Any:
        """Return the default of a parameter: a property of the caller, if there is one, or a text."""
        if forwarded and scope.home(forwarded):
            return self.property_of(scope, forwarded)
        if text is None and forwarded:
            raise self.error(f"Undefined property to forward: {forwarded}")
        return self.value(text or "", scope)


def _name(text: str) -> str:
    if not _NAME.fullmatch(text):
        raise ModelError(f"'{text[:60]}' is no name of an element or attribute", expected="a word")
    return text


_HANDLERS: Mapping[str, Callable[[Expander, Element, Element, Scope], None]] = {
    "arg": Expander._declare, "property": Expander._define_property, "macro": Expander._define_macro,
    "insert_block": Expander._insert_block, "include": Expander._include, "element": Expander._make_element,
    "attribute": Expander._set_attribute, "if": Expander._choose, "unless": Expander._choose, "call": Expander._call,
}  # fmt: skip


class UnknownArgument(InputError):
    """An argument ``name`` that a model does not have."""

    def __init__(self, name: str, declared: Iterable[str]) -> None:
        expected, hint = choices(name, declared, most=40)
        super().__init__(f"the model has no argument '{name}'", expected=expected, hint=hint)
        self.name = name


class ExpandedColumns(ValueRecord, frozen=True):
    """An expansion for columns of numbers.

    Attributes:
        columns: Words in the text -> the numbers in their place.
        arguments: Every ``xacro:arg``: its text, or its numbers.
    """

    xml: str
    columns: Mapping[str, Array]
    arguments: Mapping[str, str | Array]
    holds: Flags


def expand(path: Path, arguments: Mapping[str, float | str], *, root: Path) -> Expansion:
    """Expand a xacro file; a plain URDF file is checked and comes back as it is.

    Args:
        arguments: Values of its ``xacro:arg``, in place of the defaults.
    """
    texts = {name: _argument(name, value) for name, value in arguments.items()}
    file, source = contained_file(path.absolute(), root), str(path)
    text = read(file, source, MAX_BYTES) if file.suffix != ".xacro" else ""
    if text and not _is_xacro(tree_of(text, source), has_expressions="$" in text or "&#" in text):
        expansion = Expansion(text, {})
    else:
        expansion = Expander(root, texts).run(file, source)
    check_declared(arguments, expansion.arguments)
    return expansion


def expand_columns(
    path: Path, arguments: Mapping[str, float | str], columns: Mapping[str, Array], *, root: Path
) -> ExpandedColumns | None:
    """Expand a xacro file for columns of arguments; ``None`` where its expansion cannot be followed for many rows.

    Args:
        arguments: Values of its ``xacro:arg`` in the first row.
        columns: Those that vary -> finite numbers, shape (rows,).
    """
    rows = Rows(len(next(iter(columns.values()))))
    texts = {name: _argument(name, value) for name, value in arguments.items()}
    texts |= {name: str(Column(rows, values)) for name, values in columns.items()}
    try:
        expansion = Expander(root, texts, rows).run(contained_file(path.absolute(), root), str(path))
        told = {name: rows.literal(str, text) for name, text in expansion.arguments.items()}
    except NotByRows:
        return None
    known = {name: value.values if isinstance(value, Column) else value for name, value in told.items()}
    used = {mark: rows.marked[mark].values for mark in dict.fromkeys(MARKS.findall(expansion.xml))}
    return ExpandedColumns(expansion.xml, used, known, rows.holds)


def check_declared(names: Iterable[str], declared: Mapping[str, object]) -> None:
    """Refuse names that are not among the arguments of a model."""
    for name in sorted(names):
        if name not in declared:
            raise UnknownArgument(name, declared)


def _is_xacro(root: ElementTree.Element, *, has_expressions: bool) -> bool:
    """Return whether a model contains anything of xacro; files written by xacro declare its namespace, no more."""
    names = (name for element in root.iter() for name in (element.tag, *element.attrib))
    return any(name.startswith("xacro:") or (has_expressions and name == "xmlns:xacro") for name in names)


def _argument(name: str, value: float | str) -> str:
    plain: Any = value if isinstance(value, str) else int(value) if isinstance(value, int) else float(value)
    text = str(plain)
    if text in ("nan", "inf", "-inf") or len(text) > MAX_TEXT or MARK in text:
        raise InputError(f"the argument '{name}' is {text[:20]!r}", expected="a finite number or a short text")
    return text
