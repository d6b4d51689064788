"""What follows laws over time in the compiled kernel: against the same without it, and closed forms."""

import math
import shutil
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import pinarm
from pinarm.engine.motion.systems.loop_system import LoopSystem
from pinarm.mechanics.ball_joints import coordinate_at
from pinarm.mechanics.forces.along_coordinate import EffortAlong
from pinarm.mechanics.forces.load_laws import LoadLaw
from pinarm.mechanics.laws import Constant
from pinarm.mechanics.laws.motion_law import Wave

from .known_trees import compiled, tree

LAWS = {
    "steps": "{law: steps, points: [[0 s, 2 U], [0.3 s, -1 U]]}",
    "harmonic": "{law: harmonic, amplitude: 2 U, pulsation: 7 rad/s, mean: 0.5 U, phase: 40 deg, begin: 0.1 s}",
    "polynomial_7": "{law: polynomial, from: 1 U, to: -2 U, duration: 0.7 s, degree: 7, begin: 0.05 s}",
    "cycloidal": "{law: cycloidal, from: 1 U, to: -2 U, duration: 0.6 s, begin: 0.1 s}",
    "spline": "{law: spline, points: [[0.1 s, 0 U], [0.25 s, 1 U], [0.6 s, 0.5 U]], speeds: [0 U/s, 2 U/s]}",
}
"""Laws with a unit U."""

ARM = """
pinarm: 1
title: Arm under a torque that follows a law
mechanism: models/gen411_arm/mechanism.yaml
problem:
  kind: forward
  time: {end: 0.8 s, samples: 41}
  loads:
    torque: {kind: joint_effort, joint: B, effort: LAW}
outputs: [energy.total]
accuracy: {tolerance: 1e-10}
"""


@pytest.fixture
def scenario(tmp_path):
    """Return a function that writes a scenario beside the models, and returns its path."""
    for name in ("olive_vibrator", "gen411_arm"):
        shutil.copytree(Path("models") / name, tmp_path / "models" / name)
    (tmp_path / ".pinarm-root").touch()

    def write(text, law, unit):
        path = tmp_path / "scenario.yaml"
        path.write_text(text.replace("LAW", law.replace("U", unit)))
        return path

    return write


def agree(found, expected, within):
    for one, other in ((found.trajectory.q, expected.trajectory.q), (found.trajectory.v, expected.trajectory.v)):
        assert np.abs(one - other).max() <= within * np.abs(other).max()


@pytest.mark.usefixtures("compiled")
class TestRuns:
    @pytest.mark.parametrize("name", LAWS)
    def test_of_an_arm_with_a_torque_are_the_same_with_the_library_and_without(self, name, scenario, calls, without):
        path = scenario(ARM, LAWS[name], "N*m")
        found = pinarm.run(path)
        assert calls
        expected = without(lambda: pinarm.run(path))
        agree(found, expected, 1e-9)
        assert all("leaves its points" in note for note in found.notes())  # the spline does


@pytest.mark.usefixtures("compiled")
def test_a_mass_under_a_wave_and_a_steady_force_moves_as_in_its_textbook():
    """``m x'' = F + A sin(w (t - t_0) + p)`` less the weight along the slide."""
    model, steady = tree(["PX"], 0), 3.0
    m = float(pin.crba(model, model.createData(), np.zeros(1))[0, 0])
    wave = Wave(0.0, 2.0, 0.0, 5.0, 0.4, 0.2)
    effort = EffortAlong(model, coordinate_at(model, 0), LoadLaw(Constant(value=0.0), function=wave))
    flow = compiled(model, np.array([steady]), (effort,))
    weight = float(pin.rnea(model, model.createData(), np.zeros(1), np.zeros(1), np.zeros(1))[0])
    for t in (0.0, 0.7, 9.0):
        a = (steady + 2.0 * math.sin(5.0 * (t - 0.2) + 0.4) - weight) / m
        assert flow.slope(t, np.array([0.3, -0.8]))[1] == pytest.approx(a, rel=1e-13)


PENDULUM = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial><origin xyz="0.4 0 0"/>
  <mass value="2"/><inertia ixx="0.01" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="theta" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 -1 0"/></joint></robot>"""


def test_a_pendulum_under_a_table_of_torques_is_prepared_once_and_moves_as_its_equation(tmp_path, monkeypatch):
    """``(I + m c^2) theta'' = tau(t) - m g c cos(theta)``, by SciPy with its own spline: 200 rows are 199 cubics."""
    t = np.linspace(0.0, 2.0, 200)
    tau = 9.0 * np.sin(3.0 * t) + 4.0 * np.cos(11.0 * t)
    rows = "\n".join(f"{one!r},{other!r}" for one, other in zip(t.tolist(), tau.tolist(), strict=True))
    (tmp_path / "tau.csv").write_text(f"t [s],tau [N*m]\n{rows}\n")
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    (tmp_path / "m.yaml").write_text("pinarm: 1\nrobot: pendulum.urdf\n")
    (tmp_path / "s.yaml").write_text(
        "pinarm: 1\nmechanism: m.yaml\noutputs: [theta]\naccuracy: {tolerance: 1e-11}\n"
        "problem: {kind: forward, time: {end: 2 s, samples: 21}, initial: {position: {theta: 20 deg}},\n"
        "  loads: {motor: {kind: joint_effort, joint: theta, effort: {law: table, file: tau.csv}}}}\n"
    )
    prepared = []
    whole = LoopSystem.interval
    monkeypatch.setattr(LoopSystem, "interval", lambda *args: prepared.append(args[2:]) or whole(*args))
    found = pinarm.run(tmp_path / "s.yaml")
    assert prepared == [(0.0, 2.0)]
    spline = CubicSpline(t, tau, bc_type="clamped")
    expected = solve_ivp(
        lambda t, y: (y[1], (spline(t) - 2.0 * 9.81 * 0.4 * math.cos(y[0])) / (0.1 + 2.0 * 0.4**2)), (0.0, 2.0),
        (math.radians(20.0), 0.0), "DOP853", found.trajectory.grid.t, rtol=1e-12, atol=1e-12, max_step=t[1],
    )  # fmt: skip
    assert np.abs(found.trajectory.q[:, 0] - expected.y[0]).max() < 1e-9
