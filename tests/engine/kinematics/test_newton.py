from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.engine.kinematics.assembly import determining
from pinarm.engine.kinematics.joint_motion import DeterminedMotion
from pinarm.engine.kinematics.newton import NewtonSolver, start_configuration
from pinarm.errors import AssemblyError
from pinarm.mechanics.laws import Constant, Harmonic, Trapezoid
from pinarm.mechanics.laws.motion_law import Grid
from pinarm.use.mechanism import Mechanism

MODELS = Path(__file__).parents[3] / "models"
SHIN, THIGH, ANKLE_Y = 0.518, 0.431, -0.15
BENT = {"ankle": 0.7, "knee": 1.3, "hip": -2.0}
BENT_BACK = {"ankle": 2.2, "knee": -1.3, "hip": -0.9}
RISE = {
    "hip_height": Trapezoid(start=0.721, end=0.931, acceleration=0.84, begin=1.0),
    "hip_depth": Constant(value=0.0),
    "trunk_angle": Constant(value=0.0),
}
SMOOTH = {
    "hip_height": Harmonic(mean=0.75, amplitude=0.1, pulsation=2.0),
    "hip_depth": Harmonic(mean=-0.05, amplitude=0.1, pulsation=3.0, phase=0.4),
    "trunk_angle": Harmonic(amplitude=0.3, pulsation=1.0),
}


@pytest.fixture(scope="module")
def leg():
    return Mechanism.load(MODELS / "exoskeleton_leg" / "mechanism.yaml")


def moved(leg, motion, t, start):
    prescribed = determining(leg, motion)
    grid = Grid.cover(np.asarray(t, float), motion.values())
    states = DeterminedMotion(leg, prescribed).follow(grid, start_configuration(leg, start))
    return states.q, states.v, states.a


def hip(leg, q):
    """Height and depth of the hip and angle of the trunk by trigonometry."""
    first, second = q[:, 0], q[:, 0] + q[:, 1]
    return np.stack([
        SHIN * np.sin(first) + THIGH * np.sin(second),
        ANKLE_Y + SHIN * np.cos(first) + THIGH * np.cos(second),
        q.sum(axis=1),
    ], axis=1)  # fmt: skip


class TestTaskMotion:
    @pytest.mark.parametrize(("motion", "t"), [(RISE, 1.25), (SMOOTH, 2.1)])
    def test_rates_are_the_derivatives_of_the_positions(self, leg, motion, t, differentiate):
        def at(instant):
            # the step before brings the motion near; both rows lie in one smooth interval
            q, v, a = moved(leg, motion, [instant - 0.05, instant], BENT)
            return np.array([q[-1], v[-1], a[-1]])

        # differences of order 8 at h = 0.02 s
        assert differentiate(at, t)[:2] == pytest.approx(at(t)[1:], abs=1e-9)

    def test_each_side_of_a_jump_has_its_own_acceleration(self, leg):
        t = np.linspace(0.0, 2.5, 6)
        grid = Grid.cover(t, RISE.values())
        q, v, a = moved(leg, RISE, t, BENT)
        for row, after in ((grid.rows[1] - 1, 0.84), (grid.rows[2] - 1, -1.68), (grid.rows[3] - 1, 0.84)):
            assert grid.t[row] == grid.t[row + 1]
            assert q[row] == pytest.approx(q[row + 1], abs=1e-13)
            assert v[row] == pytest.approx(v[row + 1], abs=1e-13)
            change = np.array([after, 0.0, 0.0])
            knee, ankle = q[row, 0] + q[row, 1], q[row, 0]
            rows = np.array([
                [SHIN * np.cos(ankle) + THIGH * np.cos(knee), THIGH * np.cos(knee), 0.0],
                [-SHIN * np.sin(ankle) - THIGH * np.sin(knee), -THIGH * np.sin(knee), 0.0],
                [1.0, 1.0, 1.0],
            ])  # fmt: skip
            assert rows @ (a[row + 1] - a[row]) == pytest.approx(change, abs=1e-12)


class TestBranch:
    @pytest.mark.parametrize(("start", "side"), [(BENT, 1.0), (BENT_BACK, -1.0)])
    def test_it_is_that_of_the_start_and_is_kept(self, leg, start, side):
        q, _, _ = moved(leg, RISE, np.linspace(0.0, 2.5, 26), start)
        assert (side * q[:, 1] > 0.0).all()
        assert hip(leg, q)[:, 0].max() == pytest.approx(0.931, abs=1e-14)


@pytest.fixture
def bounded(monkeypatch):
    """Let a continuation that goes on for ever fail instead."""
    newton, calls = NewtonSolver._newton, []

    def counted(solver, q, w):
        calls.append(1)
        assert len(calls) < 5000, "the continuation does not end"
        return newton(solver, q, w)

    monkeypatch.setattr(NewtonSolver, "_newton", counted)


@pytest.mark.usefixtures("bounded")
class TestUnreachable:
    def test_the_closest_position_and_its_gap_are_told(self, leg):
        far = {**RISE, "hip_height": Constant(value=2.0), "hip_depth": Constant(value=ANKLE_Y)}
        with pytest.raises(AssemblyError, match=r"out of reach at 0: hip_height misses its value by 1.05 m") as caught:
            moved(leg, far, [0.0, 1.0], BENT)
        assert np.abs(caught.value.data["gap"]).max() == pytest.approx(2.0 - SHIN - THIGH, rel=1e-4)
        assert hip(leg, caught.value.data["q"][None])[0, 0] == pytest.approx(SHIN + THIGH, abs=1e-3)
        assert "knee = " in caught.value.expected
        assert caught.value.exit_code == 2

    def test_a_motion_that_leaves_the_reach_and_comes_back_is_told_to_be_singular(self, leg):
        over = {**RISE, "hip_height": Harmonic(mean=0.75, amplitude=0.25, pulsation=np.pi)}
        told = r"cannot be followed beyond .*, though the loops close at 1 on another branch"
        with pytest.raises(AssemblyError, match=told) as caught:
            moved(leg, {**over, "hip_depth": Constant(value=ANKLE_Y)}, [0.0, 1.0], BENT)
        first = np.arcsin((SHIN + THIGH - 0.75) / 0.25) / np.pi
        assert caught.value.data["t"] == pytest.approx(first, abs=1e-4)
        assert "keeps clear of a singular position" in caught.value.hint

    def test_a_singular_position_is_refused(self, leg):
        straight = {**RISE, "hip_height": Constant(value=SHIN + THIGH), "hip_depth": Constant(value=ANKLE_Y)}
        with pytest.raises(AssemblyError, match=r"singular at 0: .*hip_height.* does not move independently"):
            moved(leg, straight, [0.0, 1.0], {"ankle": np.pi / 2, "knee": 0.0, "hip": -np.pi / 2})


def rocker_angle(crank, points):
    """The angle of a rocker about C by the circles about A and C, on the side of the drawing, from the drawn one."""
    a, b, c = (np.array(points[name]) for name in "ABC")

    def turned(angle):
        tip = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ a
        way, coupler, rocker = c - tip, np.hypot(*(b - a)), np.hypot(*(b - c))
        length = np.hypot(*way)
        along = (length**2 + coupler**2 - rocker**2) / (2.0 * length)
        side = np.sign(np.cross([*(c - a), 0.0], [*(b - a), 0.0])[2])
        across = side * np.sqrt(coupler**2 - along**2)
        pin = tip + (along * way + across * np.array([-way[1], way[0]])) / length
        return np.arctan2(*(pin - c)[::-1])

    return np.angle(np.exp(1j * (turned(crank) - turned(0.0))))


def drawn(points):
    """A four-bar with its crank from O to A, its coupler from A to B and its rocker from B to C, without gravity."""
    links = {"crank": ["O", "A"], "coupler": ["A", "B"], "rocker": ["B", "C"]}
    planar = {
        "points": {name: [f"{float(x)!r} m" for x in point] for name, point in points.items()},
        "links": {name: {"points": of, "mass": "1 kg"} for name, of in links.items()},
        "ground": ["O", "C"],
    }
    return {"pinarm": 1, "planar": planar, "gravity": "none"}


@pytest.mark.parametrize(
    ("a", "b", "c", "crank"),
    [
        ((0.14024551859588735, -0.06520002980097124), (0.12632630032270323, -0.22519424670253602), 0.259834995277851,
         -1.1759541024952396),
        ((0.1, 0.0), (0.33, 0.24), 0.4, 1.1),
    ],
)  # fmt: skip
@pytest.mark.parametrize("off", [0.0, 0.02])
def test_a_start_that_is_a_solution_is_taken(a, b, c, crank, off):
    """With the rocker held there are two positions of the crank; the one that is given is taken, rounded digits too."""
    points = {"O": (0.0, 0.0), "A": a, "B": b, "C": (c, 0.0)}
    held = {"kind": "statics", "hold": {"C": f"{float(rocker_angle(crank, points))!r} rad"},
            "start": {"O": f"{crank + off!r} rad"}}  # fmt: skip
    result = pinarm.run({"pinarm": 1, "mechanism": drawn(points), "problem": held, "outputs": ["O"]})
    assert result["O"].values == pytest.approx(crank, abs=1e-9)


@pytest.mark.parametrize("kind", ["forward", "equilibria"])
def test_a_start_that_is_a_solution_is_where_a_motion_and_an_equilibrium_are_looked_for(kind):
    """The angle of the coupler is not given; a spring holds the crank where it is in both positions of the rocker."""
    generator = np.random.default_rng(5)
    for _ in range(10):
        a, b = generator.uniform(-0.15, 0.15, 2), generator.uniform(-0.4, 0.4, 2)
        c, crank = generator.uniform(0.1, 0.5), generator.uniform(-1.5, 1.5)
        points = {"O": (0.0, 0.0), "A": tuple(a), "B": tuple(b), "C": (c, 0.0)}
        with np.errstate(invalid="ignore"):
            rocker = rocker_angle(crank, points)
        if np.isnan(rocker):
            continue
        both = {"O": f"{crank!r} rad", "C": f"{float(rocker)!r} rad"}
        spring = {"kind": "joint_spring", "joint": "O", "stiffness": "1 N*m/rad", "rest": both["O"]}
        problem = {
            "forward": {"time": {"end": "1e-6 s", "samples": 2}, "start": {"O": both["O"]},
                        "initial": {"position": {"C": both["C"]}}},
            "equilibria": {"loads": {"spring": spring}, "starts": [both]},
        }[kind]  # fmt: skip
        found = pinarm.run({"pinarm": 1, "mechanism": drawn(points), "problem": {"kind": kind, **problem},
                            "outputs": ["O", "C"]})  # fmt: skip
        off = np.array([found["O"].values[0] - crank, found["C"].values[0] - rocker])
        assert np.angle(np.exp(1j * off)) == pytest.approx(0.0, abs=1e-9)
