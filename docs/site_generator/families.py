"""The families of kinds that have a page for each member: what they are called, and the definitions of their keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args

import pinarm
from pinarm.engine.integration.methods import METHODS
from pinarm.mechanics.control.kinds import Control
from pinarm.mechanics.coordinates import CoordinateDefinition
from pinarm.mechanics.couplings.kinds import CouplingDefinition
from pinarm.mechanics.forces.kinds import Force
from pinarm.mechanics.laws.over_coordinate import Motion
from pinarm.mechanics.loops.kinds import Loop
from pinarm.mechanics.motors import AnyMotor
from pinarm.problems import KINDS, problem_class
from pinarm.use.assessments import ASSESSMENTS


@dataclass(frozen=True)
class Kinds:
    """A family.

    Attributes:
        name: Folder of its pages, and of its examples in ``docs/kind_examples``.
        title: Heading.
        one: What a member is called, with an article.
        text: Where members stand in files, and what they have in common.
        members: Name in files -> name of the definition in the JSON Schemas; text in place of it for a kind that a
            model file says, and no key.
        pictures: What is drawn of the examples: names in ``kind_pages.PICTURES``.
        sign: How the example of a member says it, a regular expression with ``{member}`` for its name.
    """

    name: str
    title: str
    one: str
    text: str
    members: Mapping[str, str]
    pictures: Sequence[str] = ("positions", "curves")
    sign: str = r"\bkind: {member}\b"


@cache
def definitions() -> dict[str, Any]:
    """Return the definitions of both JSON Schemas by name."""
    return {**pinarm.schema("mechanism")["$defs"], **pinarm.schema("scenario")["$defs"]}


def _union(union: Any) -> dict[str, str]:
    return {struct.__struct_config__.tag: struct.__name__ for struct in get_args(union)}


PROBLEMS = "The key `problem` of a scenario is the question: its `kind`, and what the kind needs to know."
JOINTS = """Joints of the tree stand in the model file (URDF, xacro, MJCF) or follow from a drawing. Loops of the tree
are
closed by [loop joints](../loop_joints/index.md)."""
LOOPS = """A mechanism file ties two frames of the tree: `loops: {NAME: {kind: ..., between: [first, second]}}`. Every
kind
is shown by the same body, which floats but for the joint: what moves is what the joint leaves free. `loop.NAME.force.x`
and `loop.NAME.moment.x` are the action of the first frame on the second. More about loops is in
[Loops and gears](../../loops.md)."""
COUPLINGS = """A mechanism file couples the coordinates of joints: `couplings: {NAME: {kind: ..., joints: [first,
second]}}`. Where the geometry of teeth, thread or belt is given, the reactions carry its forces."""
FORCES = """Forces belong to the mechanism, `forces: {NAME: {kind: ...}}` in its file, or to one run, `loads:` of a
problem. Every one accounts for its energy: its power is what leaves its potential and is not dissipated. Weights, and
damping, springs and dry friction of the model act without an entry."""
LAWS = """A law gives a value with its exact first and second derivatives, over time or over a coordinate. It stands
under
`motion:` (of a coordinate), `effort:` (of a load), `follows:` (of a controller). The examples move one slide; pictures
show position, velocity and acceleration. Where a derivative jumps, the table of a run has a row for either side."""
CONTROLLERS = """A controller turns what it measures into the effort of a drive, in `forward` runs: `control: [{kind:
..., drive: ...}]` of the problem, or of the mechanism file. Sampling, delay, limits and integrals are described in
[Control](../../control.md)."""
COORDINATES = """Every joint of one degree of freedom is a coordinate. A mechanism file defines others: `coordinates:
{NAME: {kind: ...}}`. A coordinate may follow a law, be driven, and be an output:
`coordinate.NAME.position`, `.velocity`, `.acceleration`."""

ASSESSED = """An assessment is a key of a scenario: what is concluded from the run. Its section of the result has
tables, numbers and remarks, which terminal, result folder, notebook and report show. More is in
[Assessments](../../assessments.md)."""
DRIVES = """A drive stands in the mechanism file: `drives: {NAME: {joint: J, ratio: N, ...}}`. Its gear and rotor count
in every problem; its motor and the losses of the gear act in the motion where a controller commands it. More is in
[Control](../../control.md)."""
FRICTION = """A mechanism file gives joints, loop joints and couplings dry friction that sticks: `friction: {NAME:
{...}}`. Its load is the reaction itself. How every problem treats it is described in [Friction](../../friction.md)."""
EVENTS = """What a motion from an initial state may meet on its way, keys of a `forward` problem: `events: {NAME:
{...}}` and `end_stops: {JOINT: {...}}`. The motion is integrated to the instant, and goes on from there. More is in
[End stops, events, cams](../../events.md)."""
INTEGRATORS = """`accuracy: {method: ..., tolerance: ...}` of a scenario says how a motion is integrated over time;
`accuracy: {target: 1e-6}` looks for the cheapest tolerance that keeps the error. Their accuracy is described in
[How accuracy is known](../../theory.md), and `tradeoff` draws it."""

RUBBING = {
    "joint": "Friction",
    "screw": """Friction along the thread of a screw, a loop joint or a coupling: `radius` is the mean one of the
thread, `flank` the angle of its flank in the axial section. The same of a worm, a gear whose first joint is the worm,
with `lead_angle`. Forces in N, velocities in m/s, both along the thread.""",
    "teeth": """Friction of the mean slip of the flanks of a `gear` or `rack` with a `pressure_angle`; `teeth` is the
number of teeth of the first wheel.""",
    "belt": """A `belt` with a pretension is held on its wheels by friction alone. It slips where the tensions of its
strands differ by more than the factor `exp(mu theta)`; until then it sticks. Its wheels are two degrees of freedom.""",
    "cam": """Friction of a `cam` along the tangent of its contact: `mu N` under a flat face or a knife edge, and
`mu N r / R` of a roller of radius R that turns on a pin of `radius` r.""",
}
"""What has friction -> its definition, or what it is."""

TREE_JOINTS = {
    "revolute": """Turns about an axis; turns are counted. `type="revolute"` has limits, `type="continuous"` has none.
Coordinate J [rad].""",
    "prismatic": "Slides along an axis. Coordinate J [m].",
    "ball": """Turns about a point: `type="spherical"` of a URDF, an extension of it, or `ball` of MJCF. Its orientation
is `J.roll`, `J.pitch`, `J.yaw` or the rotation vector `J.rotation.x`; its velocity is the angular velocity in the axes
of the child.""",
    "planar": "Two slides and a turn about the normal. Coordinates `J.x`, `J.y`, `J.angle`.",
    "floating": """Moves freely: three slides along the axes of the parent, then a ball. Coordinates `J.x`, `J.y`,
`J.z`,
and those of a ball. `base: floating` of a mechanism file gives the root such a joint.""",
}
"""Joint of the tree -> what it is: model files say them, no key does."""


def families() -> list[Kinds]:
    """Return the families in the order of the site."""
    return [
        Kinds("problems", "Problems", "a problem", PROBLEMS, {kind: problem_class(kind).__name__ for kind in KINDS}),
        Kinds("joints", "Joints", "a joint", JOINTS, TREE_JOINTS, ("solids", "curves"), ""),
        Kinds("loop_joints", "Loop joints", "a loop joint", LOOPS, _union(Loop), ("solids", "curves")),
        Kinds("couplings", "Couplings", "a coupling", COUPLINGS, _union(CouplingDefinition)),
        Kinds("forces", "Forces", "a force", FORCES, _union(Force)),
        Kinds("laws", "Laws of motion", "a law", LAWS, _union(Motion), ("curves",), r"\blaw: {member}\b"),
        Kinds("controllers", "Controllers", "a controller", CONTROLLERS, _union(Control)),
        Kinds(
            "drives",
            "Drives",
            "a drive",
            DRIVES,
            {"gear": "Drive", "elasticity": "Elasticity", **_union(AnyMotor)},
            ("curves",),
            r"\bkind: {member}\b|\b{member}: {{|\befficiency: ",
        ),
        Kinds("friction", "Friction", "friction", FRICTION, RUBBING, ("positions", "curves"), r"\bmu: "),
        Kinds("events", "Events", "an event", EVENTS, {"event": "Event", "end_stop": "EndStop"}, sign=r"\b{member}s:"),
        Kinds("coordinates", "Coordinates", "a coordinate", COORDINATES, _union(CoordinateDefinition)),
        Kinds(
            "assessments",
            "Assessments",
            "an assessment",
            ASSESSED,
            {name: struct for name, (_, struct) in ASSESSMENTS.items()},
            ("positions", "curves"),
            r"\n{member}:",
        ),
        Kinds(
            "integrators",
            "Integrators",
            "an integrator",
            INTEGRATORS,
            {name: f"{entry.summary}." for name, entry in METHODS.items()},
            ("curves",),
            r"\bmethod: {member}\b",
        ),
    ]
