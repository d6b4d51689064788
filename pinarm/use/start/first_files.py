"""The first mechanism file and the first scenario of a model that has none yet, as commented text to be changed.

The scenario asks for the efforts of all joints while each moves from rest to rest, within its limits: 30 degrees or
0.1 m, slowly enough for its limit of velocity. With loops and couplings it is as many of them as there are degrees of
freedom.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from pinarm.arrays import Array
from pinarm.engine.kinematics.assembly import closed_generic
from pinarm.engine.kinematics.newton import start_configuration
from pinarm.engine.mechanism import Mechanism
from pinarm.errors import InputError, PinarmError
from pinarm.input.yaml.document import Document
from pinarm.mechanics.couplings.coupling import Coupling
from pinarm.mechanics.joints import METRE, Joint
from pinarm.use.facade import Scenario

STEP = {"deg": 30.0, "mm": 100.0}
"""Displacement of a joint, in the unit of the file."""

TITLE = "Mechanism"
"""Title of a model without a name."""

PARTS = (1.0, -1.0, 0.1, -0.1)
"""Parts of ``STEP`` that are tried where loops or couplings limit the motion, forward and backward."""

DRIVING = 0.3
"""Least motion of a coordinate that is driven, relative to the most that one makes: others would take large efforts."""

NEAR = 1e-9
"""Largest coordinate that is 0 but for rounding [rad or m]."""

PEAK = 15 / 8
"""Largest speed of a polynomial of degree 5 from rest to rest, relative to the mean one."""

PLAIN = re.compile(r"(?!(?:true|false|null|yes|no|on|off|y|n)$)[A-Za-z_][A-Za-z0-9_]*", re.IGNORECASE)
"""Names that YAML takes for text without quotes."""


def mechanism_text(mechanism: Mechanism, robot: str) -> str:
    """Return a mechanism file for a model; ``robot`` is the model's file relative to it, or the name of a robot."""
    gravity = ", ".join(f"{part:g}" for part in mechanism.model.gravity.linear)
    lines = [
        "# What the model file does not say. All keys: python -m pinarm schema mechanism",
        "pinarm: 1", f"title: {_quoted(mechanism.title or TITLE)}", f"robot: {_quoted(robot)}",
        *_of_arguments(mechanism), "# Joints with one coordinate:", *(f"#   {line}" for line in _described(mechanism)),
        f"# gravity: none               # or {{direction: -z, magnitude: 9.81 m/s^2}}; it is {gravity} m/s^2 now",
        *_of_drives(mechanism), "# symbols: {}                 # names of your own, for quantities and formulas",
    ]  # fmt: skip
    return _text(lines)


def _text(lines: Iterable[str]) -> str:
    """Return lines as text; what in names would end a line, or is no character of YAML, is escaped."""
    return "".join(f"{_printable(line)}\n" for line in lines)


def _printable(line: str) -> str:
    return "".join(char if char.isprintable() else rf"\U{ord(char):08x}" for char in line)


def _of_arguments(mechanism: Mechanism) -> Iterator[str]:
    if mechanism.arguments:
        units = ", ".join(f"{name}: UNIT" for name in mechanism.arguments)
        yield f"# arguments: {{{units}}}     # their units: m, kg ...; then scenarios can change them"


def _of_drives(mechanism: Mechanism) -> Iterator[str]:
    for joint in [*mechanism.joints][:1]:
        yield "# drives:                     # motors with gears, each at its joint"
        yield f"#   motor: {{joint: {_name(joint)}, ratio: 100, efficiency: 0.8, rotor_inertia: 20 kg*mm^2}}"


def scenario_text(mechanism: Mechanism) -> str:
    """Return a scenario of the mechanism file beside it: inverse dynamics of a motion from rest to rest.

    Of loops and couplings as many coordinates move as there are degrees of freedom, along the first of some ranges that
    they can follow; where they can follow none, a comment says why.
    """
    try:
        return _solvable(mechanism)
    except PinarmError as error:
        q = start_configuration(mechanism, {})
        text = _scenario(mechanism, q, _independent(mechanism, q), 1.0, {})
        return _text([f"# This does not run as it is: {error.message}."]) + text


def _solvable(mechanism: Mechanism) -> str:
    """Return the first scenario that can be solved, of trees the first one."""
    q = closed_generic(mechanism, {})
    names = _independent(mechanism, q)
    if not mechanism.closure.size:
        return _scenario(mechanism, q, names, 1.0, {})
    others = {name: float(q[joint.q]) for name, joint in mechanism.joints.items() if name not in names}
    start = {name: value for name, value in others.items() if abs(value) > NEAR}
    reason: PinarmError = InputError("it has no degree of freedom")
    for part in PARTS if names else ():
        text = _scenario(mechanism, q, names, part, start)
        try:
            Scenario.of_data({**Document.parse(text).data, "mechanism": mechanism}).run()
        except PinarmError as error:
            reason = error
        else:
            return text
    raise reason


def _independent(mechanism: Mechanism, q: Array) -> list[str]:
    """Return as many coordinates as there are degrees of freedom, which determine the motion from a configuration.

    One after the other in the order of the file, each that moves while those before it rest; those that hardly do, such
    as the slide of a screw, only where nothing else is left.
    """
    closure, carried = mechanism.closure, _carried(mechanism)
    names = [*(name for name in mechanism.joints if name not in carried), *_held(mechanism)]
    if not closure.size:
        return names
    state = closure.state(q)
    coordinates = [mechanism.coordinate(name) for name in names]
    units = closure.with_guides(names, coordinates).measure[closure.size :]
    rows = np.array([coordinate.row(state) for coordinate in coordinates]) * closure.scale / units[:, None]
    left = np.linalg.qr(closure.split(closure.rows(state)).free / closure.scale[:, None])[0]
    chosen: list[int] = []
    while left.shape[1]:
        moved = np.linalg.norm(rows @ left, axis=1)
        chosen.append(int(np.argmax(moved >= DRIVING * moved.max())))
        left = left @ np.linalg.svd((rows[chosen[-1]] @ left)[None])[2][1:].T
    return [names[k] for k in sorted(chosen)]


def _scenario(mechanism: Mechanism, q: Array, names: Sequence[str], part: float, start: Mapping[str, float]) -> str:
    """Return a scenario in which coordinates move from a configuration, shape (nq,), by a part of their usual range."""
    held = {name: unit for name, unit in _held(mechanism).items() if name in names}
    ways = {name: _way(mechanism, mechanism.joints[name], q, part) for name in names if name not in held}
    duration = max([1.0, *(_duration(mechanism, mechanism.joints[name], way) for name, way in ways.items())])
    rough = ", ".join(_level(mechanism.joints[name], value) for name, value in start.items())
    lines = [
        "# Which efforts does a motion from rest to rest take?",
        "# Solve: python -m pinarm run scenario.yaml     Look: python -m pinarm replay RESULT, the folder it names",
        "pinarm: 1",
        f"title: {_quoted(f'{mechanism.title or TITLE}, a motion from rest to rest')}",
        "mechanism: mechanism.yaml",
        "problem:",
        "  kind: inverse                  # the motion is known, the efforts are wanted",
        f"  time: {{end: {duration:g} s, samples: 201}}",
        *([f"  start: {{{rough}}}"] if start else []),
        "  motion:",
    ]
    for name, (first, last, unit) in ways.items():
        begin, end = (f"{round(value, 12) + 0.0:.9g} {unit}" for value in (first, last))
        law = f"law: polynomial, from: {begin}, to: {end}, duration: {duration:g} s"
        lines.append(f"    {_name(name)}: {{{law}}}")
    state = mechanism.closure.state(q)
    for name, unit in held.items():
        value = mechanism.coordinate(name).value(state) * (1.0 if unit == "m" else math.degrees(1.0))
        lines.append(f"    {_name(name)}: {{law: constant, value: {value + 0.0:.9g} {unit}}}")
    turns = (f"{ball}.moment.{axis}" for ball in mechanism.balls for axis in "xyz" if f"{ball}.rotation.{axis}" in held)
    outputs = [*(f"joint.{name}.effort" for name in ways), *(f"joint.{turn}" for turn in turns)]
    return _text([*lines, "outputs:", *(f"  - {_name(output)}" for output in outputs)])


def _level(joint: Joint, value: float) -> str:
    unit, factor = _unit(joint)
    return f"{_name(joint.name)}: {value * factor:.6g} {unit}"


def _name(text: str) -> str:
    """Return a name as YAML, in quotes where these are needed."""
    return text if all(PLAIN.fullmatch(part) for part in text.split(".")) else _quoted(text)


def _quoted(text: str) -> str:
    """Return a text in quotes; ``_text`` escapes what is left in it as YAML has it."""
    return json.dumps(text, ensure_ascii=False)


def _described(mechanism: Mechanism) -> Iterator[str]:
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
    followers = {constraint.follower for constraint in mechanism.constraints if isinstance(constraint, Coupling)}
    mimics = {joint.name for joint in mechanism.joints.values() if joint.v in followers}
    return mimics | {f"{ball}.{axis}" for ball in mechanism.balls for axis in "xyz"}


def _held(mechanism: Mechanism) -> dict[str, str]:
    """Return the coordinates that stay where they are, with their units: of floating bases and ball joints."""
    held: dict[str, str] = {}
    for ball in mechanism.balls:
        held |= {f"{ball}.{axis}": "m" for axis in "xyz" if f"{ball}.{axis}" in mechanism.joints}
        held |= {f"{ball}.rotation.{axis}": "deg" for axis in "xyz"}
    return held


def _way(mechanism: Mechanism, joint: Joint, q: Array, part: float) -> tuple[float, float, str]:
    """Return where a joint's motion begins and ends, within its limits, and the unit.

    It begins where it is in a configuration, shape (nq,), and goes by a part of its step, which may be negative, or as
    far to the other side where limits are in the way.
    """
    unit, factor = _unit(joint)
    model = mechanism.model
    low = math.ceil(1e3 * factor * max(model.lowerPositionLimit[joint.q], -1e6)) / 1e3
    high = math.floor(1e3 * factor * min(model.upperPositionLimit[joint.q], 1e6)) / 1e3
    start, step = float(np.clip(factor * q[joint.q], low, high)) + 0.0, part * STEP[unit]
    end = next((end for end in (start + step, start - step) if low <= end <= high), None)
    return (low, high, unit) if end is None else (start, end, unit)


def _duration(mechanism: Mechanism, joint: Joint, way: tuple[float, float, str]) -> float:
    """Return the least time [s], in tenths, in which a way keeps to the joint's limit of velocity."""
    fastest = float(mechanism.model.velocityLimit[joint.v]) * _unit(joint)[1]
    return math.ceil(10 * PEAK * abs(way[1] - way[0]) / fastest) / 10 if 0.0 < fastest < math.inf else 0.0
