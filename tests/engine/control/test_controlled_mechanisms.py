"""Controllers on mechanisms: loops, laws, friction, end stops, several freedoms, and functions in Python."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import pinarm
from pinarm.errors import InputError

CART = """<robot name="cart"><link name="base"/>
<link name="cart"><inertial><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="pole"><inertial><origin xyz="0 0 0.5"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="100" velocity="10"/></joint>
<joint name="phi" type="continuous"><parent link="cart"/><child link="pole"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.fixture
def cart(tmp_path):
    """A pole on a cart: m_c 2, m 1, mass centre at 0.5, I 0.1 about it, g 10."""
    (tmp_path / "cart.urdf").write_text(CART)
    return pinarm.Mechanism.load(tmp_path / "cart.urdf", values={"gravity": {"magnitude": "10 m/s^2"}})


@pytest.fixture
def slide(tmp_path):
    """Make a slide of 60 kg without weight, with friction that holds up to a force."""

    def made(friction):
        (tmp_path / "slide.urdf").write_text(
            '<robot name="slide"><link name="base"/><link name="door"><inertial><mass value="60"/><inertia ixx="1" '
            'iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="x" type="prismatic"><parent '
            'link="base"/><child link="door"/><axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/>'
            "</joint></robot>"
        )
        return pinarm.Mechanism.load(tmp_path / "slide.urdf", values=friction and {"friction": {"x": friction}})

    return made


def forward(mechanism, control, end="1 s", outputs=("x",), **problem):
    time = {"end": end, "samples": 51}
    return {"pinarm": 1, "mechanism": mechanism, "outputs": list(outputs),
            "problem": {"kind": "forward", "time": time, "control": control, **problem}}  # fmt: skip


GAINS = [["-3 N/m", "-80 N/rad", "-6 N*s/m", "-20 N*s/rad"]]
FEEDBACK = {"kind": "state_feedback", "drive": "x", "states": ["x", "phi"], "gains": GAINS}


def linear_cart():
    """``M a = (u, m g l phi)`` with ``M = [[3, 0.5], [0.5, 0.35]]``, as ``x' = A x + B u``."""
    inverse = np.linalg.inv([[3.0, 0.5], [0.5, 0.35]])
    a, b = np.zeros((4, 4)), np.zeros((4, 1))
    a[:2, 2:] = np.eye(2)
    a[2:, 1], b[2:, 0] = inverse @ [0.0, 5.0], inverse @ [1.0, 0.0]
    return a, b


@pytest.mark.parametrize("period", [None, 0.02])
def test_state_feedback_is_the_matrix_exponential(cart, period):
    """From a tilt of 1e-4 rad: what is not linear is smaller by its square."""
    control = [{**FEEDBACK, **({"period": f"{period} s"} if period else {})}]
    start = {"position": {"phi": "1e-4 rad"}}
    result = pinarm.run(
        {**forward(cart, control, outputs=("x", "phi"), initial=start), "accuracy": {"tolerance": 1e-12}}
    )
    a, b = linear_cart()
    gain = np.array([[-3.0, -80.0, -6.0, -20.0]])
    if period:
        whole = expm(np.block([[a, b], [np.zeros((1, 5))]]) * period)
        end = np.linalg.matrix_power(whole[:4, :4] - whole[:4, 4:] @ gain, 50)
    else:
        end = expm(a - b @ gain)
    exact = end @ [0.0, 1e-4, 0.0, 0.0]
    assert [result["x"].values[-1], result["phi"].values[-1]] == pytest.approx(exact[:2], abs=1e-10)


LAW = {"law": "polynomial", "from": "0 m", "to": "0.5 m", "duration": "1 s"}


def test_computed_torque_follows_beside_a_free_joint(cart):
    """The pole swings as it likes: with exact inverse dynamics the cart follows to the tolerance."""
    control = [{"kind": "computed_torque", "drive": "x", "follows": LAW, "kp": "100 1/s^2", "kd": "20 1/s"}]
    start = {"position": {"phi": "170 deg"}}
    result = pinarm.run(forward(cart, control, outputs=("control.x.error", "joint.x.effort"), initial=start))
    assert np.abs(result["control.x.error"].values).max() < 1e-8
    law = pinarm.run(forward(cart, [], outputs=("joint.x.effort",), initial=start, motion={"x": LAW}))
    assert np.abs(result["joint.x.effort"].values - law["joint.x.effort"].values).max() < 1e-6


def test_computed_torque_of_a_loop():
    """A crank-rocker: its crank follows, and needs the effort that the same law prescribed needs."""
    law = {"law": "polynomial", "from": "0 deg", "to": "90 deg", "duration": "1 s"}
    model = "models/crank_rocker/mechanism.yaml"
    crank = next(iter(pinarm.Mechanism.load(model).joints))
    control = [{"kind": "computed_torque", "drive": crank, "follows": law, "kp": "400 1/s^2", "kd": "40 1/s"}]
    effort = f"joint.{crank}.effort"
    start = {"position": {crank: "0 deg"}}
    driven = pinarm.run(forward(model, control, "0.4 s", (effort, f"control.{crank}.error"), initial=start))
    law_run = pinarm.run(forward(model, [], "0.4 s", (effort,), motion={crank: law}))
    assert np.abs(driven[f"control.{crank}.error"].values).max() < 1e-7
    size = np.abs(law_run[effort].values).max()
    assert np.abs(driven[effort].values - law_run[effort].values).max() < 1e-5 * size


@pytest.mark.parametrize("period", [{}, {"period": "50 ms"}])
def test_a_controller_pushes_against_an_end_stop(cart, period):
    """At rest on the stop the stop holds what the controller pushes; a step back of the reference lets it go."""
    reference = {"law": "steps", "points": [["0 s", "1 m"], ["2 s", "0 m"]]}
    control = [{"kind": "pid", "drive": "x", "follows": reference, "kp": "50 N/m", "kd": "30 N*s/m", **period}]
    asked = forward(cart, control, "5 s", ("x", "control.x.effort"), end_stops={"x": {"upper": "0.4 m"}},
                    motion={"phi": {"law": "constant", "value": "180 deg"}})  # fmt: skip
    result = pinarm.run(asked)
    x, t = result["x"].values, result["t"].values
    assert x.max() <= 0.4 + 1e-9
    assert x[(t > 1.5) & (t < 2.0)] == pytest.approx(0.4, abs=1e-9)
    assert abs(x[-1]) < 0.02


def test_a_controller_moves_what_friction_holds():
    """A block on a belt at rest: it sticks until the effort exceeds 0.4 m g, then slides towards its reference."""
    model = "models/mass_on_belt/mechanism.yaml"
    reference = {"law": "steps", "points": [["0 s", "0 m"], ["1 s", "0.5 m"]]}
    control = [{"kind": "pid", "drive": "slip", "follows": reference, "kp": "100 N/m", "kd": "30 N*s/m"}]
    belt = {"belt": {"law": "constant", "value": "0 m"}}
    result = pinarm.run(forward(model, control, "3 s", ("slip", "joint.slip.friction"), motion=belt))
    slip, t = result["slip"].values, result["t"].values
    assert np.abs(slip[t < 1.0]).max() < 1e-12
    assert slip[-1] > 0.1
    assert abs(result["joint.slip.velocity"].values[-1]) < 1e-9  # it sticks again, short of the reference


@pytest.mark.parametrize("period", [None, 0.05])
def test_a_function_is_the_controller_that_it_spells_out(cart, period):
    def effort(t, state):
        return 3 * state["x"] + 80 * state["phi"] + 6 * state["joint.x.velocity"] + 20 * state["joint.phi.velocity"]

    start = {"position": {"phi": "0.1 rad"}}
    control = [{**FEEDBACK, **({"period": "50 ms"} if period else {})}]
    same = pinarm.run(forward(cart, control, initial=start))
    found = pinarm.run(forward(cart, [], initial=start), control={"x": effort}, period=period)
    assert np.abs(found["x"].values - same["x"].values).max() < 1e-12


def test_a_function_sees_quantities_and_may_drive_several_joints(cart):
    seen = []

    def efforts(t, state):
        seen.append((t, state["energy.kinetic"], state["point.pole.position.x"], state["x"]))
        return [1.0, -0.5]

    result = pinarm.run(forward(cart, []), control={("x", "phi"): efforts}, period=0.1)
    assert [t for t, *_ in seen] == pytest.approx(0.1 * np.arange(10))
    assert [place for *_, place, _ in seen] == [x for *_, x in seen]
    assert result["joint.phi.effort"].values[-1] == -0.5
    assert result.figures["energy"] < 1e-9


@pytest.mark.parametrize("function, said", [
    (lambda t, state: state["nothing"], "no quantity 'nothing'"),
    (lambda t, state: float("nan"), "finite"),
    (lambda t, state: state["joint.x.acceleration"], "positions and velocities"),
    (lambda t, state: 1 / 0, "fails at t = 0 s: ZeroDivisionError"), (lambda t: 0.0, "positional"),
    (lambda t, state: state.q.__isub__(0.1)[0], "read-only"),
])  # fmt: skip
def test_mistakes_of_functions_are_told(cart, function, said):
    with pytest.raises(InputError, match=said) as caught:
        pinarm.run(forward(cart, []), control={"x": function})
    assert "spline" not in str(caught.value)  # which is for recorded motions


@pytest.mark.parametrize("keys, said", [
    ({"period": "50 ms"}, "the period is '50 ms'"), ({"period": float("nan")}, "the period is nan"),
    ({"delay": 0.1}, "sampled functions"), ({"period": 0.1, "delay": 2.0}, "no command takes effect"),
    ({"control": {("x", 5): abs}}, "the control of"), ({"control": None, "period": 0.1}, "no function"),
])  # fmt: skip
def test_what_goes_with_functions_is_checked(cart, keys, said):
    with pytest.raises(InputError, match=said):
        pinarm.run(forward(cart, []), **{"control": {"x": lambda t, state: 0.0}, **keys})


def test_a_mechanism_may_have_its_controllers(tmp_path):
    (tmp_path / "cart.urdf").write_text(CART)
    gravity = {"magnitude": "10 m/s^2"}
    start = {"position": {"phi": "0.1 rad"}}
    plain = pinarm.Mechanism.load(tmp_path / "cart.urdf", values={"gravity": gravity})
    own = pinarm.Mechanism.load(tmp_path / "cart.urdf", values={"gravity": gravity, "control": [FEEDBACK]})
    run = pinarm.run(forward(own, [], initial=start))
    found = run["x"].values
    other = pinarm.Mechanism.load(tmp_path / "cart.urdf", values={"gravity": gravity, "control": [
        {**FEEDBACK, "follows": {"x": {"law": "constant", "value": "1 m"}}}]})  # fmt: skip
    assert run.digest() != pinarm.run(forward(other, [], initial=start)).digest()
    assert np.array_equal(found, pinarm.run(forward(plain, [FEEDBACK], initial=start))["x"].values)


@pytest.mark.parametrize("follows", [
    [{"law": "constant", "value": "0.1 m"}], {"x": {"law": "constant", "value": "0.1 m"}},
])  # fmt: skip
@pytest.mark.parametrize("kind", [
    {"kind": "pid", "kp": "50 N/m"}, {"kind": "computed_torque", "kp": "9 1/s^2"},
    {"kind": "state_feedback", "states": ["x"], "gains": [["50 N/m", "3 N*s/m"]]},
    {"kind": "switching", "above": "1 N", "below": "-1 N", "hysteresis": "1 mm"},
])  # fmt: skip
def test_all_kinds_take_the_same_forms_of_what_they_follow(cart, kind, follows):
    scenario = pinarm.load(forward(cart, [{"drive": "x", "follows": follows, **kind}], "0.01 s"))
    error = scenario.run()["control.x.error"].values[0]
    assert error == pytest.approx(0.1)


@pytest.fixture
def controlled(tmp_path):
    """A scenario whose mechanism file has a sampled controller, and whose problem has a continuous one."""
    own = "{kind: pid, drive: phi, follows: {law: constant, value: 0 rad}, kp: 1 N*m/rad, period: 10 ms, delay: 4 ms}"
    other = "{kind: computed_torque, drive: x, follows: {law: constant, value: 0 m}}"
    (tmp_path / "cart.urdf").write_text(CART)
    (tmp_path / "mechanism.yaml").write_text(f"pinarm: 1\nrobot: cart.urdf\ncontrol:\n  - {own}\n")
    (tmp_path / "scenario.yaml").write_text(
        "pinarm: 1\nmechanism: mechanism.yaml\nproblem:\n  kind: forward\n  time: {end: 1 s, samples: 3}\n"
        f"  control:\n    - {other}\noutputs: [x]\n"
    )
    return tmp_path / "scenario.yaml"


def test_explain_lists_the_controllers(controlled):
    def told(file):
        return [line for line in str(pinarm.explain(file)).splitlines() if line.startswith("controller")]

    own = "controller of phi: pid, sampled every 0.01 s, with a delay of 0.004 s"
    assert told(controlled.with_name("mechanism.yaml")) == [own]
    assert told(controlled) == [own, "controller of x: computed_torque, continuous"]


def stepped(x, v, command, mass, slipping, holding, period, samples):
    """A mass with dry friction under efforts that are held between samples, by parabolas; return x and v there."""
    rows = [(x, v)]
    for _ in range(samples):
        effort, left = command(x, v), period
        while left > 0.0:
            if v == 0.0 and abs(effort) <= holding:
                break
            way = np.sign(v) if v else np.sign(effort)
            a = (effort - way * slipping) / mass
            until = min(left, -v / a) if v * a < 0.0 else left
            x, v, left = x + v * until + 0.5 * a * until**2, v + a * until, left - until
            v = 0.0 if until == -(v - a * until) / a and left > 0.0 else v
        rows.append((x, v))
    return np.array(rows).T


def at_rows(result, x):
    """Return values at samples every 20 ms at the rows of a run; at other rows its own."""
    number = result["t"].values / 0.02
    k = np.round(number).astype(int)
    return np.where(abs(number - k) < 1e-9, x[k], result["x"].values)


def test_sampled_control_beside_friction_that_sticks(slide):
    """A PD controller whose effort falls within the friction at rest: the slide then stays, and no sample moves it."""
    mechanism = slide({"constant": "40 N", "static_constant": "50 N"})
    control = [{"kind": "pid", "drive": "x", "follows": {"law": "constant", "value": "0 m"},
                "kp": "300 N/m", "kd": "120 N*s/m", "period": "20 ms"}]  # fmt: skip
    result = pinarm.run(forward(mechanism, control, "4 s", initial={"position": {"x": "1 m"}}))
    x, v = stepped(1.0, 0.0, lambda x, v: -300.0 * x - 120.0 * v, 60.0, 40.0, 50.0, 0.02, 200)
    assert v[-1] == 0.0
    assert 0.0 < abs(300.0 * x[-1]) < 50.0
    # steps end on the samples, and between them x is a parabola: exact but for where it comes to rest
    assert result["x"].values == pytest.approx(at_rows(result, x), abs=1e-11)
    assert np.ptp(result["x"].values[-10:]) == 0.0
    segments = result.outcome.motion.motion.segments
    assert len(segments) < 12  # not one for each of 200 samples


def test_a_sample_may_break_loose_what_friction_holds(slide):
    """The effort of the first sample is within the band, that after the jump of the reference is not."""
    mechanism = slide({"constant": "40 N", "static_constant": "50 N"})
    steps = {"law": "steps", "points": [["0 s", "0.1 m"], ["0.25 s", "0.5 m"]]}
    control = [{"kind": "pid", "drive": "x", "follows": steps, "kp": "300 N/m", "kd": "120 N*s/m", "period": "20 ms"}]
    result = pinarm.run(forward(mechanism, control, "0.5 s"))
    begins = result.outcome.motion.motion.segments[0].solution.end
    assert begins == pytest.approx(0.26, abs=1e-14)  # the first sample after the jump
    commands = iter([30.0] * 13 + [None] * 12)
    x, _ = stepped(0.0, 0.0, lambda x, v: next(commands) or 300.0 * (0.5 - x) - 120.0 * v, 60.0, 40.0, 50.0, 0.02, 25)
    assert result["x"].values == pytest.approx(at_rows(result, x), abs=1e-12)


def of_functions():
    """A PID whose integral is a variable that two functions share."""
    integral = 0.0

    def sum_up(x):
        nonlocal integral
        integral += 0.05 * x

    def effort(t, state):
        sum_up(state["x"])
        return -25.0 * state["x"] - 6.0 * state["joint.x.velocity"] - 20.0 * integral

    return effort


class Remembering:
    """The same, an object."""

    def __init__(self):
        self.integral = 0.0

    def __call__(self, t, state):
        self.integral += 0.05 * state["x"]
        return -25.0 * state["x"] - 6.0 * state["joint.x.velocity"] - 20.0 * self.integral


@pytest.mark.parametrize("make", [of_functions, Remembering])
@pytest.mark.parametrize("keys", [{}, {"size": 1e-3}, {"accuracy": {"target": 1e-6}}, {"verify": True}])
def test_a_function_that_remembers_knows_nothing_of_an_earlier_integration(make, keys):
    """A flywheel of 1 kg m^2 under held efforts, which move it along parabolas; small motions are integrated again."""
    size = keys.get("size", 1.0)
    x, v, integral = size, 0.0, 0.0
    for _ in range(20):
        integral += 0.05 * x
        u = -25.0 * x - 6.0 * v - 20.0 * integral
        x, v = x + 0.05 * v + 0.00125 * u, v + 0.05 * u
    problem = {"kind": "forward", "time": {"end": "1 s", "samples": 3}, "initial": {"position": {"x": f"{size} rad"}}}
    servo = {"pinarm": 1, "mechanism": str(Path(__file__).parents[3] / "models/servo/mechanism.yaml"),
             "outputs": ["x"], "problem": problem, "accuracy": keys.get("accuracy", {})}  # fmt: skip
    controlled = pinarm.load(servo).controlled({"x": make()}, period=0.05)
    result = controlled.verified() if "verify" in keys else controlled.run()
    assert result["x"].values[-1] == pytest.approx(x, rel=1e-10)
    assert result.error is None or result.error < 1e-10
