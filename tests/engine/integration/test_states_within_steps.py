"""States within steps are as good as at their ends, where the dense output of a step does not follow the motion."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

import pinarm
from pinarm.engine.constraints.closure import Closure
from pinarm.engine.dynamics.dynamics import Dynamics
from pinarm.engine.integration.driver import integrate
from pinarm.engine.integration.methods.explicit import Adaptive
from pinarm.engine.integration.runge_kutta import DOPRI5
from pinarm.engine.kernel.library import library
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems.loop_system import LoopSystem
from pinarm.mechanics.forces.joint_forces import SpringDamper
from pinarm.records import replace

SLOW, FAST = 1.0, 300.0
"""Decays of a slide of 1 kg on a spring ``SLOW FAST`` with the damper ``SLOW + FAST``."""

SLIDE = """<robot name="slide"><link name="base"/><link name="door"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="x" type="prismatic">
<parent link="base"/><child link="door"/><axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/>
</joint></robot>"""


def slide():
    """Return the slide's manifold, and its motion of 1 s."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    here = np.array([0])
    damper = SpringDamper(here, here, np.array([SLOW * FAST]), np.array([SLOW + FAST]), np.zeros(1))
    dynamics = Dynamics.of(model, {"damper": damper})
    system = LoopSystem.of(Closure.of(model), dynamics, PrescribedCoordinates((), (), ()), np.zeros(1))
    return dynamics.manifold, system.interval(dynamics, 0.0, 1.0)


def decay(t):
    """Return x and x' from 1 m at rest."""
    slow, fast = np.exp(-SLOW * t), np.exp(-FAST * t)
    x, v = (FAST * slow - SLOW * fast) / (FAST - SLOW), SLOW * FAST * (fast - slow) / (FAST - SLOW)
    return np.stack([x, v], axis=1)


def states(route, method):
    """Return the states of the slide at some times, and at the ends of its steps."""
    manifold, interval = slide()
    q, v, t = np.ones(1), np.zeros(1), np.linspace(0.0, 1.0, 601)
    solution = integrate(
        [interval if route == "compiled" else replace(interval, compiled=None)], manifold, q, v, method
    )
    found = np.concatenate(solution.states(t), axis=1)
    return t, found, solution.steps.t, solution.steps.y


@pytest.mark.parametrize("route", ["compiled", "in Python"])
@pytest.mark.parametrize("method", [Adaptive(1e-9), Adaptive(1e-6, DOPRI5)])
def test_beyond_the_limit_of_stability_states_within_steps_are_as_good_as_ends(route, method):
    """When the fast part has died away, dense outputs of whole steps erred 30 to 1000 times as much."""
    if route == "compiled" and library() is None:
        pytest.skip("the compiled kernel is not there")
    t, found, ends, y = states(route, method)
    least = np.abs(y - decay(ends)).max()
    assert least < 10.0 * method.tolerance  # of steps that the stability shortens
    assert np.abs(found - decay(t)).max() < 10.0 * least


def test_states_within_long_steps_of_a_motion_that_slows_down_are_as_good_as_ends():
    """A servo with decays of 1.3/s and 18.7/s: the cubics through the ends of its last steps err by 1e-6."""
    scenario = Path(pinarm.__file__).parents[1] / "scenarios" / "servo_step.yaml"
    result = pinarm.run(scenario, ["problem.control.0.kd=40 N*m*s/rad"])
    roots = np.roots([2.0, 40.0, 50.0])  # J, kd, kp
    parts = np.linalg.solve([[1.0, 1.0], roots], [-1.0, 0.0])
    expected = 1.0 + np.exp(np.outer(result["t"].values, roots)) @ parts
    assert np.abs(result["x"].values - expected).max() < 5e-9  # at a tolerance of 1e-9


def test_loads_between_samples_are_those_of_the_step(tmp_path):
    """``x'' = -a b x - (a + b) x' + u`` with ``u = 600 - 200 x`` sampled every 0.3 s."""
    (tmp_path / "slide.urdf").write_text(SLIDE)
    result = pinarm.run({
        "pinarm": 1, "mechanism": pinarm.Mechanism.load(tmp_path / "slide.urdf"), "outputs": ["x"],
        "problem": {"kind": "forward", "time": {"end": "0.6 s", "samples": 61},
                    "initial": {"position": {"x": "1 m"}, "velocity": {"x": "0 m/s"}},
                    "loads": {"damper": {"kind": "joint_spring", "joint": "x", "stiffness": f"{SLOW * FAST} N/m",
                                         "damping": f"{SLOW + FAST} N*s/m"}},
                    "control": [{"kind": "state_feedback", "drive": "x", "states": ["x"], "bias": ["600 N"],
                                 "gains": [["200 N/m", "0 N*s/m"]], "period": "0.3 s"}]},
        "accuracy": {"tolerance": 1e-6},
    })  # fmt: skip
    free = np.array([[0.0, 1.0, 0.0], [-SLOW * FAST, -SLOW - FAST, 1.0], [0.0, 0.0, 0.0]])
    first = np.array([1.0, 0.0, 400.0])
    x, v, _ = expm(0.3 * free) @ first
    second, t = np.array([x, v, 600.0 - 200.0 * x]), result["t"].values
    expected = [expm(at * free) @ first if at < 0.3 else expm((at - 0.3) * free) @ second for at in t]
    found = np.stack([result["x"].values, result["joint.x.velocity"].values], axis=1)
    assert np.abs(found - np.array(expected)[:, :2]).max() < 1e-5  # ends err by 3e-6
