"""Slider-crank with an offset, a load on the piston and a crank that speeds up."""

import numpy as np
import pytest

from pinarm.engine.checks.residuals import residual_figures
from pinarm.engine.quantities.names import Quantities
from pinarm.errors import NumericsError
from pinarm.mechanics.forces.points import Wrench
from pinarm.mechanics.laws import ConstantSpeed, Harmonic
from pinarm.mechanics.laws.motion_law import Grid

from .energy_integral import EnergyIntegral
from .slider_crank_closed_form import SliderCrank

START = {"theta": 0.0, "A": 0.0, "x": 0.19}


def turning(name, parent, child, x):
    return f"""<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
      <origin xyz="{x} 0 0"/><axis xyz="0 0 1"/></joint>"""


@pytest.mark.parametrize("height", [0.0, 0.012])
def test_torque_side_force_and_pin_forces_are_those_of_newton_and_euler(solve, height):
    crank, factor = SliderCrank(e=height), Harmonic(mean=1.0, amplitude=0.8, pulsation=50.0)
    gas = Wrench(point="B", force=(-900.0, 0.0, 0.0), factor=factor)
    law = Harmonic(amplitude=8.0, pulsation=20.0)
    found = solve("slider_crank", "inverse", arguments={"e": height}, end=0.4, samples=301, motion={"theta": law},
                  drives=["theta"], start=START, loads={"gas": gas})  # fmt: skip
    t, theta, omega = found["t"].values, found["theta"].values, found["w"].values
    alpha, pressed = found["joint.theta.acceleration"].values, 900.0 * Grid.cover(t, [factor]).evaluate(factor)[0]
    positions, velocities, accelerations = crank.motion(theta, omega, alpha)
    for name, (psi, x) in zip(
        ("position", "velocity", "acceleration"), (positions, velocities, accelerations), strict=True
    ):
        assert found[f"coordinate.psi.{name}"].values == pytest.approx(psi, rel=1e-9, abs=1e-8)
        assert found[f"joint.x.{name}"].values == pytest.approx(x, rel=1e-9, abs=1e-8)
    forces = crank.forces(theta, omega, alpha, pressed)
    names = {
        "T": "C", "N": "N", "M": "joint.x.moment.z", "O.x": "joint.theta.force.x", "O.y": "joint.theta.force.y",
        "A.x": "joint.A.force.x", "A.y": "joint.A.force.y", "B.x": "loop.B.force.x", "B.y": "loop.B.force.y",
    }  # fmt: skip
    for symbol, name in names.items():
        assert found[name].values == pytest.approx(forces[symbol], rel=1e-9, abs=1e-7)  # of forces of 1e4 N


def test_free_slider_crank_follows_its_energy_integral(solve):
    crank = SliderCrank()
    turning = EnergyIntegral(crank.inertia, lambda theta: 0 * theta, 0.0, 30.0, 100.0)
    initial = {"position": {"theta": 0.0}, "velocity": {"theta": 30.0}}
    found = solve("slider_crank", "forward", end=2.0, start=START, initial=initial)
    assert found["theta"].values == pytest.approx(turning.at(found["t"].values), abs=1e-9)
    assert np.ptp(found["w"].values) > 1.0


TURNING = {"motion": {"theta": ConstantSpeed(speed=6.0, start=0.1)}, "drives": ["theta"],
           "start": {"theta": 0.1, "A": -0.2, "x": 0.2}}  # fmt: skip


@pytest.mark.parametrize("longer", [1e-5, 1e-9])
@pytest.mark.parametrize("samples", [61, 301])
def test_a_rod_hardly_longer_than_the_crank_keeps_its_side(solve, longer, samples):
    """At a quarter turn the piston all but stops at the crank's bearing; the other branch goes on through it."""
    crank = SliderCrank(r=0.1, L=0.1 * (1.0 + longer))
    found = solve("slider_crank", "inverse", arguments={"r": crank.r, "L": crank.L}, samples=samples, **TURNING)
    theta = found["theta"].values
    assert theta[-1] > 1.5 * np.pi
    (_, x), _, _ = crank.motion(theta, 6.0)
    assert found["x"].values == pytest.approx(x, abs=1e-9)


@pytest.mark.parametrize("samples", [60, 75])
def test_a_rod_as_long_as_the_crank_goes_on_through_the_singular_position(solve, samples):
    found = solve("slider_crank", "inverse", arguments={"r": 0.1, "L": 0.1}, samples=samples, **TURNING)
    assert found["x"].values == pytest.approx(0.2 * np.cos(found["theta"].values), abs=1e-11)


@pytest.mark.parametrize("tolerance", [1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("speed", [1.0, 6.0])
def test_with_a_rod_without_mass_it_goes_through_or_says_that_it_does_not(outcome, tolerance, speed):
    light = {"r": 0.1, "L": 0.1, "m3": 0.0, "I3": 0.0}
    start = {"position": {"theta": 0.1}, "velocity": {"theta": speed}}
    try:
        solved = outcome("slider_crank", "forward", arguments=light, end=3.0 / speed, samples=13, initial=start,
                      start=TURNING["start"], tolerance=tolerance)  # fmt: skip
    except NumericsError as error:
        assert "singular" in str(error)
    else:
        if not any(note.startswith("energy: ") for note in solved.notes):
            found = Quantities(solved.rows)
            assert found["x"].values == pytest.approx(0.2 * np.cos(found["theta"].values), abs=1e-6)


@pytest.mark.parametrize("kind", ["inverse", "forward"])
def test_the_nearest_singular_position_is_found_between_the_rows(outcome, kind):
    """Of all positions the one at a quarter turn is the nearest, by the square root of what the rod is longer."""
    start = {"position": {"theta": 0.1}, "velocity": {"theta": 6.0}}
    asked = TURNING if kind == "inverse" else {"initial": start, "start": TURNING["start"]}
    close = []
    for longer in (1e-6, 1e-7):
        solved = outcome(
            "slider_crank", kind, arguments={"r": 0.1, "L": 0.1 * (1.0 + longer)}, end=0.6, samples=13, **asked
        )
        figures, found = residual_figures(solved.rows, solved.motion), Quantities(solved.rows)
        close.append(figures["regularity"])
        place = np.interp(figures["least regular at"], found["t"].values, found["theta"].values)
        assert place == pytest.approx(np.pi / 2, abs=0.03)  # rows are 0.3 rad apart, and not evenly
    assert close[0] / close[1] == pytest.approx(10.0**0.5, rel=1e-2)


def test_a_slide_that_closes_the_loop_is_the_slide_of_the_tree(solve, mechanism):
    crank = SliderCrank(e=0.012)
    xml = f"""<robot name="slider_crank"><link name="base"/>
      <link name="crank"><inertial><mass value="1"/>
        <inertia ixx="{crank.I2 / 2}" iyy="{crank.I2 / 2}" izz="{crank.I2}" ixy="0" ixz="0" iyz="0"/></inertial></link>
      {turning("theta", "base", "crank", 0)}{turning("A", "crank", "rod", crank.r)}
      {turning("B", "rod", "piston", crank.L)}
      <link name="rod"><inertial><origin xyz="{crank.l_G} 0 0"/><mass value="{crank.m3}"/>
        <inertia ixx="0" iyy="{crank.I3}" izz="{crank.I3}" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="piston"><inertial><mass value="{crank.m4}"/>
        <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="line"/>
      <joint name="line_fixed" type="fixed"><parent link="base"/><child link="line"/><origin xyz="0 0.012 0"/></joint>
      </robot>"""
    slide = {"kind": "prismatic", "between": ["line", "piston"], "axis": "x"}
    engine = mechanism(xml, gravity="none", loops={"slide": slide})
    law = Harmonic(amplitude=8.0, pulsation=20.0)
    found = solve(
        engine, "inverse", end=0.4, motion={"theta": law}, drives=["theta"], start={"theta": 0, "A": 0, "B": 0}
    )
    theta, omega, alpha = (found[f"joint.theta.{rate}"].values for rate in ("position", "velocity", "acceleration"))
    forces = crank.forces(theta, omega, alpha)
    assert found["joint.theta.effort"].values == pytest.approx(forces["T"], rel=1e-9, abs=1e-8)
    assert found["loop.slide.force.y"].values == pytest.approx(forces["N"], rel=1e-9, abs=1e-8)
    assert found["loop.slide.moment.z"].values == pytest.approx(forces["M"], abs=1e-8)
    assert found["joint.B.force.x"].values == pytest.approx(forces["B.x"], rel=1e-9, abs=1e-7)
