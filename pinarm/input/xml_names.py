"""Names of elements and attributes in XML models, compared with those of their format.

One rule at every level. A name that a misprint makes of a known one is refused with the name that may be meant, since a
reader that asks for known names would take ``<orign xyz="1 0 0"/>`` for no origin. Any other unknown name is an
extension: it is counted, and listed as not read. Names with a prefix belong to other formats.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from xml.etree.ElementTree import Element as AnyElement

from pinarm.errors import LISTED, SHOWN, Location, ModelError, choices, several
from pinarm.input.xml_text import Element, location_of, tree_of
from pinarm.records import ValueRecord

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
        attributes: Its attributes.
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


class UnknownName(ModelError):
    """A misprint of the name of an element or attribute.

    Attributes:
        parent: Tag of the element around it; empty for the outermost.
        tag: Tag of the element.
        attribute: The attribute; ``None`` where the element itself is unknown.
    """

    def __init__(self, around: Sequence[AnyElement], tag: str, attribute: str | None, known: Iterable[str]) -> None:
        owner = _words(around)
        message = f"{owner} contains no <{tag}>" if attribute is None else f"{owner} has no attribute '{attribute}'"
        super().__init__(message, expected=choices("", known, most=40)[0], hint=meant_by(attribute or tag, known))
        parents = around if attribute is None else around[:-1]
        self.parent, self.tag, self.attribute = parents[-1].tag if parents else "", tag, attribute

    def place(self, text: str, source: str) -> Location:
        """Return where it is in the text of a model's file; the file alone where it is not in it."""
        for parent in [None, *(root := tree_of(text, source)).iter()]:
            for element in [root] if parent is None else parent:
                wanted = self.attribute is None or self.attribute in element.attrib
                tags = parent.tag if parent is not None else "", element.tag
                if wanted and tags == (self.parent, self.tag) and isinstance(element, Element):
                    return location_of(element, text, self.attribute or self.tag)
        return Location(source)


def check_names(root: AnyElement, known: Format) -> Counter[str]:
    """Compare an element and all in it with the names of a format.

    Returns:
        What is not read, such as ``<transmission>`` or ``colour of <board>``, with its number.

    Raises:
        UnknownName: The first misprint in the order of the file.
        ModelError: An element stands twice where one would be passed over.
    """
    unread: Counter[str] = Counter()
    waiting: list[tuple[tuple[AnyElement, ...], Mapping[str, str]]] = [((root,), {root.tag: root.tag})]
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
    """Return what is not read in words, such as ``<transmission> (3), <gazebo>``; of many names the first."""
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
    """Return how many letters to change, add, drop, or swap with their neighbour make one name of the other."""
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


def _refuse_misprint(around: Sequence[AnyElement], tag: str, attribute: str | None, known: Iterable[str]) -> None:
    if not is_foreign(attribute or tag) and meant_by(attribute or tag, known):
        raise UnknownName(around, tag, attribute, known)


def _check_once(around: Sequence[AnyElement], once: frozenset[str]) -> None:
    element = around[-1]
    for tag, count in Counter(child.tag for child in element).items() if once else ():
        if count > 1 and tag in once:
            name = element.get("name")
            where = f"{element.tag} '{name}'" if name else _words(around)
            raise ModelError(f"{where}: it has {count} <{tag}>", expected="one")


def _words(chain: Sequence[AnyElement]) -> str:
    """Return the last element of a chain and those around it until one with a name: ``<mass> in <link> 'arm'``."""
    words: list[str] = []
    for element in reversed(chain[1:] or chain):
        name = element.get("name")
        words.append(f"<{element.tag}> '{name}'" if name else f"<{element.tag}>")
        if name:
            break
    return " in ".join(words)
