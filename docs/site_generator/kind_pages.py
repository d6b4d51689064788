"""The pages of the kinds: docstring, keys, and an example that is solved and drawn while the site is built."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import yaml

import pinarm
from pinarm.use.facade import Result
from pinarm.use.show.drawings import sketch
from pinarm.use.show.picture import graph, plot
from pinarm.use.show.text import report
from site_generator.families import Kinds, definitions, families
from site_generator.key_tables import key_tables, prose
from site_generator.repository_pages import LANGUAGES, ROOT, shown_block
from site_generator.solids import solids

EXAMPLES = ROOT / "docs" / "kind_examples"

FOLDER = "kinds"
"""Where the pages are in the site."""


PICTURES: Mapping[str, Callable[[Result], str]] = {
    "positions": lambda result: sketch(result).svg(),
    "solids": solids,
    "curves": lambda result: plot(result, tuple(result.content.outputs[:4])).svg(),
}
"""Name of a picture -> what draws it, as SVG."""


@dataclass(frozen=True)
class Made:
    """A file of the site that is made.

    Attributes:
        place: Its path in the site.
        content: Its text.
    """

    place: str
    content: str


def example_of(family: Kinds, member: str) -> Path:
    """Return the scenario that shows a member of a family."""
    return EXAMPLES / family.name / f"{member}.yaml"


def family_pages(family: Kinds) -> Iterator[Made]:
    """Yield the pages and pictures of a family: an overview, and a page for each member."""
    rows = [f"| [`{member}`]({member}.md) | {_beginning(description(family, member))} |" for member in family.members]
    lines = [f"# {family.title}", "", family.text, "", "| | |", "| --- | --- |", *rows, ""]
    yield Made(f"{FOLDER}/{family.name}/index.md", "\n".join(lines))
    for member in family.members:
        yield from member_pages(family, member)


def member_pages(family: Kinds, member: str) -> Iterator[Made]:
    """Yield the page of a member of a family, and its pictures."""
    scenario = example_of(family, member)
    result = pinarm.run(scenario)
    place = f"{FOLDER}/{family.name}/{member}"
    pictures = {name: PICTURES[name](result) for name in family.pictures}
    graphs = [drawn for section in result.sections.values() for drawn in section.graphs]
    pictures |= {f"graph_{k}": graph(drawn, result.presentation).svg() for k, drawn in enumerate(graphs, 1)}
    for name, picture in pictures.items():
        yield Made(f"{place}_{name}.svg", picture)
    definition = family.members[member]
    keys = ["## Keys", *key_tables(definition)] if definition in definitions() else []
    images = " ".join(f"![{member}: {name}]({member}_{name}.svg)" for name in pictures)
    lines = [
        f"# `{member}`", "", description(family, member), "",
        f'<div class="pictures" markdown="1">\n{images}\n</div>', "",
        *keys, "", "## Example", "", *_files(scenario), "It prints", "", shown_block(report(result), "text"),
    ]  # fmt: skip
    yield Made(f"{place}.md", "\n".join(lines))


def description(family: Kinds, member: str) -> str:
    """Return what a member of a family is, as its docstring says it."""
    name = family.members[member]
    return prose(definitions()[name]["description"]) if name in definitions() else name


def with_kind_links(table: str) -> str:
    """Return the table of all kinds in which their names are links to their pages; a row begins with a family."""
    rows = table.splitlines()
    for family in families():
        for k, row in enumerate(rows):
            if row.lower().startswith(f"| {family.title.lower()} |"):
                rows[k] = re.sub(r"`(\w+)`", partial(_linked, family), row)
    return "\n".join(rows)


def _linked(family: Kinds, code: re.Match[str]) -> str:
    return f"[{code[0]}]({FOLDER}/{family.name}/{code[1]}.md)" if code[1] in family.members else code[0]


def _beginning(text: str) -> str:
    return text.partition("\n\n")[0].replace("\n", " ").replace("|", r"\|")


def _files(scenario: Path) -> Iterator[str]:
    """Yield the scenario, and the files beside it that it refers to, as blocks with their names."""
    command = f"python -m pinarm run {scenario.relative_to(ROOT).as_posix()}"
    yield f"`{command}` solves it.\n"
    for file in _referred(scenario):
        if EXAMPLES in file.parents:
            yield shown_block(file.read_text(encoding="utf-8"), LANGUAGES[file.suffix], file.name)
        else:
            yield f"The model is [`{(name := file.parent.relative_to(ROOT).as_posix())}`]({_up(scenario)}{name}).\n"


def _up(scenario: Path) -> str:
    """Return the way from the page of a kind, as it would be in the repository, to its root."""
    return "../" * (len(Path(FOLDER).parts) + 2)


def _referred(scenario: Path) -> Iterator[Path]:
    """Yield a scenario, its mechanism file, and the model file of that."""
    yield scenario
    content = yaml.safe_load(scenario.read_text(encoding="utf-8"))
    mechanism = Path(os.path.normpath(scenario.parent / content["mechanism"]))
    yield mechanism
    if EXAMPLES in mechanism.parents:
        described = yaml.safe_load(mechanism.read_text(encoding="utf-8"))
        if "robot" in described:
            yield mechanism.parent / described["robot"]
