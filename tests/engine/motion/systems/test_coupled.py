"""Trees with couplings, all of whose coordinates are integrated: closed forms, and the kernel against Python."""

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from pinarm.engine.kernel.library import library
from pinarm.engine.kinematics.prescribed import PrescribedCoordinates
from pinarm.engine.motion.systems import Initial, system_of
from pinarm.engine.motion.systems.coupled import CoupledSystem
from pinarm.engine.motion.systems.partitioned import PartitionedSystem
from pinarm.mechanics.laws import Constant

WHEEL = """<link name="{name}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{joint}" type="continuous"><parent link="{parent}"/><child link="{name}"/><axis xyz="0 0 1"/></joint>"""


@pytest.fixture
def wheels(tmp_path):
    """Two wheels of 2 and 0.5 kg m^2 with ``q2 = -3 q1``, and a spring of 26 N m/rad at the first."""
    parts = [WHEEL.format(name=f"wheel{k}", joint=f"q{k}", inertia=inertia, parent="base")
             for k, inertia in ((1, 2.0), (2, 0.5))]  # fmt: skip
    (tmp_path / "wheels.urdf").write_text(f'<robot name="wheels"><link name="base"/>{"".join(parts)}</robot>')
    values = {"couplings": {"gear": {"kind": "sum", "weights": {"q2": 1.0, "q1": 3.0}}},
              "forces": {"spring": {"kind": "joint_spring", "joint": "q1", "stiffness": "26 N*m/rad"}}}  # fmt: skip
    return pinarm.Mechanism.load(tmp_path / "wheels.urdf", values=values)


def asked(mechanism, outputs, end="10 s", **problem):
    return {"pinarm": 1, "mechanism": mechanism, "outputs": outputs, "accuracy": {"tolerance": 1e-12}, "problem": {
        "kind": "forward", "time": {"end": end, "samples": 51}, **problem,
    }}  # fmt: skip


def test_a_geared_oscillator_has_its_frequency(wheels):
    """``(J1 + 9 J2) q'' + k q = 0``: w = 2/s."""
    result = pinarm.run(asked(wheels, ["q1", "q2"], initial={"position": {"q1": "0.4 rad", "q2": "-1.2 rad"}}))
    exact = 0.4 * np.cos(2.0 * result["t"].values)
    assert np.abs(result["q1"].values - exact).max() < 1e-9
    assert np.abs(result["q2"].values + 3.0 * result["q1"].values).max() < 1e-14
    assert result.figures["energy"] < 1e-9


JOINTS = [f"panda_joint{k}" for k in range(1, 8)]
START = dict(zip(JOINTS, ("10 deg", "-45 deg", "20 deg", "-135 deg", "30 deg", "90 deg", "45 deg"), strict=True))


def test_the_kernel_and_python_take_the_same_steps(monkeypatch):
    """The Panda falls from rest with its fingers coupled: the same motion, as far as rounding is amplified."""
    if library() is None:
        pytest.skip("no compiled library")
    question = asked("panda", ["panda_joint2", "panda_finger_joint1"], "0.5 s", initial={"position": START})
    compiled = pinarm.run(question)
    monkeypatch.setattr("pinarm.engine.motion.systems.compiled.compiled_couplings.library", lambda: None)
    python = pinarm.run(question)
    for cost in ("steps", "rejected steps"):
        assert compiled.figures[cost] == python.figures[cost]
    for name in question["outputs"]:
        assert np.abs(compiled[name].values - python[name].values).max() < 1e-10


def panda(laws):
    """The Panda and what is integrated of it while joints follow laws."""
    mechanism = pinarm.Mechanism.load("panda")
    initial = Initial(np.zeros(mechanism.model.nq), np.zeros(mechanism.model.nv))
    prescribed = PrescribedCoordinates.some(mechanism, laws)
    return mechanism, system_of(mechanism.closure, mechanism.dynamics, prescribed, initial)


def test_accelerations_of_the_kernel_satisfy_the_equation_of_motion():
    """``M a + nle = W^T lam`` by Pinocchio and ``W a = 0``, in states that are on the couplings."""
    if library() is None:
        pytest.skip("no compiled library")
    mechanism, system = panda({})
    assert isinstance(system, CoupledSystem)
    flow, model = system.interval(mechanism.dynamics, 0.0, 1.0).compiled, mechanism.model
    random = np.random.default_rng(5)
    assert flow is not None
    weights = system.inner.reduction.rows
    for _ in range(10):
        q, v = system.whole(np.zeros(1), random.normal(size=(1, model.nq)), random.normal(size=(1, model.nv)))
        a = flow.slope(0.0, np.concatenate([q[0], v[0]]))[model.nq :]
        left = pin.rnea(model, mechanism.dynamics.data, q[0], v[0], a) - mechanism.dynamics.loads(0.0, q[0], v[0])
        lam = np.linalg.lstsq(weights.T, left)[0]
        size = np.abs(a).max() * np.diag(pin.crba(model, mechanism.dynamics.data, q[0])).max()
        assert np.abs(left - weights.T @ lam).max() < 1e-12 * size
        assert np.abs(weights @ a).max() < 1e-13 * np.abs(a).max()


def test_with_laws_only_what_is_left_is_integrated():
    _, system = panda({"panda_joint1": Constant(value=0.0)})
    assert isinstance(system, PartitionedSystem)
