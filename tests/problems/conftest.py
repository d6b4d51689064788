"""Linkages that several tests of problems are about."""

import pytest

LENGTH = 0.83


@pytest.fixture
def rubbing_parallelogram(mechanism, chain):
    """Return a parallelogram: cranks of ``LENGTH``, a coupler of 3 kg, friction of 0.7 N*m in its four joints."""
    crank, coupler, rocker = (
        {"name": name, "axis": "0 1 0", "at": at, "mass": mass}
        for name, at, mass in (("crank", "0 0 0", 1.0), ("coupler", f"0 0 {-LENGTH}", 3.0), ("rocker", "0.4 0 0", 1.0))
    )
    own = chain(rocker).removeprefix('<robot name="test"><link name="base"/>').removesuffix("\n</robot>")
    tips = "".join(
        f'<link name="{name}_tip"/><joint name="{name}_end" type="fixed"><parent link="{name}_link"/>'
        f'<child link="{name}_tip"/><origin xyz="{at}"/></joint>'
        for name, at in (("coupler", "0.4 0 0"), ("rocker", f"0 0 {-LENGTH}"))
    )
    return mechanism(
        chain(crank, coupler).replace("</robot>", f"{own}{tips}</robot>"),
        loops={"pin": {"kind": "revolute", "axis": "y", "between": ["coupler_tip", "rocker_tip"]}},
        friction={name: {"constant": "0.7 N*m"} for name in ("crank", "coupler", "rocker", "pin")},
    )
