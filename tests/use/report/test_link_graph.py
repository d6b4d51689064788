"""The graph of links: every body once, no box over another, every joint between the bodies that it joins."""

import itertools
from pathlib import Path

from pinarm.use.mechanism import Mechanism
from pinarm.use.report.link_graph import HIGH, WIDE, link_graph

MODELS = Path(__file__).parents[3] / "models"


def test_boxes_stand_apart_and_joints_join_them() -> None:
    mechanism = Mechanism.load(MODELS / "manipulator" / "mechanism.yaml")
    graph = link_graph(mechanism)
    assert graph is not None
    model = mechanism.model
    assert len(graph.boxes) == model.njoints
    for one, other in itertools.combinations(graph.boxes, 2):
        assert abs(one.x - other.x) >= WIDE or abs(one.y - other.y) >= HIGH
    for index, (x, y, u, w, label) in enumerate(graph.joints, start=1):
        above, below = graph.boxes[model.parents[index]], graph.boxes[index]
        assert (x, y, u, w) == (above.x, above.y + HIGH / 2, below.x, below.y - HIGH / 2)
        assert label.text == model.names[index]
    assert all(box.x - WIDE / 2 >= 0 and box.x + WIDE / 2 <= graph.width for box in graph.boxes)
    assert all(box.y + HIGH / 2 <= graph.height for box in graph.boxes)
    assert len(graph.loops) == sum(hasattr(one, "first") for one in mechanism.constraints) > 0
