"""Gears with losses and an elastic shaft: own integration, closed forms, and other models of the same."""

import numpy as np
import pytest
from catalogue import four_bar, slider_crank
from scipy.integrate import solve_ivp

import pinarm

N, ROTOR, LOAD, K, C, ETA = 10.0, 2e-4, 0.05, 8.0, 0.05, 0.7
OWN = N * N * ROTOR
"""Inertia of the rotor at the joint."""

INERTIA = """<link name="{name}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{joint}" type="continuous"><parent link="{parent}"/><child link="{name}"/><axis xyz="0 0 1"/></joint>"""


def chain(*links):
    """Return a model of inertias on one axis: (name, moment of inertia, joint), each turning against the last."""
    parents, text = ["base", *(name for name, *_ in links)], '<robot name="chain"><link name="base"/>'
    for parent, (name, izz, joint) in zip(parents, links, strict=False):
        text += INERTIA.format(name=name, izz=izz, joint=joint, parent=parent)
    return text + "</robot>"


@pytest.fixture
def servo(tmp_path):
    """Make an inertia behind a gear with losses and an elastic shaft."""

    def made(shaft="input", stiffness=K, damping=C, **keys):
        (tmp_path / "x.urdf").write_text(chain(("load", LOAD, "x")))
        elasticity = {"stiffness": f"{stiffness} N*m/rad", "damping": f"{damping} N*m*s/rad", "shaft": shaft}
        drive = {"joint": "x", "ratio": N, "efficiency": ETA, "rotor_inertia": f"{ROTOR} kg*m^2",
                 "elasticity": elasticity, "motor": {"kind": "ideal"}, **keys}  # fmt: skip
        return pinarm.Mechanism.load(tmp_path / "x.urdf", values={"drives": {"servo": drive}})

    return made


def run(mechanism, torque=None, end="0.25 s", outputs=("x", "servo.rotor"), start=None, **problem):
    control = [] if torque is None else [constant(torque)]
    return pinarm.run({"pinarm": 1, "mechanism": mechanism, "outputs": list(outputs), "problem": {
        "kind": "forward", "time": {"end": end, "samples": 11}, "initial": start or {}, "control": control, **problem,
    }})  # fmt: skip


def constant(torque):
    return {"kind": "state_feedback", "drive": "servo", "states": ["servo"], "bias": [f"{torque} N*m"],
            "gains": [["0 N*m/rad", "0 N*m*s/rad"]]}  # fmt: skip


def integrated(shaft, backlash, effort, state, instants):
    """Return x_r, v_r, x, v at instants, integrated from one rest of the teeth to the next.

    The teeth are at the joint behind an input shaft, which gets ``eta s`` while the motor drives and ``s / eta`` while
    it is driven, and at the rotor before an output shaft, which feels ``s / eta`` and ``eta s``.
    """
    slip = 3 if shaft == "input" else 1

    def push(y):
        w, rate = y[0] - y[2], y[1] - y[3]
        side = np.sign(w) if abs(w) > 0.5 * backlash else 0.0
        return side * max(K * (side * w - 0.5 * backlash) + C * side * rate, 0.0) if backlash else K * w + C * rate

    def rates(way, y):
        s = push(y)
        drives = s * way >= 0.0
        rotor, joint = (s, ETA * s if drives else s / ETA) if slip == 3 else (s / ETA if drives else ETA * s, s)
        a = [(effort - rotor) / OWN, joint / LOAD]
        if not way:
            a[slip // 2] = 0.0
        return [y[1], a[0], y[3], a[1]]

    def begins(y):
        return next((way for way in (1.0, -1.0) if way * rates(way, y)[slip] > 1e-10), 0.0)

    rows, t, y = [], instants[0], np.array(state)
    while len(rows) < len(instants):
        way = np.sign(y[slip]) if abs(y[slip]) > 1e-12 else begins(y)

        def end(t, y, way=way):
            return way * y[slip] if way else -max(way * rates(way, y)[slip] for way in (1.0, -1.0)) + 2e-10

        end.terminal, end.direction = True, -1.0
        solved = solve_ivp(lambda t, y, way=way: rates(way, y), (t, instants[-1] + 1e-3), y, "DOP853", events=end,
                           rtol=1e-11, atol=1e-13, max_step=2e-3, dense_output=True)  # fmt: skip
        last = instants[len(rows) :]
        rows += [solved.sol(one) for one in last[last <= solved.t[-1]]]
        if solved.status != 1:
            break
        t, y = solved.t[-1], solved.y[:, -1].copy()
        y[slip] = 0.0
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize(("shaft", "backlash"), [("input", 0.04), ("output", 0.0), ("output", 0.04)])
def test_a_load_that_turns_back_is_stopped_and_driven_forwards(servo, shaft, backlash):
    """The rotor turns forwards, the load backwards: the teeth slip in both directions, and power through them too."""
    start = {"velocity": {"x": "-3 rad/s", "servo.rotor": "4 rad/s"}}
    names = "x", "servo.rotor", "drive.servo.friction", "joint.x.effort", "drive.servo.torque", "joint.x.acceleration"
    result = run(servo(shaft, **({"backlash": f"{backlash} rad"} if backlash else {})), 0.3, outputs=names, start=start)
    t, rows = np.unique(result["t"].values, return_index=True)
    own = integrated(shaft, backlash, N * 0.3, [0.0, 4.0, 0.0, -3.0], t)
    assert {-1.0, 1.0} <= set(np.sign(own[:, 3]))
    assert np.abs(result["servo.rotor"].values[rows] - own[:, 0]).max() < 1e-7  # tolerance 1e-9 a step
    assert np.abs(result["x"].values[rows] - own[:, 2]).max() < 1e-7
    assert np.abs(result["joint.x.effort"].values - LOAD * result["joint.x.acceleration"].values).max() < 1e-10
    assert np.abs(result["drive.servo.torque"].values - 0.3).max() < 1e-12
    assert np.abs(result["drive.servo.friction"].values).max() > 0.1
    assert result.figures["energy"] < 1e-7
    assert result.figures["equilibrium"] < 1e-12


@pytest.mark.parametrize("stiffness", [K, 1e5])
@pytest.mark.parametrize("shaft, part", [("input", 1.0 / ETA), ("output", 1.0)])
def test_a_deflected_shaft_drives_as_a_rigid_one(servo, shaft, part, stiffness):
    """``a = N eta T / (I + eta J)`` from the deflection ``I a part / k`` on, whatever the stiffness."""
    a = N * ETA * 0.3 / (LOAD + ETA * OWN)
    deflection = LOAD * a * part / stiffness
    start = {"position": {"servo.rotor": f"{deflection} rad"}, "velocity": {"x": "0.1 rad/s"}}
    result = run(servo(shaft, stiffness, 1e-4 * stiffness), 0.3, "10 ms", start=start)
    t = result["t"].values
    assert np.abs(result["x"].values - 0.1 * t - 0.5 * a * t**2).max() < 1e-9
    assert np.abs(result["servo.rotor"].values - result["x"].values - deflection).max() < 1e-9


@pytest.mark.slow
def test_an_output_shaft_is_a_wheel_and_a_joint_spring_of_the_model(servo, tmp_path):
    """A wheel of next to no inertia, driven by a rigid gear with losses, and the load behind a spring."""
    (tmp_path / "wheel.urdf").write_text(chain(("wheel", 1e-12, "x"), ("load", LOAD, "twist")))
    spring = {"kind": "joint_spring", "joint": "twist", "stiffness": f"{K} N*m/rad", "damping": f"{C} N*m*s/rad"}
    drive = {"joint": "x", "ratio": N, "efficiency": ETA, "rotor_inertia": f"{ROTOR} kg*m^2",
             "motor": {"kind": "ideal"}}  # fmt: skip
    model = pinarm.Mechanism.load(
        tmp_path / "wheel.urdf", values={"drives": {"servo": drive}, "forces": {"shaft": spring}}
    )
    wheel = run(model, 0.3, start={"velocity": {"x": "4 rad/s", "twist": "-7 rad/s"}}, outputs=("x", "twist"))
    own = run(servo("output"), 0.3, start={"velocity": {"x": "-3 rad/s", "servo.rotor": "4 rad/s"}})
    assert np.abs(own["servo.rotor"].values - wheel["x"].values).max() < 1e-8
    assert np.abs(own["x"].values - wheel["x"].values - wheel["twist"].values).max() < 1e-8


ALONG = {"crank": (four_bar(), "O", "A", "angle", {"stiffness": "80 N*m/rad", "damping": "0.5 N*m*s/rad"}),
         "slide": (slider_crank(), "C", "A", "position", {"stiffness": "8000 N/m", "damping": "50 N*s/m"})}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("keys", [{}, {"efficiency": ETA, "shaft": "output"}])
@pytest.mark.parametrize("case", ALONG)
def test_a_joint_that_closes_a_loop_is_driven_as_one_of_the_tree(case, keys, tmp_path):
    linkage, cut, other, part, elasticity = ALONG[case]
    shaft = {key: value for key, value in keys.items() if key == "shaft"}
    drive = {"ratio": 20.0, "rotor_inertia": "3e-4 kg*m^2", "elasticity": {**elasticity, **shaft},
             "motor": {"kind": "ideal"}, **{key: value for key, value in keys.items() if key != "shaft"}}  # fmt: skip
    mechanisms = (linkage.build(tmp_path, [other], drives={"motor": {"joint": cut, **drive}}),
                  linkage.build(tmp_path, [cut], drives={"motor": {"along": f"{cut}.{part}", **drive}}))  # fmt: skip
    results = []
    for mechanism in mechanisms:
        scenario = {"pinarm": 1, "mechanism": mechanism, "outputs": ["motor.rotor", "drive.motor.deflection"],
                    "problem": {"kind": "forward", "time": {"end": "0.1 s", "samples": 11}}}  # fmt: skip
        results.append(pinarm.run(scenario, control={"motor": lambda t, state: np.cos(20.0 * t)}))
    for name in ("motor.rotor", "drive.motor.deflection"):
        tree, loop = (one[name].values - one[name].values[0] for one in results)
        assert np.abs(tree).max() > 1e-3
        assert np.abs(loop - tree).max() < 1e-7
