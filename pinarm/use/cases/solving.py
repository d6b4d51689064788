"""Solution of cases: those that differ by numbers only are solved as one array, the others one by one.

The numbers of a case do not depend on those that are solved with it. They are the same to the last digit however cases
are spread over workers: all cases of a kind are solved beside one base, the scenario with the values of the kind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

from pinarm.use.cases.case import Case, Row, Task, Value, is_column, solve_case
from pinarm.use.cases.stack import Stack
from pinarm.use.workers.runners import Runners
from pinarm.use.workers.worker import LostJob

KINDS = 8
"""Kinds of cases whose stacks are kept."""

Kind = tuple[tuple[str, Value], ...] | None
"""Values common to cases that may be solved together; ``None`` for a case that varies no ``column``."""


def kind_of(values: Case) -> Kind:
    """Return the kind of a case: its values but for those of columns."""
    kept = tuple([(path, "" if is_column(path) else value) for path, value in values.items()])
    return kept if any(map(is_column, values)) else None


@dataclass(eq=False)
class _Known:
    """A kind of cases: its stack, if there is one, and whether a case was the same solved by it and alone."""

    stack: Stack | None
    agreed: bool = False


@dataclass(frozen=True)
class CaseSolver:
    """Solves the cases of a task, in this process or in a worker."""

    task: Task

    def __call__(self, case: Case) -> Row:
        return solve_case(self.task, case)

    def together(self, cases: Sequence[Case]) -> Iterator[tuple[list[int], list[Row]]]:
        """Yield places of cases and their rows: of those that are solved at once, or of one."""
        groups = dict[Kind, dict[int, Case]]()
        for place, case in enumerate(cases):
            groups.setdefault(kind_of(case), {})[place] = case
        for kind, some in groups.items():
            stack = None if kind is None else self._stack(kind, [*some.values()])
            rows = dict(zip(some, stack.rows([*some.values()]), strict=True)) if stack else {}
            solved = {place: row for place, row in rows.items() if row is not None}
            if solved:
                yield [*solved], [*solved.values()]
            yield from (([place], [self(case)]) for place, case in some.items() if place not in solved)

    def _stack(self, kind: Kind, cases: Sequence[Case]) -> Stack | None:
        """Return the stack of a kind, compared with one of its cases alone; ``None`` where there is none.

        Where both ways differ, all cases of the kind are solved one by one. A case that fails decides nothing.
        """
        known = self._kinds.pop(kind, None) or _Known(Stack.begin(self.task, dict(kind or ())))
        self._kinds[kind] = known
        if len(self._kinds) > KINDS:
            del self._kinds[next(iter(self._kinds))]
        for place in dict.fromkeys((len(cases) - 1, 0, len(cases) // 2)):
            if known.agreed or not known.stack:
                break
            agreed = known.stack.agrees(cases[place], self(cases[place]))
            known.agreed, known.stack = bool(agreed), None if agreed is False else known.stack
        return known.stack if known.agreed else None

    @cached_property
    def _kinds(self) -> dict[Kind, _Known]:
        """The kinds that were used last, the last one at the end."""
        return {}


SolveCases = Callable[[Iterable[Case]], Iterator[Row]]
"""Cases -> their rows, in their order, each solved when it is asked for or before."""


@contextmanager
def solving(task: Task, runners: Runners) -> Iterator[SolveCases]:
    """Yield a function that solves cases, as often as it is called; workers end with the block."""
    with runners.applying(CaseSolver(task)) as apply:
        yield lambda cases: map(row_of, apply(cases))


def row_of(answer: Row | LostJob) -> Row:
    """Return the row of a case, also of one that has no answer."""
    return Row((), answer.reason, final=False) if isinstance(answer, LostJob) else answer
