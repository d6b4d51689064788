"""Springs between points and wrenches at points, by hand."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.errors import DynamicsError
from pinarm.mechanics.forces.points import PointSpring, Wrench
from pinarm.mechanics.joints import frame_of, joints_of
from pinarm.mechanics.loading.pinocchio_model import build_model

from .test_force_element import load, wrenches_of


@pytest.mark.parametrize("point", ["slide_link", "turn_link"])
@pytest.mark.parametrize("axes", ["world", "slide_link"])
def test_load_of_a_wrench_is_its_virtual_work(model, joints, differentiate, point, axes):
    """Force times the displacement of the point, moment times the rotation, both by differences of the placement."""
    force, moment = np.array([3.0, -8.0, 5.0]), np.array([1.0, 2.0, -4.0])
    element = Wrench(point=point, force=force, moment=moment, axes=axes).bind(model, joints).on(0, 1)
    q, data = np.array([0.7, -0.4]), model.createData()

    def placement(x, name=point):
        pin.framesForwardKinematics(model, data, x)
        return data.oMf[frame_of(model, name)].copy() if name != "world" else pin.SE3.Identity()

    given, here = placement(q, axes).rotation, placement(q)
    for k, direction in enumerate(np.eye(2)):

        def moved(h, direction=direction):
            there = placement(pin.integrate(model, q, h * direction))
            return np.concatenate([there.translation, pin.log3(there.rotation @ here.rotation.T)])

        change = differentiate(moved, 0.0)
        expected = (given @ force) @ change[:3] + (given @ moment) @ change[3:]
        # differences of order 8 at h = 0.02
        assert load(element, 0.5, q, np.zeros(2))[k] == pytest.approx(expected, abs=1e-11)


@pytest.fixture
def held(chain):
    """A pendulum of 0.8 m about z, and a hook at (0.3, 1.1) that its tip is tied to."""
    ends = (
        '<link name="tip"/><joint name="end" type="fixed"><parent link="arm_link"/><child link="tip"/>'
        '<origin xyz="0.8 0 0"/></joint><link name="hook"/><joint name="wall" type="fixed"><parent link="base"/>'
        '<child link="hook"/><origin xyz="0.3 1.1 0"/></joint></robot>'
    )
    model = build_model(chain({"name": "arm"}).replace("</robot>", ends)).model
    return model, joints_of(model)


@pytest.mark.parametrize("ends", [("hook", "tip"), ("tip", "hook")])
@pytest.mark.parametrize("theta", [0.2, 2.7])
def test_point_spring_on_a_pendulum_by_hand(held, ends, theta):
    element = PointSpring(between=ends, stiffness=40.0, damping=6.0, free_length=0.5,
                          force=3.0).bind(*held)  # fmt: skip
    rate = 1.7
    x, y = 0.8 * np.cos(theta) - 0.3, 0.8 * np.sin(theta) - 1.1
    length = np.hypot(x, y)
    # l^2 = 0.8^2 + 0.3^2 + 1.1^2 - 2 * 0.8 (0.3 cos + 1.1 sin), so that l dl/dtheta = 0.8 (0.3 sin - 1.1 cos)
    slope = 0.8 * (0.3 * np.sin(theta) - 1.1 * np.cos(theta)) / length
    tension = 40.0 * (length - 0.5) + 6.0 * slope * rate + 3.0
    q, v = np.array([theta]), np.array([rate])
    assert load(element, 0.0, q, v) == pytest.approx([-tension * slope], rel=1e-13)
    stretched = length - 0.5
    assert element.potential_energy(q) == pytest.approx(20.0 * stretched**2 + 3.0 * stretched, rel=1e-13)
    assert element.dissipated_power(0.0, q, v) == pytest.approx(6.0 * (slope * rate) ** 2, rel=1e-13)
    pull = wrenches_of(element, held[0], 0.0, q, v)[1]
    point = np.array([0.8 * np.cos(theta), 0.8 * np.sin(theta), 0.0])
    expected = -tension * np.array([x, y, 0.0]) / length
    assert pull == pytest.approx(np.concatenate([expected, np.cross(point, expected)]), abs=1e-12)


@pytest.fixture
def meeting(chain):
    """A pendulum whose tip is at the hook at 0."""
    ends = "".join(
        f'<link name="{name}"/><joint name="to_{name}" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="0.8 0 0"/></joint>' for name, parent in (("tip", "arm_link"), ("hook", "base"))
    )  # fmt: skip
    return build_model(chain({"name": "arm"}).replace("</robot>", f"{ends}</robot>")).model


@pytest.mark.parametrize("n", [3, 20])
def test_a_spring_of_free_length_zero_pulls_through_zero(meeting, n):
    """Its energy is k l^2 / 2 with l = 2 * 0.8 sin(theta / 2): the load -0.64 k sin(theta), 0 where the points meet."""
    element = PointSpring(between=("tip", "hook"), stiffness=40.0).bind(meeting, joints_of(meeting))
    theta = np.linspace(0.0, 1.0, n)[:, None]
    found = load(element, np.zeros(n), theta, np.ones((n, 1)))
    assert found == pytest.approx(-0.64 * 40.0 * np.sin(theta), abs=1e-13)
    assert element.potential_energy(theta) == pytest.approx(0.64 * 40.0 * (1.0 - np.cos(theta[:, 0])), abs=1e-13)
    assert not any(wrench.any() for wrench in wrenches_of(element, meeting, 0.0, theta[0], np.ones(1)).values())


@pytest.mark.parametrize("act", [
    lambda element, q, v: load(element, 0.0, q, v),
    lambda element, q, v: wrenches_of(element, element.model, 0.0, q, v),
])  # fmt: skip
def test_points_that_meet_are_refused(meeting, act):
    element = PointSpring(between=("tip", "hook"), stiffness=1.0, damping=1.0).bind(meeting, joints_of(meeting))
    with pytest.raises(
        DynamicsError, match=r"points tip and hook of a two-point spring meet: .* where arm = 0 deg"
    ) as caught:
        act(element, np.zeros(1), np.ones(1))
    assert caught.value.data["q"].tolist() == [0.0]
    with pytest.raises(DynamicsError, match="points tip and hook of a two-point spring meet"):
        element.potential_energy(np.repeat([[1.0], [0.0]], 20, axis=0))
