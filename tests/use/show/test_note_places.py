"""Names beside their points: none over another, none out of the picture, and none over a line where there is room."""

import numpy as np

from pinarm.use.show.note_places import write_beside
from pinarm.use.show.picture import Note, drawing

SIDE = 288.0
"""Points per unit: the side of a drawing of one unit."""

Window = tuple[tuple[float, float], tuple[float, float]]


def notes(*named: tuple[float, float, str]) -> list[Note]:
    return [Note(text, np.array([x, y]), "#000000") for x, y, text in named]


def written(
    names: list[Note], hidden: list[np.ndarray], window: Window = ((-0.1, 1.1), (-0.1, 1.1))
) -> tuple[list[str], list[np.ndarray], list[np.ndarray]]:
    """Names in a drawing, their boxes (left, bottom, right, top) and the ends of the lines to them [points]."""
    size = [SIDE / 72.0 * (high - low) for low, high in window]
    with drawing(*size) as picture:
        picture.set_layout_engine("none")
        axis = picture.add_axes((0.0, 0.0, 1.0, 1.0), xlim=window[0], ylim=window[1])
        write_beside(axis, names, hidden, SIDE, [])
        corner = SIDE * np.array([window[0][0], window[1][0]])
        boxes = [0.72 * text.get_window_extent().extents + np.tile(corner, 2) for text in axis.texts]
    return [text.get_text() for text in axis.texts], boxes, [SIDE * line.get_xydata() for line in axis.lines]


def apart(known: list[np.ndarray]) -> bool:
    return all((one[:2] >= other[2:] - 1e-6).any() or (other[:2] >= one[2:] - 1e-6).any()
               for k, one in enumerate(known) for other in known[:k])  # fmt: skip


def test_names_do_not_cover_each_other() -> None:
    """Twenty names around a square with sides of 1 m, some at points close to each other."""
    frame = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    places = np.random.default_rng(1).uniform(0.0, 1.0, (20, 2)).tolist()
    texts, boxes, _ = written(notes(*((x, y, f"P{k}") for k, (x, y) in enumerate(places))), [frame])
    assert len(texts) == 20
    assert apart(boxes)


def test_a_name_stays_in_the_picture() -> None:
    """A point at the edge, for which no direction is free but inwards: nothing of its name is cut off."""
    _, [box], _ = written(notes((1.0, 1.0, "the name of a point at an edge")), [], ((0.0, 1.0), (0.0, 1.0)))
    assert (box[:2] >= 0.0).all()
    assert (box[2:] <= SIDE).all()


def test_what_has_no_room_is_shortened_or_left_out() -> None:
    """The first names get the places: sixty along a line, of which few fit, and these do not meet."""
    many = notes(*((k / 60, 0.5, f"A{k}, another name of the same point") for k in range(60)))
    texts, boxes, _ = written(many, [], ((-0.1, 1.1), (0.35, 0.65)))
    assert texts[:2] == [note.text for note in many[:2]]
    assert any(text.endswith(", ...") for text in texts)
    assert len(texts) < 60
    assert apart(boxes)


def test_a_name_keeps_clear_of_lines() -> None:
    """A line through its point, and others half a point above and below its eight nearest places."""
    _, [free], _ = written(notes((0.5, 0.5, "a long name")), [])
    high = free[3] - 0.5 * SIDE  # upper edge of a name aslant above its point [points]
    heights = [0.5 + y / SIDE for y in (0.0, high + 0.5, -high - 0.5)]
    _, [box], _ = written(notes((0.5, 0.5, "a long name")), [np.array([[0.0, y], [1.0, y]]) for y in heights])
    assert all(box[1] >= SIDE * y + 1.0 or box[3] <= SIDE * y - 1.0 for y in heights)


def test_lines_to_names_cross_no_names() -> None:
    """Points in a heap: several names stand away."""
    places = np.random.default_rng(10).uniform(0.35, 0.65, (30, 2)).tolist()
    _, boxes, lines = written(notes(*((x, y, f"point {k}") for k, (x, y) in enumerate(places))), [])
    assert len(lines) >= 2
    share = np.linspace(0.0, 1.0, 200)[:, None]
    for start, end in lines:
        points = start + share * (end - start)
        assert not any(((points > box[:2] + 0.5) & (points < box[2:] - 0.5)).all(axis=1).any() for box in boxes)
