"""Code blocks of the documentation: which there are, and what becomes of them when a reader follows the page.

A page is one session in a folder that looks like the project. In their order

- ``yaml`` blocks with a title, ``title="door/scenario.yaml"``, are written to that file; any other is a whole file or
  some keys of one, and validated;
- ``sh`` blocks are run by bash, ``python`` blocks by Python, each on its own;
- a ``text`` block that follows one of these is what it prints; a line ``...`` in it stands for any lines. After a
  scenario it is what ``run`` prints.

A comment before a block says where it is another case: ``<!-- not run: REASON -->``.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]

LONGEST = 300
"""Seconds that a block may take."""

RESIDUAL = re.compile(r"\d(\.\d+)?e[-+]\d\d")
"""Rounding, which differs between machines."""

_BLOCK = re.compile(
    r"(?:^ *<!-- (?P<marker>[^>]*?) -->\n)?"
    r"^(?P<indent> *)```(?P<language>\w+)?(?: title=\"(?P<title>[^\"]+)\")?\n(?P<text>.*?)^(?P=indent)```$",
    re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Block:
    """A block of a page.

    Attributes:
        page: File of the page.
        line: Line of the page on which it begins.
        language: ``yaml``, ``sh``, ``python``, ``text``, ...
        marker: Text of the comment before it; empty where there is none.
        title: File that it is the content of; empty where it has no title.
        text: Its content, without indentation.
        follows: Whether nothing but white space is between it and the block before it.
    """

    page: Path
    line: int
    language: str
    marker: str
    title: str
    text: str
    follows: bool

    @property
    def place(self) -> str:
        """Page and line."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def reason(self) -> str:
        """Why it is not run; empty where it is."""
        return self.marker.removeprefix("not run: ") if self.marker.startswith("not run: ") else ""


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page in their order."""
    text, end, blocks = page.read_text(encoding="utf-8"), 0, []
    for found in _BLOCK.finditer(text):
        lines = found["text"].splitlines(keepends=True)
        blocks.append(Block(
            page, text.count("\n", 0, found.start()) + 1, found["language"] or "", found["marker"] or "",
            found["title"] or "", "".join(line[len(found["indent"]) :] or "\n" for line in lines),
            not text[end : found.start()].strip(),
        ))  # fmt: skip
        end = found.end()
    return blocks


class Session:
    """A reader who follows a page in a folder of their own."""

    def __init__(self, folder: Path) -> None:
        """Copy what the project has there, and put ``python`` and ``pinarm`` of this environment first."""
        self.folder = folder / "project"
        self.folder.mkdir()
        (self.folder / "pyproject.toml").touch()
        for name in ("models", "scenarios", "examples"):
            shutil.copytree(ROOT / name, self.folder / name)
        bin_folder = folder / "bin"
        bin_folder.mkdir()
        for name, command in {"python": "", "python3": "", "pinarm": " -m pinarm"}.items():
            (bin_folder / name).write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)}{command} "$@"\n')
            (bin_folder / name).chmod(0o755)
        self.environment = {
            **os.environ, "PATH": f"{bin_folder}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg",
            "BROWSER": "true", "COLUMNS": "200", "PYTHONWARNINGS": "default",
        }  # fmt: skip

    def write(self, block: Block) -> None:
        """Write a block with a title to its file."""
        file = self.folder / block.title
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(block.text, encoding="utf-8")

    def printed(self, block: Block) -> str:
        """Run a block and return what it prints."""
        command = {"sh": ["bash", "-euo", "pipefail", "-c", block.text], "python": ["python", "-c", block.text],
                   "yaml": ["pinarm", "run", block.title]}[block.language]  # fmt: skip
        done = subprocess.run(command, cwd=self.folder, env=self.environment, capture_output=True, text=True,
                              timeout=LONGEST, check=False)  # fmt: skip
        assert done.returncode == 0, f"{block.place}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout


def is_printed(wanted: str, printed: str) -> bool:
    """Tell whether a text is what was printed, but for rounding, and for lines that ``...`` stands for."""
    pattern = r".*\n".join(
        re.escape(RESIDUAL.sub("residual", part)) for part in re.split(r"^\.\.\.\n", wanted, flags=re.M)
    )
    text = RESIDUAL.sub("residual", "".join(f"{line.rstrip()}\n" for line in printed.splitlines()))
    return re.fullmatch(rf"\n*{pattern}\n*", text, re.DOTALL) is not None
