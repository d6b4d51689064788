"""Sets of loads: their balance by Newton and Euler, and single loads against closed forms."""

from math import cos, pi, sin

import numpy as np
import pytest

import pinarm

ROUNDING = 1e-12
"""Relative: sums of a few terms; what constraints leave open at rounding included."""
ISOSTATIC = {"changes": {"loops": {"B": {"kind": "point_on_line"}}}}
"""The piston's pin without the three forces and moments that the crank's axis holds already."""


def rows(scenario, values):
    section = pinarm.run(f"scenarios/{scenario}.yaml", values).sections["loads"]
    table = next((table for table in section.tables if table.name == "sets"), None)
    return ([] if table is None else table.rows), section


def balance(lines):
    """Return the sums of forces and of moments about the body's origin, of the rows of one body but its residual."""
    points, forces, moments = np.array([line[4:] for line in lines]).reshape(-1, 3, 3).swapaxes(0, 1)
    return forces.sum(axis=0), (moments + np.cross(points, forces)).sum(axis=0), np.abs(forces).sum()


@pytest.mark.parametrize(("scenario", "joint", "values"), [
    ("rotor_horizontal", "B", {}),
    ("machine_on_mounts_equilibria", "left", {}),
    ("planetary_gear_reducer", "sun", {}),
    pytest.param("crank_rocker_turning", "loop.B", {
        "undetermined": "minimum_norm", "changes": {"friction": {"B": {"mu": 0.1, "radius": "10 mm"}}},
    }, marks=pytest.mark.slow),
])  # fmt: skip
def test_every_body_is_in_balance(scenario, joint, values) -> None:
    lines, section = rows(scenario, values | {"loads": {"joints": {joint: {}}, "sets": ["force"]}})
    assert lines
    assert float(section.numbers["sets.residual"].values[0]) < 1e-9  # of the reactions: closure of loops to 1e-10
    for name, body in {(line[0], line[2]) for line in lines}:
        own = [line for line in lines if (line[0], line[2]) == (name, body)]
        *acting, residual = own
        assert residual[3] == "residual"
        forces, moments, size = balance(acting)
        assert forces == pytest.approx(residual[7:10], abs=ROUNDING * max(size, 1.0))
        assert moments == pytest.approx(residual[10:], abs=ROUNDING * max(size, 1.0))
        assert np.abs([forces, moments]).max() <= 1e-8 * max(size, 1.0)


def test_loads_of_a_rotor_are_those_of_its_closed_form() -> None:
    """Weight, and inertia relief m e omega² outwards with the moments of the products of inertia, in its axes."""
    lines, _ = rows("rotor_vertical", {"loads": {"joints": {"phi": {}}, "sets": ["radial"]}})
    of = {line[3]: line[4:] for line in lines if line[2] == "rotor"}
    w2 = (100 * pi) ** 2
    assert of["weight"] == pytest.approx([0.5e-3, 0, 0, 0, 0, -12 * 9.81, 0, 0, 0], abs=1e-10)
    # I_xz = -2e-4, I_yz = 1e-4 at O, the same at the centre of mass, which is in the plane z = 0
    relief = [0.5e-3, 0, 0, 12 * 0.5e-3 * w2, 0, 0, 1e-4 * w2, 2e-4 * w2, 0]
    assert of["inertia relief"] == pytest.approx(relief, abs=1e-8)
    assert of["loop B"] == pytest.approx([0, 0, 0.2, -345.5833, 24.6740, 0, 0, 0, 0], abs=1e-4)


def test_the_pin_of_a_piston_carries_gas_and_inertia() -> None:
    """Along the line, -m xdd of the piston and the gas at its origin: what loop B puts on it is the rest."""
    values = ISOSTATIC | {"loads": {"joints": {"loop.B": {}}, "sets": ["radial"]}}
    lines, section = rows("slider_crank_gas", values)
    of = {line[3]: line[4:] for line in lines if line[2] == "piston"}
    t = lines[0][1]
    r, length, w, m4 = 0.045, 0.145, 100 * pi, 0.55
    theta = w * t
    psi = np.arcsin(-r * sin(theta) / length)
    rate = -r * w * cos(theta) / (length * np.cos(psi))
    xdd = -r * w**2 * (cos(theta) + sin(theta) * np.tan(psi)) - length * rate**2 / np.cos(psi)
    assert of["inertia relief"][3] == pytest.approx(-m4 * xdd, rel=1e-9)
    assert of["force gas"][3] + of["loop B"][3] == pytest.approx(m4 * xdd, rel=1e-9)
    assert of["force gas"][:3] == pytest.approx([0, 0, 0], abs=1e-14)
    peak = float(section.numbers["loop.B.radial.peak"].values[0])
    assert np.hypot(*of["loop B"][3:5]) == pytest.approx(peak, rel=1e-9)


def test_bodies_whose_loads_are_not_determined_are_left_out() -> None:
    lines, section = rows("slider_crank_gas", {"loads": {"joints": {"loop.B": {}}, "sets": ["radial"]}})
    assert not lines
    assert any("crank, rod, piston left out; hyperstatic of degree 3" in remark for remark in section.remarks)
