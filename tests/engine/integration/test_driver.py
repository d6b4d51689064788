from itertools import pairwise

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.integrator import Interval, Manifold, Watch
from pinarm.engine.integration.methods.explicit import Adaptive, FixedStep
from pinarm.engine.integration.methods.stiff import radau_of
from pinarm.errors import IntegrationError, Interrupted

from .methods.known_motions import ATTITUDE, MOMENTS, PLANE, attraction, body, orbit


@pytest.fixture
def top():
    return body()


class TestKnots:
    """A force that rests but for a pulse, ``x'' = 6 u (1 - u)`` with u from 0 to 1 in 1e-3 s of 6 s: x' gains 1e-3."""

    PULSE = (2.0, 2.001)

    def pulse(self, t, q, v):
        u = np.clip((t - self.PULSE[0]) / (self.PULSE[1] - self.PULSE[0]), 0.0, 1.0)
        return np.full(1, 6.0 * u * (1.0 - u))

    @pytest.mark.parametrize("method", [Adaptive(1e-9), radau_of(1e-6), FixedStep(0.7)], ids=lambda one: one.name)
    def test_steps_end_there(self, method):
        interval = Interval(0.0, 6.0, self.pulse, knots=self.PULSE)
        solution = integrate([interval], Manifold(1, 1), np.zeros(1), np.zeros(1), method)
        assert {*self.PULSE, 6.0} <= {*solution.steps.until.tolist()}
        assert not solution.owners(np.arange(len(solution.steps))).any()
        q, v = solution.states(np.array([1.0, 2.0005, 6.0]))
        assert v[:, 0] == pytest.approx([0.0, 5e-4, 1e-3], abs=1e-12)  # of rounding of u
        assert q[2, 0] == pytest.approx(1e-3 * (6.0 - 2.0005), rel=1e-9)


class TestTolerance:
    tolerances = 10.0 ** -np.arange(4, 13, 2)

    def errors(self, acceleration, manifold, q, v, t, exact):
        found = []
        for tolerance in self.tolerances:
            solution = integrate([Interval(0.0, t[-1], acceleration)], manifold, q, v, Adaptive(tolerance))
            found.append(np.abs(np.hstack(solution.states(t)) - exact).max())
        return np.array(found)

    def check(self, errors):
        # the step follows tolerance^(1/8) and the error its eighth power; the motions amplify it less than 300 times
        assert np.polyfit(np.log(self.tolerances), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.15)
        assert (errors < 300 * self.tolerances).all()

    def test_error_shrinks_with_it_in_the_plane(self):
        t = np.linspace(0.0, 20.0, 501)
        self.check(self.errors(attraction, PLANE, *orbit(0.0), t, np.hstack(orbit(t))))


def test_free_rotation_follows_the_elliptic_functions(top):
    """Landau and Lifshitz, Mechanics, section 37, for M^2 > 2 E I2: rotation near the axis of the largest moment."""
    i1, i2, i3 = MOMENTS
    w = np.array([0.3, 0.0, 1.2])
    energy2, momentum2 = float(MOMENTS @ w**2), float(MOMENTS**2 @ w**2)
    assert momentum2 > energy2 * i2
    rate = np.sqrt((i3 - i2) * (momentum2 - energy2 * i1) / (i1 * i2 * i3))
    m = (i2 - i1) * (energy2 * i3 - momentum2) / ((i3 - i2) * (momentum2 - energy2 * i1))
    t = np.linspace(0.0, 1.3 * 4 * ellipk(m) / rate, 301)
    sn, cn, dn, _ = ellipj(rate * t, m)
    expected = np.array([
        np.sqrt((energy2 * i3 - momentum2) / (i1 * (i3 - i1))) * cn,
        np.sqrt((energy2 * i3 - momentum2) / (i2 * (i3 - i2))) * sn,
        np.sqrt((momentum2 - energy2 * i1) / (i3 * (i3 - i1))) * dn,
    ])  # fmt: skip
    interval = Interval(0.0, t[-1], top.acceleration())
    _, v = integrate([interval], top.manifold, ATTITUDE, w, Adaptive(1e-13)).states(t)
    assert pytest.approx(expected, abs=1e-11) == v.T


class TestFailures:
    flat = Manifold(1, 1)

    def fails(self, acceleration, q=0.0, v=1.0, end=2.0):
        with pytest.raises(IntegrationError) as caught:
            integrate([Interval(0.0, end, acceleration)], self.flat, np.array([q]), np.array([v]), Adaptive(1e-9))
        return caught.value

    def test_blow_up_in_finite_time(self):
        error = self.fails(lambda t, q, v: v**2)
        assert "grows without bound" in error.message
        # v = 1/(1 - t)
        assert error.partial.end == pytest.approx(1.0, abs=1e-6)
        t = np.linspace(0.0, 0.9, 10)
        assert error.partial.states(t)[1][:, 0] == pytest.approx(1 / (1 - t), rel=1e-7)

    def test_acceleration_that_ceases_to_be_a_number(self):
        error = self.fails(lambda t, q, v: -q if t < 0.7 else np.nan * q)
        assert "not finite" in error.message
        assert error.partial.end == pytest.approx(0.7, abs=1e-6)
        assert error.data["t"] == error.partial.end
        t = np.linspace(0.0, 0.69, 10)
        assert error.partial.states(t)[0][:, 0] == pytest.approx(np.sin(t), abs=1e-8)


class TestInterruption:
    """Ctrl-C arrives in the middle of an acceleration, which is where nearly all of the time is spent."""

    flat = Manifold(1, 1)
    start = (np.ones(1), np.zeros(1))

    def stopped(self, when, intervals=1):
        """Return what is raised by an oscillator that is interrupted at its call ``when`` in the last interval."""
        calls = []

        def acceleration(t, q, v):
            return -q

        def interrupted(t, q, v):
            calls.append(t)
            if len(calls) == when:
                raise KeyboardInterrupt
            return -q

        cuts = np.linspace(0.0, 20.0, intervals + 1).tolist()
        parts = [Interval(low, high, acceleration) for low, high in pairwise(cuts)]
        parts[-1] = Interval(*cuts[-2:], interrupted)
        with pytest.raises((Interrupted, KeyboardInterrupt)) as caught:
            integrate(parts, self.flat, *self.start, Adaptive(1e-10))
        assert isinstance(caught.value, Interrupted), "what was integrated is lost"
        return caught.value

    @pytest.mark.parametrize("when", [205])
    def test_what_was_integrated_is_kept(self, when):
        error = self.stopped(when)
        assert 0.0 < error.partial.end < 20.0
        assert f"interrupted at t = {error.partial.end:.9g} s" in error.message
        assert error.exit_code == 130
        t = np.linspace(0.0, error.partial.end, 50)
        q, v = error.partial.states(t)
        assert q[:, 0] == pytest.approx(np.cos(t), abs=1e-8)
        assert v[:, 0] == pytest.approx(-np.sin(t), abs=1e-8)


@pytest.mark.parametrize("speed", [0.0, 1e-6])
@pytest.mark.parametrize("method", [radau_of(1e-3), radau_of(1e-6)])
def test_what_leaves_a_stop_does_not_meet_it_at_once(method, speed):
    """``q = cos(2 t)`` leaves 1: the dense output of a long first step goes on beyond 1 for an instant."""

    def swing(t, q, v):
        return -4.0 * q

    gap = Watch(lambda t, q, v: 1.0 - q[:, 0] + 2e-13, -1, stops=True)
    interval = Interval(0.0, 1.5, swing)
    solution = integrate([interval], Manifold(1, 1), np.ones(1), np.array([-speed]), method, watches=[gap])
    assert not solution.crossings
    t = np.linspace(0.0, 1.5, 31)
    assert solution.states(t)[0][:, 0] == pytest.approx(np.cos(2.0 * t) - speed / 2.0 * np.sin(2.0 * t),
                                                        abs=20.0 * method.tolerance)  # fmt: skip


def test_a_bounce_that_is_over_soon_is_seen_at_its_instant():
    """Up with 1e-5 against 1: back after twice the speed over the deceleration, which the first step is longer than."""
    speed, pull = 1e-5, 2.0

    def spring(t, q, v):
        return -pull * (1.0 + q)

    ground = Watch(lambda t, q, v: q[:, 0], -1, stops=True)
    method = radau_of(1e-3)
    solution = integrate(
        [Interval(0.0, 4.0, spring)], Manifold(1, 1), np.zeros(1), np.array([speed]), method, watches=[ground]
    )
    assert solution.end == pytest.approx(2.0 * speed / pull, rel=1e-4)
    assert solution.states(np.array([solution.end]))[1][0, 0] == pytest.approx(-speed, rel=1e-4)
