"""Draw the rooms of the package and the imports between them: ``python docs/architecture.py`` writes architecture.svg.

A room is a folder of a layer with all below it, such as ``engine/dynamics``. The modules that stand directly in a layer
are a room too, or several: those that rooms of the layer import stand apart from those that import rooms. An arrow from
a room down to another says that a module of the first imports one of the second, inside functions too, but not for
annotations only. Arrows that follow from others are left out (transitive reduction), as are those to ``errors``,
``arrays`` and ``records``, which all may import. The imports that close a circle, of each circle the fewest, are dashed
and point upwards.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterable, Iterator, Set
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from layered_drawing import Box, Drawing, Edge

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "architecture.svg"
COLOURS = {
    "cli": "#6b7280", "use": "#7c3aed", "problems": "#be185d", "engine": "#b45309", "mechanics": "#15803d",
    "input": "#0369a1",
}  # fmt: skip
"""Layers from above to below, and their colours."""
MIDDLE, LOWER = " (middle)", " (lower)"
"""End the names of the rooms of those modules of a layer that its other rooms import, and that do or do not import any
of these themselves."""


@dataclass(frozen=True)
class Package:
    """The modules of a package and what they import of it.

    Attributes:
        folder: Folder of the package.
    """

    folder: Path

    @cached_property
    def files(self) -> dict[str, Path]:
        """File of each module, such as ``pinarm.engine.mechanism``; packages have their ``__init__.py``."""
        files = sorted(self.folder.rglob("*.py"))
        parts = [file.relative_to(self.folder.parent).with_suffix("").parts for file in files]
        return {".".join(p[:-1] if p[-1] == "__init__" else p): file for p, file in zip(parts, files, strict=True)}

    @cached_property
    def imports(self) -> dict[str, set[str]]:
        """Modules of the package that each module imports, inside functions too, but not for annotations only."""
        return {module: set(self._imported(file)) - {module} for module, file in self.files.items()}

    def _imported(self, file: Path) -> Iterator[str]:
        for node in _run(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names if alias.name in self.files)
            elif isinstance(node, ast.ImportFrom) and node.module in self.files:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
                yield from (name if name in self.files else str(node.module) for name in names)

    @cached_property
    def rooms(self) -> dict[str, str]:
        """Room of each module of a layer: ``engine/dynamics``, and ``engine`` for a module directly in that layer."""
        folders = {m: file.relative_to(self.folder).parent.parts[:2] for m, file in self.files.items()}
        rooms = {module: "/".join(parts) for module, parts in folders.items() if parts}
        for layer in COLOURS:
            own = {m for m, room in rooms.items() if room == layer and self.files[m].name != "__init__.py"}
            inner = {m for m, room in rooms.items() if room.startswith(f"{layer}/")}
            edges = self._edges(own | inner)
            above = {m for m in own if reached(m, edges) & inner}
            below = {other for m in inner for other in reached(m, edges) & own}
            if above and below:
                lower = {*below, f"{self.folder.name}.{layer}"} - above  # and the __init__.py of the layer
                rooms |= dict.fromkeys(above & below, f"{layer}{MIDDLE}") | dict.fromkeys(lower, f"{layer}{LOWER}")
        return rooms

    def _edges(self, modules: set[str]) -> set[Edge]:
        """Return the imports among some modules."""
        return {(module, other) for module in modules for other in self.imports[module] & modules}

    def text(self, room: str) -> str:
        """Return what a room computes, by the first sentence of its docstring; of modules in a layer, their names."""
        if "/" not in room:
            own = sorted(m for m, name in self.rooms.items() if name == room and self.files[m].name != "__init__.py")
            return ", ".join(module.rpartition(".")[2] for module in own)
        tree = ast.parse((self.folder / room / "__init__.py").read_text(encoding="utf-8"))
        return (ast.get_docstring(tree) or "").split("\n")[0].split(". ")[0].rstrip(".").replace("``", "")

    @cached_property
    def arrows(self) -> Counter[Edge]:
        """Number of imports from one room to another."""
        rooms = self.rooms
        pairs = ((rooms[a], rooms.get(b)) for a in rooms for b in sorted(self.imports[a]))
        return Counter((a, b) for a, b in pairs if b is not None and a != b)


def _run(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a tree that run, those under ``if TYPE_CHECKING`` do not."""
    for node in ast.iter_child_nodes(tree):
        if not (isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"):
            yield node
            yield from _run(node)


def reached(start: str, edges: Iterable[Edge]) -> set[str]:
    """Return the ends of all paths from a node."""
    found: set[str] = set()
    waiting = [start]
    while waiting:
        node = waiting.pop()
        new = {b for a, b in edges if a == node} - found
        found |= new
        waiting += new
    return found


def circles_cut(counts: Counter[Edge]) -> tuple[set[Edge], set[Edge]]:
    """Return edges without circles, and those that were taken out for it: as few imports as a greedy choice finds."""
    down, back = set(counts), []
    while closing := [edge for edge in down if edge[0] in reached(edge[1], down)]:
        back.append(min(closing, key=lambda edge: (counts[edge], edge)))
        down.remove(back[-1])
    for edge in reversed(back):
        if edge[0] not in reached(edge[1], down):
            down.add(edge)
    return down, set(back) - down


def reduced(edges: Set[Edge]) -> set[Edge]:
    """Return the edges that do not follow from others."""
    after = {node: {b for a, b in edges if a == node} for edge in edges for node in edge}
    return {(a, b) for a, b in edges if not any(b in reached(c, edges) for c in after[a] - {b})}


def picture(package: Package) -> str:
    """Return the picture of a package's rooms as SVG."""
    down, back = circles_cut(package.arrows)
    boxes = []
    for room in sorted({room for edge in package.arrows for room in edge}):
        own = room.partition(" (")[0]
        title = f"{own}/" if "/" in own else f"{own}/*.py"
        boxes.append(Box(room, own.partition("/")[0], title, package.text(room)))
    return Drawing(tuple(boxes), COLOURS, frozenset(reduced(down)), frozenset(back)).svg()


if __name__ == "__main__":
    PICTURE.write_text(picture(Package(ROOT / "pinarm")), encoding="utf-8")
    print(f"written to {PICTURE}")
