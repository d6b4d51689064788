"""All extreme cases, area by area."""

from __future__ import annotations

from extreme_bodies import CASES as BODIES
from extreme_loops import CASES as LOOPS
from extreme_times import CASES as TIMES

TOGETHER = [*BODIES, *LOOPS, *TIMES]
AREAS = list(dict.fromkeys(case.area for case in TOGETHER))
CASES = sorted(TOGETHER, key=lambda case: AREAS.index(case.area))
