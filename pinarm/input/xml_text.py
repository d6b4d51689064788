"""XML text of models: bounds on its size, the tree of its elements, and includes of MJCF."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

from msgspec import Struct, field

from pinarm.errors import InputError, Location, ModelError, PinarmError
from pinarm.input.roots import contained_file

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
    """Return the text of a model file that has at most ``most`` bytes; messages call it ``source``.

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
    problem = ModelError("the files of this model are too large", expected=f"at most {MAX_BYTES} bytes")
    raise problem.at(Location(source))


def tree_of(text: str) -> Element:
    """Return the root element of a text.

    Names keep their prefixes as written, declared or not, and namespaces without a prefix are ignored: the readers of
    ROS, Gazebo and MuJoCo take names so.

    Raises:
        ModelError: It is not XML.
    """
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise ModelError(f"the model is not XML: {error}") from None
    return builder.close()


class Survey(Struct):
    """Counts from a first pass over XML text, which builds nothing and stops at the bounds.

    Attributes:
        lines: Line of every element, in the order of the document.
        is_xacro: Whether it contains anything of xacro; files that xacro has written declare its namespace, no more.
    """

    lines: list[int] = field(default_factory=list)
    is_xacro: bool = False
    _counts: dict[str, int] = field(default_factory=lambda: {"link": 0, "joint": 0, "comment": 0})
    _has_expressions: bool = False
    _depth: int = 0

    @classmethod
    def of(cls, text: str, source: str) -> Survey:
        """Read XML text.

        Raises:
            ModelError: It is malformed, has a DOCTYPE, or exceeds a bound.
        """
        survey, parser = cls(_has_expressions="$" in text or "&#" in text), expat.ParserCreate()
        parser.StartElementHandler = lambda name, attributes: survey._start(name, attributes, parser)
        parser.EndElementHandler = survey._end
        parser.CommentHandler = lambda _: survey._count("comment", "comments", MAX_COMMENTS)
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
        self.is_xacro |= name.startswith("xacro:") or any(
            key.startswith("xacro:") or (self._has_expressions and key == "xmlns:xacro") for key in attributes
        )
        bound("levels of XML", self._depth, MAX_DEPTH)
        bound("elements", len(self.lines), MAX_ELEMENTS)
        bound("characters in one attribute", max(map(len, attributes.values()), default=0), MAX_TEXT)
        if self._depth == 2 and name in ("link", "joint"):
            self._count(name, f"{name}s", MAX_LINKS)

    def _count(self, what: str, words: str, most: int) -> None:
        self._counts[what] += 1
        bound(words, self._counts[what], most)

    def _end(self, name: str) -> None:
        self._depth -= 1

    def _refuse_doctype(self, *_: object) -> None:
        raise ModelError("a model has no DOCTYPE and no entities", hint="remove the line that begins with <!DOCTYPE")


def bound(what: str, number: int, most: int) -> None:
    """Raise a ``ModelError`` where there are more than ``most`` of something."""
    if number > most:
        raise ModelError(f"the model has too many {what}", expected=f"at most {most}")


def location(source: str, text: str, line: int, column: int = 0, width: int = 1) -> Location:
    """Return a location in a text; the whole line where no column is given."""
    lines = text.splitlines()
    excerpt = lines[line - 1] if 0 < line <= len(lines) else ""
    if not column:
        column, width = len(excerpt) - len(excerpt.lstrip()) + 1, max(1, len(excerpt.strip()))
    return Location(source, line, column, excerpt, width)


def resolve_includes(text: str, path: Path, root: Path) -> str:
    """Return MJCF text with the content of its included files; any other text is returned unchanged.

    Args:
        text: Text of the file, within the bounds of ``Survey``.
        path: The file; included files are relative to its folder.
        root: Folder under which they must lie; they count against the bounds of size.

    Raises:
        ModelError: A file is malformed, too large, or included twice (also by including itself).
        InputError: A file is missing or lies elsewhere.
    """
    if "<include" not in text or (model := tree_of(text)).tag != "mujoco":
        return text
    included, size, waiting = {path.resolve()}, len(text), [model]
    while waiting:
        parent = waiting.pop()
        for place, element in enumerate(parent):
            if element.tag != "include":
                waiting.append(element)
                continue
            name = element.get("file", "")
            file = contained_file(path.parent.absolute() / name, root)
            if file in included:
                problem = ModelError(f"the file '{name}' is included twice", expected="each file once")
                raise problem.at(Location(str(path)))
            included.add(file)
            content = read(file, name, MAX_BYTES - size)
            size += len(content)
            Survey.of(content, name)
            parent[place : place + 1] = list(tree_of(content))
            waiting.append(parent)  # whose children have changed
            break
    flat = ElementTree.tostring(model, encoding="unicode")
    Survey.of(flat, f"{path} with what it includes")
    return flat
