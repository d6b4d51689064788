"""Every mistake that a user can make has a message: where, what was found, what was expected, what to try.

Each case changes one text of a valid pair of files and says what the message must hold. Lines are counted from 1.
"""

from pathlib import Path

import pytest

import pinarm
from pinarm.errors import PinarmError

URDF = """\
<robot name="slider">
  <link name="base"/>
  <link name="cart"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="rod"><inertial><origin xyz="0 0 -1"/><mass value="2"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="track" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="pivot" type="continuous"><parent link="cart"/><child link="rod"/><axis xyz="0 1 0"/></joint>
</robot>
"""

MECHANISM = """\
pinarm: 1
robot: slider.urdf
arguments: {}
gravity: {direction: -z, magnitude: 9.81 m/s^2}
coordinates:
  height: {kind: point, point: rod, along: z}
  turn: {kind: sum, of: [pivot]}
drives:
  motor: {joint: pivot, ratio: 50, efficiency: 0.8, rotor_inertia: 1 kg*mm^2}
forces:
  spring: {kind: joint_spring, joint: track, stiffness: 100 N/m, damping: 1 N*s/m, rest: 0 m}
symbols:
  x: joint.track.position
"""

SCENARIO = """\
pinarm: 1
title: Cart and rod
mechanism: slider.yaml
problem:
  kind: inverse
  time: {start: 0 s, end: 1 s, samples: 5}
  motion:
    track: {law: trapezoid, from: 0 m, to: 0.2 m, acceleration: 1 m/s^2, begin: 0 s}
    pivot: {law: polynomial, from: 0 rad, to: 1 rad, duration: 1 s, degree: 5}
  start: {pivot: 0 rad}
  loads:
    push: {kind: joint_effort, joint: track, effort: {law: constant, value: 3 N}}
outputs: [x, joint.pivot.effort]
accuracy: {tolerance: 1e-9}
symbols: {work: joint.pivot.power}
expect:
  - {quantity: x, at: {t: 1 s}, value: 0.2 m, source: the law, published: 0.20 m}
"""

STATICS = """\
pinarm: 1
mechanism: slider.yaml
problem:
  kind: statics
  over: {pivot: {from: -30 deg, to: 30 deg, samples: 5}}
  hold: {track: 0 m}
outputs: [joint.pivot.effort]
"""

FORWARD = """\
pinarm: 1
mechanism: slider.yaml
problem:
  kind: forward
  time: {end: 0.1 s, samples: 3}
  initial: {position: {pivot: 1 rad}, velocity: {track: 1 m/s}}
outputs: [x]
"""

PIVOT = "{law: polynomial, from: 0 rad, to: 1 rad, duration: 1 s, degree: 5}"
ENTRY = "{quantity: x, at: {t: 1 s}, value: 0.2 m, source: the law, published: 0.20 m}"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / ".pinarm-root").touch()
    (tmp_path / "slider.urdf").write_text(URDF)
    (tmp_path / "slider.yaml").write_text(MECHANISM)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def message(text: str) -> str:
    Path("s.yaml").write_text(text)
    with pytest.raises(PinarmError) as caught:
        pinarm.check(pinarm.load("s.yaml"))
    return str(caught.value)


def changed(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, f"{old!r} must stand once"
    return text.replace(old, new)


@pytest.mark.parametrize("text", [SCENARIO, STATICS, FORWARD])
def test_what_is_changed_below_is_valid(here: Path, text: str) -> None:
    (here / "s.yaml").write_text(text)
    assert all(finding.ok for finding in pinarm.check(pinarm.load("s.yaml")))


SCENARIOS = [
    # keys: unknown at each level, missing, of the wrong type
    (SCENARIO, "title:", "titel:", ["s.yaml:2:1: unknown key 'titel'", "try: title"]),
    (SCENARIO, "samples: 5", "sample: 5",
     ["s.yaml:6:32: unknown key 'sample'", "one of end, samples, start", "try: samples"]),
    (SCENARIO, "pinarm: 1", "pinarm: 2", ["s.yaml:1:9: ", "1"]),
    (SCENARIO, "end: 1 s, ", "", ["s.yaml:6:3: the key 'end' is missing"]),
    (SCENARIO, "law: polynomial, ", "",
     ["s.yaml:9:5: the key 'law' is missing", "expected: one of constant, ", "polynomial"]),
    (SCENARIO, "kind: joint_effort, ", "",
     ["s.yaml:12:5: the key 'kind' is missing: it says which", "expected: one of ", "joint_effort, joint_spring"]),
    (SCENARIO, "work: joint.pivot.power", "work: ''",
     ["s.yaml:15:17: the formula is empty", "a number, a name, or a formula such as 2*(a + b)"]),
    (SCENARIO, "{law: trapezoid, from: 0 m, to: 0.2 m, acceleration: 1 m/s^2, begin: 0 s}",
     "{law: spline, points: [[0 s, 0 m], [0 s, 1 m]]}",
     ["the points do not ascend: 0, then 0 (point 2)", "expected: each further on than the one before"]),
    (SCENARIO, "[x, joint.pivot.effort]", "[]", ["s.yaml:13:1: this is []", "a list of length >= 1"]),
    (SCENARIO, "Cart and rod", "a: b", ["s.yaml:2:9: this is not YAML", "quotes around text that holds a colon"]),
    # units
    (SCENARIO, "end: 1 s", "end: 1", ["s.yaml:6:27: '1' has no unit", "try: 1 s"]),
    (SCENARIO, "end: 1 s", "end: 1 m", ["s.yaml:6:27: 'm' is not a unit of this quantity", "such as s"]),
    # names
    (SCENARIO, "kind: inverse", "kind: invers",
     ["s.yaml:5:9: unknown kind 'invers'", "forward, inverse", "try: inverse"]),
    (SCENARIO, "    track: {law", "    trakc: {law",
     ["s.yaml:8:5: the mechanism has no coordinate 'trakc'", "try: track"]),
    (SCENARIO, "{pivot: 0 rad}", "{pivto: 0 rad}", ["s.yaml:10:11: the model has no joint 'pivto'", "try: pivot"]),
    (SCENARIO, "[x, joint.pivot.effort]", "['x + joint.pivot.effort']", ["s.yaml:13:11: ", "do not go together"]),
    (SCENARIO, "at: {t: 1 s}", "at: middle", ["s.yaml:17:23: ", "all, end, integral, largest"]),
    # what belongs elsewhere
    (SCENARIO, "[x, joint.pivot.effort]", "[x, joint.pivot.effort @ peak]",
     ["s.yaml:13:14: 'joint.pivot.effort @ peak' is one number of the run", "under the key 'numbers'",
      "try: numbers: [joint.pivot.effort @ peak]"]),
    (SCENARIO, "[x, joint.pivot.effort]", "[x, response.overshoot]\nresponse: {of: x, final: 1 m}",
     ["s.yaml:13:14: 'response.overshoot' is one number of the run", "try: numbers: [response.overshoot]"]),
    (SCENARIO, "  start: {pivot", "  friction: {pivot: {mu: 0.1}}\n  start: {pivot",
     ["s.yaml:10:3: 'friction' is a key of mechanism files", "in slider.yaml, or in 'changes:'",
      "try: changes: {friction: ...}"]),
    (FORWARD, "  initial:", "  drives: [pivot]\n  initial:", [": unknown key 'drives'"]),
    (SCENARIO, "  start: {pivot", "  drives: [{along: pivot}]\n  start: {pivot",
     ["s.yaml:10:12: a drive of a problem is the name of the coordinate", "try: drives: [pivot]"]),
    (SCENARIO, "  start: {pivot", "  drives: [track, rod.z]\n  start: {pivot",
     ["s.yaml:10:3: the mechanism has no coordinate 'rod.z'",
      "try: rod_z here, with coordinates: {rod_z: {kind: point, point: rod, along: z}} in the mechanism file"]),
    (SCENARIO, "joint: track, effort", "joint: turn, effort",
     ["s.yaml:12:39: the model has no joint 'turn' with one coordinate"]),
    (SCENARIO, "[x, joint.pivot.effort]", "[joint.pivot.force.about.cart.z]",
     ["s.yaml:13:11: there is no quantity 'joint.pivot.force.about.cart.z'"]),
    # as many drives as degrees of freedom, two here; height does not change where the rod hangs
    *[(SCENARIO, "  start: {pivot", f"  drives: [{drives}]\n  start: {{pivot", ["s.yaml:10:3: ", *said])
      for drives, said in (("", ["this is []", "a list of length >= 1"]), ("track", ["uncarried", "2 drives, as many"]),
                           ("height", ["the drives height leave a load of", "2 drives, as many"]),
                           ("track, pivot, turn", ["more drives than degrees of freedom, 3 and 2"]))],
    # files
    (SCENARIO, "slider.yaml", "slidr.yaml", ["s.yaml:3:12: ", "slidr.yaml' does not exist", "slider.yaml"]),
    (SCENARIO, "slider.yaml", "../x.yaml",
     ["s.yaml:3:12: the path ", "leads out of the root", "a path under", "--root DIR"]),
    (SCENARIO, "slider.yaml", "pandas", ["s.yaml:3:12: there is no robot 'pandas'", "try: panda"]),
    # what does not fit together
    (SCENARIO, "    pivot: {law: poly", "    turn: {law: constant, value: 0 rad}\n    pivot: {law: poly",
     ["s.yaml:7:3: 3 coordinates follow a law", "only 2 degrees of freedom", "2 of track, turn, pivot"]),
    (SCENARIO, "    track: {law: trapezoid, from: 0 m, to: 0.2 m, acceleration: 1 m/s^2, begin: 0 s}\n", "",
     ["s.yaml:7:3: 2 coordinates have to follow a law and 1 do", "joints track"]),
    (SCENARIO, "    track: {law: trap", "    turn: {law: constant, value: 0 rad}\n    #",
     ["s.yaml:7:3: ", "turn, pivot do not move independently"]),
    (SCENARIO, "    track: {law: trap", "    height: {law: constant, value: 1 m}\n    #",
     ["s.yaml:7:3: ", "out of reach at t = 0 s: height misses its value by 1 m", "track = 0 m, pivot = 0 deg"]),
    (SCENARIO, "{law: trapezoid, from: 0 m, to: 0.2 m, acceleration: 1 m/s^2, begin: 0 s}",
     "{law: table, file: sliderr.urdf}", ["s.yaml:8:31: the file ", "sliderr.urdf' does not exist", "slider.urdf"]),
    (SCENARIO, "{law: trapezoid, from: 0 m, to: 0.2 m, acceleration: 1 m/s^2, begin: 0 s}",
     "{law: table, file: slider.urdf}", ["s.yaml:8:31: ", "slider.urdf"]),
    (SCENARIO, "[x, joint.pivot.effort]", "[x, 1/(0*x)]",
     ["s.yaml:13:14: 1/(0*x) is not finite at t = 0 s, where track = 0 m, pivot = 0 deg, nor in 8 more rows"]),
    (STATICS, "hold: {track: 0 m}", "hold: {track: 0 m, pivot: 0}", ["s.yaml:6:22: 'pivot' is held and swept"]),
    (SCENARIO, "    push: {kind", "    spring: {kind", ["s.yaml:12:5: the mechanism has a force 'spring' already"]),
    (STATICS, "  hold: {track: 0 m}\n", "", ["s.yaml:3:1: 2 coordinates have to follow a law and 1 do"]),
    (STATICS, "to: 30 deg", "to: -30 deg", ["s.yaml:5:10: the range begins and ends at the same value"]),
    (STATICS, "over: {", "over: {track: {from: 0 m, to: 1 m}, ", ["s.yaml:5:3: "]),
    (SCENARIO, "end: 1 s", "end: -1 s", ["s.yaml:6:27: the time ends at -1 s, not after its start at 0 s"]),
    (SCENARIO, "title: Cart and rod", "gravity: {magnitude: -9.81 m/s^2}",
     ["s.yaml:2:22: -9.81 is out of bounds", "at least 0"]),
    # profiles over coordinates
    (SCENARIO, PIVOT, "{law: over, of: track, profile: {law: constant_speed, speed: 1 rad/s}}",
     ["s.yaml:9:73: 'rad/s' is not a unit", "such as 1/m"]),
    (SCENARIO, PIVOT, "{law: over, of: track, period: 1 m, profile: {law: constant_speed, speed: 1 rad/m}}",
     ["s.yaml:9:43: the profile does not close: its value is 0 at 0 and 1 after a period"]),
    (SCENARIO, "effort: {law: constant, value: 3 N}", "period: 1 rad, effort: {law: constant, value: 3 N}",
     ["s.yaml:12:54: a law over time has no period"]),
    # the answer key
    (SCENARIO, ENTRY, "{quantity: x, value: 1 m}", ["s.yaml:17:5: the key 'source' is missing"]),
    (SCENARIO, ENTRY, "{quantity: x, source: s}",
     ["s.yaml:17:5: an expectation needs a value, a formula or a published"]),
    (SCENARIO, ENTRY, "{quantity: x, published: 1 m, verdict: misprint, source: s}",
     ["s.yaml:17:5: a misprint can only be confirmed"]),
    (SCENARIO, ENTRY, "{quantity: x, formula: t, source: s}", ["s.yaml:17:28: ", "the same dimension"]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "old", "new", "says"), SCENARIOS, ids=[f"{new[:40]}" for _, _, new, _ in SCENARIOS])
def test_mistakes_in_a_scenario(here: Path, text: str, old: str, new: str, says: list[str]) -> None:
    told = message(changed(text, old, new))
    assert [part for part in says if part not in told] == [], told


MECHANISMS = [
    ("along: z", "along: up", ["slider.yaml:6:44: unknown along 'up'"]),
    ("point: rod", "point: rood", ["slider.yaml:", "the model has no link 'rood'", "try: rod"]),
    ("of: [pivot]", "of: [pivot, track]", ["slider.yaml:", "cannot mix angles and lengths"]),
    ("  turn:", "  track:", ["slider.yaml:", "the coordinate 'track' has the name of a joint"]),
    ("efficiency: 0.8", "efficiency: -0.8", ["slider.yaml:9:48: -0.8 is out of bounds", "more than 0"]),
    ("ratio: 50", "ratio: 0", ["slider.yaml:9:32: 0 is out of bounds"]),
    ("drives:\n", "drives:\n  second: {joint: pivot}\n",
     ["slider.yaml:10:18: the joint 'pivot' has two drives, 'second' and 'motor'", "one drive at each joint"]),
    ("symbols:", "loops: {L: {kind: universal, between: [rod, rod], axes: [A, y]}}\nsymbols:",
     ["slider.yaml:12:58: unknown axes 'A'", "one of -x, -y, -z, x, y, z"]),
    *[(old, new, [f"slider.yaml:{place}: 1e+308 is out of bounds", f"a size of at most {most}", "check the exponent"])
      for old, new, place, most in [("100 N/m", "1e308 N/m", "11:57", "1e+100"),
                                    ("ratio: 50", "ratio: 1e308", "9:32", "1e+100"),
                                    ("symbols:", "payloads: {p: {point: rod, mass: 1e308 kg}}\nsymbols:", "12:34",
                                     "1e+50")]],
    ("x: joint.track.position", "x: joint.trak.position", ["joint.trak.position", "try: joint.track.position"]),
    ("arguments: {}", "arguments: {m: 5 kgs}", ["slider.yaml:3:16: unknown unit 'kgs'", "try: kg"]),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "says"), MECHANISMS, ids=[new for _, new, _ in MECHANISMS])
def test_mistakes_in_a_mechanism(here: Path, old: str, new: str, says: list[str]) -> None:
    (here / "slider.yaml").write_text(changed(MECHANISM, old, new))
    told = message(SCENARIO)
    assert [part for part in says if part not in told] == [], told


MODELS = [
    ('<mass value="2"/>', '<mass value="-2"/>', ["slider.urdf:5:3: link 'rod': the mass is negative (-2 kg)"]),
    ('<mass value="2"/>', '<mass value="1e308"/>',
     ["slider.urdf:5:3: link 'rod': its mass is 1e+308 kg", "at most 1e+50 kg", "check the exponent"]),
    ('<link name="cart"><inertial><mass value="1"/>\n    <inertia ixx="1" iyy="1"',
     '<link name="cart"><inertial><mass value="1"/>\n    <inertia ixx="1e200" iyy="1e200"',
     ["slider.urdf:3:3: link 'cart': its largest moment of inertia is 1e+200 kg*m^2", "at most 1e+100 kg*m^2"]),
    ('<mass value="2"/>', '<mass value="two"/>', ["slider.urdf:5:3: link 'rod': mass: 'two' is not a finite number"]),
    ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', ["slider.urdf:9:3: joint 'pivot': its axis is 0 0 0"]),
    ('<child link="rod"/>', '<child link="rood"/>',
     ["slider.urdf:9:3: joint 'pivot': its child link 'rood' does not exist", "try: rod"]),
    ('<mass value="2"/>\n    <inertia ixx="1" iyy="1" izz="1"',
     '<mass value="2"/>\n    <inertia ixx="1" iyy="1" izz="3"',
     ["slider.urdf:5:3: link 'rod': no body has principal moments of inertia 1, 1, 3", "defects: noted"]),
    ('<link name="base"/>', '<link name="base"/><link name="base"/>',
     ["slider.urdf: two links have the name 'base'", "a name of its own"]),
    ('type="continuous"', 'type="hinge"', ["slider.urdf:9:3: joint 'pivot': its type is 'hinge'", "one of continuous"]),
    ("</robot>", '<link name="alone"/></robot>', ["slider.urdf: ", "alone"]),
    ('<parent link="cart"/>', '<parent link="rod"/>', ["slider.urdf: ", "joint pivot hang"]),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "says"), MODELS, ids=[new for _, new, _ in MODELS])
def test_mistakes_in_a_model(here: Path, old: str, new: str, says: list[str]) -> None:
    (here / "slider.urdf").write_text(changed(URDF, old, new))
    told = message(SCENARIO)
    assert [part for part in says if part not in told] == [], told


ARGUMENTS = [
    ("{m: 3}", ["s.yaml:3:16: the argument m: '3' has no unit", "try: 3 kg"]),
    ("{m: true}", ["s.yaml:3:16: "]), ("{m: 3 m}", ["s.yaml:3:16: the argument m: 'm' is not a unit", "such as kg"]),
    ("{M: 3 kg}", ["s.yaml:3:13: the model has no argument 'M'", "one of m"]),
    ("{m: .inf}", ["s.yaml:3:16: "]), ("{m: [1]}", ["s.yaml:3:13: "]),
    ("{m: -3 kg}", ["the mass is negative (-3 kg)"]),
]  # fmt: skip


@pytest.mark.parametrize(("given", "says"), ARGUMENTS, ids=[given for given, _ in ARGUMENTS])
def test_mistakes_in_arguments(here: Path, given: str, says: list[str]) -> None:
    """Where the mechanism file says the unit of an argument, a scenario has to write one: 250 might be millimetres."""
    xacro = changed(URDF, '<robot name="slider">', '<robot name="slider" xmlns:xacro="http://www.ros.org/wiki/xacro">'
                    '<xacro:arg name="m" default="2"/>').replace('mass value="2"', 'mass value="$(arg m)"')  # fmt: skip
    (here / "slider.urdf.xacro").write_text(xacro)
    (here / "slider.yaml").write_text(
        MECHANISM.replace("slider.urdf", "slider.urdf.xacro").replace("arguments: {}", "arguments: {m: kg}")
    )
    good = changed(SCENARIO, "title: Cart and rod\n", "") + "arguments: {m: 3 kg}\n"
    (here / "s.yaml").write_text(good)
    assert pinarm.load("s.yaml").mechanism.arguments == {"m": 3.0}
    old = "title: Cart and rod\nmechanism: slider.yaml"
    told = message(changed(SCENARIO, old, f"mechanism: slider.yaml\narguments: {given}"))
    assert [part for part in says if part not in told] == [], told
