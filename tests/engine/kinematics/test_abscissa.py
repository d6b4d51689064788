"""Messages name what runs along the rows, in the unit of files."""

import math
import re
from pathlib import Path

import pytest

import pinarm
from pinarm.errors import AssemblyError


def test_a_range_in_degrees_that_is_out_of_reach_is_told_in_degrees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rocker turns as far as crank and coupler in line allow; by the law of cosines."""
    monkeypatch.chdir(tmp_path)
    pinarm.new("four_bar")
    swept = {"kind": "statics", "over": {"C": {"from": "0 deg", "to": "70 deg", "samples": 3}}, "drives": ["O"]}
    with pytest.raises(AssemblyError) as caught:
        pinarm.run({"pinarm": 1, "mechanism": "four_bar/mechanism.yaml", "problem": swept, "outputs": ["O"]})
    points = pinarm.Mechanism.load("four_bar/mechanism.yaml").description.planar.points
    o, a, b, c = (complex(*points[name]) for name in "OABC")
    ground, rocker, least = abs(c - o), abs(b - c), abs(b - a) - abs(a - o)
    first, last = (math.acos((ground**2 + rocker**2 - side**2) / (2 * ground * rocker)) for side in (abs(b - o), least))
    reached = re.search(
        r"up to C = (\S+) deg; .*the closest it comes, with \S+ still open, is C = \S+ deg, O = ", caught.value.expected
    )
    assert "out of reach at C = 35 deg" in caught.value.message
    # the branch is followed to about 1e-9 of an interval of 35 degrees before a point where it ends like a root
    assert reached and math.isclose(float(reached[1]), math.degrees(first - last), abs_tol=1e-6)
