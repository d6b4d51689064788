"""The graph of links: every body once, no box over another, every joint between the bodies that it joins."""

import itertools
from pathlib import Path
from xml.etree import ElementTree

from pinarm.use.mechanism import Mechanism
from pinarm.use.report.link_graph import HIGH, WIDE, link_graph

MODELS = Path(__file__).parents[3] / "models"


def test_boxes_stand_apart_and_joints_join_them() -> None:
    mechanism = Mechanism.load(MODELS / "manipulator" / "mechanism.yaml")
    model, root = mechanism.model, ElementTree.fromstring(link_graph(mechanism))
    places = [[float(box.get(key, "")) for key in ("x", "y")] for box in root.iter("rect")]
    assert len(places) == model.njoints
    for (x, y), (u, w) in itertools.combinations(places, 2):
        assert abs(x - u) >= WIDE or abs(y - w) >= HIGH
    names = [text.text for text in root.iter("text") if text.get("class") == "joint"]
    assert names == list(model.names)[1:]
    for index, line in enumerate(root.iter("line"), start=1):
        (x, y), (u, w) = places[model.parents[index]], places[index]
        ends = [float(line.get(key, "")) for key in ("x1", "y1", "x2", "y2")]
        assert ends == [x + WIDE / 2, y + HIGH, u + WIDE / 2, w]
    width, height = (float(root.get(key, "")) for key in ("width", "height"))
    assert all(0 <= x <= width - WIDE and y + HIGH <= height for x, y in places)
    assert len(list(root.iter("path"))) == sum(hasattr(tie, "first") for tie in mechanism.constraints) > 0
