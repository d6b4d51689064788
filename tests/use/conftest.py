"""A pendulum of one or two rods whose every number is known by hand, and the means to ask for it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import pinarm

URDF = """\
<robot name="pendulum">
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 -1"/><mass value="2"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tip"/>
  <joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint>
  <joint name="end" type="fixed"><parent link="rod"/><child link="tip"/><origin xyz="0 0 -1"/></joint>
</robot>
"""

MECHANISM = """\
pinarm: 1
robot: pendulum.urdf
gravity: {direction: -z, magnitude: 10 m/s^2}
drives:
  motor: {joint: pivot, ratio: 100, efficiency: 0.8}
symbols: {alpha: joint.pivot.position, M: joint.pivot.effort, "$\\\\foo{": 2*alpha, "=cmd": 3*alpha}
"""

STATICS = """\
pinarm: 1
title: "A pendulum, held"
mechanism: pendulum.yaml
problem:
  kind: statics
  over: {pivot: {from: 0 deg, to: 180 deg, samples: 8}}
outputs: [M, alpha]
"""

INVERSE = """\
pinarm: 1
mechanism: pendulum.yaml
problem:
  kind: inverse
  time: {end: 2 s, samples: 9}
  motion: {pivot: {law: trapezoid, from: 0 rad, to: 1 rad, acceleration: 1 rad/s^2}}
outputs: [M, alpha]
"""

FORWARD = """\
pinarm: 1
mechanism: pendulum.yaml
problem:
  kind: forward
  time: {end: 5 s, samples: 23}
  initial: {position: {pivot: 30 deg}}
outputs: [alpha, energy.total]
"""

STATE = """\
pinarm: 1
mechanism: pendulum.yaml
problem:
  kind: state
  hold: {pivot: 30 deg}
  velocity: {pivot: 2 rad/s}
  acceleration: {pivot: 3 rad/s^2}
outputs: [M, alpha]
"""

EQUILIBRIA = """\
pinarm: 1
mechanism: pendulum.yaml
problem:
  kind: equilibria
  starts: [{pivot: 10 deg}, {pivot: 170 deg}]
outputs: [alpha, equilibrium.stability, equilibrium.frequency2_1]
"""

LINEAR = """\
pinarm: 1
mechanism: pendulum.yaml
problem:
  kind: linear
  about: {equilibrium: {pivot: 10 deg}}
outputs: [alpha, mode.1.frequency]
"""

KINEMATICS = """\
pinarm: 1
mechanism: pendulum.yaml
problem:
  kind: kinematics
  time: {end: 2 s, samples: 9}
  motion: {pivot: {law: over, of: crank, period: 360 deg,
                   profile: {law: harmonic, amplitude: 1 rad, pulsation: 1 rad/rad}},
           crank: {law: constant_speed, speed: 1 rad/s}}
outputs: [alpha, point.tip.velocity.x]
"""

RECORDED = """\
pinarm: 1
mechanism: pendulum.yaml
problem:
  kind: recorded
  columns: {"t [s]": [0, 0.5, 1], "pivot [deg]": 0 10 30, "joint.pivot.velocity [rad/s]": [0, 1, 0.5],
            "joint.pivot.acceleration [rad/s^2]": [1, 0, -1]}
outputs: [M, alpha]
"""

KINDS = {"statics": STATICS, "inverse": INVERSE, "forward": FORWARD, "state": STATE, "equilibria": EQUILIBRIA,
         "kinematics": KINEMATICS, "linear": LINEAR, "recorded": RECORDED}  # fmt: skip


@pytest.fixture(autouse=True)
def _one_process(one_process: None) -> None:
    """Start no worker processes but where a test says how many."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A root with the model in it."""
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "pendulum.urdf").write_text(URDF)
    (tmp_path / "pendulum.yaml").write_text(MECHANISM)
    return tmp_path


@pytest.fixture
def scenario(folder: Path) -> Callable[..., Any]:
    """``scenario("statics", more, old=new)``: the scenario of a kind with text added and replaced."""

    def build(kind: str, more: str = "", *changes: tuple[str, str]) -> Any:
        text = KINDS[kind] + more
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (folder / f"{kind}.yaml").write_text(text)
        return pinarm.load(folder / f"{kind}.yaml")

    return build


HELD_XACRO = """\
<robot name="pendulum" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="m" default="2"/>
  <xacro:arg name="l" default="1"/>
  <xacro:property name="l" value="$(arg l)"/>
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 ${-l}"/><mass value="$(arg m)"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="pivot" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint>
</robot>
"""
HELD_MECHANISM = """\
pinarm: 1
robot: pendulum.urdf.xacro
arguments: {m: kg, l: m}
gravity: {direction: -z, magnitude: 10 m/s^2}
forces: {spring: {kind: joint_spring, joint: pivot, stiffness: 0 N*m/rad}}
symbols: {alpha: joint.pivot.position, M: joint.pivot.effort}
"""
HELD_SCENARIO = """\
pinarm: 1
title: A pendulum, held
mechanism: pendulum.yaml
arguments: {l: 1 m}
problem: {kind: statics, over: {pivot: {from: 0 deg, to: 90 deg, samples: 4}}}
outputs: [M]
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the scenario's file."""
    for name, text in {
        ".pinarm-root": "", "pendulum.urdf.xacro": HELD_XACRO, "pendulum.yaml": HELD_MECHANISM,
        "held.yaml": HELD_SCENARIO,
    }.items():  # fmt: skip
        (tmp_path / name).write_text(text)
    return tmp_path / "held.yaml"


@pytest.fixture
def held(path: Path) -> pinarm.Scenario:
    return pinarm.load(path)


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], object]]:
    """Return a function that makes a module of a text, which worker processes can import as well."""
    import importlib
    import sys

    monkeypatch.syspath_prepend(tmp_path)

    def make(text: str) -> object:
        (tmp_path / "hostile.py").write_text(text)
        return importlib.import_module("hostile")

    yield make
    sys.modules.pop("hostile", None)
