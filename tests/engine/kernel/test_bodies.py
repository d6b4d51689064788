"""Virtual powers of links by the compiled library: against Pinocchio's recursion, and against the same in arrays."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.checks import balance
from pinarm.engine.kernel.bodies import demanded_powers
from pinarm.engine.kernel.library import absence
from pinarm.mechanics.geometry.link_motion import motion_of

from .known_trees import JOINTS, UNKNOWN, states, tree

pytestmark = pytest.mark.skipif(bool(absence()), reason=f"compiled kernel: {absence()}")

COUNT, SHARP = 7, 1e-12
"""States, and rounding relative to the terms, over a dozen joints some metres apart."""


@pytest.fixture(params=range(4))
def moved(request):
    """A tree of every kind of joint, at random states with random accelerations."""
    names = np.random.default_rng(request.param).permutation([*JOINTS, *UNKNOWN])[:12].tolist()
    model = tree(names, request.param)
    q, v = (np.array(each) for each in zip(*states(model, COUNT), strict=True))
    return model, q, v, np.random.default_rng(2).normal(size=v.shape)


def test_powers_are_the_efforts_of_the_recursion(moved):
    """That of Newton and Euler passes forces from link to link; here every link's act on every joint before it."""
    model, q, v, a = moved
    asked, sizes, _ = demanded_powers(*motion_of(*moved))
    data = model.createData()
    wanted = np.array([pin.rnea(model, data, *each) for each in zip(q, v, a, strict=True)]) - model.armature * a
    assert np.abs(asked - wanted).max() < SHARP * sizes.max()
    assert (sizes >= np.abs(asked)).all()


def test_powers_and_sizes_are_those_in_arrays(moved):
    links, twists, rates, columns = motion_of(*moved)
    asked, sizes, most = demanded_powers(links, twists, rates, columns)
    demands = links.demands(twists, rates)
    wanted, terms = balance._asked(links, columns, links.at_world(demands))
    largest = balance._most_powers(demands, twists)
    assert np.abs(asked - wanted).max() < SHARP * terms.max()
    np.testing.assert_allclose(sizes, terms, rtol=0.0, atol=SHARP * terms.max())
    np.testing.assert_allclose(most, largest, rtol=SHARP)


def test_a_pendulum_has_those_of_its_textbook():
    """A mass m at the end of a rod l, at an angle q: m l^2 q'', no gyroscopic power, m g l sin q, path l."""
    m, length, g, q, v, a = 2.0, 0.5, 9.81, 0.3, 4.0, -7.0
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "swing")
    model.appendBodyToJoint(joint, pin.Inertia(m, np.array([0.0, -length, 0.0]), np.zeros((3, 3))), pin.SE3.Identity())
    model.gravity = pin.Motion(np.array([0.0, -g, 0.0]), np.zeros(3))
    asked, sizes, most = demanded_powers(*motion_of(model, *(np.array([[x]]) for x in (q, v, a))))
    inertial, weight = m * length**2 * a, m * g * length * np.sin(q)
    assert asked.item() == pytest.approx(inertial + weight, rel=1e-14)
    assert sizes.item() == pytest.approx(abs(inertial) + abs(weight) + m * g * length, rel=1e-14)
    assert most.item() == pytest.approx((abs(inertial) + weight) * v, rel=1e-14)  # the joint's own origin stands still


def test_without_the_library_there_are_none(moved, monkeypatch):
    monkeypatch.setattr("pinarm.engine.kernel.bodies.library", lambda: None)
    assert demanded_powers(*motion_of(*moved)) is None
