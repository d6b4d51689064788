"""What MkDocs calls while it builds the site: it adds the pages that are made, and adapts those that are written."""

from __future__ import annotations

from itertools import chain
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from site_generator import api_page
from site_generator.code_breaks import with_breaks, with_columns
from site_generator.errata import with_errata
from site_generator.families import families
from site_generator.formulas import with_mathml
from site_generator.gallery import gallery_pages
from site_generator.kind_pages import FOLDER, family_pages, with_kind_links
from site_generator.repository_pages import (
    PAGES,
    ROOT,
    file_page,
    linked_files,
    place_of,
    with_plain_bars,
    with_site_links,
)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the families of kinds to the navigation."""
    (kinds,) = (entry["What there is"] for entry in config.nav or [] if "What there is" in entry)
    for family in families():
        pages = [f"{FOLDER}/{family.name}/{member}.md" for member in ("index", *family.members)]
        kinds.append({family.title: pages})
    (reference,) = (entry["Reference"] for entry in config.nav or [] if "Reference" in entry)
    reference.insert(1, {"Classes": [f"api/{name}.md" for name in api_page.CLASSES]})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that stand beside ``docs``, and those of the files that any page links to."""
    for source, place in PAGES.items():
        files.append(File.generated(config, place, content=(ROOT / source).read_text(encoding="utf-8")))
    for made in chain(api_page.pages(), gallery_pages(), *map(family_pages, families())):
        files.append(File.generated(config, made.place, content=made.content))
    pages = list(files.documentation_pages())
    for page in pages:  # which grows: a file that is shown may link to others
        for source in linked_files(_with_tables(page.content_string, page.src_uri), page.src_uri):
            if files.get_file_from_path(place_of(source)) is None:
                pages.append(File.generated(config, place_of(source), content=file_page(source)))
                files.append(pages[-1])
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Add what is made to a page, and let links to files of the repository lead to their pages."""
    return with_plain_bars(with_site_links(_with_tables(markdown, page.file.src_uri), page.file.src_uri))


def _with_tables(markdown: str, place: str) -> str:
    """Return a page with the tables and links that are made from the code."""
    return {"kinds.md": with_kind_links, "misprints.md": with_errata}.get(place, str)(markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Draw formulas, and let long code in tables go on in the next line."""
    return with_columns(with_breaks(with_mathml(html)))
