"""What simplification knows of free motions, for every field: none is forgotten where one is added."""

from typing import get_type_hints

import msgspec
import pytest

from pinarm.engine.motion.prescribed_motion import PrescribedTable
from pinarm.mechanics.forces.along_coordinate import JointSpring
from pinarm.mechanics.laws import Constant
from pinarm.problems import KINDS, problem_class
from pinarm.problems.forward import Forward
from pinarm.problems.simplification import without
from pinarm.problems.time_grid import TimeGrid

pytestmark = pytest.mark.house

WATCHED = {"events", "control", "end_stops", "initial"}
"""Fields that name coordinates which are not locked, and initial values, which coordinates with laws must not have."""


def test_what_is_said_of_a_locked_coordinate_is_left_out() -> None:
    both = "locked", "other"
    laws = dict.fromkeys(both, Constant(value=0.5))
    loads = {"s": JointSpring(joint="locked", stiffness=1.0)}
    problem = Forward(time=TimeGrid(end=1.0), start=dict.fromkeys(both, 0.5), motion=laws, loads=loads)
    known = {"time", "start", "motion", "loads", *WATCHED}
    assert {*Forward.__struct_fields__} == known, "say in `without` what becomes of it"
    left = without(problem, {"locked"})
    assert "locked" not in str(msgspec.to_builtins(left, enc_hook=float))
    assert [*left.motion] == [*left.start] == ["other"]


def test_kinds_whose_motion_laws_determine_prepare_a_table_of_what_is_prescribed() -> None:
    prepared = {kind: get_type_hints(problem_class(kind).prepare).get("return") for kind in KINDS}
    assert {kind for kind, table in prepared.items() if table is PrescribedTable} == {
        kind for kind, entry in KINDS.items() if entry.prescribing
    }
