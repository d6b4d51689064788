"""The first mechanism file and the first scenario of a model that has none yet, as commented text to be changed.

The scenario asks for the efforts of all joints while each moves from rest to rest, within its limits: 30 degrees or
0.1 m, slowly enough for its limit of velocity.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator

import numpy as np

from pinarm.engine.mechanism import Mechanism
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.joints import METRE, Joint

STEP = {"deg": 30.0, "mm": 100.0}
"""How far a joint moves, in the unit of the file."""

PEAK = 15 / 8
"""Largest speed of a polynomial of degree 5 from rest to rest, relative to the mean one."""

PLAIN = re.compile(r"(?!(?:true|false|null|yes|no|on|off|y|n)$)[A-Za-z_][A-Za-z0-9_]*", re.IGNORECASE)
"""Names that YAML takes for text without quotes."""


def mechanism_text(mechanism: Mechanism, robot: str) -> str:
    """Return a mechanism file.

    Args:
        mechanism: The model, as it loads without such a file.
        robot: The model's file relative to the mechanism file, or the name of a robot.
    """
    gravity = ", ".join(f"{part:g}" for part in mechanism.model.gravity.linear)
    lines = [
        "# What the model file does not say. All keys: python -m pinarm schema mechanism",
        "pinarm: 1", f"title: {_quoted(mechanism.title or 'Mechanism')}", f"robot: {_quoted(robot)}",
        *_of_arguments(mechanism), "# Joints with one coordinate:", *(f"#   {line}" for line in _described(mechanism)),
        f"# gravity: none               # or {{direction: -z, magnitude: 9.81 m/s^2}}; it is {gravity} m/s^2 now",
        *_of_drives(mechanism), "# symbols: {}                 # names of your own, for quantities and formulas",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _of_arguments(mechanism: Mechanism) -> Iterator[str]:
    if mechanism.arguments:
        units = ", ".join(f"{name}: UNIT" for name in mechanism.arguments)
        yield f"# arguments: {{{units}}}     # their units: m, kg ...; then scenarios can change them"


def _of_drives(mechanism: Mechanism) -> Iterator[str]:
    for joint in [*mechanism.joints][:1]:
        yield "# drives:                     # motors with gears, each at its joint"
        yield f"#   motor: {{joint: {_name(joint)}, ratio: 100, efficiency: 0.8, rotor_inertia: 20 kg*mm^2}}"


def scenario_text(mechanism: Mechanism) -> str:
    """Return a scenario of the mechanism file beside it: inverse dynamics of a motion from rest to rest."""
    moving = [joint for joint in mechanism.joints.values() if joint.name not in _carried(mechanism)]
    ways = {joint.name: _way(mechanism, joint) for joint in moving}
    duration = max([1.0, *(_duration(mechanism, joint, ways[joint.name]) for joint in moving)])
    lines = [
        "# Which efforts does a motion of all joints from rest to rest take?",
        "# Solve: python -m pinarm run scenario.yaml     Look: python -m pinarm replay results/scenario",
        "pinarm: 1", f"title: {_quoted(f'{mechanism.title}, a motion from rest to rest')}",
        "mechanism: mechanism.yaml", "problem:",
        "  kind: inverse                  # the motion is known, the efforts are wanted",
        f"  time: {{end: {duration:g} s, samples: 201}}", "  motion:",
    ]  # fmt: skip
    for name, (start, end, unit) in ways.items():
        law = f"law: polynomial, from: {start:g} {unit}, to: {end:g} {unit}, duration: {duration:g} s"
        lines.append(f"    {_name(name)}: {{{law}}}")
    lines += [f"    {_name(name)}: {{law: constant, value: 0 {unit}}}" for name, unit in _held(mechanism)]
    outputs = [
        *(f"joint.{name}.effort" for name in ways),
        *(f"joint.{name}.effort.{axis}" for name in mechanism.balls for axis in "xyz"),
    ]
    return "\n".join([*lines, "outputs:", *(f"  - {_name(output)}" for output in outputs)]) + "\n"


def _name(text: str) -> str:
    """Return a name as YAML, in quotes where these are needed."""
    return text if all(PLAIN.fullmatch(part) for part in text.split(".")) else _quoted(text)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _described(mechanism: Mechanism) -> Iterator[str]:
    """Yield a line for each joint: what it does, and its limits."""
    model = mechanism.model
    for joint in mechanism.joints.values():
        unit, factor = _unit(joint)
        low, high = (float(limit[joint.q]) for limit in (model.lowerPositionLimit, model.upperPositionLimit))
        effort = float(model.effortLimit[joint.v])
        limits = f", {low * factor:.6g} to {high * factor:.6g} {unit}" if low > -math.inf or high < math.inf else ""
        most = f", at most {effort:.6g} {'N' if joint.unit == METRE else 'N*m'}" if effort < math.inf else ""
        yield f"{joint.name}: {'slides' if joint.unit == METRE else 'turns'}{limits}{most}"


def _unit(joint: Joint) -> tuple[str, float]:
    """Return the unit in which a file gives a joint's coordinate, and how many there are in one of SI."""
    return ("mm", 1e3) if joint.unit == METRE else ("deg", math.degrees(1.0))


def _carried(mechanism: Mechanism) -> set[str]:
    """Return the joints that are not given a way: those that mimic others, and the slides of floating bases."""
    followers = {one.follower for one in mechanism.constraints if isinstance(one, Coupling)}
    mimics = {joint.name for joint in mechanism.joints.values() if joint.v in followers}
    return mimics | {f"{ball}.{axis}" for ball in mechanism.balls for axis in "xyz"}


def _held(mechanism: Mechanism) -> Iterator[tuple[str, str]]:
    """Yield the coordinates that stay at 0, with their units: of floating bases and ball joints."""
    for ball in mechanism.balls:
        yield from ((f"{ball}.{axis}", "m") for axis in "xyz" if f"{ball}.{axis}" in mechanism.joints)
        yield from ((f"{ball}.rotation.{axis}", "deg") for axis in "xyz")


def _way(mechanism: Mechanism, joint: Joint) -> tuple[float, float, str]:
    """Return where a joint's motion begins and ends, within its limits, and the unit; from 0 where that is allowed."""
    unit, factor = _unit(joint)
    model = mechanism.model
    low = math.ceil(1e3 * factor * max(model.lowerPositionLimit[joint.q], -1e6)) / 1e3
    high = math.floor(1e3 * factor * min(model.upperPositionLimit[joint.q], 1e6)) / 1e3
    start = float(np.clip(0.0, low, high)) + 0.0
    if start + STEP[unit] <= high:
        return start, start + STEP[unit], unit
    return (start, start - STEP[unit], unit) if start - STEP[unit] >= low else (low, high, unit)


def _duration(mechanism: Mechanism, joint: Joint, way: tuple[float, float, str]) -> float:
    """Return the least time [s], in tenths, in which a way keeps to the joint's limit of velocity."""
    fastest = float(mechanism.model.velocityLimit[joint.v]) * _unit(joint)[1]
    return math.ceil(10 * PEAK * abs(way[1] - way[0]) / fastest) / 10 if 0.0 < fastest < math.inf else 0.0
