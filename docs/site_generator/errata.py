"""The table of everything that answer keys of scenarios hold to be wrong in print."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pinarm
from pinarm.use.result.expectation import ERRATA, Expectation
from site_generator.repository_pages import ROOT

PLACE = "<!-- every entry -->"
"""Where a page wants the table."""


def with_errata(markdown: str) -> str:
    """Return a page with the table in its place."""
    return markdown.replace(PLACE, "\n".join(_table()))


def _table() -> Iterator[str]:
    yield "| scenario | quantity | printed | right | how it is known |"
    yield "| --- | --- | --- | --- | --- |"
    for file in sorted((ROOT / "scenarios").glob("*.yaml")):
        for entry in pinarm.load(file).content.expect:
            if entry.verdict in ERRATA:
                yield f"| {' | '.join(text.replace('|', chr(92) + '|') for text in _cells(file, entry))} |"


def _cells(file: Path, entry: Expectation) -> list[str]:
    printed = entry.published or f"`{entry.published_formula}`"
    right = f"`{entry.formula}`" if entry.formula else str(entry.value)
    known = ": ".join(filter(None, (entry.source, entry.note))) + (" (model)" if entry.verdict == "model_error" else "")
    title = file.stem.replace("_", "_<wbr>")  # the line may be divided there
    return [f"[{title}](../scenarios/{file.name})", f"`{entry.quantity}`", printed, right, known]
