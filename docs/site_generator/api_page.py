"""The page of everything that ``import pinarm`` gives, from the docstrings."""

from __future__ import annotations

from collections.abc import Iterator

import pinarm

HEAD = """# API

Everything that `import pinarm` gives. Arrays are in SI, in the axes of the world unless said otherwise. A mistake in
the input and numerics that fail are a [`PinarmError`](#pinarm.errors.PinarmError). The calls have the names of the
[commands](commands.md).
"""


def page() -> str:
    """Return the page: the calls, then the classes."""
    calls = [name for name in pinarm.__all__ if name.islower()]
    classes = [name for name in pinarm.__all__ if not name.islower()]
    return "\n".join([HEAD, *(line for names in (calls, classes) for name in names for line in _entry(name))])


def _entry(name: str) -> Iterator[str]:
    """Yield what mkdocstrings makes an entry of: the object where it is defined, under the name that users know."""
    thing = getattr(pinarm, name)
    yield f"::: {thing.__module__}.{thing.__qualname__}"
    yield f"    options: {{heading: pinarm.{name}, toc_label: {name}}}\n"
