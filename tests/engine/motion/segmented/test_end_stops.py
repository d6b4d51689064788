"""Impacts at end stops, rest on them and the way off them, against closed forms of a weight that slides up and down."""

import itertools
import re
from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.mechanics.forces.along_coordinate import JointEffort
from pinarm.mechanics.laws import Constant, ConstantSpeed, Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.events import EndStop
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.time_grid import TimeGrid

MASS, G = 2.0, 9.81
WEIGHT = {"name": "weight", "kind": "prismatic", "axis": "0 0 1", "mass": MASS, "inertia": (0.1, 0.1, 0.1)}


@pytest.fixture
def fall(mechanism, chain):
    """A function that lets the weight move above a floor; its height at the samples, and when it met the floor."""
    model = mechanism(chain(WEIGHT), gravity={"direction": "-z", "magnitude": f"{G} m/s^2"})

    def run(end, *, floor=0.0, height=0.0, speed=0.0, restitution=0.0, push=None):
        problem = Forward(
            time=TimeGrid(end=end, samples=61),
            initial=InitialState(position={"weight": height}, velocity={"weight": speed}),
            loads={"push": JointEffort(joint="weight", effort=push)} if push else {},
            end_stops={"weight": EndStop(lower=floor, restitution=restitution)},
        )
        found = problem.solve(model, Accuracy(tolerance=1e-12), lambda *path: nullcontext())
        return found.rows.grid.t, found.rows.q[:, 0], np.array([one.t for one in found.events])

    return run


@pytest.mark.parametrize("floor", [-0.3, 1e3])
@pytest.mark.parametrize("factor", [1.0 + 1e-9, 3.0])
def test_what_is_pushed_off_from_rest_leaves_and_does_not_meet_the_stop_again(fall, floor, factor):
    t, height, met = fall(1.0, floor=floor, height=floor, push=Constant(value=factor * MASS * G))
    assert len(met) == 0
    assert height - floor == pytest.approx(0.5 * (factor - 1.0) * G * t**2, abs=1e-12 * (1.0 + abs(floor)), rel=1e-9)


def test_what_rests_leaves_when_the_push_has_grown_to_its_weight(fall):
    growth, lifted = 40.0, MASS * G / 40.0
    t, height, met = fall(1.0, push=ConstantSpeed(start=0.0, speed=growth))
    assert len(met) == 0
    # a stop is given up where its push is 0, found to rounding of the push
    expected = growth * np.maximum(t - lifted, 0.0) ** 3 / (6.0 * MASS)
    assert height == pytest.approx(expected, abs=1e-11)


def test_impacts_follow_each_other_as_those_of_a_bouncing_ball_do(fall):
    drop, restitution = 1.2, 0.6
    first, speed = (2.0 * drop / G) ** 0.5, (2.0 * G * drop) ** 0.5
    pauses = 2.0 * speed / G * restitution ** np.arange(1, 29)  # until it rebounds with less than 1e-6 m/s
    expected = first + np.concatenate([[0.0], np.cumsum(pauses)])
    t, height, met = fall(3.0, height=drop, restitution=restitution)
    assert met[:20] == pytest.approx(expected[:20], abs=1e-10)
    assert len(met) == pytest.approx(np.log(1e-6 / speed) / np.log(restitution), abs=1.0)
    assert height[t > expected[-1] + 1e-5] == pytest.approx(0.0, abs=1e-13)


@pytest.mark.parametrize(("restitution", "lost"), [(0.0, 1.0), (0.5, 1.0), (1.0, 0.0)])
def test_the_energy_that_impacts_take_is_told(mechanism, chain, restitution, lost):
    """All of m g h of what comes to rest on the stop, nothing of what bounces for ever."""
    model = mechanism(chain(WEIGHT), gravity={"direction": "-z", "magnitude": f"{G} m/s^2"})
    problem = Forward(time=TimeGrid(end=3.0, samples=61), initial=InitialState(position={"weight": 0.5}),
                      end_stops={"weight": EndStop(lower=0.0, restitution=restitution)})  # fmt: skip
    found = problem.solve(model, Accuracy(tolerance=1e-12), lambda *path: nullcontext())
    (note,) = (note for note in found.notes if note.startswith("end stop 'weight lower'"))
    assert f"the first at t = {(2 * 0.5 / G) ** 0.5:.6g} s" in note
    taken = float(note.partition(" J;")[0].rpartition(" ")[2])
    assert taken == pytest.approx(lost * MASS * G * 0.5, rel=1e-3, abs=1e-9)  # three digits are told


def two_weights(mechanism, **description):
    """Return two equal weights side by side, which know nothing of one another."""
    one = (
        '<link name="W"><inertial><mass value="2"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    joint = (
        '<joint name="W" type="prismatic"><parent link="base"/><child link="W"/><axis xyz="0 0 1"/>'
        '<limit lower="-100" upper="100" effort="1e9" velocity="1e9"/></joint>'
    )
    parts = "".join((one + joint).replace('"W"', f'"{name}"') for name in ("first", "second"))
    return mechanism(
        f'<robot name="test"><link name="base"/>{parts}</robot>',
        **{"gravity": {"direction": "-z", "magnitude": f"{G} m/s^2"}, **description},
    )


@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("offset", [0.0, 1e-16, -3e-14, 1e-7])
def test_stops_that_are_met_at_one_instant_are_all_met(mechanism, offset, restitution):
    """Each weight moves as it does alone, however small the difference of their impacts, or none."""
    problem = Forward(
        time=TimeGrid(end=1.0, samples=41), initial=InitialState(position={"second": offset}),
        end_stops={name: EndStop(lower=-0.5, restitution=restitution) for name in ("first", "second")},
    )  # fmt: skip
    found = problem.solve(two_weights(mechanism), Accuracy(tolerance=1e-12), lambda *path: nullcontext())
    first, second = found.rows.q.T
    assert first.min() > -0.5 - 1e-12
    assert second == pytest.approx(first, abs=4.0 * abs(offset) + 1e-12)
    met = [[event.t for event in found.events if event.name == f"{name} lower"] for name in ("first", "second")]
    assert len(met[0]) == pytest.approx(len(met[1]), abs=0 if abs(offset) < 1e-8 else 1)
    told = [note for note in found.notes if note.startswith("end stop")]
    energy = sum(float(re.search(r"takes? ([0-9.]+) J", note)[1]) for note in told)
    assert energy == pytest.approx(2.0 * 9.81, rel=0.02)  # m g h of both, told together where rounding tells no order


def random_arm(seed, mechanism, chain, **description):
    """Return an arm of three to five joints of random sizes, the sides of stops at 0, its mass matrix and its model."""
    rng = np.random.default_rng(seed)
    words = lambda low, high: " ".join(f"{x:.6f}" for x in rng.uniform(low, high, 3))  # noqa: E731
    bodies = [
        {
            "name": f"J{k}", "kind": str(rng.choice(["continuous", "prismatic"])), "axis": words(-1, 1),
            "at": words(-0.7, 0.7), "com": words(-0.5, 0.5), "mass": float(10.0 ** rng.uniform(-1, 1)),
            "inertia": (float(10.0 ** rng.uniform(-3, -1)),) * 3,
        }
        for k in range(int(rng.integers(3, 6)))
    ]  # fmt: skip
    model = mechanism(chain(*bodies), **description)
    nv = len(bodies)
    return rng, model, rng.choice([-1.0, 1.0], size=nv), model.mass_matrix(np.zeros(nv))


def nearest_by_trying(mass, free, least, sides):
    """Return the vector nearest to a free one, measured by masses, whose entries are at least given ones.

    All sets of entries that are exactly these are tried.
    """
    inverse, count = np.linalg.inv(mass), len(free)
    for chosen in itertools.product([False, True], repeat=count):
        held = np.flatnonzero(chosen)
        impulses = np.linalg.solve(inverse[np.ix_(held, held)], least[held] - free[held])
        found = free + inverse[:, held] @ impulses
        scale = np.abs(free).max()
        if (sides[held] * impulses >= 0.0).all() and (sides * (found - least) >= -1e-12 * scale).all():
            return found
    raise AssertionError


def stops_at_zero(sides, restitution=0.0):
    return {
        f"J{k}": EndStop(**{"lower" if side > 0 else "upper": 0.0}, restitution=restitution)
        for k, side in enumerate(sides)
    }


@pytest.mark.parametrize("seed", [0, 1, 12, 56, 170])
def test_what_rests_on_several_stops_leaves_those_that_would_pull(mechanism, chain, seed):
    """Some that pull as long as others hold push once these have let go."""
    gravity = {"direction": "-z", "magnitude": f"{G} m/s^2"}
    _, model, sides, mass = random_arm(seed, mechanism, chain, gravity=gravity)
    free = model.forward(*np.zeros((3, len(sides))))
    problem = Forward(time=TimeGrid(end=1e-4, samples=3), end_stops=stops_at_zero(sides))
    found = problem.solve(model, Accuracy(tolerance=1e-10), lambda *path: nullcontext())
    expected = nearest_by_trying(mass, free, np.zeros(len(sides)), sides)
    assert found.rows.a[0] == pytest.approx(expected, rel=1e-8, abs=1e-8 * np.abs(free).max())


@pytest.mark.parametrize("restitution", [0.0, 0.3])
@pytest.mark.parametrize("seed", [0, 1, 15, 82])
def test_an_impact_of_what_rests_on_others_enters_none(mechanism, chain, seed, restitution):
    rng, model, sides, mass = random_arm(seed, mechanism, chain, gravity="none")
    hit = int(rng.integers(len(sides)))
    before = np.where(np.arange(len(sides)) == hit, -sides, 0.0)
    problem = Forward(
        time=TimeGrid(end=1e-9, samples=2), end_stops=stops_at_zero(sides, restitution),
        initial=InitialState(velocity={f"J{k}": float(speed) for k, speed in enumerate(before)}),
    )  # fmt: skip
    found = problem.solve(model, Accuracy(tolerance=1e-10), lambda *path: nullcontext())
    expected = nearest_by_trying(mass, before, -restitution * before, sides)
    assert found.rows.v[0] == pytest.approx(expected, abs=1e-8)


HOLD, PULL, PACE = 3.0, 10.0, 5.0


def pulled_to_and_fro(model, names):
    """Return the motion of weights with friction between stops under a load PULL sin(PACE t) on each."""
    problem = Forward(
        time=TimeGrid(end=3.0, samples=301),
        loads={name: JointEffort(joint=name, effort=Harmonic(amplitude=PULL, pulsation=PACE)) for name in names},
        end_stops={name: EndStop(lower=-0.1, upper=0.1) for name in names},
    )
    return problem.solve(model, Accuracy(tolerance=1e-12), lambda *path: nullcontext())


def test_what_friction_holds_at_a_stop_breaks_loose_from_it(mechanism):
    """From the upper stop, where it came to rest, once the load has turned and exceeds the friction."""
    model = two_weights(mechanism, gravity="none", friction={"first": {"constant": f"{HOLD} N"}})
    found = pulled_to_and_fro(model, ["first"])
    loose = (np.pi + np.arcsin(HOLD / PULL)) / PACE
    lower = next(event.t for event in found.events if event.name == "first lower")
    t, height = found.rows.grid.t, found.rows.q[:, 0]
    falls = (t > loose) & (t < lower)
    since = t[falls] - loose
    speed = PULL / PACE * np.cos(PACE * loose)
    expected = (
        0.1
        + (-PULL / PACE**2 * (np.sin(PACE * t[falls]) - np.sin(PACE * loose)) + speed * since + HOLD * since**2 / 2.0)
        / MASS
    )
    assert falls.sum() > 30
    assert height[falls] == pytest.approx(expected, abs=1e-10)
    assert np.abs(height).max() < 0.1 + 1e-12


DOWN = {"direction": "-z", "magnitude": f"{G} m/s^2"}


@pytest.mark.parametrize("static", [None, 8.0])
def test_a_stop_lets_go_where_friction_would_make_it_pull(mechanism, chain, static):
    """A load slides on a cart that a force pulls off its stop: once it sticks, or breaks loose, nothing presses."""
    cart = [{"name": "cart", "kind": "prismatic", "axis": "1 0 0", "mass": 2.0},
            {"name": "load", "kind": "prismatic", "axis": "1 0 0", "mass": 1.0}]  # fmt: skip
    if static is None:
        friction, loads, speed = {"constant": "6 N"}, {"cart": Constant(value=3.0)}, -1.0
        half, begins = 0.5, 1.0 / 6.0  # of the acceleration, of both, 3 N / 3 kg
    else:
        friction, speed = {"constant": "2 N", "static_constant": "8 N"}, 0.0
        loads = {"load": ConstantSpeed(start=-5.0, speed=-6.0), "cart": ConstantSpeed(start=-2.0, speed=-6.0)}
        half, begins = 0.25, 0.5  # of that of the cart: efforts of -5 N and 8 N less 2 N of friction move 2 kg
    model = mechanism(chain(*cart), gravity="none", friction={"load": friction})
    problem = Forward(
        time=TimeGrid(end=1.0, samples=11), initial=InitialState(velocity={"load": speed}),
        end_stops={"cart": EndStop(lower=0.0)},
        loads={name: JointEffort(joint=name, effort=effort) for name, effort in loads.items()},
    )  # fmt: skip
    found = problem.solve(model, Accuracy(tolerance=1e-12), lambda *path: nullcontext())
    t, place = found.rows.grid.t, found.rows.q[:, 0]
    assert place == pytest.approx(half * np.maximum(t - begins, 0.0) ** 2, abs=1e-9)
    assert found.rows.tau[:, 0].min() > -1e-12


@pytest.mark.parametrize("restitution", [0.3])
def test_an_arm_shaken_between_its_stops_passes_none(mechanism, chain, restitution):
    """Its joints come to rest on their stops one after the other, and set each other in motion while they do."""
    arm = [
        {"name": f"J{k}", "axis": "0 1 0", "at": "0 0 -0.4" if k else "0 0 0", "mass": mass, "com": f"{x} 0 -0.2",
         "inertia": (0.01, 0.01, 0.01)}
        for k, (mass, x) in enumerate([(1.217, -0.073), (0.821, 0.016), (1.645, -0.07)])
    ]  # fmt: skip
    ranges = {"J0": (-0.37, -0.17, 0.3), "J1": (0.44, 0.74, 0.0), "J2": (0.07, 0.47, restitution)}
    shake = JointEffort(joint="J0", effort=Harmonic(amplitude=8.83, pulsation=6.33))
    problem = Forward(
        time=TimeGrid(end=1.0, samples=51), initial=InitialState(position={"J0": -0.27, "J1": 0.44, "J2": 0.17}),
        loads={"shake": shake},
        end_stops={name: EndStop(lower=low, upper=high, restitution=e) for name, (low, high, e) in ranges.items()},
    )  # fmt: skip
    found = problem.solve(mechanism(chain(*arm), gravity=DOWN), Accuracy(), lambda *path: nullcontext())
    low, high, _ = np.array([*ranges.values()]).T
    assert (found.rows.q >= low - 1e-11).all()
    assert (found.rows.q <= high + 1e-11).all()
    assert found.measures()["energy"] < 1e-6
