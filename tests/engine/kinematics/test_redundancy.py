"""Redundant mechanisms on a path, nearest to a posture: against scipy row by row, closed forms and differences."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize

from pinarm.engine.kinematics.redundancy import NearestMotion, Posture
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.laws import Constant, Harmonic
from pinarm.mechanics.laws.motion_law import Grid

LENGTHS = np.array([0.5, 0.4, 0.3])
PLACES = {"A": "0 0 0", "B": "0.5 0 0", "C": "0.4 0 0"}
LINKS = [{"name": name, "axis": "0 0 1", "at": at, "com": "0.2 0 0"} for name, at in PLACES.items()]
LINKS += [{"name": "tip", "kind": "fixed", "at": "0.3 0 0"}]
TASK = {name: {"kind": "point", "point": "tip_link", "along": name} for name in "xy"}
CIRCLE = {"x": Harmonic(mean=0.6, amplitude=0.15, pulsation=2.0, phase=np.pi / 2),
          "y": Harmonic(mean=0.3, amplitude=0.15, pulsation=2.0)}  # fmt: skip
TARGET, WEIGHTS = np.array([0.3, 0.5, 0.4]), np.array([1.0, 2.0, 0.5])
PERIOD = np.pi


def posture(target=TARGET, weights=WEIGHTS, lower=-np.inf, upper=np.inf, names=("A", "B", "C")):
    n = len(target)
    bounds = np.broadcast_to(lower, n).astype(float), np.broadcast_to(upper, n).astype(float)
    return Posture(np.array(target), np.array(weights), *bounds, np.arange(n), names)


def on_circle(t):
    return np.array([0.6 + 0.15 * np.cos(2 * t), 0.3 + 0.15 * np.sin(2 * t)])


def hand(q):
    """Return the place of the tip of the planar arm."""
    angles = np.cumsum(q)
    return np.array([LENGTHS @ np.cos(angles), LENGTHS @ np.sin(angles)])


def best(t, start, lower=-np.inf, upper=np.inf, target=TARGET):
    """Return the nearest configuration on the circle by scipy's SLSQP."""

    def square(q):
        return float((((q - target) * WEIGHTS) ** 2).sum())

    bounds = np.stack([np.broadcast_to(lower, 3), np.broadcast_to(upper, 3)], axis=1)
    found = minimize(square, start, method="SLSQP", bounds=bounds, options={"ftol": 1e-15, "maxiter": 300},
                     constraints={"type": "eq", "fun": lambda q: hand(q) - on_circle(t)})  # fmt: skip
    return found.x, found.fun


@pytest.fixture
def arm(mechanism, chain):
    return mechanism(chain(*LINKS), coordinates=TASK)


def grid(laws, samples=61, end=PERIOD):
    return Grid.cover(np.linspace(0.0, end, samples), laws)


def follow(mechanism, chosen, motion=CIRCLE, samples=61, end=PERIOD):
    path = NearestMotion.of(mechanism, motion, chosen)
    return path.follow(grid(path.laws, samples, end), np.array(chosen.target, float))


def test_every_row_is_the_optimum_of_an_independent_optimiser(arm):
    run = follow(arm, posture())
    for t, q in zip(run.grid.t, run.q, strict=True):
        expected, _ = best(t, q + 0.05)
        # SLSQP stops where the square changes by less than 1e-15: the joints are known to its root
        assert q == pytest.approx(expected, abs=2e-7)


def test_the_hand_is_on_the_path_to_rounding_with_its_rates(arm):
    run = follow(arm, posture())
    figures = run.motion.figures(run)
    assert set(figures) == {"path", "path rate", "path acceleration"}
    assert max(figures.values()) < 1e-13
    assert np.array([hand(q) for q in run.q]) == pytest.approx(np.array([on_circle(t) for t in run.grid.t]), abs=1e-14)


def test_velocity_and_acceleration_are_the_derivatives_of_the_configuration(arm, differentiate):
    path = NearestMotion.of(arm, CIRCLE, posture())
    run = path.follow(grid(path.laws), TARGET)

    def states(t):
        at = run.motion.follow(Grid(np.array([t]), run.grid.cuts, (0, 1)), run.q[np.abs(run.grid.t - t).argmin()])
        return np.concatenate([at.q[0], at.v[0], at.a[0]])

    for t in (0.4, 1.3, 2.6):
        # differences of order 8 at h = 0.02 of functions of 2 rad/s and some harmonics: 1e-11
        assert differentiate(states, t)[:6] == pytest.approx(states(t)[3:], abs=1e-9)


class TestLimits:
    lower, upper = np.array([-0.27, -3.0, -3.0]), np.array([3.0, 3.0, 2.45])

    def chosen(self):
        return posture(lower=self.lower, upper=self.upper)

    def test_rows_are_those_of_an_independent_optimiser_with_bounds(self, arm):
        run = follow(arm, self.chosen())
        assert len(run.motion.jumps) == 4  # A and C each reach a limit and come off it
        at_limit = 0
        for t, q in zip(run.grid.t, run.q, strict=True):
            expected, _ = best(t, np.clip(q + 0.05, self.lower, self.upper), self.lower, self.upper)
            assert q == pytest.approx(expected, abs=1e-6)
            at_limit += min(abs(q[0] + 0.27), abs(q[2] - 2.45)) < 1e-12
        assert 10 < at_limit < len(run.q) - 10

    def test_velocities_jump_where_limits_change_and_nowhere_else(self, arm):
        run = follow(arm, self.chosen())
        jumps = [k for k in range(1, len(run.grid.t)) if run.grid.t[k] == run.grid.t[k - 1]]
        assert [run.grid.t[k] for k in jumps] == list(run.motion.bounds)
        for k in jumps:
            assert run.q[k] == pytest.approx(run.q[k - 1], abs=1e-14)
            assert np.abs(run.v[k] - run.v[k - 1]).max() > 1e-3
            still = [(np.abs(v) < 1e-12).any() for v in run.v[k - 1 : k + 1]]
            assert sorted(still) == [False, True]  # one joint stands, on one side

    def test_a_path_that_leaves_the_limits_on_its_way_is_refused(self, arm):
        """C stops at its limit, then A: the freedom is used up."""
        lower, upper = np.array([-0.2, -3.0, -3.0]), np.array([3.0, 3.0, 2.2])
        with pytest.raises(AssemblyError, match=r"beyond t = 1\.8.* A reaches its limit, as C did before"):
            follow(arm, posture(lower=lower, upper=upper))


def test_a_posture_that_leaves_freedom_is_refused(arm):
    """Tip on a line only: two freedoms, of which the posture determines one."""
    with pytest.raises(AssemblyError, match="is not determined"):
        follow(arm, posture(target=(0.0, 0.0, 0.7), weights=(0.0, 0.0, 1.0)), motion={"x": Constant(value=0.6)})


def test_as_many_laws_as_freedoms_leave_nothing_to_resolve(arm):
    still = Constant(value=0.1)
    for motion, message in ((CIRCLE | {"A": still}, "nothing is left to resolve"),
                            (CIRCLE | {"A": still, "B": still}, "only 3 degrees")):  # fmt: skip
        with pytest.raises(InputError, match=message):
            NearestMotion.of(arm, motion, posture())


def test_two_freedoms_of_a_spatial_arm_against_the_optimiser(mechanism, chain):
    """Five joints about changing axes and a slide, tip on a spatial curve: rows of J of every kind bend."""
    axes = ("0 0 1", "0 1 0", "1 0 0", "0 1 0", "0 0 1")
    joints = [{"name": f"j{k}", "axis": axis, "at": "0.25 0 0.1"} for k, axis in enumerate(axes)]
    joints[2] |= {"kind": "prismatic"}
    task = {x: {"kind": "point", "point": "tip_link", "along": x} for x in "xyz"}
    arm = mechanism(chain(*joints, {"name": "tip", "kind": "fixed", "at": "0.3 0.1 0"}), coordinates=task)
    target, weights = np.array([0.2, -0.4, 0.1, 0.9, 0.5]), np.array([1.0, 1.0, 3.0, 0.7, 1.0])
    names = tuple(f"j{k}" for k in range(5))
    model, data = arm.model, arm.model.createData()
    frame = model.getFrameId("tip_link")

    def tip(q):
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[frame].translation.copy()

    middle = tip(target)
    motion = {x: Harmonic(mean=middle[k] + 0.05, amplitude=0.1, pulsation=1.0 + k, phase=0.3 * k)
              for k, x in enumerate("xyz")}  # fmt: skip
    path = NearestMotion.of(arm, motion, posture(target, weights, names=names))
    run = path.follow(grid(path.laws, 21, 2.0), target)
    for row in (0, 7, 15, 20):
        place = tip(run.q[row])
        found = minimize(lambda q: float((((q - target) * weights) ** 2).sum()), run.q[row] + 0.02, method="SLSQP",
                         constraints={"type": "eq", "fun": lambda q, place=place: tip(q) - place},
                         options={"ftol": 1e-16, "maxiter": 300})  # fmt: skip
        assert run.q[row] == pytest.approx(found.x, abs=1e-6)
    coarse = np.gradient(run.q, run.grid.t, axis=0, edge_order=2)
    assert run.v[1:-1] == pytest.approx(coarse[1:-1], abs=0.05)


def test_where_the_nearest_configuration_leaps_the_run_ends(arm):
    """The minimum vanishes at t = 1.3749: the optimiser goes far from there just after it, and not before."""
    target = np.array([1.11, 0.45, 1.67])
    with pytest.raises(AssemblyError, match=r"is not determined at 1\.3748") as caught:
        follow(arm, posture(target=target))
    assert 1.374 < caught.value.data["t"] < 1.376
    near = follow(arm, posture(target=target), samples=31, end=1.374).q[-1]
    before, after = (best(t, near, target=target)[0] for t in (1.373, 1.376))
    assert np.abs(before - near).max() < 0.02
    assert np.abs(after - near).max() > 0.1
