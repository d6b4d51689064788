"""Solution of cases: those that differ by numbers only are solved as one array, the others one by one.

The numbers of a case do not depend on those that are solved with it. They are the same to the last digit however cases
are spread over workers: loops are followed from an anchor of the task, whatever case comes first.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinarm.arrays import Indices
from pinarm.use.cases.case import Case, Row, Task, solve_case
from pinarm.use.cases.case_table import Kind, RowTable, SomeCases, grouped, of_kind, tabled
from pinarm.use.cases.stack import EXPANDED, Stack
from pinarm.use.workers.runners import Runners
from pinarm.use.workers.worker import LostJob

Part = tuple[Indices, RowTable | list[Row]]
"""Places of cases, and their rows."""

KINDS = 8
"""Kinds of cases whose stacks are kept."""


@dataclass(eq=False)
class _Known:
    """A kind of cases: its stack, whether they can only be solved one by one, whether the anchors have been tried."""

    stack: Stack | None = None
    alone: bool = False
    anchored: bool = False


@dataclass(frozen=True)
class CaseSolver:
    """Solves the cases of a task, in this process or in a worker."""

    task: Task

    def __call__(self, case: Case) -> Row:
        """Solve one case by itself."""
        return solve_case(self.task, case)

    def together(self, cases: SomeCases) -> Iterator[tuple[list[int], RowTable | list[Row]]]:
        """Yield places of cases and their rows: of those that are solved at once, or of one."""
        for kind, places in grouped(cases).items():
            while len(places):
                parts = self._solved(self._known(kind), places, cases)
                places = places[sum(len(some) for some, _ in parts) :]
                yield from ((some.tolist(), rows) for some, rows in parts)

    def _solved(self, known: _Known, places: Indices, cases: SomeCases) -> list[Part]:
        """Return the rows of the first of some places, or of several."""
        first, last = cases[int(places[0])], cases[int(places[-1])]
        if not known.anchored:
            known.anchored = True
            for anchor in self.task.anchors:
                case = of_kind(anchor, first)
                if case is not None and not known.alone and not known.stack:
                    self._begin(known, case, last)
        if not known.alone and not known.stack:
            row = self._begin(known, first, last)
            if self.task.anchors and known.stack and known.stack.follows:
                known.stack, known.alone = None, True  # numbers would depend on which case comes first
            if not known.stack:
                return [(places[:1], [row])]
        if known.alone or not known.stack:
            return [(places[:1], [self(first)])]
        some = places[:EXPANDED]
        solved, rows = known.stack.rows(tabled(cases, some))
        parts: list[Part] = [(some[solved], rows)] if len(solved) else []
        return [*parts, *((np.array([place]), [self(cases[place])]) for place in np.delete(some, solved).tolist())]

    def _begin(self, known: _Known, first: Case, last: Case) -> Row:
        """Solve a case alone, return its row, and begin a stack with it where both ways agree on it and on another."""
        stack, row = Stack.begin(self.task, first)
        if stack is None:
            known.alone = known.alone or not row.error
            return row
        try:
            agreed = stack.agrees(first, row)
            others = agreed if last == first else stack.agrees(last, self(last))
        except Exception:  # a fault of the program too costs time only
            agreed = others = False
        if agreed and others is not False:
            known.stack = stack
        elif False in (agreed, others):
            known.alone = True
        return row

    def _known(self, kind: Kind) -> _Known:
        """Return the state of a kind, the last used ones of which are kept."""
        known = self._kinds.setdefault(kind, _Known(alone=kind is None))
        self._kinds.move_to_end(kind)
        while len(self._kinds) > KINDS:
            self._kinds.popitem(last=False)
        return known

    @cached_property
    def _kinds(self) -> OrderedDict[Kind, _Known]:
        return OrderedDict()


SolveCases = Callable[[Iterable[Case]], Iterator[Row]]
"""Cases -> their rows, in their order, each solved when it is asked for or before."""


@contextmanager
def solving(task: Task, runners: Runners) -> Iterator[SolveCases]:
    """Yield a function that solves cases, as often as it is called; workers end with the block.

    Args:
        task: What is the same in all cases.
        runners: Who solves them.
    """
    with runners.applying(CaseSolver(task)) as apply:

        def solve(cases: Iterable[Case]) -> Iterator[Row]:
            return (Row((), row.reason, final=False) if isinstance(row, LostJob) else row for row in apply(cases))

        yield solve
