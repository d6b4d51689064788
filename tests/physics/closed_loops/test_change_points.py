"""Four-bars pass positions with all bars in line, whatever kind of joint closes their loop: against closed forms."""

import shutil
from contextlib import nullcontext

import numpy as np
import pytest

from pinarm.engine.quantities.names import Quantities
from pinarm.problems.accuracy import Accuracy
from pinarm.problems.forward import Forward, InitialState
from pinarm.problems.time_grid import TimeGrid
from pinarm.use.mechanism import Mechanism

from .conftest import MODELS
from .energy_integral import EnergyIntegral
from .four_bar_closed_form import ChangePoint

UNEQUAL = ChangePoint(0.15, 0.35, 0.20, 0.40, 1.5, 3.5, 2.0)

LOOPS = {
    "revolute": "kind: revolute, axis: z",
    "pin": "kind: pin, axis: z",
    "spherical": "kind: spherical",
    "cylindrical": "kind: cylindrical, axis: z",
    "point_on_line": "kind: point_on_line, axis: z",
    "universal": "kind: universal, axes: [z, y]",
    "two planes": None,
}


def closed_by(model, loop, kind, tmp_path):
    """Return a shipped four-bar whose loop is closed by another kind of joint."""
    lines = (MODELS / model / "mechanism.yaml").read_text().splitlines()
    (place,) = (k for k, line in enumerate(lines) if line.strip().startswith(f"{loop}: {{"))
    between = lines[place].split("between:")[1].split("]")[0] + "]"
    if kind == "two planes":
        lines[place : place + 1] = [
            f"  {loop}{axis}: {{kind: point_on_plane, axis: {axis}, between: {between}}}" for axis in "xy"
        ]
    else:
        lines[place] = f"  {loop}: {{{LOOPS[kind]}, between: {between}}}"
    shutil.copytree(MODELS / model, tmp_path / model)
    shutil.copytree(MODELS / "crank_rocker", tmp_path / "crank_rocker")
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / model / "mechanism.yaml").write_text("\n".join(lines))
    return Mechanism.load(tmp_path / model / "mechanism.yaml")


def moved(mechanism, end, tolerance, start, position, velocity):
    """Return the quantities of a free motion."""
    problem = Forward(
        time=TimeGrid(end=end, samples=31), start=start, initial=InitialState(position=position, velocity=velocity)
    )
    return Quantities(problem.solve(mechanism, Accuracy(tolerance=tolerance), lambda *path: nullcontext()).rows)


@pytest.mark.parametrize("kind", LOOPS)
def test_unequal_bars_pass_their_change_point_as_the_energy_says(kind, tmp_path):
    mechanism = closed_by("change_point_four_bar", "B", kind, tmp_path)
    found = moved(mechanism, 0.9, 1e-8, {"A": 0.8, "theta4": 1.8}, {"theta2": 0.0}, {"theta2": 12.0})
    turning = EnergyIntegral(UNEQUAL.inertia, UNEQUAL.potential, 0.0, 12.0, 4.2 * 12.0)
    theta2 = found["theta2"].values
    assert theta2[-1] > 3.0 * np.pi
    _, theta4, *_ = UNEQUAL.slopes(theta2)
    assert np.exp(1j * found["theta4"].values) == pytest.approx(np.exp(1j * theta4), abs=1e-8)
    assert theta2 == pytest.approx(turning.at(found["t"].values), abs=1e-5)
