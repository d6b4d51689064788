"""A pendulum held at an angle, of any mass and length, with a spring: M = m g l sin(alpha) + k alpha."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import pinarm

XACRO = """\
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
MECHANISM = """\
pinarm: 1
robot: pendulum.urdf.xacro
arguments: {m: kg, l: m}
gravity: {direction: -z, magnitude: 10 m/s^2}
forces: {spring: {kind: joint_spring, joint: pivot, stiffness: 0 N*m/rad}}
symbols: {alpha: joint.pivot.position, M: joint.pivot.effort}
"""
SCENARIO = """\
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
        ".pinarm-root": "", "pendulum.urdf.xacro": XACRO, "pendulum.yaml": MECHANISM, "held.yaml": SCENARIO,
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
