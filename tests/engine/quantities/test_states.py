"""States of their own: what a run says of them row by row, and closed forms."""

from contextlib import nullcontext
from pathlib import Path
from time import process_time

import numpy as np
import pytest

import pinarm
from pinarm.engine.quantities.names import Quantities
from pinarm.engine.series import Series
from pinarm.errors import DynamicsError, InputError, PinarmError
from pinarm.input.units import unit
from pinarm.mechanics.laws import Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.inverse import Inverse
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

ROOT = Path(pinarm.__file__).parents[1]
MODELS = ROOT / "models"


@pytest.fixture
def arm():
    return Mechanism.load(MODELS / "gen411_arm" / "mechanism.yaml")


@pytest.fixture
def states():
    return np.random.default_rng(8).normal(size=(3, 40, 2))


def test_drives_along_a_distance_and_a_height_move_the_joints():
    """Their efforts at the joints give the accelerations back, by forward dynamics, and are those of virtual work."""
    arm = Mechanism.load(ROOT / "docs" / "kind_examples" / "coordinates" / "arm.yaml")
    q, v, a = np.random.default_rng(3).normal(size=(3, 20, 2))
    tau = arm.inverse(q, v, a, drives=["reach", "height"])
    assert arm.forward(q, v, tau) == pytest.approx(a, rel=1e-9, abs=1e-9)
    states = arm.at(q, v, a, drives=["reach", "height"])
    work = sum(
        states[f"coordinate.{name}.effort"].values[:, None] * arm.jacobian(name, q) for name in ("reach", "height")
    )
    assert tau == pytest.approx(work, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", ["magic_arms_cycle", "gyroscope_free"])
def test_every_quantity_of_a_run_is_that_of_its_states(name):
    run = pinarm.load(ROOT / "scenarios" / f"{name}.yaml").run().trajectory
    part = slice(3, None, 97)
    alone = run.mechanism.at(run.q[part], run.v[part], run.a[part])
    along = Quantities(run)
    names = [one for one in along.names() if one not in ("t", *(f"drive.{d}.torque" for d in run.mechanism.drives))]
    assert len(names) > 150
    for one in names:
        whole = along[one].values
        floor = 1e-11 * np.abs(whole).max(initial=1.0)
        assert alone[one].values == pytest.approx(whole[part], rel=1e-10, abs=floor), one
        assert alone[one].unit == along[one].unit


def test_points_energies_and_moments_by_closed_forms(arm, states):
    (q, v, a), l1, l2 = states, 0.25, 0.25
    found, th, ph = arm.at(q, v, a), q[:, 0], q.sum(axis=1)
    thd, phd = v[:, 0], v.sum(axis=1)
    thdd, phdd = a[:, 0], a.sum(axis=1)
    speed = -l1 * thd * np.sin(th) - l2 * phd * np.sin(ph)
    growth = -l1 * (thdd * np.sin(th) + thd**2 * np.cos(th)) - l2 * (phdd * np.sin(ph) + phd**2 * np.cos(ph))
    assert found["A_x"].values == pytest.approx(l1 * np.cos(th) + l2 * np.cos(ph), abs=1e-14)
    assert found["point.A.velocity.x"].values == pytest.approx(speed, abs=1e-13)
    assert found["point.A.acceleration.x"].values == pytest.approx(growth, abs=1e-12)
    assert found["2*phi + 1"].values == pytest.approx(2 * ph + 1)
    assert found["C_B"].values == pytest.approx(arm.inverse(q, v, a)[:, 1], abs=1e-13)


def test_states_are_built_from_names(arm):
    q = arm.configurations({"B": [0.1, 0.2, 0.3], "O": 0.5})
    assert q.tolist() == [[0.5, 0.1], [0.5, 0.2], [0.5, 0.3]]
    assert arm.rates({"B": np.array([2.0])}).tolist() == [[0.0, 2.0]]
    assert arm.configurations({}).tolist() == [0.0, 0.0]
    assert arm.at(q)["theta"].values.tolist() == [0.5] * 3


def measured(value, text):
    return Series("x", unit(text), np.asarray(value, float))


def test_what_has_a_unit_is_taken_in_it(arm):
    """90 deg are no 90 rad, and 60 rpm no 60 rad/s."""
    q = arm.configurations({"O": measured([90.0], "deg"), "B": 0.5})
    assert q == pytest.approx(np.array([[np.pi / 2, 0.5]]), rel=1e-15)
    assert arm.rates({"O": measured(60.0, "rpm")}) == pytest.approx(np.array([2 * np.pi, 0.0]), rel=1e-15)
    assert arm.rates({"O": measured(2.0, "kN*m")}).tolist() == [2000.0, 0.0]
    assert arm.at(measured([90.0, 0.0], "deg"))["theta"].values == pytest.approx(np.pi / 2, rel=1e-15)
    v = np.zeros(2)
    assert np.array_equal(arm.inverse(q[0], v, v, t=measured(500.0, "ms")), arm.inverse(q[0], v, v, t=0.5))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"q": "N"}, "q is in N\n  expected: a unit such as rad"), ({"v": "rad"}, "v is in rad"),
        ({"a": "rad/s"}, "a is in rad/s"), ({"tau": "N"}, "tau is in N\n"),
    ],
)  # fmt: skip
def test_arrays_that_measure_something_else_are_refused(arm, given, message):
    """Of two turning joints; those in units that fit are taken in these, as below."""
    arrays = {name: measured([1.0, 2.0], given.get(name, own)) for name, own in FITS.items()}
    q, v, a, tau = arrays.values()
    calls = [
        lambda: arm.inverse(q, v, a), lambda: arm.forward(q, v, tau), lambda: arm.at(q, v, a),
        lambda: pinarm.result(arm, [0.0], q[None], v[None], a[None], tau[None]),
    ]  # fmt: skip
    found = [str(error) for call in calls for error in [refusal(call)] if error]
    assert len(found) >= 2
    assert all(message in text for text in found)


FITS = {"q": "deg", "v": "rpm", "a": "deg/s^2", "tau": "N*mm"}


def refusal(call):
    try:
        call()
    except PinarmError as error:
        return error
    return None


@pytest.mark.parametrize(("given", "message"), [
    ({"O": None}, "O is no array of real numbers"), ({"O": "1 rad"}, "O is no array of real numbers"),
    ({"O": measured(1.0, "mm")}, "O is in mm"),
    ({"C": 1.0}, "no joint 'C'"), ({"O": [1.0, 2.0], "B": [1.0, 2.0, 3.0]}, r"O: \(2,\), B: \(3,\)"),
])  # fmt: skip
def test_names_that_build_nothing(arm, given, message):
    with pytest.raises(PinarmError, match=message):
        arm.configurations(given)


@pytest.mark.parametrize(("v", "a", "direction"), [(0.0, 3.0, 1.0), (0.0, -3.0, -1.0), (-1e-15, 3.0, -1.0)])
def test_a_motor_at_standstill_drives_into_the_motion_that_begins(mechanism, chain, v, a, direction):
    """At every row, the last one too: these rows are no motion that could end there."""
    arm = mechanism(chain({"name": "arm"}), gravity="none",
                    drives={"m": {"joint": "arm", "efficiency": 0.5}})  # fmt: skip
    one = np.ones((3, 1))
    torque = arm.at(0 * one, v * one, a * one)["drive.m.torque"].values
    assert torque == pytest.approx(0.1 * a * (2.0 if a * direction > 0 else 0.5) * np.ones(3), rel=1e-13)


class TestLoops:
    @pytest.fixture
    def run(self):
        lift = Inverse(time=TimeGrid(end=2.0, samples=117), start={"alpha": 0.1},
                       motion={"alpha": Harmonic(mean=0.1, amplitude=0.7, pulsation=2.0)})  # fmt: skip
        manipulator = Mechanism.load(MODELS / "manipulator" / "mechanism.yaml")
        return lift.solve(manipulator, Accuracy(), lambda *path: nullcontext()).rows

    def test_efforts_lead_to_the_accelerations_of_the_published_law(self, run):
        """``I_eq al'' = C - [g (m1 (l - d)/2 + (m2 + m) l + m3 l/2 - m6 d)] cos al``: the cylinder without pressure."""
        q, v = run.q, run.v
        arm = run.mechanism.joints["alpha"]
        effort = np.linspace(-3e4, 3e4, len(q))
        found = run.mechanism.at(q, v, tau=run.mechanism.rates({"alpha": effort}))
        moment = 9.81 * (100 * 0.375 + 720 * 2 + 60 * 1 - 270 * 1.25) * np.cos(q[:, arm.q])
        expected = (effort - moment) / 3483.9583333333335
        assert found["joint.alpha.acceleration"].values == pytest.approx(expected, rel=1e-10, abs=1e-10)
        assert found["loop.D.force.y"].values == pytest.approx(0.0, abs=1e-7)
        a = np.stack([found[f"joint.{name}.acceleration"].values for name in run.mechanism.joints], axis=1)
        again, along = (
            run.mechanism.at(q, v, a, drives=["alpha"])["loop.F.force.y"].values,
            found["loop.F.force.y"].values,
        )
        assert along == pytest.approx(again, rel=1e-9)
        assert np.abs(along).min() > 10.0

    @pytest.mark.parametrize(("what", "column"), [("positions", 0), ("velocities", 1), ("accelerations", 2)])
    def test_a_state_that_tears_a_loop_is_refused(self, run, what, column):
        state = [run.q[:5].copy(), run.v[:5].copy(), run.a[:5].copy()]
        state[column][3, run.mechanism.joints["alpha"].v] += 1e-3
        with pytest.raises(InputError, match=f"row 3: the {what} tear"):
            run.mechanism.at(*state)

    def test_efforts_do_not_tear_a_loop_but_a_singular_position_does(self):
        """Two motions cross where all bars are in line; no motion has velocities between theirs."""
        bars = pinarm.Mechanism.load(MODELS / "change_point_four_bar" / "mechanism.yaml")
        closure, q = bars.closure, bars.configurations({"theta2": np.pi, "A": np.pi, "theta4": np.pi})
        free = closure.split(closure.rows(closure.state(q))).free
        assert free.shape[1] == 2
        v = free @ np.array([1.0, 0.7])
        for asked in (bars.at, bars.forward):
            with pytest.raises(InputError, match=r"accelerations tear .*singular") as refused:
                asked(q, v, tau=np.zeros(bars.model.nv))
            assert "motions that meet there" in str(refused.value)

    def test_without_drives_there_is_no_inverse(self, run):
        with pytest.raises(InputError, match="F, D tie joints"):
            run.mechanism.inverse(run.q[:2], run.v[:2], run.a[:2])


def test_what_contradicts_itself_is_refused(arm, states):
    with pytest.raises(InputError, match="accelerations and efforts are given"):
        arm.at(*states, tau=states[0])
    with pytest.raises(InputError, match=r"q: \(40, 2\), v: \(7, 2\)"):
        arm.at(states[0], states[1][:7])
    with pytest.raises(PinarmError, match="no quantity 'speed'"):
        _ = arm.at(states[0])["speed"]


@pytest.mark.parametrize("call", ["inverse", "forward", "at"])
def test_a_quaternion_that_is_none_is_refused(call):
    free = Mechanism.load("ur5", values={"base": "floating"})
    q, still = np.vstack([free.configurations({})] * 2), np.zeros((2, free.model.nv))
    ask = getattr(free, call)
    ask(q, still, still)
    q[1, free.balls["root"].q :][:4] *= 2.0
    with pytest.raises(InputError, match="row 1: the quaternion of 'root' has the length 2"):
        ask(q, still, still)


IDLE = """<robot name="idle"><link name="base"/><link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial></link><link name="hand"/><link name="finger"/><link name="tip"/>
<joint name="a" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
<joint name="b" type="continuous"><parent link="arm"/><child link="hand"/><origin xyz="1 0 0"/><axis xyz="0 1 0"/>
</joint><joint name="c" type="continuous"><parent link="hand"/><child link="finger"/><origin xyz="1 0 0"/>
<axis xyz="0 1 0"/></joint><joint name="d" type="fixed"><parent link="finger"/><child link="tip"/>
<origin xyz="1 0 0"/></joint></robot>"""


class TestABranchWithoutMass:
    """Its accelerations are undetermined: aba divides 0 by 0, or rounding by rounding."""

    @pytest.fixture
    def idle(self, tmp_path):
        (tmp_path / "idle.urdf").write_text(IDLE)
        return Mechanism.load(tmp_path / "idle.urdf")

    @pytest.mark.parametrize("rows", [1, 40])
    def test_it_is_named(self, idle, rows):
        q, v, tau = np.random.default_rng(3).normal(size=(3, rows, 3))
        for solve in (lambda: idle.forward(q, v, tau), lambda: idle.at(q, v, tau=tau), lambda: idle.forward(q, v)):
            with pytest.raises(DynamicsError, match=r"joints? .*b.* can move without mass"):
                solve()

    def test_a_loop_that_holds_it_is_enough(self, tmp_path):
        """The tip is held at a point: a crank with mass falls as alone while it hangs, whatever is tied to it."""
        (tmp_path / "idle.urdf").write_text(IDLE)
        ties = (
            "{level: {kind: point_on_plane, between: [base, tip]}, side: "
            "{kind: point_on_plane, between: [base, tip], axis: x}}"
        )
        (tmp_path / "m.yaml").write_text(f"pinarm: 1\nrobot: idle.urdf\nloops: {ties}\n")
        held = Mechanism.load(tmp_path / "m.yaml")
        crank, third = 0.4, 2.0 * np.pi / 3  # an equilateral triangle: the coupler and the rocker are bars without mass
        q = np.tile([crank, third, third], (4, 1))
        a = held.forward(q, np.zeros((4, 3)))
        assert a[:, 0] == pytest.approx(0.5 * 9.81 * np.cos(crank) / (0.01 + 0.25), rel=1e-12)


DOOR = MODELS / "counterweighted_door" / "mechanism.yaml"


@pytest.mark.parametrize(("lift", "drop"), np.random.default_rng(5).normal(scale=1000.0, size=(8, 2)).tolist())
def test_a_cable_carries_a_tension_and_where_it_would_have_to_push_efforts_are_refused(lift, drop):
    """Newton's law of a door of 40 kg and its weight of 35 kg: ``T = 40 (a + g) - lift``, of which -T was a push."""
    door, at, a = Mechanism.load(DOOR), np.zeros(2), (lift + drop - 5.0 * 9.81) / 75.0
    tau, tension = door.rates({"lift": lift, "drop": drop}), 40.0 * (a + 9.81) - lift
    if tension > 0.0:
        assert door.forward(at, at, tau) == pytest.approx([a, a], rel=1e-12)
        assert door.at(at, at, tau=tau)["S"].values == pytest.approx(tension, rel=1e-12)
        return
    with pytest.raises(InputError, match=f"cable 'cable' would have to push with {-tension:.6g} N: it goes slack"):
        door.forward(at, at, tau)
    with pytest.raises(InputError, match=f"cable 'cable' would have to push with {-tension:.6g} N: it goes slack"):
        door.at(at, at, tau=tau)


def test_cables_that_may_share_a_load_without_a_push():
    """One above and one below a block: the least multipliers have the lower one push, which the upper one may do."""
    points = {"T": [0, "1 m"], "B": [0, "-1 m"], "P": [0, 0], "Q": [0, "0.1 m"]}
    block = pinarm.load({
        "pinarm": 1,
        "mechanism": {
            "pinarm": 1,
            "planar": {"points": points, "ground": ["T", "B"],
                       "links": {"block": {"points": ["P", "Q"], "mass": "2 kg"}},
                       "sliders": {"z": {"link": "block", "along": ["P", "Q"]}}},
            "loops": {"up": {"kind": "cable", "through": ["T", "P"]}, "down": {"kind": "cable", "through": ["P", "B"]}},
        },
        "problem": {"kind": "forward", "time": {"end": "1 s", "samples": 2}},
        "outputs": ["z"],
    }).mechanism  # fmt: skip
    assert block.forward(np.zeros(1), np.zeros(1)) == pytest.approx([0.0], abs=1e-12)


def _seconds(call):
    times = []
    for _ in range(3):
        begun = process_time()
        call()
        times.append(process_time() - begun)
    return min(times)


def test_many_states_of_a_loop_are_solved_together():
    """3,000 states take the time of some hundred single ones, and the one that tears the loop is told by its place."""
    bar = Mechanism.load(MODELS / "four_bar" / "mechanism.yaml")
    phi = np.linspace(0.3, 1.2, 3000)
    q, v, a = bar.close({"upright_0": phi}, {"upright_0": 1.0 + phi}, {"upright_0": phi})
    drives = ["upright_0"]
    single = _seconds(lambda: bar.inverse(q[0], v[0], a[0], drives=drives))
    assert _seconds(lambda: bar.inverse(q, v, a, drives=drives)) < 300 * single
    v[1700, 0] += 0.1
    with pytest.raises(InputError, match=r"row 1700.*velocities tear"):
        bar.inverse(q, v, a, drives=drives)
