"""XML text of models: bounds on its size, elements that know their lines, and includes of MJCF."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from pinarm.errors import InputError, Location, ModelError, PinarmError
from pinarm.input.roots import contained_file

MAX_BYTES = 4_000_000
"""Largest size of all files of a model together, and of its expansion; example-robot-data has at most 0.2 MB."""
MAX_ELEMENTS = 100_000
"""The largest robot of example-robot-data has 3900."""
MAX_LINKS = 6000
"""Largest number of links, and of joints; Pinocchio's parser recurses along chains and crashes at 10,000."""
MAX_DEPTH = 100
"""Largest depth of XML, and of nested macros; of properties that use properties half of it."""
MAX_TEXT = 10_000
"""Largest number of characters of one attribute or one evaluated text."""


class Element(ElementTree.Element):
    """An element of a model file.

    Attributes:
        source: Name of its file in messages.
        line: Line of the file in which it begins; 0 for an element that no file has.
    """

    source = ""
    line = 0


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


def tree_of(text: str, source: str = "the model") -> Element:
    """Return the root element of XML text; messages call the text ``source``.

    Names keep their prefixes as written, declared or not, and namespaces without a prefix are ignored: the readers of
    ROS, Gazebo and MuJoCo take names so.

    Raises:
        ModelError: It is malformed, has a DOCTYPE, or exceeds a bound.
    """
    builder, parser, counts = ElementTree.TreeBuilder(element_factory=Element), expat.ParserCreate(), Counter[str]()

    def start(name: str, attributes: dict[str, str]) -> None:
        counts["elements"] += 1
        counts["levels of XML"] += 1
        if counts["levels of XML"] == 2 and name in ("link", "joint"):
            counts[f"{name}s"] += 1
            bound(f"{name}s", counts[f"{name}s"], MAX_LINKS)
        bound("levels of XML", counts["levels of XML"], MAX_DEPTH)
        bound("elements", counts["elements"], MAX_ELEMENTS)
        bound("characters in one attribute", max(map(len, attributes.values()), default=0), MAX_TEXT)
        element = builder.start(name, attributes)
        assert isinstance(element, Element)
        element.source, element.line = source, parser.CurrentLineNumber

    def end(name: str) -> None:
        counts["levels of XML"] -= 1
        builder.end(name)

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, builder.data
    parser.StartDoctypeDeclHandler = _refuse_doctype
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        problem = ModelError(f"this is not XML: {expat.ErrorString(error.code)}")
        raise problem.at(location(source, text, error.lineno, error.offset + 1)) from None
    except PinarmError as error:
        raise error.at(location(source, text, parser.CurrentLineNumber)) from None
    except ValueError as error:
        raise ModelError(f"this is not XML: {error}").at(Location(source)) from None
    root = builder.close()
    assert isinstance(root, Element)
    return root


def _refuse_doctype(*_: object) -> None:
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


def location_of(element: Element, text: str, word: str = "") -> Location:
    """Return the place of an element in the text of its file, or of the first ``word`` from its line on."""
    lines = text.splitlines()
    for number, line in enumerate(lines[element.line - 1 :], element.line) if word else ():
        if (column := line.find(word) + 1) > 0:
            return location(element.source, text, number, column, len(word))
    return location(element.source, text, element.line)


def resolve_includes(text: str, path: Path, root: Path) -> str:
    """Return MJCF text with the content of its included files; any other text is returned unchanged.

    Args:
        text: Text of the file.
        path: The file; included files are relative to its folder.
        root: Folder under which they must lie; they count against the bounds of size.

    Raises:
        ModelError: A file is malformed, too large, or included twice (also by including itself).
        InputError: A file is missing or lies elsewhere.
    """
    if "<include" not in text or (model := tree_of(text, str(path))).tag != "mujoco":
        return text
    included, size = {path.resolve()}, len(text)
    waiting: list[ElementTree.Element] = [model]
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
            parent[place : place + 1] = list(tree_of(content, name))
            waiting.append(parent)  # whose children have changed
            break
    flat = ElementTree.tostring(model, encoding="unicode")
    tree_of(flat, f"{path} with what it includes")
    return flat
