"""The jobs of a chunk: those that differ by numbers only are solved as one array, the others one by one.

The numbers of a case do not depend on those that are solved with it. They are the same to the last digit however cases
are spread over workers: loops are followed from an anchor of the task, whatever case comes first.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice

from pinarm.input.xacro.templates import WAYS
from pinarm.use.cases.case import Case, Row, Task, solve_case
from pinarm.use.cases.columns import Kind, kind_of, of_kind
from pinarm.use.cases.stack import Stack
from pinarm.use.workers.worker import Late

Job = tuple[int, str, Case]
"""A case, its digest, and its values."""

KINDS = 8
"""Kinds of cases of which what they have in common is kept."""


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

    def __call__(self, job: Job) -> Row:
        """Solve one case by itself."""
        return solve_case(self.task, job[2])

    def together(self, jobs: Sequence[Job], late: Late = lambda: False) -> Iterator[Row]:
        """Yield the rows of jobs in their order; each is solved when it is asked for, or with one before it.

        Args:
            jobs: The jobs.
            late: Tells whether to end as soon as all that is solved has been yielded.
        """
        left: dict[Kind, deque[int]] = {}
        kinds = [kind_of(job[2]) for job in jobs]
        for place, kind in enumerate(kinds):
            left.setdefault(kind, deque()).append(place)
        rows: dict[int, Row] = {}
        for place, kind in enumerate(kinds):
            if place not in rows:
                if not rows and late():
                    return
                rows |= self._solved(self._known(kind), left[kind], jobs)
            yield rows.pop(place)

    def _solved(self, known: _Known, places: deque[int], jobs: Sequence[Job]) -> dict[int, Row]:
        """Return the rows of the first of some places, or of several; they are taken from these."""
        first, last = jobs[places[0]], jobs[places[-1]]
        if not known.anchored:
            self._anchor(known, first, last)
        if not known.alone and not known.stacks:
            row = self._begin(known, first, last)
            if self.task.anchors and known.stacks and known.stacks[0].follows:
                known.stacks, known.alone = [], True  # numbers would depend on which case comes first
            if not known.stacks:
                return {places.popleft(): row}
        if known.alone:
            place = places.popleft()
            return {place: self(jobs[place])}
        some = [places.popleft() for _ in islice(range(len(places)), known.stacks[0].most)]
        rows = dict[int, Row]()
        for stack in known.stacks:
            left = [place for place in some if place not in rows]
            found = zip(left, stack.rows([jobs[place][2] for place in left]), strict=True)
            rows |= {place: row for place, row in found if row is not None}
        return rows | {place: self._other(known, jobs[place]) for place in some if place not in rows}

    def _anchor(self, known: _Known, first: Job, last: Job) -> None:
        """Begin with the first anchor that can be solved."""
        known.anchored = True
        for anchor in self.task.anchors:
            own = of_kind(anchor, first[2])
            if own is not None and not known.alone and not known.stacks:
                self._begin(known, (-1, "", own), last)

    def _other(self, known: _Known, job: Job) -> Row:
        """Return the row of a case that no stack takes; it may begin another one."""
        count = len(known.stacks)
        if count == WAYS or known.stacks[0].follows:
            return self(job)
        row = self._begin(known, job, job)
        (own,) = known.stacks[-1].rows([job[2]]) if len(known.stacks) > count else (None,)
        return own or row

    def _begin(self, known: _Known, first: Job, last: Job) -> Row:
        """Solve a case alone, return its row, and begin a stack with it where both ways agree on it and on another."""
        stack, row = Stack.begin(self.task, first[2])
        if stack is None:
            known.alone = known.alone or not (row.error or known.stacks)
            return row
        try:
            own = stack.agrees(first[2], row)
            others = own if last is first else stack.agrees(last[2], self(last))
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
