"""Loads along the axes of joints: of a weight on a skew axis by statics, and of loops by their components."""

from pathlib import Path

import numpy as np
import pytest

import pinarm
from pinarm.errors import InputError

SKEW = """<robot name="skew">
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="2"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="2 -1 2"/></joint>
</robot>"""
HELD = """pinarm: 1
mechanism: skew.urdf
gravity: {direction: -z, magnitude: 9.81 m/s^2}
problem: {kind: inverse, time: {end: 1 s, samples: 2}, motion: {hinge: {law: constant, value: 0 rad}}, drives: [hinge]}
outputs: [joint.hinge.force.axial, joint.hinge.force.radial, joint.hinge.moment.axial, joint.hinge.moment.radial]
"""
ROUNDING = 1e-12
"""Relative: sums of a few terms."""


def test_a_weight_on_a_skew_axis_is_parted_by_statics(tmp_path: Path) -> None:
    (tmp_path / "skew.urdf").write_text(SKEW)
    (tmp_path / "held.yaml").write_text(HELD)
    result = pinarm.run(tmp_path / "held.yaml")
    axis, force = np.array([2.0, -1.0, 2.0]) / 3.0, np.array([0.0, 0.0, 2 * 9.81])
    moment = np.cross([0.1, 0.2, 0.3], force)
    for kind, vector in (("force", force), ("moment", moment)):
        axial = float(vector @ axis)
        assert result[f"joint.hinge.{kind}.axial"].values == pytest.approx(axial, rel=ROUNDING)
        assert result[f"joint.hinge.{kind}.radial"].values == pytest.approx(
            (vector @ vector - axial**2) ** 0.5, rel=ROUNDING
        )
    assert result["joint.hinge.moment.axial"].values == pytest.approx(result["joint.hinge.effort"].values, rel=ROUNDING)


def test_of_a_loop_only_what_is_determined_is_told() -> None:
    result = pinarm.run("scenarios/slider_crank_gas.yaml")
    across = np.hypot(result["loop.B.force.x"].values, result["loop.B.force.y"].values)
    assert result["loop.B.force.radial"].values == pytest.approx(across, rel=ROUNDING)
    for name in ("loop.B.force.axial", "loop.B.moment.radial"):
        with pytest.raises(InputError, match="hyperstatic"):
            _ = result[name]
