"""Names of elements and attributes in XML files: what a format knows, and what of it is read here.

A reader that asks for the names it knows takes a misprint for something left out: ``<orign xyz="1 0 0"/>`` would put a
joint at 0. So a file is first compared with all names of its format.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum, auto
from xml.etree.ElementTree import Element
from xml.parsers import expat

from msgspec import field

from pinarm.errors import Location, ModelError, choices
from pinarm.input.xml_text import location
from pinarm.records import ValueRecord


class Content(Enum):
    """Elements that a format knows and whose content is not examined."""

    IDLE = auto()
    """It has no part in what is computed, such as a colour."""
    UNREAD = auto()
    """It may have one, and is not read: it is listed as such."""


class ElementNames(ValueRecord, frozen=True):
    """Names that one kind of element may contain.

    Attributes:
        attributes: Attributes that are read, or have no part in what is computed.
        children: Elements in it by tag. A mapping may contain itself, as that of bodies that carry bodies does.
        unread: Attributes that may have a part, and are not read.
        once: Elements that stand in it once at most: a second one would be passed over.
    """

    attributes: frozenset[str] = frozenset()
    children: Mapping[str, ElementNames | Content] = field(default_factory=dict)
    unread: frozenset[str] = frozenset()
    once: frozenset[str] = frozenset()


class UnknownName(ModelError):
    """An element or attribute that a format does not have.

    Attributes:
        parent: Tag of the element around it; empty for the outermost.
        tag: Tag of the element.
        attribute: The attribute; ``None`` where the element itself is unknown.
    """

    def __init__(
        self, message: str, around: Sequence[Element], tag: str, attribute: str | None, known: Iterable[str]
    ) -> None:
        expected, hint = choices(attribute or tag, known)
        super().__init__(message, expected=expected, hint=hint)
        self.parent, self.tag, self.attribute = around[-1].tag if around else "", tag, attribute

    def place(self, text: str, source: str) -> Location:
        """Return where it stands in the text of a file, which is well-formed; the file where it does not.

        Args:
            text: Text of the file.
            source: Name of the file.
        """
        lines: list[int] = []
        tags = [""]
        parser = expat.ParserCreate()

        def start(tag: str, attributes: dict[str, str]) -> None:
            wanted = self.attribute is None or self.attribute in attributes
            if wanted and (tags[-1], tag) == (self.parent, self.tag):
                lines.append(parser.CurrentLineNumber)
            tags.append(tag)

        parser.StartElementHandler, parser.EndElementHandler = start, lambda _: tags.pop()
        parser.Parse(text, True)
        if not lines:
            return Location(source)
        name = self.attribute or self.tag
        whole = location(source, text, lines[0])
        column = whole.text.find(name) + 1
        return location(source, text, lines[0], column, len(name)) if column else whole


def names(
    attributes: str = "", children: Mapping[str, ElementNames | Content] | None = None, unread: str = "",
    once: str = "",
) -> ElementNames:  # fmt: skip
    """Return the names of an element; attributes, and elements that stand in it once, are separated by spaces."""
    return ElementNames(frozenset(attributes.split()), children or {}, frozenset(unread.split()),
                        frozenset(once.split()))  # fmt: skip


def check_names(root: Element, known: ElementNames) -> Counter[str]:
    """Compare an element and all in it with the names of their format; elements with a namespace are not read.

    Args:
        root: The outermost element.
        known: The names that it may contain.

    Returns:
        What is not read, such as ``<transmission>``, with its number.

    Raises:
        UnknownName: The first name in the order of the file that the format does not have; the message says the nearest
            element around it that has a name, the hint what it may have been meant to be.
        ModelError: An element stands twice where one would be passed over.
    """
    unread: Counter[str] = Counter()
    waiting: list[tuple[tuple[Element, ...], Element, ElementNames]] = [
        ((), root, ElementNames(children={root.tag: known}))
    ]
    while waiting:
        around, element, allowed = waiting.pop()
        if element.tag not in allowed.children:
            raise UnknownName(f"{_words(around)} contains no <{element.tag}>", around, element.tag, None,
                              allowed.children)  # fmt: skip
        content = allowed.children[element.tag]
        if content is Content.UNREAD:
            unread[f"<{element.tag}>"] += 1
        elif isinstance(content, ElementNames):
            _check_attributes(around, element, content, unread)
            _check_once(around, element, content)
            unread.update(f"<{child.tag}>" for child in element if isinstance(child.tag, str) and _foreign(child.tag))
            inside = (*around, element)
            waiting += [(inside, child, content) for child in reversed(element) if not _foreign(child.tag)]
    return unread


def own_names(root: Element) -> bool:
    """Take the namespace of the outermost element from all elements in it: what it contains is of one format.

    Returns:
        Whether there was one.
    """
    space, found, _ = root.tag.rpartition("}")
    if found:
        for element in root.iter():
            if isinstance(element.tag, str):
                element.tag = element.tag.removeprefix(f"{space}}}")
    return bool(found)


def counted(unread: Mapping[str, int]) -> str:
    """Return what is not read in words, such as ``<transmission> (3), <gazebo>``."""
    return ", ".join(what if number == 1 else f"{what} ({number})" for what, number in sorted(unread.items()))


def _check_attributes(
    around: tuple[Element, ...], element: Element, allowed: ElementNames, unread: Counter[str]
) -> None:
    for attribute in element.attrib:
        if attribute in allowed.unread:
            unread[f"{attribute} of <{element.tag}>"] += 1
        elif attribute not in allowed.attributes and not _foreign(attribute):
            raise UnknownName(f"{_words((*around, element))} has no attribute '{attribute}'", around, element.tag,
                              attribute, allowed.attributes | allowed.unread)  # fmt: skip


def _check_once(around: tuple[Element, ...], element: Element, allowed: ElementNames) -> None:
    if not allowed.once:
        return
    for tag, count in Counter(child.tag for child in element).items():
        if count > 1 and tag in allowed.once:
            name = element.get("name")
            where = f"{element.tag} '{name}'" if name else _words((*around, element))
            raise ModelError(f"{where}: it has {count} <{tag}>", expected="one")


def _words(chain: tuple[Element, ...]) -> str:
    """Return the last element of a chain and those around it until one with a name: ``<mass> in <link> 'arm'``."""
    words: list[str] = []
    for element in reversed(chain[1:] or chain):
        name = element.get("name")
        words.append(f"<{element.tag}> '{name}'" if name else f"<{element.tag}>")
        if name:
            break
    return " in ".join(words)


def _foreign(name: object) -> bool:
    """Tell whether a name belongs to another format, by its namespace; comments have no name."""
    return not isinstance(name, str) or name.startswith("{") or ":" in name
