"""Virtual powers of links by the compiled library: against Pinocchio's recursion, and against the same in arrays."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.engine.checks.virtual_powers import in_arrays
from pinarm.engine.kernel.bodies import demanded_powers
from pinarm.engine.kernel.library import absence
from pinarm.mechanics.geometry.link_motion import motion_of
from pinarm.mechanics.geometry.vectors import lengths
from pinarm.mechanics.geometry.vectors import moved as moved_to

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


@pytest.fixture
def acting(moved):
    """Wrenches on all links, and sizes of what they could be the sums of."""
    wrenches = np.random.default_rng(3).normal(size=(COUNT, moved[0].njoints, 6))
    return wrenches, 3.0 * lengths(wrenches)


def nothing(model, n=COUNT):
    return np.zeros((n, model.njoints, 6)), np.zeros((n, model.njoints, 2))


def test_powers_are_the_efforts_of_the_recursion(moved, acting):
    """That of Newton and Euler passes forces from link frame to link frame, here they are summed in world axes."""
    model, q, v, a = moved
    data = model.createData()
    for wrenches, sizes in (nothing(model), acting):
        motion = motion_of(*moved)
        asked, terms, _ = demanded_powers(motion, wrenches, sizes)
        outside = motion[0].inwards(moved_to(wrenches, motion[0].places))
        wanted = [
            pin.rnea(model, data, *each, [pin.Force(force) for force in forces])
            for *each, forces in zip(q, v, a, outside, strict=True)
        ]
        assert np.abs(asked - (np.array(wanted) - model.armature * a)).max() < SHARP * terms.max()
        assert (terms >= np.abs(asked)).all()


def test_powers_and_sizes_are_those_in_arrays(moved, acting):
    motion = motion_of(*moved)
    links, twists, rates, _ = motion
    asked, terms, most = demanded_powers(motion, *acting)
    same, largest, speeds = in_arrays(motion, links.demands(twists, rates), *acting)
    assert np.abs(asked - same).max() < SHARP * terms.max()
    np.testing.assert_allclose(terms, largest, rtol=SHARP)
    np.testing.assert_allclose(most, speeds, rtol=SHARP)


def test_a_pendulum_has_those_of_its_textbook():
    """A mass m at the end of a rod l, at an angle q: m l^2 q'', no gyroscopic power, m g l sin q."""
    m, length, g, q, v, a = 2.0, 0.5, 9.81, 0.3, 4.0, -7.0
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "swing")
    model.appendBodyToJoint(joint, pin.Inertia(m, np.array([0.0, -length, 0.0]), np.zeros((3, 3))), pin.SE3.Identity())
    model.gravity = pin.Motion(np.array([0.0, -g, 0.0]), np.zeros(3))
    motion = motion_of(model, *(np.array([[x]]) for x in (q, v, a)))
    asked, terms, most = demanded_powers(motion, *nothing(model, 1))
    inertial, weight = m * length**2 * a, m * g * length * np.sin(q)
    assert asked.item() == pytest.approx(inertial + weight, rel=1e-14)
    forces = m * length * (abs(a) + v**2) + m * g  # each with the whole rod as its arm
    assert terms.item() == pytest.approx(abs(inertial) + abs(weight) + forces * length, rel=1e-14)
    assert most.item() == pytest.approx((abs(inertial) + weight) * v, rel=1e-14)  # the joint's own origin stands still


def test_without_the_library_there_are_none(moved, acting, monkeypatch):
    monkeypatch.setattr("pinarm.engine.kernel.bodies.library", lambda: None)
    assert demanded_powers(motion_of(*moved), *acting) is None
