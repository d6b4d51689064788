"""Olive-tree vibrator: the exact law of motion of one loop in space, and the force in its ball joint."""

import numpy as np
import pytest

from pinarm.mechanics.laws import ConstantSpeed

from .vibrator_closed_form import Vibrator


@pytest.mark.parametrize(("e", "speed", "end"), [
    (0.06, 157.0, 0.5), pytest.param(0.6, 50.7, 1.0, marks=pytest.mark.slow),
    pytest.param(0.06, 250.0, 0.3, marks=pytest.mark.slow),
])  # fmt: skip
def test_trunk_moves_and_pulls_as_the_exact_law_says(solve, e, speed, end):
    machine = Vibrator(e=e, Omega=speed)
    found = solve("olive_vibrator", "forward", arguments={"e": e}, end=end, tolerance=1e-13,
                  motion={"phi": ConstantSpeed(speed=speed)}, start={"theta": -0.27, "X": 3.95},
                  initial={"position": {"beta": 0.02}, "velocity": {"beta": -0.1}})  # fmt: skip
    t = found["t"].values
    beta, bed, bedd = machine.motion(t, 0.02, -0.1)
    assert found["beta"].values == pytest.approx(beta, abs=1e-10)
    assert found["bed"].values == pytest.approx(bed, abs=1e-8)
    assert found["bedd"].values == pytest.approx(bedd, rel=1e-8, abs=1e-6)
    for name, place in zip(("Y", "theta", "X"), machine.closure(beta), strict=True):
        assert found[name].values == pytest.approx(place, abs=1e-10)
    forces = np.transpose([machine.loop_force(*row) for row in zip(t, beta, bed, bedd, strict=True)])
    for name, force in zip(("X53", "Y53", "Z53"), forces, strict=True):
        assert found[name].values == pytest.approx(force, rel=1e-7, abs=1e-7 * np.abs(forces).max())
