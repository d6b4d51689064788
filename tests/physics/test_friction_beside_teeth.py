"""Friction of bearings that teeth and strands load: against the roots of the scalar equation, and mirror images.

An eccentric wheel b, held by a wheel a beside it without friction, rubs in its journal. The force of the teeth presses
the wheels apart on either flank, and a strand that is slack carries nothing: what loads the journal is not linear in
the friction.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import pinarm

G, MASS, ECCENTRIC = 9.81, 2.0, 0.02
URDF = """<robot name="pair"><link name="base"/>
<link name="a"><inertial><mass value="1"/>
  <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="b"><inertial><origin xyz="{eccentric} 0 0"/><mass value="2"/>
  <inertia ixx="2e-3" iyy="2e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="ja" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
<joint name="jb" type="continuous"><parent link="base"/><child link="b"/><origin xyz="{apart} 0 0"/>
  <axis xyz="0 0 1"/></joint></robot>"""
ANGLES = np.linspace(0.0, 12.0, 25)


def bands(
    folder: Path, up: bool, apart: float, eccentric: float, coupling: dict[str, Any], friction: dict[str, Any]
) -> list[np.ndarray]:
    (folder / "pair.urdf").write_text(URDF.format(apart=apart, eccentric=eccentric))
    mechanism = {"pinarm": 1, "robot": str(folder / "pair.urdf"), "couplings": {"C": coupling},
                 "friction": {"jb": friction},
                 "gravity": {"direction": "y" if up else "-y", "magnitude": f"{G} m/s^2"}}  # fmt: skip
    over = {"ja": {"from": f"{ANGLES[0]} rad", "to": f"{ANGLES[-1]} rad", "samples": len(ANGLES)}}
    with pinarm.file_root(folder):
        result = pinarm.run({"pinarm": 1, "mechanism": mechanism, "problem": {"kind": "statics", "over": over},
                             "outputs": ["joint.ja.effort.lower", "joint.ja.effort.upper"]})  # fmt: skip
    return [result[f"joint.ja.effort.{end}"].values for end in ("lower", "upper")]


def least_and_greatest(effort: Callable[[float, float], float]) -> tuple[list[float], list[float]]:
    """The efforts that begin to turn wheel a down and up, by that for an angle of b and a direction of its slip."""
    each = [sorted((effort(angle, 1.0), effort(angle, -1.0))) for angle in ANGLES]
    return [low for low, _ in each], [high for _, high in each]


@pytest.mark.parametrize("up", [False, True])
@pytest.mark.parametrize(("mu", "radius"), [(0.3, 0.05), (0.1, 0.01)])
def test_bands_of_a_journal_beside_teeth(tmp_path: Path, up: bool, mu: float, radius: float) -> None:
    small, large, slope, weight = 0.04, 0.08, np.tan(np.deg2rad(28.0)), MASS * (G if up else -G)

    def effort(angle: float, slip: float) -> float:
        turned = -0.5 * angle

        def left(force: float) -> float:
            journal = -np.array([abs(force) * slope, force + weight])
            moment = -slip * mu * radius * float(np.hypot(*journal))
            return float(-large * force + ECCENTRIC * np.cos(turned) * weight + moment)

        return small * float(brentq(left, -500.0, 500.0, xtol=1e-13))

    gear = {"kind": "gear", "joints": ["ja", "jb"], "ratio": -0.5, "pressure_angle": "28 deg"}
    found = bands(tmp_path, up, small + large, ECCENTRIC, gear, {"mu": mu, "radius": f"{radius} m"})
    for ours, theirs in zip(found, least_and_greatest(effort), strict=True):
        assert ours == pytest.approx(theirs, abs=1e-10)  # differences of loads lose four digits


def test_bands_of_a_journal_under_a_belt_whose_strand_goes_slack(tmp_path: Path) -> None:
    small, large, apart, pretension, mu, radius, eccentric = 0.05, 0.1, 0.3, 5.0, 0.3, 0.02, 0.1
    across = (small - large) / apart
    strands = [(across, sign * np.sqrt(1.0 - across**2)) for sign in (1.0, -1.0)]

    def effort(angle: float, slip: float) -> float:
        turned = 0.5 * angle

        def loads(difference: float) -> tuple[np.ndarray, float]:
            """The force and the moment of both strands on b, of which one pulls more by the difference."""
            tight, slack = pretension + 0.5 * abs(difference), pretension - 0.5 * abs(difference)
            tight, slack = (abs(difference), 0.0) if slack < 0.0 else (tight, slack)
            force, moment = np.zeros(2), 0.0
            for normal in np.array(strands):
                way = (small - large) * normal - np.array([apart, 0.0])
                way /= np.hypot(*way)
                arm = large * (normal[0] * way[1] - normal[1] * way[0])
                tension = tight if (arm > 0.0) == (difference > 0.0) else slack
                force, moment = force + tension * way, moment + tension * arm
            return force, moment

        def left(difference: float) -> float:
            force, moment = loads(difference)
            rubbing = mu * radius * float(np.hypot(*(force + np.array([0.0, -MASS * G]))))
            return moment - MASS * G * eccentric * float(np.cos(turned)) - slip * rubbing

        return loads(float(brentq(left, -300.0, 300.0, xtol=1e-13)))[1] * small / large

    belt = {"kind": "belt", "joints": ["ja", "jb"], "radii": ["50 mm", "100 mm"], "pretension": f"{pretension} N"}
    found = bands(tmp_path, False, apart, eccentric, belt, {"mu": mu, "radius": f"{radius} m"})
    for ours, theirs in zip(found, least_and_greatest(effort), strict=True):
        assert ours == pytest.approx(theirs, abs=1e-10)
