"""Andrews' squeezing mechanism: motion and loop forces against its equations written anew."""

import numpy as np
import pytest

from . import andrews_equations as andrews

T = np.linspace(0.0, 0.03, 31)


@pytest.fixture(scope="module")
def motion():
    return andrews.motion(T)


@pytest.mark.parametrize(("tolerance", "reached"), [
    (1e-10, 1e-7), pytest.param(1e-12, 1e-9, marks=pytest.mark.slow),
])  # fmt: skip
def test_it_reaches_the_reference(solve, motion, tolerance, reached):
    initial = {"position": dict(zip(andrews.NAMES, andrews.START, strict=True))}
    found = solve("andrews", "forward", end=0.03, samples=31, tolerance=tolerance, initial=initial)
    for index, name in enumerate(andrews.NAMES):
        assert found[name].values == pytest.approx(motion[0][:, index], abs=reached)


def test_loop_forces_are_the_multipliers_of_its_equations(solve, motion):
    initial = {"position": dict(zip(andrews.NAMES, andrews.START, strict=True))}
    found = solve("andrews", "forward", end=0.03, samples=31, initial=initial)
    forces = np.array([andrews.acceleration(*row)[1] for row in zip(*motion, strict=True)])
    for index, loop in enumerate(("K3", "K4", "K6")):
        given = found[f"loop.{loop}.force.x"].values + 1j * found[f"loop.{loop}.force.y"].values
        assert given == pytest.approx(-forces[:, index], abs=1e-6 * abs(forces).max())
