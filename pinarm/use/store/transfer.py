"""A result on its way to another process: what a folder of it would hold, without the folder.

Solved motions and bound forces hold functions, which no other process knows. The rows go over to the last bit; states
at other instants are solved anew when they are asked for, as for a result that is read from a folder.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pinarm.engine.mechanism import Mechanism
from pinarm.engine.motion.outcome import Outcome
from pinarm.use.result.result import Result
from pinarm.use.scenario.scenario import Scenario
from pinarm.use.store.restore import SolvedAnew, trajectory_of
from pinarm.use.store.save import states


@dataclass(frozen=True, eq=False)
class TransferredResult:
    """The parts of a result.

    Attributes:
        scenario: Its question.
        mechanism: The whole mechanism.
        states: Arrays of its rows; see ``store.save.states``.
        outcome: Fields of its outcome but for rows and motion.
        measured: Figures, errors and what else the result has been given.
    """

    scenario: Scenario
    mechanism: Mechanism
    states: Mapping[str, Any]
    outcome: Mapping[str, Any]
    measured: Mapping[str, Any]

    @classmethod
    def of(cls, result: Result) -> TransferredResult:
        """Return the parts of a result."""
        outcome = {"figures": dict(result.outcome.figures), "events": tuple(result.outcome.events),
                   "notes": result.outcome.notes}  # fmt: skip
        names = ("figures", "errors", "setting", "removals", "known")
        return cls(
            Scenario.of_data(result.data, result.folder.absolute() / f"{result.name}.yaml"),
            result.trajectory.mechanism, states(result.trajectory), outcome,
            {name: getattr(result, name) for name in names},
        )  # fmt: skip

    def result(self) -> Result:
        """Return the result again."""
        scenario, mechanism = self.scenario, self.mechanism
        rows = trajectory_of(scenario, mechanism, self.states)
        motion = None if rows.numbered else SolvedAnew(scenario, mechanism, rows.grid.cuts)
        outcome = Outcome(rows, motion, **self.outcome)
        return replace(scenario.result(outcome), **self.measured)
