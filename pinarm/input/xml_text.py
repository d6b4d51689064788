"""XML of models: bounds on its size, elements that know their lines, names compared with those of a format.

One rule for names at every level. A misprint of a known name is refused with the name that may be meant: a reader that
asks for known names would take ``<orign xyz="1 0 0"/>`` for no origin. Any other unknown name is an extension: it is
counted, and listed as not read. Names with a prefix belong to other formats.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from pinarm.errors import LISTED, SHOWN, InputError, Location, ModelError, PinarmError, choices, several
from pinarm.input.roots import contained_file
from pinarm.records import ValueRecord

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
        line: Line of the file in which it begins; 0 for an element that no file has.
    """

    source = ""
    line = 0


def read(path: Path, source: str, most: int) -> str:
    """Return the text of a model file that has at most ``most`` bytes; messages call it ``source``."""
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
        path: The file; included files are relative to its folder.
        root: Folder under which they must lie; they count against the bounds of size.
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


SHORT = 5
"""Letters of a name up to which one mistake makes a misprint; two in longer names."""

TextTable = Mapping[str, str]
"""Kind of element -> its attributes, then, after ``>``, the elements in it.

``tag`` stands in it once at most, ``tag*`` any number of times, ``tag-`` has no part in what is computed and is not
examined. ``tag=kind`` names its kind where that is not the tag; an element whose kind has no entry has text only.
"""


class Kind(ValueRecord, frozen=True):
    """Names in one kind of element.

    Attributes:
        children: Tags of the elements in it -> their kind; empty where their content is not examined.
        once: Tags of those that stand in it once at most.
    """

    attributes: frozenset[str] = frozenset()
    children: Mapping[str, str] = {}
    once: frozenset[str] = frozenset()


Format = Mapping[str, Kind]
"""Kind of element -> the names in it."""


def format_names(table: TextTable) -> Format:
    """Return the names of a format."""
    kinds = {}
    for name, text in table.items():
        attributes, _, inside = text.partition(">")
        children, once = dict[str, str](), set[str]()
        for word in inside.split():
            tag, _, kind = word.rstrip("*-").partition("=")
            children[tag] = "" if word.endswith("-") else kind or tag
            once |= {tag} if word[-1] not in "*-" else set()
        kinds[name] = Kind(frozenset(attributes.split()), children, frozenset(once))
    return kinds


Parents = Sequence[ElementTree.Element]
"""An element after those around it."""


class UnknownName(ModelError):
    """A misprint of the name of an element or attribute; ``pattern`` finds it in the text of a file."""

    def __init__(self, around: Parents, tag: str, attribute: str | None, known: Iterable[str]) -> None:
        owner = _words(around)
        message = f"{owner} contains no <{tag}>" if attribute is None else f"{owner} has no attribute '{attribute}'"
        super().__init__(message, expected=choices("", known, most=40)[0], hint=meant_by(attribute or tag, known))
        self.pattern = rf"(?<=<){re.escape(tag)}\b" if attribute is None else rf"(?<=\s){re.escape(attribute)}(?=\s*=)"


def first_place(pattern: str, text: str, source: str) -> Location:
    """Return the first match of a pattern in a text, outside of comments; the file alone where there is none."""
    bare = re.sub("<!--.*?-->", lambda comment: re.sub(".", " ", comment[0]), text, flags=re.DOTALL)
    if (match := re.search(pattern, bare)) is None:
        return Location(source)
    begin = match.start()
    column = begin - bare.rfind("\n", 0, begin)
    return location(source, text, bare.count("\n", 0, begin) + 1, column, len(match[0]))


def check_names(root: ElementTree.Element, known: Format) -> Counter[str]:
    """Compare an element and all in it with the names of a format.

    Returns:
        What is not read, such as ``<transmission>`` or ``colour of <board>``, with its number.
    """
    unread: Counter[str] = Counter()
    waiting: list[tuple[tuple[ElementTree.Element, ...], Mapping[str, str]]] = [((root,), {root.tag: root.tag})]
    while waiting:
        (*around, element), siblings = waiting.pop()
        tag = element.tag
        if tag not in siblings:
            _refuse_misprint(around, tag, None, siblings)
            unread[f"<{tag}>"] += 1
        elif siblings[tag]:
            kind = known.get(siblings[tag], Kind())
            inside = (*around, element)
            for attribute in (name for name in element.attrib if name not in kind.attributes):
                _refuse_misprint(inside, tag, attribute, kind.attributes)
                if not is_foreign(attribute):
                    unread[f"{attribute} of <{tag}>"] += 1
            _check_once(inside, kind.once)
            waiting += [((*inside, child), kind.children) for child in reversed(element)]
    return unread


def is_foreign(name: str) -> bool:
    """Return whether a name has a prefix, or declares a namespace."""
    return ":" in name or name == "xmlns"


def counted(unread: Mapping[str, int]) -> str:
    """Return names not read, with counts, such as ``<transmission> (3), <gazebo>``; of many names the first."""
    names = [name[:SHOWN] + f" ({number})" * (number > 1) for name, number in sorted(unread.items())]
    return several(names, LISTED)


def meant_by(name: str, known: Iterable[str]) -> str:
    """Return the known name that a misprint makes a name of; empty where there is none."""
    for other in sorted(known):
        most = 1 if len(other) <= SHORT else 2
        if abs(len(name) - len(other)) <= most and _mistakes(name.lower(), other.lower()) <= most:
            return other
    return ""


def _mistakes(name: str, other: str) -> int:
    """Return the edit distance of two names: letters to change, add, drop, or swap with their neighbour."""
    before, above = list[int](), list(range(len(other) + 1))
    for i, letter in enumerate(name, 1):
        row = [i]
        for j, wanted in enumerate(other, 1):
            least = min(above[j] + 1, row[-1] + 1, above[j - 1] + (letter != wanted))
            if min(i, j) > 1 and (letter, wanted) == (other[j - 2], name[i - 2]):
                least = min(least, before[j - 2] + 1)
            row.append(least)
        before, above = above, row
    return above[-1]


def _refuse_misprint(around: Parents, tag: str, attribute: str | None, known: Iterable[str]) -> None:
    if not is_foreign(attribute or tag) and meant_by(attribute or tag, known):
        raise UnknownName(around, tag, attribute, known)


def _check_once(around: Parents, once: frozenset[str]) -> None:
    element = around[-1]
    for tag, count in Counter(child.tag for child in element).items() if once else ():
        if count > 1 and tag in once:
            name = element.get("name")
            where = f"{element.tag} '{name}'" if name else _words(around)
            raise ModelError(f"{where}: it has {count} <{tag}>", expected="one")


def _words(chain: Parents) -> str:
    """Return the last element of a chain and those around it until one with a name: ``<mass> in <link> 'arm'``."""
    words: list[str] = []
    for element in reversed(chain[1:] or chain):
        name = element.get("name")
        words.append(f"<{element.tag}> '{name}'" if name else f"<{element.tag}>")
        if name:
            break
    return " in ".join(words)
