"""Placements, twists and wrenches of all links at once, against Pinocchio state by state."""

import numpy as np
import pinocchio as pin
import pytest

from pinarm.mechanics.geometry.link_placements import LinkPlacements
from pinarm.mechanics.geometry.vectors import moved

N = 4


@pytest.fixture(params=[pin.buildSampleModelManipulator, pin.buildSampleModelHumanoid], ids=["held", "floating"])
def model(request):
    built = request.param()
    inner = pin.SE3.Random()
    built.addFrame(pin.Frame("tool", 3, built.frames[0].parentFrame, inner, pin.FrameType.OP_FRAME))
    return built


@pytest.fixture
def states(model):
    generator = np.random.default_rng(1)
    q = np.array([pin.integrate(model, pin.neutral(model), generator.normal(size=model.nv)) for _ in range(N)])
    return q, generator.normal(size=(N, model.nv)), generator.normal(size=(N, model.nv))


def test_wrenches_change_their_frame_as_pinocchio_changes_it(model, states):
    links = LinkPlacements.at(model, states[0])
    own = np.random.default_rng(2).normal(size=(N, model.njoints, 6))
    outwards = links.outwards(own)
    world = moved(outwards, links.places)
    assert links.inwards(world) == pytest.approx(own, abs=1e-12)
    for row in range(N):
        for joint in range(1, model.njoints):
            placement = pin.SE3(links.turns[row, joint], links.places[row, joint])
            assert world[row, joint] == pytest.approx(placement.act(pin.Force(own[row, joint])).vector, abs=1e-12)
            turned = pin.SE3(placement.rotation, np.zeros(3)).act(pin.Force(own[row, joint]))
            assert outwards[row, joint] == pytest.approx(turned.vector, abs=1e-12)
