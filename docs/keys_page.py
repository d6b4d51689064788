"""Write docs/keys.md: keys of laws and of parts of mechanisms, of their docstrings. ``python docs/keys_page.py``."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from site_generator.families import Kinds, definitions, families
from site_generator.key_tables import key_tables, prose

PAGE = Path(__file__).with_name("keys.md")

WANTED = ("laws", "forces", "loop_joints", "couplings", "coordinates", "drives")
"""Families whose keys the page has."""

HEAD = """# Keys of parts and laws

What may be written in `motion:`, `forces:`, `loads:`, `loops:`, `couplings:`, `coordinates:` and `drives:`. A number
has its unit, such as `20 N/mm`. An editor offers the same keys with the [JSON Schema](commands.md).
"""

_LINK = re.compile(r"\[([^\]]+)\]\((?!http)[^)]*\)")
"""Links of the site, whose pages the repository does not have."""

_PLACE = re.compile(r" \{#\w+\}")


def page() -> str:
    """Return the page."""
    chosen = [family for family in families() if family.name in WANTED]
    lines = [line for family in sorted(chosen, key=lambda each: WANTED.index(each.name)) for line in _family(family)]
    return "\n".join([HEAD, *lines, ""])


def _family(family: Kinds) -> Iterator[str]:
    """Yield the heading of a family, and the keys of each member; structures that several have once."""
    yield f"## {family.title}\n"
    known = set[str]()
    for member, definition in family.members.items():
        tables = "\n".join(key_tables(definition)).strip().split("\n### ")
        fresh = [tables[0], *(f"#### {table}" for table in tables[1:] if table not in known)]
        known.update(tables[1:])
        summary = prose(definitions()[definition]["description"]).partition("\n\n")[0].replace("\n", " ")
        text = "\n".join([f"### `{member}`", "", summary, "", *fresh])
        yield _PLACE.sub("", _LINK.sub(r"\1", text)) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"written to {PAGE}")
