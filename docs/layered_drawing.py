"""A drawing of boxes in layers with arrows downwards, as SVG; the same input gives the same text.

After Sugiyama, Tagawa and Toda (1981), Methods for visual understanding of hierarchical system structures: rows by the
longest path, the order in a row by the mean place of the neighbours, long arrows through lanes in the rows between.
"""

from __future__ import annotations

import textwrap
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from itertools import pairwise

Edge = tuple[str, str]

WIDTH, MARGIN, PAD, LABEL = 880, 6, 14, 106  # of the picture; around it; around the rows of a layer; its name [px]
BOX, LANE, GAP, ROW_GAP = 234, 10, 16, 26  # widths of boxes and lanes, the gaps between them and between rows [px]
TITLE, LINE, LETTERS = 24, 13, 38  # height of a box's title and of a line [px]; letters a line
SWEEPS, ROUNDS = 40, 300
STIFFNESS = {2 * BOX: 1.0, BOX + LANE: 2.0, 2 * LANE: 8.0}  # of an arrow's pieces by its ends: long arrows are straight
INK, RED = "#475569", "#dc2626"
FONT = "font-family=\"system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif\""


@dataclass(frozen=True)
class Box:
    """A box.

    Attributes:
        name: What arrows call it.
        layer: The layer in which it lies.
        title: Its heading.
        text: What stands below.
    """

    name: str
    layer: str
    title: str
    text: str

    @property
    def lines(self) -> list[str]:
        """The text, folded to the width of a box."""
        return textwrap.wrap(self.text, LETTERS)


@dataclass(frozen=True)
class Drawing:
    """Boxes, and the arrows between them.

    Attributes:
        boxes: The boxes.
        layers: Names of the layers from above to below, and their colours.
        down: Arrows from a box to one below; together they close no circle.
        back: Arrows from a box to one above, dashed; turned round they close no circle with the others.
    """

    boxes: tuple[Box, ...]
    layers: Mapping[str, str]
    down: frozenset[Edge]
    back: frozenset[Edge]

    @cached_property
    def links(self) -> list[Edge]:
        """Upper and lower box of every arrow."""
        return sorted({*self.down, *((b, a) for a, b in self.back)})

    @cached_property
    def row(self) -> dict[str, int]:
        """Row of each box: below all that point to it, and below all of the layer above."""
        row: dict[str, int] = {}
        for layer in self.layers:
            inside = [box.name for box in self.boxes if box.layer == layer]
            row |= dict.fromkeys(inside, 1 + max(row.values(), default=-1))
            for _ in inside:
                for a, b in self.links:
                    if a in inside and b in inside:
                        row[b] = max(row[b], row[a] + 1)
        return row

    @cached_property
    def paths(self) -> dict[Edge, list[tuple[str, int]]]:
        """Places that each arrow passes: box or lane, and row."""
        paths = {}
        for a, b in self.links:
            lanes = [(f"{a} -> {b}", row) for row in range(self.row[a] + 1, self.row[b])]
            paths[a, b] = [(a, self.row[a]), *lanes, (b, self.row[b])]
        return paths

    @cached_property
    def middle(self) -> dict[tuple[str, int], float]:
        """Middle of each place from the left [px]."""
        return placed(list(self.row.items()), [link for path in self.paths.values() for link in pairwise(path)])

    @cached_property
    def heights(self) -> list[int]:
        """Height of each row [px]."""
        lines = [[len(box.lines) for box in self.boxes if self.row[box.name] == k] for k in range(self.rows)]
        return [TITLE + LINE * max(counts) + 6 for counts in lines]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return 1 + max(self.row.values())

    @cached_property
    def tops(self) -> list[int]:
        """Upper end of each row [px]."""
        layer = {self.row[box.name]: box.layer for box in self.boxes}
        tops = [MARGIN + PAD]
        for k in range(1, self.rows):
            between = ROW_GAP if layer[k] == layer[k - 1] else 2 * PAD + 12
            tops.append(tops[-1] + self.heights[k - 1] + between)
        return tops

    @cached_property
    def bottoms(self) -> list[int]:
        """Lower end of each row [px]."""
        return [top + height for top, height in zip(self.tops, self.heights, strict=True)]

    def svg(self) -> str:
        """Return the drawing."""
        height = self.bottoms[-1] + PAD + MARGIN
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" {FONT}>',
            f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>',
            _marker("down", INK), _marker("back", RED),
            *map(self._band, self.layers), *map(self._arrow, self.links), *map(self._box, self.boxes),
            "</svg>",
        ]  # fmt: skip
        return "\n".join(parts) + "\n"

    def _band(self, layer: str) -> str:
        """Return the background of a layer, and its name."""
        rows = [self.row[box.name] for box in self.boxes if box.layer == layer]
        top, bottom, colour = self.tops[min(rows)] - PAD, self.bottoms[max(rows)] + PAD, self.layers[layer]
        return (
            f'<rect x="{MARGIN}" y="{top}" width="{WIDTH - 2 * MARGIN}" height="{bottom - top}" rx="8" '
            f'fill="{colour}" fill-opacity="0.07"/>\n'
            f'<text x="{MARGIN + 12}" y="{top + 25}" font-size="15" font-weight="700" fill="{colour}">{layer}</text>'
        )

    def _box(self, box: Box) -> str:
        """Return a box with its texts."""
        row = self.row[box.name]
        left, top = self.middle[box.name, row] - BOX / 2, self.tops[row]
        lines = "".join(f'<tspan x="{left + 9:.1f}" dy="{LINE}">{escape(line)}</tspan>' for line in box.lines)
        return (
            f'<rect x="{left:.1f}" y="{top}" width="{BOX}" height="{self.heights[row]}" rx="5" fill="#ffffff" '
            f'stroke="{self.layers[box.layer]}"/>\n'
            f'<text x="{left + 9:.1f}" y="{top + 18}" font-size="12.5" font-weight="600" fill="#0f172a">'
            f"{escape(box.title)}</text>\n"
            f'<text y="{top + 21}" font-size="10.5" fill="{INK}">{lines}</text>'
        )

    def _arrow(self, link: Edge) -> str:
        """Return an arrow: a curve that is vertical where it leaves a box, passes a row and meets a box."""
        path = self.paths[link]
        xs = [self._port(link, 0), *(self.middle[lane] for lane in path[1:-1]), self._port(link, -1)]
        curve = f"M{xs[0]:.1f} {self.bottoms[path[0][1]]}"
        for (_, above), (_, below), x, end in zip(path, path[1:], xs, xs[1:], strict=False):
            half = (self.bottoms[above] + self.tops[below]) / 2
            curve += f" C{x:.1f} {half:.1f} {end:.1f} {half:.1f} {end:.1f} {self.tops[below]}"
            curve += f" V{self.bottoms[below]}" if below != path[-1][1] else ""
        style = f'stroke="{INK}" marker-end="url(#down)"'
        if link not in self.down:
            style = f'stroke="{RED}" stroke-dasharray="5 4" marker-start="url(#back)"'
        said = f"{link[0]} imports {link[1]}" if link in self.down else f"{link[1]} imports {link[0]}"
        return f'<path d="{curve}" fill="none" stroke-width="1.3" {style}><title>{escape(said)}</title></path>'

    def _port(self, link: Edge, end: int) -> float:
        """Return where on its upper box (end 0) or lower box (end -1) an arrow begins [px]: beside the others there."""
        beside = 1 if end == 0 else -2
        here = [other for other in self.links if other[end] == link[end]]
        here.sort(key=lambda other: (self.middle[self.paths[other][beside]], other))
        step = min(24.0, (BOX - 24) / len(here))
        return self.middle[self.paths[link][end]] + step * (here.index(link) - (len(here) - 1) / 2)


def _marker(name: str, colour: str) -> str:
    return (
        f'<marker id="{name}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
        f'orient="auto-start-reverse"><path d="M0 0.6 L7.5 4 L0 7.4 z" fill="{colour}"/></marker>'
    )


Spot = tuple[str, int]
"""A box or a lane, and its row."""


def placed(boxes: Sequence[Spot], links: Sequence[tuple[Spot, Spot]]) -> dict[Spot, float]:
    """Return the middles of boxes and lanes [px], near those of their neighbours and without overlap.

    Args:
        boxes: The boxes; what is in links only is a lane.
        links: Upper and lower end of each piece of an arrow, in rows that follow each other.
    """
    width = {spot: LANE for link in links for spot in link} | dict.fromkeys(boxes, BOX)
    near: dict[Spot, list[Spot]] = defaultdict(list)
    for above, below in links:
        near[above].append(below)
        near[below].append(above)
    rows = _ordered([sorted(s for s in width if s[1] == k) for k in range(1 + max(k for _, k in width))], near)
    middle = dict.fromkeys(width, WIDTH / 2)

    def pull(spot: Spot, other: Spot) -> float:  # less with distance: the sum of lengths becomes least, not of squares
        return STIFFNESS[width[spot] + width[other]] / (10.0 + abs(middle[spot] - middle[other]))

    for _ in range(ROUNDS):
        for row in (*rows, *reversed(rows)):
            wanted = [_mean([(middle[t], pull(s, t)) for t in near[s]]) for s in row]
            middle |= zip(row, _spaced(wanted, [width[s] for s in row]), strict=True)
    return middle


def _mean(weighted: Sequence[tuple[float, float]]) -> float:
    """Return the weighted mean of values; the middle of the picture where there are none."""
    total = sum(weight for _, weight in weighted)
    return sum(value * weight for value, weight in weighted) / total if total else WIDTH / 2


def _ordered(rows: list[list[Spot]], near: Mapping[Spot, Sequence[Spot]]) -> list[list[Spot]]:
    """Return rows in the order of fewest crossings that sweeps down and up find."""
    best, least = rows, _crossings(rows, near)
    for sweep in range(SWEEPS):
        down = sweep % 2 == 0
        for k in range(len(rows)) if down else reversed(range(len(rows))):
            order = {spot: float(i) for row in rows for i, spot in enumerate(row)}
            beside = k - 1 if down else k + 1
            seen = [[(order[t], 1.0) for t in near[s] if t[1] == beside] or [(order[s], 1.0)] for s in rows[k]]
            keys = {s: _mean(places) for s, places in zip(rows[k], seen, strict=True)}
            rows = [*rows[:k], sorted(rows[k], key=keys.__getitem__), *rows[k + 1 :]]
        if (count := _crossings(rows, near)) < least:
            best, least = rows, count
    return best


def _crossings(rows: Sequence[Sequence[Spot]], near: Mapping[Spot, Sequence[Spot]]) -> int:
    """Return how often straight arrows would cross."""
    count = 0
    for upper, lower in pairwise(rows):
        order = {spot: i for i, spot in enumerate(lower)}
        ends = [(i, order[other]) for i, spot in enumerate(upper) for other in near[spot] if other in order]
        count += sum((a - c) * (b - d) < 0 for k, (a, b) in enumerate(ends) for c, d in ends[:k])
    return count


def _spaced(wanted: Sequence[float], widths: Sequence[float]) -> list[float]:
    """Return the middles nearest to those wanted, in the same order, a gap apart and inside the picture.

    With the width before each taken off, middles a gap apart only must not decrease: isotonic regression, by pooling
    adjacent violators.
    """
    before = [sum(widths[:k]) + widths[k] / 2 + k * GAP for k in range(len(widths))]
    pools: list[list[float]] = []
    for value in (w - b for w, b in zip(wanted, before, strict=True)):
        pools.append([value])
        while len(pools) > 1 and sum(pools[-2]) / len(pools[-2]) > sum(pools[-1]) / len(pools[-1]):
            last = pools.pop()
            pools[-1] += last
    least, most = LABEL + MARGIN, WIDTH - MARGIN - PAD - sum(widths) - GAP * (len(widths) - 1)
    means = [min(max(sum(pool) / len(pool), least), most) for pool in pools for _ in pool]
    return [mean + b for mean, b in zip(means, before, strict=True)]
