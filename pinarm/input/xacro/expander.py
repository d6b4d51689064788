"""One expansion by a private copy of xacro in which the functions that evaluate, read or recurse are replaced.

xacro evaluates Python, reads any file and can be made to run for ever. Here expressions are the checked arithmetic of
``arithmetic``, only ``$(arg NAME)`` and ``$(find PACKAGE)`` are substituted, included files lie under the root, and
every step counts against a budget. Honest files expand as with xacro.
"""

from __future__ import annotations

import importlib.util
import keyword
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from pinarm.errors import Location, ModelError, PinarmError, choices
from pinarm.input.formulas.grammar import MANY
from pinarm.input.roots import contained_file, contained_path
from pinarm.input.xacro.arithmetic import Names, Scalars, evaluate
from pinarm.input.xacro.expression_tape import OPEN, Tape
from pinarm.input.xml_text import MAX_BYTES, MAX_DEPTH, MAX_TEXT, Survey, bound, location, read
from pinarm.records import ValueRecord

if TYPE_CHECKING:
    from xml.dom.minidom import Document, Element, Node

MAX_STEPS = 200_000
"""Largest number of steps: evaluations, copied nodes and attributes, searches among siblings; about 5 s."""
SIBLINGS = 500
"""Siblings that are searched in the time of one step; the trees of xacro have their children in lists."""

_LOCK = threading.Lock()
_TOKEN = re.compile(r"\$(\$+[{(])|\$\{([^}]*)\}|\$\(([^)]*)\)|([^$]+|\$[^{($]+|\$$)")
"""As in xacro: an escaped brace, an expression, a substitution, other text."""


_MACRO_PARAMETER = re.compile(
    r"^\s*([^\s:=]+?)\s*:?=\s*(\^\|?)?(\$\{.*?\}|\$\(.*?\)|(?:'.*?'|\".*?\"|[^\s'\"]++)++|)(?:\s+|$)(.*)"
)
"""Pattern of xacro, with possessive repetitions: in xacro an unbalanced quote takes exponential time."""
_DISARMED = ("open", "eval", "compile", "os", "glob", "load_yaml", "safe_eval", "eval_extension", "process_file")
"""Names of xacro that are set to ``None``: the replacements do not need them, and any other use fails."""
OURS = (
    "check_attrs", "eval_all", "eval_text", "get_include_files", "handle_macro_call", "is_valid_name", "parse",
    "print_location", "remove_previous_comments", "replace_node", "reqd_attrs", "warning",
)  # fmt: skip
_NEEDED = (
    *OURS, "LEXER", "NameSpace", "Table", "XacroException", "_global_symbols", "all_includes", "filestack",
    "init_stacks", "macrostack", "process_doc", "process_include", "re_macro_arg", "root_dir",
    "substitution_args_context",
)  # fmt: skip


class Expansion(ValueRecord, frozen=True):
    """A model as plain URDF.

    Attributes:
        xml: The text.
        arguments: Every ``xacro:arg`` with its value, given or default.
        warnings: Warnings of xacro, such as on unknown attributes.
    """

    xml: str
    arguments: dict[str, str]
    warnings: tuple[str, ...] = ()


class Expander:
    """One expansion: the replacements of xacro's functions, with their counters and records.

    Args:
        root: Folder of the files that may be read.
        arguments: Values of arguments; xacro adds the defaults.
        sources: Path of a file -> its name in messages.
        tape: Where to record what is computed; arguments that are on it are given as its marks.
    """

    def __init__(
        self, root: Path, arguments: dict[str, str], sources: dict[str, str], tape: Tape | None = None
    ) -> None:
        self.root, self.arguments, self.sources, self.tape = root, arguments, sources, tape
        with _LOCK:  # loading it is not for two at once either
            self.xacro, self.plain = private_xacro()
        self.declared: dict[str, None] = {}
        self.warnings: list[str] = []
        self.texts: dict[str, str] = {}
        self.includes: dict[str, str] = {}
        self.element: Element | None = None
        self.snippet = ""
        self.depth = self.steps = self.size = 0
        self.copies = _Copies(self._spend)

    def run(self, path: Path) -> Expansion:
        """Return the expansion; every failure is a located ``PinarmError``."""
        xacro = self.xacro
        with _LOCK:
            vars(xacro).update({name: getattr(self, name) for name in OURS})
            literal = xacro.Table._eval_literal
            if self.tape is not None:
                xacro.Table._eval_literal = staticmethod(partial(self.tape.literal, literal))
            try:
                xacro.init_stacks(str(path))
                document = self.parse(None, str(path))
                xacro.process_doc(document, mappings=self.arguments)
                arguments = {name: self.arguments[name] for name in self.declared}
                return Expansion(Writer().document(document), arguments, tuple(self.warnings))
            except PinarmError as error:
                raise error.at(self._here()) from None
            except Exception as error:  # xacro raises whatever Python does where a file surprises it
                raise ModelError(_one_line(error) + self._macros()).at(self._here()) from None
            finally:
                xacro.Table._eval_literal = staticmethod(literal)
                vars(xacro).update(self.plain, filestack=None, macrostack=None, all_includes=[])
                xacro.substitution_args_context.clear()

    def _here(self) -> Location:
        """Return the location of the evaluation: of the text that failed, otherwise of the element."""
        path, line = (self.element and self.element.getUserData("place")) or (self.xacro.filestack[-1], 0)
        places = [
            (name, number, row.index(self.snippet) + 1)
            for name, text in self.texts.items()
            for number, row in enumerate(text.splitlines(), 1)
            if self.snippet and self.snippet in row
        ]
        exact = [place for place in places if place[:2] == (path, line)] or places
        if len(exact) == 1:
            path, line, column = exact[0]
            return location(self.sources.get(path, path), self.texts[path], line, column, len(self.snippet))
        return location(self.sources.get(path, path), self.texts.get(path, ""), line)

    def _macros(self) -> str:
        names = [macro.body.getAttribute("name") for macro in self.xacro.macrostack[-5:]]
        return f" (in macro {' > '.join(names)})" if names else ""

    def _spend(self, steps: int = 1) -> None:
        self.steps += steps
        if self.steps > MAX_STEPS:
            raise ModelError("the expansion does not come to an end", hint="fewer macros, properties and elements")

    def _descend(self, levels: int = 1) -> None:
        self.depth += levels
        if self.depth > MAX_DEPTH:
            hint = "a macro, an include or a property that does not use itself"
            raise ModelError(f"the model is nested more than {MAX_DEPTH} levels deep{self._macros()}", hint=hint)

    # The methods below replace the functions of xacro of the same names.

    def parse(self, _: None, filename: str) -> Document:
        """Read a file into a tree whose elements have their locations and whose copies are counted."""
        from xml.dom import minidom

        path, source = Path(filename), self.sources.setdefault(filename, filename)
        if not path.exists():
            self.xacro.filestack.pop()  # as xacro does: where an include is optional, it goes on from here
            raise self.xacro.XacroException(f"there is no file {filename}", exc=FileNotFoundError())
        text = read(contained_file(path, self.root), source, MAX_BYTES - self.size)
        self.size += len(text)
        self.texts[filename] = text
        lines = Survey.of(text, source).lines
        document = minidom.parseString(text)
        for element, line in zip(document.getElementsByTagName("*"), lines, strict=True):
            element.setUserData("place", (filename, line), self.copies)
        self._count_created(document)
        return document

    def _count_created(self, document: Document) -> None:
        def counted(create: Callable[..., Any]) -> Callable[..., Any]:
            def created(*arguments: Any) -> Any:
                self._spend()
                return create(*arguments)

            return created

        for name in ("createTextNode", "createComment", "createCDATASection", "createProcessingInstruction"):
            setattr(document, name, counted(getattr(document, name)))

    def eval_all(self, node: Element, macros: Any, symbols: Any) -> None:
        """Expand an element, counting it."""
        self._spend()
        self._descend()
        outer, self.element = self.element, node
        try:
            self.plain["eval_all"](node, macros, symbols)
        finally:
            self.depth -= 1
        self.element = outer  # only now: where it fails, the place is that of the failure

    def handle_macro_call(self, node: Element, macros: Any, symbols: Any) -> bool:
        """Expand an element if it calls a macro; return whether it does."""
        if not node.tagName.startswith("xacro:"):
            return False
        self.element = node
        return bool(self.plain["handle_macro_call"](node, macros, symbols))

    def replace_node(self, node: Element, by: Any, content_only: bool = False) -> None:
        """Replace an element by trees or by their children, in one step however many they are.

        xacro's own version searches among all siblings for each of them.
        """
        parent: Any = node.parentNode
        trees = by if isinstance(by, list) else [by] if by is not None else []
        children = [child for tree in trees for child in (tree.childNodes if content_only else [tree])]
        siblings = parent.childNodes
        self._spend(1 + len(children) + len(siblings) // SIBLINGS)
        place = siblings.index(node)
        siblings[place : place + 1] = children
        row = [node.previousSibling, *children, node.nextSibling]
        for left, right in pairwise(row):
            if left is not None:
                left.nextSibling = right
            if right is not None:
                right.previousSibling = left
        for child in children:
            child.parentNode = parent
        node.parentNode = node.previousSibling = node.nextSibling = None

    def remove_previous_comments(self, node: Element) -> None:
        """Remove the comments that stand before an element; each costs a search among its siblings."""
        parent: Any = node.parentNode
        passed, before = 1, node.previousSibling
        while before is not None and before.nodeType != node.ELEMENT_NODE:
            passed, before = passed + 1, before.previousSibling
        self._spend(passed * (1 + len(parent.childNodes) // SIBLINGS))
        self.plain["remove_previous_comments"](node)

    def check_attrs(self, tag: Element, required: list[str], optional: list[str]) -> list[Any]:
        """Fetch attributes; this is where xacro begins with each element of its own."""
        self._spend()
        self.element = tag
        values: list[Any] = self.plain["check_attrs"](tag, required, optional)
        if tag.tagName == "xacro:arg":
            self.declared[values[0]] = None
        return values

    def reqd_attrs(self, tag: Element, attrs: list[str]) -> list[Any]:
        """Fetch attributes that must be there."""
        self.element = tag
        return list(self.plain["reqd_attrs"](tag, attrs))

    def eval_text(self, text: str, symbols: Any) -> Any:
        """Evaluate text; one that is a single expression gives its value, all others text."""
        if "$" not in text:
            return text
        self._descend(2)  # a property in a property takes the frames of two macros
        try:
            parts = list(self._evaluated(text, symbols))
        except Exception as error:
            self.snippet = self.snippet or text.strip()
            if isinstance(error, PinarmError):
                error.at(self._here())  # at once: what uses this text is not where the mistake is
            raise
        finally:
            self.depth -= 2
        result = parts[0] if len(parts) == 1 else "".join(map(str, parts))
        if isinstance(result, str):
            bound("characters in one evaluated text", len(result), MAX_TEXT)
            self._spend(len(result) // 100)
        return result

    def _evaluated(self, text: str, symbols: Any) -> Iterator[Any]:
        position = 0
        while position < len(text):
            self._spend()
            match = _TOKEN.match(text, position)
            if match is None:
                raise ModelError(f"a brace is not closed: '{text[position : position + 40]}'")
            escaped, expression, substitution, other = match.groups()
            if expression is not None:
                names = Names(symbols, self.xacro.NameSpace)
                inner = self.eval_text(expression, symbols)
                yield evaluate(inner, Scalars(names)) if self.tape is None else self.tape.evaluate(inner, names)
            elif substitution is not None:
                yield self._substitute(str(self.eval_text(substitution, symbols)))
            else:
                yield escaped or other
            position = match.end()

    def _substitute(self, text: str) -> str:
        """Return the value of ``$(arg NAME)``, or for ``$(find PACKAGE)`` the URI of the package."""
        command, _, name = text.strip().partition(" ")
        name = name.strip()
        if command == "find" and name:  # no package is looked for, and only includes would read a file of it
            return f"package://{name}"
        if command != "arg":
            raise ModelError(f"'$({text[:60]})' is not allowed", expected="$(arg NAME) or $(find PACKAGE)")
        if name not in self.arguments:
            expected, hint = choices(name, self.arguments, most=40)
            raise ModelError(f"unknown argument '{name[:60]}'", expected=expected, hint=hint)
        self.declared[name] = None
        return self.arguments[name]

    def get_include_files(self, filename_spec: str, symbols: Any) -> Iterator[str]:
        """Yield the file to include, once it is checked to lie in an allowed folder."""
        name = str(self.eval_text(filename_spec, symbols))
        if any(character in name for character in ("*?[" + OPEN)):
            raise ModelError(f"'{name[:60]}' has wildcards", expected="the name of one file")
        base = "" if "://" in name else Path(self.xacro.filestack[-1]).parent
        wanted = str(base / Path(name)) if base else name
        path = self.includes[wanted] = str(contained_path(wanted, self.root))
        if path in self.xacro.filestack:
            raise ModelError(f"the file '{name}' includes itself")
        yield path

    def is_valid_name(self, name: str) -> bool:
        """Return whether a property may have this name, without parsing it."""
        return name.isidentifier() and not keyword.iskeyword(name)

    def warning(self, *texts: Any, **_: Any) -> None:
        """Keep a warning for the result, not for the terminal."""
        if len(self.warnings) < MANY:
            self.warnings.append(" ".join(str(text) for text in texts)[:200])

    def print_location(self) -> None:
        """Say nothing: errors carry their place."""


class _Copies(ValueRecord, frozen=True):
    """Counts the copies of elements and gives them the locations of these."""

    spend: Callable[[int], None]

    def handle(self, operation: int, key: str, data: Any, src: Any, dst: Node) -> None:
        """Be called by the DOM for each copy."""
        self.spend(1 + len(src.attributes))
        dst.setUserData(key, data, self)


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text[:300]


def _version(site: Path) -> str:
    """Return the version of the xacro in a folder, which its name says (importlib.metadata takes 20 ms)."""
    names = [name for name in os.listdir(site) if name.startswith("xacro-") and name.endswith(".dist-info")]
    return names[0].removeprefix("xacro-").removesuffix(".dist-info") if len(names) == 1 else "of unknown version"


def _literal(plain: Callable[[Any], Any], value: Any) -> Any:
    """Turn text into the number that it is, as xacro does; but digits of other scripts are text."""
    return value if isinstance(value, str) and not value.isascii() and value[0] != "'" else plain(value)


@cache
def private_xacro() -> tuple[ModuleType, dict[str, Any]]:
    """Load a private copy of xacro; return it with those of its functions that are replaced.

    Raises:
        ModelError: It is missing, or not version 2.1, for which the replacements are written.
    """
    from xml.dom import minidom

    spec, hint = importlib.util.find_spec("xacro"), "pip install 'xacro==2.1.*'"
    if spec is None or spec.origin is None:
        raise ModelError("xacro files need the package xacro", hint=hint)
    version = _version(Path(spec.origin).parents[1])
    if not version.startswith("2.1."):
        raise ModelError(f"xacro {version} is not known to be contained", expected="version 2.1", hint=hint)
    folders = spec.submodule_search_locations
    spec = importlib.util.spec_from_file_location("_pinarm_xacro", spec.origin, submodule_search_locations=folders)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    command_line: Any = ModuleType(f"{spec.name}.cli")  # which nobody needs, and which imports much
    command_line.process_args = None
    sys.modules[command_line.__name__] = command_line
    writexml = minidom.Element.writexml
    try:
        spec.loader.exec_module(module)
    finally:
        minidom.Element.writexml = writexml  # type: ignore[method-assign]  # which xacro replaces for everyone
    if missing := [name for name in _NEEDED if not hasattr(module, name)]:
        raise ModelError(f"this xacro {version} has no {missing[0]}: it is not known to be contained", hint=hint)
    module.Table._eval_literal = staticmethod(partial(_literal, module.Table._eval_literal))
    vars(module).update(dict.fromkeys(_DISARMED), re_macro_arg=_MACRO_PARAMETER, _global_symbols={})
    return module, {name: getattr(module, name) for name in OURS}


class Writer:
    """Writer of a tree in xacro's format, with a bound on its size."""

    def __init__(self) -> None:
        self.parts: list[str] = []
        self.size = 0

    def document(self, document: Document) -> str:
        """Return the text of a document."""
        self.write('<?xml version="1.0" ?>\n')
        for node in document.childNodes:
            self._node(node, "")
        return "".join(self.parts)

    def write(self, text: str) -> None:
        """Append a piece of text."""
        self.size += len(text)
        bound("characters", self.size, MAX_BYTES)
        self.parts.append(text)

    def _node(self, node: Any, indent: str) -> None:
        if node.nodeType == node.ELEMENT_NODE:
            self._element(node, indent)
        elif node.nodeType != node.TEXT_NODE or node.data.strip():
            node.writexml(self, indent, "  ", "\n")

    def _element(self, element: Any, indent: str) -> None:
        children = element.childNodes
        self.write(f"{indent}<{element.tagName}")
        for name, value in sorted(element.attributes.items()):
            self.write(f' {name}="{str(value).translate(_ATTRIBUTE)}"')
        if not children:
            self.write("/>\n")
        elif len(children) == 1 and children[0].nodeType == element.TEXT_NODE:
            self.write(">")
            children[0].writexml(self)
            self.write(f"</{element.tagName}>\n")
        else:
            self.write(">\n")
            for child in children:
                self._node(child, indent + "  ")
            self.write(f"{indent}</{element.tagName}>\n")


_ATTRIBUTE = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\r": "&#13;", "\n": "&#10;", "\t": "&#9;"}
)
