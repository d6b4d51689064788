"""Solution of cases: those that differ by numbers only are solved as one array, the others one by one.

The numbers of a case do not depend on those that are solved with it. They are the same to the last digit however cases
are spread over workers: loops are followed from an anchor of the task, whatever case comes first.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from pinarm.arrays import Indices
from pinarm.use.cases.case import Case, Row, Task, solve_case
from pinarm.use.cases.case_table import CaseTable, Kind, RowTable, SomeCases, grouped, of_kind, tabled
from pinarm.use.cases.stack import EXPANDED, Stack
from pinarm.use.workers.runners import Runners
from pinarm.use.workers.worker import LostJob

Part = tuple[Indices, RowTable | list[Row]]
"""Places of cases, and their rows."""

KINDS = 8
"""Kinds of cases of which what they have in common is kept."""

WAYS = 8
"""Most stacks of cases of one kind: each way through branches of the model that depend on numbers has its own."""


@dataclass(eq=False)
class _Known:
    """What is known of cases of one kind.

    Attributes:
        stacks: What they have in common: one for each branch that the model takes.
        alone: Whether they can only be solved one by one.
        anchored: Whether the task's anchors have been tried.
    """

    stacks: list[Stack] = field(default_factory=list)
    alone: bool = False
    anchored: bool = False


@dataclass(frozen=True)
class CaseSolver:
    """What workers do with cases.

    Attributes:
        task: What is the same in all cases.
    """

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
            self._anchor(known, first, last)
        if not known.alone and not known.stacks:
            row = self._begin(known, first, last)
            if self.task.anchors and known.stacks and known.stacks[0].follows:
                known.stacks, known.alone = [], True  # numbers would depend on which case comes first
            if not known.stacks:
                return [(places[:1], [row])]
        if known.alone:
            return [(places[:1], [self(first)])]
        left, parts = places[:EXPANDED], list[Part]()
        for stack in known.stacks:
            if len(left):
                solved, rows = stack.rows(tabled(cases, left))
                parts += [(left[solved], rows)] if len(solved) else []
                left = np.delete(left, solved)
        return parts + [(left[k : k + 1], [self._other(known, cases[place])]) for k, place in enumerate(left.tolist())]

    def _anchor(self, known: _Known, first: Case, last: Case) -> None:
        """Begin with the first anchor that can be solved."""
        known.anchored = True
        for anchor in self.task.anchors:
            own = of_kind(anchor, first)
            if own is not None and not known.alone and not known.stacks:
                self._begin(known, own, last)

    def _other(self, known: _Known, case: Case) -> Row:
        """Return the row of a case that no stack takes; it may begin another one."""
        count = len(known.stacks)
        if count == WAYS or known.stacks[0].follows:
            return self(case)
        row = self._begin(known, case, case)
        if len(known.stacks) == count:
            return row
        _, rows = known.stacks[-1].rows(CaseTable.of([case]))
        return rows[0] if len(rows) else row

    def _begin(self, known: _Known, first: Case, last: Case) -> Row:
        """Solve a case alone, return its row, and begin a stack with it where both ways agree on it and on another."""
        stack, row = Stack.begin(self.task, first)
        if stack is None:
            known.alone = known.alone or not (row.error or known.stacks)
            return row
        try:
            own = stack.agrees(first, row)
            others = own if last == first else stack.agrees(last, self(last))
        except Exception:  # a fault of the program too costs time only
            own = others = False
        if own and others is not False:
            known.stacks.append(stack)
        elif False in (own, others) and not known.stacks:
            known.alone = True
        return row

    def _known(self, kind: Kind) -> _Known:
        """Return what is known of a kind, the last used ones of which are kept."""
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
    """Yield what solves cases, as often as it is asked; workers end with the block.

    Args:
        task: What is the same in all cases.
        runners: Who solves them.
    """
    with runners.applying(CaseSolver(task)) as apply:

        def solve(cases: Iterable[Case]) -> Iterator[Row]:
            return (Row((), row.reason, final=False) if isinstance(row, LostJob) else row for row in apply(cases))

        yield solve
