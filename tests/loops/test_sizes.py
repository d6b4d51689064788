"""Loops of any size: angles are those of 1 m."""

import numpy as np
import pytest
from catalogue import four_bar, rssr, slider_crank
from linkage import Body, Linkage
from motions import driven, free

from pinarm.mechanics.laws import ConstantSpeed
from pinarm.records import replace

LOOPS = {"four-bar": (four_bar(), "B"), "spatial four-bar": (rssr(), "A"), "slider-crank": (slider_crank(), "A")}


def sized(linkage, size):
    """Lengths times the size; in times of its root the same motion falls as far."""
    joints = {name: replace(one, place=size * one.place) for name, one in linkage.joints.items()}
    bodies = {name: Body(one.mass, size * one.com, size**2 * one.inertia) for name, one in linkage.bodies.items()}
    return Linkage(bodies, joints)


@pytest.mark.parametrize("size", [1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize("name", LOOPS)
def test_loops_move_alike_at_any_size(name, size, tmp_path):
    linkage, cut = LOOPS[name]
    end, found = 0.4 * np.sqrt(size), []
    for one, time in ((linkage, 0.4), (sized(linkage, size), end)):
        mechanism = one.build(tmp_path, [cut])
        slides = np.array([size if one is not linkage and joint.unit.dimension[0] else 1.0
                           for joint in mechanism.joints.values()])  # fmt: skip
        speed = 1.0 / time
        runs = (
            free(mechanism, time, velocity={"O": speed}),
            driven(mechanism, {"O": ConstantSpeed(speed=speed)}, time),
        )
        found.append([run.q / slides for run in runs])
    for usual, other in zip(*found, strict=True):
        assert other == pytest.approx(usual, abs=3e-9)  # 1e-12 of 1 + |v|, where v is 1e-3 at 1e6 m: 1e-9 of v a step
