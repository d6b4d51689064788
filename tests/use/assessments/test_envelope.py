"""Envelopes against the rows of the table and closed forms."""

from functools import cache
from math import pi
from typing import Any

import numpy as np
import pytest

import pinarm

SLIDER_CRANK = "scenarios/slider_crank_gas.yaml"


@cache
def envelope(path, *joints):
    result = pinarm.run(path, {"loads": {"joints": {name: {} for name in joints}, "sets": []}})
    section = result.sections["loads"]
    return result, {row[:2]: row[2:] for row in section.tables[1].rows}, section


def test_a_horizontal_rotor_presses_its_bearing_most_where_weight_and_unbalance_agree() -> None:
    """B is b e^(i phi) + i m g/2, largest where both parts have one direction."""
    _, rows, section = envelope("scenarios/rotor_horizontal.yaml", "B")
    b_x, b_y, weight = -3.5e-3 * (100 * pi) ** 2, 2.5e-4 * (100 * pi) ** 2, 12 * 9.81 / 2
    unit, least, least_at, most, most_at, _ = rows["B", "force.radial"]
    turned = np.hypot(b_x, b_y)
    assert (unit, least, most) == (
        "N",
        pytest.approx(turned - weight, rel=1e-9),
        pytest.approx(turned + weight, rel=1e-9),
    )
    where = (pi / 2 - np.arctan2(b_y, b_x)) % (2 * pi) / (100 * pi)
    assert most_at == pytest.approx(where, abs=1e-8)  # half of the digits of a place near a maximum
    assert least_at == pytest.approx((where + 10e-3) % 20e-3, abs=1e-8)
    along_x = rows["B", "force.along.B_shaft.x"]
    assert along_x[3:5] == (pytest.approx(b_x + weight, rel=1e-9), pytest.approx(5e-3, abs=1e-8))  # at phi = pi/2
    assert float(section.numbers["B.radial.peak"].values[0]) == pytest.approx(most, rel=1e-12)


def test_it_holds_the_rows_of_the_table_and_names_what_is_open() -> None:
    result, rows, section = envelope(SLIDER_CRANK, "A")
    for axis in "xy":
        values = result[f"joint.A.force.along.rod.{axis}"].values
        _, least, _, most, *_ = rows["A", f"force.along.rod.{axis}"]
        assert least <= values.min() + 1e-9
        assert values.min() - least < 1e-3 * np.ptp(values)  # between neighbouring rows, 721 of them
        assert most >= values.max() - 1e-9
    assert ("A", "force.along.rod.z") not in rows
    assert any(text.startswith("A: force.along.rod.z, moment.along.rod.x, moment") for text in section.remarks)
    assert "A.axial.peak" not in section.numbers


def test_the_direction_of_a_peak_and_the_polar_diagram_are_those_of_the_closed_form() -> None:
    """The load b e^(i phi) + i m g/2 is a circle about the weight, and points up where it is largest."""
    _, _, section = envelope("scenarios/rotor_horizontal.yaml", "B")
    turned, weight = np.hypot(3.5e-3, 2.5e-4) * (100 * pi) ** 2, 12 * 9.81 / 2
    peak = next(row for row in section.tables[0].rows if row[0] == "B.radial.peak")
    assert peak[4:6] == ("0 1 0", "B")
    circle, _ = section.graphs[0].curves
    assert np.hypot(circle.across.values, circle.up.values - weight) == pytest.approx(turned, rel=1e-9)
    assert "axes of B: x to the right, y up" in circle.label


def test_a_pin_has_its_load_in_the_axes_of_both_links() -> None:
    """Newton's law of the rod, rotated by hand into its axes and into those of the crank."""
    result, _, section = envelope(SLIDER_CRANK, "A")
    force = result["joint.A.force.x"].values + 1j * result["joint.A.force.y"].values
    for curve, angle in zip(section.graphs[0].curves[:2], ("psi", "theta"), strict=True):
        wanted = force * np.exp(-1j * result[angle].values)
        assert curve.across.values + 1j * curve.up.values == pytest.approx(wanted, rel=1e-9)


def short_lift(samples: int, **problem: Any) -> dict[str, Any]:
    """Return one turn of a cam in 1 s that raises 0.5 kg by 1 mm in 6 degrees from 192 on, and lowers it in as many."""
    lift = [{"duration": "192 deg", "motion": {"law": "constant", "value": "0 mm"}}]
    for first, last in (("0 mm", "1 mm"), ("1 mm", "0 mm")):
        rise = {"law": "cycloidal", "from": first, "to": last, "duration": "6 deg"}
        lift.append({"duration": "6 deg", "motion": rise})
    lift.append({"duration": "156 deg", "motion": {"law": "constant", "value": "0 mm"}})
    cam = {"kind": "cam", "joints": ["O", "lift"], "period": "360 deg", "roller": "R",
           "profile": {"law": "succession", "segments": lift}}  # fmt: skip
    links = {"shaft": {"points": ["O"], "mass": "1 kg", "inertia": "0.002 kg*m^2"},
             "follower": {"points": ["R", "T"], "mass": "0.5 kg"}}  # fmt: skip
    planar = {
        "points": {"O": [0, 0], "R": [0, "45 mm"], "T": [0, "140 mm"]}, "ground": ["O"], "links": links,
        "sliders": {"lift": {"link": "follower", "along": ["R", "T"]}},
    }  # fmt: skip
    return {
        "pinarm": 1, "outputs": ["lift"], "mechanism": {"pinarm": 1, "planar": planar, "couplings": {"C": cam}},
        "problem": {"kind": "inverse", "time": {"end": "1 s", "samples": samples}, "drives": ["O"],
                    "motion": {"O": {"law": "constant_speed", "speed": "60 rpm"}}, **problem},
    }  # fmt: skip


@pytest.mark.slow
def test_a_component_that_is_alike_at_all_rows_is_looked_at_between_them() -> None:
    """A knife edge of 0.5 kg above the shaft: ``F = 1.5 g + 0.5 a_max``, ``a_max = 2 pi h/T^2``, T = 1/60 s, h = 1 mm.

    Its force on the cam has ``tan(phi) = s'/s``, and across ``0.5 (g + a) tan(phi)``, which the guide holds and which
    is 0 while it rests: by numpy on a fine grid.
    """
    result = pinarm.run({**short_lift(11), "loads": {"joints": {"O": {"bearing": {"C": "5 kN"}}}, "sets": []}})
    u = np.linspace(0.0, 1.0, 300_001)
    slope = 1e-3 / np.radians(6.0) * (1.0 - np.cos(2.0 * pi * u))
    height = 0.045 + 1e-3 * (u - np.sin(2.0 * pi * u) / (2.0 * pi))
    carried = 0.5 * (9.81 + 2.0 * pi * 3.6 * np.sin(2.0 * pi * u))
    radial, across = np.hypot(9.81 + carried, carried * slope / height), carried * slope / height
    numbers = {name: float(one.values[0]) for name, one in result.sections["loads"].numbers.items()}
    assert numbers["O.radial.peak"] == pytest.approx(radial.max(), rel=1e-9)
    assert 0.0 < result.sections["loads"].errors["O.radial.peak"] < 1e-9 * radial.max()
    assert numbers["O.load.peak"] == numbers["O.radial.peak"] == result.number("joint.O.force.radial @ max")[0]
    rows = {row[1]: row for row in result.sections["loads"].tables[1].rows}
    assert rows["force.radial"][5] == pytest.approx(radial.max(), rel=1e-9)
    guide = pinarm.run({**short_lift(11), "loads": {"joints": {"lift": {}}, "sets": []}}).sections["loads"]
    assert guide.numbers["lift.force.peak"].values[0] == pytest.approx(across.max(), rel=1e-9)


def test_what_is_constant_has_its_peak_at_the_start() -> None:
    """The same while it rests, for 0.5 s of 1 s."""
    still = {**short_lift(11, time={"end": "0.5 s", "samples": 11}), "loads": {"joints": {"O": {}}, "sets": []}}
    (row,) = (row for row in pinarm.run(still).sections["loads"].tables[1].rows if row[1] == "force.norm")
    assert row[3:7] == pytest.approx((1.5 * 9.81, 0.0, 1.5 * 9.81, 0.0), abs=1e-12)
