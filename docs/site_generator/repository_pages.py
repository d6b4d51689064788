"""Files of the repository that pages link to, as pages of the site, and the links to them.

A page under ``docs`` may link to any file of the repository, as it does where the repository is read: the site has a
page with the content of that file, and of a folder one with the contents of all its text files.
"""

from __future__ import annotations

import json
import os
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]

PAGES = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changes.md"}
"""Pages that stand beside ``docs``, and their places in the site."""

LANGUAGES = {".yaml": "yaml", ".py": "python", ".xacro": "xml", ".urdf": "xml", ".xml": "xml", ".csv": "text",
             ".cff": "yaml", ".toml": "toml", ".md": "markdown", "": "text"}  # fmt: skip
"""Suffix of a file that is shown, and the language that it is highlighted as."""

FOLDER = "repository"
"""Where pages of other files are in the site."""

_LINK = re.compile(r"\]\((?P<target>[^)#\s:]+)(?P<anchor>#[^)\s]*)?\)")


def source_of(page: str) -> str:
    """Return the path in the repository of a page of the site."""
    if page.startswith(f"{FOLDER}/"):
        return page.removeprefix(f"{FOLDER}/").removesuffix(".md")
    return {place: source for source, place in PAGES.items()}.get(page, f"docs/{page}")


def place_of(source: str) -> str:
    """Return the place in the site of a file or folder of the repository: the page that shows it."""
    if source in PAGES:
        return PAGES[source]
    if source.startswith("docs/"):
        return source.removeprefix("docs/")
    return f"{FOLDER}/{source}.md"


def _folder_of(page: str) -> str:
    """Return the folder of the repository from which the links of a page of the site are meant."""
    source = source_of(page)
    return source if (ROOT / source).is_dir() else posixpath.dirname(source)


def with_site_links(markdown: str, page: str) -> str:
    """Return a page in which links to files of the repository lead to their pages in the site.

    Args:
        markdown: The page, with links as they are in the repository.
        page: Its place in the site.
    """
    folder = _folder_of(page)

    def moved(link: re.Match[str]) -> str:
        source = posixpath.normpath(posixpath.join(folder, link["target"]))
        if not (ROOT / source).exists():
            return link[0]  # a page that is made for the site, or a mistake that MkDocs warns about
        target = posixpath.relpath(place_of(source), posixpath.dirname(page) or ".")
        return f"]({target}{link['anchor'] or ''})"

    return _LINK.sub(moved, markdown)


def with_plain_bars(markdown: str) -> str:
    """Return a page whose code in tables has no backslash before a bar: other Markdown needs it, this shows it."""
    rows = re.compile(r"^\|.*", re.MULTILINE)
    return rows.sub(lambda row: re.sub(r"`[^`]*`", lambda code: code[0].replace("\\|", "|"), row[0]), markdown)


def linked_files(markdown: str, page: str) -> Iterator[str]:
    """Yield the files and folders of the repository outside ``docs`` that a page links to, without ``PAGES``."""
    folder = _folder_of(page)
    for link in _LINK.finditer(markdown):
        source = posixpath.normpath(posixpath.join(folder, link["target"]))
        path = ROOT / source
        shown = path.is_dir() or (path.is_file() and path.suffix in {*LANGUAGES, ".ipynb"})
        if not source.startswith(("docs/", "..")) and source not in PAGES and shown:
            yield source


def file_page(source: str) -> str:
    """Return the page that shows a file of the repository, or the text files of a folder."""
    path = ROOT / source
    head = f"---\nsearch:\n  exclude: true\n---\n\n# {path.name}\n\n`{source}`\n"
    if path.is_dir():
        return head + "".join(f"\n## {file.name}\n\n{_shown(file)}" for file in _texts(path))
    return f"{head}\n{_shown(path)}"


def _texts(folder: Path) -> list[Path]:
    return [Path(entry.path) for entry in sorted(os.scandir(folder), key=lambda entry: entry.name)
            if entry.is_file() and Path(entry.path).suffix in {*LANGUAGES, ".ipynb"}]  # fmt: skip


def _shown(file: Path) -> str:
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".ipynb":
        return "".join(_cells(text))
    return shown_block(text, LANGUAGES[file.suffix])


def _cells(notebook: str) -> Iterator[str]:
    """Yield the cells of a notebook as Markdown, headings below that of the page."""
    for cell in json.loads(notebook)["cells"]:
        text = "".join(cell["source"])
        yield (
            shown_block(text, "python")
            if cell["cell_type"] == "code"
            else f"{re.sub('^#', '##', text, flags=re.M)}\n\n"
        )


def shown_block(text: str, language: str, title: str = "") -> str:
    """Return a text as a block of code of a page of the site; files may contain fences of their own."""
    head = f'{language} title="{title}"' if title else language
    return f"~~~~{head}\n{text.rstrip()}\n~~~~\n\n"
