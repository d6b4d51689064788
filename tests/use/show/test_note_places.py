"""Names beside their points: none over another, none out of the picture, and none over a line where there is room."""

import numpy as np

from pinarm.use.show.chart import Line, Note, Window
from pinarm.use.show.labels import text_width
from pinarm.use.show.note_places import LINE, leaders, note_places

SIDE = 300.0
"""Points per unit: the side of a drawing of one unit."""

WINDOW = ((-0.1, 1.1), (-0.1, 1.1))


def boxes(notes: list[Note], per: float) -> list[np.ndarray]:
    """Left, bottom, right, top of the names [points]."""
    found = []
    for note in notes:
        half = np.array([text_width(note.text, note.size), LINE * note.size]) / 2
        middle = per * np.array([note.x, note.y]) + [note.dx, note.dy]
        found.append(np.concatenate([middle - half, middle + half]))
    return found


def apart(known: list[np.ndarray]) -> bool:
    return all((one[:2] >= other[2:]).any() or (other[:2] >= one[2:]).any()
               for k, one in enumerate(known) for other in known[:k])  # fmt: skip


def test_names_do_not_cover_each_other() -> None:
    """Twenty names around a square with sides of 1 m, some at points close to each other."""
    frame = Line(np.array([0.0, 1.0, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, 1.0, 0.0]))
    places = np.random.default_rng(1).uniform(0.0, 1.0, (20, 2))
    placed = note_places([Note(x, y, f"P{k}") for k, (x, y) in enumerate(places.tolist())], [frame], WINDOW, SIDE)
    assert len(placed) == 20
    assert apart(boxes(placed, SIDE))


def test_a_name_stays_in_the_picture() -> None:
    """A point at the edge, for which no direction is free but inwards: nothing of its name is cut off."""
    window: Window = ((0.0, 1.0), (0.0, 1.0))
    [note] = note_places([Note(1.0, 1.0, "the name of a point at an edge")], [], window, SIDE)
    [box] = boxes([note], SIDE)
    assert (box[:2] >= 0.0).all()
    assert (box[2:] <= SIDE).all()


def test_what_has_no_room_is_shortened_or_left_out() -> None:
    """The first names get the places: sixty along a line, of which few fit, and these do not meet."""
    many = [Note(k / 60, 0.5, f"A{k}, another name of the same point") for k in range(60)]
    placed = note_places(many, [], ((-0.1, 1.1), (0.35, 0.65)), SIDE)
    assert [note.text for note in placed[:2]] == [note.text for note in many[:2]]
    assert any(note.text.endswith(", ...") for note in placed)
    assert len(placed) < 60
    assert apart(boxes(placed, SIDE))


def test_a_name_keeps_clear_of_lines() -> None:
    """Of its eight nearest places, a line would touch the upper ones half a point away, and another cover the lower."""
    high = 5.0 * np.sin(np.pi / 4) + LINE * 8.0  # upper edge of a name aslant above its point [points]
    lines = [Line(np.array([0.0, 1.0]), np.full(2, 0.5 + y / SIDE)) for y in (0.0, high + 0.5, -8.0)]
    [box] = boxes(note_places([Note(0.5, 0.5, "P")], lines, WINDOW, SIDE), SIDE)
    assert all(box[1] >= SIDE * line.y[0] + 1.0 or box[3] <= SIDE * line.y[0] - 1.0 for line in lines)


def crossed(line: Line, other: Line) -> bool:
    """Whether two lines have a point in common that is inside of both, by the solution of two equations."""
    (start, end), (first, last) = (np.array([each.x, each.y]).T for each in (line, other))
    ways = np.stack([end - start, first - last], axis=1)
    if abs(np.linalg.det(ways)) < 1e-12:
        return False
    shares = np.linalg.solve(ways, first - start)
    return bool(((shares > 1e-9) & (shares < 1.0 - 1e-9)).all())


def test_lines_to_names_cross_neither_names_nor_each_other() -> None:
    """Points in a heap: several names stand away."""
    places = np.random.default_rng(10).uniform(0.35, 0.65, (30, 2)).tolist()
    placed = note_places([Note(x, y, f"point {k}") for k, (x, y) in enumerate(places)], [], WINDOW, SIDE)
    lines, known = leaders(placed, SIDE), boxes(placed, SIDE)
    assert len(lines) >= 5
    assert not any(crossed(line, other) for k, line in enumerate(lines) for other in lines[:k])
    share = np.linspace(0.0, 1.0, 200)[:, None]
    for line in lines:
        start, end = SIDE * np.array([line.x, line.y]).T
        points = start + share * (end - start)
        covered = [((points > box[:2] + 1e-6) & (points < box[2:] - 1e-6)).all(axis=1).any() for box in known]
        assert not any(covered)
