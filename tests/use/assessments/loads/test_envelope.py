"""Envelopes against the rows of the table and closed forms."""

from math import pi

import numpy as np
import pytest

import pinarm

SLIDER_CRANK = "scenarios/slider_crank_gas.yaml"


def envelope(path, joints):
    result = pinarm.run(path, {"loads": {"joints": {name: {} for name in joints}, "sets": []}})
    section = result.sections["loads"]
    return result, {row[:2]: row[2:] for row in section.tables[1].rows}, section


def test_a_horizontal_rotor_presses_its_bearing_most_where_weight_and_unbalance_agree() -> None:
    """B is b e^(i phi) + i m g/2, largest where both parts have one direction."""
    _, rows, section = envelope("scenarios/rotor_horizontal.yaml", ["B"])
    b_x, b_y, weight = -3.5e-3 * (100 * pi) ** 2, 2.5e-4 * (100 * pi) ** 2, 12 * 9.81 / 2
    unit, least, least_at, most, most_at = rows["B", "force.radial"]
    turned = np.hypot(b_x, b_y)
    assert (unit, least, most) == (
        "N",
        pytest.approx(turned - weight, rel=1e-9),
        pytest.approx(turned + weight, rel=1e-9),
    )
    where = (pi / 2 - np.arctan2(b_y, b_x)) % (2 * pi) / (100 * pi)
    assert most_at == pytest.approx(where, abs=1e-8)  # half of the digits of a place near a maximum
    assert least_at == pytest.approx((where + 10e-3) % 20e-3, abs=1e-8)
    assert rows["B", "force.x"][3] == pytest.approx(b_x + weight, rel=1e-9)  # at phi = pi/2
    assert rows["B", "force.x"][4] == pytest.approx(5e-3, abs=1e-8)
    assert float(section.numbers["B.radial.peak"].values[0]) == pytest.approx(most, rel=1e-12)


def test_a_peak_between_rows_that_are_alike_is_found() -> None:
    """Rows at whole turns of the rotor: the unbalance stands to the weight there as at the start."""
    shown = {"loads": {"joints": {"B": {}}, "sets": []}, "expect": []}
    result = pinarm.run("scenarios/rotor_horizontal.yaml", {**shown, "problem.time": {"end": "0.06 s", "samples": 4}})
    turned = (100 * pi) ** 2 * np.hypot(-3.5e-3, 2.5e-4)
    peak = result.sections["loads"].numbers["B.radial.peak"].values
    assert peak == pytest.approx(turned + 12 * 9.81 / 2, rel=1e-9)


def test_it_holds_the_rows_of_the_table_and_names_what_is_open() -> None:
    result, rows, section = envelope(SLIDER_CRANK, ["A"])
    for axis in "xy":
        values = result[f"joint.A.force.along.rod.{axis}"].values
        _, least, _, most, _ = rows["A", f"force.{axis}"]
        assert least <= values.min() + 1e-9
        assert values.min() - least < 1e-3 * np.ptp(values)  # between neighbouring rows, 721 of them
        assert most >= values.max() - 1e-9
    assert ("A", "force.z") not in rows
    assert any(text.startswith("A: force.z, moment.x, moment.y,") for text in section.remarks)
    assert "A.axial.peak" not in section.numbers
