"""Statics of drives at loop joints with friction there: bands of efforts against closed forms."""

from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.problems.accuracy import Accuracy
from pinarm.problems.equilibria import Equilibria
from pinarm.problems.inverse import Range, Statics

G, MASS, LENGTH = 9.81, 0.7, 0.83


def place(*path):
    return nullcontext()


def solve(mechanism, **given):
    return Statics(**given).solve(mechanism, Accuracy(), place)


def band(found):
    return [found.rows.columns[f"coordinate.pin.angle.effort.{side}"].values for side in ("lower", "upper")]


@pytest.fixture
def hung(mechanism, chain):
    """Return a pendulum that moves freely in its plane, but for a loop joint ``pin`` at its top."""
    slides = [{"name": name, "kind": "prismatic", "axis": axis, "mass": 1e-9, "inertia": (1e-9, 1e-9, 1e-9)}
              for name, axis in (("x", "1 0 0"), ("z", "0 0 1"))]  # fmt: skip
    bob = {"name": "bob", "axis": "0 1 0", "mass": MASS, "com": f"0 0 {-LENGTH}"}

    def build(**friction):
        loops = {"pin": {"kind": "revolute", "axis": "y", "between": ["base", "bob_link"]}}
        return mechanism(chain(*slides, bob), loops=loops, friction=friction)

    return build


def test_a_drive_at_a_loop_joint_holds_a_band(hung):
    """``m g l sin theta +- mu_s r m g``: the pin carries the weight, that of the slides (1e-9 kg) neglected."""
    pendulum = hung(pin={"mu": 0.2, "static_mu": 0.3, "radius": "50 mm"})
    found = solve(pendulum, over={"pin.angle": Range(start=0.01, end=1.01, samples=3)}, drives=["pin.angle"])
    weight = MASS * G * (LENGTH * np.sin([0.01, 0.51, 1.01]) + np.array([[-1.0], [1.0]]) * 0.3 * 0.05)
    assert band(found) == pytest.approx(weight, rel=1e-7)
    assert found.notes[0].startswith("coordinate.pin.angle.effort: friction holds any value from")
    assert found.notes[1].startswith("coordinate.pin.angle is self-locking in 1 of 3 rows")


def test_friction_at_a_loop_joint_alone_holds_a_band_of_positions(hung):
    found = Equilibria(starts=[{"bob": 0.1}]).solve(hung(pin={"mu": 0.3, "radius": "50 mm"}), Accuracy(), place)
    ends = [found.rows.columns[f"equilibrium.end_{k}.bob"].values[0] for k in (1, 2)]
    half = np.arcsin(0.3 * 0.05 / LENGTH)
    assert sorted(ends) == pytest.approx([-half, half], rel=1e-7)


def test_friction_beside_the_drive_is_in_its_band(rubbing_parallelogram):
    """A parallelogram driven at the pin that closes it: every joint turns with it, ``W l sin theta +- 4 M``."""
    linkage = rubbing_parallelogram
    found = solve(linkage, hold={"pin.angle": 0.5}, drives=["pin.angle"], start={"crank": 0.5, "coupler": -0.5})
    crank_at = found.rows.q[0, linkage.joints["crank"].q]
    assert crank_at == pytest.approx(0.5, rel=1e-12)
    middle = 3.0 * G * LENGTH * np.sin(0.5)
    assert [side[0] for side in band(found)] == pytest.approx([middle - 2.8, middle + 2.8], rel=1e-12)
