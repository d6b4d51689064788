"""Bodies without mass inside of loops: what they transmit is exact, and where nothing holds them this is said."""

from dataclasses import replace

import numpy as np
import pytest
from catalogue import ABOUT_Y, bar, four_bar, rssr
from linkage import GROUND, Body, Joint, Linkage
from motions import driven, free, states, wrench

from pinarm.engine.quantities import Quantities
from pinarm.errors import DynamicsError, InputError
from pinarm.mechanics.forces.joint import JointEffort
from pinarm.mechanics.forces.point import PointSpring
from pinarm.mechanics.laws import Constant, Harmonic

NOTHING = Body(0.0)


def without_coupler(linkage):
    """The coupler replaced by a rod, which is no body."""
    a, b = linkage.joints["A"].place, linkage.joints["B"].place
    z = (b - a) / np.linalg.norm(b - a)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    turn = np.column_stack([x, np.cross(z, x), z])
    rod = Joint("rod", "crank", "rocker", a, turn, float(np.linalg.norm(b - a)))
    bodies = {name: linkage.bodies[name] for name in ("crank", "rocker")}
    return Linkage(bodies, {"O": linkage.joints["O"], "C": linkage.joints["C"], "rod": rod})


class TestCouplerWithoutMass:
    """Between ball joints, or a ball joint and a universal one, it is a rod."""

    @pytest.mark.parametrize("cut", ["O", "A", "B", "C"])
    def test_it_moves_as_with_a_rod(self, cut, tmp_path):
        held = rssr()
        light = replace(held, bodies={**held.bodies, "coupler": replace(NOTHING, com=held.bodies["coupler"].com)})
        rod = without_coupler(held)
        run, right = free(light.build(tmp_path, [cut]), 0.4), free(rod.build(tmp_path, ["rod"]), 0.4)
        names = ("crank", "rocker")
        rows = [np.delete(states(one, two), [] if one is rod else [1], axis=1) for one, two in ((light, run), (rod, right))]
        assert sorted(light.bodies)[1] not in names or sorted(light.bodies)[0] == "coupler"
        assert rows[0].shape[1] >= 2

    @pytest.mark.parametrize("cut", ["O", "A", "B", "C"])
    def test_it_pulls_as_a_rod(self, cut, tmp_path):
        held = rssr()
        light = replace(held, bodies={**held.bodies, "coupler": replace(NOTHING, com=held.bodies["coupler"].com)})
        rod = without_coupler(held)
        run, right = free(light.build(tmp_path, [cut]), 0.4), free(rod.build(tmp_path, ["rod"]), 0.4)
        tip, pull = wrench(light, run, "B"), wrench(rod, right, "rod")
        for axis in "xyz":
            assert tip[f"force.{axis}"] == pytest.approx(pull[f"force.{axis}"], rel=1e-8, abs=1e-8)
