"""Joints that hold more than once, in files that are rounded: what moves is what an exact file moves.

The same shaft in one bearing, and the same linkage before its file was rounded, tell what is right.
"""

import re

import numpy as np
import pinocchio as pin
import pytest
from catalogue import ABOUT_Y, five_bar, four_bar, parallelogram
from linkage import GROUND, Body, Joint, Linkage
from motions import anywhere, driven, free

from pinarm.engine.checks.residuals import residual_figures, unclosed
from pinarm.engine.constraints.self_stresses import mobility_of
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import AssemblyError, InputError
from pinarm.mechanics.laws import ConstantSpeed, Harmonic
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.equilibria import Equilibria
from pinarm.problems.inverse import KinematicMotion, Range, State, Statics
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

ASKEW = pin.rpy.rpyToMatrix(0.3, 0.5, 0.7)
GRID = TimeGrid(end=0.8, samples=9)
SPEED = {"left": ConstantSpeed(speed=3.0)}
SWEPT = {"left": Range(start=0.0, end=3.0, samples=7)}
KINDS = {
    "statics": lambda shaft: Statics(over=SWEPT).solve(shaft, Accuracy(), anywhere).rows,
    "state": lambda shaft: State(over=SWEPT, velocity={"left": 3.0}, acceleration={"left": 2.0}).solve(
        shaft, Accuracy(), anywhere).rows,
    "kinematics": lambda shaft: KinematicMotion(time=GRID, motion=SPEED).solve(shaft, Accuracy(), anywhere).rows,
    "inverse": lambda shaft: driven(shaft, SPEED),
    "forward": lambda shaft: free(shaft, 0.8, 9, velocity={"left": 5.0}),
    "equilibria": lambda shaft: Equilibria(starts=[{"left": 1.0}, {"left": 4.0}]).solve(
        shaft, Accuracy(), anywhere).rows,
}  # fmt: skip


def bearings(*names: str) -> Linkage:
    """A shaft with its mass aside of its axis, in hinges that are in line."""
    body = Body(3.0, np.array([0.02, 0.3, 0.01]), np.diag([0.2, 0.01, 0.2]))
    at = {"left": 0.0, "right": 0.7}
    joints = {name: Joint("revolute", GROUND, "shaft", np.array([0.1, at[name], 0.3]), ABOUT_Y) for name in names}
    return Linkage({"shaft": body}, joints)


def rounded(linkage: Linkage, folder, cut, size: float, seed: int = 0) -> Mechanism:
    """The linkage with every place of its file off by up to ``size`` metres and every axis by up to as many radians."""
    linkage.build(folder, cut)
    model, generator = folder / "model.urdf", np.random.default_rng(seed)

    def moved(match: re.Match[str]) -> str:
        given = [np.array((words or "0 0 0").split(), float) for words in match.groups()]
        xyz, rpy = (" ".join(map(repr, (one + size * generator.uniform(-1.0, 1.0, 3)).tolist())) for one in given)
        return f'<origin xyz="{xyz}" rpy="{rpy}"/>'

    place = r'<origin xyz="([^"]*)"(?: rpy="([^"]*)")?/>(?=<axis|</joint>)'
    text, places = re.subn(place, moved, model.read_text())
    assert places > len(linkage.joints)
    model.write_text(text)
    return Mechanism.load(folder / "mechanism.yaml")


@pytest.fixture
def shafts(tmp_path_factory):
    """In one bearing, in two, and in two of a file that is rounded."""
    one, two = bearings("left").turned(ASKEW), bearings("left", "right").turned(ASKEW)
    folders = [tmp_path_factory.mktemp(name) for name in ("one", "two", "rounded")]
    return one.build(folders[0]), two.build(folders[1], ["right"]), rounded(two, folders[2], ["right"], 1e-11)


class TestShaftInTwoBearings:
    @pytest.mark.parametrize("kind", KINDS)
    def test_it_moves_like_one_in_one_bearing(self, kind, shafts):
        one, two, off = map(KINDS[kind], shafts)
        for found, tolerance in ((two, 1e-12), (off, 1e-9)):  # the file is off by 1e-11, and 30 N pull
            for part in ("q", "v", "a", "tau"):
                assert getattr(found, part) == pytest.approx(getattr(one, part), rel=tolerance, abs=tolerance)

    def test_what_they_share_is_refused_with_their_names_and_what_to_loosen(self, tmp_path):
        run = driven(bearings("left", "right").build(tmp_path, ["right"]), SPEED)
        for name in ("joint.left.force.x", "joint.left.moment.z", "loop.right.force.y"):
            with pytest.raises(InputError, match=r"degree 5.*right, left carry together") as error:
                Quantities(run)[name]
            assert "looser joints: right as point_on_plane: degree 1" in str(error.value)
        assert Quantities(run)["loop.right.moment.y"].values == pytest.approx(0.0, abs=1e-12)  # about the axis

    def test_loosened_as_advised_it_is_isostatic(self, tmp_path):
        joints = bearings("left", "right").joints
        kinds = {"left": "spherical", "right": "point_on_line"}
        linkage = Linkage(bearings("left").bodies, {name: Joint(kinds[name], GROUND, "shaft", one.place, one.turn)
                                                    for name, one in joints.items()})  # fmt: skip
        found = mobility_of(mechanism := linkage.build(tmp_path, ["right"]), np.zeros(mechanism.model.nq))
        assert (found.mobility, found.degree) == (1, 0)

    @pytest.mark.parametrize("kind", ["statics", "inverse", "forward"])
    def test_out_of_line_it_is_refused_with_the_gap(self, kind, tmp_path):
        shaft = rounded(bearings("left", "right"), tmp_path, ["right"], 1e-3)
        with pytest.raises(AssemblyError, match=r"right stays open by 0\.00\d+ (m|rad)") as error:
            KINDS[kind](shaft)
        assert "1e-09 of the extent" in str(error.value)


LINKAGES = {
    "four-bar": (four_bar(), ["B"], ["O"]),
    "five-bar": (five_bar(), ["M"], ["O", "C"]),
    "parallelogram": (parallelogram(), ["b", "d"], ["foot_0"]),
}


@pytest.mark.parametrize("name", LINKAGES)
def test_plane_loops_of_a_rounded_file_move_as_those_of_an_exact_one(name, tmp_path, size=1e-10):
    linkage, cut, motors = LINKAGES[name]
    linkage = linkage.turned(ASKEW)
    motion = {motor: Harmonic(amplitude=0.3, pulsation=4.0) for motor in motors}
    exact = linkage.build(tmp_path, cut)
    right = driven(exact, motion, drives=motors), free(exact, 0.1, 3, velocity={motors[0]: 3.0})
    regularity = min(residual_figures(run)["regularity"] for run in right)
    mechanism = rounded(linkage, tmp_path, cut, size)
    found = driven(mechanism, motion, drives=motors), free(mechanism, 0.1, 3, velocity={motors[0]: 3.0})
    for one, other in zip(found, right, strict=True):
        # lengths that are off by the size, over the regularity, and accelerations of 100; 1e-9 for integration
        off = 1e2 * size / regularity + 1e-9
        assert one.q == pytest.approx(other.q, abs=off)
        assert one.v == pytest.approx(other.v, abs=10 * off)
        assert one.tau == pytest.approx(other.tau, abs=1e3 * off)
        least = np.linalg.norm(other.lam, axis=1).max()
        assert np.linalg.norm(one.lam, axis=1).max() <= 1.001 * least + 1e3 * off
        assert mobility_of(mechanism, one.q[0]).rank == mobility_of(exact, other.q[0]).rank
        assert unclosed(one)
        assert not unclosed(other)
