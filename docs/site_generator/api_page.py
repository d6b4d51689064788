"""Pages of everything that ``import pinarm`` gives, from the docstrings: the calls, and a page for each class."""

from __future__ import annotations

from collections.abc import Iterator

import pinarm
from site_generator.kind_pages import Made

HEAD = """# API

The calls that `import pinarm` gives; they have the names of the [commands](commands.md). Arrays are in SI, in the axes
of the world unless said otherwise. Mistakes in the input and numerics that fail are a
[`PinarmError`](api/PinarmError.md).

| class | |
| --- | --- |
"""

CLASSES = [name for name in pinarm.__all__ if not name.islower()]
"""Public classes, each with a page of its own."""


def pages() -> Iterator[Made]:
    """Yield the page of the calls, which lists the classes, and the page of each class."""
    rows = [f"| [`{name}`](api/{name}.md) | {_summary(name)} |" for name in CLASSES]
    calls = [line for name in pinarm.__all__ if name.islower() for line in _entry(name)]
    yield Made("api.md", "\n".join([HEAD + "\n".join(rows), "", *calls]))
    for name in CLASSES:
        yield Made(f"api/{name}.md", "\n".join([f"# pinarm.{name}", "", *_entry(name)]))


def _summary(name: str) -> str:
    return str(getattr(pinarm, name).__doc__).partition("\n")[0].replace("``", "`").replace("|", r"\|")


def _entry(name: str) -> Iterator[str]:
    """Yield what mkdocstrings makes an entry of: the object where it is defined, under the name that users know.

    Members of a record are all that have a public name, inherited ones too.
    """
    thing = getattr(pinarm, name)
    listed = [name for name in dir(thing) if name[0] != "_"] if hasattr(thing, "__struct_fields__") else []
    members = f", inherited_members: true, members: [{', '.join(listed)}]" if listed else ""
    yield f"::: {thing.__module__}.{thing.__qualname__}"
    yield f"    options: {{heading: pinarm.{name}, toc_label: {name}{members}}}\n"
