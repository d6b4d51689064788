"""Where a watched value turns near zero: found, counted once, and open where the errors of steps are larger."""

import numpy as np
import pytest

from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Interval, Manifold, Watch
from pinarm.engine.integration.methods import METHODS

SETTINGS = {"tolerance": (1e-4, 1e-9), "step": (0.1, 0.02)}
ALL = [(name, value) for name in ("dop853", "dopri5", "rk4", "stiff") for value in SETTINGS[METHODS[name].setting]]


def cosine(watch, method, end=20.0):
    """The unit oscillator from (1, 0): q = cos t."""
    interval = Interval(0.0, end, lambda t, q, v: -q)
    return integrate([interval], Manifold(1, 1), np.ones(1), np.zeros(1), method, watches=[watch])


def level(value, **changes):
    """Watch of a coordinate whose value is as wrong as the coordinate, which is relative to ``1 + |q|``."""
    given = {"begins": 0.0, "level": abs(value), "what": "event 'one' takes place", "sensitivity": lambda *state: 4.0}
    return Watch(lambda t, q, v: q[:, 0] - value, **({"direction": 0, "stops": False} | given | changes))


@pytest.mark.parametrize(("name", "setting"), ALL)
def test_a_motion_that_turns_at_its_start_value_comes_back_once_a_period(name, setting):
    """At 2 pi k exactly; which side of the value it turns at is an error, and so the decision is open."""
    found = cosine(level(1.0), METHODS[name].make(setting))
    tight = setting if METHODS[name].setting == "tolerance" else setting**4
    assert [one.t for one in found.crossings] == pytest.approx(2.0 * np.pi * np.arange(1, 4), abs=300.0 * tight + 1e-9)
    assert found.nearest[0].is_open


@pytest.mark.parametrize(("name", "setting"), ALL)
@pytest.mark.parametrize("apart", [1e-1, 1e-5, 1e-9, 0.0, -1e-7, -1e-1])
def test_whether_a_value_is_passed_is_right_or_open(name, setting, apart):
    """The value lies beyond the lower turn by ``apart``: no crossing, or two in each of three periods."""
    found = cosine(level(-1.0 - apart, level=None), METHODS[name].make(setting))
    count = 0 if apart > 0.0 else 6
    assert found.nearest[0].is_open or len(found.crossings) == count
    if abs(apart) > 0.01:
        assert not found.nearest[0].is_open
    if found.nearest[0].is_open:
        assert abs(found.nearest[0].margin) <= found.nearest[0].error
