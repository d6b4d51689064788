"""XML text of models: a bounded survey before a tree is built from it, and a bounded writer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

from msgspec import Struct, field

from pinarm.errors import InputError, Location, ModelError, PinarmError

if TYPE_CHECKING:
    from xml.dom.minidom import Document

MAX_BYTES = 4_000_000
"""Largest size of all files of a model together, and of its expansion; example-robot-data has at most 0.2 MB."""
MAX_ELEMENTS = 100_000
"""The largest robot of example-robot-data has 3900."""
MAX_COMMENTS = 5000
"""The largest robot of example-robot-data has 237; xacro takes time quadratic in their number."""
MAX_LINKS = 6000
"""Largest number of links, and of joints; Pinocchio's parser recurses along chains and crashes at 10,000."""
MAX_DEPTH = 100
"""Largest depth of XML, and of nested macros; of properties that use properties half of it."""
MAX_TEXT = 10_000
"""Largest number of characters of one attribute or one evaluated text."""


def read(path: Path, source: str, most: int) -> str:
    """Return the text of a file of a model.

    Args:
        path: The file.
        source: Its name in messages.
        most: Largest size in bytes.

    Raises:
        InputError: It cannot be read, or is not UTF-8.
        ModelError: It is too large.
    """
    try:
        with open(path, "rb") as stream:
            raw = stream.read(most + 1)
        if len(raw) <= most:
            return raw.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"the file cannot be read as UTF-8 text ({reason})").at(Location(source)) from None
    raise ModelError("the files of this model are too large", expected=f"at most {MAX_BYTES} bytes").at(
        Location(source)
    )


class Survey(Struct):
    """Counts from a first pass over XML text, which builds nothing and stops at the bounds.

    Attributes:
        source: File name, for errors.
        lines: Line of every element, in the order of the document.
        links: Number of links below the root element.
        joints: Number of joints below the root element.
        comments: Number of comments.
        is_xacro: Whether it contains anything of xacro; files that xacro has written declare its namespace, no more.
    """

    source: str
    lines: list[int] = field(default_factory=list)
    links: int = 0
    joints: int = 0
    comments: int = 0
    is_xacro: bool = False
    _has_expressions: bool = False
    _depth: int = 0

    @classmethod
    def of(cls, text: str, source: str) -> Survey:
        """Read XML text.

        Raises:
            ModelError: It is malformed, has a DOCTYPE, or exceeds a bound.
        """
        survey, parser = cls(source, _has_expressions="$" in text or "&#" in text), expat.ParserCreate()
        parser.StartElementHandler = lambda name, attributes: survey._start(name, attributes, parser)
        parser.EndElementHandler = survey._end
        parser.CommentHandler = survey._count_comment
        parser.StartDoctypeDeclHandler = survey._refuse_doctype
        try:
            parser.Parse(text, True)
        except expat.ExpatError as error:
            problem = ModelError(f"this is not XML: {expat.ErrorString(error.code)}")
            raise problem.at(location(source, text, error.lineno, error.offset + 1)) from None
        except PinarmError as error:
            raise error.at(location(source, text, parser.CurrentLineNumber)) from None
        except ValueError as error:
            raise ModelError(f"this is not XML: {error}").at(Location(source)) from None
        return survey

    def _start(self, name: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        self._depth += 1
        self.lines.append(parser.CurrentLineNumber)
        self.links += self._depth == 2 and name == "link"
        self.joints += self._depth == 2 and name == "joint"
        self.is_xacro |= name.startswith("xacro:") or any(
            key.startswith("xacro:") or (self._has_expressions and key == "xmlns:xacro") for key in attributes
        )
        bound("levels of XML", self._depth, MAX_DEPTH)
        bound("elements", len(self.lines), MAX_ELEMENTS)
        bound("links", self.links, MAX_LINKS)
        bound("joints", self.joints, MAX_LINKS)
        bound("characters in one attribute", max(map(len, attributes.values()), default=0), MAX_TEXT)

    def _end(self, name: str) -> None:
        self._depth -= 1

    def _count_comment(self, _: str) -> None:
        self.comments += 1
        bound("comments", self.comments, MAX_COMMENTS)

    def _refuse_doctype(self, *_: object) -> None:
        raise ModelError("a model has no DOCTYPE and no entities", hint="remove the line that begins with <!DOCTYPE")


def bound(what: str, number: int, most: int) -> None:
    """Raise where there are too many of something.

    Raises:
        ModelError: Says how many there may be.
    """
    if number > most:
        raise ModelError(f"the model has too many {what}", expected=f"at most {most}")


def location(source: str, text: str, line: int, column: int = 0, width: int = 1) -> Location:
    """Return a location in a text; the whole line where no column is given."""
    lines = text.splitlines()
    excerpt = lines[line - 1] if 0 < line <= len(lines) else ""
    stripped = excerpt.strip()
    if not column:
        column, width = len(excerpt) - len(excerpt.lstrip()) + 1, max(1, len(stripped))
    return Location(source, line, column, excerpt, width)


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
