"""What kinds of problem say of themselves."""

from typing import get_type_hints

import pytest

from pinarm.engine.motion.prescribed_motion import PrescribedTable
from pinarm.problems import KINDS, problem_class

pytestmark = pytest.mark.house


def test_kinds_whose_motion_laws_determine_prepare_a_table_of_what_is_prescribed() -> None:
    prepared = {kind: get_type_hints(problem_class(kind).prepare).get("return") for kind in KINDS}
    assert {kind for kind, table in prepared.items() if table is PrescribedTable} == {
        kind for kind, entry in KINDS.items() if entry.prescribing
    }
