"""Motions at constant energy so small that rounding of the energies is larger than they are."""

import numpy as np
import pytest

import pinarm

ROD = """<link name="{name}"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
<inertia ixx="1e-3" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/></joint>"""


@pytest.fixture
def four_bar(tmp_path):
    """Return a four-bar of three equal rods that hangs from (0, 0) and (0.6, 0), and its equilibrium."""
    links = (
        "".join(ROD.format(name=name) for name in ("crank", "coupler", "rocker")) + '<link name="tip"/><link name="e"/>'
    )
    joints = [("a", "base", "crank", 0), ("b", "crank", "coupler", 0.4), ("d", "base", "rocker", 0.6)]
    joints = "".join(JOINT.format(name=n, parent=p, child=c, x=x) for n, p, c, x in joints)
    for parent, child in (("coupler", "tip"), ("rocker", "e")):
        joints += JOINT.format(name=child, parent=parent, child=child, x=0.4).replace("continuous", "fixed")
    (tmp_path / "m.urdf").write_text(f'<robot name="m"><link name="base"/>{links}{joints}</robot>')
    loop = {"kind": "revolute", "between": ["tip", "e"], "axis": "z"}
    gravity = {"direction": "-y", "magnitude": "9.81 m/s^2"}
    mechanism = pinarm.Mechanism.load(tmp_path / "m.urdf", values={"gravity": gravity, "loops": {"c": loop}})
    crank = -float(np.arctan2(np.sqrt(0.15), 0.1))
    return mechanism, {"a": crank, "b": -crank, "d": -np.pi - crank}


def swings(mechanism, position, speed, method):
    start = {"position": {name: f"{float(q)!r} rad" for name, q in position.items()}}
    result = pinarm.run({"pinarm": 1, "mechanism": mechanism, "outputs": ["a"], "problem": {
        "kind": "forward", "time": {"end": "3 s", "samples": 101},
        "initial": {**start, "velocity": {"a": f"{speed} rad/s"}},
    }, "accuracy": {"method": method, "tolerance": 1e-10}})  # fmt: skip
    return result, 0.5 * float(np.ptp(result["a"].values)) / speed


@pytest.mark.parametrize("speed", [1e-6, 1e-10])
def test_a_linkage_swings_no_farther_than_rounding_allows(four_bar, speed):
    """Amplitude over speed is that of a large swing, to the tolerance of 1e-10 a step at coordinates of 1.4 rad."""
    _, large = swings(*four_bar, 1e-3, "dop853")
    result, small = swings(*four_bar, speed, "conserving")
    assert abs(small - large) * speed < 2e-11 + 1e-3 * speed * large
    assert any(note.startswith("conserving: rounding of the potential energy") for note in result.notes())


def test_larger_swings_keep_the_energy(four_bar):
    result, _ = swings(*four_bar, 1e-1, "conserving")
    assert result.figures["energy"] < 1e-7  # within steps it is that of the dense output
    assert not any(note.startswith("conserving") for note in result.notes())
