"""Bands of positions that friction holds, against closed forms."""

import math
from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.errors import AssemblyError
from pinarm.mechanics.forces.along_coordinate import JointSpring
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.equilibria import Equilibria
from pinarm.problems.inverse import Statics

G, MASS, LENGTH = 9.81, 0.7, 0.83
BOB = {"name": "bob", "axis": "0 1 0", "mass": MASS, "com": f"0 0 {-LENGTH}", "inertia": (0.0, 0.0, 0.0)}


def place(*path):
    return nullcontext()


def outcome(mechanism, starts, **given):
    return Equilibria(starts=starts, **given).solve(mechanism, Accuracy(), place)


def ends(found, joint, row=0):
    return [found.rows.columns[f"equilibrium.end_{k}.{joint}"].values[row] for k in (1, 2)]


def test_a_pendulum_is_held_about_the_bottom_and_about_the_top(mechanism, chain):
    """``m g l |sin theta| <= M_f``."""
    pendulum = mechanism(chain(BOB), friction={"bob": {"constant": "2 N*m", "static_constant": "2.5 N*m"}})
    found = outcome(pendulum, [{"bob": 0.3}, {"bob": 3.0}])
    half = math.asin(2.5 / (MASS * G * LENGTH))
    assert ends(found, "bob") == pytest.approx([-half, half], rel=1e-13)
    assert ends(found, "bob", 1) == pytest.approx([math.pi - half, math.pi + half], rel=1e-13)
    assert "holds the positions between equilibrium.end_1 and equilibrium.end_2" in found.notes[0]


def test_a_pendulum_in_a_journal_is_held_within_the_friction_circle(mechanism, chain):
    """The weight's line passes within ``mu r`` of the axis: ``l |sin theta| <= mu r``, whatever the mass."""
    pendulum = mechanism(chain(BOB), friction={"bob": {"mu": 0.2, "static_mu": 0.3, "radius": "50 mm"}})
    half = math.asin(0.3 * 0.05 / LENGTH)
    assert ends(outcome(pendulum, [{"bob": 0.1}]), "bob") == pytest.approx([-half, half], rel=1e-12)


def test_a_mass_on_a_spring_and_a_rough_plane(mechanism, chain):
    """``|x - x0| <= mu m g / k``."""
    slide = {"name": "slide", "kind": "prismatic", "axis": "1 0 0", "mass": 2.0}
    block = mechanism(chain(slide), friction={"slide": {"mu": 0.3, "static_mu": 0.4}})
    spring = JointSpring(joint="slide", stiffness=50.0, rest=0.25)
    found = outcome(block, [{"slide": 3.0}], loads={"spring": spring})
    half = 0.4 * 2.0 * G / 50.0
    assert ends(found, "slide") == pytest.approx([0.25 - half, 0.25 + half], rel=1e-13)


@pytest.mark.parametrize(("slope", "holds"), [pytest.param(21.7, True, marks=pytest.mark.slow), (21.9, False)])
def test_a_block_on_an_incline_stays_where_it_is_or_nowhere(mechanism, chain, slope, holds):
    """``tan(slope) <= mu``, at every position: 0.4 is the tangent of 21.80 deg."""
    angle = math.radians(slope)
    slide = {"name": "slide", "kind": "prismatic", "axis": f"{math.cos(angle)} 0 {math.sin(angle)}", "mass": 2.0}
    block = mechanism(chain(slide), friction={"slide": {"mu": 0.4}})
    if not holds:
        with pytest.raises(AssemblyError, match="leads to no equilibrium"):
            outcome(block, [{"slide": 0.5}])
        return
    found = outcome(block, [{"slide": 0.5}])
    assert found.rows.q[0, 0] == 0.5
    assert np.isnan(ends(found, "slide")).all()
    assert np.isnan(found.rows.columns["equilibrium.stability"].values[0])
    assert found.figures["stable"] == 0.0
    assert "row 1: the start, which friction holds as it is, leads to no position that needs no friction" in found.notes
    assert found.notes[-1].endswith("has no end: friction holds every position as far as it was followed")


@pytest.mark.slow
def test_friction_may_hold_every_position_of_a_turn(mechanism, chain):
    pendulum = mechanism(chain(BOB), friction={"bob": {"constant": f"{1.01 * MASS * G * LENGTH!r} N*m"}})
    found = outcome(pendulum, [{"bob": 0.3}])
    assert np.isnan(ends(found, "bob")).all()
    assert found.notes[-1].endswith("friction holds every position of a full turn")


def test_a_parallelogram_rubs_in_its_four_joints(rubbing_parallelogram):
    """The coupler does not turn, so every joint turns as the crank does: ``W l |sin theta| <= 4 M_f``."""
    found = outcome(rubbing_parallelogram, [{"crank": 0.2, "coupler": -0.2, "rocker": 0.2}])
    half = math.asin(4.0 * 0.7 / (3.0 * G * LENGTH))
    assert sorted(ends(found, "crank")) == pytest.approx([-half, half], rel=1e-12)
    assert np.array(ends(found, "coupler")) == pytest.approx(-np.array(ends(found, "crank")), rel=1e-11)


def test_an_arm_whose_shoulder_is_held(mechanism, chain):
    """Of the second of two arms the weight's lever is ``l cos(a + b)``; the table's ends of the first are its value."""
    bodies = [{"name": name, "axis": "0 -1 0", "com": "0.5 0 0"} for name in "ab"]
    friction = {"a": {"constant": "2 N*m"}, "b": {"constant": "1 N*m"}}
    arms = mechanism(chain(*bodies), friction=friction)
    found = outcome(arms, [{"b": -1.5}], hold={"a": 0.3})
    half = math.asin(1.0 / (0.5 * G))
    middle = -math.pi / 2 - 0.3
    assert ends(found, "b") == pytest.approx([middle - half, middle + half], rel=1e-12)
    assert ends(found, "a") == pytest.approx([0.3, 0.3], rel=1e-13)
    assert "efforts that hold a are those without friction" in found.notes[1]
    inside = [Statics(hold={"a": 0.3, "b": middle + part * half}).solve(arms, Accuracy(), place).rows
              for part in (0.99, 1.01)]  # fmt: skip
    lower = [rows.columns["joint.b.effort.lower"].values[0] for rows in inside]
    assert lower[0] < 0.0 < lower[1]


def test_several_free_motions_have_no_band(mechanism, chain):
    bodies = [{"name": name, "axis": "0 -1 0", "com": "0.5 0 0"} for name in "ab"]
    found = outcome(mechanism(chain(*bodies), friction={"a": {"constant": "2 N*m"}}), [{"a": -1.5, "b": 0.1}])
    assert not [name for name in found.rows.columns if "end_" in name]
    assert "With 2 free motions they are no band" in found.notes[0]
