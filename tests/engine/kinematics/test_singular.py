"""What is said where a coordinate reaches the end of its travel."""

import math
import re

import pytest

import pinarm
from pinarm.errors import AssemblyError

O, A, B, C = (0.0, 0.0), (0.0, 0.3), (0.2, 0.35), (0.4, 0.0)


def metres(*place):
    return [f"{x} m" for x in place]


def refusal(points, links, ground, motion, **more):
    planar = {"points": {name: metres(*place) for name, place in points.items()}, "ground": ground, **more}
    planar["links"] = {name: {"points": list(ends), "mass": "1 kg"} for name, ends in links.items()}
    problem = {"kind": "kinematics", "time": {"end": "1 s", "samples": 11}, "motion": motion}
    text = {"pinarm": 1, "mechanism": {"pinarm": 1, "planar": planar}, "problem": problem, "outputs": ["O"]}
    with pytest.raises(AssemblyError) as caught:
        pinarm.run(text)
    return f"{caught.value.message} {caught.value.expected}"


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_of_a_crank_that_cannot_turn(way):
    """It ends where rod and rocker are in line, stretched or folded; its angle there is by the law of cosines."""
    rod, rocker, base, crank = math.dist(A, B), math.dist(B, C), math.dist(O, C), math.dist(O, A)
    reach = rocker + way * rod
    end = math.acos((crank**2 + base**2 - reach**2) / (2.0 * crank * base)) - math.pi / 2
    motion = {"O": {"law": "constant_speed", "speed": f"{60 * way} rpm"}}
    said = refusal({"O": O, "A": A, "B": B, "C": C}, {"crank": "OA", "rod": "AB", "rocker": "BC"}, ["O", "C"], motion)
    told = re.search(r"as it does up to t = (\S+) s", said)
    assert told is not None, said
    assert 2.0 * math.pi * way * float(told[1]) == pytest.approx(end, abs=1e-4)  # steps end at the root of the last one


def test_of_a_piston_at_the_inner_dead_centre():
    """A row is exactly there, where the position is singular."""
    points = {"O": O, "A": (0.0, 0.04), "B": (math.sqrt(0.14**2 - 0.04**2), 0.0)}
    links, sliders = {"crank": "OA", "rod": "AB", "piston": "B"}, {"x": {"link": "piston", "along": ["O", "B"]}}
    way = 0.1 - points["B"][0]
    said = refusal(points, links, ["O"], {"x": {"law": "constant_speed", "speed": f"{way} m/s"}}, sliders=sliders)
    assert "the position is singular at t = " in said
    assert "x do not move independently there" in said
