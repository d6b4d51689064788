"""Names beside their points: none over another, and none over a line where there is room."""

import numpy as np

from pinarm.use.show.chart import Line, Note
from pinarm.use.show.note_places import LETTER, LINE, note_places

SIDE = 300.0
"""Points: length of the side of the drawing."""


def boxes(notes: list[Note], per: float) -> list[np.ndarray]:
    """Left, bottom, right, top of the names [points]."""
    found = []
    for note in notes:
        half = np.array([LETTER * note.size * len(note.text), LINE * note.size]) / 2
        middle = per * np.array([note.x, note.y]) + [note.dx, note.dy]
        found.append(np.concatenate([middle - half, middle + half]))
    return found


def test_names_do_not_cover_each_other() -> None:
    """Twenty names around a square with sides of 1 m, some at points close to each other."""
    frame = Line(np.array([0.0, 1.0, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, 1.0, 0.0]))
    places = np.random.default_rng(1).uniform(0.0, 1.0, (20, 2))
    placed = note_places([Note(x, y, f"P{k}") for k, (x, y) in enumerate(places.tolist())], [frame], [frame], SIDE,
                         kept=20)  # fmt: skip
    assert len(placed) == 20
    known = boxes(placed, SIDE)
    for k, one in enumerate(known):
        for other in known[:k]:
            assert (one[:2] >= other[2:]).any() or (other[:2] >= one[2:]).any()


def test_a_name_stands_clear_of_lines() -> None:
    """A point on a horizontal line is named above or below it."""
    line = Line(np.array([0.0, 1.0]), np.zeros(2))
    [note] = note_places([Note(0.5, 0.0, "a name")], [line], [line], SIDE, kept=1)
    [box] = boxes([note], SIDE)
    assert box[1] >= 0.0 or box[3] <= 0.0


def test_what_has_no_room_is_left_out_if_it_may_be() -> None:
    line = Line(np.array([0.0, 1.0]), np.zeros(2))
    many = [Note(0.5, 0.0, "a long name of a point") for _ in range(60)]
    placed = note_places(many, [line], [line], SIDE, kept=2)
    assert 2 <= len(placed) < 60
    assert len(note_places(many, [line], [line], SIDE, kept=60)) == 60
