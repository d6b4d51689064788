"""The stiffness of weights against Pinocchio, of trees of many joints too."""

import numpy as np
import pinocchio as pin
import pytest

import pinarm
from benchmarks.growth import written
from pinarm.engine.statics.stiffness import weight_slopes
from pinarm.mechanics.geometry.pinocchio_data import new_data


def depth_first(count: int, generator: np.random.Generator) -> pin.Model:
    """A tree of sliding and turning joints, three on each of the first ones, in the order that Pinocchio asks for."""
    model = pin.Model()
    left = [count]

    def grow(parent: int) -> None:
        for _ in range(3):
            if not left[0]:
                return
            left[0] -= 1
            kind = pin.JointModelRevoluteUnaligned if left[0] % 3 else pin.JointModelPrismaticUnaligned
            axis = generator.normal(size=3)
            joint = model.addJoint(parent, kind(axis / np.linalg.norm(axis)), pin.SE3.Random(), f"joint{left[0]}")
            model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Random())
            if generator.random() < 0.8:
                grow(joint)

    grow(0)
    model.gravity.linear = np.array([1.0, -3.0, 9.0])
    return model


@pytest.mark.parametrize("count", [2, 20, 90])
def test_slopes_of_weights_are_those_of_pinocchio(count: int) -> None:
    """Beyond 64 velocities the buffers are smaller than Pinocchio's derivatives need: these end the process."""
    generator = np.random.default_rng(count)
    model = depth_first(count, generator)
    q = generator.normal(size=model.nq)
    wanted = np.array(pin.computeGeneralizedGravityDerivatives(model, model.createData(), q)).reshape(
        model.nv, model.nv
    )
    found = weight_slopes(model, new_data(model), q)
    np.testing.assert_allclose(found, wanted, atol=1e-12 * max(np.abs(wanted).max(), 1.0))


@pytest.mark.slow
def test_many_loops_rest_where_a_spring_holds_them(tmp_path):
    """``k (theta - rest) = A g sin theta`` of 41 uprights of 1 m and 1 kg, and 40 couplers on their ends."""
    path, n, k, rest, g = written(tmp_path, "fourbars", 40), 40, 2000.0, 0.1, 9.81
    with (tmp_path / "mechanism.yaml").open("a") as file:
        file.write(f"forces:\n  s: {{kind: joint_spring, joint: u0, stiffness: {k} N*m/rad, rest: {rest} rad}}\n")
    path.write_text(
        "pinarm: 1\nmechanism: mechanism.yaml\nproblem:\n  kind: equilibria\n  starts: [{u0: 0 deg}]\n"
        "outputs: [joint.u0.position, joint.u40.position, equilibrium.frequency2_1]\n"
    )
    run = pinarm.Scenario.load(path).run()
    [theta], lever, inertia = run["joint.u0.position"].values, 0.5 * (n + 1) + n, 0.33 * (n + 1) + n
    assert k * (theta - rest) == pytest.approx(lever * g * np.sin(theta), rel=1e-9)
    assert run["joint.u40.position"].values == pytest.approx([theta], rel=1e-9)
    square = (k - lever * g * np.cos(theta)) / inertia
    assert run["equilibrium.frequency2_1"].values == pytest.approx([square], rel=1e-8)
