"""From a URDF or xacro file to plain URDF text, for files from strangers.

xacro evaluates Python, reads any file and can be made to run for ever. So a private copy of it is loaded, beside the
one a user may import, and while a file is expanded the functions of that copy that evaluate, read or recurse are ours:
expressions are the checked arithmetic of ``expressions``, only ``$(arg NAME)`` and ``$(find PACKAGE)`` are substituted,
included files lie under the root, and every step counts against a budget. Honest files come out as xacro gives them.
"""

from __future__ import annotations

import importlib.util
import keyword
import math
import operator
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

from pinarm.errors import ExpressionError, InputError, Location, ModelError, PinarmError, choices
from pinarm.input.expressions import MANY, MAX_INTEGER, Grammar, interpret, look_up, read_tree
from pinarm.input.roots import NO_PACKAGES, contained, inside

if TYPE_CHECKING:
    from xml.dom.minidom import Document, Element, Node

MAX_BYTES = 2_000_000
"""Of all files of a model together, and of its expansion; the largest robot of example-robot-data has 0.2 MB."""
MAX_ELEMENTS = 50_000
"""Largest robot of example-robot-data: 3900."""
MAX_COMMENTS = 5000
"""Largest robot of example-robot-data: 237; xacro takes time quadratic in their number."""
MAX_LINKS = 2000
"""Links, and joints as well; Pinocchio's parser recurses along chains and crashes at 10,000."""
MAX_DEPTH = 100
"""Of XML and of macros in macros; of properties that use properties half as many."""
MAX_TEXT = 10_000
"""Characters of one attribute or one evaluated text."""
MAX_STEPS = 200_000
"""Evaluations and nodes copied."""
MAX_SECONDS = 5.0
"""A backstop: the tree takes time quadratic in the number of siblings."""

_LOCK = threading.Lock()


@dataclass(frozen=True)
class Expansion:
    """A model as plain URDF.

    Attributes:
        xml: The text.
        arguments: Every ``xacro:arg`` with its value, given or default.
        warnings: What xacro found odd, such as attributes it does not know.
    """

    xml: str
    arguments: dict[str, str]
    warnings: tuple[str, ...] = ()


def expand(
    path: Path, arguments: Mapping[str, float | str], *, root: Path, packages: Mapping[str, Path] = NO_PACKAGES
) -> Expansion:
    """Expand a xacro file; a plain URDF file is checked and comes back as it is.

    Args:
        path: The file.
        arguments: Values of its ``xacro:arg``, in place of the defaults.
        root: Folder under which the file and what it includes must lie.
        packages: Names of packages -> folders, under which included files may lie too.

    Raises:
        ModelError: The model is malformed, does something that is not allowed, or is too large.
        InputError: A file is missing or lies elsewhere, or an expression is wrong.
    """
    source = str(path)
    path = inside(path.absolute(), root, packages)
    text = _read(path, source, MAX_BYTES)
    survey = Survey.of(text, source)
    given = {name: _argument(name, value) for name, value in arguments.items()}
    if not survey.is_xacro and path.suffix != ".xacro":
        _check_declared(given, {}, source)
        return Expansion(text, {})
    expander = _Expander(root, packages, given, {str(path): source})
    xml = expander.run(path)
    Survey.of(xml, f"the expansion of {source}")
    _check_declared(given, expander.declared, source)
    return Expansion(xml, {name: given[name] for name in expander.declared}, tuple(expander.warnings))


def _argument(name: str, value: float | str) -> str:
    text = value if isinstance(value, str) else repr(int(value) if isinstance(value, int) else float(value))
    if text in ("nan", "inf", "-inf") or len(text) > MAX_TEXT:
        raise InputError(f"the argument '{name}' is {text[:20]}", expected="a finite number or a short text")
    return text


def _check_declared(given: Mapping[str, str], declared: Mapping[str, None], source: str) -> None:
    for name in sorted(given.keys() - declared.keys()):
        expected, hint = choices(name, declared, most=40)
        problem = ModelError(f"the model has no argument '{name}'", expected=expected, hint=hint)
        raise problem.at(Location(source))


def _read(path: Path, source: str, most: int) -> str:
    try:
        with open(path, "rb") as stream:
            raw = stream.read(most + 1)
        if len(raw) <= most:
            return raw.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"the file cannot be read as UTF-8 text ({error})").at(Location(source)) from None
    raise ModelError("the files of this model are too large", expected=f"at most {MAX_BYTES} bytes").at(
        Location(source)
    )


@dataclass
class Survey:
    """What a first reading of XML finds, without building anything, within the bounds.

    Attributes:
        source: File name, for errors.
        lines: Line of every element, in the order of the document.
        links: Number of links below the root element.
        joints: Number of joints below the root element.
        comments: Number of comments.
        is_xacro: Whether there is anything of xacro in it.
    """

    source: str
    lines: list[int] = field(default_factory=list)
    links: int = 0
    joints: int = 0
    comments: int = 0
    is_xacro: bool = False
    _depth: int = 0

    @classmethod
    def of(cls, text: str, source: str) -> Survey:
        """Read XML text.

        Raises:
            ModelError: It is malformed, has a DOCTYPE, or exceeds a bound.
        """
        survey, parser = cls(source), expat.ParserCreate()
        parser.StartElementHandler = lambda name, attributes: survey._start(name, attributes, parser)
        parser.EndElementHandler = survey._end
        parser.CommentHandler = survey._count_comment
        parser.StartDoctypeDeclHandler = survey._refuse_doctype
        try:
            parser.Parse(text, True)
        except expat.ExpatError as error:
            problem = ModelError(f"this is not XML: {expat.ErrorString(error.code)}")
            raise problem.at(_location(source, text, error.lineno, error.offset + 1)) from None
        except PinarmError as error:
            raise error.at(_location(source, text, parser.CurrentLineNumber)) from None
        except ValueError as error:
            raise ModelError(f"this is not XML: {error}").at(Location(source)) from None
        return survey

    def _start(self, name: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        self._depth += 1
        self.lines.append(parser.CurrentLineNumber)
        self.links += self._depth == 2 and name == "link"
        self.joints += self._depth == 2 and name == "joint"
        self.is_xacro |= name.startswith("xacro:") or any("xacro:" in key or key == "xmlns:xacro" for key in attributes)
        _bound("levels of XML", self._depth, MAX_DEPTH)
        _bound("elements", len(self.lines), MAX_ELEMENTS)
        _bound("links", self.links, MAX_LINKS)
        _bound("joints", self.joints, MAX_LINKS)
        _bound("characters in one attribute", max(map(len, attributes.values()), default=0), MAX_TEXT)

    def _end(self, name: str) -> None:
        self._depth -= 1

    def _count_comment(self, _: str) -> None:
        self.comments += 1
        _bound("comments", self.comments, MAX_COMMENTS)

    def _refuse_doctype(self, *_: object) -> None:
        raise ModelError("a model has no DOCTYPE and no entities", hint="remove the line that begins with <!DOCTYPE")


def _bound(what: str, number: int, most: int) -> None:
    if number > most:
        raise ModelError(f"the model has too many {what}", expected=f"at most {most}")


def _location(source: str, text: str, line: int, column: int = 0, width: int = 1) -> Location:
    lines = text.splitlines()
    excerpt = lines[line - 1] if 0 < line <= len(lines) else ""
    stripped = excerpt.strip()
    if not column:
        column, width = len(excerpt) - len(excerpt.lstrip()) + 1, max(1, len(stripped))
    return Location(source, line, column, excerpt, width)


_TOKEN = re.compile(r"\$(\$+[{(])|\$\{([^}]*)\}|\$\(([^)]*)\)|([^$]+|\$[^{($]+|\$$)")
"""As in xacro: an escaped brace, an expression, a substitution, other text."""
_MACRO_PARAMETER = re.compile(
    r"^\s*([^\s:=]+?)\s*:?=\s*(\^\|?)?(\$\{.*?\}|\$\(.*?\)|(?:'.*?'|\".*?\"|[^\s'\"]++)++|)(?:\s+|$)(.*)"
)
"""xacro's own, with possessive repetitions: as it stands there, an unbalanced quote takes exponential time."""
_DISARMED = ("open", "eval", "compile", "os", "glob", "load_yaml", "safe_eval", "eval_extension", "process_file")
"""Names of xacro that nothing should reach once ours are in place; should anything, it fails."""
_OURS = (
    "check_attrs", "eval_all", "eval_text", "get_include_files", "handle_macro_call", "is_valid_name", "parse",
    "print_location", "replace_node", "reqd_attrs", "warning",
)  # fmt: skip
_NEEDED = (
    *_OURS, "LEXER", "NameSpace", "Table", "XacroException", "_global_symbols", "all_includes", "filestack",
    "init_stacks", "macrostack", "process_doc", "process_include", "re_macro_arg", "root_dir",
    "substitution_args_context",
)  # fmt: skip


def _version(site: Path) -> str:
    """Return the version of the xacro installed in a folder; its name says it (importlib.metadata takes 20 ms)."""
    names = [folder.name for folder in site.glob("xacro-*.dist-info")]
    return names[0].removeprefix("xacro-").removesuffix(".dist-info") if len(names) == 1 else "of unknown version"


@cache
def _xacro() -> tuple[ModuleType, dict[str, Any]]:
    """Load a copy of xacro for ourselves; return it with its functions that ours will stand in for.

    Raises:
        ModelError: It is missing, or not the version whose inside we know.
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
    writexml = minidom.Element.writexml
    try:
        spec.loader.exec_module(module)
    finally:
        minidom.Element.writexml = writexml  # type: ignore[method-assign]  # which xacro replaces for everyone
    if missing := [name for name in _NEEDED if not hasattr(module, name)]:
        raise ModelError(f"this xacro {version} has no {missing[0]}: it is not known to be contained", hint=hint)
    vars(module).update(dict.fromkeys(_DISARMED), re_macro_arg=_MACRO_PARAMETER, _global_symbols={})
    return module, {name: getattr(module, name) for name in _OURS}


class _Expander:
    """One expansion: the functions that stand in for xacro's own, and what they count and remember.

    Args:
        root: Folder of the files that may be read.
        packages: Packages whose files may be read too.
        arguments: Values of arguments; xacro adds the defaults.
        sources: Path of a file -> its name in messages.
    """

    def __init__(
        self, root: Path, packages: Mapping[str, Path], arguments: dict[str, str], sources: dict[str, str]
    ) -> None:
        self.root, self.packages, self.arguments, self.sources = root, packages, arguments, sources
        with _LOCK:  # loading it is not for two at once either
            self.xacro, self.plain = _xacro()
        self.declared: dict[str, None] = {}
        self.warnings: list[str] = []
        self.texts: dict[str, str] = {}
        self.element: Element | None = None
        self.snippet = ""
        self.depth = self.steps = self.size = 0
        self.deadline = time.monotonic() + MAX_SECONDS

    def run(self, path: Path) -> str:
        """Return the expanded text; whatever goes wrong is a located ``PinarmError``."""
        xacro = self.xacro
        with _LOCK:
            vars(xacro).update({name: getattr(self, name) for name in _OURS})
            try:
                xacro.init_stacks(str(path))
                document = self.parse(None, str(path))
                xacro.process_doc(document, mappings=self.arguments)
                return _Writer().document(document)
            except PinarmError as error:
                raise error.at(self._here()) from None
            except Exception as error:  # xacro raises whatever Python does where a file surprises it
                raise ModelError(_one_line(error) + self._macros()).at(self._here()) from None
            finally:
                vars(xacro).update(self.plain, filestack=None, macrostack=None, all_includes=[])
                xacro.substitution_args_context.clear()

    def _here(self) -> Location:
        """Return where the evaluation stands: the text that failed, else the element."""
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
            return _location(self.sources.get(path, path), self.texts[path], line, column, len(self.snippet))
        return _location(self.sources.get(path, path), self.texts.get(path, ""), line)

    def _macros(self) -> str:
        names = [macro.body.getAttribute("name") for macro in self.xacro.macrostack[-5:]]
        return f" (in macro {' > '.join(names)})" if names else ""

    def _spend(self, steps: int = 1) -> None:
        self.steps += steps
        if self.steps > MAX_STEPS or time.monotonic() > self.deadline:
            raise ModelError("the expansion does not come to an end", hint="fewer macros, properties and elements")

    def _descend(self, levels: int = 1) -> None:
        self.depth += levels
        if self.depth > MAX_DEPTH:
            hint = "a macro, an include or a property that does not use itself"
            raise ModelError(f"the model is nested more than {MAX_DEPTH} levels deep{self._macros()}", hint=hint)

    # What follows stands in for functions of xacro and bears their names.

    def parse(self, _: None, filename: str) -> Document:
        """Read a file into a tree whose elements know their places and whose copies are counted."""
        from xml.dom import minidom

        path, source = Path(filename), self.sources.setdefault(filename, filename)
        if not path.exists():
            self.xacro.filestack.pop()  # as xacro does: where an include is optional, it goes on from here
            raise self.xacro.XacroException(f"there is no file {filename}", exc=FileNotFoundError())
        text = _read(inside(path, self.root, self.packages), source, MAX_BYTES - self.size)
        self.size += len(text)
        self.texts[filename] = text
        lines = Survey.of(text, source).lines
        document = minidom.parseString(text)
        for element, line in zip(document.getElementsByTagName("*"), lines, strict=True):
            element.setUserData("place", (filename, line), _KEEP)
        self._count_copies(document)
        return document

    def _count_copies(self, document: Document) -> None:
        def counted(create: Callable[..., Any]) -> Callable[..., Any]:
            def created(*arguments: Any) -> Any:
                self._spend()
                return create(*arguments)

            return created

        for name in ("createElementNS", "createTextNode", "createComment"):
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
        """Expand an element if it is a macro's, and tell whether it is."""
        if not node.tagName.startswith("xacro:"):
            return False
        self.element = node
        return bool(self.plain["handle_macro_call"](node, macros, symbols))

    def replace_node(self, node: Element, by: Any, content_only: bool = False) -> None:
        """Put trees, or what is in them, in the place of an element; it takes xacro time quadratic in their number."""
        parent: Any = node.parentNode
        for tree in by if isinstance(by, list) else [by] if by is not None else []:
            for child in list(tree.childNodes) if content_only else [tree]:
                self._spend()
                parent.insertBefore(child, node)
        parent.removeChild(node)

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
            _bound("characters in one evaluated text", len(result), MAX_TEXT)
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
                yield _evaluate(self.eval_text(expression, symbols), _Names(symbols, self.xacro.NameSpace))
            elif substitution is not None:
                yield self._substitute(str(self.eval_text(substitution, symbols)))
            else:
                yield escaped or other
            position = match.end()

    def _substitute(self, text: str) -> str:
        """Return what ``$(arg NAME)`` and ``$(find PACKAGE)`` stand for; there are no others."""
        command, _, name = text.strip().partition(" ")
        tables = {"arg": self.arguments, "find": {package: str(path) for package, path in self.packages.items()}}
        if command not in tables:
            raise ModelError(f"'$({text[:60]})' is not allowed", expected="$(arg NAME) or $(find PACKAGE)")
        name = name.strip()
        if name not in tables[command]:
            expected, hint = choices(name, tables[command], most=40)
            what = "argument" if command == "arg" else "package"
            raise ModelError(f"unknown {what} '{name[:60]}'", expected=expected, hint=hint)
        if command == "arg":
            self.declared[name] = None
        return tables[command][name]

    def get_include_files(self, filename_spec: str, symbols: Any) -> Iterator[str]:
        """Yield the file to include, once it is known to lie where it may."""
        name = str(self.eval_text(filename_spec, symbols))
        if any(character in name for character in "*?["):
            raise ModelError(f"'{name[:60]}' has wildcards", expected="the name of one file")
        base = "" if "://" in name else Path(self.xacro.filestack[-1]).parent
        path = str(contained(base / Path(name) if base else name, self.root, self.packages))
        if path in self.xacro.filestack:
            raise ModelError(f"the file '{name}' includes itself")
        yield path

    def is_valid_name(self, name: str) -> bool:
        """Tell whether a property may have this name, without parsing it."""
        return name.isidentifier() and not keyword.iskeyword(name)

    def warning(self, *texts: Any, **_: Any) -> None:
        """Keep a warning for the result, not for the terminal."""
        if len(self.warnings) < MANY:
            self.warnings.append(" ".join(str(text) for text in texts)[:200])

    def print_location(self) -> None:
        """Say nothing: errors carry their place."""


class _Keep:
    """Hands the place of an element on to its copies."""

    def handle(self, operation: int, key: str, data: Any, src: Node, dst: Node) -> None:
        """Be called by the DOM for each copy."""
        dst.setUserData(key, data, self)


_KEEP = _Keep()


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text[:300]


class _Writer:
    """Writes a tree as xacro does, within a bound."""

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
        """Take a piece of text."""
        self.size += len(text)
        _bound("characters", self.size, MAX_BYTES)
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


def _evaluate(text: str, names: Mapping[str, Any]) -> Any:
    """Evaluate an expression of xacro."""
    return interpret(read_tree(text, _GRAMMAR), _Scalars(names), text)


class _Names(Mapping[str, Any]):
    """The properties in reach; ``a.b`` is property ``b`` of namespace ``a``."""

    def __init__(self, symbols: Any, namespace: type) -> None:
        self.symbols, self.namespace = symbols, namespace

    def _home(self, name: str) -> tuple[Mapping[str, Any], str]:
        *spaces, last = name.split(".")
        table = self.symbols
        for space in spaces:
            if space not in table or not isinstance(table[space], self.namespace):
                return {}, last
            table = table[space]
        return table, last

    def __getitem__(self, name: str) -> Any:
        table, last = self._home(name)
        return table[last]

    def __contains__(self, name: object) -> bool:
        table, last = self._home(str(name))
        return last in table

    def __iter__(self) -> Iterator[str]:
        table = self.symbols
        while table:
            yield from (name for name in dict.keys(table) if name.isidentifier())
            table = getattr(table, "parent", None)

    def __len__(self) -> int:
        return sum(1 for _ in self)


@dataclass(frozen=True)
class _Scalars:
    """The algebra of xacro: Python's numbers, texts and truth values, of bounded size."""

    names: Mapping[str, Any]

    def constant(self, value: Any) -> Any:
        return value

    def name(self, name: str) -> Any:
        return _bounded(look_up(name, self.names, _CONSTANTS))

    def unary(self, symbol: str, operand: Any) -> Any:
        return _applied(_UNARY[symbol], operand)

    def binary(self, symbol: str, left: Any, right: Any) -> Any:
        if isinstance(left, str) != isinstance(right, str) or (isinstance(left, str) and symbol != "+"):
            raise ExpressionError(f"'{symbol}' does not go with text", expected="numbers, or text + text")
        if symbol == "**" and isinstance(left, int) and isinstance(right, int) and left.bit_length() * right > 64:
            raise ExpressionError("the power is too large", expected="a value below 2**64")
        return _applied(_OPERATIONS[symbol], left, right)

    def compare(self, symbols: Sequence[str], operands: Sequence[Any]) -> Any:
        pairs = zip(symbols, operands, operands[1:], strict=False)
        return all(_applied(_OPERATIONS[symbol], left, right) for symbol, left, right in pairs)

    def logic(self, symbol: str, operands: Sequence[Callable[[], Any]]) -> Any:
        result = operands[0]()
        for operand in operands[1:]:
            if bool(result) == (symbol == "or"):
                break
            result = operand()
        return result

    def choose(self, test: Any, then: Callable[[], Any], otherwise: Callable[[], Any]) -> Any:
        return then() if test else otherwise()

    def call(self, function: str, arguments: Sequence[Any]) -> Any:
        return _applied(_FUNCTIONS[function][0], *arguments)


def _applied(function: Callable[..., Any], *operands: Any) -> Any:
    try:
        value = function(*operands)
    except (ArithmeticError, TypeError, ValueError) as error:
        raise ExpressionError(f"this cannot be computed ({error})") from None
    return _bounded(value)


def _bounded(value: Any) -> Any:
    if not isinstance(value, int | float | str):
        raise ExpressionError(f"a {type(value).__name__} is no value of a model", expected="a number or a text")
    if isinstance(value, int) and abs(value) >= MAX_INTEGER:
        raise ExpressionError("the value is too large", expected="a value below 2**64")
    if isinstance(value, str) and len(value) > MAX_TEXT:
        raise ExpressionError("the text is too long", expected=f"at most {MAX_TEXT} characters")
    return value


def _round(value: float, digits: int = 0) -> float:
    return round(value, max(-20, min(20, digits))) if digits else round(value)


_UNARY: Mapping[str, Callable[[Any], Any]] = {"+": operator.pos, "-": operator.neg, "not": operator.not_}
_OPERATIONS: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "//": operator.floordiv,
    "%": operator.mod, "**": operator.pow, "==": operator.eq, "!=": operator.ne, "<": operator.lt, "<=": operator.le,
    ">": operator.gt, ">=": operator.ge,
}  # fmt: skip

_ONE_ARGUMENT = (
    math.sin, math.cos, math.tan, math.asin, math.acos, math.atan, math.sinh, math.cosh, math.tanh, math.asinh,
    math.acosh, math.atanh, math.sqrt, math.exp, math.log2, math.log10, math.fabs, math.floor, math.ceil, math.trunc,
    math.radians, math.degrees, math.isnan, math.isinf, math.isfinite,
)  # fmt: skip
_MATH: dict[str, tuple[Callable[..., Any], int, int]] = {
    **{function.__name__: (function, 1, 1) for function in _ONE_ARGUMENT},
    "atan2": (math.atan2, 2, 2), "copysign": (math.copysign, 2, 2), "fmod": (math.fmod, 2, 2), "pow": (math.pow, 2, 2),
    "log": (math.log, 1, 2), "hypot": (math.hypot, 2, MANY),
}  # fmt: skip
_PYTHON: dict[str, tuple[Callable[..., Any], int, int]] = {
    "abs": (abs, 1, 1), "min": (min, 2, MANY), "max": (max, 2, MANY), "round": (_round, 1, 2), "len": (len, 1, 1),
    "int": (int, 1, 1), "float": (float, 1, 1), "str": (str, 1, 1), "bool": (bool, 1, 1),
}  # fmt: skip
_FUNCTIONS = {
    **_MATH, **_PYTHON, **{f"math.{name}": entry for name, entry in _MATH.items()},
    **{f"python.{name}": entry for name, entry in _PYTHON.items()},
}  # fmt: skip
_PLAIN_CONSTANTS = {name: getattr(math, name) for name in ("pi", "e", "tau", "inf", "nan")}
_CONSTANTS = {**_PLAIN_CONSTANTS, **{f"math.{name}": value for name, value in _PLAIN_CONSTANTS.items()}}
_GRAMMAR = Grammar((int, float, str, bool), {name: arity for name, (_, *arity) in _FUNCTIONS.items()})  # type: ignore[misc]
