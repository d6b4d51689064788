"""Pictures of sweeps show the numbers of the table, the right way round."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

import pinarm
from pinarm.use.study.sweep.table import ranges

LONG = {"arguments.m": "1:3:9 kg", "arguments.l": "0.2:1:7 m"}


def ink(path: Path) -> float:
    """Return the share of a picture that is not white."""
    return float((imread(path)[:, :, :3].min(axis=2) < 0.95).mean())


@pytest.mark.slow
def test_two_long_axes_make_a_map(held: pinarm.Scenario, tmp_path: Path) -> None:
    sweep = pinarm.sweep(held, {**LONG, "arguments.m": "3:1:9 kg"}, results=["M @ end"])
    figure = sweep.plot()
    axis = figure.axes[0]
    (mesh,) = axis.collections[:1]
    m, l = np.linspace(1, 3, 9), np.linspace(0.2, 1, 7)
    np.testing.assert_allclose(mesh.get_array(), 10 * np.outer(l, m), rtol=1e-12)
    np.testing.assert_allclose(mesh.get_coordinates()[0, :, 0][[0, -1]], [0.875, 3.125])  # half a cell beyond the ends
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("m [kg]", "l [m]")
    assert figure.axes[1].get_ylabel() == "M @ end [N·m]"
    figure.savefig(tmp_path / "map.png")
    assert ink(tmp_path / "map.png") > 0.4


def test_what_failed_stays_empty_in_a_map(held: pinarm.Scenario) -> None:
    sweep = pinarm.sweep(held, {**LONG, "arguments.m": "-1:3:9 kg"}, results=["M @ end"])
    mesh = sweep.plot("M @ end").axes[0].collections[0]
    assert np.ma.getmaskarray(mesh.get_array()).sum() == 2 * 7 == len(sweep.errors)


def test_a_short_axis_makes_a_family_of_curves(held: pinarm.Scenario) -> None:
    sweep = pinarm.sweep(held, {"arguments.l": "0.5, 1 m", "arguments.m": "1:3:9 kg"}, results=["M @ end"])
    axis = sweep.plot().axes[0]
    lines = axis.get_lines()
    m = np.linspace(1, 3, 9)
    for line, l in zip(lines, (0.5, 1), strict=True):
        np.testing.assert_allclose(line.get_xydata(), np.column_stack([m, 10 * m * l]), rtol=1e-12)
        assert line.get_label() == f"{l} m"
    assert axis.get_xlabel() == "m [kg]"


def test_results_have_the_units_and_labels_of_the_scenario(scenario: Callable[..., Any]) -> None:
    """A torque in kN*mm, which is the same number of N*m."""
    keys = 'units: {M: kN*mm}\nlabels: {M: "M_\\\\alpha"}\n'
    swept = pinarm.sweep(scenario("statics", keys), {"problem.over.pivot.to": "30, 60, 90 deg"}, results=["M"])
    name = next(series.name for series in swept.results())
    axis = swept.plot(name).axes[0]
    assert axis.get_ylabel() == r"min $M_\alpha$ [kN·mm]"
    assert axis.get_lines()[0].get_ydata() == pytest.approx(swept[name].values)  # 1 kN*mm is 1 N*m
    assert [row[:2] for row in ranges(swept)[1:]] == [["min M_α", "kN*mm"], ["max M_α", "kN*mm"]]
    assert swept.csv().startswith("case,problem.over.pivot.to [deg],min M [kN*mm],max M [kN*mm],")
