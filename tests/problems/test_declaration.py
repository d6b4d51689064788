"""What simplification knows of a problem, for every kind and every field: none is forgotten where one is added."""

from typing import Any, get_args, get_type_hints

import msgspec
import pytest

from pinarm.engine.motion.prescribed_motion import PrescribedTable
from pinarm.input.yaml.schema import Level, Rate, SecondRate, with_types
from pinarm.mechanics.control.kinds import Control, Pid
from pinarm.mechanics.forces.kinds import Force
from pinarm.mechanics.laws import Constant, Motion
from pinarm.problems import KINDS, problem_class
from pinarm.problems.drives import EffortSharing, Share
from pinarm.problems.events import EndStop, Event
from pinarm.problems.forward import InitialState
from pinarm.problems.inverse import Range
from pinarm.problems.laws import NearestPosture
from pinarm.problems.simplification import without
from pinarm.problems.time_grid import TimeGrid

pytestmark = pytest.mark.house

MADE = {
    Level: 0.5, Rate: 0.5, SecondRate: 0.5, Range: Range(start=0.0, end=1.0), Event: Event(when="joint", reaches=1.0),
    EndStop: EndStop(lower=0.0),
}  # fmt: skip
"""A value of every type that stands by the name of a coordinate, or of an event of one."""

NO_NAMES = {TimeGrid: TimeGrid(end=1.0), InitialState: InitialState()}
"""Values of fields that name no coordinate that can be removed: initial values of coordinates with laws are refused."""


def value_of(field: Any, *names: str) -> Any:
    """A value of a field that names coordinates; a type that this test does not know makes it fail."""
    if field in NO_NAMES:
        return NO_NAMES[field]
    if field == Share | None:
        return EffortSharing(weights=dict.fromkeys(names, 1.0))
    if field == NearestPosture | None:
        return NearestPosture(nearest_to=dict.fromkeys(names, 0.5))
    arguments = get_args(field)
    assert arguments, f"{field}: say in this test what such a field holds"
    if field == list[str]:
        return list(names)
    if field == list[dict[str, Level]]:
        return [dict.fromkeys(names, 0.5)]
    if field == list[Control]:
        return [Pid(drive=name, follows=Constant(value=0.5), kp=1.0) for name in names]
    kind = arguments[1]
    if kind in MADE:
        return dict.fromkeys(names, MADE[kind])
    assert kind in (Motion, Force), f"{kind}: say in this test what such a field holds"
    return dict.fromkeys(names, Constant(value=0.5)) if kind == Motion else {}


def fields_of(kind: str) -> dict[str, Any]:
    """The fields of a kind of problem with their types, as they are without ``Annotated``."""
    problem = problem_class(kind)
    hints = get_type_hints(with_types(problem, problem.deferred))
    return {name: hints[name] for name in problem.__struct_fields__}


def naming(kind: str, name: str) -> Any:
    """A problem in which one field names a joint; what has no default names another one."""
    fields = fields_of(kind)
    required = [f.name for f in msgspec.structs.fields(problem_class(kind)) if f.required]
    names = ["joint"] if name == "over" else ["joint", "other"]  # one is swept at most
    given = {each: value_of(fields[each], "other") for each in required}
    return problem_class(kind)(**{**given, name: value_of(fields[name], *names)})


FIELDS = [(kind, name) for kind in KINDS for name in fields_of(kind)]
DECLARED = [(kind, name) for kind, name in FIELDS if kind not in ("equilibria", "linear", "recorded")]
UNDECLARED = ("share", "resolve")
"""Fields with which a problem says nothing: every effort, or every joint, depends on all others."""

SEPARATE = [(kind, name) for kind, name in DECLARED if name not in UNDECLARED]


@pytest.mark.parametrize(("kind", "name"), DECLARED)
def test_what_is_said_of_a_removed_coordinate_is_left_out(kind: str, name: str) -> None:
    """Of what is swept or watched nothing is: its coordinate is never removed. Where all depend on all, none is."""
    problem = naming(kind, name)
    declared = problem.declaration()
    assert (declared is None) == (name in UNDECLARED)
    if declared is None:
        return
    if {"joint"} & {*declared.moved, *declared.watched} or name == "end_stops":
        return
    assert "joint" not in str(msgspec.to_builtins(without(problem, {"joint"}), enc_hook=float))


@pytest.mark.parametrize(("kind", "name"), SEPARATE)
def test_a_coordinate_that_is_prescribed_or_watched_is_declared(kind: str, name: str) -> None:
    """A rough start, and rates of what is held elsewhere, impose nothing."""
    problem = naming(kind, name)
    declared = problem.declaration()
    said = "joint" in str(msgspec.to_builtins(getattr(problem, name), enc_hook=str))
    known = {*declared.prescribed, *declared.watched, *declared.drives, *declared.loads}
    assert ("joint" in known) == (said and name not in ("start", "velocity", "acceleration", "end_stops"))


def test_kinds_whose_motion_laws_determine_prepare_a_table_of_what_is_prescribed() -> None:
    prepared = {kind: get_type_hints(problem_class(kind).prepare).get("return") for kind in KINDS}
    assert {kind for kind, table in prepared.items() if table is PrescribedTable} == {
        kind for kind, entry in KINDS.items() if entry.prescribing
    }
