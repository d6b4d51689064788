"""Coordinates of loop joints, and what acts along them: as of the same joint in the tree, the linkage cut elsewhere."""

import numpy as np
import pytest
from catalogue import four_bar, rssr, screw_jack, slider_crank
from motions import driven, freely, states, wrench

from pinarm.engine.quantities.names import Quantities
from pinarm.errors import InputError, UnitError
from pinarm.mechanics.laws import Harmonic

LINKAGES = {
    "four-bar": four_bar(), "mixed": four_bar(("revolute", "spherical", "cylindrical", "revolute")), "rssr": rssr(),
    "slider-crank": slider_crank(), "screw jack": screw_jack(),
}  # fmt: skip
CASES = {
    "crank": ("four-bar", "O", "A", "angle", "O"), "coupler": ("four-bar", "A", "C", "angle", "A"),
    "rocker": ("four-bar", "C", "A", "angle", "C"), "turning sleeve": ("mixed", "B", "A", "angle", "B_a"),
    "sliding sleeve": ("mixed", "B", "A", "position", "B_b"), "spatial rocker": ("rssr", "C", "A", "angle", "C"),
    "slider": ("slider-crank", "C", "A", "position", "C"), "nut": ("screw jack", "S", "A", "angle", "S_b"),
    "nut's way": ("screw jack", "S", "A", "position", "S_a"),
}  # fmt: skip
"""Linkage, joint, another one that is cut in its place, coordinate, and its name in the tree."""
TOLERANCE = 1e-10
"""Of integrations whose ends are compared to 1e-6: some hundred steps, errors that grow on the way."""
PLAIN = [name for name, (*_, joint) in CASES.items() if "_" not in joint]
SAME_KIND = ("coupler", "rocker", "spatial rocker")
"""Revolute joints as the crank is one."""
each = pytest.mark.parametrize(
    "case", [pytest.param(case, marks=pytest.mark.slow if case in SAME_KIND else ()) for case in CASES]
)


def pair(case, folder, *, tree=(), loop=()):
    """The mechanism with the joint in the tree, and with the joint as a loop joint; what is written beside each."""
    name, cut, other, *_ = CASES[case]
    linkage = LINKAGES[name]
    return linkage, linkage.build(folder, [other], **dict(tree)), linkage.build(folder, [cut], **dict(loop))


@each
class TestTheSameJoint:
    def test_it_has_moved_as_far(self, case, tmp_path):
        """Also over several turns of the crank."""
        _, tree, loop = pair(case, tmp_path)
        *_, cut, _, part, joint = CASES[case]
        crank = {"O": 12.0 if case != "spatial rocker" else 2.0}
        given = {} if case == "crank" else {"velocity": crank}  # where O is cut no initial velocity can be given at it
        end = 0.15 if "nut" in case else 0.6
        right, found = (Quantities(freely(one, end, 7, tolerance=TOLERANCE, **given).rows) for one in (tree, loop))
        assert found[f"loop.{cut}.{part}"].values == pytest.approx(right[f"joint.{joint}.position"].values, abs=1e-6)
        for rate in ("position", "velocity", "acceleration"):
            along = found[f"coordinate.{cut}.{part}.{rate}"]
            expected = right[f"joint.{joint}.{rate}"]
            size = np.abs(expected.values).max()
            assert along.values == pytest.approx(expected.values, rel=1e-6, abs=1e-6 * (1.0 + size)), rate
            assert along.unit == expected.unit

    def test_a_spring_a_damper_and_an_effort_over_time_do_the_same(self, case, tmp_path):
        *_, cut, _, part, joint = CASES[case]
        way = "m" if part == "position" else "rad"
        effort = "N" if way == "m" else "N*m"
        keys = {"stiffness": f"40 {effort}/{way}", "damping": f"0.5 {effort}*s/{way}", "rest": f"0.1 {way}"}
        push = {"effort": {"law": "harmonic", "amplitude": f"0.3 {effort}", "pulsation": "7 rad/s"}}
        linkage, tree, loop = pair(
            case, tmp_path,
            tree={"forces": {"F": {"kind": "joint_spring", "joint": joint, **keys},
                             "E": {"kind": "joint_effort", "joint": joint, **push}}},
            loop={"forces": {"F": {"kind": "coordinate_spring", "coordinate": f"{cut}.{part}", **keys},
                             "E": {"kind": "coordinate_effort", "coordinate": f"{cut}.{part}", **push}}},
        )  # fmt: skip
        right, run = (freely(one, 0.15, 5, tolerance=TOLERANCE).rows for one in (tree, loop))
        assert states(linkage, run) == pytest.approx(states(linkage, right), rel=1e-6, abs=1e-6)
        expected, found = Quantities(right), Quantities(run)
        for name in ("energy.potential", "energy.total", "power.F", "power.E"):
            assert found[name].values == pytest.approx(expected[name].values, rel=1e-6, abs=1e-6), name
        if joint == cut:  # of several simple joints in the tree each has a frame of its own
            other = wrench(linkage, right, cut)
            for component, values in wrench(linkage, run, cut).items():
                if component in other:
                    assert values == pytest.approx(other[component], rel=1e-6, abs=1e-5), component


@pytest.mark.parametrize("case", PLAIN)
def test_a_drive_at_it_gives_the_same_effort(case, tmp_path):
    linkage, tree, loop = pair(case, tmp_path)
    *_, cut, _, part, joint = CASES[case]
    law = Harmonic(amplitude=0.02 if part == "position" else -0.05, pulsation=3.0)  # away from a dead point
    right, run = driven(tree, {joint: law}), driven(loop, {f"{cut}.{part}": law})
    expected, found = Quantities(right), Quantities(run)
    assert states(linkage, run) == pytest.approx(states(linkage, right), rel=1e-9, abs=1e-8)
    effort = expected[f"joint.{joint}.effort"].values
    assert found[f"coordinate.{cut}.{part}.effort"].values == pytest.approx(effort, rel=1e-9, abs=1e-9)
    other = wrench(linkage, right, cut)
    for component, values in wrench(linkage, run, cut).items():
        if component in other:
            assert values == pytest.approx(other[component], rel=1e-8, abs=1e-8), component


@pytest.mark.parametrize(
    ("force", "error", "message"),
    [
        ({"coordinate": "C.angel", "stiffness": "1 N*m/rad"}, InputError, "no coordinate 'C.angel'"),
        ({"coordinate": "C.angle", "stiffness": "1 N/m"}, UnitError, "N/m"),
    ],
)
def test_what_is_no_coordinate_or_no_such_unit_is_refused(tmp_path, force, error, message):
    with pytest.raises(error, match=message):
        LINKAGES["four-bar"].build(tmp_path, ["C"], forces={"F": {"kind": "coordinate_spring", **force}})
