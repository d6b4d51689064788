"""Free-body diagrams: arrows to one scale, bodies in balance, what rigid bodies do not determine."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pinarm
from pinarm.use.assessments.loads import free_bodies


def arrows(figure: Any) -> list[np.ndarray]:
    """Tip minus start of every arrow on the page [points]."""
    drawn = [(axis, text) for axis in figure.axes for text in axis.texts if getattr(text, "arrow_patch", None)]
    ends = [(axis.transData.transform([text.xyann, text.xy])) for axis, text in drawn]
    return [(tip - start) * 72.0 / figure.dpi for start, tip in ends]


def test_the_arrow_of_a_weight_is_as_long_as_its_scale_says(scenario: Callable[..., Any]) -> None:
    """A pendulum at rest: its pin carries its weight upwards, and both arrows are ``m g`` long."""
    result = scenario("statics").run()
    figure = result.sketch(forces=True)
    model = result.scenario.mechanism.model
    *drawn, bar = arrows(figure)
    (scale,) = (text.get_text() for text in figure.axes[-1].texts if text.get_text().endswith(" N"))
    up = [arrow for arrow in drawn if abs(arrow[0]) < 1e-9]
    wanted = model.inertias[1].mass * np.linalg.norm(model.gravity.linear) / float(scale.split()[0]) * bar[0]
    assert sorted(arrow[1] for arrow in up) == pytest.approx([-wanted, wanted], rel=1e-9)


def test_bodies_of_a_plane_are_in_balance_though_loads_across_it_are_open() -> None:
    """By sums of forces and moments about the world's origin: a loop of revolute joints."""
    row = pinarm.run("scenarios/slider_crank_gas.yaml").row_at(0.0031)
    assert all(free.left_out for free in free_bodies(row))
    bodies = [*free_bodies(row, np.array([0.0, 0.0, 1.0]))]
    assert len(bodies) == 3
    for free in bodies:
        forces = np.array([action.wrench[:3] for action in free.actions])
        about = [action.wrench[3:] + np.cross(action.point, action.wrench[:3]) for action in free.actions]
        assert not free.doubt
        assert np.abs(forces.sum(axis=0)).max() < 1e-11 * np.abs(forces).max()
        assert abs(np.sum(about, axis=0)[2]) < 1e-11 * np.abs(forces).max()
        assert not np.any(forces[:, 2])


def test_an_instant_that_the_run_does_not_reach_is_refused(scenario: Callable[..., Any]) -> None:
    with pytest.raises(pinarm.PinarmError, match="9 is not reached"):
        scenario("inverse").run().sketch(forces=True, at=9.0)


def test_an_instant_has_its_unit_or_is_in_si(scenario: Callable[..., Any]) -> None:
    result = scenario("inverse").run()
    assert result.row_at("500 ms")["M"].values == result.row_at(0.5)["M"].values
    with pytest.raises(pinarm.PinarmError, match="'deg' is not a unit of this quantity"):
        result.sketch(forces=True, at="40 deg")
